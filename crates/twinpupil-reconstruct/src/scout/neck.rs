//! Pieces of several discs that touch, divided where they are thinnest.

use crate::flood::{Flood, FloodRule};
use crate::scout::run::Run;

/// A neck narrower than this share of the thinner disc divides two discs that touch.
const NECK: f32 = 0.85;

/// Divides pieces; its buffers are used again from piece to piece.
#[derive(Debug, Clone, Default)]
pub(crate) struct Necks {
    depth: Vec<f32>,
    flood: Flood,
}

impl Necks {
    /// Divides the runs of a piece between its discs: basins of the distance to its edge, with necks as saddles. Returns
    /// the number of discs; `parts` are the runs and `numbers` their discs. Rows are `step` pixels apart.
    pub(crate) fn divide(&mut self, runs: &[Run], step: usize, parts: &mut Vec<Run>, numbers: &mut Vec<u32>) -> usize {
        parts.clear();
        numbers.clear();
        let bounds = |(left, right): (u32, u32), run: &Run| (left.min(run.first), right.max(run.end));
        let (left, right) = runs.iter().fold((u32::MAX, 0), bounds);
        let (Some(first), Some(last)) = (runs.first(), runs.last()) else { return 0 };
        // A margin of one pixel on every side lies outside the piece.
        let (columns, rows) = ((right - left + 2) as usize, (last.row - first.row + 1) as usize * step + 2);
        let place = |run: &Run| ((run.row - first.row) as usize * step + 1) * columns + (run.first - left + 1) as usize;
        self.depth.clear();
        self.depth.resize(columns * rows, 0.0);
        for run in runs {
            for row in 0..step {
                self.depth[place(run) + row * columns..][..run.pixels() as usize].fill(f32::INFINITY);
            }
        }
        distance_to_edge(&mut self.depth, columns);
        let count = self.flood.divide(&self.depth, columns, FloodRule { floor: 0.0, saddle: NECK, pixels_min: 4 });
        for run in runs {
            let mut start = run.first;
            for same in self.flood.labels()[place(run)..][..run.pixels() as usize].chunk_by(|a, b| a == b) {
                let end = start + same.len() as u32;
                parts.push(run.part(start, end));
                numbers.push(same[0]);
                start = end;
            }
        }
        count
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

    /// Runs of the pixels inside a shape.
    fn runs(inside: impl Fn(f64, f64) -> bool) -> Vec<Run> {
        let mut runs = Vec::new();
        for row in 0..60 {
            let line: Vec<bool> = (0..100).map(|column| inside(f64::from(column), f64::from(row))).collect();
            let mut first = 0;
            for same in line.chunk_by(|a, b| a == b) {
                let end = first + same.len() as u32;
                runs.extend(same[0].then_some(Run { row, first, end, at: 0, peak: 1.0 }));
                first = end;
            }
        }
        runs
    }

    /// Number of discs that a shape is divided into.
    fn count(inside: impl Fn(f64, f64) -> bool) -> usize {
        Necks::default().divide(&runs(inside), 1, &mut Vec::new(), &mut Vec::new())
    }

    fn discs(discs: &[(f64, f64, f64)]) -> usize {
        count(|u, v| discs.iter().any(|(c, r, radius)| (u - c).hypot(v - r) <= *radius))
    }

    #[test]
    fn one_disc_is_one() {
        for radius in [2.0, 3.5, 8.2, 20.0] {
            assert_eq!(discs(&[(40.3, 30.6, radius)]), 1, "{radius}");
        }
    }

    #[test]
    fn touching_and_overlapping_discs_are_told_apart() {
        for distance in [19.0, 17.0, 15.0, 13.5] {
            assert_eq!(discs(&[(30.0, 30.0, 10.0), (30.0 + distance, 30.0, 10.0)]), 2, "{distance}");
            let diagonal = distance / 2.0_f64.sqrt();
            assert_eq!(discs(&[(30.2, 20.0, 10.0), (30.2 + diagonal, 20.0 + diagonal, 10.0)]), 2, "{distance}");
        }
    }

    #[test]
    fn an_ellipse_is_one() {
        assert_eq!(count(|u, v| ((u - 50.0) / 22.0).hypot((v - 30.0) / 11.0) <= 1.0), 1);
    }

    #[test]
    fn no_pixel_is_lost() {
        let runs = runs(|u, v| (u - 30.0).hypot(v - 30.0) <= 12.0 || (u - 50.0).hypot(v - 33.0) <= 12.0);
        let (mut parts, mut numbers) = (Vec::new(), Vec::new());
        let count = Necks::default().divide(&runs, 1, &mut parts, &mut numbers);
        assert!(count == 2 && numbers.iter().all(|number| (*number as usize) < count));
        assert_eq!(parts.iter().map(Run::pixels).sum::<u32>(), runs.iter().map(Run::pixels).sum::<u32>());
        for (disc, centre) in [[30.0, 30.0], [50.0, 33.0]].into_iter().enumerate() {
            let own = parts.iter().zip(&numbers).filter(|(_, number)| **number as usize == disc);
            let (mut pixels, mut sums) = (0.0, [0.0; 2]);
            for (run, _) in own {
                let count = f64::from(run.pixels());
                pixels += count;
                sums[0] += count * 0.5 * f64::from(run.first + run.end - 1);
                sums[1] += count * f64::from(run.row);
            }
            let [c, r] = sums.map(|sum| sum / pixels);
            assert!((c - centre[0]).hypot(r - centre[1]) < 1.0, "{c} {r} {centre:?}");
        }
    }
}
