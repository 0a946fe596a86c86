//! The whole way from a frame to points, as in Section 3 of the paper: planes, features, pairs, positions.

mod again;
mod agreement;
mod late;
mod merged;
mod seeds;
mod shape;

use std::f64::consts::PI;
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use smallvec::SmallVec;
use thiserror::Error;
use twinpupil_instrument::{
    Band, Frame, FrameError, FrameView, Instrument, LensTerms, PixelPoint, PlaneView, Projection, ResponseMatrix,
    ResponseTable, Role,
};

use self::again::is_in_doubt;
use self::agreement::birge_ratio2;
use self::late::Lone;
use crate::calibrated::Calibrated;
use crate::detect::{DetectOptions, Detection, Detector, Estimator, Feature};
use crate::further::{FurtherImage, Group, match_predicted};
use crate::likelihood::known::{KnownDot, SpotScore};
use crate::likelihood::refine::{ForwardModel, Refined, Seed, Workspace};
use crate::likelihood::spot::Dot;
use crate::matching::{Epipole, Match, MatchOptions, Matcher};
use crate::model::{Disc, Model};
use crate::noise::{Noise, NoiseSource};
use crate::planes::Planes;
use crate::position::{Position, Sighting, first_order_position_mm, gamma, model_position, paper_position};
use crate::register::Register;
use crate::rejection::{Rejection, RejectionReason};
use crate::shading::Shading;
use crate::slope::Slopes;
use crate::threads::{enter, for_each, worthwhile};
use crate::unmix::Crosstalk;

/// How points are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// [Ohno2018, Eqs. 9–13] to the letter: mean radius and azimuth, the data sheet's f and L.
    Paper,
    /// Cartesian centroids, and positions by inverting the instrument's forward model.
    Centroid,
    /// The dots whose modelled light, through the masks, out of focus and on their neighbours, is the most likely one
    /// given every pixel.
    #[default]
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
    /// Where the noise of pixels is known from.
    pub noise: NoiseSource,
    /// Threads that share the work of one frame, of those of the rayon pool that it is read in. Without a number, frames that
    /// show many hundreds of dots are shared, others are not; results do not depend on it.
    pub threads: Option<NonZeroUsize>,
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

/// What a frame gives. In each band, features found = points that it shows + rejected.
#[derive(Debug, Clone, PartialEq)]
pub struct Reconstruction {
    /// Points, by the row and column of their telecentric features.
    pub points: Vec<Point>,
    /// What the bands beside the pair show of the points.
    pub further: Vec<FurtherImage>,
    /// Features of all bands that did not become part of a point.
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

/// A point with its features in the bands beside the pair.
#[derive(Debug, Clone, PartialEq)]
struct Placed {
    point: Point,
    further: Vec<Option<Feature>>,
}

impl Placed {
    /// Whether the largest code hides how bright it is.
    fn is_saturated(&self) -> bool {
        self.point.telecentric.saturated || self.point.entocentric.saturated
    }

    /// The feature that shows it in a band of the model.
    fn feature(&self, band: usize) -> Option<&Feature> {
        match band {
            0 => Some(&self.point.telecentric),
            1 => Some(&self.point.entocentric),
            _ => self.further.get(band - 2).and_then(Option::as_ref),
        }
    }
}

/// How far the centroid of a feature of any shape may jump on a lattice of pixels, px.
///
/// Where its edge crosses a line of pixels, the sum over them misses the edge by a wave of the lattice, of which the
/// pixel's square and the blur of radius b leave a share. With 2R/s lines across an area of radius R, each counting by
/// its distance from the middle, and twice as much since straight edges miss alike from line to line:
///
/// ```text
/// ε = s/(√2 π) · sinc(1/s) · 2 J₁(2πb/s)/(2πb/s)        σ = 2 ε √(2 s/R)/π
/// ```
fn lattice_std_px(feature: &Feature, step_px: f64) -> f64 {
    use std::f64::consts::{PI, SQRT_2};
    // At whole pixels the square leaves nothing of a wave along it, but of those across.
    const SQUARE_MIN: f64 = 0.1;
    let radius_px = (feature.area_px / PI).sqrt();
    let wave = PI / step_px;
    let square = (wave.sin() / wave).abs().max(SQUARE_MIN);
    // The envelope of Bessel's function.
    let disc = (1.6 * (2.0 * wave * feature.edge_px).powf(-1.5)).min(1.0);
    let edge_px = step_px / (SQRT_2 * PI) * square * disc;
    2.0 * edge_px * (2.0 * step_px / radius_px).sqrt() / PI
}

impl Placed {
    /// Moves it to a position, unless that is none; says whether it did.
    fn settle(&mut self, position: &Position, diameter_mm: f64) -> bool {
        let std_mm = position.std_mm();
        let finite = position.position_mm.iter().chain(&std_mm).all(|value| value.is_finite());
        if finite {
            let point = &mut self.point;
            (point.position_mm, point.std_mm, point.diameter_mm) = (position.position_mm, std_mm, diameter_mm);
            let covariance_mm2 = &position.covariance_mm2;
            point.covariance_mm2 = std::array::from_fn(|i| std::array::from_fn(|k| covariance_mm2[(i, k)]));
        }
        finite
    }

