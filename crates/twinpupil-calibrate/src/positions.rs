//! Calibration from how dots are imaged, without frames: what the adjustment finds where every image is measured as told.

use nalgebra::{Matrix3, Matrix4, Rotation3, Vector3, Vector4};
use twinpupil_instrument::{Instrument, LensTerms, PixelPoint, Projection};

use crate::adjust::{BLUR_SHARE, Dots, Observation, Weighing};
use crate::calibrate::{CalibrateError, Foreign};
use crate::now::Now;
use crate::pose::Pose;
use crate::unknown::{Choices, Unknown};

/// How the page of a band shows a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// The middle of its light.
    pub centre: PixelPoint,
    /// Radius of its blur, px: negative on the other side of the focus.
    pub blur_px: f64,
}

/// How the page of a band shows a dot of the target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DotImage {
    /// The pose in which the target is seen.
    pub frame: usize,
    /// Index of the band.
    pub band: usize,
    /// Index of the dot.
    pub dot: usize,
    /// Its image.
    pub shown: Shown,
}

/// How the page of a band shows a point (x, y, z), mm; `None` where the band does not see it.
pub type ImageOf = Box<dyn Fn(usize, [f64; 3]) -> Option<Shown>>;

/// Deviation of a dot's blur over that of its centre. Along an edge that rises evenly over 2b the light changes by 1/2b with
/// a shift, by x/2b² with b: `√3` times as little; and all of the rim tells of b, of a shift along one axis half of it.
pub const BLUR_STD: f64 = 1.224_745;

/// What a camera is calibrated from when it is known how it shows dots.
pub struct PositionCalibrator<'a> {
    /// The data sheet.
    pub instrument: &'a Instrument,
    /// Dots of the target, on it, mm.
    pub dots_mm: &'a [[f64; 2]],
    /// What is sought.
    pub choices: &'a Choices,
    /// What a real lens of the data sheet adds, band by band: for the derivatives alone.
    pub lens: &'a [LensTerms],
    /// Standard deviation of both coordinates of an image, px: what the priors are weighed against.
    pub std_px: f64,
    /// Makes an instrument ready to tell how it shows points.
    pub optics: &'a dyn Fn(&Instrument) -> Result<ImageOf, Foreign>,
}

/// What images of dots tell of the camera that shows them.
#[derive(Debug, Clone)]
pub struct PositionCalibration {
    /// The data sheet with the numbers that explain the images best.
    pub instrument: Instrument,
    /// Where the target stood, as it sees it.
    pub poses: Vec<Pose>,
    /// Root mean square distance of the images from where they should be, px.
    pub rms_px: f64,
}

/// Times that images are compared at most, and the change of the unknowns in their deviations that is none.
const COMPARISONS: usize = 6;
const RESTING_SIGMAS: f64 = 0.1;

impl PositionCalibrator<'_> {
    /// Calibrates from images of dots, about poses of the target that are known roughly.
    ///
    /// Each image is compared with what the optics of the instrument show, as it stands by then; the adjustment follows the
    /// difference by the derivatives of the forward model.
    ///
    /// # Errors
    /// Where a key of the choices is none, the optics refuse an instrument, or the images determine none.
    pub fn calibrate(&self, images: &[DotImage], poses: &[Pose]) -> Result<PositionCalibration, CalibrateError> {
        let unknowns = self.choices.unknowns(self.instrument)?;
        let mut images = images.to_vec();
        images.sort_by_key(|image| image.frame);
        let mut now = self.start(&unknowns, poses);
        let mut observations = Vec::new();
        for _ in 0..COMPARISONS {
            observations = self.compared(&now, &images)?;
            let next = now.moved_to(&unknowns, now.solved(&unknowns, &observations, Weighing::BY_NOISE)?)?;
            let moved = next.moved_sigmas(&now, &unknowns);
            now = next;
            if moved < RESTING_SIGMAS {
                break;
            }
        }
        let rms_px = rms_px(&now, &observations);
        Ok(PositionCalibration { instrument: now.instrument, poses: now.adjusted.state.poses, rms_px })
    }

    fn start(&self, unknowns: &[Unknown], poses: &[Pose]) -> Now {
        let instrument = self.instrument;
        let projections: Vec<Projection> = instrument.bands.iter().map(|band| instrument.projection(band)).collect();
        let dots =
            Dots { position_mm: self.dots_mm.to_vec(), diameter_mm: vec![0.0; self.dots_mm.len()], place_std_mm: None };
        let optics = (projections, self.lens.to_vec());
        Now::start(instrument.clone(), optics, dots, unknowns, poses.to_vec(), vec![None; poses.len()])
    }

    /// What every image says of a change from where the instrument is by now.
    fn compared(&self, now: &Now, images: &[DotImage]) -> Result<Vec<Observation>, CalibrateError> {
        let image_of = (self.optics)(&now.instrument).map_err(CalibrateError::Foreign)?;
        let (problem, state) = (now.problem(&[], &[], Weighing::BY_NOISE), &now.adjusted.state);
        let observation = |&DotImage { frame, band, dot, shown }: &DotImage| {
            let Shown { centre, blur_px } = image_of(band, state.dot_mm(&now.dots, frame, dot).into())?;
            let anchor = problem.image(band, dot, &now.cameras, state, &state.poses[frame]);
            // Nothing is said of the size of dots.
            let change =
                Vector4::new(shown.centre.u - centre.u, shown.centre.v - centre.v, 0.0, shown.blur_px - blur_px);
            let blur_std_px = (BLUR_STD * self.std_px).hypot(BLUR_SHARE * shown.blur_px);
            let [place, blur] = [self.std_px, blur_std_px].map(|std_px| std_px.powi(-2));
            let information = Matrix4::from_diagonal(&Vector4::new(place, place, 0.0, blur));
            Some(Observation::new((frame, band, dot), anchor, information * change, information))
        };
        Ok(images.iter().filter_map(observation).collect())
    }
}

