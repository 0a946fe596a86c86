//! `twinpupil simulate`: instrument + scene → frame.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use serde::Serialize;
use twinpupil_instrument::{Frame, ResponseMatrix};
use twinpupil_optics::RayLedger;
use twinpupil_simulate::{Defects, PUPIL_SAMPLES_MAX, Scene, SimulateOptions, Simulation, simulate, standard_errors};

use super::destination::pretty;
use super::options::file_of;
use crate::console::Console;
use crate::io::encode_tiff_f32;
use crate::io::files::FrameFiles;
use crate::io::frame::check_frame_files;
use crate::io::output::{self, Outputs};
use crate::io::table::check_table_path;
use crate::io::truth::{self, TruthRow};
use crate::load::{self, LoadedInstrument};

/// Steps of the progress bar.
const STEPS: f64 = 1000.0;

/// `twinpupil simulate …`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Instrument file, or the name of one that ships, such as `paper`
    #[arg(long, value_name = "FILE")]
    instrument: PathBuf,
    /// Scene file, or the word `paper` for the paper's plate of random dots at 300 mm
    #[arg(long, value_name = "FILE")]
    scene: PathBuf,
    /// Frame to write: .png, .tif or .tiff; a cube as .hdr, .raw, .bsq, .bil or .bip; with a sensor for each band
    /// once for each, or with {band} in it
    #[arg(short, long, value_name = "FRAME", required = true)]
    output: Vec<PathBuf>,
    /// Also write where the dots are: .csv, .ply or .parquet
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Rays over the pupil for every pixel and band; 1024 if left out
    #[arg(long, value_name = "N", value_parser = samples)]
    samples: Option<usize>,
    /// Write the expected values, without noise
    #[arg(long)]
    noiseless: bool,
    /// Seed of the sensor's noise; the scene's if left out
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Share of the pixels that are dead and read 0; which ones does not depend on the seed
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    dead: f64,
    /// Share of the pixels that are hot and read the largest code
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    hot: f64,
    /// Light this band alone, as the flat frames of `crosstalk` are lit
    #[arg(long, value_name = "BAND")]
    lit: Option<String>,
    /// Also write how far the electrons of every pixel may be off because its rays are finite in number: a TIFF of 32-bit
    /// floats, standard errors in electrons, with the pages of the frame; takes eight times as long again
    #[arg(long, value_name = "FILE", value_parser = file_of("tif"))]
    standard_error: Option<PathBuf>,
    /// Print a summary as JSON
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Rays over the pupil.
    fn samples(&self) -> usize {
        self.samples.unwrap_or(SimulateOptions::default().pupil_samples)
    }
}

/// A legal number of rays over the pupil.
pub(super) fn samples(text: &str) -> Result<usize, String> {
    let legal = text.parse().ok().filter(|samples| (1..=PUPIL_SAMPLES_MAX).contains(samples));
    legal.ok_or_else(|| format!("legal: 1 to {PUPIL_SAMPLES_MAX}"))
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary<'a> {
    instrument: &'a str,
    scene: &'a str,
    frame: String,
    size_px: [usize; 2],
    dots: usize,
    pupil_samples: usize,
    noiseless: bool,
    saturated_pixels: usize,
    seconds: f64,
    rays: Rays<'a>,
    #[serde(skip_serializing_if = "Option::is_none")]
    standard_error: Option<StandardError>,
}

/// What the number of rays leaves open, over the pixels in which not all rays bring back the same.
#[derive(Debug, Serialize)]
struct StandardError {
    pixels: usize,
    rms_e: f64,
    largest_e: f64,
}

/// Every ray by its fate.
#[derive(Debug, Serialize)]
struct Rays<'a> {
    launched: u64,
    arrived: u64,
    blocked_by_aperture: &'a [u64],
    missed_lens: u64,
    groove_wall: u64,
    total_internal_reflection: u64,
}

