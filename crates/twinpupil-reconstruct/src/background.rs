//! The light between the features: a smooth surface through what is left when features are masked.

use twinpupil_instrument::PlaneView;

/// Whether features are brighter or darker than what surrounds them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Polarity {
    /// Bright features on dark ground.
    Bright,
    /// Dark features on bright ground.
    Dark,
}

/// Side of a tile, pixels of the plane.
const TILE: usize = 64;

/// Every how many pixels a tile is sampled for its median.
const STRIDE: usize = 4;

/// Background of a plane on a grid of tile centres, bilinear between them.
#[derive(Debug, Clone)]
pub(crate) struct Background {
    tiles: Tiles,
    levels: Vec<f32>,
    /// Mean level, codes.
    pub(crate) mean: f64,
    /// Noise of one pixel, codes.
    pub(crate) pixel_noise: f64,
    pub(crate) polarity: Polarity,
}

#[derive(Debug, Clone, Copy)]
struct Tiles {
    across: usize,
    down: usize,
    width: f64,
    height: f64,
}

impl Background {
    /// Tile medians, cleaned by their neighbours, tell features from ground; the mean of the ground is the background.
    pub(crate) fn estimate(plane: &PlaneView<'_>, polarity: Option<Polarity>) -> Self {
        let tiles = Tiles::covering(plane);
        let samples = tiles.samples(plane);
        let medians: Vec<f32> = samples.iter().map(|tile| quantile(&mut tile.clone(), 0.5)).collect();
        let first = tiles.median_of_neighbours(&medians);
        let polarity = polarity.unwrap_or_else(|| longer_tail(&samples, &first));
        let scatter = ground_scatter(&samples, &first, polarity);
        let (levels, weights) = ground_means(&samples, &first, 4.0 * scatter.max(0.5), polarity);
        let levels = tiles.filled(&levels, &weights, &first);
        let mean = levels.iter().map(|&level| f64::from(level)).sum::<f64>() / levels.len() as f64;
        Self { tiles, levels, mean, pixel_noise: pixel_noise(plane), polarity }
    }

    /// Background of every pixel of a row of the plane.
    pub(crate) fn fill_row(&self, row: usize, ground: &mut [f32]) {
        let Tiles { across, down, width, height } = self.tiles;
        let (j, fj) = cell(row as f64, height, down);
        let line: Vec<f32> = (0..across)
            .map(|i| {
                let (upper, lower) = (self.levels[j * across + i], self.levels[(j + 1).min(down - 1) * across + i]);
                upper + fj * (lower - upper)
            })
            .collect();
        for (column, value) in ground.iter_mut().enumerate() {
            let (i, fi) = cell(column as f64, width, across);
            *value = line[i] + fi * (line[(i + 1).min(across - 1)] - line[i]);
        }
    }
}

/// Tile centre at or before a pixel, and how far on towards the next; the slope goes on beyond the outermost centres.
fn cell(pixel: f64, size: f64, count: usize) -> (usize, f32) {
    let position = (pixel + 0.5) / size - 0.5;
    let index = position.clamp(0.0, count.saturating_sub(2) as f64).floor();
    (index as usize, (position - index) as f32)
}

impl Tiles {
    fn covering(plane: &PlaneView<'_>) -> Self {
        let (across, down) = (plane.columns.div_ceil(TILE), plane.rows.div_ceil(TILE));
        Self { across, down, width: plane.columns as f64 / across as f64, height: plane.rows as f64 / down as f64 }
    }

    /// A sparse sample of codes from every tile; every tile has at least one.
    fn samples(&self, plane: &PlaneView<'_>) -> Vec<Vec<f32>> {
        let stride = STRIDE.min(plane.columns).min(plane.rows);
        let mut samples = vec![Vec::with_capacity((TILE / stride + 2).pow(2)); self.across * self.down];
        for row in (0..plane.rows).step_by(stride) {
            let j = ((row as f64 / self.height) as usize).min(self.down - 1);
            for (column, code) in plane.row(row).enumerate().step_by(stride) {
                let i = ((column as f64 / self.width) as usize).min(self.across - 1);
                samples[j * self.across + i].push(f32::from(code));
            }
        }
        samples
    }

