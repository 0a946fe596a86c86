//! Rows and columns among the features of one band.

use std::collections::{HashMap, VecDeque};

/// A feature as it lies in its band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Spot {
    pub(crate) centre_px: [f64; 2],
    pub(crate) area_px: f64,
}

/// Features that lie in rows and columns.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Lattice {
    /// The index of the feature at every step along the first and the second direction.
    pub(crate) at: HashMap<[i32; 2], usize>,
    /// The mean steps, px.
    pub(crate) steps_px: [[f64; 2]; 2],
}

/// A feature stands where it is expected if it is no farther away than this share of a step.
const STRAY_SHARE: f64 = 0.25;

/// How much each step that is found tells of the next.
const LEARNING: f64 = 0.5;

/// Features at which lattices are begun, at most.
const SEEDS: usize = 12;

/// A lattice with this share of the features has all rows and columns: begun along a diagonal it has every second dot.
const ENOUGH_SHARE: f64 = 0.75;

impl Lattice {
    /// The largest lattice among some of the features.
    pub(crate) fn largest(spots: &[Spot], among: &[usize]) -> Option<Self> {
        let mut seeds: Vec<usize> = among.to_vec();
        let middle = [0, 1].map(|k| median(among.iter().map(|index| spots[*index].centre_px[k])));
        seeds.sort_by(|a, b| away_px(spots[*a].centre_px, middle).total_cmp(&away_px(spots[*b].centre_px, middle)));
        let mut largest: Option<Self> = None;
        for seed in seeds.into_iter().take(SEEDS) {
            let Some(steps_px) = first_steps(spots, among, seed) else { continue };
            let grown = Self::grown(spots, among, seed, steps_px);
            if largest.as_ref().is_none_or(|largest| largest.at.len() < grown.at.len()) {
                largest = Some(grown);
            }
            if largest.as_ref().is_some_and(|largest| largest.at.len() as f64 > ENOUGH_SHARE * among.len() as f64) {
                break;
            }
        }
        largest.map(|largest| largest.reduced().right_handed())
    }

    /// From one feature to its neighbours, and on to theirs.
    fn grown(spots: &[Spot], among: &[usize], seed: usize, steps_px: [[f64; 2]; 2]) -> Self {
        const WAYS: [(usize, i32); 4] = [(0, 1), (0, -1), (1, 1), (1, -1)];
        let mut lattice = Self { at: HashMap::from([([0, 0], seed)]), steps_px };
        let mut labelled: HashMap<usize, [i32; 2]> = HashMap::from([(seed, [0, 0])]);
        let mut queue = VecDeque::from([(seed, [0, 0], steps_px)]);
        while let Some((index, place, steps_px)) = queue.pop_front() {
            for (direction, sign) in WAYS {
                let mut next = place;
                next[direction] += sign;
                if lattice.at.contains_key(&next) {
                    continue;
                }
                let step_px = steps_px[direction].map(|component| component * f64::from(sign));
                let start_px = spots[index].centre_px;
                let expected_px = [start_px[0] + step_px[0], start_px[1] + step_px[1]];
                let reach_px = STRAY_SHARE * step_px[0].hypot(step_px[1]);
                let Some(found) = nearest(spots, among, expected_px, reach_px) else { continue };
                if labelled.contains_key(&found) {
                    continue;
                }
                lattice.at.insert(next, found);
                labelled.insert(found, next);
                let mut learnt = steps_px;
                for k in 0..2 {
                    let seen = f64::from(sign) * (spots[found].centre_px[k] - start_px[k]);
                    learnt[direction][k] += LEARNING * (seen - learnt[direction][k]);
                }
                queue.push_back((found, next, learnt));
            }
        }
        lattice.steps_px = lattice.mean_steps(spots).unwrap_or(steps_px);
        lattice
    }

    /// Steps by least squares over all places.
    fn mean_steps(&self, spots: &[Spot]) -> Option<[[f64; 2]; 2]> {
        let (mut information, mut scores) = (nalgebra::Matrix3::zeros(), [nalgebra::Vector3::zeros(); 2]);
        for ([i, j], index) in &self.at {
            let row = nalgebra::Vector3::new(1.0, f64::from(*i), f64::from(*j));
            information += row * row.transpose();
            scores.iter_mut().zip(spots[*index].centre_px).for_each(|(score, seen)| *score += seen * row);
        }
        let factor = information.cholesky()?;
        let [u, v] = scores.map(|score| factor.solve(&score));
        Some([[u.y, v.y], [u.z, v.z]])
    }

