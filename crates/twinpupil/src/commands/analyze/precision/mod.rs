//! `twinpupil analyze precision`: the Cramér–Rao bound over the working volume, and what simulated frames achieve.

mod page;
mod plots;
mod series;
mod summary;
mod text;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use twinpupil_instrument::Instrument;
use twinpupil_reconstruct::Mode;

use self::summary::Summary;
use super::super::destination::pretty;
use super::super::figures::clipping_radius_mm;
use super::super::simulate::samples;
use crate::console::Console;
use crate::io::folder::FolderOutputs;
use crate::io::output;
use crate::load::LoadedInstrument;
use crate::precision::{BoundStudy, DotKind, Examiner, Grid, Place, Sheet, Steps, Tally};

/// `twinpupil analyze precision …`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Instrument file, or the word `paper`
    #[arg(long, value_name = "FILE")]
    instrument: PathBuf,
    /// Depths in mm, FROM:TO:STEP or one; the instrument's depth range if left out
    #[arg(long, value_name = "STEPS")]
    z: Option<Steps>,
    /// Distances from the axis in mm, FROM:TO:STEP or one; the field of view if left out
    #[arg(long, value_name = "STEPS")]
    r: Option<Steps>,
    /// Diameter of the dots, mm
    #[arg(long, value_name = "MM", default_value_t = 1.0)]
    diameter_mm: f64,
    /// Electrons of a dot in a pixel that sees the whole pupil
    #[arg(long, value_name = "E", default_value_t = 20_000.0)]
    brightness_e: f64,
    /// Electrons of the ground around it
    #[arg(long, value_name = "E", default_value_t = 0.0)]
    background_e: f64,
    /// Dots for every place of the grid, each at another azimuth
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=100))]
    dots: u16,
    /// Also simulate and read noisy frames, with noise of so many seeds for every dot
    #[arg(long, value_name = "SEEDS", num_args = 0..=1, default_missing_value = "16",
        value_parser = clap::value_parser!(u16).range(1..=1000))]
    achieved: Option<u16>,
    /// Rays over the pupil for every pixel and band
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = samples)]
    samples: usize,
    /// Folder for the report, its plots and the series behind them
    #[arg(short, long, value_name = "FOLDER", default_value = "twinpupil-precision")]
    output: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

/// How frames are read.
const MODES: [Mode; 2] = [Mode::Model, Mode::Centroid];

/// Everything that is shown.
struct Analysis {
    instrument: Instrument,
    grid: Grid,
    kind: DotKind,
    bounds: BoundStudy,
    /// With `--achieved`, one for each of [`MODES`].
    tallies: Vec<Tally>,
    /// Noise seeds of every sheet.
    seeds: u64,
    /// For every depth the distance from the axis below which the masks clip, mm.
    clipping_mm: Vec<f64>,
}

impl Analysis {
    /// All places, depth by depth, from the axis outwards.
    fn places(&self) -> impl Iterator<Item = Place> {
        let depths = 0..self.grid.z_mm.len();
        depths.flat_map(|z| (0..self.grid.r_mm.len()).map(move |r| Place { z, r }))
    }

    /// Whether the masks leave the light of a place alone.
    fn is_unclipped(&self, place: Place) -> bool {
        self.r_mm(place) >= self.clipping_mm[place.z]
    }

    fn z_mm(&self, place: Place) -> f64 {
        self.grid.z_mm[place.z]
    }

    fn r_mm(&self, place: Place) -> f64 {
        self.grid.r_mm[place.r]
    }
}

/// The word for a mode.
fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Paper => "paper",
        Mode::Centroid => "centroid",
        Mode::Model => "model",
    }
}

/// Runs `twinpupil analyze precision`.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let start = Instant::now();
    let mut files = FolderOutputs::new(&args.output)?;
    let loaded = LoadedInstrument::load(&args.instrument, console)?;
    let (analysis, sheets, trials) = analyse(args, &loaded, console)?;

    series::add(&mut files, &analysis, &sheets, &trials);
    let figures = plots::figures(&analysis);
    for figure in &figures {
        files.add(figure.file, plots::standalone(&figure.svg).into_bytes());
    }
    files.add("report.html", page::page(&analysis, &figures).into_html().into_bytes());
    let (names, report) = (files.names(), files.path("report.html"));
    files.commit()?;

    let seconds = start.elapsed().as_secs_f64();
    console.note(format!("{}, its plots and the series behind them, {seconds:.0} s", report.display()));
    let text = if args.json {
        pretty(&Summary::new(&analysis, args.output.display().to_string(), names, seconds))?
    } else {
        text::tables(&analysis)
    };
    output::write_stdout(text.as_bytes())
}

fn analyse(
    args: &Args,
    loaded: &LoadedInstrument,
    console: &Console,
) -> Result<(Analysis, Vec<Sheet>, Vec<crate::precision::Trial>)> {
    let instrument = &loaded.instrument;
    let response = loaded.response_matrix()?;
    let Args { diameter_mm, brightness_e, background_e, .. } = *args;
    let grid = Grid::new(instrument, args.z.as_ref(), args.r.as_ref(), diameter_mm);
    let kind = DotKind { diameter_mm, brightness_e, background_e };
    let sheets = Sheet::all(instrument, &grid, &kind, args.dots.into())?;
    if sheets.is_empty() {
        bail!("no dot of {diameter_mm} mm is wholly on the sensor at any of these places");
    }
    let bar = console.progress(sheets.len() as u64, "bounds");
    let bounds = BoundStudy::new(instrument, &response, &sheets, args.samples, || bar.inc(1))?;
    bar.finish_and_clear();

    let seeds = args.achieved.unwrap_or(0).into();
    let trials = match args.achieved {
        None => Vec::new(),
        Some(_) => {
            let examiner = Examiner::new(instrument, response, &MODES, args.samples)?;
            let bar = console.progress(seeds * sheets.len() as u64, "simulating and reading");
            let trials = examiner.trials(&sheets, seeds, || bar.inc(1))?;
            bar.finish_and_clear();
            trials
        }
    };
    let tally = |mode: &Mode| Tally::new(*mode, &trials, &sheets, &bounds);
    let tallies = if trials.is_empty() { Vec::new() } else { MODES.iter().map(tally).collect() };
    let table = twinpupil_optics::smoothed_response_table_for(instrument)?;
    let clipping_mm = grid.z_mm.iter().map(|z_mm| clipping_radius_mm(&table, *z_mm).unwrap_or(f64::INFINITY)).collect();
    let analysis = Analysis { instrument: instrument.clone(), grid, kind, bounds, tallies, seeds, clipping_mm };
    Ok((analysis, sheets, trials))
}
