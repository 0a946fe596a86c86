//! A smooth surface of light over a plane: bilinear between nodes, and no rougher than the samples demand.

use twinpupil_instrument::PlaneView;

use crate::background::quantile;

/// A pixel of the plane and its code.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) column: u32,
    pub(crate) row: u32,
    pub(crate) code: f32,
}

/// Distance from node to node, pixels of the plane, about.
const SPACING: usize = 64;

/// Weight of a node's curvature against all the samples that a node has about it: where there is ground the surface
/// follows the ground, and across features it runs straight on.
const STIFFNESS: f64 = 0.4;

/// Levels on a lattice of nodes that spans the plane.
#[derive(Debug, Clone)]
pub(crate) struct Surface {
    across: usize,
    down: usize,
    width: f32,
    height: f32,
    levels: Vec<f32>,
}

impl Surface {
    /// A flat surface over a plane.
    pub(crate) fn covering(plane: &PlaneView<'_>) -> Self {
        let nodes = |pixels: usize| pixels.div_ceil(SPACING) + 1;
        let (across, down) = (nodes(plane.columns), nodes(plane.rows));
        let (width, height) = (plane.columns as f32 / (across - 1) as f32, plane.rows as f32 / (down - 1) as f32);
        Self { across, down, width, height, levels: vec![0.0; across * down] }
    }

    /// Mean over the nodes, codes.
    pub(crate) fn mean(&self) -> f64 {
        self.levels.iter().map(|&level| f64::from(level)).sum::<f64>() / self.levels.len() as f64
    }

    /// Level at a sample.
    pub(crate) fn at(&self, sample: &Sample) -> f32 {
        self.support(sample).iter().map(|&(node, weight)| weight * self.levels[node]).sum()
    }

    /// Levels of every pixel of a row of the plane.
    pub(crate) fn fill_row(&self, row: usize, levels: &mut [f32]) {
        let (j, fj) = cell(row as f32, self.height, self.down);
        let line: Vec<f32> = (0..self.across)
            .map(|i| {
                let (upper, lower) = (self.levels[j * self.across + i], self.levels[(j + 1) * self.across + i]);
                upper + fj * (lower - upper)
            })
            .collect();
        let mut start = 0;
        for (i, ends) in line.windows(2).enumerate() {
            let end = (((i + 1) as f32 * self.width - 0.5).ceil() as usize).min(levels.len());
            let slope = (ends[1] - ends[0]) / self.width;
            let first = ends[0] + slope * (start as f32 + 0.5 - i as f32 * self.width);
            for (k, level) in levels[start..end].iter_mut().enumerate() {
                *level = first + slope * k as f32;
            }
            start = end;
        }
    }

    /// Sets every node to a quantile of the samples about it, then to the same quantile's half-way mark of its 5×5
    /// neighbours, so that a node under a large feature takes its surroundings' level.
    pub(crate) fn set_to_quantiles(&mut self, samples: &[Sample], share: f64) {
        let mut near = vec![Vec::new(); self.levels.len()];
        for sample in samples {
            let (i, fi) = cell(sample.column as f32, self.width, self.across);
            let (j, fj) = cell(sample.row as f32, self.height, self.down);
            near[(j + usize::from(fj > 0.5)) * self.across + i + usize::from(fi > 0.5)].push(sample.code);
        }
        let own: Vec<Option<f32>> =
            near.iter_mut().map(|codes| (!codes.is_empty()).then(|| quantile(codes, share))).collect();
        self.levels = (0..own.len())
            .map(|node| {
                let mut around: Vec<f32> = self.around(node).filter_map(|other| own[other]).collect();
                quantile(&mut around, 0.5 * (share + 0.5))
            })
            .collect();
    }

    /// The nodes of the 5×5 block about one.
    fn around(&self, node: usize) -> impl Iterator<Item = usize> + use<> {
        let (i, j, across) = (node % self.across, node / self.across, self.across);
        let block = |centre: usize, count: usize| centre.saturating_sub(2)..(centre + 3).min(count);
        let columns = block(i, across);
        block(j, self.down).flat_map(move |row| columns.clone().map(move |column| row * across + column))
    }

    /// Fits the surface to samples, of which an unmasked plane would have `everywhere`: least squares with a penalty on
    /// curvature, by conjugate gradients from where the surface is.
    ///
    /// ```text
    /// Σ (code − surface)² + stiffness · Σ (second differences along rows and columns)²  →  min
    /// ```
    pub(crate) fn fit(&mut self, samples: &[Sample], everywhere: usize) {
        const STEPS: usize = 60;
        const RESTING: f64 = 1e-10;
        let stiffness = STIFFNESS * everywhere as f64 / self.levels.len() as f64;
        let normal = Normal::new(self, samples, stiffness);
        let mut x: Vec<f64> = self.levels.iter().map(|&level| f64::from(level)).collect();
        let applied = normal.apply(&x);
        let mut residual: Vec<f64> = normal.right.iter().zip(&applied).map(|(b, a)| b - a).collect();
        let mut direction = residual.clone();
        let mut size = dot(&residual, &residual);
        let resting = RESTING * dot(&normal.right, &normal.right);
        for _ in 0..STEPS {
            if size <= resting {
                break;
            }
            let applied = normal.apply(&direction);
            let step = size / dot(&direction, &applied);
            for k in 0..x.len() {
                x[k] += step * direction[k];
                residual[k] -= step * applied[k];
            }
            let next = dot(&residual, &residual);
            for (d, r) in direction.iter_mut().zip(&residual) {
                *d = r + next / size * *d;
            }
            size = next;
        }
        if x.iter().all(|level| level.is_finite()) {
            self.levels = x.into_iter().map(|level| level as f32).collect();
        }
    }

