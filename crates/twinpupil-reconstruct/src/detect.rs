//! From a plane to its features.

use twinpupil_instrument::{PixelPoint, PlaneView};

use crate::background::{Polarity, quantile};
use crate::centroid::{Bench, Centre, RadialMean, Shared};
use crate::contrast::Contrast;
use crate::lattice::{BLUR_MAX, Shape, off_lattice};
use crate::lone::{Scatter, lone_mean};
use crate::noise::Noise;
use crate::rejection::{Bystander, RejectionReason};
use crate::relief::{BINOMIAL_GAIN, Relief};
use crate::scout::ground::{Ground, Survey};
use crate::scout::light::Light;
use crate::scout::run::runs_of_row;
use crate::scout::{Blob, Scout};
use crate::shading::Shading;
use crate::window::{Disc, Neighbours};

/// How the centre of a feature is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Estimator {
    /// Centroid in Cartesian coordinates.
    Cartesian,
    /// Centroid of the light above half the height: within some tenths of a pixel, to start a fit from.
    Rough,
    /// Mean radius and mean azimuth about the axis  [Ohno2018, Eqs. 9–11].
    Radial {
        /// Where the optical axis meets the sensor.
        axis: PixelPoint,
    },
}

/// What counts as a feature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectOptions {
    /// Bright or dark features; `None` lets the plane decide by its longer tail.
    pub polarity: Option<Polarity>,
    /// Fewest pixels of the plane above half the feature's height.
    pub pixels_min: usize,
    /// Least contrast, relative to the typical strong feature of the plane.
    pub relative_contrast_min: f64,
    /// Least contrast, in standard deviations of the background in one pixel.
    pub significance_min: f64,
    /// How centres are measured.
    pub estimator: Estimator,
}

impl Default for DetectOptions {
    fn default() -> Self {
        Self {
            polarity: None,
            pixels_min: 9,
            relative_contrast_min: 0.15,
            significance_min: 4.0,
            estimator: Estimator::Cartesian,
        }
    }
}

/// A bright or dark spot in one plane of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feature {
    /// Its centre on the frame.
    pub centre: PixelPoint,
    /// Standard deviation of the centre from pixel noise, along u and v, px.
    pub centre_std_px: [f64; 2],
    /// Its area above half its height, px of the frame.
    pub area_px: f64,
    /// Its contrast, codes.
    pub height_codes: f64,
    /// Level of the ground about it, codes.
    pub ground_codes: f64,
    /// About how far its edge reaches, from half its height to its foot, px: the radius of its blur.
    pub edge_px: f64,
    /// Whether a neighbour's light reaches into its window and was taken out.
    pub overlapped: bool,
    /// Whether part of it reads the largest code: its edges alone tell something.
    pub saturated: bool,
}

/// What was found in one plane; every feature is either measured or rejected.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Detection {
    /// Features with a measured centre, from top to bottom.
    pub features: Vec<Feature>,
    /// The others, each with its reason; their light still falls on their neighbours.
    pub rejected: Vec<Bystander>,
    /// Which side of the background they lie on.
    pub polarity: Polarity,
    /// Mean level of the background, codes.
    pub background_codes: f64,
}

/// Finds and measures the features of one plane.
///
/// `noise` is that of the sensor where it is known; without it, background scatter is taken for all of the noise. One
/// who reads many planes keeps a [`Detector`] instead.
pub fn detect(plane: &PlaneView<'_>, noise: Option<&Noise>, options: &DetectOptions) -> Detection {
    let mut detection = Detection::default();
    Detector::new(*options).detect(plane, noise, &mut detection);
    detection
}

/// Finds features in one plane after another and keeps its buffers, so that it allocates next to nothing once it is warm.
#[derive(Debug, Clone, Default)]
pub struct Detector {
    pub(crate) options: DetectOptions,
    survey: Survey,
    contrast: Contrast,
    search: Search,
    discs: Vec<Disc>,
    neighbours: Neighbours,
    centres: Vec<Option<Centre>>,
    bench: Bench,
}

/// What features are searched with, and those that were found.
#[derive(Debug, Clone, Default)]
struct Search {
    scout: Scout,
    blobs: Vec<Blob>,
    relief: Relief,
    line: Vec<f32>,
    masks: Vec<u16>,
}

/// Features that stand out by less than so many standard deviations of a pixel are looked for on a smoothed plane.
const CLEAR_SIGMAS: f32 = 50.0;

