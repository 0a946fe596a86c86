//! `twinpupil design`: a lens made into a camera with two pupils.

mod page;
mod rows;
mod text;
mod tolerance;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use serde::Serialize;
use twinpupil_instrument::{Instrument, PrescriptionLens};

use super::destination::pretty;
use super::options::{distance_mm, extent_mm, number, size_mm};
use super::parts::{self, Run as _};
use crate::console::Console;
use crate::design::{Check, Choice, Design, Light, Pairs, PairsSpec, best, check};
use crate::io::folder::FolderOutputs;
use crate::io::lens::read_with_glasses;
use crate::io::output;
use crate::io::shard::Shard;
use crate::load::{LoadedInstrument, is_instrument};

/// `twinpupil design …`.
#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    camera: Option<CameraArgs>,
    /// Try only every n-th pair of radii, from the i-th on, so that n machines share the work; put the parts together with
    /// --merge
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Put the pieces of a sweep together: files, or folders that hold them
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with_all = ["CameraArgs", "shard"])]
    merge: Vec<PathBuf>,
    /// Folder for the instrument, the report and the series behind it; pieces of a shard go into `pieces` there
    #[arg(short, long, value_name = "FOLDER", default_value = "twinpupil-design")]
    output: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

/// `twinpupil design tolerance …`.
#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Build many cameras of one design, each off by what its parts may be off by, and tell how well they measure depth
    Tolerance(tolerance::Args),
}

/// `twinpupil design LENS …`.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
struct CameraArgs {
    /// Lens: a `.zmx` file, or a prescription in TOML
    #[arg(required = false, required_unless_present = "merge")]
    lens: PathBuf,
    /// AGF catalogue with glasses of the lens; may be given several times
    #[arg(long, value_name = "FILE")]
    agf: Vec<PathBuf>,
    /// Scale the lens to this focal length, mm
    #[arg(long, value_name = "MM", value_parser = number("0.1 to 1e5", |mm| (0.1..=1e5).contains(mm)))]
    focal_length_mm: Option<f64>,
    /// Instrument whose sensor and bands the camera is to have
    #[arg(long, value_name = "FILE", default_value = "paper")]
    like: PathBuf,
    /// Distance in front of the front principal plane that is to be in focus, mm
    #[arg(long, value_name = "MM", value_parser = distance_mm(), required = false, required_unless_present = "merge")]
    distance_mm: f64,
    /// Nearest distance of objects, mm; 0.85 of the distance if left out
    #[arg(long, value_name = "MM", value_parser = distance_mm())]
    near_mm: Option<f64>,
    /// Farthest distance of objects, mm; 1.18 of the distance if left out
    #[arg(long, value_name = "MM", value_parser = distance_mm())]
    far_mm: Option<f64>,
    /// Diameter of the dots by which depth is judged, mm
    #[arg(long, value_name = "MM", value_parser = size_mm(), default_value_t = 1.0)]
    diameter_mm: f64,
    /// Electrons of a dot through a pupil as wide on the lens as a hundredth of the focal length, in radius
    #[arg(long, value_name = "E", value_parser = number("above 0, up to 1e9", |e| *e > 0.0 && *e <= 1e9), default_value_t = 20_000.0)]
    brightness_e: f64,
    /// Largest radius about the axis in which a band may see nothing, mm
    #[arg(long, value_name = "MM", value_parser = extent_mm(), default_value_t = 1.0)]
    blind_mm: f64,
    /// Radius within which masks keep clear of glass, mm
    #[arg(long, value_name = "MM", value_parser = size_mm(), default_value_t = 8.0)]
    mask_radius_mm: f64,
    /// How far masks keep from glass, mm
    #[arg(long, value_name = "MM", value_parser = extent_mm(), default_value_t = 0.5)]
    clearance_mm: f64,
    /// Surface behind which the entocentric mask goes, from 0; else where it appears nearest to the principal planes
    #[arg(long, value_name = "N", requires = "position_mm")]
    surface: Option<usize>,
    /// How far behind that surface it goes, mm
    #[arg(long, value_name = "MM", value_parser = number("-1e6 to 1e6", |mm| mm.abs() <= 1e6), requires = "surface")]
    position_mm: Option<f64>,
    /// Radii of the telecentric and the entocentric mask, mm, instead of the most precise ones
    #[arg(long, value_name = "MM", value_parser = size_mm(), num_args = 2)]
    radii_mm: Option<Vec<f64>>,
}

/// Everything that is shown.
struct Designed {
    design: Design,
    instrument: Instrument,
    choices: Vec<Choice>,
    chosen: Choice,
    check: Check,
    light: Light,
}

/// Runs `twinpupil design`.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    match &args.command {
        Some(Command::Tolerance(args)) => tolerance::run(args, console),
        None => run_camera(args, console),
    }
}

fn run_camera(args: &Args, console: &Console) -> Result<()> {
    let start = Instant::now();
    let mut files = FolderOutputs::new(&args.output)?;
    let Some((spec, pairs, choices)) = swept(args, console)? else { return Ok(()) };
    let designed = designed(&spec.name, pairs, choices)?;
    files.add("instrument.toml", designed.instrument.to_toml().into_bytes());
    files.add("sweep.csv", text::series(&designed.choices).into_bytes());
    files.add("report.html", page::page(&designed)?.into_html().into_bytes());
    let (names, report) = (files.names(), files.path("report.html"));
    files.commit()?;
    let seconds = start.elapsed().as_secs_f64();
    console.note(format!("{}, the instrument and the series behind it, {seconds:.0} s", report.display()));
    let text = if args.json { pretty(&Summary::new(&designed, names))? } else { text::tables(&designed) };
    output::write_stdout(text.as_bytes())
}

