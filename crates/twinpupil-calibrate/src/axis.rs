//! The optical axis from any frame of dots: the images of a dot in two bands lie on one line through it, if the masks are
//! centred; else through where the line through both pupils' centres meets the sensor.

use nalgebra::{Matrix2, Matrix4, Matrix4x2, Rotation3, SMatrix, Unit, Vector2, Vector3, Vector4};
use thiserror::Error;
use twinpupil_instrument::{Frame, Instrument, PixelPoint, Role};
use twinpupil_reconstruct::{Feature, KnownDot, KnownLight, Point, Polarity, Reconstructor, surface_slopes};

use crate::adjust::{BandCamera, ModelError, Observation};
use crate::calibrate::Foreign;
use crate::camera::cameras;
use crate::forward::{CAMERA_SLOTS, Slot, Slots, View, spot};
use crate::lattice::median;
use crate::mask_centre::{AxisByPupil, MaskCentre, mask_centres};

/// Where the optical axis meets the sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisEstimate {
    /// Its place on the reference frame, px.
    pub axis_px: [f64; 2],
    /// Covariance of u and v that noise leaves, px²: for masks where the instrument has them.
    pub covariance_px2: [[f64; 2]; 2],
    /// Covariance of u and v that the masks' centres leave, px², to be added to that.
    pub mask_covariance_px2: [[f64; 2]; 2],
    /// Every mask that is a pupil, and how the axis changes with its centre.
    pub masks: Vec<MaskCentre>,
    /// Dots that told it.
    pub dots: usize,
    /// χ² of their images over the degrees of freedom.
    pub reduced_chi2: f64,
}

/// Frames that do not tell the axis.
#[derive(Debug, Error)]
pub enum AxisError {
    /// A frame that cannot be read, or an instrument that cannot be traced.
    #[error(transparent)]
    Foreign(Foreign),
    /// Too few dots.
    #[error("the frames show {dots} dots in both bands; legal: at least {DOTS_MIN}")]
    TooFew {
        /// Dots.
        dots: usize,
    },
    /// Dots that both bands see in the same places.
    #[error(
        "the frames do not tell where the axis is: it would be known to {std_px:.1} px; the two bands see all dots in nearly \
         the same places, as they do at {focus_mm:.0} mm; legal: dots well before or behind that"
    )]
    Undetermined {
        /// Deviation of the axis, px.
        std_px: f64,
        /// Distance at which the bands have one scale, mm.
        focus_mm: f64,
    },
    /// Dots whose images are not those of this instrument.
    #[error(
        "the instrument does not explain the dots: χ² of the typical one is {chi2:.0} for each degree of freedom; legal: up to \
         {CHI2_MAX:.0}; calibrate the camera first with `twinpupil calibrate`, or the planes of the two bands are swapped"
    )]
    Unexplained {
        /// χ² of the typical dot over its degrees of freedom.
        chi2: f64,
    },
}

/// Fewest dots that tell an axis.
const DOTS_MIN: usize = 4;

/// Largest deviation of an axis that is worth the name, px.
const STD_PX_MAX: f64 = 20.0;

/// Largest χ² of the typical dot over its degrees of freedom that an instrument explains well enough for an axis: few rays a
/// pixel leave 12, a focal length that is 0.05 % off in one band some 300.
const CHI2_MAX: f64 = 500.0;

/// Times that frames are compared with the forward model.
const ROUNDS: usize = 4;

/// What the axis is found with.
pub struct AxisFinder<'a> {
    /// The instrument, with the axis somewhere.
    pub instrument: &'a Instrument,
    /// Makes an instrument ready to read frames, in model mode.
    pub reader: &'a dyn Fn(&Instrument) -> Result<Reconstructor, Foreign>,
    /// The frames.
    pub frames: &'a [Frame],
}

/// A dot in one frame, and what its images say.
struct Sighted {
    dot: KnownDot,
    scores: Vec<Option<twinpupil_reconstruct::SpotScore>>,
}

/// Information on the axis and the score that goes with it.
#[derive(Debug, Clone, PartialEq, Default)]
struct Equations {
    information: Matrix2<f64>,
    score: Vector2<f64>,
    /// How the score changes with the pupil of every band.
    by_pupil: Vec<AxisByPupil>,
    /// χ² of the typical dot over its degrees of freedom.
    typical_chi2: f64,
    chi2: f64,
    freedom: usize,
    dots: usize,
}

