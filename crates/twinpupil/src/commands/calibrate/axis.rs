//! `twinpupil calibrate axis`: any frames of dots → where the optical axis meets the sensor.

use std::path::PathBuf;

use anyhow::{Context, Result};
use serde::Serialize;
use twinpupil_calibrate::{AxisEstimate, AxisFinder, MaskCentre};
use twinpupil_instrument::{Frame, Instrument};
use twinpupil_reconstruct::{DetectOptions, Mode};

use super::super::destination::pretty;
use super::super::options::PolarityOption;
use super::reader;
use crate::console::Console;
use crate::io::files::{self, FrameFiles};
use crate::io::frame::FrameFormat;
use crate::io::output::{self, Outputs};
use crate::load::LoadedInstrument;

/// `twinpupil calibrate axis …`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Frames of dots that do not move against the camera or do, as they like
    #[arg(required = true, value_name = "FRAME")]
    frames: Vec<PathBuf>,
    /// Instrument file, or the name of one that ships, such as `paper`
    #[arg(long, value_name = "FILE")]
    instrument: PathBuf,
    /// Instrument file to write, with the axis that was found; the axis goes to standard output in any case
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Whether dots are bright or dark
    #[arg(long, value_enum, default_value_t = PolarityOption::Auto)]
    polarity: PolarityOption,
    /// Print the axis as JSON
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary {
    axis_px: [f64; 2],
    /// From noise, for masks where the instrument file has them.
    std_px: [f64; 2],
    correlation: f64,
    /// From the masks' centres, to be added to that.
    mask_std_px: [f64; 2],
    mask_correlation: f64,
    masks: Vec<Mask>,
    holds_for: String,
    dots: usize,
    reduced_chi2: f64,
}

/// A mask whose centre moves the axis.
#[derive(Debug, Serialize)]
struct Mask {
    key: String,
    std_mm: [f64; 2],
    axis_px_per_mm: [[f64; 2]; 2],
}

/// Runs `twinpupil calibrate axis`.
pub(super) fn run(args: &Args, console: &Console) -> Result<()> {
    let loaded = LoadedInstrument::load(&args.instrument, console)?;
    if let Some(path) = &args.output {
        output::check(path)?;
    }
    let format = FrameFormat::of_instrument(&loaded.instrument);
    let files = FrameFiles::of_arguments(&args.frames, &format)?;
    let frames = files.iter().map(|files| files.read(&format)).collect::<Result<Vec<Frame>>>()?;
    let detect = DetectOptions { polarity: args.polarity.polarity(), ..DetectOptions::default() };
    let response = loaded.response_matrix()?;
    let finder = AxisFinder {
        instrument: &loaded.instrument,
        reader: &|instrument| Ok(reader(instrument, Mode::Model, detect)?.unmixing(&response)),
        frames: &frames,
    };
    let estimate = finder.find()?;

    let mut outputs = Outputs::new();
    if let Some(path) = &args.output {
        outputs.add(path, with_axis(&loaded.instrument, &estimate)?.to_toml().into_bytes());
    }
    let summary = summary(&estimate);
    let text = if args.json { pretty(&summary)? } else { lines(&summary) };
    outputs.add_or_print(None, text.into_bytes());
    outputs.commit()?;
    console.note(format!(
        "from {} dots in {}, χ² {:.2} for each degree of freedom",
        summary.dots,
        files::frames(frames.len()),
        summary.reduced_chi2
    ));
    Ok(())
}

fn lines(summary: &Summary) -> String {
    let Summary { axis_px: [u, v], std_px: [u_std, v_std], mask_std_px: [u_mask, v_mask], holds_for, .. } = summary;
    format!(
        "axis_px = [{u:.4}, {v:.4}]  # ± {u_std:.4}, {v_std:.4} from noise, ± {u_mask:.2}, {v_mask:.2} from the masks' centres\n\
         # {holds_for}\n"
    )
}

fn summary(estimate: &AxisEstimate) -> Summary {
    let (std_px, correlation) = std_and_correlation(&estimate.covariance_px2);
    let (mask_std_px, mask_correlation) = std_and_correlation(&estimate.mask_covariance_px2);
    let mask = |mask: &MaskCentre| Mask { key: mask.key(), std_mm: mask.std_mm, axis_px_per_mm: mask.axis_px_per_mm };
    Summary {
        axis_px: estimate.axis_px,
        std_px,
        correlation,
        mask_std_px,
        mask_correlation,
        masks: estimate.masks.iter().map(mask).collect(),
        holds_for: holds_for(&estimate.masks),
        dots: estimate.dots,
        reduced_chi2: estimate.reduced_chi2,
    }
}

/// What the axis holds for, and how much it moves otherwise.
fn holds_for(masks: &[MaskCentre]) -> String {
    const STEP_MM: f64 = 0.01;
    let moves =
        |mask: &MaskCentre| format!("{:.2} px for each {STEP_MM} mm of {}", STEP_MM * mask.px_per_mm_max(), mask.key());
    let moves: Vec<String> = masks.iter().map(moves).collect();
    format!("holds for masks where the instrument file has them; it moves by {}", moves.join(", by "))
}

/// Deviations of u and v and their correlation, none of what is known exactly.
fn std_and_correlation([[uu, uv], [_, vv]]: &[[f64; 2]; 2]) -> ([f64; 2], f64) {
    let std_px = [uu.sqrt(), vv.sqrt()];
    let product = std_px[0] * std_px[1];
    (std_px, if product > 0.0 { uv / product } else { 0.0 })
}

fn with_axis(instrument: &Instrument, estimate: &AxisEstimate) -> Result<Instrument> {
    let mut spec = instrument.clone().into_spec();
    spec.sensor.axis_px = estimate.axis_px.map(|px| (px * 1e6).round() / 1e6);
    // What was known of the numbers together holds no longer.
    spec.calibration = None;
    Instrument::new(spec).context("the instrument with this axis")
}
