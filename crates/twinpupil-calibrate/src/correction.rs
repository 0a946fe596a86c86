//! A smooth correction of what the numbers of a camera leave, where frames that take no part bear it out.
//!
//! Every band is given a field of displacements in circle polynomials (`Correction` of the instrument), sought together with
//! all numbers and poses, robustly and with a prior deviation. It is sought up to several orders without one part of the
//! frames after the other, and the parts that were left out are asked what they make of it. One that is kept is sought again
//! against the pixels.

use nalgebra::{DMatrix, DVector};
use twinpupil_instrument::{Correction, DistortionTerm, Instrument, Parameter, Role};

use crate::adjust::{Observation, Testimony, Weighing};
use crate::now::Now;
use crate::result::{HeldOut, PARTS_MAX};
use crate::unknown::{Quantity, Unknown};

/// Whether a camera may be given a correction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CorrectionChoice {
    /// If it lowers the error of frames that take no part by more than chance.
    Auto,
    /// Never.
    #[default]
    Off,
}

/// Orders up to which corrections are tried.
const DEGREES: std::ops::RangeInclusive<usize> = 2..=6;

/// Fewer frames do not tell it from their own errors.
const FRAMES_MIN: usize = 4;

/// Standard errors by which the held-out error must fall.
const GAIN_SIGMAS_MIN: f64 = 2.0;

/// Deviation of a coefficient beforehand, over the root mean square distance that the numbers leave: what they take up of the
/// field is not seen in that.
const PRIOR_OVER_RMS: f64 = 3.0;

/// What was found of a correction.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrectionFinding {
    /// Held-out error of the numbers alone: root mean square over its deviation.
    pub error_without: f64,
    /// What was tried, by order.
    pub trials: Vec<CorrectionTrial>,
    /// The order of that which was chosen, if one was.
    pub degree: Option<usize>,
    /// Depth errors in held-out frames without it, and with it, if one was chosen; it is kept if they fall.
    pub held_out: Option<[HeldOut; 2]>,
}

impl CorrectionFinding {
    /// Whether the instrument has it.
    pub fn is_kept(&self) -> bool {
        self.held_out.is_some_and(|[without, with]| with.z_rms_mm < without.z_rms_mm)
    }
}

/// A correction that was tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CorrectionTrial {
    /// The highest order of its terms.
    pub degree: usize,
    /// Numbers that were sought for it, of all bands.
    pub coefficients: usize,
    /// Held-out error: root mean square over its deviation.
    pub error: f64,
    /// By how many of its standard errors χ² of the held-out frames falls.
    pub gain_sigmas: f64,
}

/// A trial with what every part of the frames says of it.
struct Outcome {
    degree: usize,
    coefficients: usize,
    chi2: Vec<f64>,
}

/// Whether a part of a term is left out, since numbers of the camera or poses do the same to the images.
///
/// | n, m | part | what does the same |
/// |---|---|---|
/// | 0, 0 | both | the axis, in one band; centres of the masks with the poses, in the other |
/// | 1, 1 | x: scale | focal lengths, L |
/// | 1, 1 | y: turn | the turn of the target, in the telecentric band |
/// | 2, 2 | both | the sensor's tilt; centre of the telecentric mask with tilts of the poses |
/// | 3, 1 | x: radial | k₁ |
/// | 5, 1 | x: radial | k₂, if it is sought |
/// | 2, 0 | both | p₁, p₂, if they are sought |
///
/// A tilt does `α w w̄ + ᾱ w²`, of which the second part is left out and the first sought: any field is one of those that are
/// sought, up to what the numbers do.
fn is_carried(band: usize, role: Role, (term, axis): (usize, usize), unknowns: &[Unknown]) -> bool {
    let seeks = |terms: &[DistortionTerm]| {
        unknowns.iter().any(|unknown| match unknown.quantity {
            Quantity::Instrument(Parameter::Distortion(own, term)) => own == band && terms.contains(&term),
            _ => false,
        })
    };
    match (Correction::orders(term), axis) {
        ((0, 0) | (2, 2), _) | ((1, 1) | (3, 1), 0) => true,
        ((1, 1), _) => role == Role::Telecentric,
        ((5, 1), 0) => seeks(&[DistortionTerm::K2]),
        ((2, 0), _) => seeks(&[DistortionTerm::P1, DistortionTerm::P2]),
        _ => false,
    }
}

/// The coefficients that are sought of a correction, besides unknowns.
fn coefficients(instrument: &Instrument, degree: usize, prior_mm: f64, unknowns: &[Unknown]) -> Vec<Unknown> {
    let terms = 0..Correction::terms(degree);
    let of_band = |band: usize| {
        let parts = terms.clone().flat_map(|term| [(term, 0), (term, 1)]);
        let role = instrument.bands[band].role;
        let own = parts.filter(move |part| !is_carried(band, role, *part, unknowns));
        own.map(move |(term, axis)| Parameter::Correction(band, term, axis))
    };
    let is_new = |parameter: &Parameter| unknowns.iter().all(|own| own.quantity != Quantity::Instrument(*parameter));
    let all = (0..instrument.bands.len()).flat_map(of_band).filter(is_new);
    all.map(|parameter| Unknown::of(Quantity::Instrument(parameter), instrument, prior_mm)).collect()
}

