//! `twinpupil crosstalk`: flat frames → an instrument that knows its crosstalk.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use serde::Serialize;
use twinpupil_instrument::{CrosstalkSpec, Instrument};
use twinpupil_reconstruct::{CrosstalkEstimate, estimate_crosstalk};

use super::destination::pretty;
use crate::console::Console;
use crate::io::files::FrameFiles;
use crate::io::frame::FrameFormat;
use crate::io::output::{self, Outputs};
use crate::load::LoadedInstrument;

/// `twinpupil crosstalk …`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Flat frames, each lit in one band alone, in the order of the instrument's bands
    #[arg(required = true, value_name = "FLAT")]
    flats: Vec<PathBuf>,
    /// Instrument file, or the name of one that ships, such as `paper`
    #[arg(long, value_name = "FILE")]
    instrument: PathBuf,
    /// A frame without light, in as many files as each flat; the sensor's black level is believed if left out
    #[arg(long, value_name = "FRAME")]
    dark: Vec<PathBuf>,
    /// Instrument file to write, with `[crosstalk]`; standard output if left out
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Print matrix and deviations as JSON; needs -o
    #[arg(long, requires = "output")]
    json: bool,
}

/// What `--json` prints: rows are planes and columns are bands, both in the order of `bands`.
#[derive(Debug, Serialize)]
struct Summary {
    bands: Vec<String>,
    matrix: Vec<Vec<f64>>,
    std: Vec<Vec<f64>>,
}

/// Decimals that are kept: far below any deviation of a flat.
const DECIMALS: i32 = 7;

/// Runs `twinpupil crosstalk`.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let LoadedInstrument { instrument, .. } = LoadedInstrument::load(&args.instrument, console)?;
    if let Some(path) = &args.output {
        output::check(path)?;
    }
    let format = FrameFormat::of_instrument(&instrument);
    let read = |arguments: &[PathBuf]| {
        FrameFiles::of_arguments(arguments, &format)?
            .iter()
            .map(|files| files.read(&format))
            .collect::<Result<Vec<_>>>()
    };
    let (flats, mut darks) = (read(&args.flats)?, read(&args.dark)?);
    let dark = darks.pop();
    if !darks.is_empty() {
        bail!("--dark: there are {} dark frames; legal: one", darks.len() + 1);
    }
    let estimate = estimate_crosstalk(&instrument, &flats, dark.as_ref())?;
    let summary = summary(&instrument, &estimate);
    let text = with_crosstalk(instrument, &summary)?.to_toml();

    let mut outputs = Outputs::new();
    outputs.add_or_print(args.output.as_deref(), text.into_bytes());
    outputs.commit()?;
    lines(&summary).iter().for_each(|line| console.note(line));
    if args.json { output::write_stdout(pretty(&summary)?.as_bytes()) } else { Ok(()) }
}

fn summary(instrument: &Instrument, estimate: &CrosstalkEstimate) -> Summary {
    let scale = 10_f64.powi(DECIMALS);
    let rounded = |value: &f64| (value * scale).round() / scale;
    Summary {
        bands: instrument.bands.iter().map(|band| band.name.clone()).collect(),
        matrix: estimate.matrix.iter().map(|row| row.iter().map(rounded).collect()).collect(),
        std: estimate.std.clone(),
    }
}

/// The instrument with what was measured in place of curves and laws.
fn with_crosstalk(instrument: Instrument, summary: &Summary) -> Result<Instrument> {
    let mut spec = instrument.into_spec();
    spec.spectra = None;
    spec.sensor.extinction_ratio = None;
    spec.crosstalk = Some(CrosstalkSpec { matrix: summary.matrix.clone() });
    Instrument::new(spec).context("the measured crosstalk")
}

/// The summary for a human: one line for every plane that sees a band that is not its own.
fn lines(Summary { bands, matrix, std }: &Summary) -> Vec<String> {
    let others = |plane: usize| (0..bands.len()).filter(move |band| *band != plane);
    let line = |plane: usize, band: usize| {
        let (value, std) = (matrix[plane][band], std[plane][band]);
        format!("the plane of {} sees {value:.6} ± {std:.6} of {}", bands[plane], bands[band])
    };
    (0..bands.len()).flat_map(|plane| others(plane).map(move |band| line(plane, band))).collect()
}
