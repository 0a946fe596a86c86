//! Outlines: the pixels of each basin of a relief above half its height, and their division where discs touch.

use crate::background::quantile;
use crate::flood::{Basins, FloodRule, NONE, flood};
use crate::relief::Relief;

/// A blob of the relief: the pixels of one basin above half its height, or one disc of several that touch there.
#[derive(Debug, Clone)]
pub(crate) struct Outline {
    /// Indices of its pixels in the relief, rising.
    pub(crate) pixels: Vec<u32>,
    /// Mean column and row in the relief.
    pub(crate) centre: [f64; 2],
    /// Typical contrast at the top, codes.
    pub(crate) height: f32,
    /// Width of the faint skirt about it, pixels of the relief.
    pub(crate) skirt: f64,
    /// Whether a pixel lies on the edge of the relief.
    pub(crate) touches_edge: bool,
}

/// A neck narrower than this share of the thinner disc divides two discs that touch.
const NECK: f32 = 0.85;

/// Top pixels give the height, as this quantile of a basin's pixels above half its maximum.
const TOP: f64 = 0.75;

/// The outlines of all basins. Skirts are followed down to `skirt`, codes.
pub(crate) fn outlines(relief: &Relief, basins: &Basins, skirt: f32) -> Vec<Outline> {
    let (starts, pixels) = grouped(basins);
    let mut divider = Divider::default();
    let mut outlines = Vec::with_capacity(basins.count);
    for basin in starts.windows(2) {
        let pixels = &pixels[basin[0] as usize..basin[1] as usize];
        let height = top(relief, pixels);
        let core: Vec<u32> =
            pixels.iter().copied().filter(|&index| relief.heights[index as usize] >= 0.5 * height).collect();
        let whole = Outline::new(relief, core, height);
        if whole.is_elliptic(relief.columns as u32) {
            outlines.push(whole);
        } else {
            let parts = divider.discs(&whole.pixels, relief.columns);
            outlines.extend(parts.into_iter().map(|part| Outline::new(relief, part, height)));
        }
    }
    for outline in &mut outlines {
        outline.skirt = skirt_width(relief, outline.centre, outline.height, skirt);
    }
    outlines
}

impl Outline {
    fn new(relief: &Relief, pixels: Vec<u32>, height: f32) -> Self {
        let (columns, rows) = (relief.columns as u32, relief.rows as u32);
        let (mut sum, mut touches_edge) = ([0.0; 2], false);
        for (column, row) in places(&pixels, columns) {
            sum[0] += f64::from(column);
            sum[1] += f64::from(row);
            touches_edge |= column == 0 || row == 0 || column + 1 == columns || row + 1 == rows;
        }
        let count = pixels.len() as f64;
        Self { centre: sum.map(|s| s / count), pixels, height, skirt: 0.0, touches_edge }
    }

    /// Distance from the centre to its farthest pixel, pixels of the relief.
    pub(crate) fn extent(&self, columns: usize) -> f64 {
        let distance2 = |(column, row): (u32, u32)| {
            (f64::from(column) - self.centre[0]).powi(2) + (f64::from(row) - self.centre[1]).powi(2)
        };
        places(&self.pixels, columns as u32).map(distance2).fold(0.0, f64::max).sqrt()
    }

    /// Whether the outline fills the ellipse of its second moments, `area = 4π √det(covariance)`: two discs that touch
    /// fill 89 % of theirs, two that overlap by a third of their diameter 98.6 %.
    fn is_elliptic(&self, columns: u32) -> bool {
        const FILLED: f64 = 0.99;
        // Moments of whole pixels, each with its own spread of 1/12.
        let mut covariance = [0.0; 3];
        for (column, row) in places(&self.pixels, columns) {
            let (dc, dr) = (f64::from(column) - self.centre[0], f64::from(row) - self.centre[1]);
            covariance[0] += dc * dc + 1.0 / 12.0;
            covariance[1] += dc * dr;
            covariance[2] += dr * dr + 1.0 / 12.0;
        }
        let count = self.pixels.len() as f64;
        let [cc, cr, rr] = covariance.map(|sum| sum / count);
        count >= FILLED * 4.0 * std::f64::consts::PI * (cc * rr - cr * cr).max(0.0).sqrt()
    }
}

