//! What is known of numbers beforehand beside what the frames say of them.

use std::fmt;

use twinpupil_instrument::Instrument;

use crate::adjust::Observation;
use crate::now::Now;
use crate::unknown::{Choices, Quantity, Unknown, UnknownKey, tolerance};

/// Deviations that are no chance.
const SIGMAS_MAX: f64 = 4.0;

/// A number that was held or given a deviation beforehand and is not what the frames say.
#[derive(Debug, Clone, PartialEq)]
pub struct Contradiction {
    /// Its key.
    pub key: String,
    /// What it was known to be, and how well; 0 if it was held fast.
    pub expected: f64,
    /// See [`Self::expected`].
    pub prior_std: f64,
    /// What the frames say if it is left free, and how well.
    pub found: f64,
    /// See [`Self::found`].
    pub std: f64,
}

impl Contradiction {
    /// How far both are apart, in deviations.
    pub fn sigmas(&self) -> f64 {
        (self.found - self.expected).abs() / self.prior_std.hypot(self.std)
    }

    /// If what frames say, and its deviation, is too far from what was known.
    pub(crate) fn of(key: String, prior_std: f64, expected: f64, [found, std]: [f64; 2]) -> Option<Self> {
        let own = Self { key, expected, prior_std, found, std };
        (own.sigmas() > SIGMAS_MAX).then_some(own)
    }
}

impl fmt::Display for Contradiction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, expected, prior_std, found, std } = self;
        let how = if *prior_std > 0.0 {
            format!("known to be {expected} ± {prior_std}")
        } else {
            format!("held at {expected}")
        };
        let sigmas = self.sigmas();
        write!(f, "`{key}` is {how}, but the frames say {found:.5} ± {std:.5}, {sigmas:.0} deviations beside it")
    }
}

impl Choices {
    /// The same with every number as free as if nothing had been chosen.
    pub(crate) fn freed(&self, instrument: &Instrument) -> Self {
        let mut freed = self.clone();
        for quantity in Quantity::all(instrument) {
            if let Some(prior_std) = freed.prior_std.get_mut(&quantity.key(instrument)) {
                *prior_std = prior_std.max(tolerance(quantity, instrument));
            }
        }
        freed
    }

    /// What of the choices goes against observations to which all numbers are adjusted, if those are left free.
    pub(crate) fn contradictions(
        &self,
        instrument: &Instrument,
        now: &Now,
        observations: &[Observation],
    ) -> Result<Vec<Contradiction>, UnknownKey> {
        let freed = self.freed(instrument);
        if freed == *self {
            return Ok(Vec::new());
        }
        let unknowns = freed.unknowns(instrument)?;
        let Ok(free) = now.seeking(&unknowns).adjusted_to(&unknowns, observations) else { return Ok(Vec::new()) };
        let covariance = &free.adjusted.covariance;
        let own = |(k, unknown): (usize, &Unknown)| {
            let key = unknown.quantity.key(instrument);
            let prior_std = *self.prior_std.get(&key)?;
            let value = free.adjusted.state.values[k];
            let [found, std] = told(unknown, value, covariance[(k, k)])?;
            Contradiction::of(key, prior_std, unknown.expected, [found, std])
        };
        Ok(unknowns.iter().enumerate().filter_map(own).collect())
    }
}

/// What frames say of an unknown without what is known of it beforehand, and its deviation; the variance of both together is
/// in that of the latter.
fn told(unknown: &Unknown, value: f64, variance: f64) -> Option<[f64; 2]> {
    const VARIANCE_MAX: f64 = 0.99;
    let alone = 1.0 - variance;
    let found = unknown.expected + (value - unknown.expected) / alone;
    (variance < VARIANCE_MAX).then(|| [found, unknown.prior_std * (variance / alone).sqrt()])
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;

    #[test]
    fn what_is_known_beforehand_is_taken_out_of_what_is_told() {
        let instrument = paper::instrument();
        let unknown = Unknown::of(Quantity::DotDiameter, &instrument, 0.5);
        // 1 ± 0.5 from before and 2 ± 1 from frames are 1.2 and a variance of 0.2, 0.8 of that from before.
        let [found, std] = told(&unknown, 1.2, 0.8).unwrap();
        assert!((found - 2.0).abs() < 1e-12 && (std - 1.0).abs() < 1e-12, "{found} {std}");
        assert_eq!(told(&unknown, 1.0, 1.0), None);
    }

    #[test]
    fn only_what_is_more_than_chance_contradicts() {
        let of = |prior_std: f64, found: f64| Contradiction::of("k".to_owned(), prior_std, 10.0, [found, 0.3]);
        assert_eq!(of(0.4, 11.9), None);
        let fixed = of(0.0, 11.9).unwrap().to_string();
        assert_eq!(fixed, "`k` is held at 10, but the frames say 11.90000 ± 0.30000, 6 deviations beside it");
        assert!(of(0.4, 13.0).unwrap().to_string().contains("known to be 10 ± 0.4, but the frames say 13.0"));
    }
}
