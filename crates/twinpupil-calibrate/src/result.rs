//! What a calibration comes to.

use nalgebra::{DMatrix, Matrix4, Vector4};
use twinpupil_instrument::{CalibrationFrame, CalibrationSpec, Instrument, Parameter, Role};

use crate::adjust::{Observation, OnWay, Problem, Weighing};
use crate::advice::advice;
use crate::calibrate::{CalibrateError, Fault};
use crate::compare::Fitness;
use crate::correction::CorrectionFinding;
use crate::forward::{CAMERA_SLOTS, Slot, spot};
use crate::known::Contradiction;
use crate::lattice::median;
use crate::now::Now;
use crate::pose::Pose;
use crate::seen::Seen;
use crate::target::Target;
use crate::unknown::{Quantity, Unknown};
use crate::unseen::unseen_lines;

/// An instrument as its frames tell it.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// The instrument, at its calibrated numbers.
    pub instrument: Instrument,
    /// Every number that was sought.
    pub numbers: Vec<Number>,
    /// Covariance of those, in the squares of their units.
    pub covariance: DMatrix<f64>,
    /// Every frame that was used.
    pub frames: Vec<FrameResult>,
    /// Those that were not, and why.
    pub faults: Vec<Fault>,
    /// How every spot lies beside where it should.
    pub residuals: Vec<Residual>,
    /// Where the target's dots lie beside their places, mm, if that was sought.
    pub offsets_mm: Option<Vec<[f64; 2]>>,
    /// χ² of the places of all spots over their degrees of freedom.
    pub reduced_chi2: f64,
    /// Root mean square distance of the spots from where they should be, px.
    pub rms_px: f64,
    /// What frames that took no part in a calibration say of it; `None` of a single frame.
    pub held_out: Option<HeldOut>,
    /// What was found of a smooth correction, if one was tried.
    pub correction: Option<CorrectionFinding>,
    /// How far the last step still moved the numbers, in deviations; 0 if they came to rest.
    pub unrest_sigmas: f64,
    /// What was held or given a deviation beforehand and is not what the frames say.
    pub contradictions: Vec<Contradiction>,
    /// What would make it better, in sentences.
    pub advice: Vec<String>,
}

/// A number that was sought.
#[derive(Debug, Clone, PartialEq)]
pub struct Number {
    /// What it is.
    pub quantity: Quantity,
    /// Its key in the instrument file, or `target.dot_diameter_scale`.
    pub key: String,
    /// What the instrument file said, and within what tolerance.
    pub expected: f64,
    /// See [`Self::expected`].
    pub tolerance: f64,
    /// What the frames say.
    pub value: f64,
    /// Its standard deviation.
    pub std: f64,
    /// Why the frames do not determine it, if so.
    pub left_open: Option<LeftOpen>,
}

/// Why frames do not determine a number.
#[derive(Debug, Clone, PartialEq)]
pub enum LeftOpen {
    /// Their images hardly depend on it.
    Unseen,
    /// A change of another number does about the same to them.
    Tied {
        /// The key of the other.
        with: String,
        /// Correlation with it.
        correlation: f64,
    },
}

/// A frame that was used.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameResult {
    /// Its index.
    pub frame: usize,
    /// Where the target stood.
    pub pose: Pose,
    /// Deviations of the turns (rad) and shifts (mm) of the pose.
    pub pose_std: [f64; 6],
    /// Spots that were compared, in all bands.
    pub spots: usize,
    /// Root mean square distance of the spots from where they should be, px.
    pub rms_px: f64,
    /// χ² of the frame's pixels about the forward model over their number.
    pub pixel_chi2: f64,
    /// How far the target stands beside where the stage says, if it says so.
    pub off_stage: Option<OffStage>,
}

/// How far the target stands beside where a stage says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffStage {
    /// Along x, y and z.
    pub off_mm: [f64; 3],
    /// Root mean square of the three in the stage's deviations.
    pub sigmas: f64,
}