/// Rays along which a feature is followed outwards, and the step along them, pixels of the relief.
const RAYS: usize = 16;
const STRIDE: f64 = 0.5;

/// Which of the rays' skirts counts, from the narrowest to the widest.
const SKIRT_RANK: f64 = 0.8;

/// How wide the skirt of a feature is: along each ray, from where its light falls below half its height to where it
/// ends in the ground. A ray that climbs a neighbour before it gets there ends where it turns.
fn skirt_width(relief: &Relief, centre: [f64; 2], height: f32, ground: f32) -> f64 {
    let mut widths = [0.0_f32; RAYS];
    for (ray, width) in widths.iter_mut().enumerate() {
        let (sin, cos) = (std::f64::consts::TAU * ray as f64 / RAYS as f64).sin_cos();
        let (mut edge, mut lowest) = (None, f32::INFINITY);
        let mut distance = 0.0;
        while let Some(value) = relief.near(centre[0] + distance * cos, centre[1] + distance * sin) {
            if value < 0.5 * height {
                let edge = *edge.get_or_insert(distance);
                if value < lowest {
                    (lowest, *width) = (value, (distance - edge) as f32);
                }
            }
            let turned = edge.is_some() && value > 2.0 * lowest + ground;
            if value <= ground || turned {
                break;
            }
            distance += STRIDE;
        }
    }
    f64::from(quantile(&mut widths, SKIRT_RANK))
}

/// Columns and rows of pixels with rising indices, without a division for each.
fn places(pixels: &[u32], columns: u32) -> impl Iterator<Item = (u32, u32)> {
    let mut row = pixels.first().map_or(0, |first| first / columns);
    pixels.iter().map(move |&index| {
        while index >= (row + 1) * columns {
            row += 1;
        }
        (index - row * columns, row)
    })
}

/// Pixels in the order of their basins: basin `b` has those from `starts[b]` to `starts[b + 1]`.
fn grouped(basins: &Basins) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0_u32; basins.count + 1];
    for &label in basins.labels.iter().filter(|label| **label != NONE) {
        starts[label as usize + 1] += 1;
    }
    for basin in 0..basins.count {
        starts[basin + 1] += starts[basin];
    }
    let mut next = starts.clone();
    let mut pixels = vec![0; starts[basins.count] as usize];
    for (index, &label) in (0_u32..).zip(&basins.labels) {
        if label != NONE {
            let place = &mut next[label as usize];
            pixels[*place as usize] = index;
            *place += 1;
        }
    }
    (starts, pixels)
}

/// Typical contrast at the top of a basin: robust against a single bright pixel.
fn top(relief: &Relief, pixels: &[u32]) -> f32 {
    let value = |index: &u32| relief.heights[*index as usize];
    let highest = pixels.iter().map(value).fold(0.0, f32::max);
    let mut upper: Vec<f32> = pixels.iter().map(value).filter(|value| *value >= 0.5 * highest).collect();
    quantile(&mut upper, TOP)
}

/// Divides blobs of discs that touch where they are thinnest; its buffers are reused from blob to blob.
#[derive(Debug, Default)]
struct Divider {
    depth: Vec<f32>,
}

