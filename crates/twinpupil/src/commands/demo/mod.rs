//! `twinpupil demo`: the main job, end to end, within seconds.

mod page;
mod text;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use serde::Serialize;
use twinpupil_instrument::Frame;
use twinpupil_reconstruct::{Mode, Reconstruction};

use super::destination::pretty;
use super::simulate::{samples, truth_rows};
use crate::console::Console;
use crate::experiments::{Case, Experiment, LensModel, Reading, Rig, Shot, statistics, tilt};
use crate::io::folder::FolderOutputs;
use crate::io::points::{self, FramePoints};
use crate::io::{frame, output, truth};

/// `twinpupil demo …`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder for the report, the frame and the points
    #[arg(short, long, value_name = "FOLDER", default_value = "twinpupil-demo")]
    output: PathBuf,
    /// Seed of the plate's dots and of the sensor's noise
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(..1 << 32))]
    seed: u64,
    /// Rays over the pupil for every pixel and band
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = samples)]
    samples: usize,
    /// Print the results as JSON
    #[arg(long)]
    json: bool,
}

/// The plate across the axis, mm; and tilted, degrees.
const DISTANCES_MM: [f64; 3] = [250.0, 300.0, 350.0];
const TILT_DEG: f64 = 45.0;

/// One exposure with everything that was read in it.
struct Exposed {
    shot: Shot,
    frame: Frame,
    /// By the paper's equations and by the default.
    readings: [Reading; 2],
    /// The default's.
    reconstruction: Reconstruction,
}

/// One line of the result.
#[derive(Debug, Serialize)]
struct Line {
    /// True distance, mm.
    true_z_mm: f64,
    /// True tilt, degrees.
    true_tilt_deg: f64,
    /// Dots whose images lie wholly on the sensor.
    whole_dots: usize,
    /// By the paper's equations.
    paper: Found,
    /// By the default.
    twinpupil: Found,
}

/// What one way of reading found.
#[derive(Debug, Serialize)]
struct Found {
    /// Of the whole dots.
    dots: usize,
    /// Points that are no dot.
    false_points: usize,
    /// Mean of the depths, mm.
    mean_z_mm: f64,
    /// Root mean square of recovered less true depth, mm.
    rms_error_mm: f64,
    /// Tilt and R² of the line through all points, for the tilted plate.
    tilt_deg: Option<f64>,
    r_squared: Option<f64>,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary {
    lines: Vec<Line>,
    folder: String,
    files: Vec<&'static str>,
    seconds: f64,
}

/// Runs `twinpupil demo`.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let start = Instant::now();
    let mut files = FolderOutputs::new(&args.output)?;
    let rig = Rig::new(LensModel::Thin, args.samples)?;
    let exposed = expose(&rig, args.seed, console)?;
    let lines = exposed.iter().map(Line::new).collect::<Result<Vec<_>>>()?;

    let page = page::page(&rig, &exposed, &lines)?;
    files.add("report.html", page.into_html().into_bytes());
    let tilted = exposed.last().expect("the shots are a constant list");
    add_frame(&mut files, &rig, tilted)?;
    let summary = Summary {
        lines,
        folder: args.output.display().to_string(),
        files: files.names(),
        seconds: start.elapsed().as_secs_f64(),
    };
    files.commit()?;
    let text = if args.json { pretty(&summary)? } else { text::text(&summary) };
    output::write_stdout(text.as_bytes())
}

fn expose(rig: &Rig, seed: u64, console: &Console) -> Result<Vec<Exposed>> {
    let plates = DISTANCES_MM.into_iter().map(|z_mm| Shot::plate(z_mm, seed));
    let shots = plates.chain([Shot::tilted(TILT_DEG, seed)]).collect::<Result<Vec<_>>>()?;
    let bar = console.progress(shots.len() as u64, "simulating and reconstructing");
    let exposed = shots.into_iter().map(|shot| {
        let frame = rig.expose(&shot)?;
        let reconstruction = rig.reconstruct(&frame, Mode::Model)?;
        let model = Reading::new(Case::ThinModel, &shot, &reconstruction.points, rig.whole_dots(&shot.scene));
        let readings = [rig.read(&shot, &frame, Case::ThinPaper)?, model];
        bar.inc(1);
        Ok(Exposed { shot, frame, readings, reconstruction })
    });
    let exposed = exposed.collect();
    bar.finish_and_clear();
    exposed
}

/// Adds the tilted plate as files that the other commands read.
fn add_frame(files: &mut FolderOutputs, rig: &Rig, exposed: &Exposed) -> Result<()> {
    let name = "frame.png";
    files.add(name, frame::encode_frame(name.as_ref(), &exposed.frame, rig.instrument.sensor.mosaic)?);
    let points = exposed.reconstruction.points.clone();
    let frame = FramePoints { frame: name.to_owned(), points, calibration_std_mm: None };
    let table = points::table(&[frame]);
    files.add("points.csv", table.encode(Some("points.csv".as_ref()))?);
    files.add("points.ply", table.encode(Some("points.ply".as_ref()))?);
    files.add("truth.csv", truth::table(&truth_rows(&exposed.shot.scene)).to_csv());
    Ok(())
}

impl Line {
    fn new(exposed: &Exposed) -> Result<Self> {
        let [paper, model] = &exposed.readings;
        Ok(Self {
            true_z_mm: exposed.shot.z_mm,
            true_tilt_deg: match exposed.shot.experiment {
                Experiment::Tilt { tilt_deg } => tilt_deg,
                _ => 0.0,
            },
            whole_dots: paper.whole.len(),
            paper: Found::new(paper)?,
            twinpupil: Found::new(model)?,
        })
    }

    /// Where the plate stands, in words.
    fn plate(&self) -> String {
        match self.is_tilted() {
            true => format!("at {} mm, tilted {}°", self.true_z_mm, self.true_tilt_deg),
            false => format!("at {} mm", self.true_z_mm),
        }
    }

    fn is_tilted(&self) -> bool {
        self.true_tilt_deg != 0.0
    }
}

impl Found {
    fn new(reading: &Reading) -> Result<Self> {
        let is_tilted = matches!(reading.experiment, Experiment::Tilt { .. });
        let fit = if is_tilted { Some(tilt::fit(reading)?) } else { None };
        Ok(Self {
            dots: reading.whole_found(),
            false_points: reading.strays_mm.len(),
            mean_z_mm: statistics::mean(&reading.depths_mm()),
            rms_error_mm: statistics::rms(&reading.depth_errors_mm()),
            tilt_deg: fit.map(|fit| fit.tilt_rad.value.to_degrees()),
            r_squared: fit.map(|fit| fit.quality.r_squared),
        })
    }
}