    /// Makes all variances so many times larger.
    fn widen(&mut self, ratio2: f64) {
        self.point.covariance_mm2 = self.point.covariance_mm2.map(|row| row.map(|covariance| ratio2 * covariance));
        self.point.std_mm = self.point.std_mm.map(|std_mm| ratio2.sqrt() * std_mm);
    }
}

/// What features are paired and placed with; its buffers are used again from frame to frame.
#[derive(Debug, Clone, Default)]
struct Placing {
    matcher: Matcher,
    slopes: Slopes,
    pairs: Vec<Match>,
    /// The groups that were found last, and their points.
    groups: Vec<Group>,
    points: Vec<Option<Placed>>,
}

/// What one frame is read with, and what was read; used again from frame to frame.
#[derive(Debug, Clone, Default)]
struct Reading {
    /// For every band of the model.
    detectors: Vec<Detector>,
    detections: Vec<Detection>,
    placing: Placing,
    fitting: Fitting,
    points: Vec<Point>,
}

/// What points are fitted to pixels with.
#[derive(Debug, Clone, Default)]
struct Fitting {
    seeds: Vec<Seed>,
    /// Features among them that are part of no point.
    lone: Vec<Lone>,
    workspace: Workspace,
    refined: Vec<Option<Refined>>,
    values: Vec<f64>,
    is_shown: Vec<bool>,
    /// Which points are none of a disc.
    is_other: Vec<bool>,
}

/// An instrument made ready to read frames.
///
/// [`Reconstructor::frame`] is for live use, on codes as they lie in a camera's buffer; once warm it allocates nothing,
/// unless threads share a frame ([`Options::threads`]): to wake them may.
/// [`Reconstructor::reconstruct`] also tells what did not become a point, and many threads may call it at once.
#[derive(Debug, Clone)]
pub struct Reconstructor {
    instrument: Instrument,
    model: Model,
    forward: ForwardModel,
    options: Options,
    /// In the order of the model's bands.
    registers: Vec<Register>,
    shadings: Vec<OnceLock<Shading>>,
    crosstalk: Option<Crosstalk>,
    calibrated: OnceLock<Option<Calibrated>>,
    reading: Reading,
    /// Of those who share it.
    spare: Arc<Mutex<Vec<Reading>>>,
}

impl Reconstructor {
    /// A reconstructor for an instrument. `table` is the instrument's response, which the optics compute; without it
    /// (and in paper mode) every lens is taken to be ideal.
    pub fn new(instrument: Instrument, table: Option<ResponseTable>, options: Options) -> Self {
        let table = table.filter(|_| options.mode != Mode::Paper);
        let forward = ForwardModel::new(&instrument, table.as_ref(), &instrument.bands_by_role());
        let model = Model::new(&instrument, table);
        let register = |band: usize| Register::new(&instrument.sensor, instrument.page(&instrument.bands[band]));
        let registers: Vec<Register> = (0..model.bands()).map(|band| register(model.index(band))).collect();
        let shadings = vec![OnceLock::new(); registers.len()];
        Self {
            instrument,
            model,
            forward,
            options,
            registers,
            shadings,
            crosstalk: None,
            calibrated: OnceLock::new(),
            reading: Reading::default(),
            spare: Arc::default(),
        }
    }

