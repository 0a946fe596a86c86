//! From frames of a target to the instrument that took them.

use std::borrow::Cow;
use std::error::Error;

use rayon::prelude::*;
use thiserror::Error;
use twinpupil_instrument::check::ValueError;
use twinpupil_instrument::{Frame, Instrument, Role};
use twinpupil_reconstruct::{Mode, Reconstructor};

use crate::approach::FirstLook;
use crate::compare::Comparison;
use crate::correction::{Candidate, CorrectionChoice, CorrectionFinding, tried};
use crate::known::Contradiction;
use crate::now::Now;
use crate::result::{Calibration, Conclusion, HeldOut, held_out};
use crate::seen::Seen;
use crate::sighting::SightingError;
use crate::stage::StagePosition;
use crate::target::Target;
use crate::unknown::{Choices, DOT_DIAMETER_KEY, Unknown, UnknownKey};

/// What went wrong outside of this crate.
pub type Foreign = Box<dyn Error + Send + Sync>;

/// Frames that tell nothing of the instrument, or something that it cannot be.
#[derive(Debug, Error)]
pub enum CalibrateError {
    /// A choice that is none.
    #[error(transparent)]
    UnknownKey(#[from] UnknownKey),
    /// A frame that cannot be read, or an instrument that cannot be traced.
    #[error(transparent)]
    Foreign(Foreign),
    /// No frame shows the target.
    #[error("no frame can be used: {0}")]
    NoFrames(FrameFault),
    /// Telecentric and entocentric are the other way round.
    #[error(
        "the bands are swapped: `{telecentric}` is said to be telecentric, but its image changes with distance and that of \
         `{entocentric}` does not; legal: the other way round"
    )]
    Swapped {
        /// The band that is said to be telecentric.
        telecentric: String,
        /// The band that is said to be entocentric.
        entocentric: String,
    },
    /// The masks say the opposite of the roles.
    #[error(
        "band `{entocentric}` is said to be entocentric, but its mask stands nearer to the back focal plane than that of \
         `{telecentric}`, which is said to be telecentric; legal: the roles, or what the masks pass, the other way round"
    )]
    RolesAgainstMasks {
        /// The band that is said to be telecentric.
        telecentric: String,
        /// The band that is said to be entocentric.
        entocentric: String,
    },
    /// Every frame has edges wider than any distance makes them.
    #[error(
        "all frames are blurred: where edges are sharpest, they are still {extra_px:.1} px wide, which no distance makes; legal: \
         frames without motion, through a clean lens, at pupils wide enough for diffraction not to show"
    )]
    AllBlurred {
        /// Radius of the blur that is added, px.
        extra_px: f64,
    },
    /// What was fixed or given a deviation is not what the frames say.
    #[error("{0}; legal: what the frames say, or a larger deviation")]
    Contradicted(Contradiction),
    /// A number too far from what the data sheet says.
    #[error(
        "`{key}` would be {found:.6}, {sigmas:.1} tolerances from the {expected} that the instrument file says; {}",
        suspicion(key, *pitch_mm, *likely_pitch_mm)
    )]
    OffDataSheet {
        /// Its key.
        key: String,
        /// What it would be.
        found: f64,
        /// What the instrument file says.
        expected: f64,
        /// How far they are apart, in tolerances.
        sigmas: f64,
        /// The pitch of the target file, mm.
        pitch_mm: f64,
        /// The pitch at which the telecentric magnification is that of the data sheet, mm.
        likely_pitch_mm: f64,
    },
    /// An instrument that is none.
    #[error("the frames lead to an instrument that is none: {0}")]
    NoInstrument(#[from] ValueError),
    /// Equations without a solution.
    #[error("the frames do not determine the instrument: {0}")]
    Undetermined(&'static str),
}

/// What is most likely wrong where a number would be far from the data sheet.
fn suspicion(key: &str, pitch_mm: f64, likely_pitch_mm: f64) -> String {
    /// Shares by which the pitch would have to be another, to be suspected first; and at all.
    const FAR: f64 = 0.05;
    const BESIDE: f64 = 0.01;
    let off = (likely_pitch_mm / pitch_mm - 1.0).abs();
    if off < FAR && key == DOT_DIAMETER_KEY {
        return "is the target's dot_diameter_mm right?".to_owned();
    }
    if off < FAR && key.ends_with("radius_mm") {
        return "are the frames blurred, or were they taken through other masks?".to_owned();
    }
    if off > BESIDE {
        let or_blurred = if off < FAR { "; or are the frames blurred?" } else { "" };
        return format!(
            "is the target's pitch_mm = {pitch_mm} right? A pitch of {likely_pitch_mm:.4} would fit the data sheet{or_blurred}"
        );
    }
    "were the frames taken by another camera, or are the bands' roles exchanged?".to_owned()
}

/// Why a frame is left out.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum FrameFault {
    /// The target is not recognised.
    #[error(transparent)]
    Sighting(#[from] SightingError),
    /// Its dots lie on one line, or nowhere in space.
    #[error("the dots that both bands show do not lie on a plane before the camera")]
    NoPose,
    /// Edges wider than any distance makes them.
    #[error(
        "the frame is blurred: its edges are {extra_px:.1} px wider than the target's distance of {z_mm:.0} mm makes them"
    )]
    Blurred {
        /// Radius of the blur that is added, px.
        extra_px: f64,
        /// Distance of the target, mm.
        z_mm: f64,
    },
    /// Telecentric and entocentric are the other way round in this frame.
    #[error("its bands are swapped: they fit the camera of the other frames the other way round")]
    Exchanged,
    /// Another camera, another target or an image that was changed.
    #[error(
        "{doubted} of its {spots} spots are not where the camera of the other frames sees them: is it mirrored, of another \
         camera or target, or lit by something else?"
    )]
    Stranger {
        /// Spots that hardly count.
        doubted: usize,
        /// All.
        spots: usize,
    },
    /// Another pose or another target: nothing fits.
    #[error("the dots lie {off_px:.1} px beside where one camera could see them")]
    Unlike {
        /// Root mean square distance, px.
        off_px: f64,
    },
}

