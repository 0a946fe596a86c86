//! How far every pixel may be off because its rays are finite in number.

use twinpupil_instrument::{Instrument, ResponseMatrix};

use crate::sampling::SETS;
use crate::scene::Scene;
use crate::simulate::{SimulateError, expectation};

/// How often a scene is rendered to tell standard errors, which they are then known to within a quarter.
pub const REPLICATES: usize = 8;

const _: () = assert!(REPLICATES <= SETS, "every rendering has rays of its own");

/// Standard errors of what [`expected_electrons`](crate::expected_electrons) has with the same number of rays: the pages of
/// the frame, each row by row, in electrons.
///
/// They are the standard deviations over [`REPLICATES`] renderings, in which every pixel has other rays each time: florets
/// that are turned and Sobol' points that are scrambled anew. The spread of means of such points tells their error, which the
/// spread of single rays overrates.  A. B. Owen, "Monte Carlo variance of scrambled net quadrature", SIAM Journal on Numerical
/// Analysis 34, 1884 (1997). They are 0 where all rays bring back the same.
///
/// `progress` is told the share that is done, 0 to 1, from several threads at once.
pub fn standard_errors(
    instrument: &Instrument,
    scene: &Scene,
    response: &ResponseMatrix,
    pupil_samples: usize,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Vec<Vec<f64>>, SimulateError> {
    let mut spreads: Vec<Vec<Spread>> = Vec::new();
    for turn in 0..REPLICATES {
        let of_turn = |share: f64| progress((turn as f64 + share) / REPLICATES as f64);
        let pages = expectation(instrument, scene, response, pupil_samples, turn, &of_turn)?.pages;
        spreads.resize_with(pages.len(), Vec::new);
        for (spreads, page) in spreads.iter_mut().zip(pages) {
            spreads.resize(page.len(), Spread::default());
            spreads.iter_mut().zip(page).for_each(|(spread, electrons)| spread.add(electrons, turn));
        }
    }
    Ok(spreads.into_iter().map(|page| page.into_iter().map(Spread::deviation).collect()).collect())
}

/// Mean and sum of squared differences from it, value by value  [Welford 1962].
#[derive(Debug, Clone, Copy, Default)]
struct Spread {
    mean: f64,
    squares: f64,
}

impl Spread {
    /// One value more after `before` others.
    fn add(&mut self, value: f64, before: usize) {
        let difference = value - self.mean;
        self.mean += difference / (before + 1) as f64;
        self.squares += difference * (value - self.mean);
    }

    fn deviation(self) -> f64 {
        (self.squares / (REPLICATES - 1) as f64).sqrt()
    }
}