    /// Takes the crosstalk between the planes off every frame before anything is measured.
    #[must_use]
    pub fn unmixing(self, response: &ResponseMatrix) -> Self {
        Self { crosstalk: Crosstalk::of(&self.instrument, response), ..self }
    }

    /// The points of one exposure, whose codes lie page by page and row by row as the sensor delivers them; by the row and
    /// column of their telecentric features, until the next frame is read.
    pub fn frame(&mut self, codes: &[u16]) -> Result<&[Point], ReconstructError> {
        let [width_px, height_px] = self.instrument.sensor.size_px;
        let frame = FrameView::of_codes(width_px, height_px, self.instrument.sensor.code_max(), codes)?;
        let mut reading = std::mem::take(&mut self.reading);
        let done = self.read(frame, &mut reading);
        self.reading = reading;
        done?;
        let Reading { placing, points, .. } = &mut self.reading;
        points.clear();
        points.extend(placing.points.iter().flatten().map(|placed| placed.point));
        Ok(points)
    }

    /// Reads one frame, and tells of all that is on it.
    pub fn reconstruct(&self, frame: &Frame) -> Result<Reconstruction, ReconstructError> {
        let mut reading = self.spares().pop().unwrap_or_default();
        let done = self.read(frame.into(), &mut reading);
        let reconstruction = done.map(|()| self.account(&reading.detections, &reading.placing));
        self.spares().push(reading);
        reconstruction
    }

    /// What the lens adds to the projections of all bands, in the order of the instrument's: nothing without a table.
    pub fn lens_terms(&self) -> Vec<LensTerms> {
        let (instrument, projections) = (self.instrument(), self.projections());
        let radius_mm = instrument.corner_radius_mm();
        let mut terms = vec![LensTerms::default(); projections.len()];
        for band in 0..self.model.bands() {
            if let Some((table, index)) = self.model.table(band) {
                terms[index] = table.lens_terms(index, &projections[index], radius_mm);
            }
        }
        terms
    }

    /// The projections of all bands in the order of the instrument's, with the focal lengths of its response.
    pub fn projections(&self) -> Vec<Projection> {
        self.forward.projections()
    }

    /// What the uncertainty of the instrument's own numbers does to a point there, mm²: apart from the noise of its pixels,
    /// and alike for all points nearby. `None` where the instrument was not calibrated, or does not see the point.
    pub fn calibration_covariance_mm2(&self, position_mm: [f64; 3]) -> Option<[[f64; 3]; 3]> {
        self.calibrated.get_or_init(|| Calibrated::of(&self.instrument)).as_ref()?.covariance_mm2(position_mm)
    }

    /// The instrument that frames are read with.
    pub fn instrument(&self) -> &Instrument {
        &self.instrument
    }

    /// What the pixels of a frame say of dots whose places are given, for each in every band of the instrument; `None`
    /// where a band does not show the dot or does not tell.
    pub fn scores(&self, frame: &Frame, dots: &[KnownDot]) -> Result<Vec<Vec<Option<SpotScore>>>, ReconstructError> {
        let frame = FrameView::from(frame);
        self.check_size(frame)?;
        let planes = self.planes(frame)?;
        let bands = 0..self.model.bands();
        let views =
            bands.clone().map(|band| planes.of_band(self.index(band))).collect::<Result<SmallVec<[_; 2]>, _>>()?;
        let known: Vec<_> = dots
            .iter()
            .map(|dot| {
                let lights = bands.clone().map(|band| dot.lights.get(self.index(band)).copied().flatten()).collect();
                let KnownDot { centre_mm, slopes, diameter_mm, .. } = *dot;
                (Dot { centre_mm, diameter_mm, slopes }, lights)
            })
            .collect();
        let mut workspace = Workspace::default();
        let scores = self.forward.scores(&views, &known, &mut workspace);
        let of_instrument = |own: SmallVec<[Option<SpotScore>; 2]>| {
            let mut all = vec![None; own.len()];
            own.into_iter().enumerate().for_each(|(band, score)| all[self.index(band)] = score);
            all
        };
        Ok(scores.into_iter().map(of_instrument).collect())
    }

