//! What `calibrate` tells: lines for a human, JSON for a machine.

use serde::Serialize;
use twinpupil_calibrate::{Calibration, CorrectionFinding, CorrectionTrial, LeftOpen, Number, Target};
use twinpupil_instrument::Instrument;

use super::corrected::decision;
use super::faults;
use super::measured::{measured, stated};
use crate::io::files::{self, FrameFiles};

/// What `--json` prints.
#[derive(Debug, Serialize)]
pub(super) struct Summary {
    instrument: String,
    target: String,
    frames: Vec<FrameSummary>,
    /// Frames that were left out, each with its reason.
    left_out: Vec<String>,
    spots: usize,
    /// Spots so far from where they should be that they hardly count; in neither of the next two.
    doubted_spots: usize,
    rms_px: f64,
    reduced_chi2: f64,
    /// Root mean square depth error of dots in frames that took no part, and of those that did, about the target's plane.
    held_out_z_rms_mm: Option<f64>,
    within_z_rms_mm: Option<f64>,
    /// The numbers of the instrument and the target; coefficients of a correction are in the instrument file.
    numbers: Vec<NumberSummary>,
    /// What was tried of a smooth correction, if anything was.
    correction: Option<CorrectionSummary>,
    advice: Vec<String>,
}

#[derive(Debug, Serialize)]
struct CorrectionSummary {
    is_kept: bool,
    decision: String,
    /// Root mean square error of frames held out over its deviation, without any.
    held_out_error: f64,
    tried: Vec<TrialSummary>,
}

#[derive(Debug, Serialize)]
struct TrialSummary {
    /// Highest order of the terms, and how many numbers were sought for them.
    order: usize,
    coefficients: usize,
    held_out_error: f64,
    /// By how many standard errors χ² of the frames held out falls.
    gain_sigmas: f64,
}

impl CorrectionSummary {
    fn new(finding: &CorrectionFinding) -> Self {
        let trial = |trial: &CorrectionTrial| TrialSummary {
            order: trial.degree,
            coefficients: trial.coefficients,
            held_out_error: trial.error,
            gain_sigmas: trial.gain_sigmas,
        };
        Self {
            is_kept: finding.is_kept(),
            decision: decision(finding),
            held_out_error: finding.error_without,
            tried: finding.trials.iter().map(trial).collect(),
        }
    }

    /// For a human.
    fn line(&self) -> String {
        let trial = |trial: &TrialSummary| {
            format!("order {} {:.2} ({:+.1} standard errors)", trial.order, trial.held_out_error, trial.gain_sigmas)
        };
        let tried: Vec<String> = self.tried.iter().map(trial).collect();
        format!(
            "{}; error over deviation in frames held out: {:.2} without, {}",
            self.decision,
            self.held_out_error,
            tried.join(", ")
        )
    }
}

#[derive(Debug, Serialize)]
struct FrameSummary {
    frame: String,
    distance_mm: f64,
    tilt_deg: f64,
    spots: usize,
    rms_px: f64,
    pixel_chi2: f64,
    /// How far the target stands beside where the stage says, mm, if it says so.
    off_stage_mm: Option<[f64; 3]>,
}

#[derive(Debug, Serialize)]
struct NumberSummary {
    key: String,
    data_sheet: f64,
    tolerance: f64,
    value: f64,
    std: f64,
    /// Why the frames do not determine it, if so.
    left_open: Option<String>,
}

impl Summary {
    pub(super) fn new(
        calibration: &Calibration,
        instrument: &Instrument,
        target: &Target,
        files: &[FrameFiles],
    ) -> Self {
        let frame = |result: &twinpupil_calibrate::FrameResult| FrameSummary {
            frame: files[result.frame].name.clone(),
            distance_mm: result.pose.translation_mm.z,
            tilt_deg: result.pose.tilt_rad().to_degrees(),
            spots: result.spots,
            rms_px: result.rms_px,
            pixel_chi2: result.pixel_chi2,
            off_stage_mm: result.off_stage.map(|off| off.off_mm),
        };
        let number = |number: &Number| NumberSummary {
            key: number.key.clone(),
            data_sheet: number.expected,
            tolerance: number.tolerance,
            value: number.value,
            std: number.std,
            left_open: number.left_open.as_ref().map(reason),
        };
        Self {
            instrument: instrument.name.clone(),
            target: target.spec().name.clone(),
            frames: calibration.frames.iter().map(frame).collect(),
            left_out: faults(&calibration.faults, files),
            spots: calibration.residuals.len(),
            doubted_spots: calibration.doubted().count(),
            rms_px: calibration.rms_px,
            reduced_chi2: calibration.reduced_chi2,
            held_out_z_rms_mm: calibration.held_out.map(|held_out| held_out.z_rms_mm),
            within_z_rms_mm: calibration.held_out.map(|held_out| held_out.z_rms_within_mm),
            numbers: calibration.named().map(|(_, own)| number(own)).collect(),
            correction: calibration.correction.as_ref().map(CorrectionSummary::new),
            advice: calibration.advice.clone(),
        }
    }

    /// For a human.
    pub(super) fn lines(&self) -> Vec<String> {
        let mut lines = self.left_out.clone();
        let doubted = match self.doubted_spots {
            0 => String::new(),
            some => format!(" ({some} hardly count)"),
        };
        lines.push(format!(
            "{}, {} spots{doubted}: {:.4} px rms, χ² {:.2} for each degree of freedom",
            files::frames(self.frames.len()),
            self.spots,
            self.rms_px,
            self.reduced_chi2
        ));
        if let Some(z_rms_mm) = self.held_out_z_rms_mm {
            lines.push(format!("depth of dots in frames that took no part: {:.1} µm rms", 1e3 * z_rms_mm));
        }
        let width = self.numbers.iter().map(|number| number.key.len()).max().unwrap_or(0);
        lines.extend(self.numbers.iter().map(|number| {
            let open = if number.left_open.is_some() { ", not determined" } else { "" };
            let value = measured(number.value, number.std);
            let sheet = stated(number.data_sheet, number.tolerance);
            format!("{:width$}  {value}  (data sheet {sheet}){open}", number.key)
        }));
        lines.extend(self.correction.as_ref().map(CorrectionSummary::line));
        lines.extend(self.advice.iter().map(|advice| format!("advice: {advice}")));
        lines
    }
}

fn reason(left_open: &LeftOpen) -> String {
    match left_open {
        LeftOpen::Unseen => "the frames hardly depend on it".to_owned(),
        LeftOpen::Tied { with, correlation } => format!("tied to {with}, correlation {correlation:.3}"),
    }
}
