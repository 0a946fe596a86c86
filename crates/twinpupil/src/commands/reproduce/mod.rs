//! `twinpupil reproduce`: the paper as a command.

mod exposures;
mod page;
mod plots;
mod series;
mod text;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use serde::Serialize;

use self::exposures::Exposures;
use super::destination::pretty;
use super::simulate::samples;
use crate::console::Console;
use crate::experiments::{Comparison, LensModel, Rig, Study, choices};
use crate::io::folder::FolderOutputs;
use crate::io::output;

/// `twinpupil reproduce …`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder for the report and the series behind its plots
    #[arg(short, long, value_name = "FOLDER", default_value = "twinpupil-reproduce")]
    output: PathBuf,
    /// Seed of the plate's dots and of the sensor's noise
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(..1 << 32))]
    seed: u64,
    /// Rays over the pupil for every pixel and band, thin lens; the Fresnel lens, which costs more, gets a quarter
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = samples)]
    samples: usize,
    /// Distances in steps of 50 mm instead of 10 mm
    #[arg(long)]
    quick: bool,
    /// Print the table as JSON
    #[arg(long)]
    json: bool,
}

/// Steps of distance, mm.
const STEP_MM: u32 = 10;
const QUICK_STEP_MM: u32 = 50;

/// The Fresnel lens gets one ray for so many of the thin lens.
const FRESNEL_SHARE: usize = 4;

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary<'a> {
    columns: [String; 3],
    comparison: &'a Comparison,
    choices: &'a [String],
    folder: String,
    files: Vec<&'static str>,
    seconds: f64,
}

/// Runs `twinpupil reproduce`.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let start = Instant::now();
    let mut files = FolderOutputs::new(&args.output)?;
    let step_mm = if args.quick { QUICK_STEP_MM } else { STEP_MM };
    let thin = Rig::new(LensModel::Thin, args.samples)?;
    let fresnel = Rig::new(LensModel::Fresnel, args.samples.div_ceil(FRESNEL_SHARE))?;

    let exposures = Exposures::take(&thin, &fresnel, step_mm, args.seed, console)?;
    let study = Study::new(&exposures.readings)?;
    let comparison = Comparison::new(&study);
    let choices = choices::choices(&thin, &fresnel, step_mm, args.seed);

    series::add(&mut files, &study)?;
    files.add("comparison.csv", series::comparison(&comparison).to_csv());
    let page = page::page(&exposures, &study, &comparison, &choices)?;
    files.add("report.html", page.into_html().into_bytes());
    let (names, report) = (files.names(), files.path("report.html"));
    files.commit()?;

    let seconds = start.elapsed().as_secs_f64();
    console.note(format!("{} and the series behind its plots, {seconds:.0} s", report.display()));
    let text = if args.json {
        let columns = crate::experiments::Case::REPRODUCED.map(|case| case.id().to_owned());
        let folder = args.output.display().to_string();
        pretty(&Summary { columns, comparison: &comparison, choices: &choices, folder, files: names, seconds })?
    } else {
        text::table(&comparison, &choices)
    };
    output::write_stdout(text.as_bytes())
}
