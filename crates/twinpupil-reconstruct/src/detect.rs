//! From a plane to its features.

use twinpupil_instrument::{PixelPoint, PlaneView};

use crate::background::{Polarity, quantile};
use crate::centroid::{Centre, cartesian_means, radial_mean};
use crate::contrast::Contrast;
use crate::flood::{FloodRule, flood};
use crate::lattice::{BLUR_MAX, off_lattice};
use crate::noise::Noise;
use crate::outline::{Outline, outlines};
use crate::rejection::{Bystander, RejectionReason};
use crate::relief::Relief;
use crate::shading::Shading;
use crate::window::Windows;

/// How the centre of a feature is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Estimator {
    /// Centroid in Cartesian coordinates.
    Cartesian,
    /// Centroid of the light in blocks of pixels: within some tenths of a pixel, to start a fit from.
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

/// Skirts are followed down to this share of the typical height.
const SKIRT: f32 = 0.02;

/// Two summits are one feature unless the saddle lies below this share of the lower.
const SADDLE: f32 = 0.7;

/// Finds and measures the features of one plane.
///
/// `noise` is that of the sensor where it is known; without it, background scatter is taken for all of the noise. One
/// who reads many planes keeps a [`Detector`] instead.
pub fn detect(plane: &PlaneView<'_>, noise: Option<&Noise>, options: &DetectOptions) -> Detection {
    let mut detection = Detection::default();
    Detector::new(*options).detect(plane, noise, &mut detection);
    detection
}

/// Finds features in one plane after another and keeps its buffers, so that it allocates nothing once it is warm.
#[derive(Debug, Clone, Default)]
pub struct Detector {
    options: DetectOptions,
}

impl Detector {
    /// A detector with settings of its own.
    pub fn new(options: DetectOptions) -> Self {
        Self { options }
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
        let options = &self.options;
        let contrast = Contrast::new(plane, options.polarity, noise, shading);
        let (relief, found) = find(&contrast, options);
        let background_noise =
            Noise { floor_codes2: f64::from(contrast.pixel_noise).powi(2), slope_codes: 0.0, black_level: 0.0 };
        let noise = noise.unwrap_or(&background_noise);
        let measure = Measure { plane, contrast: &contrast, relief: &relief, noise, options };
        let (features, rejected) = measure.all(&found);
        *detection = Detection { features, rejected, polarity: contrast.polarity, background_codes: contrast.ground };
    }
}

/// The outlines of everything that stands out of the noise, on a relief no finer than large features need.
fn find(contrast: &Contrast, options: &DetectOptions) -> (Relief, Vec<Outline>) {
    const COARSE: usize = 2;
    const LARGE: usize = 15;
    let significant = options.significance_min as f32 * contrast.pixel_noise;
    let scale = if contrast.median_run(significant) >= LARGE { COARSE } else { 1 };
    let relief = Relief::of(contrast, scale);
    let mut standing_out: Vec<f32> =
        relief.heights.iter().step_by(7).copied().filter(|height| *height > significant).collect();
    let typical = quantile(&mut standing_out, 0.9);
    let noise = options.significance_min as f32 * relief.noise;
    let floor = (0.5 * options.relative_contrast_min as f32 * typical).max(noise);
    let rule = FloodRule { floor, saddle: SADDLE, pixels_min: (options.pixels_min / 2).max(1) as u32 };
    let basins = flood(&relief.heights, relief.columns, rule);
    let mut found = outlines(&relief, &basins, (SKIRT * typical).max(noise));
    found.retain(|outline| outline.height > significant);
    (relief, found)
}

/// Measures outlines, or says why not.
struct Measure<'a> {
    plane: &'a PlaneView<'a>,
    contrast: &'a Contrast,
    relief: &'a Relief,
    noise: &'a Noise,
    options: &'a DetectOptions,
}