/// A spot and where it should be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Index of the frame.
    pub frame: usize,
    /// Index of the band.
    pub band: usize,
    /// Index of the target's dot.
    pub dot: usize,
    /// Where the calibrated instrument sees the dot: u, v, radius and blur, px.
    pub foreseen_px: [f64; 4],
    /// How far the pixels would have that moved, px.
    pub off_px: [f64; 4],
    /// Deviations of [`Self::off_px`], px.
    pub std_px: [f64; 4],
    /// χ² of the four.
    pub chi2: f64,
    /// Whether it is so far from the others that it hardly counts.
    pub is_doubted: bool,
    /// Whether the masks take some of its light.
    pub is_cut: bool,
    /// Where the dot is, mm.
    pub position_mm: [f64; 3],
}

impl Residual {
    /// Squares of u and v in their deviations.
    fn place_chi2(&self) -> f64 {
        let told = [0, 1].into_iter().filter(|k| self.std_px[*k] > 0.0);
        told.map(|k| (self.off_px[k] / self.std_px[k]).powi(2)).sum()
    }
}

/// What frames say that took no part. Dots count by how well they show depth, which those near the axis do not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldOut {
    /// Root mean square error of the depth of their dots about the target's plane, mm.
    pub z_rms_mm: f64,
    /// The same of the frames that took part, mm.
    pub z_rms_within_mm: f64,
    /// Dots.
    pub dots: usize,
}

/// What a calibration is concluded from.
pub(crate) struct Conclusion<'a> {
    /// The data sheet.
    pub(crate) instrument: &'a Instrument,
    pub(crate) target: &'a Target,
    pub(crate) unknowns: &'a [Unknown],
    pub(crate) now: &'a Now,
    pub(crate) seen: &'a [Seen<'a>],
    pub(crate) faults: Vec<Fault>,
    pub(crate) observations: &'a [Observation],
    pub(crate) fitness: &'a [Fitness],
    pub(crate) unrest_sigmas: f64,
    pub(crate) held_out: Option<HeldOut>,
    pub(crate) correction: Option<CorrectionFinding>,
    pub(crate) contradictions: Vec<Contradiction>,
}

/// Parts of the frames that are held out one after the other, at most.
pub(crate) const PARTS_MAX: usize = 10;

/// A number is left open if the frames leave this share of its tolerance: of several that only together are told, each is
/// held by those of the others, and keeps about half of its own.
const OPEN_SHARE: f64 = 0.3;

/// What the modelled light is off by in all frames alike, in parts of its blur: more of them make it no better. Of 12
/// calibrations with 4096 rays a pixel, the radii of the masks were off by 2.0e-5 and 2.6e-5 of them on the average.
const COMMON_BLUR_SHARE: f64 = 2.3e-5;

/// Variance that the model of light leaves a number, whatever the frames: blur grows with the masks' radii.
fn model_variance(unknown: &Unknown, instrument: &Instrument) -> f64 {
    match unknown.quantity {
        Quantity::Instrument(radius @ Parameter::ZoneRadius(..)) => {
            (COMMON_BLUR_SHARE * radius.value(instrument)).powi(2)
        }
        _ => 0.0,
    }
}

