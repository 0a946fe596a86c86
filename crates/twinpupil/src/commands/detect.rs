//! `twinpupil detect`: frames → features of each band.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use rayon::prelude::*;
use serde::Serialize;
use twinpupil_instrument::Mosaic;
use twinpupil_reconstruct::{DetectOptions, Options, Reconstructor, Rejection, detect};

use super::destination::pretty;
use super::options::PolarityOption;
use crate::console::Console;
use crate::io::features::{self, BandFeatures, FrameRejections, rejected_table};
use crate::io::files::FrameFiles;
use crate::io::frame::FrameFormat;
use crate::io::output::{self, Outputs};
use crate::io::table::check_table_path;
use crate::load::LoadedInstrument;

/// `twinpupil detect …`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Frames: PNG or TIFF, an ENVI header, or one file for each sensor
    #[arg(required = true, value_name = "FRAME")]
    frames: Vec<PathBuf>,
    /// Instrument file, or the name of one that ships, such as `paper`
    #[arg(long, value_name = "FILE", required_unless_present = "mosaic")]
    instrument: Option<PathBuf>,
    /// Without an instrument: how the sensor samples colour
    #[arg(long, value_name = "MOSAIC", conflicts_with = "instrument", requires = "plane", value_parser = mosaic)]
    mosaic: Option<Mosaic>,
    /// Without an instrument: plane to search, r, g, b, an angle or a page number; may be repeated
    #[arg(long, value_name = "PLANE", conflicts_with = "instrument")]
    plane: Vec<String>,
    /// Features to write, .csv, .ply or .parquet; CSV on standard output if left out
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Also write what was found and not used, each with its reason: .csv, .ply or .parquet
    #[arg(long, value_name = "FILE")]
    rejected: Option<PathBuf>,
    /// Whether features are bright or dark
    #[arg(long, value_enum, default_value_t = PolarityOption::Auto)]
    polarity: PolarityOption,
    /// Print a summary as JSON; needs -o
    #[arg(long, requires = "output")]
    json: bool,
}

fn mosaic(text: &str) -> Result<Mosaic, String> {
    // The planes of cubes and of several sensors are those of an instrument.
    let is_bare = |mosaic: &Mosaic| !matches!(mosaic, Mosaic::Cube | Mosaic::Sensors);
    let names: Vec<&str> = Mosaic::ALL.into_iter().filter(is_bare).map(Mosaic::name).collect();
    Mosaic::from_name(text).filter(is_bare).ok_or_else(|| format!("legal: {}", names.join(", ")))
}

/// Where to look, and what is known of the sensor.
struct Target {
    format: FrameFormat,
    mosaic: Mosaic,
    bands: Vec<Band>,
    /// With an instrument, its noise, shading and crosstalk are known.
    reconstructor: Option<Reconstructor>,
    options: DetectOptions,
}

/// A plane to search.
struct Band {
    name: String,
    plane: String,
    /// Its index in the instrument.
    index: Option<usize>,
}

/// What `--json` prints: one entry for each band of each frame.
#[derive(Debug, Serialize)]
struct BandSummary {
    frame: String,
    band: String,
    features: usize,
    rejected: usize,
}

/// One frame, searched.
struct Done {
    bands: Vec<BandFeatures>,
    rejected: FrameRejections,
}

/// Runs `twinpupil detect`.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let options = DetectOptions { polarity: args.polarity.polarity(), ..DetectOptions::default() };
    let target = Target::of(args, options, console)?;
    for path in args.output.iter().chain(&args.rejected) {
        check_table_path(path)?;
        output::check(path)?;
    }
    let files = FrameFiles::of_arguments(&args.frames, &target.format)?;
    let bar = console.progress(files.len() as u64, "detecting");
    let one = |files: &FrameFiles| {
        let done = target.search(files);
        bar.inc(1);
        done
    };
    let frames = files.par_iter().map(one).collect::<Result<Vec<Done>>>()?;
    bar.finish_and_clear();

    let summary: Vec<BandSummary> = frames.iter().flat_map(summaries).collect();
    write(args, frames)?;
    for band in &summary {
        let BandSummary { frame, band, features, rejected } = band;
        console.note(format!("{frame}: {features} features in {band}, {rejected} rejected"));
    }
    if args.json { output::write_stdout(pretty(&summary)?.as_bytes()) } else { Ok(()) }
}