/// Runs `twinpupil simulate`.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let loaded = LoadedInstrument::load(&args.instrument, console)?;
    let scene = load::scene(&args.scene)?;
    let response = response(args, &loaded)?;
    let files = FrameFiles::of_output(&args.output, &loaded.instrument)?;
    check_frame_files(&files, &loaded.instrument)?;
    files.paths().iter().try_for_each(|path| output::check(path))?;
    if let Some(path) = &args.truth {
        check_table_path(path)?;
        output::check(path)?;
    }
    args.standard_error.iter().try_for_each(|path| output::check(path))?;

    let start = Instant::now();
    let options = SimulateOptions {
        pupil_samples: args.samples(),
        noiseless: args.noiseless,
        seed: args.seed,
        defects: Defects { dead: args.dead, hot: args.hot, ..Defects::default() },
    };
    let bar = console.progress(STEPS as u64, "simulating");
    let progress = |share: f64| bar.set_position((STEPS * share) as u64);
    let simulation = simulate(&loaded.instrument, &scene, &response, &options, &progress)?;
    bar.finish_and_clear();
    let seconds = start.elapsed().as_secs_f64();
    let mut outputs = Outputs::new();
    let mut standard_error = None;
    if let Some(path) = &args.standard_error {
        let bar = console.progress(STEPS as u64, "simulating with other rays");
        let progress = |share: f64| bar.set_position((STEPS * share) as u64);
        let pages = standard_errors(&loaded.instrument, &scene, &response, args.samples(), &progress)?;
        bar.finish_and_clear();
        outputs.add(path, encode_tiff_f32(loaded.instrument.sensor.size_px, &pages)?);
        standard_error = Some(StandardError::of(&pages));
    }

    for (path, bytes) in files.encode(&simulation.frame, &loaded.instrument)? {
        outputs.add(&path, bytes);
    }
    if let Some(path) = &args.truth {
        outputs.add(path, truth::table(&truth_rows(&scene)).encode(Some(path))?);
    }
    outputs.commit()?;

    let summary = Summary { standard_error, ..summary(args, &files, &loaded, &scene, &simulation, seconds) };
    console.note(line(&summary));
    summary.standard_error.iter().for_each(|error| console.note(error.line()));
    if args.json { output::write_stdout(pretty(&summary)?.as_bytes()) } else { Ok(()) }
}

/// Signal in every plane from every band, or from the one that is lit.
fn response(args: &Args, loaded: &LoadedInstrument) -> Result<ResponseMatrix> {
    let response = loaded.response_matrix()?;
    let Some(name) = &args.lit else { return Ok(response) };
    let bands = &loaded.instrument.bands;
    match bands.iter().position(|band| band.name == *name) {
        Some(band) => Ok(response.lit_by(band)),
        None => {
            let names = bands.iter().map(|band| band.name.as_str()).collect::<Vec<_>>().join(", ");
            bail!("--lit {name}: there is no such band; legal: {names}")
        }
    }
}

/// The centres of a scene's dots.
pub fn truth_rows(scene: &Scene) -> Vec<TruthRow> {
    let row = |(id, dot): (usize, &twinpupil_simulate::Dot)| TruthRow { id: id as i64, position_mm: dot.centre_mm };
    scene.dots().iter().enumerate().map(row).collect()
}

fn summary<'a>(
    args: &Args,
    files: &FrameFiles,
    loaded: &'a LoadedInstrument,
    scene: &'a Scene,
    simulation: &'a Simulation,
    seconds: f64,
) -> Summary<'a> {
    let frame = &simulation.frame;
    Summary {
        instrument: &loaded.instrument.name,
        scene: &scene.name,
        frame: files.name.clone(),
        size_px: [frame.width_px(), frame.height_px()],
        dots: scene.dots().len(),
        pupil_samples: args.samples(),
        noiseless: args.noiseless,
        saturated_pixels: saturated_pixels(frame),
        seconds,
        rays: rays(&simulation.ledger),
        standard_error: None,
    }
}

impl StandardError {
    fn of(pages: &[Vec<f64>]) -> Self {
        let open = || pages.iter().flatten().filter(|error_e| **error_e > 0.0);
        let pixels = open().count();
        let squares: f64 = open().map(|error_e| error_e * error_e).sum();
        Self { pixels, rms_e: (squares / pixels.max(1) as f64).sqrt(), largest_e: open().copied().fold(0.0, f64::max) }
    }

    fn line(&self) -> String {
        let Self { pixels, rms_e, largest_e } = self;
        format!("rays tell {pixels} pixels; their standard error is {rms_e:.1} e- rms, {largest_e:.0} e- at most")
    }
}

fn saturated_pixels(frame: &Frame) -> usize {
    frame.pages().iter().flatten().filter(|&&code| code == frame.code_max()).count()
}

fn rays(ledger: &RayLedger) -> Rays<'_> {
    Rays {
        launched: ledger.launched,
        arrived: ledger.arrived,
        blocked_by_aperture: &ledger.blocked,
        missed_lens: ledger.missed_lens,
        groove_wall: ledger.groove_wall,
        total_internal_reflection: ledger.total_internal_reflection,
    }
}

/// The summary for a human: one line.
fn line(summary: &Summary<'_>) -> String {
    let [width, height] = summary.size_px;
    let arrived = 100.0 * summary.rays.arrived as f64 / summary.rays.launched.max(1) as f64;
    let million = summary.rays.launched as f64 / 1e6;
    let saturated = match summary.saturated_pixels {
        0 => String::new(),
        pixels => format!(", {pixels} pixels saturated"),
    };
    format!(
        "{}: {width} × {height} px, {} dots, {million:.1} million rays of which {arrived:.1} % arrived{saturated}, {:.2} s",
        summary.frame, summary.dots, summary.seconds
    )
}