    /// How far the typical feature stands beside the middle of its two neighbours along a row or column, over the step: next
    /// to nothing in perspective, but much among features that only happen to stand where others are expected.
    pub(crate) fn unevenness(&self, spots: &[Spot]) -> f64 {
        let step_px = self.step_px();
        let beside = |[i, j]: [i32; 2], [di, dj]: [i32; 2]| {
            let place_px = |k: i32| self.at.get(&[i + k * di, j + k * dj]).map(|index| spots[*index].centre_px);
            let ([before, own], after) = ([place_px(-1)?, place_px(0)?], place_px(1)?);
            Some(away_px([0, 1].map(|k| 0.5 * (before[k] + after[k])), own) / step_px)
        };
        let ways = |place: &[i32; 2]| [[1, 0], [0, 1]].map(|way| beside(*place, way));
        median(self.at.keys().flat_map(ways).flatten())
    }

    /// With the shortest steps that lead to the same places, by Lagrange's reduction: where a feature has lost its
    /// neighbours along a column, steps that begin there lead askew.
    fn reduced(self) -> Self {
        // A little above a half, so that rounding never turns a step back.
        const SKEW_MAX: f64 = 0.51;
        let [first, second] = self.steps_px.map(|[u, v]| u.hypot(v));
        let lattice = if first <= second { self } else { self.transposed() };
        let [[a, b], [c, d]] = lattice.steps_px;
        let skew = (a * c + b * d) / (a * a + b * b);
        if skew.abs() > SKEW_MAX { lattice.sheared(skew.round()).reduced() } else { lattice }
    }

    /// With the second step less so many of the first.
    fn sheared(self, times: f64) -> Self {
        let [first, second] = self.steps_px;
        let second = [0, 1].map(|k| second[k] - times * first[k]);
        let at = self.at.into_iter().map(|([i, j], index)| ([i + times as i32 * j, j], index)).collect();
        Self { at, steps_px: [first, second] }
    }

    /// With the second direction a quarter turn from the first, the way v lies from u.
    fn right_handed(self) -> Self {
        let [[a, b], [c, d]] = self.steps_px;
        if a * d - b * c >= 0.0 { self } else { self.transposed() }
    }

    fn transposed(self) -> Self {
        let [first, second] = self.steps_px;
        Self { at: self.at.into_iter().map(|([i, j], index)| ([j, i], index)).collect(), steps_px: [second, first] }
    }

    /// Least and largest place along both directions.
    pub(crate) fn extent(&self) -> [[i32; 2]; 2] {
        [0, 1].map(|k| {
            let along = || self.at.keys().map(|place| place[k]);
            [along().min().unwrap_or(0), along().max().unwrap_or(0)]
        })
    }

    /// Length of a step, px.
    pub(crate) fn step_px(&self) -> f64 {
        let [first, second] = self.steps_px.map(|[u, v]| u.hypot(v));
        (first * second).sqrt()
    }
}

/// Steps from a feature to its nearest neighbour, and to the nearest that lies well beside that direction.
fn first_steps(spots: &[Spot], among: &[usize], seed: usize) -> Option<[[f64; 2]; 2]> {
    const BESIDE_COS_MAX: f64 = 0.7;
    let start_px = spots[seed].centre_px;
    let step = |index: &usize| {
        let [u, v] = spots[*index].centre_px;
        [u - start_px[0], v - start_px[1]]
    };
    let shortest =
        |steps: &mut dyn Iterator<Item = [f64; 2]>| steps.min_by(|a, b| a[0].hypot(a[1]).total_cmp(&b[0].hypot(b[1])));
    let others = || among.iter().filter(|index| **index != seed).map(step);
    let first = shortest(&mut others())?;
    let is_beside = |other: &[f64; 2]| {
        let cos = (first[0] * other[0] + first[1] * other[1]) / first[0].hypot(first[1]) / other[0].hypot(other[1]);
        cos.abs() < BESIDE_COS_MAX
    };
    let second = shortest(&mut others().filter(is_beside))?;
    Some([first, second])
}

