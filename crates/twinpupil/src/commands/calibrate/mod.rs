//! `twinpupil calibrate`: frames of a dot grid → an instrument whose numbers are known, and how well.

mod axis;
mod corrected;
mod correlations;
mod measured;
mod page;
mod plots;
mod residuals;
mod summary;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use anyhow::{Context, Result, anyhow, bail};
use clap::Subcommand;
use sha2::{Digest, Sha256};
use twinpupil_calibrate::{
    Calibration, Calibrator, Choices, CorrectionChoice, Fault, Foreign, FrameResult, Stage, StagePosition, Target,
};
use twinpupil_instrument::{CalibrationFrame, CalibrationSpec, Instrument, Lens};
use twinpupil_reconstruct::{DetectOptions, Mode, Options, Reconstructor};

use self::page::Findings;
use self::summary::Summary;
use super::destination::pretty;
use super::options::PolarityOption;
use crate::console::Console;
use crate::io::files::FrameFiles;
use crate::io::frame::FrameFormat;
use crate::io::input;
use crate::io::output::{self, Outputs};
use crate::io::stage::read_stage;
use crate::load::LoadedInstrument;

/// `twinpupil calibrate …`.
#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    grid: GridArgs,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Find the optical axis from any frames of dots, for masks where the instrument file has them
    ///
    /// The line through both images of a dot goes through the axis if the masks are centred, else through where the line
    /// through both masks' centres meets the sensor. The axis is corrected for `centre_mm` of the instrument file; what
    /// those leave uncertain is stated beside the noise: 0.2 mm each, or what `[calibration]` says of them. Frames that the
    /// instrument does not explain are refused.
    Axis(axis::Args),
}

/// Calibration from a dot grid.
#[derive(Debug, clap::Args)]
struct GridArgs {
    /// Frames of the target, each in another pose: PNG or TIFF, an ENVI header, or one file for each sensor
    #[arg(required = true, value_name = "FRAME")]
    frames: Vec<PathBuf>,
    /// Instrument file with the data sheet, or the name of one that ships, such as `paper`
    #[arg(long, value_name = "FILE", required = true)]
    instrument: Option<PathBuf>,
    /// Target file, as `twinpupil target dot-grid --file` writes it
    #[arg(long, value_name = "FILE", required = true)]
    target: Option<PathBuf>,
    /// Calibrated instrument file to write; standard output if left out
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Report to write: one HTML page with every number, residual and plot
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Hold a number fast at what the instrument file says, such as `sensor.tilt_deg[0]`; may be repeated
    #[arg(long, value_name = "KEY")]
    fix: Vec<String>,
    /// Standard deviation of what the instrument file says, KEY=STD in the unit of the key; may be repeated
    #[arg(long, value_name = "KEY=STD", value_parser = key_and_std)]
    prior: Vec<(String, f64)>,
    /// Also seek the places of the target's dots, known to this standard deviation in mm
    #[arg(long, value_name = "STD")]
    refine_target_mm: Option<f64>,
    /// Whether to correct what the numbers leave by a smooth field in every band: only if that lowers the error of frames held
    /// out by more than chance, or never
    #[arg(long, value_enum, default_value_t = CorrectionOption::Off)]
    correction: CorrectionOption,
    /// What a stage says that carried the middle of the target along a straight way: CSV with frame, travel_mm and std_mm;
    /// the frames that it does not name stood elsewhere
    #[arg(long, value_name = "FILE")]
    stage: Option<PathBuf>,
    /// Whether dots are bright or dark
    #[arg(long, value_enum, default_value_t = PolarityOption::Auto)]
    polarity: PolarityOption,
    /// Print a summary as JSON; needs -o
    #[arg(long, requires = "output")]
    json: bool,
}

/// `--correction`.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum CorrectionOption {
    Auto,
    Off,
}

fn key_and_std(text: &str) -> Result<(String, f64), String> {
    let (key, std) = text.split_once('=').ok_or("legal: KEY=STD, such as sensor.distance_mm=0.5")?;
    match std.trim().parse::<f64>() {
        Ok(std) if std.is_finite() && std > 0.0 => Ok((key.trim().to_owned(), std)),
        _ => Err(format!("{std} is no standard deviation; legal: a number above 0")),
    }
}

/// Runs `twinpupil calibrate`.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    match (&args.command, &args.grid) {
        (Some(Command::Axis(args)), _) => axis::run(args, console),
        (None, GridArgs { instrument: Some(instrument), target: Some(target), .. }) => {
            calibrate(&args.grid, instrument, target, console)
        }
        (None, _) => bail!("--instrument and --target are missing"),
    }
}

fn calibrate(args: &GridArgs, instrument: &Path, target: &Path, console: &Console) -> Result<()> {
    let loaded = LoadedInstrument::load(instrument, console)?;
    let target = Target::from_toml(&input::read_text(target)?).with_context(|| target.display().to_string())?;
    for path in args.output.iter().chain(&args.report) {
        output::check(path)?;
    }
    if let Some(std_mm) = args.refine_target_mm.filter(|std_mm| !(*std_mm > 0.0 && *std_mm < target.spec().pitch_mm)) {
        bail!("--refine-target-mm is {std_mm}; legal: above 0 and below the pitch of {} mm", target.spec().pitch_mm);
    }
    let format = FrameFormat::of_instrument(&loaded.instrument);
    let files = FrameFiles::of_arguments(&args.frames, &format)?;
    let choices = choices(args)?;
    let stage = args.stage.as_deref().map_or_else(|| Ok(Vec::new()), |path| read_stage(path, &files))?;
    let calibration =
        Run { loaded: &loaded, target: &target, choices: &choices, stage: &stage, files: &files, format: &format }
            .calibrate(args, console)?;

    let instrument = with_calibration(&calibration, &target, &files)?;
    let mut outputs = Outputs::new();
    outputs.add_or_print(args.output.as_deref(), instrument.to_toml().into_bytes());
    if let Some(path) = &args.report {
        let frames: Vec<String> = files.iter().map(|files| files.name.clone()).collect();
        let findings =
            Findings { calibration: &calibration, instrument: &instrument, target: &target, frames: &frames };
        outputs.add(path, page::page(&findings).into_html().into_bytes());
    }
    outputs.commit()?;
    let summary = Summary::new(&calibration, &instrument, &target, &files);
    summary.lines().iter().for_each(|line| console.note(line));
    if args.json { output::write_stdout(pretty(&summary)?.as_bytes()) } else { Ok(()) }
}

