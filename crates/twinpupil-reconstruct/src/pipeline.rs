//! The whole way from a frame to points, as in Section 3 of the paper: planes, features, pairs, positions.

use std::borrow::Cow;
use std::sync::OnceLock;

use thiserror::Error;
use twinpupil_instrument::{Frame, FrameError, Instrument, PixelPoint, PlaneView, ResponseMatrix, ResponseTable, Role};

use crate::background::Polarity;
use crate::detect::{DetectOptions, Detection, Detector, Estimator, Feature};
use crate::likelihood::joint::Workspace;
use crate::likelihood::refine::{ForwardModel, Refined, Seed};
use crate::matching::{Match, MatchOptions, pair_up};
use crate::model::{Disc, Model};
use crate::noise::Noise;
use crate::position::{MeasuredPair, Position, first_order_position_mm, model_position, paper_position};
use crate::rejection::{Rejection, RejectionReason};
use crate::shading::Shading;
use crate::slope::local_slopes;
use crate::unmix::Crosstalk;

/// How points are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// [Ohno2018, Eqs. 9–13] to the letter: mean radius and azimuth, the data sheet's f and L.
    Paper,
    /// Cartesian centroids, and positions by inverting the instrument's forward model.
    #[default]
    Centroid,
    /// The dots whose modelled light, through the masks, out of focus and on their neighbours, is the most likely one
    /// given every pixel.
    Model,
}

/// Settings of a reconstruction.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Options {
    /// How points are computed.
    pub mode: Mode,
    /// What counts as a feature; its estimator is set by the mode.
    pub detect: DetectOptions,
    /// How features are paired.
    pub matching: MatchOptions,
}

/// A point in space and what it was computed from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Position from the front principal point, mm.
    pub position_mm: [f64; 3],
    /// Standard deviations from pixel noise, mm.
    pub std_mm: [f64; 3],
    /// Covariance of x, y and z from pixel noise, mm².
    pub covariance_mm2: [[f64; 3]; 3],
    /// How badly what the bands measure by themselves fits one point in space: χ² of the match.
    pub match_chi2: f64,
    /// Degrees of freedom of [`Self::match_chi2`].
    pub match_dof: usize,
    /// χ² of the pixels about their model over their number; `None` where no model was laid over them.
    pub pixel_chi2: Option<f64>,
    /// Γ, telecentric over entocentric radius.
    pub gamma: f64,
    /// The feature in the telecentric band.
    pub telecentric: Feature,
    /// The feature in the entocentric band.
    pub entocentric: Feature,
    /// How far the entocentric feature lies beside the telecentric one's azimuth, px: near zero if the axis is right.
    pub azimuth_residual_px: f64,
    /// Diameter of the disc that has the features' area, mm.
    pub diameter_mm: f64,
    /// Whether another pairing would have been nearly as good.
    pub ambiguous: bool,
}

/// What a frame gives. In each band, features found = points + rejected.
#[derive(Debug, Clone, PartialEq)]
pub struct Reconstruction {
    /// Points, by the row and column of their telecentric features.
    pub points: Vec<Point>,
    /// Features of both bands that did not become part of a point.
    pub rejected: Vec<Rejection>,
}

/// A frame that does not fit the instrument.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ReconstructError {
    /// A plane is missing.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// Another size than the sensor's.
    #[error(
        "the frame is {} × {}, the instrument's sensor.size_px is {} × {}",
        found_px[0], found_px[1], sensor_px[0], sensor_px[1]
    )]
    Size {
        /// Columns and rows of the frame.
        found_px: [usize; 2],
        /// Columns and rows of the sensor.
        sensor_px: [usize; 2],
    },
}

/// A frame without crosstalk, and the noise of its codes.
struct Clean<'a> {
    frame: Cow<'a, Frame>,
    noise: Noise,
}