/// A step of a calibration, for whoever watches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Frames are searched for the target.
    Finding,
    /// Frames are compared with the forward model, for the n-th time.
    Comparing(usize),
}

/// What a camera is calibrated from.
pub struct Calibrator<'a> {
    /// The data sheet.
    pub instrument: &'a Instrument,
    /// The target.
    pub target: &'a Target,
    /// What is sought.
    pub choices: &'a Choices,
    /// Standard deviation of the places of the target's dots, mm, if they are sought too.
    pub place_std_mm: Option<f64>,
    /// Where a stage says that the target stood, frame by frame; empty if nothing does.
    pub stage: &'a [Option<StagePosition>],
    /// Makes an instrument ready to read frames in a mode.
    pub reader: &'a (dyn Fn(&Instrument, Mode) -> Result<Reconstructor, Foreign> + Sync),
    /// Reads a frame.
    pub frame: &'a (dyn Fn(usize) -> Result<Cow<'a, Frame>, Foreign> + Sync),
    /// Is told of every frame that is done with.
    pub progress: &'a (dyn Fn(Stage) + Sync),
}

/// A frame's index and why it is left out.
pub type Fault = (usize, FrameFault);

/// Times that frames are compared at most, and the change of the unknowns in their deviations that is none; or that of the
/// next one, as far as it can be foreseen, once they are as near as that.
const COMPARISONS: usize = 12;
const RESTING_SIGMAS: f64 = 0.1;
const FORESEEN_SIGMAS: f64 = 0.3;
const NEAR_SIGMAS: f64 = 1.0;