/// Where a calibration stands once it has a correction, which displaces nothing yet.
#[derive(Debug)]
pub(crate) struct Candidate {
    pub(crate) now: Now,
    /// The unknowns before, then its coefficients.
    pub(crate) unknowns: Vec<Unknown>,
}

impl Candidate {
    /// With all terms up to an order; `None` if the instrument cannot have them.
    pub(crate) fn new(now: &Now, unknowns: &[Unknown], observations: &[Observation], degree: usize) -> Option<Self> {
        let radius_mm = (100.0 * now.instrument.corner_radius_mm()).ceil() / 100.0;
        let mut spec = now.instrument.clone().into_spec();
        for band in &mut spec.bands {
            let own = band.correction.take().unwrap_or_else(|| Correction::none(radius_mm, 0));
            band.correction = Some(own.up_to(degree));
        }
        let instrument = Instrument::new(spec).ok()?;
        let prior_mm = PRIOR_OVER_RMS * now.rms_px(observations) * instrument.sensor.pitch_mm;
        let own = coefficients(&instrument, degree, prior_mm, unknowns);
        let mut now = Now { instrument, ..now.clone() };
        now.see_through(now.projections.clone(), now.lens.clone());
        now.adjusted.state.values.extend(own.iter().map(|unknown| unknown.expected));
        Some(Self { now, unknowns: unknowns.iter().cloned().chain(own).collect() })
    }
}

/// Tries corrections of all orders on the numbers that explain the observations best; `None` if there are too few frames.
pub(crate) fn tried(
    now: &Now,
    unknowns: &[Unknown],
    observations: &[Observation],
    frames: usize,
) -> Option<CorrectionFinding> {
    if frames < FRAMES_MIN {
        return None;
    }
    let widest = Candidate::new(now, unknowns, observations, *DEGREES.end())?;
    // What the numbers leave is doubted no more than it was, but counts in full: a correction may explain it.
    let weighing = Weighing { misfit: 1.0, ..now.weighing(unknowns, observations, &now.adjusted.state) };
    let problem = widest.now.problem(&widest.unknowns, observations, weighing);
    let state = &widest.now.adjusted.state;
    let held_out = Parts {
        testimonies: problem.testimonies(state, frames.min(PARTS_MAX)),
        prior_score: problem.prior_score(state),
    };
    let outcome = |degree: Option<usize>| {
        let is_sought = |k: &usize| order(widest.unknowns.get(*k)).is_none_or(|own| Some(own) <= degree);
        let sought: Vec<usize> = (0..held_out.prior_score.len()).filter(is_sought).collect();
        let coefficients = sought.iter().filter(|k| order(widest.unknowns.get(**k)).is_some()).count();
        Some(Outcome { degree: degree.unwrap_or(0), coefficients, chi2: held_out.chi2(&sought)? })
    };
    let without = outcome(None)?;
    let outcomes: Vec<Outcome> = DEGREES.filter_map(|degree| outcome(Some(degree))).collect();
    let numbers = (4 * observations.len()).saturating_sub(6 * frames).max(1) as f64;
    let error = |outcome: &Outcome| (outcome.chi2.iter().sum::<f64>().max(0.0) / numbers).sqrt();
    let trial = |outcome: &Outcome| CorrectionTrial {
        degree: outcome.degree,
        coefficients: outcome.coefficients,
        error: error(outcome),
        gain_sigmas: sigmas(&gains(outcome, &without)),
    };
    Some(CorrectionFinding {
        error_without: error(&without),
        trials: outcomes.iter().map(trial).collect(),
        degree: chosen(&outcomes, &without),
        held_out: None,
    })
}

/// The order of a coefficient, if an unknown is one.
fn order(unknown: Option<&Unknown>) -> Option<usize> {
    match unknown?.quantity {
        Quantity::Instrument(Parameter::Correction(_, term, _)) => Some(Correction::orders(term).0),
        _ => None,
    }
}

/// The order of the correction that is worth it: the lowest of those that are no more than a standard error worse than the
/// best (T. Hastie, R. Tibshirani, J. Friedman, The Elements of Statistical Learning, section 7.10), if its gain is no chance.
fn chosen(outcomes: &[Outcome], without: &Outcome) -> Option<usize> {
    let best = outcomes.iter().min_by(|a, b| a.chi2.iter().sum::<f64>().total_cmp(&b.chi2.iter().sum()))?;
    let is_as_good = |outcome: &&Outcome| outcome.degree == best.degree || sigmas(&gains(best, outcome)) < 1.0;
    let simplest = outcomes.iter().find(is_as_good)?;
    (sigmas(&gains(simplest, without)) > GAIN_SIGMAS_MIN).then_some(simplest.degree)
}