/// Beyond the foot of its edge a window reaches on by this share of the edge and so many pixels.
const REACH: f64 = 1.1;
const MARGIN: f64 = 1.5;

impl Detector {
    /// A detector with settings of its own.
    pub fn new(options: DetectOptions) -> Self {
        Self { options, ..Self::default() }
    }

    /// Finds and measures the features of one plane; `detection` is overwritten.
    ///
    /// `noise` is that of the sensor where it is known; without it, background scatter is taken for all of the noise.
    /// The result depends on nothing that was read before.
    pub fn detect(&mut self, plane: &PlaneView<'_>, noise: Option<&Noise>, detection: &mut Detection) {
        self.detect_shaded(plane, noise, None, detection);
    }

    /// [`Self::detect`] on a ground that the masks shade.
    pub(crate) fn detect_shaded(
        &mut self,
        plane: &PlaneView<'_>,
        noise: Option<&Noise>,
        shading: Option<&Shading>,
        detection: &mut Detection,
    ) {
        let Self { options, survey, contrast, search, discs, neighbours, centres, bench } = self;
        let ground = Ground::survey(plane, options.polarity, noise, shading, survey);
        let background_noise =
            Noise { floor_codes2: f64::from(ground.pixel_noise).powi(2), slope_codes: 0.0, black_level: 0.0 };
        let black = noise.map_or(0.0, |noise| noise.black_level);
        let noise = noise.unwrap_or(&background_noise);
        let mut field = Field { contrast, plane, ground: &ground, black, shading, filled: false };
        find(&mut field, options, survey, search);
        let Search { scout, blobs, line, .. } = search;
        discs.clear();
        discs.extend(blobs.iter().map(disc));
        neighbours.find(discs);
        let measure = Measure { plane, ground: &ground, options, scout, blobs };
        let shared = Shared {
            light: field.light(),
            scatter: Scatter::on(&ground, noise),
            noise: ground.pixel_noise,
            discs,
            neighbours,
        };
        centres.clear();
        centres.resize(blobs.len(), None);
        match options.estimator {
            Estimator::Rough => {
                centres.iter_mut().zip(&*blobs).for_each(|(centre, blob)| *centre = Some(measure.rough_centre(blob)));
            }
            Estimator::Cartesian => measure.cartesian_centres(&shared, bench, line, centres),
            Estimator::Radial { axis } => measure.radial_centres(&shared, bench, line, axis, centres),
        }
        measure.judge(centres, neighbours, line, detection);
    }
}

/// The contrast of a plane, computed for every pixel when it is first needed.
struct Field<'a> {
    contrast: &'a mut Contrast,
    plane: &'a PlaneView<'a>,
    ground: &'a Ground,
    black: f64,
    shading: Option<&'a Shading>,
    filled: bool,
}

impl Field<'_> {
    fn contrast(&mut self) -> &Contrast {
        if !self.filled {
            self.contrast.fill(self.plane, self.ground, self.black, self.shading);
            self.filled = true;
        }
        self.contrast
    }

    /// Contrasts as cheaply as the ground allows.
    fn light(&mut self) -> Light<'_> {
        if self.ground.surface.is_none() {
            return Light::Codes {
                plane: *self.plane,
                level: self.ground.level as f32,
                polarity: self.ground.polarity,
            };
        }
        let contrast = self.contrast();
        Light::Field { columns: contrast.columns, contrasts: &contrast.signal }
    }
}