impl Target {
    fn of(args: &Args, options: DetectOptions, console: &Console) -> Result<Self> {
        if let Some(path) = &args.instrument {
            return Self::of_instrument(&LoadedInstrument::load(path, console)?, options);
        }
        let Some(mosaic) = args.mosaic else { bail!("--instrument or --mosaic is needed") };
        let pages = args.plane.iter().map(|plane| mosaic.site(plane).map(|site| site.page + 1));
        let Some(pages) = pages.collect::<Option<Vec<_>>>() else {
            bail!("--plane {}: a sensor `{}` has no such plane", args.plane.join(" --plane "), mosaic.name());
        };
        let format = FrameFormat::bare(mosaic, pages.into_iter().max().unwrap_or(1));
        let band = |plane: &String| Band { name: plane.clone(), plane: plane.clone(), index: None };
        Ok(Self { format, mosaic, bands: args.plane.iter().map(band).collect(), reconstructor: None, options })
    }

    fn of_instrument(loaded: &LoadedInstrument, options: DetectOptions) -> Result<Self> {
        let instrument = &loaded.instrument;
        let table = twinpupil_optics::response_table_for(instrument)?;
        let settings = Options { detect: options, ..Options::default() };
        let reconstructor =
            Reconstructor::new(instrument.clone(), Some(table), settings).unmixing(&loaded.response_matrix()?);
        let band = |(index, band): (usize, &twinpupil_instrument::Band)| Band {
            name: band.name.clone(),
            plane: band.plane.clone(),
            index: Some(index),
        };
        Ok(Self {
            format: FrameFormat::of_instrument(instrument),
            mosaic: instrument.sensor.mosaic,
            bands: instrument.bands.iter().enumerate().map(band).collect(),
            reconstructor: Some(reconstructor),
            options,
        })
    }

    fn search(&self, files: &FrameFiles) -> Result<Done> {
        let frame = files.read(&self.format)?;
        let name = files.name.clone();
        let mut bands = Vec::with_capacity(self.bands.len());
        let mut rejected: Vec<Rejection> = Vec::new();
        for band in &self.bands {
            let found = match (&self.reconstructor, band.index) {
                (Some(reconstructor), Some(index)) => reconstructor.detect_band(&frame, index),
                _ => frame.plane(self.mosaic, &band.plane).map(|view| detect(&view, None, &self.options)),
            };
            let found = found.with_context(|| name.clone())?;
            rejected.extend(found.rejected.iter().map(|bystander| bystander.rejection(&band.name)));
            bands.push(BandFeatures { frame: name.clone(), band: band.name.clone(), features: found.features });
        }
        Ok(Done { bands, rejected: FrameRejections { frame: name, rejected } })
    }
}

fn summaries(done: &Done) -> Vec<BandSummary> {
    let one = |band: &BandFeatures| BandSummary {
        frame: band.frame.clone(),
        band: band.band.clone(),
        features: band.features.len(),
        rejected: done.rejected.rejected.iter().filter(|rejection| rejection.band == band.band).count(),
    };
    done.bands.iter().map(one).collect()
}

fn write(args: &Args, frames: Vec<Done>) -> Result<()> {
    let several = frames.len() > 1;
    let (bands, rejected): (Vec<_>, Vec<_>) = frames.into_iter().map(|done| (done.bands, done.rejected)).unzip();
    let bands: Vec<BandFeatures> = bands.into_iter().flatten().collect();
    let encoded = features::table(&bands, several).encode(args.output.as_deref())?;
    let mut outputs = Outputs::new();
    if let Some(path) = &args.rejected {
        outputs.add(path, rejected_table(&rejected).encode(Some(path))?);
    }
    outputs.add_or_print(args.output.as_deref(), encoded);
    outputs.commit()
}