    /// Median of the 5×5 tiles about every tile, so that a tile under a large feature takes its neighbours' level.
    fn median_of_neighbours(&self, levels: &[f32]) -> Vec<f32> {
        let near = |center: usize, count: usize| center.saturating_sub(2)..(center + 3).min(count);
        let mut around = Vec::with_capacity(25);
        (0..levels.len())
            .map(|index| {
                let (i, j) = (index % self.across, index / self.across);
                around.clear();
                for row in near(j, self.down) {
                    around.extend(near(i, self.across).map(|column| levels[row * self.across + column]));
                }
                quantile(&mut around, 0.5)
            })
            .collect()
    }

    /// Levels averaged over 3×3 tiles by weight; tiles that are all feature take their surroundings.
    fn filled(&self, levels: &[f32], weights: &[f32], fallback: &[f32]) -> Vec<f32> {
        (0..levels.len())
            .map(|index| {
                if weights[index] >= 0.25 {
                    return levels[index];
                }
                let (i, j) = (index % self.across, index / self.across);
                let (mut sum, mut weight) = (0.0, 0.0);
                for row in j.saturating_sub(1)..(j + 2).min(self.down) {
                    for column in i.saturating_sub(1)..(i + 2).min(self.across) {
                        let other = row * self.across + column;
                        sum += weights[other] * levels[other];
                        weight += weights[other];
                    }
                }
                if weight > 0.0 { sum / weight } else { fallback[index] }
            })
            .collect()
    }
}

/// The polarity whose tail about the local ground is the longer.
fn longer_tail(samples: &[Vec<f32>], ground: &[f32]) -> Polarity {
    let mut residuals: Vec<f32> =
        samples.iter().zip(ground).flat_map(|(tile, level)| tile.iter().map(move |code| code - level)).collect();
    let (low, high) = (quantile(&mut residuals, 0.005), quantile(&mut residuals, 0.995));
    if -low > high { Polarity::Dark } else { Polarity::Bright }
}

/// Standard deviation of the ground from the side that features do not reach: 1.4826 × the median deviation.
fn ground_scatter(samples: &[Vec<f32>], ground: &[f32], polarity: Polarity) -> f32 {
    let mut deviations: Vec<f32> = samples
        .iter()
        .zip(ground)
        .flat_map(|(tile, level)| tile.iter().map(move |code| away(*code, *level, polarity)))
        .filter(|deviation| *deviation <= 0.0)
        .map(f32::abs)
        .collect();
    if deviations.is_empty() { 0.0 } else { 1.4826 * quantile(&mut deviations, 0.5) }
}

/// Noise of one pixel from second differences along rows, which a slope does not reach: 1.4826 × their median size,
/// over √6.
fn pixel_noise(plane: &PlaneView<'_>) -> f64 {
    let mut differences = Vec::new();
    for row in (0..plane.rows).step_by(STRIDE) {
        let codes: Vec<f32> = plane.row(row).map(f32::from).collect();
        differences.extend(codes.windows(3).step_by(STRIDE).map(|c| (c[0] - 2.0 * c[1] + c[2]).abs()));
    }
    1.4826 * f64::from(quantile(&mut differences, 0.5)) / 6.0_f64.sqrt()
}

/// Mean of the codes of each tile that are no feature, and their share of the tile.
fn ground_means(samples: &[Vec<f32>], ground: &[f32], limit: f32, polarity: Polarity) -> (Vec<f32>, Vec<f32>) {
    samples
        .iter()
        .zip(ground)
        .map(|(tile, level)| {
            let (mut sum, mut count) = (0.0_f32, 0.0_f32);
            for code in tile {
                let kept = f32::from(u8::from(away(*code, *level, polarity).abs() <= limit));
                sum += kept * code;
                count += kept;
            }
            if count > 0.0 { (sum / count, count / tile.len() as f32) } else { (*level, 0.0) }
        })
        .unzip()
}

/// How far a code lies from the ground on the side of the features.
fn away(code: f32, level: f32, polarity: Polarity) -> f32 {
    match polarity {
        Polarity::Bright => code - level,
        Polarity::Dark => level - code,
    }
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
        let background = Background::estimate(&frame.plane(Mosaic::Mono, "0").expect("page 0"), None);
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