impl Divider {
    /// The discs in a blob: basins of the distance to its edge, with necks as saddles.
    fn discs(&mut self, core: &[u32], plane_columns: usize) -> Vec<Vec<u32>> {
        let plane_columns = plane_columns as u32;
        let span = |coordinate: fn(u32, u32) -> u32| {
            let range = core.iter().map(|&index| coordinate(index, plane_columns));
            range.clone().min().zip(range.max())
        };
        let (Some((left, right)), Some((upper, lower))) = (span(|i, n| i % n), span(|i, n| i / n)) else {
            return Vec::new();
        };
        // A margin of one pixel on every side lies outside the blob.
        let (columns, rows) = ((right - left + 3) as usize, (lower - upper + 3) as usize);
        let place = |index: u32| {
            let (column, row) = (index % plane_columns - left, index / plane_columns - upper);
            (row as usize + 1) * columns + column as usize + 1
        };
        self.depth.clear();
        self.depth.resize(columns * rows, 0.0);
        for &index in core {
            self.depth[place(index)] = f32::INFINITY;
        }
        distance_to_edge(&mut self.depth, columns);
        let rule = FloodRule { floor: 0.0, saddle: NECK, pixels_min: 4 };
        let basins = flood(&self.depth, columns, rule);
        let mut discs = vec![Vec::new(); basins.count];
        for &index in core {
            discs[basins.labels[place(index)] as usize].push(index);
        }
        discs
    }
}

/// Replaces infinities by their distance to the nearest zero, by the 3–4 chamfer: within 6 % of Euclid's.
fn distance_to_edge(depth: &mut [f32], columns: usize) {
    const STRAIGHT: f32 = 1.0;
    const DIAGONAL: f32 = 4.0 / 3.0;
    let rows = depth.len() / columns;
    for row in 1..rows - 1 {
        for column in 1..columns - 1 {
            let index = row * columns + column;
            let above = index - columns;
            let nearest = (depth[index - 1] + STRAIGHT)
                .min(depth[above] + STRAIGHT)
                .min(depth[above - 1] + DIAGONAL)
                .min(depth[above + 1] + DIAGONAL);
            depth[index] = depth[index].min(nearest);
        }
    }
    for row in (1..rows - 1).rev() {
        for column in (1..columns - 1).rev() {
            let index = row * columns + column;
            let below = index + columns;
            let nearest = (depth[index + 1] + STRAIGHT)
                .min(depth[below] + STRAIGHT)
                .min(depth[below - 1] + DIAGONAL)
                .min(depth[below + 1] + DIAGONAL);
            depth[index] = depth[index].min(nearest);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels of a 100-column plane inside any of the discs (column, row, radius).
    fn blob(discs: &[(f64, f64, f64)]) -> Vec<u32> {
        (0..100 * 60)
            .filter(|index| {
                let (column, row) = (f64::from(index % 100), f64::from(index / 100));
                discs.iter().any(|(c, r, radius)| (column - c).hypot(row - r) <= *radius)
            })
            .collect()
    }

    fn count(discs: &[(f64, f64, f64)]) -> usize {
        Divider::default().discs(&blob(discs), 100).len()
    }

    #[test]
    fn one_disc_is_one() {
        for radius in [2.0, 3.5, 8.2, 20.0] {
            assert_eq!(count(&[(40.3, 30.6, radius)]), 1, "{radius}");
        }
    }

    #[test]
    fn touching_and_overlapping_discs_are_told_apart() {
        for distance in [19.0, 17.0, 15.0, 13.5] {
            assert_eq!(count(&[(30.0, 30.0, 10.0), (30.0 + distance, 30.0, 10.0)]), 2, "{distance}");
            let diagonal = distance / 2.0_f64.sqrt();
            assert_eq!(count(&[(30.2, 20.0, 10.0), (30.2 + diagonal, 20.0 + diagonal, 10.0)]), 2, "{distance}");
        }
        assert_eq!(count(&[(20.0, 30.0, 10.0), (38.0, 30.0, 10.0), (29.0, 45.5, 10.0)]), 3);
    }

    #[test]
    fn an_ellipse_is_one() {
        let ellipse: Vec<u32> = (0..100 * 60)
            .filter(|index| {
                let (u, v) = (f64::from(index % 100) - 50.0, f64::from(index / 100) - 30.0);
                (u / 22.0).powi(2) + (v / 11.0).powi(2) <= 1.0
            })
            .collect();
        assert_eq!(Divider::default().discs(&ellipse, 100).len(), 1);
    }
}
