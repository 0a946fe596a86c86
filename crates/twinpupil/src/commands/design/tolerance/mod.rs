//! `twinpupil design tolerance`: many cameras of one design, each off by what its parts may be off by.

mod page;
mod rows;
mod series;
mod summary;
mod text;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use rayon::prelude::*;

use super::super::destination::pretty;
use crate::console::Console;
use crate::design::tolerance::{GRADES, Outcome, Row, Run, RunSpec, Tolerances, grade};
use crate::io::folder::FolderOutputs;
use crate::io::pieces::{Piece, Pieces};
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

/// Rows of a piece: some seconds of work.
const PIECE: usize = 20;

/// The folder of pieces beside the results.
const FOLDER: &str = "pieces";

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
        return merged(args, files, console);
    }
    let spec = spec(args, console)?;
    let run = spec
        .run()
        .with_context(|| args.instrument.as_ref().map_or(String::new(), |path| path.display().to_string()))?;
    let pieces = Pieces::new(&spec, run.rows(), PIECE)?;
    let shard = args.shard.unwrap_or(Shard::WHOLE);
    let folder = args.output.join(FOLDER);
    work(&run, &pieces, shard, &folder, console)?;
    let ready = ready(&pieces, &folder)?;
    if ready.len() < pieces.ranges().len() {
        let (done, all) = (ready.len(), pieces.ranges().len());
        console.note(format!(
            "shard {shard} is done: {done} of {all} pieces are in {}; --merge puts all together",
            folder.display()
        ));
        return Ok(());
    }
    show(args, spec, run, pieces.joined(ready)?, files, console)
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

/// Computes the pieces of a shard that are not there yet.
fn work(run: &Run, pieces: &Pieces, shard: Shard, folder: &Path, console: &Console) -> Result<()> {
    let mut open = Vec::new();
    let mut done = 0;
    for (number, rows) in pieces.ranges().into_iter().enumerate().filter(|(number, _)| shard.holds(*number)) {
        match pieces.load(folder, &rows)? {
            Some(_) => done += rows.len(),
            None => open.push((number, rows)),
        }
    }
    if done > 0 {
        console.note(format!("{done} rows are in {} already", folder.display()));
    }
    if open.is_empty() {
        return Ok(());
    }
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let length = done + open.iter().map(|(_, rows)| rows.len()).sum::<usize>();
    let bar = console.progress(length as u64, "cameras");
    bar.inc(done as u64);
    for (_, rows) in open {
        let row = |row: usize| {
            let computed = run.row(row);
            bar.inc(1);
            computed
        };
        let computed: Vec<Row> = rows.clone().into_par_iter().map(row).collect();
        pieces.store(folder, &rows, &rows::table(run, rows.start, &computed))?;
    }
    bar.finish_and_clear();
    Ok(())
}

/// The pieces of a run that are in a folder.
fn ready(pieces: &Pieces, folder: &Path) -> Result<Vec<Piece>> {
    let load = |rows: &std::ops::Range<usize>| pieces.load(folder, rows).transpose();
    pieces.ranges().iter().filter_map(load).collect()
}

/// Puts pieces from anywhere together.
fn merged(args: &Args, files: FolderOutputs, console: &Console) -> Result<()> {
    let mut paths = Vec::new();
    for path in &args.merge {
        paths.extend(pieces_at(path)?);
    }
    let read = paths.iter().map(|path| Piece::read(path)).collect::<Result<Vec<_>>>()?;
    let Some(first) = read.first() else { bail!("there is no piece to merge") };
    let spec: RunSpec = first.run()?;
    let run = spec.run().context("the run that the pieces are of")?;
    let joined = Pieces::new(&spec, run.rows(), PIECE)?.joined(read)?;
    show(args, spec, run, joined, files, console)
}

/// A file, or the pieces in a folder or in that of its pieces.
fn pieces_at(path: &Path) -> Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let inner = path.join(FOLDER);
    let folder = if inner.is_dir() { inner } else { path.to_owned() };
    let entries = std::fs::read_dir(&folder).with_context(|| folder.display().to_string())?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "parquet"));
    paths.sort();
    if paths.is_empty() {
        bail!("{}: there is no piece of a run in this folder", folder.display());
    }
    Ok(paths)
}

/// Writes and prints what a whole run tells.
fn show(
    args: &Args,
    spec: RunSpec,
    run: Run,
    tables: Vec<(std::ops::Range<usize>, crate::io::read_table::ReadTable)>,
    mut files: FolderOutputs,
    console: &Console,
) -> Result<()> {
    let rows = tables.iter().map(|(_, table)| rows::rows(&run, table)).collect::<Result<Vec<_>>>()?.concat();
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