impl AxisFinder<'_> {
    /// Finds the axis: first from the lines through the images of every dot, then from their pixels.
    pub fn find(&self) -> Result<AxisEstimate, AxisError> {
        let mut axis_px = self.instrument.sensor.axis_px;
        for _ in 0..2 {
            let reader = self.reader_at(axis_px)?;
            axis_px = self.crossing(&self.points(&reader)?.concat())?;
        }
        let mut equations = Equations::default();
        for _ in 0..ROUNDS {
            let reader = self.reader_at(axis_px)?;
            let sighted = self.sight(&reader)?;
            let cameras = cameras(reader.instrument(), &reader.projections(), &reader.lens_terms(), 1.0);
            equations = equations_of(&sighted, &cameras, self.instrument.sensor.pitch_mm);
            if equations.dots < DOTS_MIN {
                return Err(AxisError::TooFew { dots: equations.dots });
            }
            let step = self.covariance(&equations)? * equations.score;
            axis_px = [axis_px[0] + step.x, axis_px[1] + step.y];
            if step.norm() < 1e-4 {
                break;
            }
        }
        if equations.typical_chi2 > CHI2_MAX {
            return Err(AxisError::Unexplained { chi2: equations.typical_chi2 });
        }
        let reduced_chi2 = equations.chi2 / equations.freedom.max(1) as f64;
        let covariance = self.covariance(&equations)?;
        let (masks, of_masks) = mask_centres(self.instrument, &covariance, &equations.by_pupil);
        Ok(AxisEstimate {
            axis_px,
            covariance_px2: rows(&(covariance * reduced_chi2.max(1.0))),
            mask_covariance_px2: rows(&of_masks),
            masks,
            dots: equations.dots,
            reduced_chi2,
        })
    }

    fn covariance(&self, equations: &Equations) -> Result<Matrix2<f64>, AxisError> {
        let covariance = equations.information.try_inverse();
        let std_px = covariance.map_or(f64::INFINITY, |covariance| covariance.diagonal().max().sqrt());
        match covariance {
            Some(covariance) if std_px < STD_PX_MAX => Ok(covariance),
            _ => Err(self.undetermined(std_px)),
        }
    }

    fn undetermined(&self, std_px: f64) -> AxisError {
        AxisError::Undetermined { std_px, focus_mm: self.instrument.focus_distance_mm() }
    }

    fn reader_at(&self, axis_px: [f64; 2]) -> Result<Reconstructor, AxisError> {
        let mut spec = self.instrument.clone().into_spec();
        spec.sensor.axis_px = axis_px;
        let instrument = Instrument::new(spec).map_err(|error| AxisError::Foreign(error.into()))?;
        (self.reader)(&instrument).map_err(AxisError::Foreign)
    }

    /// The points of every frame.
    fn points(&self, reader: &Reconstructor) -> Result<Vec<Vec<Point>>, AxisError> {
        let of_frame = |frame: &Frame| Ok(reader.reconstruct(frame)?.points);
        self.frames.iter().map(of_frame).collect::<Result<_, Foreign>>().map_err(AxisError::Foreign)
    }

    /// Where the lines through the images of the dots come nearest to each other.
    ///
    /// With images t and e of a dot, the axis a and × the product of two vectors across the axis,
    ///
    /// ```text
    /// (t − a) × (e − a) = t × e − a × (e − t) = 0        σ² = σ_t² |e − a|² + σ_e² |t − a|²
    /// ```
    fn crossing(&self, points: &[Point]) -> Result<[f64; 2], AxisError> {
        const ROUNDS: usize = 10;
        const DOUBT: f64 = 3.0;
        if points.len() < DOTS_MIN {
            return Err(AxisError::TooFew { dots: points.len() });
        }
        let [u, v] = self.instrument.sensor.axis_px;
        let mut axis = Vector2::new(u, v);
        let place = |centre: PixelPoint| Vector2::new(centre.u, centre.v);
        let std_px = |std_px: [f64; 2]| (0.5 * (std_px[0].powi(2) + std_px[1].powi(2))).sqrt().max(1e-3);
        let off = |point: &Point, axis: &Vector2<f64>| {
            let (t, e) = (place(point.telecentric.centre) - axis, place(point.entocentric.centre) - axis);
            let std = (std_px(point.telecentric.centre_std_px) * e.norm())
                .hypot(std_px(point.entocentric.centre_std_px) * t.norm());
            ((t.x * e.y - t.y * e.x) / std, std)
        };
        for _ in 0..ROUNDS {
            let typical = median(points.iter().map(|point| off(point, &axis).0.abs())).max(1.0);
            let (mut information, mut score) = (Matrix2::zeros(), Vector2::zeros());
            for point in points {
                let (sigmas, std) = off(point, &axis);
                let weight = (DOUBT * typical / sigmas.abs().max(1e-12)).min(1.0);
                let across = place(point.entocentric.centre) - place(point.telecentric.centre);
                // How the product changes with the axis.
                let row = Vector2::new(-across.y, across.x) / std;
                information += weight * row * row.transpose();
                score -= weight * row * sigmas;
            }
            let Some(step) = information.try_inverse().map(|covariance| covariance * score) else {
                return Err(self.undetermined(f64::INFINITY));
            };
            axis += step;
        }
        let [width, height] = self.instrument.sensor.size_px.map(|size| size as f64);
        let is_near = axis.x.abs() < 3.0 * width && axis.y.abs() < 3.0 * height;
        if is_near { Ok(axis.into()) } else { Err(self.undetermined(f64::INFINITY)) }
    }

    /// Compares the dots that a reader finds with its forward model.
    fn sight(&self, reader: &Reconstructor) -> Result<Vec<Sighted>, AxisError> {
        let mut sighted = Vec::new();
        for (frame, points) in self.frames.iter().zip(self.points(reader)?) {
            let dots = self.known_dots(reader, frame, &points).map_err(AxisError::Foreign)?;
            let scores = reader.scores(frame, &dots).map_err(|error| AxisError::Foreign(error.into()))?;
            sighted.extend(dots.into_iter().zip(scores).map(|(dot, scores)| Sighted { dot, scores }));
        }
        Ok(sighted)
    }

    fn known_dots(&self, reader: &Reconstructor, frame: &Frame, points: &[Point]) -> Result<Vec<KnownDot>, Foreign> {
        let pair = [Role::Telecentric, Role::Entocentric].map(|role| self.instrument.band_index(role));
        let mut signs = [1.0; 2];
        for (sign, band) in signs.iter_mut().zip(pair) {
            if reader.detect_band(frame, band)?.polarity == Polarity::Dark {
                *sign = -1.0;
            }
        }
        let positions: Vec<[f64; 3]> = points.iter().map(|point| point.position_mm).collect();
        let dot = |(point, slopes): (&Point, [f64; 2])| {
            let mut lights = vec![None; self.instrument.bands.len()];
            for (band, (sign, feature)) in
                pair.into_iter().zip(signs.iter().zip([point.telecentric, point.entocentric]))
            {
                let Feature { height_codes, ground_codes, .. } = feature;
                lights[band] = Some(KnownLight {
                    contrast_codes: sign * height_codes,
                    ground_codes,
                    illumination_per_px: [0.0; 2],
                    is_fitted: false,
                });
            }
            KnownDot { centre_mm: point.position_mm, slopes, diameter_mm: point.diameter_mm, lights }
        };
        Ok(points.iter().zip(surface_slopes(&positions)).map(dot).collect())
    }
}

