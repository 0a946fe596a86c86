//! `twinpupil reconstruct`: frames → points.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::ValueEnum;
use rayon::prelude::*;
use serde::Serialize;
use twinpupil_instrument::{Band, Frame, Role};
use twinpupil_reconstruct::{DetectOptions, Mode, NoiseSource, Options, Point, Reconstruction, Reconstructor};

use super::destination::pretty;
use super::options::PolarityOption;
use crate::console::Console;
use crate::io::features::{FrameRejections, rejected_table};
use crate::io::files::{self, FrameFiles};
use crate::io::frame::FrameFormat;
use crate::io::output::{self, Outputs};
use crate::io::points::{self, FramePoints};
use crate::io::table::{Table, check_table_path};
use crate::load::LoadedInstrument;

/// `twinpupil reconstruct …`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Frames: PNG or TIFF, an ENVI header, or one file for each sensor
    #[arg(required = true, value_name = "FRAME")]
    frames: Vec<PathBuf>,
    /// Instrument file, or the name of one that ships, such as `paper`
    #[arg(long, value_name = "FILE")]
    instrument: PathBuf,
    /// Points to write, .csv, .ply or .parquet; CSV on standard output if left out
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Also write the features that became no point, each with its reason: .csv, .ply or .parquet
    #[arg(long, value_name = "FILE")]
    rejected: Option<PathBuf>,
    /// How points are computed
    #[arg(long, value_enum, default_value_t = ModeOption::Model)]
    mode: ModeOption,
    /// Whether features are bright or dark
    #[arg(long, value_enum, default_value_t = PolarityOption::Auto)]
    polarity: PolarityOption,
    /// Where the noise of pixels is known from
    #[arg(long, value_enum, default_value_t = NoiseOption::Sensor)]
    noise: NoiseOption,
    /// Print a summary as JSON; needs -o
    #[arg(long, requires = "output")]
    json: bool,
}

/// How points are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ModeOption {
    /// Equations 9 to 13 of the paper, to the letter
    Paper,
    /// Cartesian centroids, and the instrument's forward model inverted
    Centroid,
    /// The dots whose modelled light is the most likely one given every pixel
    Model,
}

/// Where the noise of pixels is known from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum NoiseOption {
    /// The sensor's figures in the instrument file
    Sensor,
    /// How much the flat places of every frame scatter
    Frame,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary {
    instrument: String,
    mode: String,
    points: usize,
    ambiguous: usize,
    bands: Vec<BandSummary>,
    /// Number of rejected features by reason.
    rejected: BTreeMap<&'static str, usize>,
    /// Time spent on reading files and on computing, summed over threads.
    read_seconds: f64,
    compute_seconds: f64,
    /// Time from the first frame to the last.
    wall_seconds: f64,
    frames: Vec<FrameSummary>,
}

#[derive(Debug, Serialize)]
struct FrameSummary {
    frame: String,
    points: usize,
    rejected: usize,
    /// Why there is no point, if so.
    empty: Option<String>,
}

/// What became of the features of one band: found = points + rejected.
#[derive(Debug, Serialize)]
struct BandSummary {
    band: String,
    found: usize,
    points: usize,
    rejected: usize,
}

/// One frame, read and reconstructed.
struct Done {
    frame: String,
    reconstruction: Reconstruction,
    /// Why there is no point, if so.
    empty: Option<String>,
    read_seconds: f64,
    compute_seconds: f64,
}