    /// The four nodes about a sample with their weights.
    fn support(&self, sample: &Sample) -> [(usize, f32); 4] {
        let (i, fi) = cell(sample.column as f32, self.width, self.across);
        let (j, fj) = cell(sample.row as f32, self.height, self.down);
        let node = j * self.across + i;
        [
            (node, (1.0 - fi) * (1.0 - fj)),
            (node + 1, fi * (1.0 - fj)),
            (node + self.across, (1.0 - fi) * fj),
            (node + self.across + 1, fi * fj),
        ]
    }
}

/// Node before a pixel, and how far on towards the next.
fn cell(pixel: f32, spacing: f32, nodes: usize) -> (usize, f32) {
    let position = (pixel + 0.5) / spacing;
    let index = (position as usize).min(nodes - 2);
    (index, position - index as f32)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Normal equations of the fit: every node is coupled to its eight neighbours by samples, and by the penalty to nodes
/// two steps away.
struct Normal {
    across: usize,
    /// For every node its couplings to the 3×3 nodes about it, row by row.
    couplings: Vec<[f64; 9]>,
    right: Vec<f64>,
    stiffness: f64,
}

impl Normal {
    fn new(surface: &Surface, samples: &[Sample], stiffness: f64) -> Self {
        let nodes = surface.levels.len();
        let (across, right) = (surface.across, vec![0.0; nodes]);
        let mut normal = Self { across, couplings: vec![[0.0; 9]; nodes], right, stiffness };
        for sample in samples {
            let support = surface.support(sample).map(|(node, weight)| (node, f64::from(weight)));
            for (a, &(node, weight)) in support.iter().enumerate() {
                normal.right[node] += weight * f64::from(sample.code);
                for (b, &(_, other)) in support.iter().enumerate() {
                    // Corners are numbered 0 1 / 2 3, so corner b lies this many rows and columns from corner a.
                    let (rows, columns) = (1 + b / 2 - a / 2, 1 + b % 2 - a % 2);
                    normal.couplings[node][3 * rows + columns] += weight * other;
                }
            }
        }
        normal
    }

    fn apply(&self, x: &[f64]) -> Vec<f64> {
        let (across, down) = (self.across, x.len() / self.across);
        let mut out = vec![0.0; x.len()];
        for (node, couplings) in self.couplings.iter().enumerate() {
            let (i, j) = (node % across, node / across);
            for (k, &coupling) in couplings.iter().enumerate().filter(|(_, coupling)| **coupling != 0.0) {
                out[node] += coupling * x[(j + k / 3 - 1) * across + i + k % 3 - 1];
            }
        }
        let mut bend = |a: usize, b: usize, c: usize| {
            let curvature = self.stiffness * (x[a] - 2.0 * x[b] + x[c]);
            out[a] += curvature;
            out[b] -= 2.0 * curvature;
            out[c] += curvature;
        };
        for node in 0..x.len() {
            if (1..across - 1).contains(&(node % across)) {
                bend(node - 1, node, node + 1);
            }
            if (1..down - 1).contains(&(node / across)) {
                bend(node - across, node, node + across);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface() -> Surface {
        Surface { across: 5, down: 4, width: 60.0, height: 50.0, levels: vec![0.0; 20] }
    }

    fn sample(column: u32, row: u32) -> Sample {
        Sample { column, row, code: 100.0 + 0.5 * column as f32 - 0.25 * row as f32 }
    }

    #[test]
    fn a_plane_is_met_exactly_even_across_a_gap() {
        let samples: Vec<Sample> = (0..240)
            .step_by(4)
            .flat_map(|column| (0..150).step_by(4).map(move |row| sample(column, row)))
            .filter(|s| !(60..160).contains(&s.column) || s.row > 100)
            .collect();
        let mut surface = surface();
        surface.fit(&samples, 60 * 38);
        for (column, row) in [(3, 3), (110, 40), (200, 140)] {
            let expected = sample(column, row);
            assert!((surface.at(&expected) - expected.code).abs() < 0.05, "{} {expected:?}", surface.at(&expected));
        }
        let mut row = vec![0.0; 240];
        surface.fill_row(40, &mut row);
        assert!((row[110] - surface.at(&sample(110, 40))).abs() < 1e-3);
    }

    #[test]
    fn no_samples_leave_the_surface_as_it_was() {
        let mut surface = Surface { levels: vec![7.0; 20], ..surface() };
        surface.fit(&[], 2000);
        assert_eq!(surface.levels, vec![7.0; 20]);
    }
}