impl Measure<'_> {
    fn all(&self, found: &[Outline]) -> (Vec<Feature>, Vec<Bystander>) {
        let mut windows = Windows::new(self.contrast, &self.discs(found));
        let centres = cartesian_means(&mut windows, self.contrast, self.noise);
        let mut heights: Vec<f32> = found.iter().map(|outline| outline.height).collect();
        let height_min = self.options.relative_contrast_min as f32 * quantile(&mut heights, 0.9);
        let (mut features, mut rejected) = (Vec::new(), Vec::new());
        for (index, (outline, centre)) in found.iter().zip(centres).enumerate() {
            let judged = self.flaw(outline, height_min).map_or_else(
                || {
                    let centre = self.centre(&windows, index, outline, centre).ok_or(RejectionReason::NoCentre)?;
                    Ok(self.feature(outline, centre, windows.overlaps(index)))
                },
                Err,
            );
            match judged {
                Ok(feature) => features.push(feature),
                Err(reason) => {
                    let centre = Centre { position: self.plane_centre(outline), std: [0.5; 2] };
                    let feature = self.feature(outline, centre, windows.overlaps(index));
                    rejected.push(Bystander { feature, reason });
                }
            }
        }
        features.sort_by(|a, b| a.centre.v.total_cmp(&b.centre.v).then(a.centre.u.total_cmp(&b.centre.u)));
        (features, rejected)
    }

    /// Centres, extents and skirts of outlines, pixels of the plane.
    fn discs(&self, found: &[Outline]) -> Vec<([f64; 2], f64, f64)> {
        let scale = self.relief.scale as f64;
        let disc = |outline: &Outline| {
            (self.plane_centre(outline), outline.extent(self.relief.columns) * scale, outline.skirt * scale)
        };
        found.iter().map(disc).collect()
    }

    fn plane_centre(&self, outline: &Outline) -> [f64; 2] {
        outline.centre.map(|coordinate| self.relief.plane_position(coordinate))
    }

    /// Why an outline cannot be measured, if so.
    fn flaw(&self, outline: &Outline, height_min: f32) -> Option<RejectionReason> {
        if outline.touches_edge {
            Some(RejectionReason::CutByBorder)
        } else if self.pixels(outline) < self.options.pixels_min {
            Some(RejectionReason::TooSmall)
        } else if outline.height < height_min {
            Some(RejectionReason::LowContrast)
        } else if self.saturated(outline) {
            Some(RejectionReason::Saturated)
        } else {
            None
        }
    }

    /// More than one pixel in fifty of the outline reads the largest code, or the ground about a dark feature does.
    fn saturated(&self, outline: &Outline) -> bool {
        let code_max = self.plane.code_max;
        if self.contrast.polarity == Polarity::Dark {
            return self.contrast.ground >= f64::from(code_max) - 0.5;
        }
        let (columns, scale) = (self.relief.columns, self.relief.scale);
        let at_limit = |index: &&u32| {
            let (column, row) = (**index as usize % columns, **index as usize / columns);
            self.plane.code(column * scale, row * scale) == code_max
        };
        50 * outline.pixels.iter().filter(at_limit).count() > outline.pixels.len()
    }

    /// The centre by the chosen estimator, in pixels of the plane.
    fn centre(&self, windows: &Windows<'_>, index: usize, outline: &Outline, centre: Option<Centre>) -> Option<Centre> {
        let centre = centre?;
        match self.options.estimator {
            Estimator::Rough => Some(centre),
            Estimator::Cartesian if self.has_soft_edge(outline) => Some(centre),
            Estimator::Cartesian => {
                let pixel_width = 1.0 / self.plane.step_px as f64;
                let position = off_lattice(windows, self.contrast, self.noise, index, centre.position, pixel_width);
                Some(Centre { position, ..centre })
            }
            Estimator::Radial { axis } => {
                let step = self.plane.step_px as f64;
                let origin = self.plane.origin_px.map(|o| o as f64);
                let axis = [(axis.u - origin[0]) / step, (axis.v - origin[1]) / step];
                let [radius, azimuth] = radial_mean(windows, index, axis)?;
                let position = [axis[0] + radius * azimuth.cos(), axis[1] + radius * azimuth.sin()];
                Some(Centre { position, ..centre })
            }
        }
    }

    /// Whether a feature's skirt is so wide that the lattice cannot matter; what the relief adds to it is allowed for.
    fn has_soft_edge(&self, outline: &Outline) -> bool {
        outline.skirt * self.relief.scale as f64 > 2.0 * BLUR_MAX + 2.0 * self.relief.scale as f64
    }

    fn feature(&self, outline: &Outline, centre: Centre, overlapped: bool) -> Feature {
        let step = self.plane.step_px as f64;
        Feature {
            centre: self.frame_position(centre.position),
            centre_std_px: centre.std.map(|std| std * step),
            area_px: self.area_px(outline),
            height_codes: f64::from(outline.height),
            ground_codes: self.contrast.ground,
            edge_px: outline.skirt * self.relief.scale as f64 * step,
            overlapped,
        }
    }

    fn frame_position(&self, position: [f64; 2]) -> PixelPoint {
        PixelPoint { u: self.plane.frame_u_px(position[0]), v: self.plane.frame_v_px(position[1]) }
    }

    fn area_px(&self, outline: &Outline) -> f64 {
        (self.pixels(outline) * self.plane.step_px.pow(2)) as f64
    }

    /// Pixels of the plane in an outline.
    fn pixels(&self, outline: &Outline) -> usize {
        outline.pixels.len() * self.relief.scale.pow(2)
    }
}
