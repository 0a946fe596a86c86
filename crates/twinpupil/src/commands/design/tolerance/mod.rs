//! `twinpupil design tolerance`: many cameras of one design, each off by what its parts may be off by.

mod page;
mod rows;
mod series;
mod summary;
mod text;

use std::path::PathBuf;

use anyhow::{Context, Result};

use super::super::destination::pretty;
use super::super::parts;
use crate::console::Console;
use crate::design::tolerance::{GRADES, Outcome, Row, Run, RunSpec, Tolerances, grade};
use crate::io::folder::FolderOutputs;
use crate::io::shard::Shard;
use crate::io::{input, output};
use crate::load::LoadedInstrument;

/// `twinpupil design tolerance …`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Instrument file, or the word `paper`
    #[arg(required_unless_present_any = ["merge", "example"])]
    instrument: Option<PathBuf>,
    /// File of tolerances, or the word `commercial` or `precision`
    #[arg(long, value_name = "FILE", default_value = "commercial")]
    tolerances: PathBuf,
    /// Cameras to build
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    cameras: u32,
    /// What the cameras are drawn from
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Do only the i-th of n parts, so that n machines share the work; put the parts together with --merge
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Put the pieces of a run together: files, or folders that hold them
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with_all = ["instrument", "tolerances", "cameras", "seed", "shard"])]
    merge: Vec<PathBuf>,
    /// Print a file of tolerances to start from, and do nothing else
    #[arg(long, value_name = "GRADE", num_args = 0..=1, default_missing_value = "commercial",
        value_parser = GRADES.map(|(name, _)| name), conflicts_with_all = ["instrument", "merge"])]
    example: Option<String>,
    /// Folder for the report and the tables behind it; pieces that are done wait there in `pieces`
    #[arg(short, long, value_name = "FOLDER", default_value = "twinpupil-tolerance")]
    output: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

/// Everything that is shown.
struct Toleranced {
    name: String,
    spec: RunSpec,
    run: Run,
    rows: Vec<Row>,
    outcome: Outcome,
}

/// Runs `twinpupil design tolerance`.
pub(super) fn run(args: &Args, console: &Console) -> Result<()> {
    if let Some(text) = args.example.as_deref().and_then(grade) {
        return output::write_stdout(text.as_bytes());
    }
    let files = FolderOutputs::new(&args.output)?;
    if !args.merge.is_empty() {
        let (spec, run, rows) = parts::merged(&args.merge)?;
        return show(args, spec, run, rows, files, console);
    }
    let spec = spec(args, console)?;
    let run = spec
        .run()
        .with_context(|| args.instrument.as_ref().map_or(String::new(), |path| path.display().to_string()))?;
    match parts::shared(&spec, &run, args.shard.unwrap_or(Shard::WHOLE), &args.output, console)? {
        Some(rows) => show(args, spec, run, rows, files, console),
        None => Ok(()),
    }
}

/// What makes this run the same run.
fn spec(args: &Args, console: &Console) -> Result<RunSpec> {
    let path = args.instrument.as_deref().context("no instrument is given")?;
    let instrument = LoadedInstrument::load(path, console)?.instrument;
    let word = args.tolerances.to_str().and_then(grade);
    let tolerances = word.map_or_else(|| input::read_text(&args.tolerances), |text| Ok(text.to_owned()))?;
    Tolerances::from_toml(&tolerances).with_context(|| args.tolerances.display().to_string())?;
    Ok(RunSpec {
        instrument: instrument.to_toml(),
        tolerances,
        cameras: args.cameras as usize,
        seed: args.seed,
        version: env!("CARGO_PKG_VERSION").to_owned(),
    })
}

/// Writes and prints what a whole run tells.
fn show(
    args: &Args,
    spec: RunSpec,
    run: Run,
    rows: Vec<Row>,
    mut files: FolderOutputs,
    console: &Console,
) -> Result<()> {
    let outcome = Outcome::of(&run, &rows);
    let toleranced = Toleranced { name: run.trial.drawing.instrument.name.clone(), spec, run, rows, outcome };
    series::add(&mut files, &toleranced)?;
    files.add("report.html", page::page(&toleranced).into_html().into_bytes());
    let (names, report) = (files.names(), files.path("report.html"));
    files.commit()?;
    console.note(format!("{} and the tables behind it", report.display()));
    let text = if args.json { pretty(&summary::Summary::new(&toleranced, names))? } else { text::tables(&toleranced) };
    output::write_stdout(text.as_bytes())
}
