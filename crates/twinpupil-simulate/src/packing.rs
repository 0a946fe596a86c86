//! Dots at random places that keep their distance.

use std::collections::HashMap;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;
use twinpupil_instrument::check::{ValueError, positive, within};

use crate::scene::LENGTH_MM_MAX;

/// Places tried for each dot before the plate counts as full.
const TRIES_PER_DOT: usize = 20_000;

/// Places tried for all dots together, so that even a hopeless plate of very many dots ends within seconds.
const TRIES_MAX: usize = 20_000_000;

/// The random dots did not fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("only {fitted} of {count} random dots fitted on the plate; ask for fewer, or for a smaller gap or diameter")]
pub struct PackingError {
    /// Dots that found a place.
    pub fitted: usize,
    /// Dots that were asked for.
    pub count: usize,
}

/// Dots whose distance r from the axis is spread evenly over the area between two radii.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RandomDots {
    /// Number of dots.
    pub count: u32,
    /// Diameter of each dot, mm.
    pub diameter_mm: f64,
    /// Smallest distance of a centre from the axis, mm.
    pub r_min_mm: f64,
    /// Largest distance of a centre from the axis, mm.
    pub r_max_mm: f64,
    /// Smallest distance on the plate from edge to edge of two dots, mm.
    pub gap_mm: f64,
}

impl RandomDots {
    pub(crate) fn check(&self) -> Result<(), ValueError> {
        positive("plate.diameter_mm", self.diameter_mm, LENGTH_MM_MAX)?;
        within("plate.r_min_mm", self.r_min_mm, 0.0, LENGTH_MM_MAX)?;
        within("plate.r_max_mm", self.r_max_mm, self.r_min_mm, LENGTH_MM_MAX)?;
        within("plate.gap_mm", self.gap_mm, 0.0, LENGTH_MM_MAX)
    }

    /// x and y of the centres in the order in which they found a place; `stretch` is the length on the plate of a
    /// unit step in x and y.
    pub(crate) fn centres_mm(&self, stretch: [f64; 2], seed: u64) -> Result<Vec<[f64; 2]>, PackingError> {
        let count = self.count as usize;
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let mut centres_mm = Vec::with_capacity(count);
        let mut placed = Neighbourhood::new(self.diameter_mm + self.gap_mm);
        let mut tries_left = TRIES_PER_DOT;
        for _ in 0..TRIES_MAX {
            if centres_mm.len() == count || tries_left == 0 {
                break;
            }
            let [x_mm, y_mm] = self.place_mm(&mut rng);
            if placed.insert([x_mm * stretch[0], y_mm * stretch[1]]) {
                centres_mm.push([x_mm, y_mm]);
                tries_left = TRIES_PER_DOT;
            } else {
                tries_left -= 1;
            }
        }
        if centres_mm.len() < count {
            return Err(PackingError { fitted: centres_mm.len(), count });
        }
        Ok(centres_mm)
    }

    /// A place with r² even between the squares of the two radii.
    fn place_mm(&self, rng: &mut Pcg64Mcg) -> [f64; 2] {
        let (inner, outer) = (self.r_min_mm.powi(2), self.r_max_mm.powi(2));
        let r_mm = (inner + (outer - inner) * rng.random::<f64>()).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * rng.random::<f64>()).sin_cos();
        [r_mm * cos, r_mm * sin]
    }
}

/// Places on a plate, none closer to another than a given distance.
struct Neighbourhood {
    distance_mm: f64,
    /// Places by square cell, whose width is that distance: whoever is too close lies in one of nine cells.
    cells: HashMap<[i64; 2], Vec<[f64; 2]>>,
}

impl Neighbourhood {
    fn new(distance_mm: f64) -> Self {
        Self { distance_mm, cells: HashMap::new() }
    }

    /// Takes the place unless somebody is too close.
    fn insert(&mut self, place_mm: [f64; 2]) -> bool {
        let [column, row] = place_mm.map(|c| (c / self.distance_mm).floor() as i64);
        let too_close = |other: &[f64; 2]| {
            (other[0] - place_mm[0]).powi(2) + (other[1] - place_mm[1]).powi(2) < self.distance_mm.powi(2)
        };
        let nearby = (-1..=1).flat_map(|i| (-1..=1).map(move |j| [column + i, row + j]));
        if nearby.filter_map(|cell| self.cells.get(&cell)).flatten().any(too_close) {
            return false;
        }
        self.cells.entry([column, row]).or_default().push(place_mm);
        true
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn sparse(count: u32) -> RandomDots {
        RandomDots { count, diameter_mm: 0.01, r_min_mm: 2.0, r_max_mm: 7.5, gap_mm: 0.0 }
    }

    #[test]
    fn radii_are_even_in_area() {
        let centres_mm = sparse(20_000).centres_mm([1.0, 1.0], 7).unwrap();
        // Half of the area between 2 and 7.5 lies within this radius.
        let middle_mm = ((4.0 + 56.25) / 2.0_f64).sqrt();
        let inside = centres_mm.iter().filter(|[x, y]| x.hypot(*y) < middle_mm).count() as f64;
        // Four standard deviations of a binomial count.
        assert!((inside - 10_000.0).abs() < 4.0 * 5000.0_f64.sqrt(), "{inside}");
    }

    #[test]
    fn a_hopeless_plate_is_refused_soon() {
        let crowd = RandomDots { diameter_mm: 1.0, ..sparse(200_000) };
        let error = crowd.centres_mm([1.0, 1.0], 1).unwrap_err();
        assert!(error.fitted > 80 && error.fitted < 200, "{error}");
    }

    proptest! {
        #[test]
        fn dots_keep_their_distance_on_the_plate(seed in 0..u64::MAX, stretch in 1.0..3.0_f64, gap_mm in 0.0..0.3_f64) {
            let dots = RandomDots { count: 60, diameter_mm: 1.0, r_min_mm: 2.0, r_max_mm: 7.5, gap_mm };
            let centres_mm = dots.centres_mm([stretch, 1.0], seed).unwrap();
            for (i, a) in centres_mm.iter().enumerate() {
                let r_mm = a[0].hypot(a[1]);
                prop_assert!((2.0 - 1e-12..=7.5 + 1e-12).contains(&r_mm));
                for b in &centres_mm[..i] {
                    prop_assert!(((a[0] - b[0]) * stretch).hypot(a[1] - b[1]) >= 1.0 + gap_mm - 1e-12);
                }
            }
        }
    }
}