/// Runs `twinpupil reconstruct`.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let loaded = LoadedInstrument::load(&args.instrument, console)?;
    for path in args.output.iter().chain(&args.rejected) {
        check_table_path(path)?;
        output::check(path)?;
    }
    let format = FrameFormat::of_instrument(&loaded.instrument);
    let reconstructor = reconstructor(args, &loaded)?;

    let start = Instant::now();
    let files = FrameFiles::of_arguments(&args.frames, &format)?;
    let bar = console.progress(files.len() as u64, "reconstructing");
    let one = |files: &FrameFiles| {
        let done = reconstruct(&reconstructor, &format, files);
        bar.inc(1);
        done
    };
    let frames = files.par_iter().map(one).collect::<Result<Vec<Done>>>()?;
    bar.finish_and_clear();
    let summary = summary(args, &loaded, &frames, start.elapsed().as_secs_f64());

    let (points, rejected) = tables(frames, &reconstructor);
    write(args, &points, &rejected)?;
    lines(&summary).iter().for_each(|line| console.note(line));
    if args.json {
        output::write_stdout(pretty(&summary)?.as_bytes())?;
    }
    match summary.frames.first() {
        Some(FrameSummary { frame, empty: Some(why), .. }) if summary.points == 0 => {
            let others = if summary.frames.len() > 1 { ", and none from the other frames" } else { "" };
            bail!("{frame}: no points, because {why}{others}")
        }
        _ => Ok(()),
    }
}

fn reconstructor(args: &Args, loaded: &LoadedInstrument) -> Result<Reconstructor> {
    let mode = match args.mode {
        ModeOption::Paper => Mode::Paper,
        ModeOption::Centroid => Mode::Centroid,
        ModeOption::Model => Mode::Model,
    };
    let detect = DetectOptions { polarity: args.polarity.polarity(), ..DetectOptions::default() };
    let table = match mode {
        Mode::Paper => None,
        Mode::Centroid | Mode::Model => Some(twinpupil_optics::response_table_for(&loaded.instrument)?),
    };
    let noise = match args.noise {
        NoiseOption::Sensor => NoiseSource::Sensor,
        NoiseOption::Frame => NoiseSource::Frame,
    };
    let options = Options { mode, detect, noise, ..Options::default() };
    Ok(Reconstructor::new(loaded.instrument.clone(), table, options).unmixing(&loaded.response_matrix()?))
}

fn reconstruct(reconstructor: &Reconstructor, format: &FrameFormat, files: &FrameFiles) -> Result<Done> {
    let start = Instant::now();
    let frame = files.read(format)?;
    let read_seconds = start.elapsed().as_secs_f64();
    let reconstruction = reconstructor.reconstruct(&frame).with_context(|| files.name.clone())?;
    let empty = reconstruction.points.is_empty().then(|| why_empty(&frame, &reconstruction));
    let compute_seconds = start.elapsed().as_secs_f64() - read_seconds;
    Ok(Done { frame: files.name.clone(), reconstruction, empty, read_seconds, compute_seconds })
}

/// Why a frame gives no point.
fn why_empty(frame: &Frame, reconstruction: &Reconstruction) -> String {
    let code = frame.pages()[0][0];
    let constant = frame.pages().iter().flatten().all(|other| *other == code);
    match (constant, reconstruction.rejected.len()) {
        (true, _) if code == frame.code_max() => format!("every pixel is saturated at {code}"),
        (true, _) => format!("every pixel reads {code}"),
        (false, 0) => "no feature stands out of the noise".to_owned(),
        (false, 1) => "its only feature was rejected".to_owned(),
        (false, rejected) => format!("all of its {rejected} features were rejected"),
    }
}

fn tables(frames: Vec<Done>, reconstructor: &Reconstructor) -> (Table, Table) {
    let (mut all_points, mut all_rejected) = (Vec::new(), Vec::new());
    for Done { frame, reconstruction: Reconstruction { points, rejected, .. }, .. } in frames {
        all_rejected.push(FrameRejections { frame: frame.clone(), rejected });
        // Also where there are no points, so that the columns do not depend on them.
        let is_calibrated = reconstructor.instrument().calibration.is_some();
        let calibration_std_mm =
            is_calibrated.then(|| points.iter().map(|point| calibration_std_mm(reconstructor, point)).collect());
        all_points.push(FramePoints { frame, points, calibration_std_mm });
    }
    (points::table(&all_points), rejected_table(&all_rejected))
}

