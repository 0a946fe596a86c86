//! `twinpupil calibrate axis`: any frames of dots → where the optical axis meets the sensor.

use std::path::PathBuf;

use anyhow::{Context, Result};
use serde::Serialize;
use twinpupil_calibrate::{AxisEstimate, AxisFinder};
use twinpupil_instrument::{Frame, Instrument};
use twinpupil_reconstruct::{DetectOptions, Mode};

use super::super::destination::pretty;
use super::super::options::PolarityOption;
use super::reader;
use crate::console::Console;
use crate::io::files::FrameFiles;
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
    std_px: [f64; 2],
    correlation: f64,
    dots: usize,
    reduced_chi2: f64,
}

/// Runs `twinpupil calibrate axis`.
pub(super) fn run(args: &Args, console: &Console) -> Result<()> {
    let loaded = LoadedInstrument::load(&args.instrument)?;
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
    let line = || {
        let ([u, v], [u_std, v_std]) = (summary.axis_px, summary.std_px);
        format!("axis_px = [{u:.4}, {v:.4}]  # ± {u_std:.4}, {v_std:.4}\n")
    };
    let text = if args.json { pretty(&summary)? } else { line() };
    outputs.add_or_print(None, text.into_bytes());
    outputs.commit()?;
    console.note(format!(
        "from {} dots in {} frames, χ² {:.2} for each degree of freedom",
        summary.dots,
        frames.len(),
        summary.reduced_chi2
    ));
    Ok(())
}

fn summary(estimate: &AxisEstimate) -> Summary {
    let [[uu, uv], [_, vv]] = estimate.covariance_px2;
    Summary {
        axis_px: estimate.axis_px,
        std_px: [uu.sqrt(), vv.sqrt()],
        correlation: uv / (uu * vv).sqrt(),
        dots: estimate.dots,
        reduced_chi2: estimate.reduced_chi2,
    }
}

fn with_axis(instrument: &Instrument, estimate: &AxisEstimate) -> Result<Instrument> {
    let mut spec = instrument.clone().into_spec();
    spec.sensor.axis_px = estimate.axis_px.map(|px| (px * 1e6).round() / 1e6);
    // What was known of the numbers together holds no longer.
    spec.calibration = None;
    Instrument::new(spec).context("the instrument with this axis")
}