fn choices(args: &GridArgs) -> Result<Choices> {
    let mut prior_std: BTreeMap<String, f64> = args.prior.iter().cloned().collect();
    for key in &args.fix {
        if prior_std.insert(key.clone(), 0.0).is_some() {
            bail!("`{key}` is both fixed and given a deviation; legal: one of the two");
        }
    }
    let correction = match args.correction {
        CorrectionOption::Auto => CorrectionChoice::Auto,
        CorrectionOption::Off => CorrectionChoice::Off,
    };
    Ok(Choices { prior_std, correction })
}

/// Everything that a calibration reads.
struct Run<'a> {
    loaded: &'a LoadedInstrument,
    target: &'a Target,
    choices: &'a Choices,
    stage: &'a [Option<StagePosition>],
    files: &'a [FrameFiles],
    format: &'a FrameFormat,
}

impl Run<'_> {
    fn calibrate(&self, args: &GridArgs, console: &Console) -> Result<Calibration> {
        let detect = DetectOptions { polarity: args.polarity.polarity(), ..DetectOptions::default() };
        let response = self.loaded.response_matrix()?;
        let reader = |instrument: &Instrument, mode: Mode| -> Result<Reconstructor, Foreign> {
            Ok(reader(instrument, mode, detect)?.unmixing(&response))
        };
        let frame = |index: usize| {
            let frame = self.files[index].read(self.format).map_err(|error| Unreadable(one_line(&error)))?;
            Ok(Cow::Owned(frame))
        };
        let bar = console.progress(self.files.len() as u64, "finding the target");
        let stage = Mutex::new(Stage::Finding);
        let progress = |now: Stage| {
            if let Ok(mut stage) = stage.lock() {
                if *stage != now {
                    *stage = now;
                    bar.reset();
                    bar.set_message("comparing with the pixels");
                }
                bar.inc(1);
            }
        };
        let calibrator = Calibrator {
            instrument: &self.loaded.instrument,
            target: self.target,
            choices: self.choices,
            place_std_mm: args.refine_target_mm,
            stage: self.stage,
            reader: &reader,
            frame: &frame,
            progress: &progress,
        };
        let calibration = calibrator.calibrate(self.files.len());
        bar.finish_and_clear();
        calibration.map_err(|error| match (error, self.files) {
            (twinpupil_calibrate::CalibrateError::NoFrames(fault), [only]) => anyhow!("{}: {fault}", only.name),
            (error, _) => error.into(),
        })
    }
}

/// A frame that cannot be read, as one line.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Unreadable(String);

fn one_line(error: &anyhow::Error) -> String {
    format!("{error:#}")
}

/// Makes an instrument ready to read frames; an ideal lens adds nothing to first order.
pub(super) fn reader(instrument: &Instrument, mode: Mode, detect: DetectOptions) -> Result<Reconstructor> {
    let table = match instrument.lens {
        Lens::Thin(_) => None,
        Lens::Fresnel(_) | Lens::Prescription(_) => Some(twinpupil_optics::response_table_for(instrument)?),
    };
    let options = Options { mode, detect, ..Options::default() };
    Ok(Reconstructor::new(instrument.clone(), table, options))
}

/// The calibrated instrument with all that is known of its numbers.
fn with_calibration(calibration: &Calibration, target: &Target, files: &[FrameFiles]) -> Result<Instrument> {
    let frame = |result: &FrameResult| {
        let files = &files[result.frame];
        Ok(CalibrationFrame {
            file: files.name.clone(),
            sha256: sha256(files.paths())?,
            distance_mm: rounded(result.pose.translation_mm.z, 4),
            tilt_deg: rounded(result.pose.tilt_rad().to_degrees(), 4),
            rms_px: rounded(result.rms_px, 6),
        })
    };
    let mut spec = calibration.instrument.clone().into_spec();
    let date = chrono::Utc::now().format("%Y-%m-%d").to_string();
    let frames = calibration.frames.iter().map(frame).collect::<Result<_>>()?;
    let stated = calibration.to_spec(date, target.spec().name.clone(), frames);
    spec.calibration = Some(CalibrationSpec {
        rms_px: rounded(stated.rms_px, 6),
        reduced_chi2: rounded(stated.reduced_chi2, 4),
        ..stated
    });
    Instrument::new(spec).context("the calibrated instrument")
}

fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = 10_f64.powi(decimals);
    (value * scale).round() / scale
}

/// Hash of the files of a frame, one after the other.
fn sha256(paths: &[PathBuf]) -> Result<String> {
    let mut hash = Sha256::new();
    for path in paths {
        hash.update(input::read_bytes(path)?);
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Names of the frames that were left out, each with its reason.
fn faults(faults: &[Fault], files: &[FrameFiles]) -> Vec<String> {
    faults.iter().map(|(frame, fault)| format!("{}: left out: {fault}", files[*frame].name)).collect()
}