/// Everything that stands out of the noise.
fn find(
    field: &mut Field<'_>,
    options: &DetectOptions,
    survey: &Survey,
    Search { scout, blobs, relief, line, masks }: &mut Search,
) {
    const SPARE_SIGMAS: f32 = 1.0;
    // Where features are large, some of their rows tell enough.
    const ROWS: usize = 7;
    const STEP_MAX: usize = 4;
    let noise = field.ground.pixel_noise;
    let sigmas = options.significance_min as f32;
    let (significant, clear) = (sigmas * noise, CLEAR_SIGMAS * noise);
    let floor = |typical: f32, noise: f32| (0.5 * options.relative_contrast_min as f32 * typical).max(noise);
    let light = field.light();
    let mut typical = typical_height(&light, survey, significant, line);
    let rows = if typical > 0.0 { median_run(&light, survey, 0.5 * typical, masks) } else { 0 };
    let step = (rows / ROWS).clamp(1, STEP_MAX);
    // Few features may have been missed by the samples.
    if typical == 0.0 || typical >= clear {
        scout.find(&light, step, floor(typical, significant + SPARE_SIGMAS * noise), blobs);
        line.clear();
        line.extend(blobs.iter().map(|blob| blob.height));
        typical = quantile(line, 0.9);
    }
    if typical < clear {
        let contrast = field.contrast();
        relief.smooth(&contrast.signal, contrast.columns);
        let smooth = Light::Field { columns: contrast.columns, contrasts: &relief.heights };
        scout.find(&smooth, step, floor(typical, BINOMIAL_GAIN * significant), blobs);
    }
    blobs.retain(|blob| blob.height > significant);
    blobs.sort_unstable_by(|a, b| a.centre[1].total_cmp(&b.centre[1]).then(a.centre[0].total_cmp(&b.centre[0])));
}

/// How high features rise, from samples of what stands out; 0 if none does.
fn typical_height(light: &Light<'_>, survey: &Survey, significant: f32, line: &mut Vec<f32>) -> f32 {
    line.clear();
    let contrasts = survey.places().iter().map(|[column, row]| light.at(*column as usize, *row as usize));
    line.extend(contrasts.filter(|contrast| *contrast > significant));
    quantile(line, 0.9)
}

/// Median length of the runs of pixels above a level along the rows of a survey; 0 without any.
fn median_run(light: &Light<'_>, survey: &Survey, level: f32, masks: &mut Vec<u16>) -> usize {
    const LONGEST: usize = 64;
    let (mut counts, mut runs) = ([0_usize; LONGEST + 1], 0);
    for row in survey.rows() {
        runs_of_row(light.against(row, level), masks, |first, end| {
            counts[(end - first).min(LONGEST)] += 1;
            runs += 1;
        });
    }
    let mut shorter = 0;
    counts
        .iter()
        .position(|count| {
            shorter += count;
            2 * shorter > runs
        })
        .unwrap_or(0)
}

/// Where the light of a blob lies.
fn disc(blob: &Blob) -> Disc {
    Disc { centre: blob.centre, extent: blob.extent, radius: blob.extent + REACH * blob.edge + MARGIN }
}

/// Measures blobs, or says why not.
struct Measure<'a> {
    plane: &'a PlaneView<'a>,
    ground: &'a Ground,
    options: &'a DetectOptions,
    scout: &'a Scout,
    blobs: &'a [Blob],
}