    /// Whether the masks take some of the light of a dot in a given place, in every band of the instrument.
    pub fn is_cut(&self, dot: &KnownDot) -> Vec<bool> {
        let KnownDot { centre_mm, slopes, diameter_mm, .. } = *dot;
        let own = self.forward.is_cut(&Dot { centre_mm, diameter_mm, slopes });
        let mut all = vec![false; own.len()];
        own.into_iter().enumerate().for_each(|(band, is_cut)| all[self.index(band)] = is_cut);
        all
    }

    fn spares(&self) -> std::sync::MutexGuard<'_, Vec<Reading>> {
        // What was left behind by a panic is only buffers.
        self.spare.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn read(&self, frame: FrameView<'_>, reading: &mut Reading) -> Result<(), ReconstructError> {
        self.check_size(frame)?;
        let Reading { detectors, detections, placing, fitting, .. } = reading;
        let planes = self.planes(frame)?;
        // The paper knows of two bands.
        let bands = if self.options.mode == Mode::Paper { 2 } else { self.model.bands() };
        detectors.resize_with(bands, Detector::default);
        detections.resize_with(bands, Detection::default);
        let views = (0..bands).map(|band| planes.of_band(self.index(band))).collect::<Result<SmallVec<[_; 2]>, _>>()?;
        // The frame before tells how much there will be to do.
        let threads = self.threads(placing.points.len());
        enter(threads, || self.detect_planes(&views, threads, detectors, detections));
        let threads = self.threads(detections.iter().map(|detection| detection.features.len()).min().unwrap_or(0));
        enter(threads, || {
            self.placed(detections, threads, placing);
            if self.options.mode == Mode::Model {
                self.refine(&views, detections, placing, fitting);
            }
        });
        Ok(())
    }