/// How far images are from where the adjusted instrument shows them.
fn rms_px(now: &Now, observations: &[Observation]) -> f64 {
    let (problem, state) = (now.problem(&[], &[], Weighing::BY_NOISE), &now.adjusted.state);
    let off_px2 = |observation: &Observation| {
        let &Observation { frame, band, dot, anchor, change, .. } = observation;
        let image = problem.image(band, dot, &now.cameras, state, &state.poses[frame]);
        (image - anchor - change).xy().norm_squared()
    };
    (observations.iter().map(off_px2).sum::<f64>() / observations.len().max(1) as f64).sqrt()
}

impl PositionCalibration {
    /// The motion that takes what the camera reads to where things are: a calibration knows its target by its pose alone, so
    /// its space is known up to a motion, which a datum on the target tells. `None` if the dots lie on one line.
    ///
    /// The rotation and the shift that bring the dots nearest to their places [Kabsch 1976].
    pub fn datum(&self, dots_mm: &[[f64; 2]], poses: &[Pose]) -> Option<Pose> {
        let pairs = || {
            let both = self.poses.iter().zip(poses);
            both.flat_map(|(found, place)| dots_mm.iter().map(move |dot| (found.at(*dot), place.at(*dot))))
        };
        let count = pairs().count() as f64;
        let middle = |sum: Vector3<f64>| sum / count;
        let (from, to) = (middle(pairs().map(|pair| pair.0).sum()), middle(pairs().map(|pair| pair.1).sum()));
        let mixed: Matrix3<f64> = pairs().map(|(found, place)| (place - to) * (found - from).transpose()).sum();
        let parts = mixed.svd(true, true);
        let (u, v_t) = (parts.u?, parts.v_t?);
        let sense = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
        let rotation = Rotation3::from_matrix_unchecked(u * sense * v_t);
        let is_known = rotation.matrix().iter().all(|entry| entry.is_finite());
        is_known.then(|| Pose { rotation, translation_mm: to - rotation * from })
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;

    /// Images of chief rays: of an ideal lens behind masks that do not clip.
    fn chief_rays(instrument: &Instrument) -> Result<ImageOf, Foreign> {
        let bands: Vec<_> =
            instrument.bands.iter().map(|band| (instrument.page(band), instrument.projection(band))).collect();
        Ok(Box::new(move |band, object_mm| {
            let (page, projection) = &bands[band];
            let blur_px = -projection.pupil_radius_mm * projection.chief(object_mm[2]).shift / 0.00586;
            Some(Shown { centre: page.to_page(projection.image(object_mm)), blur_px })
        }))
    }

    fn pose(z_mm: f64, x_rad: f64, y_rad: f64) -> Pose {
        Pose {
            rotation: Rotation3::new(Vector3::new(x_rad, y_rad, 0.05)),
            translation_mm: Vector3::new(0.3, -0.2, z_mm),
        }
    }

    #[test]
    fn a_camera_off_its_data_sheet_is_found_from_where_it_shows_dots() {
        let instrument = paper::instrument();
        let mut spec = instrument.clone().into_spec();
        spec.sensor.distance_mm += 0.4;
        spec.sensor.axis_px = [966.0, 596.0];
        spec.sensor.tilt_deg = [0.2, -0.1];
        spec.apertures[1].centre_mm = [0.05, -0.03];
        let built = Instrument::new(spec).unwrap();
        let dots_mm: Vec<[f64; 2]> =
            (0..35).map(|k| [1.8 * f64::from(k % 7 - 3), 1.8 * f64::from(k / 7 - 2)]).collect();
        let poses = [pose(260.0, 0.0, 0.1), pose(285.0, 0.5, 0.0), pose(310.0, -0.1, -0.5), pose(335.0, -0.4, 0.2)];
        let image_of = chief_rays(&built).unwrap();
        let images: Vec<DotImage> = (0..4 * 2 * 35)
            .map(|k| {
                let (frame, band, dot) = (k / 70, k / 35 % 2, k % 35);
                let shown = image_of(band, poses[frame].at(dots_mm[dot]).into()).unwrap();
                DotImage { frame, band, dot, shown }
            })
            .collect();
        let calibrator = PositionCalibrator {
            instrument: &instrument,
            dots_mm: &dots_mm,
            choices: &Choices::default(),
            lens: &[LensTerms::default(); 2],
            std_px: 1e-3,
            optics: &chief_rays,
        };
        let found = calibrator.calibrate(&images, &poses).unwrap();
        assert!(found.rms_px < 1e-3, "{}", found.rms_px);
        let sensor = &found.instrument.sensor;
        assert!((sensor.distance_mm - 151.4).abs() < 0.01, "{}", sensor.distance_mm);
        assert!((sensor.tilt_deg[0] - 0.2).abs() < 0.02, "{:?}", sensor.tilt_deg);
        let datum = found.datum(&dots_mm, &poses).unwrap();
        for (found, place) in found.poses.iter().zip(&poses) {
            let [x, y] = dots_mm[4];
            let off_mm = datum.moving(found.at([x, y]).into());
            assert!((Vector3::from(off_mm) - place.at([x, y])).norm() < 5e-3, "{off_mm:?} {place:?}");
        }
    }
}
