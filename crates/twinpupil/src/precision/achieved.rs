//! What the trials come to.

use std::collections::BTreeMap;

use serde::Serialize;
use twinpupil_reconstruct::Mode;

use super::{BoundStudy, Located, Place, Sheet, Trial};
use crate::experiments::statistics::{mean, rms, spread};

/// How well dots were located: those of one place, or all of them. x is outwards, y sideways.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Achievement {
    /// Dots that could have been found: all with a bound, in all frames.
    pub dots: usize,
    /// Those that were found.
    pub found: usize,
    /// Root mean square of the errors, mm.
    pub rms_error_mm: [f64; 3],
    /// Mean error, mm.
    pub bias_mm: [f64; 3],
    /// Standard deviation of that mean, mm.
    pub bias_std_mm: [f64; 3],
    /// Root mean square of every error over its dot's bound.
    pub error_over_bound: [f64; 3],
    /// Root mean square of every error over the deviation that was reported with it.
    pub error_over_std: [f64; 3],
}

/// The trials of one mode, counted.
#[derive(Debug, Clone, PartialEq)]
pub struct Tally {
    /// The mode.
    pub mode: Mode,
    /// Frames that were read.
    pub frames: usize,
    /// What was achieved at every place.
    pub places: BTreeMap<Place, Achievement>,
    /// Points that are no dot.
    pub false_points: usize,
    /// Number of features that became no point, by the place of the dot on whose image they lie, by band and reason.
    pub rejected: BTreeMap<(Option<Place>, String, &'static str), usize>,
    samples: BTreeMap<Place, Sample>,
}

/// Errors, with bounds and reported deviations, of the dots of one place.
#[derive(Debug, Clone, PartialEq, Default)]
struct Sample {
    dots: usize,
    found: Vec<(Located, [f64; 3])>,
}

impl Achievement {
    /// Share of the dots that were found.
    pub fn recall(&self) -> f64 {
        self.found as f64 / self.dots.max(1) as f64
    }

    fn of(sample: &Sample) -> Self {
        let each = |value: &dyn Fn(&Located, &[f64; 3], usize) -> f64, axis: usize| -> Vec<f64> {
            sample.found.iter().map(|(located, bound_mm)| value(located, bound_mm, axis)).collect()
        };
        let error_mm = |located: &Located, _: &[f64; 3], axis: usize| located.error_mm[axis];
        let over_bound = |located: &Located, bound_mm: &[f64; 3], axis: usize| located.error_mm[axis] / bound_mm[axis];
        let over_std = |located: &Located, _: &[f64; 3], axis: usize| located.error_mm[axis] / located.std_mm[axis];
        let bias_std_mm = |axis| {
            let errors_mm = each(&error_mm, axis);
            spread(&errors_mm) / (errors_mm.len() as f64).sqrt()
        };
        Self {
            dots: sample.dots,
            found: sample.found.len(),
            rms_error_mm: [0, 1, 2].map(|axis| rms(&each(&error_mm, axis))),
            bias_mm: [0, 1, 2].map(|axis| mean(&each(&error_mm, axis))),
            bias_std_mm: [0, 1, 2].map(bias_std_mm),
            error_over_bound: [0, 1, 2].map(|axis| rms(&each(&over_bound, axis))),
            error_over_std: [0, 1, 2].map(|axis| rms(&each(&over_std, axis))),
        }
    }
}

impl Tally {
    /// Counts the trials of a mode.
    pub fn new(mode: Mode, trials: &[Trial], sheets: &[Sheet], bounds: &BoundStudy) -> Self {
        let own = || trials.iter().filter(|trial| trial.mode == mode);
        let mut samples = BTreeMap::<Place, Sample>::new();
        let mut rejected = BTreeMap::new();
        for trial in own() {
            let sheet = &sheets[trial.sheet];
            for ((dot, bound), located) in sheet.dots.iter().zip(&bounds.dots[trial.sheet]).zip(&trial.dots) {
                let Some(bound) = bound else { continue };
                let covariance = super::turned_covariance_mm2(bound.covariance_mm2, dot.azimuth_rad());
                let bound_mm = [0, 1, 2].map(|axis| covariance[axis][axis].sqrt());
                let sample = samples.entry(dot.place).or_default();
                sample.dots += 1;
                sample.found.extend(located.map(|located| (located, bound_mm)));
            }
            for lost in &trial.lost {
                let place = lost.dot.map(|dot| sheet.dots[dot].place);
                *rejected.entry((place, lost.band.clone(), lost.reason.name())).or_default() += 1;
            }
        }
        Self {
            mode,
            frames: own().count(),
            places: samples.iter().map(|(place, sample)| (*place, Achievement::of(sample))).collect(),
            false_points: own().map(|trial| trial.false_points).sum(),
            rejected,
            samples,
        }
    }

    /// What was achieved at all places that `wanted` picks together.
    pub fn over(&self, wanted: impl Fn(Place) -> bool) -> Achievement {
        let mut all = Sample::default();
        for (_, sample) in self.samples.iter().filter(|(place, _)| wanted(**place)) {
            all.dots += sample.dots;
            all.found.extend(&sample.found);
        }
        Achievement::of(&all)
    }

    /// Number of features that became no point, by reason.
    pub fn reasons(&self) -> BTreeMap<&'static str, usize> {
        let mut reasons = BTreeMap::new();
        for ((_, _, reason), count) in &self.rejected {
            *reasons.entry(*reason).or_default() += count;
        }
        reasons
    }
}