fn rows(matrix: &Matrix2<f64>) -> [[f64; 2]; 2] {
    [[matrix.m11, matrix.m12], [matrix.m21, matrix.m22]]
}

/// Adds up what all dots say of the axis, their own places and diameters left open.
fn equations_of(sighted: &[Sighted], cameras: &[BandCamera], pitch_mm: f64) -> Equations {
    const DOUBT_CHI2: f64 = 30.0;
    let own: Vec<Own> = sighted.iter().filter_map(|one| Own::of(one, cameras, pitch_mm)).collect();
    // χ² of four numbers, of which half exceed 3.36.
    let median_chi2 = median(own.iter().map(|own| own.chi2)) / 3.36;
    let typical = median_chi2.max(1.0);
    let by_pupil = vec![Matrix2::zeros(); cameras.len()];
    let mut equations = Equations { by_pupil, typical_chi2: median_chi2, ..Equations::default() };
    for own in &own {
        let weight = (DOUBT_CHI2 * typical / own.chi2.max(1e-12)).sqrt().min(1.0);
        equations.information += weight * own.information;
        equations.score += weight * own.score;
        for (band, by_pupil) in &own.by_pupil {
            equations.by_pupil[*band] += weight * by_pupil;
        }
        equations.chi2 += weight * own.chi2;
        equations.freedom += 4;
        equations.dots += 1;
    }
    equations.freedom = equations.freedom.saturating_sub(2);
    equations
}