    fn detect_planes(
        &self,
        views: &[(PlaneView<'_>, Noise)],
        threads: usize,
        detectors: &mut [Detector],
        detections: &mut [Detection],
    ) {
        let bands = detectors.iter_mut().zip(detections).zip(views);
        for_each(&mut bands.collect::<SmallVec<[_; 2]>>(), threads, |band, ((detector, detection), view)| {
            self.detect_plane(band, view, detector, detection);
        });
    }

    /// How many threads share the work of a frame with so many dots.
    fn threads(&self, dots: usize) -> usize {
        const DOTS_EACH: usize = 200;
        const DOTS_EACH_AT_LEAST: usize = 8;
        let most = match self.options.threads {
            Some(threads) => worthwhile(dots, DOTS_EACH_AT_LEAST, threads.get()),
            None => dots / DOTS_EACH,
        };
        // Those who never share work need no pool.
        if most > 1 { most.min(rayon::current_num_threads()) } else { 1 }
    }

    fn check_size(&self, frame: FrameView<'_>) -> Result<(), ReconstructError> {
        let found_px = [frame.width_px(), frame.height_px()];
        let sensor_px = self.instrument.sensor.size_px;
        if found_px == sensor_px { Ok(()) } else { Err(ReconstructError::Size { found_px, sensor_px }) }
    }

    /// Places points anew by what all pixels say.
    fn refine(
        &self,
        planes: &[(PlaneView<'_>, Noise)],
        detections: &mut [Detection],
        placing: &mut Placing,
        fitting: &mut Fitting,
    ) {
        let background: SmallVec<[f64; 2]> = (detections.iter().zip(planes))
            .map(|(detection, (_, noise))| detection.background_codes - noise.black_level)
            .collect();
        self.fit(planes, detections, &background, placing, fitting);
        if self.divide_merged(detections, placing, fitting) {
            self.fit(planes, detections, &background, placing, fitting);
        }
        if self.pair_late(detections, placing, fitting) {
            self.fit(planes, detections, &background, placing, fitting);
        }
        let Fitting { refined, is_other, .. } = fitting;
        let mut refined = refined.iter_mut();
        is_other.clear();
        is_other.resize(placing.points.len(), false);
        let places = placing.points.iter_mut().zip(&placing.groups);
        for ((place, group), is_other) in places.zip(&mut *is_other) {
            let Some(placed) = place else { continue };
            let is_saturated = placed.is_saturated();
            let disc = refined.next().and_then(Option::take).filter(|refined| refined.is_disc(is_saturated));
            match disc {
                Some(refined) if !is_saturated || refined.tells_depth() => self.place(placed, &refined),
                // Moments would believe what the largest code hides, and pairs that nothing but a fit has shown.
                _ if is_saturated || group.is_late => *place = None,
                _ => *is_other = true,
            }
        }
        if placing.points.iter().zip(&*is_other).any(|(place, is_other)| is_in_doubt(place.as_ref(), *is_other)) {
            self.try_again(planes, detections, &background, placing, fitting);
        }
    }

    /// Finds the most likely dots behind all features.
    fn fit(
        &self,
        planes: &[(PlaneView<'_>, Noise)],
        detections: &[Detection],
        background: &[f64],
        placing: &Placing,
        fitting: &mut Fitting,
    ) {
        self.collect_seeds(detections, placing, fitting);
        let Fitting { seeds, workspace, refined, .. } = fitting;
        let threads = self.threads(seeds.len());
        self.forward.refine(planes, seeds, background, threads, workspace, refined);
    }

    /// Features that were found before, with the centres of all their light.
    fn with_moments(&self, band: usize, (plane, noise): &(PlaneView<'_>, Noise), found: &Detection) -> Detection {
        const SAME: f64 = 1e-6;
        let mut measured = Detection::default();
        let options = DetectOptions { estimator: Estimator::Cartesian, ..self.options.detect };
        Detector::new(options).detect_shaded(plane, Some(noise), self.shading(band, plane), &mut measured);
        self.registers[band].onto_image_plane(&mut measured);
        let mut found = found.clone();
        for feature in &mut found.features {
            let away_px =
                |other: &&Feature| (other.centre.u - feature.centre.u).hypot(other.centre.v - feature.centre.v);
            let is_same = |other: &&Feature| (other.area_px / feature.area_px - 1.0).abs() < SAME;
            let same = measured.features.iter().filter(is_same).min_by(|a, b| away_px(a).total_cmp(&away_px(b)));
            if let Some(same) = same.filter(|same| away_px(same) < feature.area_px.sqrt()) {
                *feature = *same;
                let lattice_px = lattice_std_px(feature, plane.step_px as f64);
                feature.centre_std_px = feature.centre_std_px.map(|std_px| std_px.hypot(lattice_px));
            }
        }
        found
    }

    /// Places points by the centroids of their features, as centroid mode does.
    fn place_by_moments(
        &self,
        detections: &[Detection],
        groups: &[Group],
        points: &mut [Option<Placed>],
        is_other: &[bool],
    ) {
        for ((place, group), _) in points.iter_mut().zip(groups).zip(is_other).filter(|(_, is_other)| **is_other) {
            if let Some(again) = self.point(detections, group) {
                *place = Some(again);
            }
        }
        let mut slopes = Slopes::default();
        slopes.lay_through(points.iter().flatten().map(|placed| placed.point.position_mm));
        for (placed, _) in points.iter_mut().zip(is_other).filter(|(_, is_other)| **is_other) {
            if let Some(placed) = placed {
                let slopes = slopes.at(placed.point.position_mm);
                self.place_again(placed, slopes.unwrap_or_default());
                placed.widen(birge_ratio2(placed.point.match_chi2, placed.point.match_dof));
                self.doubt_shape(placed, slopes);
            }
        }
    }

    fn place(&self, placed: &mut Placed, refined: &Refined) {
        let Placed { point, further } = placed;
        let covariance = refined.position_covariance_mm2();
        point.position_mm = refined.dot.centre_mm;
        point.diameter_mm = refined.dot.diameter_mm;
        point.covariance_mm2 = std::array::from_fn(|i| std::array::from_fn(|k| covariance[(i, k)]));
        point.std_mm = std::array::from_fn(|i| covariance[(i, i)].sqrt());
        point.pixel_chi2 = Some(refined.reduced_chi2);
        let [Some(_), Some(_), ..] = refined.centres[..] else { return };
        let features = [Some(&mut point.telecentric), Some(&mut point.entocentric)].into_iter();
        let features = features.chain(further.iter_mut().map(Option::as_mut)).enumerate();
        for ((band, feature), own) in features.zip(&refined.centres) {
            if let (Some(feature), Some(own)) = (feature, own) {
                (feature.centre, feature.centre_std_px) = self.registers[band].mapped_centre(own.centre, own.std_px);
            }
        }
        // Every band tells a centre and a size, of which four numbers are the dot's.
        let shown = refined.centres.iter().flatten();
        point.match_chi2 = shown.clone().map(|own| own.chi2).sum();
        point.match_dof = 3 * shown.count() - 4;
        let images = [point.telecentric, point.entocentric]
            .map(|feature| self.instrument.sensor.image_from_pixel(feature.centre));
        point.gamma = images[0].radius_mm() / images[1].radius_mm();
        let [t, e] = images;
        point.azimuth_residual_px =
            (t.x_mm * e.y_mm - t.y_mm * e.x_mm) / t.radius_mm().max(1e-12) / self.instrument.sensor.pitch_mm;
        placed.widen(birge_ratio2(placed.point.match_chi2, placed.point.match_dof));
    }

    /// Index in the instrument of a band of the model.
    fn index(&self, band: usize) -> usize {
        self.model.index(band)
    }

    /// A band of the model.
    fn band(&self, band: usize) -> &Band {
        &self.instrument.bands[self.index(band)]
    }

    /// Pairs the features of the two bands, finds what the others show of the pairs, and places them: what
    /// [`Reconstructor::reconstruct`] does once it has detected. The telecentric and the entocentric band come first.
    pub fn points_from(&self, detections: &[Detection]) -> Reconstruction {
        let mut placing = Placing::default();
        self.placed(detections, 1, &mut placing);
        self.account(detections, &placing)
    }

    /// The features of the band with a role.
    pub fn detect(&self, frame: &Frame, role: Role) -> Result<Detection, FrameError> {
        self.detect_band(frame, self.instrument.band_index(role))
    }

    /// The features of a band, by its index in the instrument; none where there is no such band.
    pub fn detect_band(&self, frame: &Frame, index: usize) -> Result<Detection, FrameError> {
        let planes = self.planes(frame.into())?;
        let mut detection = Detection::default();
        if let Some(band) = (0..self.model.bands()).find(|band| self.model.index(*band) == index) {
            self.detect_plane(band, &planes.of_band(index)?, &mut Detector::default(), &mut detection);
        }
        Ok(detection)
    }

    fn planes<'a>(&'a self, frame: FrameView<'a>) -> Result<Planes<'a>, FrameError> {
        Planes::of(&self.instrument, self.crosstalk.as_ref(), frame, self.options.noise)
    }

    fn detect_plane(
        &self,
        band: usize,
        (plane, noise): &(PlaneView<'_>, Noise),
        detector: &mut Detector,
        detection: &mut Detection,
    ) {
        let stated = self.band(band);
        let [u, v] = self.instrument.axis_px(stated);
        let estimator = match self.options.mode {
            Mode::Paper => Estimator::Radial { axis: PixelPoint { u, v } },
            Mode::Centroid => Estimator::Cartesian,
            Mode::Model => Estimator::Rough,
        };
        detector.options = DetectOptions { estimator, ..self.options.detect };
        detector.detect_shaded(plane, Some(noise), self.shading(band, plane), detection);
        self.registers[band].onto_image_plane(detection);
    }

    /// What the masks leave of an even ground, computed with the first frame; `None` without a response table, or for
    /// planes of another size.
    fn shading(&self, band: usize, plane: &PlaneView<'_>) -> Option<&Shading> {
        let (table, index) = self.model.table(band)?;
        let shading = self.shadings[band].get_or_init(|| Shading::of(table, index, &self.registers[band], plane));
        shading.fits(plane).then_some(shading)
    }

    /// Puts points together, and whatever is left into rejections.
    fn account(&self, detections: &[Detection], placing: &Placing) -> Reconstruction {
        let Placing { groups, points, .. } = placing;
        let mut rejected = Vec::new();
        for (band, detection) in detections.iter().enumerate() {
            let mut fates = vec![Some(RejectionReason::NoPartner); detection.features.len()];
            for (group, point) in groups.iter().zip(points) {
                let fate = if point.is_some() { None } else { Some(RejectionReason::NoDepth) };
                group.feature(band).into_iter().for_each(|index| fates[index] = fate);
            }
            let name = &self.band(band).name;
            rejected.extend(detection.rejected.iter().map(|bystander| bystander.rejection(name)));
            rejected.extend(detection.features.iter().zip(fates).filter_map(|(feature, fate)| {
                let fate = if feature.saturated { fate.and(Some(RejectionReason::Saturated)) } else { fate };
                Some(Rejection {
                    band: name.clone(),
                    position: feature.centre,
                    area_px: feature.area_px,
                    reason: fate?,
                })
            }));
        }
        let mut further = Vec::new();
        for (point, placed) in points.iter().flatten().enumerate() {
            let images = placed.further.iter().enumerate().filter_map(|(band, feature)| Some((band + 2, (*feature)?)));
            further.extend(images.map(|(band, feature)| FurtherImage { point, band: self.index(band), feature }));
        }
        Reconstruction { points: points.iter().flatten().map(|placed| placed.point).collect(), further, rejected }
    }

    /// The point of every pair; first by the pair alone and as if all features faced the camera, then with the tilt of
    /// the surface that their neighbours show and with what the further bands show at the place where it is predicted.
    fn placed(&self, detections: &[Detection], threads: usize, placing: &mut Placing) {
        let Placing { matcher, slopes, pairs, groups, points } = placing;
        let epipole = Epipole::new(&self.model, &self.instrument.sensor, self.instrument.depth_range());
        let [telecentric, entocentric] = [0, 1].map(|band| &detections[band].features[..]);
        matcher.pair_up(&epipole, telecentric, entocentric, &self.options.matching, pairs);
        groups.clear();
        groups.extend(pairs.drain(..).map(Group::of));
        points.clear();
        points.resize(groups.len(), None);
        for_each(points, threads, |place, point| *point = self.point(detections, &groups[place]));
        if self.options.mode == Mode::Paper {
            return;
        }
        self.find_further(detections, groups, points);
        // The fit of pixels finds slopes by itself.
        let tilts = self.options.mode == Mode::Centroid;
        if tilts {
            slopes.lay_through(points.iter().flatten().map(|placed| placed.point.position_mm));
        }
        if tilts || detections.len() > 2 {
            for placed in points.iter_mut().flatten() {
                let slopes = if tilts { slopes.at(placed.point.position_mm).unwrap_or_default() } else { [0.0; 2] };
                self.place_again(placed, slopes);
            }
        }
    }

    /// Gives every group and its point what the further bands show where that is predicted.
    fn find_further(&self, detections: &[Detection], groups: &mut [Group], points: &mut [Option<Placed>]) {
        groups.iter_mut().for_each(|group| group.further.clear());
        for (band, detection) in detections.iter().enumerate().skip(2) {
            let predicted: Vec<Option<PixelPoint>> = points
                .iter()
                .map(|placed| {
                    let Point { position_mm, diameter_mm, .. } = placed.as_ref()?.point;
                    let image = self.model.image(band, position_mm, &Disc { diameter_mm, slopes: [0.0; 2] }).image;
                    Some(self.instrument.sensor.pixel_from_image(image))
                })
                .collect();
            let found = match_predicted(&predicted, &detection.features, self.options.matching.prediction_tolerance_px);
            groups.iter_mut().zip(found).for_each(|(group, feature)| group.further.push(feature));
        }
        for (group, placed) in groups.iter().zip(points) {
            if let Some(placed) = placed {
                let shown = group.further.iter().zip(&detections[2..]);
                placed.further.clear();
                placed.further.extend(shown.map(|(index, detection)| index.map(|index| detection.features[index])));
            }
        }
    }

    /// Where a band sees a feature.
    fn sighting(&self, band: usize, feature: &Feature) -> Sighting {
        let sensor = &self.instrument.sensor;
        let image = sensor.image_from_pixel(feature.centre);
        Sighting { band, image, std_mm: feature.centre_std_px.map(|std_px| std_px * sensor.pitch_mm) }
    }

    /// Where all bands see a point.
    fn sightings(&self, placed: &Placed) -> SmallVec<[Sighting; 4]> {
        let Placed { point: Point { telecentric, entocentric, .. }, further } = placed;
        let features = [Some(telecentric), Some(entocentric)].into_iter().chain(further.iter().map(Option::as_ref));
        features.enumerate().filter_map(|(band, feature)| Some(self.sighting(band, feature?))).collect()
    }

    /// The point of one group by its pair alone, on a surface that faces the camera.
    fn point(&self, detections: &[Detection], group: &Group) -> Option<Placed> {
        let Match { telecentric, entocentric, azimuth_residual_px, ambiguous } = group.pair;
        let features = [detections[0].features[telecentric], detections[1].features[entocentric]];
        let measured = [self.sighting(0, &features[0]), self.sighting(1, &features[1])];
        let (position, diameter_mm) = if self.options.mode == Mode::Paper {
            let position = paper_position(&self.instrument, &self.model, &measured)?;
            (position, self.apparent_diameter_mm(&features, position.position_mm[2]))
        } else {
            let start_mm = first_order_position_mm(&self.instrument, &self.model, &measured)?;
            let diameter_mm = self.apparent_diameter_mm(&features, start_mm[2]);
            let disc = Disc { diameter_mm, slopes: [0.0; 2] };
            (model_position(&self.model, &measured, &disc, start_mm)?, diameter_mm)
        };
        // What a pair leaves is how far it lies beside its azimuth.
        let azimuth_std_px =
            features.iter().map(|f| f.centre_std_px[0].max(f.centre_std_px[1]).powi(2)).sum::<f64>().sqrt();
        let point = Point {
            position_mm: [0.0; 3],
            std_mm: [0.0; 3],
            covariance_mm2: [[0.0; 3]; 3],
            match_chi2: (azimuth_residual_px / azimuth_std_px.max(1e-9)).powi(2),
            match_dof: 1,
            pixel_chi2: None,
            gamma: gamma(&measured),
            telecentric: features[0],
            entocentric: features[1],
            azimuth_residual_px,
            diameter_mm,
            ambiguous,
        };
        let mut placed = Placed { point, further: Vec::new() };
        placed.settle(&position, diameter_mm).then_some(placed)
    }

    /// Places a point anew on a surface with slopes, by what all bands show of it; what was known of it tells its size.
    fn place_again(&self, placed: &mut Placed, slopes: [f64; 2]) {
        let features = [placed.point.telecentric, placed.point.entocentric];
        let start_mm = placed.point.position_mm;
        // A tilted disc looks smaller by the cosine of its tilt.
        let foreshortening = 1.0 / (1.0 + slopes[0].powi(2) + slopes[1].powi(2)).sqrt();
        let diameter_mm = self.apparent_diameter_mm(&features, start_mm[2]) / foreshortening.sqrt();
        let sightings = self.sightings(placed);
        let disc = Disc { diameter_mm, slopes };
        if let Some(position) = model_position(&self.model, &sightings, &disc, start_mm)
            && placed.settle(&position, diameter_mm)
            && sightings.len() > 2
        {
            (placed.point.match_chi2, placed.point.match_dof) = (position.chi2, 2 * sightings.len() - 3);
        }
    }

    /// Diameter of the disc of the outlines' area, facing the camera: from the larger of the two outlines, since the
    /// other band's may have lost more to the masks.
    ///
    /// Blur over a disc of radius b moves the half-lit edge of a disc of radius a inwards by b²/8a: the mean square of
    /// the blur along one direction, b²/4, times half the edge's curvature.
    fn apparent_diameter_mm(&self, features: &[Feature; 2], z_mm: f64) -> f64 {
        let (magnifications, blurs_mm) = (self.model.magnifications(z_mm), self.model.blur_radii_mm(z_mm));
        let diameters_mm = [0, 1].map(|role| {
            let half_lit_px = (features[role].area_px / PI).sqrt();
            let half_lit_mm = half_lit_px * self.instrument.sensor.pitch_mm;
            2.0 * (half_lit_mm + blurs_mm[role].powi(2) / (8.0 * half_lit_mm)) / magnifications[role]
        });
        diameters_mm[0].max(diameters_mm[1])
    }
}
