//! A tolerance run: what every one of its rows is, so that any of them can be computed anywhere.

use anyhow::Result;
use rand_distr::{Distribution as _, StandardNormal, Uniform};
use rand_pcg::Pcg64Dxsm;
use serde::{Deserialize, Serialize};
use twinpupil_instrument::Instrument;

use super::tolerances::{Distribution, Tolerances};
use super::trial::{Reading, Trial};
use crate::reason::one_line;

/// What makes a run the same run, in plain text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunSpec {
    /// The instrument, as its file has it, lens and all.
    pub instrument: String,
    /// The tolerances, as their file has them.
    pub tolerances: String,
    /// Cameras that are built.
    pub cameras: usize,
    /// What they are drawn from.
    pub seed: u64,
    /// The program that computes it: another one may come to other last digits.
    pub version: String,
}

/// A tolerance run, ready to compute its rows.
///
/// The first rows are off by one number alone, by its standard deviation one way and the other; the others are cameras that
/// are off by all of them.
pub struct Run {
    /// What all cameras have in common.
    pub trial: Trial,
    /// How the numbers are drawn.
    pub tolerances: Tolerances,
    cameras: usize,
    seed: u64,
}

/// One row.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// What it is off by, in the order of the sources.
    pub off: Vec<f64>,
    /// What it reads, or why there is no such camera.
    pub reading: Result<Reading, String>,
}

/// What a row is off by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// One source, by its index, alone.
    Single(usize),
    /// Everything: a camera by its number.
    Camera(usize),
}

/// A tolerance over its standard deviation: of a normal distribution that is cut off at two deviations,
/// `2/√(1 − 4 φ(2)/(2 Φ(2) − 1))`, and of a uniform one, √3.
const NORMAL: f64 = 2.273_694;
const UNIFORM: f64 = 1.732_051;

/// Deviations of the normal distribution at which it is cut off.
const CUT: f64 = 2.0;

/// Noise of single rows is drawn from streams beyond those of cameras.
const SINGLES: u128 = 1 << 64;

impl RunSpec {
    /// Made ready.
    pub fn run(&self) -> Result<Run> {
        let instrument = Instrument::from_toml(&self.instrument)?;
        let tolerances = Tolerances::from_toml(&self.tolerances)?;
        let trial = Trial::new(&instrument, &tolerances)?;
        Ok(Run { trial, tolerances, cameras: self.cameras, seed: self.seed })
    }
}

impl Run {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        2 * self.sources() + self.cameras
    }

    fn sources(&self) -> usize {
        self.trial.drawing.sources.len()
    }

    /// What a row is off by.
    pub fn kind(&self, row: usize) -> Kind {
        let singles = 2 * self.sources();
        if row < singles { Kind::Single(row / 2) } else { Kind::Camera(row - singles) }
    }

    /// Standard deviation of a source, in its unit.
    pub fn std(&self, source: usize) -> f64 {
        let ratio = match self.tolerances.distribution {
            Distribution::Normal => NORMAL,
            Distribution::Uniform => UNIFORM,
        };
        self.trial.drawing.sources[source].tolerance / ratio
    }

    /// Computes a row: the same whenever and wherever.
    pub fn row(&self, row: usize) -> Row {
        let (off, mut noise) = match self.kind(row) {
            Kind::Single(source) => self.single(source, row),
            Kind::Camera(camera) => self.camera(camera),
        };
        let reading = self.trial.reading(&off, &mut noise).map_err(|error| one_line(&error));
        Row { off, reading }
    }

    fn single(&self, source: usize, row: usize) -> (Vec<f64>, Pcg64Dxsm) {
        let mut off = vec![0.0; self.sources()];
        off[source] = if row.is_multiple_of(2) { self.std(source) } else { -self.std(source) };
        (off, Pcg64Dxsm::new(u128::from(self.seed), SINGLES + row as u128))
    }

    fn camera(&self, camera: usize) -> (Vec<f64>, Pcg64Dxsm) {
        let mut rng = Pcg64Dxsm::new(u128::from(self.seed), camera as u128);
        let drawn = self.trial.drawing.sources.iter().map(|own| own.tolerance * self.share(&mut rng));
        (drawn.collect(), rng)
    }

    /// Share of a tolerance, −1 to 1.
    fn share(&self, rng: &mut Pcg64Dxsm) -> f64 {
        match self.tolerances.distribution {
            Distribution::Uniform => Uniform::new_inclusive(-1.0, 1.0).map_or(0.0, |uniform| uniform.sample(rng)),
            Distribution::Normal => loop {
                let deviations: f64 = StandardNormal.sample(rng);
                if deviations.abs() <= CUT {
                    return deviations / CUT;
                }
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::super::tolerances::grade;
    use super::*;

    fn run(distribution: &str) -> Run {
        let tolerances = grade("commercial")
            .unwrap()
            .replace("distribution = \"normal\"", &format!("distribution = {distribution}"));
        let instrument = paper::INSTRUMENT_TOML.to_owned();
        let spec = RunSpec { instrument, tolerances, cameras: 4000, seed: 3, version: String::new() };
        spec.run().unwrap()
    }

    #[test]
    fn draws_have_the_deviation_that_single_rows_have() {
        for distribution in ["\"normal\"", "\"uniform\""] {
            let run = run(distribution);
            let drawn: Vec<f64> = (0..4000).map(|camera| run.camera(camera).0[0]).collect();
            let tolerance = run.trial.drawing.sources[0].tolerance;
            assert!(drawn.iter().all(|off| off.abs() <= tolerance));
            let std = (drawn.iter().map(|off| off * off).sum::<f64>() / 4000.0).sqrt();
            // Its own deviation is 1/√8000.
            assert!((std / run.std(0) - 1.0).abs() < 0.035, "{distribution}: {std} {}", run.std(0));
        }
    }

    #[test]
    fn a_row_is_its_own_and_singles_are_off_by_one_number() {
        let run = run("\"normal\"");
        let singles = 2 * run.sources();
        assert_eq!((run.rows(), run.kind(1), run.kind(singles)), (singles + 4000, Kind::Single(0), Kind::Camera(0)));
        let (up, down) = (run.single(0, 0).0, run.single(0, 1).0);
        assert_eq!((up[0], up.iter().filter(|off| **off != 0.0).count()), (-down[0], 1));
        let camera = run.camera(7).0;
        assert_eq!(camera, run.camera(7).0);
        assert_ne!(camera, run.camera(8).0);
    }
}
