//! Pixels that do not answer to light.

use rand::RngExt;
use rand_pcg::Pcg64Dxsm;
use rayon::prelude::*;
use twinpupil_instrument::Sensor;
use twinpupil_instrument::check::{ValueError, within};

/// Pixels at random that read the same whatever falls on them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Defects {
    /// Share of the pixels that read 0.
    pub dead: f64,
    /// Share of the pixels that read the largest code.
    pub hot: f64,
    /// Which pixels these are: a seed of the sensor's own, the same for all its frames.
    pub seed: u64,
}

/// Keeps the streams of random numbers apart from those of the noise.
const STREAMS: u128 = 1 << 64;

impl Defects {
    pub(crate) fn check(&self) -> Result<(), ValueError> {
        within("share of dead pixels", self.dead, 0.0, 1.0)?;
        within("share of hot pixels", self.hot, 0.0, 1.0 - self.dead)
    }

    /// Overwrites the codes of one page, row by row.
    pub(crate) fn strike(&self, sensor: &Sensor, page: usize, codes: &mut [u16]) {
        let [width_px, height_px] = sensor.size_px;
        codes.par_chunks_mut(width_px).enumerate().for_each(|(row, codes)| {
            let mut rng = Pcg64Dxsm::new(u128::from(self.seed), STREAMS + (page * height_px + row) as u128);
            for code in codes {
                let draw: f64 = rng.random();
                if draw < self.dead {
                    *code = 0;
                } else if draw < self.dead + self.hot {
                    *code = sensor.code_max();
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;

    #[test]
    fn as_many_pixels_are_stuck_as_is_stated() {
        let sensor = Sensor { size_px: [500, 400], ..paper::instrument().into_spec().sensor };
        let struck = |seed| {
            let mut codes = vec![7; 200_000];
            Defects { dead: 0.002, hot: 0.001, seed }.strike(&sensor, 0, &mut codes);
            codes
        };
        let codes = struck(1);
        let count = |code| codes.iter().filter(|other| **other == code).count();
        // Five deviations of a binomial count.
        assert!(count(0).abs_diff(400) < 100, "{}", count(0));
        assert!(count(4095).abs_diff(200) < 71, "{}", count(4095));
        assert_eq!(codes, struck(1));
        assert_ne!(codes, struck(2));
    }

    #[test]
    fn shares_are_shares() {
        assert!(Defects { dead: 0.6, hot: 0.5, seed: 0 }.check().is_err());
        assert!(Defects { dead: -0.1, hot: 0.0, seed: 0 }.check().is_err());
        assert!(Defects { dead: 0.5, hot: 0.5, seed: 0 }.check().is_ok());
    }
}