/// By how much χ² of every part is lower than that of another.
fn gains(outcome: &Outcome, than: &Outcome) -> Vec<f64> {
    outcome.chi2.iter().zip(&than.chi2).map(|(own, other)| other - own).collect()
}

/// A mean over its standard error.
fn sigmas(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    mean / (variance / count).sqrt().max(f64::MIN_POSITIVE)
}

/// What parts of the frames say of everything that could be sought, to first order.
struct Parts {
    testimonies: Vec<Testimony>,
    prior_score: DVector<f64>,
}

impl Parts {
    /// χ² of every part at what the others find of some unknowns.
    fn chi2(&self, sought: &[usize]) -> Option<Vec<f64>> {
        let own = |testimony: &Testimony| Testimony {
            information: testimony.information.select_rows(sought).select_columns(sought),
            score: testimony.score.select_rows(sought),
            cost: testimony.cost,
        };
        let testimonies: Vec<Testimony> = self.testimonies.iter().map(own).collect();
        let prior = self.prior_score.select_rows(sought);
        (0..testimonies.len()).map(|part| chi2_held_out(part, &testimonies, &prior)).collect()
    }
}

fn chi2_held_out(part: usize, testimonies: &[Testimony], prior: &DVector<f64>) -> Option<f64> {
    let mut information = DMatrix::identity(prior.len(), prior.len());
    let mut score = prior.clone();
    for (_, testimony) in testimonies.iter().enumerate().filter(|(other, _)| *other != part) {
        information += &testimony.information;
        score += &testimony.score;
    }
    let step = information.cholesky()?.solve(&score);
    let own = &testimonies[part];
    Some(own.cost - 2.0 * own.score.dot(&step) + step.dot(&(&own.information * &step)))
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;
    use crate::unknown::Choices;

    fn outcome(degree: usize, chi2: &[f64]) -> Outcome {
        Outcome { degree, coefficients: 0, chi2: chi2.to_vec() }
    }

    #[test]
    fn the_simplest_that_is_as_good_as_the_best_is_chosen() {
        let without = outcome(0, &[100.0, 110.0, 90.0, 105.0]);
        let poor = outcome(2, &[80.0, 85.0, 70.0, 90.0]);
        let good = outcome(3, &[10.0, 12.0, 9.0, 11.0]);
        let best = outcome(4, &[9.0, 13.0, 8.0, 10.5]);
        assert_eq!(chosen(&[poor, good, best], &without), Some(3));
        let chance = outcome(2, &[80.0, 125.0, 85.0, 108.0]);
        assert_eq!(chosen(&[chance], &without), None);
        assert_eq!(chosen(&[outcome(2, &[101.0, 112.0, 91.0, 106.0])], &without), None);
        assert_eq!(chosen(&[], &without), None);
    }

    #[test]
    fn what_numbers_do_is_left_to_them() {
        let instrument = paper::instrument();
        let unknowns = Choices::default().unknowns(&instrument).expect("legal");
        let keys = |unknowns: &[Unknown]| -> Vec<String> {
            let own = coefficients(&instrument, 5, 1e-3, unknowns);
            own.iter().map(|unknown| unknown.quantity.key(&instrument)).collect()
        };
        let found = keys(&unknowns);
        // Of 21 terms of two parts each, 7 are left out in the telecentric band and 6 in the other.
        assert_eq!(found.len(), 2 * 42 - 13);
        let has = |key: &str| found.contains(&key.to_owned());
        assert!(
            !has("band[0].correction.y_mm[1]")
                && has("band[1].correction.y_mm[1]")
                && has("band[0].correction.x_mm[16]")
        );
        let mut choices = Choices::default();
        choices.prior_std.insert("band[0].distortion.k2_per_mm4".to_owned(), 1e-6);
        let with_k2 = choices.unknowns(&instrument).expect("legal");
        assert_eq!(keys(&with_k2).len(), found.len() - 1);
    }

    /// Without noise what is held out is foreseen, unless a part of what is there is not sought.
    #[test]
    fn what_all_parts_share_is_foreseen_in_that_held_out() {
        let truth = DVector::from_vec(vec![0.3, -0.2, 0.5]);
        let testimony = |part: usize| {
            let seen = DMatrix::from_fn(4, 3, |i, k| ((3 * part + 5 * i + 7 * k) as f64).powi(2).sin());
            let information = 1e8 * seen.transpose() * seen;
            Testimony { score: &information * &truth, cost: truth.dot(&(&information * &truth)), information }
        };
        let parts = Parts { testimonies: (0..6).map(testimony).collect(), prior_score: DVector::zeros(3) };
        let all: f64 = parts.chi2(&[0, 1, 2]).expect("definite").iter().sum();
        let some: f64 = parts.chi2(&[0, 2]).expect("definite").iter().sum();
        assert!(all < 1e-3 && some > 1e5, "{all} {some}");
    }
}
