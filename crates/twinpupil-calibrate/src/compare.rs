//! What pixels say of the images that the forward model foresees.

use std::collections::BTreeMap;

use rayon::prelude::*;
use twinpupil_reconstruct::{KnownDot, KnownLight, Mode, SpotScore};

use crate::adjust::{ModelError, Observation, Weighing};
use crate::calibrate::{CalibrateError, Calibrator, Foreign, Stage};
use crate::now::Now;
use crate::seen::Seen;

/// What a spot's pixels come to, beside its score.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Fitness {
    pub(crate) chi2: f64,
    pub(crate) used_px: usize,
    /// Whether the masks take some of its light.
    pub(crate) is_cut: bool,
}

/// The light of every dot of the target in every band, as a frame shows it.
pub(crate) type Lights = Vec<Vec<Option<KnownLight>>>;

/// What the comparison of frames comes to.
#[derive(Debug, Default)]
pub(crate) struct Comparison {
    /// Ordered by frame.
    pub(crate) observations: Vec<Observation>,
    pub(crate) fitness: Vec<Fitness>,
    /// By frame.
    pub(crate) lights: BTreeMap<usize, Lights>,
    /// How far what it leads to lies beside where it was made, in deviations, if it was the last.
    pub(crate) unrest_sigmas: f64,
}

impl Comparison {
    fn add(&mut self, other: Self) {
        self.observations.extend(other.observations);
        self.fitness.extend(other.fitness);
        self.lights.extend(other.lights);
    }
}

impl Calibrator<'_> {
    /// Compares frames, by their places among those seen, with the forward model of an instrument; `lights` are those of the
    /// comparison before.
    pub(crate) fn compare(
        &self,
        now: &mut Now,
        (seen, places): (&[Seen<'_>], &[usize]),
        lights: &BTreeMap<usize, Lights>,
        round: usize,
    ) -> Result<Comparison, CalibrateError> {
        let reader = (self.reader)(&now.instrument, Mode::Model).map_err(CalibrateError::Foreign)?;
        now.see_through(reader.projections(), reader.lens_terms());
        let now = &*now;
        let one = |place: &usize| -> Result<Comparison, Foreign> {
            let one = &seen[*place];
            let dots = self.known_dots(now, one, lights.get(place), *place);
            let scores = match &one.kept {
                Some(frame) => reader.scores(frame, &dots)?,
                None => reader.scores(&*(self.frame)(one.frame)?, &dots)?,
            };
            (self.progress)(Stage::Comparing(round));
            Ok(compared(now, one, *place, &scores))
        };
        let all = places.par_iter().map(one).collect::<Result<Vec<_>, _>>();
        let mut comparison = Comparison::default();
        all.map_err(CalibrateError::Foreign)?.into_iter().for_each(|one| comparison.add(one));
        Ok(comparison)
    }

    /// All dots of the target as they stand in a frame; those that a band does not show are at most neighbours there.
    pub(crate) fn known_dots(
        &self,
        now: &Now,
        seen: &Seen<'_>,
        lights: Option<&Lights>,
        place: usize,
    ) -> Vec<KnownDot> {
        let state = &now.adjusted.state;
        let slopes = state.poses[place].slopes();
        let stated = self.target.dots();
        let bands = 0..seen.sighting.len();
        let first: Vec<Vec<KnownLight>> = bands.clone().map(|band| seen.lights(band, stated.len())).collect();
        let dot = |(index, dot): (usize, &crate::target::TargetDot)| {
            let light = |band: usize| lights.and_then(|lights| lights[index][band]).unwrap_or(first[band][index]);
            KnownDot {
                centre_mm: state.dot_mm(&now.dots, place, index).into(),
                slopes,
                diameter_mm: dot.diameter_mm * now.diameter_scale,
                lights: bands.clone().map(|band| Some(light(band))).collect(),
            }
        };
        stated.iter().enumerate().map(dot).collect()
    }
}

/// What one frame comes to whose dots have these scores.
fn compared(now: &Now, seen: &Seen<'_>, place: usize, scores: &[Vec<Option<SpotScore>>]) -> Comparison {
    let problem = now.problem(&[], &[], Weighing::BY_NOISE);
    let state = &now.adjusted.state;
    let mut comparison = Comparison::default();
    let shown = |band: usize| seen.dots(band).map(move |(dot, _)| (band, dot));
    for (band, dot) in (0..seen.sighting.len()).flat_map(shown) {
        let Some(score) = scores[dot][band] else { continue };
        let anchor = problem.image(band, dot, &now.cameras, state, &state.poses[place]);
        let observation = Observation::new((place, band, dot), anchor, score.score, score.information);
        if let Some(observation) = observation.with_model_error(ModelError::of(&score)) {
            comparison.observations.push(observation);
            let SpotScore { chi2, used_px, is_cut, .. } = score;
            comparison.fitness.push(Fitness { chi2, used_px, is_cut });
        }
    }
    let light = |score: &Option<SpotScore>| score.map(|score| score.light);
    let lights = scores.iter().map(|bands| bands.iter().map(light).collect()).collect();
    comparison.lights.insert(place, lights);
    comparison
}