/// Frames that go ahead of the others, so that those have to be compared only from near where they end; they are kept at hand
/// if all of them together take no more than so many bytes.
const LEADERS: usize = 8;
const KEPT_BYTES_MAX: usize = 128 << 20;

/// Tolerances from the data sheet beyond which a number is refused.
const SIGMAS_MAX: f64 = 4.0;

impl<'a> Calibrator<'a> {
    /// Calibrates from so many frames.
    pub fn calibrate(&self, frames: usize) -> Result<Calibration, CalibrateError> {
        self.check_masks()?;
        self.calibrate_with(self.choices, frames).map_err(|error| match error {
            CalibrateError::OffDataSheet { .. } => self.contradiction(frames).unwrap_or(error),
            error => error,
        })
    }

    /// Refuses roles that the masks contradict: what is telecentric is seen through the back focal plane.
    fn check_masks(&self) -> Result<(), CalibrateError> {
        let off_focus_mm = |role: Role| {
            let projection = self.instrument.projection(self.instrument.band(role));
            (projection.pupil_position_mm - projection.focal_length_mm).abs()
        };
        if off_focus_mm(Role::Entocentric) >= off_focus_mm(Role::Telecentric) {
            return Ok(());
        }
        let [telecentric, entocentric] =
            [Role::Telecentric, Role::Entocentric].map(|role| self.instrument.band(role).name.clone());
        Err(CalibrateError::RolesAgainstMasks { telecentric, entocentric })
    }

    /// What was chosen and goes against the frames, if those lead to a camera of this data sheet without it.
    fn contradiction(&self, frames: usize) -> Option<CalibrateError> {
        let choices = self.choices.freed(self.instrument);
        if choices == *self.choices {
            return None;
        }
        let free = self.calibrate_with(&choices, frames).ok()?;
        let own = |(key, prior_std): (&String, &f64)| {
            let number = free.number(key)?;
            Contradiction::of(key.clone(), *prior_std, number.expected, [number.value, number.std])
        };
        let all = self.choices.prior_std.iter().filter_map(own);
        all.max_by(|a, b| a.sigmas().total_cmp(&b.sigmas())).map(CalibrateError::Contradicted)
    }

    fn calibrate_with(&self, choices: &Choices, frames: usize) -> Result<Calibration, CalibrateError> {
        let unknowns = choices.unknowns(self.instrument)?;
        let reader = (self.reader)(self.instrument, Mode::Centroid).map_err(CalibrateError::Foreign)?;
        let (mut seen, mut faults) = self.find(&reader, frames)?;
        let look = self.first_look(&reader, &unknowns, &mut seen, &mut faults)?;
        let followed = match seen.len() {
            1 => self.followed_from_either(&look, &reader, &unknowns, &seen),
            _ => self
                .approach(&look, 0, &reader, &unknowns, &mut seen, &mut faults)
                .and_then(|now| self.follow(now, &reader, &unknowns, &seen)),
        };
        let followed = followed.map_err(|error| self.blur_instead(&look, error))?;
        let (now, comparison) = self.without_strangers(followed, &unknowns, &mut seen, &mut faults)?;
        let (fit, correction) = self.corrected(Fit::of(now, unknowns, comparison, seen.len())?, &seen)?;
        let contradictions = choices.contradictions(self.instrument, &fit.now, &fit.comparison.observations)?;
        // What a field that is not corrected does to the numbers may be too much.
        let named: Vec<Unknown> = fit.unknowns.iter().filter(|own| !own.quantity.is_coefficient()).cloned().collect();
        let is_off_sheet = self.check_data_sheet(&fit.now, &named, &fit.now.adjusted, SIGMAS_MAX);
        is_off_sheet.map_err(|error| self.blur_instead(&look, error))?;
        Calibration::conclude(Conclusion {
            instrument: self.instrument,
            target: self.target,
            unknowns: &fit.unknowns,
            now: &fit.now,
            seen: &seen,
            faults,
            observations: &fit.comparison.observations,
            fitness: &fit.comparison.fitness,
            unrest_sigmas: fit.comparison.unrest_sigmas,
            held_out: fit.held_out,
            correction,
            contradictions,
        })
    }

