//! Instruments and what they refer to, from the arguments of the command line.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use twinpupil_instrument::{Instrument, ResponseMatrix, SpectralTable, paper};

use crate::io::input;

/// The word that stands for the paper's instrument instead of a file.
pub const PAPER: &str = "paper";

/// An instrument, and the folder from which the files it names are found.
#[derive(Debug, Clone)]
pub struct LoadedInstrument {
    /// The instrument.
    pub instrument: Instrument,
    folder: PathBuf,
}

impl LoadedInstrument {
    /// Reads an instrument file; the word `paper` is the instrument of the paper, `-` standard input.
    pub fn load(argument: &Path) -> Result<Self> {
        if argument == Path::new(PAPER) {
            return Ok(Self { instrument: paper::instrument(), folder: PathBuf::new() });
        }
        let text = input::read_text(argument)?;
        let instrument = Instrument::from_toml(&text).with_context(|| argument.display().to_string())?;
        Ok(Self { instrument, folder: folder_of(argument) })
    }

    /// Signal in every plane from every band: from the curves of `[spectra]`, ideal where there is none.
    pub fn response_matrix(&self) -> Result<ResponseMatrix> {
        let instrument = &self.instrument;
        let Some(spectra) = &instrument.spectra else { return Ok(ResponseMatrix::ideal(&instrument.bands)) };
        let quantum_efficiency = self.curves(&spectra.quantum_efficiency, SpectralTable::nominal_quantum_efficiency)?;
        let filters = self.curves(&spectra.filters, SpectralTable::nominal_filters)?;
        ResponseMatrix::from_curves(&instrument.bands, instrument.sensor.mosaic, &quantum_efficiency, &filters)
            .context("spectra")
    }

    fn curves(&self, source: &str, nominal: fn() -> SpectralTable) -> Result<SpectralTable> {
        if source == "nominal" {
            return Ok(nominal());
        }
        let path = self.folder.join(source);
        SpectralTable::from_csv(&input::read_text(&path)?).with_context(|| path.display().to_string())
    }
}

/// The folder of a file: files that it names are relative to it.
pub fn folder_of(file: &Path) -> PathBuf {
    file.parent().map(Path::to_owned).unwrap_or_default()
}
