//! What `--json` prints.

use serde::Serialize;

use super::Toleranced;
use crate::design::tolerance::{Contributor, Errors, quantile};

/// The result.
#[derive(Debug, Serialize)]
pub(super) struct Summary {
    instrument: String,
    tolerances: String,
    cameras: usize,
    seed: u64,
    places: usize,
    before: Spread,
    after: Spread,
    contributors: Vec<Share>,
    faults: usize,
    blind: usize,
    files: Vec<&'static str>,
}

/// Errors of depth over the cameras.
#[derive(Debug, Serialize)]
struct Spread {
    rms_mm: f64,
    rms_mm_if_added: f64,
    camera_rms_mm_median: f64,
    camera_rms_mm_95: f64,
    camera_rms_mm_99: f64,
    camera_largest_mm_median: f64,
    camera_largest_mm_95: f64,
    camera_largest_mm_99: f64,
}

#[derive(Debug, Serialize)]
struct Share {
    name: String,
    tolerance: f64,
    unit: &'static str,
    before_rms_mm: f64,
    before_share: f64,
    after_rms_mm: f64,
    after_share: f64,
}

impl Summary {
    pub(super) fn new(toleranced: &Toleranced, files: Vec<&'static str>) -> Self {
        let Toleranced { name, spec, run, outcome, .. } = toleranced;
        Self {
            instrument: name.clone(),
            tolerances: run.tolerances.name.clone(),
            cameras: spec.cameras,
            seed: spec.seed,
            places: run.trial.volume.places_mm.len(),
            before: Spread::of(&outcome.before),
            after: Spread::of(&outcome.after),
            contributors: outcome.contributors.iter().map(Share::of).collect(),
            faults: outcome.faults,
            blind: outcome.blind,
            files,
        }
    }
}

impl Spread {
    fn of(errors: &Errors) -> Self {
        let (rms, largest) = (|share| quantile(&errors.rms_mm, share), |share| quantile(&errors.largest_mm, share));
        Self {
            rms_mm: errors.all_mm,
            rms_mm_if_added: errors.added_mm,
            camera_rms_mm_median: rms(0.5),
            camera_rms_mm_95: rms(0.95),
            camera_rms_mm_99: rms(0.99),
            camera_largest_mm_median: largest(0.5),
            camera_largest_mm_95: largest(0.95),
            camera_largest_mm_99: largest(0.99),
        }
    }
}

impl Share {
    fn of(own: &Contributor) -> Self {
        Self {
            name: own.name.clone(),
            tolerance: own.tolerance,
            unit: own.unit,
            before_rms_mm: own.rms_mm[0],
            before_share: own.share[0],
            after_rms_mm: own.rms_mm[1],
            after_share: own.share[1],
        }
    }
}