impl Calibration {
    pub(crate) fn conclude(conclusion: Conclusion<'_>) -> Result<Self, CalibrateError> {
        let Conclusion { instrument, target, unknowns, now, seen, observations, fitness, .. } = conclusion;
        let problem = now.problem(unknowns, observations, Weighing::BY_NOISE);
        let residuals = residuals(&problem, now, seen, (unknowns, observations, fitness));
        // Of places alone: size and blur count for less than they are known to.
        let sound = || residuals.iter().filter(|residual| !residual.is_doubted);
        let chi2: f64 = sound().map(Residual::place_chi2).sum();
        let freedom = (2 * sound().count()).saturating_sub(unknowns.len() + 6 * seen.len()).max(1);
        let reduced_chi2 = chi2 / freedom as f64;
        // Beyond what they are weighed by already.
        let excess = (reduced_chi2 / now.adjusted.misfit).max(1.0);
        let count = unknowns.len();
        let scale = |i: usize, k: usize| unknowns[i].prior_std * unknowns[k].prior_std * excess;
        let told = |i: usize, k: usize| now.adjusted.covariance[(i, k)] * scale(i, k);
        let alike = |i: usize, k: usize| if i == k { model_variance(&unknowns[i], instrument) } else { 0.0 };
        let covariance = DMatrix::from_fn(count, count, |i, k| told(i, k) + alike(i, k));
        let data = problem.information_of_each(&now.adjusted.state);
        let numbers = numbers(instrument, unknowns, now, &covariance, &data);
        let frames: Vec<FrameResult> = (0..seen.len())
            .map(|place| {
                let result = frame_result(place, now, seen, &residuals, (observations, fitness), excess);
                FrameResult { off_stage: off_stage(&problem, now, place), ..result }
            })
            .collect();
        let mut calibration = Self {
            instrument: now.instrument.clone(),
            numbers,
            covariance,
            frames,
            faults: conclusion.faults,
            rms_px: rms_px(&residuals, |_| true),
            residuals,
            offsets_mm: now.dots.place_std_mm.map(|_| now.adjusted.state.offsets_mm.clone()),
            reduced_chi2,
            held_out: conclusion.held_out,
            correction: conclusion.correction,
            unrest_sigmas: conclusion.unrest_sigmas,
            contradictions: conclusion.contradictions,
            advice: Vec::new(),
        };
        calibration.advice = unseen_lines(now, seen, target);
        calibration.advice.extend(advice(&calibration, target));
        Ok(calibration)
    }

    /// What the instrument file keeps of it: every number of the instrument with its deviation and correlations.
    pub fn to_spec(&self, date: String, target: String, frames: Vec<CalibrationFrame>) -> CalibrationSpec {
        let own: Vec<usize> = (0..self.numbers.len())
            .filter(|index| matches!(self.numbers[*index].quantity, Quantity::Instrument(_)))
            .collect();
        let std: Vec<f64> = own.iter().map(|index| self.numbers[*index].std).collect();
        let row = |row: usize| {
            let correlation = |column: usize| {
                let covariance = self.covariance[(own[row], own[column])];
                if row == column { 1.0 } else { (covariance / (std[row] * std[column])).clamp(-1.0, 1.0) }
            };
            (0..=row).map(correlation).collect()
        };
        CalibrationSpec {
            date,
            target,
            rms_px: self.rms_px,
            reduced_chi2: self.reduced_chi2,
            parameters: own.iter().map(|index| self.numbers[*index].key.clone()).collect(),
            correlation: (0..own.len()).map(row).collect(),
            std,
            frames,
        }
    }

    /// The numbers that were sought but the coefficients of a correction, with their places among all.
    pub fn named(&self) -> impl Iterator<Item = (usize, &Number)> {
        self.numbers.iter().enumerate().filter(|(_, number)| !number.quantity.is_coefficient())
    }

    /// Spots that hardly count, so far are they from where they should be beside the others.
    pub fn doubted(&self) -> impl Iterator<Item = &Residual> {
        self.residuals.iter().filter(|residual| residual.is_doubted)
    }

    /// A number by its key.
    pub fn number(&self, key: &str) -> Option<&Number> {
        self.numbers.iter().find(|number| number.key == key)
    }
}

