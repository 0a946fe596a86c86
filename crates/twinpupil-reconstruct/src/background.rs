//! The light between the features: a smooth surface through what is left when features are masked.

use twinpupil_instrument::PlaneView;

use crate::noise::Noise;
use crate::quantile::STD_PER_DISTANCE;
use crate::shading::Shading;
use crate::surface::{Sample, Surface};

/// Whether features are brighter or darker than what surrounds them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Polarity {
    /// Bright features on dark ground.
    #[default]
    Bright,
    /// Dark features on bright ground.
    Dark,
}

impl Polarity {
    /// Of the contrast of features: 1 or −1.
    pub fn sign(self) -> f64 {
        match self {
            Self::Bright => 1.0,
            Self::Dark => -1.0,
        }
    }
}

/// Number of pixels that tell the background, about; they are spread evenly over the plane.
const SAMPLES: usize = 4096;

/// Share of a tile that is surely ground, however many features it holds.
const GROUND_SHARE: f64 = 0.1;

/// Samples within this share of the contrast of the surface count as ground, round by round; at last only noise.
const GROUND_LIMITS: [f32; 4] = [0.25, 0.05, 0.0, 0.0];

/// Least distance from the surface within which samples count as ground, in standard deviations of a pixel.
const GROUND_SIGMAS: f32 = 2.5;

/// Background of a plane.
#[derive(Debug, Clone)]
pub(crate) struct Background {
    surface: Surface,
    /// Mean level above black, codes.
    pub(crate) mean: f64,
    /// Noise of one pixel, codes.
    pub(crate) pixel_noise: f64,
    pub(crate) polarity: Polarity,
}

impl Background {
    /// Starts from the level that only a tenth of each tile lies beyond, then fits a surface to what lies near it,
    /// until features and their skirts are left out. `noise` gives the variance of a pixel where it is known.
    /// `shading` is what the masks leave of an even ground; the surface is that of the light without them.
    pub(crate) fn estimate(
        plane: &PlaneView<'_>,
        polarity: Option<Polarity>,
        noise: Option<&Noise>,
        shading: Option<&Shading>,
    ) -> Self {
        let black = noise.map_or(0.0, |noise| noise.black_level as f32);
        let mut samples = samples(plane);
        samples.iter_mut().for_each(|sample| sample.code -= black);
        if let Some(shading) = shading {
            shading.undo(&mut samples);
        }
        let mut surface = Surface::covering(plane);
        let polarity = polarity.unwrap_or_else(|| longer_tail(&samples, &mut surface));
        let share = match polarity {
            Polarity::Bright => GROUND_SHARE,
            Polarity::Dark => 1.0 - GROUND_SHARE,
        };
        surface.set_to_quantiles(&samples, share);
        let measured_noise = measured_noise(plane);
        let mut ground = Self { mean: surface.mean(), surface, pixel_noise: measured_noise, polarity };
        let contrast = quantile(&mut samples.iter().map(|sample| ground.away(sample)).collect::<Vec<_>>(), 0.995);
        for limit in GROUND_LIMITS {
            if let Some(noise) = noise {
                // What the frame itself shows counts where it is noisier than the sensor ought to be.
                ground.pixel_noise = noise.variance(ground.mean + noise.black_level).sqrt().max(measured_noise);
            }
            let limit = (limit * contrast).max(GROUND_SIGMAS * ground.pixel_noise.max(0.5) as f32);
            // Both ways: where the masks leave a dark spot about the axis, the surface passes over it.
            let near: Vec<Sample> = samples.iter().filter(|s| ground.away(s).abs() <= limit).copied().collect();
            ground.surface.fit(&near, samples.len());
            ground.mean = ground.surface.mean();
        }
        ground
    }

    /// Background of every pixel of a row of the plane.
    pub(crate) fn fill_row(&self, row: usize, ground: &mut [f32]) {
        self.surface.fill_row(row, ground);
    }