    /// What the pixels of a single frame lead to, from that of two starts whose end they fit better: its features do not always
    /// tell the side of the focus.
    fn followed_from_either(
        &self,
        look: &FirstLook,
        reader: &Reconstructor,
        unknowns: &[Unknown],
        seen: &[Seen<'a>],
    ) -> Result<(Now, Comparison), CalibrateError> {
        const RANKS: usize = 6;
        const ENDS: usize = 2;
        let from = |rank: usize| {
            let (mut seen, mut faults) = (seen.to_vec(), Vec::new());
            let now = self.approach(look, rank, reader, unknowns, &mut seen, &mut faults)?;
            let (now, comparison) = self.follow(now, reader, unknowns, &seen)?;
            self.check_data_sheet(&now, unknowns, &now.adjusted, SIGMAS_MAX)?;
            Ok((now, comparison))
        };
        let first = from(0);
        if let Err(error) = &first
            && !matches!(error, CalibrateError::OffDataSheet { .. })
        {
            return first;
        }
        let others = (1..RANKS).map(from).filter_map(Result::ok).take(ENDS - usize::from(first.is_ok()));
        let better = |a: &(Now, Comparison), b: &(Now, Comparison)| a.0.adjusted.cost.total_cmp(&b.0.adjusted.cost);
        match (others.min_by(better), first) {
            (Some(other), Ok(first)) => Ok(if better(&other, &first).is_lt() { other } else { first }),
            (Some(other), Err(_)) => Ok(other),
            (None, first) => first,
        }
    }

    /// With a smooth correction, if frames that take no part bear it out.
    fn corrected(&self, fit: Fit, seen: &[Seen<'a>]) -> Result<(Fit, Option<CorrectionFinding>), CalibrateError> {
        if self.choices.correction == CorrectionChoice::Off {
            return Ok((fit, None));
        }
        let observations = &fit.comparison.observations;
        let Some(finding) = tried(&fit.now, &fit.unknowns, observations, seen.len()) else { return Ok((fit, None)) };
        let candidate = finding.degree.and_then(|degree| Candidate::new(&fit.now, &fit.unknowns, observations, degree));
        let Some(Candidate { now, unknowns }) = candidate else { return Ok((fit, Some(finding))) };
        let now = now.adjusted_to(&unknowns, observations)?;
        let all: Vec<usize> = (0..seen.len()).collect();
        let before = Comparison { lights: fit.comparison.lights.clone(), ..Comparison::default() };
        let (now, comparison) = self.settle(now, &unknowns, (seen, &all), before)?;
        let with = Fit::of(now, unknowns, comparison, seen.len())?;
        let held_out = fit.held_out.zip(with.held_out).map(|(without, with)| [without, with]);
        let finding = CorrectionFinding { held_out, ..finding };
        Ok((if finding.is_kept() { with } else { fit }, Some(finding)))
    }

    /// Searches all frames for the target.
    fn find(&self, reader: &Reconstructor, frames: usize) -> Result<(Vec<Seen<'a>>, Vec<Fault>), CalibrateError> {
        let one = |frame: usize| -> Result<Result<Seen<'a>, SightingError>, Foreign> {
            let image = (self.frame)(frame)?;
            let detect = |index: usize| reader.detect_band(&image, index);
            let detections = (0..self.instrument.bands.len()).map(detect).collect::<Result<Vec<_>, _>>()?;
            let seen = Seen::recognised(frame, detections, self.instrument, self.target);
            (self.progress)(Stage::Finding);
            let kept = (is_leader(frame, frames) && LEADERS * bytes(&image) <= KEPT_BYTES_MAX).then_some(image);
            Ok(seen.map(|seen| seen.keeping(kept)))
        };
        let all = (0..frames).into_par_iter().map(one).collect::<Result<Vec<_>, _>>();
        let (mut seen, mut faults) = (Vec::new(), Vec::new());
        for (frame, result) in all.map_err(CalibrateError::Foreign)?.into_iter().enumerate() {
            match result {
                Ok(one) => seen.push(one),
                Err(error) => faults.push((frame, FrameFault::from(error))),
            }
        }
        if seen.is_empty() {
            return Err(CalibrateError::no_frames(&faults));
        }
        Ok((seen, faults))
    }

    /// Follows what pixels say until nothing moves any more: first some of many frames, then all.
    fn follow(
        &self,
        now: Now,
        reader: &Reconstructor,
        unknowns: &[Unknown],
        seen: &[Seen<'a>],
    ) -> Result<(Now, Comparison), CalibrateError> {
        let is_leader = |place: &usize| is_leader(*place, seen.len());
        let (leaders, others): (Vec<usize>, Vec<usize>) = (0..seen.len()).partition(is_leader);
        let (now, comparison) = self.settle(now, unknowns, (seen, &leaders), Comparison::default())?;
        if others.is_empty() {
            return Ok((now, comparison));
        }
        let now = self.posed(&now, reader, seen, |place| !is_leader(&place))?;
        let all: Vec<usize> = (0..seen.len()).collect();
        self.settle(now, unknowns, (seen, &all), comparison)
    }

    /// Compares frames and adjusts by turns until nothing moves any more; what was compared `before` is known from there.
    pub(crate) fn settle(
        &self,
        mut now: Now,
        unknowns: &[Unknown],
        frames: (&[Seen<'a>], &[usize]),
        before: Comparison,
    ) -> Result<(Now, Comparison), CalibrateError> {
        let mut comparison = self.compare(&mut now, frames, &before.lights, 0)?;
        let mut last_moved = 0.0;
        for round in 1..=COMPARISONS {
            let next = now.adjusted_to(unknowns, &comparison.observations)?;
            let moved = next.moved_sigmas(&now, unknowns);
            now = next;
            if rests(moved, last_moved) {
                break;
            }
            if round == COMPARISONS {
                comparison.unrest_sigmas = moved;
                break;
            }
            last_moved = moved;
            comparison = self.compare(&mut now, frames, &comparison.lights, round)?;
        }
        Ok((now, comparison))
    }
}

/// What frames lead to.
struct Fit {
    now: Now,
    unknowns: Vec<Unknown>,
    comparison: Comparison,
    held_out: Option<HeldOut>,
}

impl Fit {
    fn of(now: Now, unknowns: Vec<Unknown>, comparison: Comparison, frames: usize) -> Result<Self, CalibrateError> {
        let held_out = held_out(&unknowns, &now, &comparison.observations, frames)?;
        Ok(Self { now, unknowns, comparison, held_out })
    }
}

/// Whether unknowns that moved by so many of their deviations, and before by so many, will hardly move any more: each step is
/// about as much shorter than the one before as that was.
fn rests(moved: f64, last_moved: f64) -> bool {
    moved < RESTING_SIGMAS || moved < NEAR_SIGMAS && moved * moved < FORESEEN_SIGMAS * last_moved
}

/// Whether a frame is one of those that go ahead, which are spread evenly over all.
pub(crate) fn is_leader(frame: usize, frames: usize) -> bool {
    frames <= LEADERS || frame * LEADERS % frames < LEADERS
}

fn bytes(frame: &Frame) -> usize {
    frame.pages().iter().map(|page| 2 * page.len()).sum()
}

impl CalibrateError {
    pub(crate) fn no_frames(faults: &[Fault]) -> Self {
        match faults.first() {
            Some((_, fault)) => Self::NoFrames(fault.clone()),
            None => Self::Undetermined("there are none"),
        }
    }
}