fn residuals(
    problem: &Problem<'_>,
    now: &Now,
    seen: &[Seen<'_>],
    (unknowns, observations, fitness): (&[Unknown], &[Observation], &[Fitness]),
) -> Vec<Residual> {
    let state = &now.adjusted.state;
    let doubt_chi2 = now.weighing(unknowns, observations, state).doubt_chi2;
    let residual = |(observation, fitness): (&Observation, &Fitness)| {
        let Observation { frame, band, dot, .. } = *observation;
        let image = problem.image(band, dot, &now.cameras, state, &state.poses[frame]);
        let off = observation.change - (image - observation.anchor);
        let chi2 = observation.chi2(&image);
        Residual {
            frame: seen[frame].frame,
            band,
            dot,
            foreseen_px: image.into(),
            off_px: off.into(),
            std_px: observation.variances_px2().map(f64::sqrt).into(),
            chi2,
            is_doubted: chi2 > doubt_chi2,
            is_cut: fitness.is_cut,
            position_mm: state.dot_mm(&now.dots, frame, dot).into(),
        }
    };
    observations.iter().zip(fitness).map(residual).collect()
}

/// Root mean square of how far spots lie beside where they should, of those that are sought and not doubted.
fn rms_px(residuals: &[Residual], is_sought: impl Fn(&Residual) -> bool) -> f64 {
    let sound = residuals.iter().filter(|residual| !residual.is_doubted && is_sought(residual));
    let squares: Vec<f64> = sound.map(|Residual { off_px: [u, v, ..], .. }| u * u + v * v).collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

fn numbers(
    instrument: &Instrument,
    unknowns: &[Unknown],
    now: &Now,
    covariance: &DMatrix<f64>,
    data: &[f64],
) -> Vec<Number> {
    let number = |(k, unknown): (usize, &Unknown)| {
        let std = covariance[(k, k)].sqrt();
        let key = |quantity: Quantity| quantity.key(instrument);
        let alone = if data[k] > 0.0 { data[k].sqrt().recip() } else { f64::INFINITY };
        let left_open = if std < OPEN_SHARE * unknown.prior_std || unknown.quantity.is_coefficient() {
            None
        } else if alone > OPEN_SHARE {
            Some(LeftOpen::Unseen)
        } else {
            let correlation = |other: usize| covariance[(k, other)] / (std * covariance[(other, other)].sqrt());
            let others = (0..unknowns.len()).filter(|other| *other != k);
            let strongest = others.max_by(|a, b| correlation(*a).abs().total_cmp(&correlation(*b).abs()));
            strongest
                .map(|other| LeftOpen::Tied { with: key(unknowns[other].quantity), correlation: correlation(other) })
        };
        Number {
            quantity: unknown.quantity,
            key: key(unknown.quantity),
            expected: unknown.expected,
            tolerance: unknown.prior_std,
            value: now.adjusted.state.values[k],
            std,
            left_open,
        }
    };
    unknowns.iter().enumerate().map(number).collect()
}

fn frame_result(
    place: usize,
    now: &Now,
    seen: &[Seen<'_>],
    residuals: &[Residual],
    (observations, fitness): (&[Observation], &[Fitness]),
    excess: f64,
) -> FrameResult {
    let frame = seen[place].frame;
    let own = || residuals.iter().filter(|residual| residual.frame == frame);
    let fits = observations.iter().zip(fitness).filter(|(observation, _)| observation.frame == place);
    let (chi2, used_px) = fits.fold((0.0, 0), |(chi2, used), (_, fit)| (chi2 + fit.chi2, used + fit.used_px));
    let covariance = &now.adjusted.pose_covariances[place];
    FrameResult {
        frame,
        pose: now.adjusted.state.poses[place],
        pose_std: std::array::from_fn(|k| (covariance[(k, k)] * excess).max(0.0).sqrt()),
        spots: own().count(),
        rms_px: rms_px(residuals, |residual| residual.frame == frame),
        pixel_chi2: chi2 / used_px.max(1) as f64,
        off_stage: None,
    }
}

fn off_stage(problem: &Problem<'_>, now: &Now, place: usize) -> Option<OffStage> {
    let OnWay { off_mm, position, .. } = problem.on_way(&now.adjusted.state, place)?;
    Some(OffStage { off_mm: off_mm.into(), sigmas: off_mm.norm() / position.std_mm / 3.0_f64.sqrt() })
}

/// Calibrates again without a part of the frames, and finds how the depth of their dots fits the target's plane.
pub(crate) fn held_out(
    unknowns: &[Unknown],
    now: &Now,
    observations: &[Observation],
    frames: usize,
) -> Result<Option<HeldOut>, CalibrateError> {
    if frames < 2 {
        return Ok(None);
    }
    let parts = frames.min(PARTS_MAX);
    let mut errors = Vec::new();
    for part in 0..parts {
        let split = |is_own: bool| -> Vec<Observation> {
            observations.iter().filter(|observation| (observation.frame % parts == part) == is_own).copied().collect()
        };
        let others = now.adjusted_to(unknowns, &split(false))?;
        // The poses of the frames that were left out, as that instrument sees them.
        let own = split(true);
        let posed = others.adjusted_to(&[], &own)?;
        errors.extend(depth_errors(&posed, &own));
    }
    let within = depth_errors(now, observations);
    Ok(Some(HeldOut { z_rms_mm: rms_mm(&errors), z_rms_within_mm: rms_mm(&within), dots: errors.len() }))
}

/// How far a dot seems before or behind the target, and what noise makes of that, mm.
struct DepthError {
    z_mm: f64,
    std_mm: f64,
}

impl DepthError {
    fn sigmas(&self) -> f64 {
        self.z_mm.abs() / self.std_mm
    }
}

/// Root mean square error, weighted by what noise leaves of each.
fn rms_mm(errors: &[DepthError]) -> f64 {
    let chi2: f64 = errors.iter().map(|error| error.sigmas().powi(2)).sum();
    let weights: f64 = errors.iter().map(|error| error.std_mm.powi(-2)).sum();
    if errors.is_empty() { 0.0 } else { (chi2 / weights).sqrt() }
}

/// Information and score of a dot's place and diameter, from all bands that show it. Apart from the loop over dots: within it, in
/// a crate of one unit, the compiler gets the score wrong.
fn dot_equations(problem: &Problem<'_>, now: &Now, own: &[&Observation]) -> (Matrix4<f64>, Vector4<f64>) {
    let state = &now.adjusted.state;
    let (mut information, mut score) = (Matrix4::zeros(), Vector4::zeros());
    for observation in own {
        let pose = &state.poses[observation.frame];
        let (slots, view) = problem.look(observation.band, observation.dot, &now.cameras, state, pose);
        let (image, gradient) = spot(&slots, &view);
        let mut to_dot = Matrix4::zeros();
        to_dot.fixed_columns_mut::<3>(0).copy_from(&gradient.fixed_columns::<3>(CAMERA_SLOTS + 3));
        to_dot.set_column(3, &gradient.column(Slot::Diameter as usize));
        information += to_dot.transpose() * observation.information * to_dot;
        score += to_dot.transpose() * (observation.score - observation.information * (image - observation.anchor));
    }
    (information, score)
}

/// How far every dot that the pair of bands shows seems before or behind the target, mm, if its place and diameter are
/// unknown.
fn depth_errors(now: &Now, observations: &[Observation]) -> Vec<DepthError> {
    let problem = now.problem(&[], observations, Weighing::BY_NOISE);
    let bands = [Role::Telecentric, Role::Entocentric].map(|role| now.instrument.band_index(role));
    let mut errors = Vec::new();
    let mut rest: Vec<&Observation> = observations.iter().collect();
    rest.sort_by_key(|observation| (observation.frame, observation.dot));
    for own in rest.chunk_by(|a, b| (a.frame, a.dot) == (b.frame, b.dot)) {
        if !bands.iter().all(|band| own.iter().any(|observation| observation.band == *band)) {
            continue;
        }
        let (information, score) = dot_equations(&problem, now, own);
        if let Some(factor) = information.cholesky() {
            errors.push(DepthError { z_mm: factor.solve(&score).z, std_mm: factor.inverse()[(2, 2)].sqrt() });
        }
    }
    // A few wrong dots are no error of the calibration.
    const WRONG: f64 = 20.0;
    let typical = median(errors.iter().map(DepthError::sigmas)).max(1e-9);
    errors.retain(|error| error.sigmas() < WRONG * typical);
    errors
}
