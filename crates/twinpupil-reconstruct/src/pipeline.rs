//! The whole way from a frame to points, as in Section 3 of the paper: planes, features, pairs, positions.

use std::borrow::Cow;
use std::sync::OnceLock;

use thiserror::Error;
use twinpupil_instrument::{Frame, FrameError, Instrument, PixelPoint, PlaneView, ResponseMatrix, ResponseTable, Role};

use crate::detect::{DetectOptions, Detection, Detector, Estimator, Feature};
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
        };
        let model = Model::new(&instrument, table.filter(|_| options.mode == Mode::Centroid));
        let options = Options { detect: DetectOptions { estimator, ..options.detect }, ..options };
        Self { instrument, model, options, shadings: Default::default(), crosstalk: None }
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
        Ok(self.points_from(telecentric, entocentric))
    }

    /// Pairs the features of the two bands and places the pairs: what [`Reconstructor::frame`] does once it has
    /// detected.
    pub fn points_from(&self, telecentric: Detection, entocentric: Detection) -> Reconstruction {
        let pairs = pair_up(
            &self.model,
            &self.instrument.sensor,
            self.instrument.depth_range(),
            &telecentric.features,
            &entocentric.features,
            &self.options.matching,
        );
        self.locate(telecentric, entocentric, &pairs)
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

    /// Turns pairs into points, and whatever is left into rejections.
    fn locate(&self, telecentric: Detection, entocentric: Detection, pairs: &[Match]) -> Reconstruction {
        let points = self.points(&telecentric.features, &entocentric.features, pairs);
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
        if self.options.mode == Mode::Paper {
            return points;
        }
        for _ in 0..TILT_ROUNDS {
            let known: Vec<Point> = points.iter().flatten().copied().collect();
            let mut slopes = local_slopes(&known).into_iter();
            for (place, pair) in points.iter_mut().zip(pairs) {
                if let Some(before) = place {
                    *place = slopes.next().and_then(|slopes| point(pair, Some(before), slopes)).or(*place);
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
            Mode::Centroid => model_position(&self.model, &measured, &Disc { diameter_mm, slopes }, start_mm),
        }?;
        let Position { position_mm, .. } = position;
        let finite = position_mm.iter().chain(&position.std_mm()).all(|value| value.is_finite());
        finite.then(|| Point {
            position_mm,
            std_mm: position.std_mm(),
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
