//! Frames that the camera of the others does not explain.

use crate::adjust::{Observation, Weighing};
use crate::calibrate::{CalibrateError, Calibrator, Fault, FrameFault};
use crate::compare::Comparison;
use crate::now::Now;
use crate::seen::Seen;
use crate::unknown::Unknown;

/// Frames that can outvote one.
const FRAMES_MIN: usize = 3;

impl<'a> Calibrator<'a> {
    /// Without frames most of whose spots hardly count, one after the other.
    pub(crate) fn without_strangers(
        &self,
        (mut now, mut comparison): (Now, Comparison),
        unknowns: &[Unknown],
        seen: &mut Vec<Seen<'a>>,
        faults: &mut Vec<Fault>,
    ) -> Result<(Now, Comparison), CalibrateError> {
        while let Some((place, fault)) = self.stranger(&now, unknowns, seen, &comparison.observations)? {
            faults.push((seen.remove(place).frame, fault));
            let all: Vec<usize> = (0..seen.len()).collect();
            let rest = now.without_frame(place);
            (now, comparison) = self.settle(rest, unknowns, (seen, &all), Comparison::default())?;
        }
        Ok((now, comparison))
    }

    /// The frame with the largest share of spots that hardly count, if those are most of it, and what it looks like.
    fn stranger(
        &self,
        now: &Now,
        unknowns: &[Unknown],
        seen: &[Seen<'_>],
        observations: &[Observation],
    ) -> Result<Option<(usize, FrameFault)>, CalibrateError> {
        const DOUBTED_SHARE: f64 = 0.5;
        if seen.len() < FRAMES_MIN {
            return Ok(None);
        }
        let problem = now.problem(unknowns, observations, Weighing::BY_NOISE);
        let state = &now.adjusted.state;
        let doubt_chi2 = now.weighing(unknowns, observations, state).doubt_chi2;
        let is_doubted = |own: &&Observation| {
            own.chi2(&problem.image(own.band, own.dot, &now.cameras, state, &state.poses[own.frame])) > doubt_chi2
        };
        let doubted = |place: usize| {
            let own = || observations.iter().filter(move |own| own.frame == place);
            (own().filter(is_doubted).count(), own().count())
        };
        let share = |(doubted, spots): (usize, usize)| doubted as f64 / spots.max(1) as f64;
        let worst = (0..seen.len()).map(|place| (place, doubted(place)));
        let Some((place, (doubted, spots))) = worst.max_by(|a, b| share(a.1).total_cmp(&share(b.1))) else {
            return Ok(None);
        };
        if share((doubted, spots)) <= DOUBTED_SHARE {
            return Ok(None);
        }
        let fault = if self.is_exchanged(now, seen, place)? {
            FrameFault::Exchanged
        } else if let Some(extra_px) = self.added_blur_px(now, &self.rough_observations(now, seen, place)) {
            FrameFault::Blurred { extra_px, z_mm: state.poses[place].translation_mm.z }
        } else {
            FrameFault::Stranger { doubted, spots }
        };
        Ok(Some((place, fault)))
    }
}
