//! Instruments and scenes, and the files they refer to, from the arguments of the command line.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use twinpupil_instrument::{Instrument, InstrumentSpec, Lens, ResponseMatrix, SpectralTable, builtin, check};
use twinpupil_reconstruct::noise_gain;
use twinpupil_simulate::{Picture, Scene};

use crate::console::Console;
use crate::io::{input, lens, page};

/// The word that stands for the paper's scene instead of a file.
pub const PAPER: &str = "paper";

/// Largest growth of noise by unmixing at which the bands can still be told apart.
const NOISE_GAIN_MAX: f64 = 3.0;

/// An instrument, and the folder from which the files it names are found.
#[derive(Debug, Clone)]
pub struct LoadedInstrument {
    /// The instrument.
    pub instrument: Instrument,
    folder: PathBuf,
}

impl LoadedInstrument {
    /// Reads an instrument file; a name such as `paper` is an instrument that ships, `-` standard input. What the user should
    /// know of the lens file that it may name goes to the console.
    pub fn load(argument: &Path, console: &Console) -> Result<Self> {
        if let Some(text) = argument.to_str().and_then(builtin::toml) {
            return Ok(Self { instrument: Instrument::from_toml(text)?, folder: PathBuf::new() });
        }
        if lens::is_zmx(argument) {
            let lens = argument.display();
            bail!("{lens}: a lens, not an instrument file; `twinpupil design {lens} --distance-mm MM` makes one of it");
        }
        let text = input::read_text(argument)?;
        let folder = folder_of(argument);
        let (instrument, warnings) = read_instrument(&text, &folder).with_context(|| argument.display().to_string())?;
        warnings.iter().for_each(|warning| console.note(warning));
        Ok(Self { instrument, folder })
    }

    /// Signal in every plane from every band: from the curves of `[spectra]`, or what the instrument states by itself.
    pub fn response_matrix(&self) -> Result<ResponseMatrix> {
        let instrument = &self.instrument;
        let (source, response) = match &instrument.spectra {
            Some(spectra) => {
                let sensor = self.curves(&spectra.quantum_efficiency, SpectralTable::nominal_quantum_efficiency)?;
                let filters = self.curves(&spectra.filters, SpectralTable::nominal_filters)?;
                let bands = &instrument.bands;
                let response = ResponseMatrix::from_curves(bands, instrument.sensor.mosaic, &sensor, &filters);
                ("spectra", response.context("spectra")?)
            }
            None => ("crosstalk", instrument.response_matrix()),
        };
        match noise_gain(instrument, &response) {
            Some(gain) if gain <= NOISE_GAIN_MAX => Ok(response),
            Some(gain) => bail!(
                "{source}: the planes see the bands so much alike that unmixing makes noise {gain:.1} times as large; \
                 legal: up to {NOISE_GAIN_MAX} times"
            ),
            None => bail!("{source}: the planes see the bands so much alike that they cannot be told apart"),
        }
    }

    fn curves(&self, source: &str, nominal: fn() -> SpectralTable) -> Result<SpectralTable> {
        if source == "nominal" {
            return Ok(nominal());
        }
        let path = self.folder.join(source);
        SpectralTable::from_csv(&input::read_text(&path)?).with_context(|| path.display().to_string())
    }
}

/// The instrument of a file in a folder, with the surfaces of the lens file that it may name, and what the user should know
/// of that file.
fn read_instrument(text: &str, folder: &Path) -> Result<(Instrument, Vec<String>)> {
    let mut warnings = Vec::new();
    let mut spec: InstrumentSpec = check::parse_toml(text)?;
    if let Lens::Prescription(stated) = &mut spec.lens
        && stated.prescription.is_none()
        && let Some(file) = stated.file.take()
    {
        let catalogues: Vec<PathBuf> = stated.catalogues.drain(..).map(|path| folder.join(path)).collect();
        let (prescription, told) = lens::read_with_glasses(&folder.join(file), &catalogues)?;
        (stated.prescription, warnings) = (Some(prescription), told);
    }
    Ok((Instrument::new(spec)?, warnings))
}

/// Distance and seed of the paper's plate behind the word `paper`; the experiment has it at 250 to 350 mm.
const PAPER_PLATE_MM: f64 = 300.0;
const PAPER_PLATE_SEED: u64 = 1;

/// Reads a scene file with the picture it may name; the word `paper` is the random plate of the paper at 300 mm, `-`
/// standard input.
pub fn scene(argument: &Path) -> Result<Scene> {
    if argument == Path::new(PAPER) {
        return Ok(twinpupil_simulate::paper::random_plate(PAPER_PLATE_MM, PAPER_PLATE_SEED)?);
    }
    let text = input::read_text(argument)?;
    let scene = Scene::from_toml(&text).with_context(|| argument.display().to_string())?;
    let Some(picture) = scene.picture_path().map(|path| folder_of(argument).join(path)) else { return Ok(scene) };
    let picture = read_picture(&picture)?;
    scene.with_picture(picture).with_context(|| argument.display().to_string())
}

/// Reads a PNG or TIFF as grey values of 0 to 1; colours are averaged.
fn read_picture(path: &Path) -> Result<Picture> {
    let bytes = input::read_bytes(path)?;
    let pages = page::decode(&bytes, None).with_context(|| path.display().to_string())?;
    let page = &pages[0];
    let white = page.channels as f32 * if page.bits == 8 { 255.0 } else { 65_535.0 };
    let grey = |pixel: &[u16]| pixel.iter().map(|&sample| f32::from(sample)).sum::<f32>() / white;
    let values = page.samples.chunks_exact(page.channels).map(grey).collect();
    Ok(Picture::new(page.size_px[0], page.size_px[1], values)?)
}

/// Whether a file is an instrument, which has a sensor, and not the lens of one.
pub fn is_instrument(path: &Path) -> Result<bool> {
    if path.to_str().and_then(builtin::toml).is_some() {
        return Ok(true);
    }
    if lens::is_zmx(path) {
        return Ok(false);
    }
    let table: Option<toml::Table> = toml::from_str(&input::read_text(path)?).ok();
    Ok(table.is_some_and(|table| table.contains_key("sensor")))
}

/// The folder of a file: files that it names are relative to it.
pub fn folder_of(file: &Path) -> PathBuf {
    file.parent().map(Path::to_owned).unwrap_or_default()
}