impl<'a> Clean<'a> {
    fn of(reconstructor: &Reconstructor, frame: &'a Frame) -> Result<Self, FrameError> {
        let noise = Noise::of_sensor(&reconstructor.instrument.sensor, frame.code_max());
        let Some(crosstalk) = &reconstructor.crosstalk else { return Ok(Self { frame: Cow::Borrowed(frame), noise }) };
        let unmixed = crosstalk.unmixed(frame, &reconstructor.instrument)?;
        let noise = noise.raised(unmixed.pedestal);
        Ok(Self { frame: Cow::Owned(unmixed.into_frame(frame)?), noise })
    }
}

/// Times that points and the tilts between them are computed in turn.
const TILT_ROUNDS: usize = 2;

/// An instrument made ready to read frames.
#[derive(Debug, Clone)]
pub struct Reconstructor {
    instrument: Instrument,
    model: Model,
    forward: ForwardModel,
    options: Options,
    shadings: [OnceLock<Shading>; 2],
    crosstalk: Option<Crosstalk>,
}

impl Reconstructor {
    /// A reconstructor for an instrument. `table` is the instrument's response, which the optics compute; without it
    /// (and in paper mode) every lens is taken to be ideal.
    pub fn new(instrument: Instrument, table: Option<ResponseTable>, options: Options) -> Self {
        let [u, v] = instrument.sensor.axis_px;
        let estimator = match options.mode {
            Mode::Paper => Estimator::Radial { axis: PixelPoint { u, v } },
            Mode::Centroid => Estimator::Cartesian,
            Mode::Model => Estimator::Rough,
        };
        let table = table.filter(|_| options.mode != Mode::Paper);
        let bands = [Role::Telecentric, Role::Entocentric].map(|role| instrument.band_index(role));
        let forward = ForwardModel::new(&instrument, table.as_ref(), &bands);
        let model = Model::new(&instrument, table);
        let options = Options { detect: DetectOptions { estimator, ..options.detect }, ..options };
        Self { instrument, model, forward, options, shadings: Default::default(), crosstalk: None }
    }

    /// Takes the crosstalk between the two planes off every frame before anything is measured.
    #[must_use]
    pub fn unmixing(self, response: &ResponseMatrix) -> Self {
        Self { crosstalk: Crosstalk::of(&self.instrument, response), ..self }
    }

    /// Reads one frame.
    pub fn frame(&self, frame: &Frame) -> Result<Reconstruction, ReconstructError> {
        let found_px = [frame.width_px(), frame.height_px()];
        if found_px != self.instrument.sensor.size_px {
            return Err(ReconstructError::Size { found_px, sensor_px: self.instrument.sensor.size_px });
        }
        let clean = Clean::of(self, frame)?;
        let telecentric = self.detect_clean(&clean, Role::Telecentric)?;
        let entocentric = self.detect_clean(&clean, Role::Entocentric)?;
        if self.options.mode != Mode::Model {
            return Ok(self.points_from(telecentric, entocentric));
        }
        let pairs = self.pair(&telecentric, &entocentric);
        let points = self.points(&telecentric.features, &entocentric.features, &pairs);
        let planes = [Role::Telecentric, Role::Entocentric].map(|role| {
            let plane = clean.frame.plane(self.instrument.sensor.mosaic, &self.instrument.band(role).plane);
            plane.map(|plane| (plane, clean.noise))
        });
        let [a, b] = planes;
        let points = self.refined([a?, b?], [&telecentric, &entocentric], &pairs, points);
        Ok(self.account(telecentric, entocentric, &pairs, points))
    }

