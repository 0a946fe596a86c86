//! What `--json` prints.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{Analysis, mode_name};
use crate::precision::{Achievement, Place, Tally};

/// The whole result.
#[derive(Debug, Serialize)]
pub(super) struct Summary<'a> {
    instrument: &'a str,
    diameter_mm: f64,
    brightness_e: f64,
    background_e: f64,
    places: Vec<PlaceSummary<'a>>,
    /// With `--achieved`.
    achieved: Vec<ModeSummary>,
    folder: String,
    files: Vec<&'static str>,
    seconds: f64,
}

/// One place of the grid.
#[derive(Debug, Serialize)]
struct PlaceSummary<'a> {
    z_mm: f64,
    r_mm: f64,
    /// Smallest deviations of x, y and z of a dot on the x axis; none out of sight or without light.
    bound_std_mm: Option<[f64; 3]>,
    /// By mode.
    achieved: BTreeMap<&'static str, &'a Achievement>,
}

/// One mode.
#[derive(Debug, Serialize)]
struct ModeSummary {
    mode: &'static str,
    frames: usize,
    false_points: usize,
    /// Number of features that became no point, by reason.
    rejected: BTreeMap<&'static str, usize>,
    all: Achievement,
    /// At places where the masks clip nothing.
    unclipped: Achievement,
}

impl<'a> Summary<'a> {
    pub(super) fn new(analysis: &'a Analysis, folder: String, files: Vec<&'static str>, seconds: f64) -> Self {
        Self {
            instrument: &analysis.instrument.name,
            diameter_mm: analysis.kind.diameter_mm,
            brightness_e: analysis.kind.brightness_e,
            background_e: analysis.kind.background_e,
            places: analysis.places().map(|place| PlaceSummary::new(analysis, place)).collect(),
            achieved: analysis.tallies.iter().map(|tally| ModeSummary::new(analysis, tally)).collect(),
            folder,
            files,
            seconds,
        }
    }
}

impl<'a> PlaceSummary<'a> {
    fn new(analysis: &'a Analysis, place: Place) -> Self {
        let own = |tally: &'a Tally| Some((mode_name(tally.mode), tally.places.get(&place)?));
        Self {
            z_mm: analysis.z_mm(place),
            r_mm: analysis.r_mm(place),
            bound_std_mm: analysis.bounds.at(place).map(|bound| bound.std_mm()),
            achieved: analysis.tallies.iter().filter_map(own).collect(),
        }
    }
}

impl ModeSummary {
    fn new(analysis: &Analysis, tally: &Tally) -> Self {
        Self {
            mode: mode_name(tally.mode),
            frames: tally.frames,
            false_points: tally.false_points,
            rejected: tally.reasons(),
            all: tally.over(|_| true),
            unclipped: tally.over(|place| analysis.is_unclipped(place)),
        }
    }
}