    /// How far a sample lies from the ground on the side of the features.
    fn away(&self, sample: &Sample) -> f32 {
        let difference = sample.code - self.surface.at(sample);
        match self.polarity {
            Polarity::Bright => difference,
            Polarity::Dark => -difference,
        }
    }
}

/// Columns and rows from one sample to the next.
fn stride(plane: &PlaneView<'_>) -> usize {
    (((plane.columns * plane.rows) as f64 / SAMPLES as f64).sqrt().round() as usize).clamp(1, 12)
}

/// Pixels spread evenly over a plane.
fn samples(plane: &PlaneView<'_>) -> Vec<Sample> {
    let stride = stride(plane);
    let sample = |row: usize| {
        let codes = plane.row(row).enumerate().step_by(stride);
        codes.map(move |(column, code)| Sample { column: column as u32, row: row as u32, code: f32::from(code) })
    };
    (0..plane.rows).step_by(stride).flat_map(sample).collect()
}

/// The polarity whose tail about the local median is the longer.
fn longer_tail(samples: &[Sample], surface: &mut Surface) -> Polarity {
    surface.set_to_quantiles(samples, 0.5);
    let mut residuals: Vec<f32> = samples.iter().map(|sample| sample.code - surface.at(sample)).collect();
    let (low, high) = (quantile(&mut residuals, 0.005), quantile(&mut residuals, 0.995));
    if -low > high { Polarity::Dark } else { Polarity::Bright }
}

/// Noise of one pixel from second differences along rows, which a slope does not reach: 1.4826 × their median size,
/// over √6.
pub(crate) fn measured_noise(plane: &PlaneView<'_>) -> f64 {
    let stride = stride(plane);
    let mut differences = Vec::new();
    for row in (0..plane.rows).step_by(stride) {
        let codes: Vec<f32> = plane.row(row).map(f32::from).collect();
        differences.extend(codes.windows(3).step_by(stride).map(|c| (c[0] - 2.0 * c[1] + c[2]).abs()));
    }
    STD_PER_DISTANCE * f64::from(quantile(&mut differences, 0.5)) / 6.0_f64.sqrt()
}

/// The value below which a share of `values` lies; 0 if there are none. Reorders `values`.
pub(crate) fn quantile(values: &mut [f32], share: f64) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let index = ((values.len() - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(index, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use twinpupil_instrument::{Frame, Mosaic};

    fn frame(level: impl Fn(usize, usize) -> u16) -> Frame {
        let codes = (0..400 * 300).map(|index| level(index % 400, index / 400)).collect();
        Frame::new(400, 300, u16::MAX, vec![codes]).expect("a legal frame")
    }

    fn estimate(frame: &Frame) -> (Background, Vec<f32>) {
        let background = Background::estimate(&frame.plane(Mosaic::Mono, "0").expect("page 0"), None, None, None);
        let mut row = vec![0.0; 400];
        background.fill_row(150, &mut row);
        (background, row)
    }

    #[test]
    fn a_slope_under_bright_discs_is_followed() {
        let slope = |u: usize, v: usize| 1000 + u as u16 + 2 * v as u16;
        let (background, row) = estimate(&frame(|u, v| {
            let inside = (u % 100).abs_diff(50).pow(2) + (v % 100).abs_diff(50).pow(2) < 30_usize.pow(2);
            slope(u, v) + if inside { 8000 } else { 0 }
        }));
        assert_eq!(background.polarity, Polarity::Bright);
        for u in [40, 100, 200, 300, 350] {
            assert!((row[u] - f32::from(slope(u, 150))).abs() < 40.0, "{u}: {}", row[u]);
        }
    }

    #[test]
    fn dark_discs_are_told_from_bright_ones() {
        let (background, row) = estimate(&frame(|u, v| if (u / 40 + v / 40) % 5 == 0 { 500 } else { 9000 }));
        assert_eq!(background.polarity, Polarity::Dark);
        assert!(row.iter().all(|level| (level - 9000.0).abs() < 1.0));
    }
}