fn nearest(spots: &[Spot], among: &[usize], place_px: [f64; 2], reach_px: f64) -> Option<usize> {
    let away = |index: &usize| away_px(spots[*index].centre_px, place_px);
    let nearest = among.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b)))?;
    (away(&nearest) < reach_px).then_some(nearest)
}

fn away_px(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The middle of some values; 0 of none.
pub(crate) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid turned and seen in perspective, without the dots that `is_there` leaves out.
    fn grid(columns: i32, rows: i32, turn_rad: f64, is_there: impl Fn(i32, i32) -> bool) -> Vec<Spot> {
        let places = (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j)));
        let (sin, cos) = turn_rad.sin_cos();
        places
            .filter(|(i, j)| is_there(*i, *j))
            .map(|(i, j)| {
                let (x, y) = (100.0 * f64::from(i), 70.0 * f64::from(j));
                let (x, y) = (cos * x - sin * y, sin * x + cos * y);
                let w = 1.0 + 2e-4 * x;
                Spot { centre_px: [500.0 + x / w, 400.0 + y / w], area_px: 500.0 }
            })
            .collect()
    }

    #[test]
    fn a_grid_is_found_whole_however_it_is_turned() {
        for turn_rad in [0.0, 0.4, 1.2, 2.9, -1.0] {
            let spots = grid(9, 7, turn_rad, |i, j| (i, j) != (2, 3));
            let all: Vec<usize> = (0..spots.len()).collect();
            let lattice = Lattice::largest(&spots, &all).unwrap();
            assert_eq!(lattice.at.len(), 62);
            let mut sides = lattice.extent().map(|[low, high]| high - low + 1);
            sides.sort_unstable();
            assert_eq!(sides, [7, 9]);
            let [[a, b], [c, d]] = lattice.steps_px;
            assert!(a * d - b * c > 0.0);
        }
    }

    #[test]
    fn what_lies_elsewhere_is_no_part_of_it() {
        let mut spots = grid(5, 4, 0.2, |_, _| true);
        spots.push(Spot { centre_px: [540.0, 455.0], area_px: 300.0 });
        let all: Vec<usize> = (0..spots.len()).collect();
        let lattice = Lattice::largest(&spots, &all).unwrap();
        assert_eq!(lattice.at.len(), 20);
        assert!(lattice.at.values().all(|index| *index < 20));
    }

    #[test]
    fn only_features_in_rows_and_columns_are_even() {
        let uneven = |spots: &[Spot]| {
            let all: Vec<usize> = (0..spots.len()).collect();
            Lattice::largest(spots, &all).unwrap().unevenness(spots)
        };
        let even = uneven(&grid(9, 7, 0.3, |_, _| true));
        assert!(even < 0.03, "{even}");
        // Moved by some 7 % of a step, each its own way.
        let mut strayed = grid(9, 7, 0.3, |_, _| true);
        for (k, spot) in strayed.iter_mut().enumerate() {
            let (sin, cos) = (2.4 * k as f64).sin_cos();
            spot.centre_px = [spot.centre_px[0] + 6.0 * cos, spot.centre_px[1] + 6.0 * sin];
        }
        let strayed = uneven(&strayed);
        assert!(strayed > 0.06, "{strayed}");
    }

    #[test]
    fn a_spot_that_has_swallowed_its_neighbours_leads_to_no_diagonals() {
        let (column, row) = (4, 3);
        let mut spots = grid(9, 7, 0.1, |i, j| (i - column).abs() + (j - row).abs() > 1);
        let [left, right] = [(3, 2), (5, 4)].map(|at| grid(9, 7, 0.1, |i, j| (i, j) == at)[0].centre_px);
        spots.push(Spot { centre_px: [0, 1].map(|k| 0.5 * (left[k] + right[k])), area_px: 6500.0 });
        let all: Vec<usize> = (0..spots.len()).collect();
        assert_eq!(Lattice::largest(&spots, &all).unwrap().at.len(), 58);
    }

    #[test]
    fn a_line_or_a_pair_is_no_lattice() {
        assert_eq!(Lattice::largest(&grid(6, 1, 0.1, |_, _| true), &[0, 1, 2, 3, 4, 5]), None);
        assert_eq!(Lattice::largest(&[], &[]), None);
    }
}