/// What the calibrated instrument leaves uncertain of a point; NaN where that cannot be told.
fn calibration_std_mm(reconstructor: &Reconstructor, point: &Point) -> [f64; 3] {
    let covariance_mm2 = reconstructor.calibration_covariance_mm2(point.position_mm);
    [0, 1, 2].map(|axis| covariance_mm2.map_or(f64::NAN, |covariance| covariance[axis][axis].sqrt()))
}

fn write(args: &Args, points: &Table, rejected: &Table) -> Result<()> {
    let mut outputs = Outputs::new();
    outputs.add_or_print(args.output.as_deref(), points.encode(args.output.as_deref())?);
    if let Some(path) = &args.rejected {
        outputs.add(path, rejected.encode(Some(path))?);
    }
    outputs.commit()
}

fn summary(args: &Args, loaded: &LoadedInstrument, frames: &[Done], wall_seconds: f64) -> Summary {
    let points = || frames.iter().flat_map(|done| &done.reconstruction.points);
    let mut rejected = BTreeMap::new();
    for rejection in frames.iter().flat_map(|done| &done.reconstruction.rejected) {
        *rejected.entry(rejection.reason.name()).or_default() += 1;
    }
    let frame = |done: &Done| FrameSummary {
        frame: done.frame.clone(),
        points: done.reconstruction.points.len(),
        rejected: done.reconstruction.rejected.len(),
        empty: done.empty.clone(),
    };
    Summary {
        instrument: loaded.instrument.name.clone(),
        mode: format!("{:?}", args.mode).to_lowercase(),
        points: points().count(),
        ambiguous: points().filter(|point| point.ambiguous).count(),
        bands: bands(loaded, frames),
        rejected,
        read_seconds: frames.iter().map(|done| done.read_seconds).sum(),
        compute_seconds: frames.iter().map(|done| done.compute_seconds).sum(),
        wall_seconds,
        frames: frames.iter().map(frame).collect(),
    }
}

fn bands(loaded: &LoadedInstrument, frames: &[Done]) -> Vec<BandSummary> {
    let paired: usize = frames.iter().map(|done| done.reconstruction.points.len()).sum();
    let shown = |band: usize| {
        let images = frames.iter().flat_map(|done| &done.reconstruction.further);
        images.filter(|image| image.band == band).count()
    };
    let one = |(index, band): (usize, &Band)| {
        let points = if band.role == Role::Intermediate { shown(index) } else { paired };
        let rejections = frames.iter().flat_map(|done| &done.reconstruction.rejected);
        let rejected = rejections.filter(|rejection| rejection.band == band.name).count();
        BandSummary { band: band.name.clone(), found: points + rejected, points, rejected }
    };
    loaded.instrument.bands.iter().enumerate().map(one).collect()
}

/// The summary for a human.
fn lines(summary: &Summary) -> Vec<String> {
    let frames = summary.frames.len();
    let mut lines = vec![format!(
        "{} points from {}, {} ambiguous; {}",
        summary.points,
        files::frames(frames),
        summary.ambiguous,
        rejections(&summary.rejected),
    )];
    for BandSummary { band, found, points, rejected } in &summary.bands {
        lines.push(format!("{band}: {found} features found = {points} in points + {rejected} rejected"));
    }
    if summary.points > 0 {
        let empty = summary.frames.iter().filter_map(|frame| Some((&frame.frame, frame.empty.as_ref()?)));
        lines.extend(empty.map(|(frame, why)| format!("{frame}: no points, because {why}")));
    }
    let (read_ms, compute_ms) =
        (1e3 * summary.read_seconds / frames as f64, 1e3 * summary.compute_seconds / frames as f64);
    let rate = frames as f64 / summary.wall_seconds;
    lines.push(format!("{read_ms:.1} ms to read and {compute_ms:.1} ms to reconstruct a frame, {rate:.1} frames/s"));
    lines
}

fn rejections(rejected: &BTreeMap<&str, usize>) -> String {
    if rejected.is_empty() {
        return "no feature rejected".to_owned();
    }
    let each = rejected.iter().map(|(reason, count)| format!("{count} {reason}")).collect::<Vec<_>>().join(", ");
    format!("features rejected: {each}")
}