    /// Points placed anew by what all pixels say.
    fn refined(
        &self,
        planes: [(PlaneView<'_>, Noise); 2],
        detections: [&Detection; 2],
        pairs: &[Match],
        mut points: Vec<Option<Point>>,
    ) -> Vec<Option<Point>> {
        let signs = detections.map(|detection| if detection.polarity == Polarity::Bright { 1.0 } else { -1.0 });
        let background =
            std::array::from_fn::<f64, 2, _>(|role| detections[role].background_codes - planes[role].1.black_level);
        let seed = |point: &Point| Seed {
            centre_mm: point.position_mm,
            diameter_mm: point.diameter_mm,
            contrast: vec![
                Some(signs[0] * point.telecentric.height_codes),
                Some(signs[1] * point.entocentric.height_codes),
            ],
            placed: true,
        };
        let mut seeds: Vec<Seed> = points.iter().flatten().map(seed).collect();
        let placed = seeds.len();
        seeds.extend(self.lone_seeds(detections, signs, pairs, &points));
        let refined = self.forward.refine(&planes, &seeds, &background, &mut Workspace::default());
        for (point, refined) in points.iter_mut().filter(|point| point.is_some()).zip(refined.into_iter().take(placed))
        {
            if let (Some(point), Some(refined)) = (point, refined) {
                const NOT_A_DISC: f64 = 0.05;
                if refined.misfit < NOT_A_DISC {
                    self.place(point, &refined);
                }
            }
        }
        points
    }

    fn place(&self, point: &mut Point, refined: &Refined) {
        let covariance = refined.position_covariance_mm2();
        point.position_mm = refined.dot.centre_mm;
        point.diameter_mm = refined.dot.diameter_mm;
        point.covariance_mm2 = std::array::from_fn(|i| std::array::from_fn(|k| covariance[(i, k)]));
        point.std_mm = std::array::from_fn(|i| covariance[(i, i)].sqrt());
        point.pixel_chi2 = Some(refined.reduced_chi2);
        if let [Some(telecentric), Some(entocentric)] = refined.centres[..] {
            for (feature, own) in [(&mut point.telecentric, telecentric), (&mut point.entocentric, entocentric)] {
                feature.centre = own.centre;
                feature.centre_std_px = own.std_px;
            }
            point.match_chi2 = telecentric.chi2 + entocentric.chi2;
            point.match_dof = 2;
            let images = [telecentric, entocentric].map(|own| self.instrument.sensor.image_from_pixel(own.centre));
            point.gamma = images[0].radius_mm() / images[1].radius_mm();
            let [t, e] = images;
            point.azimuth_residual_px =
                (t.x_mm * e.y_mm - t.y_mm * e.x_mm) / t.radius_mm().max(1e-12) / self.instrument.sensor.pitch_mm;
        }
    }

    /// Features of one band that became no point, as dots somewhere along the line of sight.
    fn lone_seeds(
        &self,
        detections: [&Detection; 2],
        signs: [f64; 2],
        pairs: &[Match],
        points: &[Option<Point>],
    ) -> Vec<Seed> {
        let mut depths_mm: Vec<f64> = points.iter().flatten().map(|point| point.position_mm[2]).collect();
        depths_mm.sort_by(f64::total_cmp);
        let z_mm = depths_mm.get(depths_mm.len() / 2).copied().unwrap_or(self.instrument.focus_distance_mm());
        let magnifications = self.model.magnifications(z_mm);
        let mut seeds = Vec::new();
        for role in 0..2 {
            let detection = detections[role];
            let paired = |index: usize| {
                pairs
                    .iter()
                    .zip(points)
                    .any(|(pair, point)| point.is_some() && [pair.telecentric, pair.entocentric][role] == index)
            };
            let alone = detection.features.iter().enumerate().filter(|(index, _)| !paired(*index)).map(|(_, f)| f);
            let bystanders = detection.rejected.iter().map(|bystander| &bystander.feature);
            for feature in alone.chain(bystanders) {
                let image = self.instrument.sensor.image_from_pixel(feature.centre);
                let m = magnifications[role];
                let diameter_px = 2.0 * (feature.area_px / std::f64::consts::PI).sqrt();
                let mut contrast = vec![None, None];
                contrast[role] = Some(signs[role] * feature.height_codes);
                seeds.push(Seed {
                    centre_mm: [image.x_mm / m, image.y_mm / m, z_mm],
                    diameter_mm: (diameter_px * self.instrument.sensor.pitch_mm / m).max(1e-3),
                    contrast,
                    placed: false,
                });
            }
        }
        seeds
    }

    fn pair(&self, telecentric: &Detection, entocentric: &Detection) -> Vec<Match> {
        pair_up(
            &self.model,
            &self.instrument.sensor,
            self.instrument.depth_range(),
            &telecentric.features,
            &entocentric.features,
            &self.options.matching,
        )
    }

    /// Pairs the features of the two bands and places the pairs: what [`Reconstructor::frame`] does once it has
    /// detected.
    pub fn points_from(&self, telecentric: Detection, entocentric: Detection) -> Reconstruction {
        let pairs = self.pair(&telecentric, &entocentric);
        let points = self.points(&telecentric.features, &entocentric.features, &pairs);
        self.account(telecentric, entocentric, &pairs, points)
    }

    /// The features of the band with a role.
    pub fn detect(&self, frame: &Frame, role: Role) -> Result<Detection, FrameError> {
        self.detect_clean(&Clean::of(self, frame)?, role)
    }

    fn detect_clean(&self, clean: &Clean<'_>, role: Role) -> Result<Detection, FrameError> {
        let band = self.instrument.band(role);
        let plane = clean.frame.plane(self.instrument.sensor.mosaic, &band.plane)?;
        let shading = self.shading(role, &plane);
        let mut detection = Detection::default();
        Detector::new(self.options.detect).detect_shaded(&plane, Some(&clean.noise), shading, &mut detection);
        Ok(detection)
    }

    /// What the masks leave of an even ground, computed with the first frame; `None` without a response table, or for
    /// planes of another size.
    fn shading(&self, role: Role, plane: &PlaneView<'_>) -> Option<&Shading> {
        let (table, band) = self.model.table(role)?;
        let place = match role {
            Role::Telecentric => &self.shadings[0],
            Role::Entocentric => &self.shadings[1],
        };
        let shading = place.get_or_init(|| Shading::of(table, band, &self.instrument.sensor, plane));
        shading.fits(plane).then_some(shading)
    }

    /// Puts points together, and whatever is left into rejections.
    fn account(
        &self,
        telecentric: Detection,
        entocentric: Detection,
        pairs: &[Match],
        points: Vec<Option<Point>>,
    ) -> Reconstruction {
        let mut fates = [&telecentric, &entocentric]
            .map(|detection| vec![Some(RejectionReason::NoPartner); detection.features.len()]);
        for (pair, point) in pairs.iter().zip(&points) {
            let fate = if point.is_some() { None } else { Some(RejectionReason::NoDepth) };
            fates[0][pair.telecentric] = fate;
            fates[1][pair.entocentric] = fate;
        }
        let mut rejected = Vec::new();
        for ((detection, fates), role) in
            [telecentric, entocentric].into_iter().zip(fates).zip([Role::Telecentric, Role::Entocentric])
        {
            let band = &self.instrument.band(role).name;
            rejected.extend(detection.rejected.iter().map(|bystander| bystander.rejection(band)));
            rejected.extend(detection.features.iter().zip(fates).filter_map(|(feature, fate)| {
                Some(Rejection {
                    band: band.clone(),
                    position: feature.centre,
                    area_px: feature.area_px,
                    reason: fate?,
                })
            }));
        }
        Reconstruction { points: points.into_iter().flatten().collect(), rejected }
    }

    /// The point of every pair; first as if all features faced the camera, then with the tilt of the surface that
    /// their neighbours show.
    fn points(&self, telecentric: &[Feature], entocentric: &[Feature], pairs: &[Match]) -> Vec<Option<Point>> {
        let point = |pair: &Match, before: Option<&Point>, slopes: [f64; 2]| {
            self.point([telecentric[pair.telecentric], entocentric[pair.entocentric]], pair, before, slopes)
        };
        let mut points: Vec<Option<Point>> = pairs.iter().map(|pair| point(pair, None, [0.0; 2])).collect();
        if self.options.mode != Mode::Centroid {
            return points;
        }
        for _ in 0..TILT_ROUNDS {
            let known: Vec<[f64; 3]> = points.iter().flatten().map(|point| point.position_mm).collect();
            let mut slopes = local_slopes(&known, &known).into_iter();
            for (place, pair) in points.iter_mut().zip(pairs) {
                if let Some(before) = place {
                    *place = slopes
                        .next()
                        .and_then(|slopes| point(pair, Some(before), slopes.unwrap_or_default()))
                        .or(*place);
                }
            }
        }
        points
    }

    /// The point of one pair on a surface with slopes; what was known of it before tells its size.
    fn point(&self, features: [Feature; 2], pair: &Match, before: Option<&Point>, slopes: [f64; 2]) -> Option<Point> {
        let sensor = &self.instrument.sensor;
        let measured = MeasuredPair {
            images: features.map(|feature| sensor.image_from_pixel(feature.centre)),
            std_mm: features.map(|feature| feature.centre_std_px.map(|std_px| std_px * sensor.pitch_mm)),
        };
        let start_mm = match before {
            Some(point) => point.position_mm,
            None => first_order_position_mm(&self.instrument, &self.model, &measured)?,
        };
        // A tilted disc looks smaller by the cosine of its tilt.
        let foreshortening = 1.0 / (1.0 + slopes[0].powi(2) + slopes[1].powi(2)).sqrt();
        let diameter_mm = self.apparent_diameter_mm(&features, start_mm[2]) / foreshortening.sqrt();
        let position = match self.options.mode {
            Mode::Paper => paper_position(&self.instrument, &self.model, &measured),
            Mode::Centroid | Mode::Model => {
                model_position(&self.model, &measured, &Disc { diameter_mm, slopes }, start_mm)
            }
        }?;
        let Position { position_mm, covariance_mm2 } = position;
        let azimuth_std_px = features.iter().map(|f| f.centre_std_px[0].max(f.centre_std_px[1])).fold(0.0, f64::hypot);
        let finite = position_mm.iter().chain(&position.std_mm()).all(|value| value.is_finite());
        finite.then(|| Point {
            position_mm,
            std_mm: position.std_mm(),
            covariance_mm2: std::array::from_fn(|i| std::array::from_fn(|k| covariance_mm2[(i, k)])),
            match_chi2: (pair.azimuth_residual_px / azimuth_std_px.max(1e-9)).powi(2),
            match_dof: 1,
            pixel_chi2: None,
            gamma: measured.gamma(),
            telecentric: features[0],
            entocentric: features[1],
            azimuth_residual_px: pair.azimuth_residual_px,
            diameter_mm,
            ambiguous: pair.ambiguous,
        })
    }

    /// Diameter of the disc of the outlines' area, facing the camera: from the larger of the two outlines, since the
    /// other band's may have lost more to the masks.
    ///
    /// Blur over a disc of radius b moves the half-lit edge of a disc of radius a inwards by b²/8a: the mean square of
    /// the blur along one direction, b²/4, times half the edge's curvature.
    fn apparent_diameter_mm(&self, features: &[Feature; 2], z_mm: f64) -> f64 {
        let (magnifications, blurs_mm) = (self.model.magnifications(z_mm), self.model.blur_radii_mm(z_mm));
        let diameters_mm = [0, 1].map(|role| {
            let half_lit_px = (features[role].area_px / std::f64::consts::PI).sqrt();
            let half_lit_mm = half_lit_px * self.instrument.sensor.pitch_mm;
            2.0 * (half_lit_mm + blurs_mm[role].powi(2) / (8.0 * half_lit_mm)) / magnifications[role]
        });
        diameters_mm[0].max(diameters_mm[1])
    }
}