/// The whole sweep, unless it is a shard and others are still missing.
fn swept(args: &Args, console: &Console) -> Result<Option<(PairsSpec, Pairs, Vec<Choice>)>> {
    if !args.merge.is_empty() {
        return parts::merged(&args.merge).map(Some);
    }
    // The command line asks for one of them.
    let camera = args.camera.as_ref().context("no lens is given")?;
    let spec = spec(camera, console)?;
    let pairs = spec.pairs().with_context(|| camera.lens.display().to_string())?;
    let choices = match args.shard {
        Some(shard) => parts::shared(&spec, &pairs, shard, &args.output, console)?,
        None => Some(all(&pairs, console)?),
    };
    Ok(choices.map(|choices| (spec, pairs, choices)))
}

/// Tries all pairs, without leaving pieces.
fn all(pairs: &Pairs, console: &Console) -> Result<Vec<Choice>> {
    let bar = console.progress(pairs.radii_mm.len() as u64, Pairs::COUNTED);
    let swept = (0..pairs.radii_mm.len()).map(|number| {
        bar.inc(1);
        pairs.choice(number)
    });
    let choices = swept.collect::<Result<Vec<_>>>()?;
    bar.finish_and_clear();
    Ok(choices)
}

fn designed(name: &str, pairs: Pairs, choices: Vec<Choice>) -> Result<Designed> {
    let Pairs { design, light, .. } = pairs;
    let chosen = best(&choices).context("no dot is wholly on the sensor over the depth range")?;
    let instrument = design.instrument(name, chosen.radii_mm)?;
    let check = check(&instrument, &light, chosen.electrons)?;
    Ok(Designed { design, instrument, choices, chosen, check, light })
}

/// The camera is called after its lens.
fn name(args: &CameraArgs) -> String {
    args.lens.file_stem().map_or("camera".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// What makes this sweep the same sweep.
fn spec(args: &CameraArgs, console: &Console) -> Result<PairsSpec> {
    if is_instrument(&args.lens)? {
        bail!("{}: an instrument file, not a lens; it is designed already", args.lens.display());
    }
    let (prescription, warnings) = read_with_glasses(&args.lens, &args.agf)?;
    warnings.iter().for_each(|warning| console.note(warning));
    let lens = PrescriptionLens {
        focal_length_mm: args.focal_length_mm,
        prescription: Some(prescription),
        ..PrescriptionLens::default()
    };
    let near_mm = args.near_mm.unwrap_or(0.85 * args.distance_mm);
    let far_mm = args.far_mm.unwrap_or(1.18 * args.distance_mm);
    if !(near_mm < args.distance_mm && args.distance_mm < far_mm) {
        bail!("--distance-mm is {}; legal: between --near-mm and --far-mm", args.distance_mm);
    }
    let radii_mm = args.radii_mm.as_deref();
    Ok(PairsSpec {
        name: name(args),
        lens: toml::to_string(&lens).with_context(|| args.lens.display().to_string())?,
        like: LoadedInstrument::load(&args.like, console)?.instrument.to_toml(),
        distance_mm: args.distance_mm,
        near_mm,
        far_mm,
        diameter_mm: args.diameter_mm,
        brightness_e: args.brightness_e,
        blind_mm: args.blind_mm,
        mask_radius_mm: args.mask_radius_mm,
        clearance_mm: args.clearance_mm,
        surface: args.surface,
        position_mm: args.position_mm,
        radii_mm: radii_mm.and_then(|pair| <[f64; 2]>::try_from(pair).ok()),
        version: env!("CARGO_PKG_VERSION").to_owned(),
    })
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary {
    focal_length_mm: f64,
    sensor_distance_mm: f64,
    sensor_behind_last_surface_mm: f64,
    entocentric_surface: usize,
    entocentric_position_mm: f64,
    telecentric_surface: usize,
    telecentric_position_mm: f64,
    telecentric_radius_mm: f64,
    entocentric_radius_mm: f64,
    electrons: f64,
    blind_mm: f64,
    z_std_mm: f64,
    files: Vec<&'static str>,
}

impl Summary {
    fn new(designed: &Designed, files: Vec<&'static str>) -> Self {
        let Designed { design, chosen, check, instrument, .. } = designed;
        Self {
            focal_length_mm: instrument.lens.focal_length_mm(),
            sensor_distance_mm: design.sensor_distance_mm,
            sensor_behind_last_surface_mm: text::sensor_behind_mm(design),
            entocentric_surface: design.entocentric.0.surface,
            entocentric_position_mm: design.entocentric.0.behind_mm,
            telecentric_surface: design.telecentric.surface,
            telecentric_position_mm: design.telecentric.behind_mm,
            telecentric_radius_mm: chosen.radii_mm[0],
            entocentric_radius_mm: chosen.radii_mm[1],
            electrons: chosen.electrons,
            blind_mm: chosen.blind_mm,
            z_std_mm: check.z_std_mm,
            files,
        }
    }
}