/// What one dot says of the axis.
struct Own {
    information: Matrix2<f64>,
    score: Vector2<f64>,
    /// How the score changes with the pupils of the bands that see it.
    by_pupil: Vec<(usize, AxisByPupil)>,
    /// Of its images about one dot in space.
    chi2: f64,
}

impl Own {
    /// `None` if it is not seen in two bands.
    fn of(sighted: &Sighted, cameras: &[BandCamera], pitch_mm: f64) -> Option<Self> {
        let (mut dot, mut dot_score) = (Matrix4::zeros(), Vector4::zeros());
        let (mut axis, mut axis_score) = (Matrix2::zeros(), Vector2::zeros());
        let mut mixed = SMatrix::<f64, 2, 4>::zeros();
        let mut best_chi2 = 0.0;
        let mut pupils: Vec<(usize, Matrix2<f64>, Matrix4x2<f64>)> = Vec::new();
        for (band, score) in sighted.scores.iter().enumerate() {
            let Some(score) = score else { continue };
            let (image, gradient) = look(&sighted.dot, &cameras[band], pitch_mm);
            let observation = Observation::new((0, band, 0), image, score.score, score.information)
                .with_model_error(ModelError::of(score))?;
            let mut to_dot = Matrix4::zeros();
            to_dot.fixed_columns_mut::<3>(0).copy_from(&gradient.fixed_columns::<3>(CAMERA_SLOTS + 3));
            to_dot.set_column(3, &gradient.column(Slot::Diameter as usize));
            let mut to_axis = Matrix4x2::zeros();
            to_axis.set_column(0, &gradient.column(Slot::AxisU as usize));
            to_axis.set_column(1, &gradient.column(Slot::AxisV as usize));
            let mut to_pupil = Matrix4x2::zeros();
            to_pupil.set_column(0, &gradient.column(Slot::PupilX as usize));
            to_pupil.set_column(1, &gradient.column(Slot::PupilY as usize));
            let seen = observation.information * to_pupil;
            pupils.push((band, to_axis.transpose() * seen, to_dot.transpose() * seen));
            let weighted = observation.information * to_dot;
            dot += to_dot.transpose() * weighted;
            dot_score += to_dot.transpose() * observation.score;
            axis += to_axis.transpose() * observation.information * to_axis;
            axis_score += to_axis.transpose() * observation.score;
            mixed += to_axis.transpose() * weighted;
            best_chi2 += observation.chi2(&image);
        }
        let factor = dot.cholesky().filter(|_| pupils.len() >= 2)?;
        let step = factor.solve(&dot_score);
        let by_pupil = pupils.iter().map(|(band, axis, dot)| (*band, axis - mixed * factor.solve(dot))).collect();
        Some(Self {
            information: axis - mixed * factor.solve(&mixed.transpose()),
            score: axis_score - mixed * step,
            by_pupil,
            chi2: (best_chi2 - step.dot(&dot_score)).max(0.0),
        })
    }
}