impl Measure<'_> {
    /// What the light above half the height tells.
    fn rough_centre(&self, blob: &Blob) -> Centre {
        const ALONE: f64 = 0.1;
        const TOUCHED: f64 = 0.5;
        Centre { position: blob.centre, std: [if blob.alone { ALONE } else { TOUCHED }; 2] }
    }

    /// Centroids of all light: one by one where features stand alone, else together.
    fn cartesian_centres(
        &self,
        shared: &Shared<'_>,
        bench: &mut Bench,
        line: &mut Vec<f32>,
        centres: &mut [Option<Centre>],
    ) {
        let pixel_width = 1.0 / self.plane.step_px as f64;
        self.means(shared, bench, line, |feature, centre, shape| {
            let sharp = shape.filter(|_| self.blobs[feature].edge <= 2.0 * BLUR_MAX);
            let position = sharp.map_or(centre.position, |shape| off_lattice(&shape, centre.position, pixel_width));
            centres[feature] = Some(Centre { position, ..centre });
        });
    }

    /// Calls `found` with the centroid of every feature and its shape, where it has light.
    fn means(
        &self,
        shared: &Shared<'_>,
        bench: &mut Bench,
        line: &mut Vec<f32>,
        mut found: impl FnMut(usize, Centre, Option<Shape>),
    ) {
        for (feature, disc) in shared.discs.iter().enumerate().filter(|(k, _)| shared.neighbours.is_alone(*k)) {
            if let Some((centre, shape)) = lone_mean(&shared.light, shared.scatter, disc, line) {
                found(feature, centre, Some(shape));
            }
        }
        shared.means(bench, found);
    }

    /// The paper's centres.
    fn radial_centres(
        &self,
        shared: &Shared<'_>,
        bench: &mut Bench,
        line: &mut Vec<f32>,
        axis: PixelPoint,
        centres: &mut [Option<Centre>],
    ) {
        self.means(shared, bench, line, |feature, centre, _| centres[feature] = Some(centre));
        let step = self.plane.step_px as f64;
        let origin = self.plane.origin_px.map(|o| o as f64);
        let axis = [(axis.u - origin[0]) / step, (axis.v - origin[1]) / step];
        for (feature, place) in centres.iter_mut().enumerate() {
            let Some(centre) = place else { continue };
            let mut mean = RadialMean::default();
            shared.for_each_row(feature, centre.position, bench, |row, first, own| {
                mean.add([first as f64 - axis[0], row as f64 - axis[1]], own);
            });
            *place = mean.mean().map(|[radius, azimuth]| {
                let position = [axis[0] + radius * azimuth.cos(), axis[1] + radius * azimuth.sin()];
                Centre { position, ..*centre }
            });
        }
    }

    /// Makes features of blobs, or rejections.
    fn judge(
        &self,
        centres: &[Option<Centre>],
        neighbours: &Neighbours,
        line: &mut Vec<f32>,
        detection: &mut Detection,
    ) {
        let Detection { features, rejected, polarity, background_codes } = detection;
        (*polarity, *background_codes) = (self.ground.polarity, self.ground.level);
        features.clear();
        rejected.clear();
        line.clear();
        line.extend(self.blobs.iter().map(|blob| blob.height));
        let height_min = self.options.relative_contrast_min as f32 * quantile(line, 0.9);
        for ((index, blob), centre) in self.blobs.iter().enumerate().zip(centres) {
            let overlapped = !neighbours.is_alone(index);
            match (self.flaw(blob, height_min), centre) {
                (None, Some(centre)) => features.push(self.feature(blob, *centre, overlapped)),
                (flaw, _) => {
                    let feature = self.feature(blob, self.rough_centre(blob), overlapped);
                    rejected.push(Bystander { feature, reason: flaw.unwrap_or(RejectionReason::NoCentre) });
                }
            }
        }
        features.sort_unstable_by(|a, b| a.centre.v.total_cmp(&b.centre.v).then(a.centre.u.total_cmp(&b.centre.u)));
    }

    /// Why a blob cannot be measured, if so.
    fn flaw(&self, blob: &Blob, height_min: f32) -> Option<RejectionReason> {
        if blob.touches_edge {
            Some(RejectionReason::CutByBorder)
        } else if blob.pixels < self.options.pixels_min {
            Some(RejectionReason::TooSmall)
        } else if blob.height < height_min {
            Some(RejectionReason::LowContrast)
        } else if !self.edges_tell() && self.saturated(blob) {
            Some(RejectionReason::Saturated)
        } else {
            None
        }
    }

    /// Whether what comes after makes do with the pixels below the largest code; the ground must be below it.
    fn edges_tell(&self) -> bool {
        self.options.estimator == Estimator::Rough && self.ground.polarity == Polarity::Bright
    }

    /// More than one pixel in fifty of the blob reads the largest code, or the ground about a dark feature does.
    fn saturated(&self, blob: &Blob) -> bool {
        const NEAR: f64 = 0.8;
        let code_max = self.plane.code_max;
        if self.ground.polarity == Polarity::Dark {
            return self.ground.level >= f64::from(code_max) - 0.5;
        }
        if self.ground.surface.is_none() && self.ground.level + f64::from(blob.height) < NEAR * f64::from(code_max) {
            return false;
        }
        let step = self.plane.step_px;
        let (mut at_limit, mut pixels) = (0, 0);
        for (row, columns) in self.scout.runs_of(blob) {
            let line = self.plane.line(row)[columns.start * step..].iter().step_by(step);
            at_limit += line.take(columns.len()).filter(|code| **code >= code_max).count();
            pixels += columns.len();
        }
        50 * at_limit > pixels
    }

    fn feature(&self, blob: &Blob, centre: Centre, overlapped: bool) -> Feature {
        let step = self.plane.step_px as f64;
        let [column, row] = centre.position;
        Feature {
            centre: PixelPoint { u: self.plane.frame_u_px(column), v: self.plane.frame_v_px(row) },
            centre_std_px: centre.std.map(|std| std * step),
            area_px: blob.area * step * step,
            height_codes: f64::from(blob.height),
            ground_codes: self.ground.level,
            edge_px: blob.edge * step,
            overlapped,
            saturated: self.saturated(blob),
        }
    }
}