/// The image of a dot in a band, and its derivatives.
fn look(dot: &KnownDot, camera: &BandCamera, pitch_mm: f64) -> (Vector4<f64>, crate::forward::Gradient) {
    let [sx, sy] = dot.slopes;
    let normal = Unit::new_normalize(Vector3::new(-sx, -sy, 1.0));
    let rotation = Rotation3::rotation_between(&Vector3::z(), &normal).unwrap_or_default();
    let mut slots = Slots::zeros();
    slots.as_mut_slice()[..CAMERA_SLOTS].copy_from_slice(&camera.slots);
    slots.as_mut_slice()[CAMERA_SLOTS + 3..].copy_from_slice(&dot.centre_mm);
    let view = View {
        target_mm: [0.0; 2],
        diameter_mm: dot.diameter_mm,
        rotation: rotation.into_inner(),
        pitch_mm,
        page_from_reference: camera.page_from_reference,
        lens: camera.lens,
        displacement: camera.displacement.as_ref(),
    };
    spot(&slots, &view)
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{LensTerms, Projection, paper};
    use twinpupil_reconstruct::SpotScore;

    use super::*;

    /// Dots before and behind focus, and what noise of 0.002 px says of their images.
    fn sighted(score: Vector4<f64>) -> Vec<Sighted> {
        let light =
            KnownLight { contrast_codes: 2500.0, ground_codes: 100.0, illumination_per_px: [0.0; 2], is_fitted: false };
        let spot = SpotScore {
            score,
            information: Matrix4::from_diagonal_element(0.002_f64.powi(-2)),
            chi2: 1000.0,
            used_px: 1000,
            masked_px: 0,
            is_cut: false,
            is_aberrated: false,
            light,
        };
        let places =
            [[4.0, 1.0, 262.0], [-3.0, 4.0, 271.0], [-4.0, -3.0, 335.0], [2.0, -5.0, 344.0], [5.0, 3.0, 350.0]];
        let dot = |centre_mm| KnownDot { centre_mm, slopes: [0.0; 2], diameter_mm: 0.9, lights: vec![Some(light); 2] };
        places.map(|centre_mm| Sighted { dot: dot(centre_mm), scores: vec![Some(spot); 2] }).into()
    }

    fn equations(instrument: &Instrument, score: Vector4<f64>) -> Equations {
        let projections: Vec<Projection> = instrument.bands.iter().map(|band| instrument.projection(band)).collect();
        let cameras = cameras(instrument, &projections, &[LensTerms::default(); 2], 1.0);
        equations_of(&sighted(score), &cameras, instrument.sensor.pitch_mm)
    }

    /// Where the straight line through both centres, at d₁ and d₂ behind the lens, meets the sensor at L:
    ///
    /// ```text
    /// p = c₁ (d₂ − L)/(d₂ − d₁) + c₂ (L − d₁)/(d₂ − d₁)
    /// ```
    ///
    /// Images are upright there: u and v count against x and y. All pairs of images are seen from −p, where the axis is
    /// for centred masks, so the axis lies at p from where they meet.
    #[test]
    fn the_axis_moves_with_where_the_line_through_both_centres_meets_the_sensor() {
        let instrument = paper::instrument();
        let equations = equations(&instrument, Vector4::zeros());
        let covariance = equations.information.try_inverse().expect("dots tell the axis");
        let (masks, of_masks) = mask_centres(&instrument, &covariance, &equations.by_pupil);
        let (l, d, pitch_mm) = (151.0, [0.0, 100.0], 0.00586);
        let shares = [(d[1] - l) / (d[1] - d[0]), (l - d[0]) / (d[1] - d[0])];
        assert_eq!(masks.iter().map(|mask| mask.aperture).collect::<Vec<_>>(), [0, 1]);
        for (mask, share) in masks.iter().zip(shares) {
            let expected = share / pitch_mm;
            let [[ux, uy], [vx, vy]] = mask.axis_px_per_mm;
            assert!((ux / expected - 1.0).abs() < 1e-6 && (vy / expected - 1.0).abs() < 1e-6, "{mask:?} {expected}");
            assert!(uy.abs() < 1e-6 * expected.abs() && vx.abs() < 1e-6 * expected.abs(), "{mask:?}");
            assert!((mask.px_per_mm_max() / expected.abs() - 1.0).abs() < 1e-6);
        }
        let expected_px = 0.2 * shares[0].hypot(shares[1]) / pitch_mm;
        assert!((of_masks.m11.sqrt() / expected_px - 1.0).abs() < 1e-6, "{of_masks} {expected_px}");
    }

    #[test]
    fn blurs_that_are_not_the_instruments_show_in_the_typical_dot() {
        let instrument = paper::instrument();
        let chi2 = |score: Vector4<f64>| equations(&instrument, score).typical_chi2;
        assert!(chi2(Vector4::zeros()) < 1e-9);
        // Blurs that are off by 0.1 px, fifty deviations, in both bands.
        assert!(chi2(Vector4::new(0.0, 0.0, 0.0, 0.1 * 0.002_f64.powi(-2))) > CHI2_MAX);
    }
}
