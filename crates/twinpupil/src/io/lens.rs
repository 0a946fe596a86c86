//! Lenses that are given surface by surface: `.zmx` files, or prescriptions in TOML.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use twinpupil_instrument::{Catalogue, Prescription, PrescriptionSpec};
use twinpupil_optics::{Beam, FieldPoint, ZmxLens};

use super::input;

/// A lens and what its file says of its use.
#[derive(Debug)]
pub struct LensFile {
    /// The lens.
    pub prescription: Prescription,
    /// Wavelengths, nm, the primary one first.
    pub wavelengths_nm: Vec<f64>,
    /// What limits the beam.
    pub beam: Option<Beam>,
    /// Whether the stop is as wide as paraxial rays have that beam.
    pub has_paraxial_stop: bool,
    /// Points of the field.
    pub fields: Vec<FieldPoint>,
}

/// Where a file names no wavelengths: those of the d, F and C lines.
const WAVELENGTHS_NM: [f64; 3] = [587.5618, 486.1327, 656.2725];

/// Reads a lens: a `.zmx` file by its extension, else a prescription.
pub fn read_lens(path: &Path) -> Result<LensFile> {
    let name = || path.display().to_string();
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("zmx")) {
        let lens = ZmxLens::read(&input::read_bytes(path)?).with_context(name)?;
        let wavelengths_nm = if lens.wavelengths_nm.is_empty() { WAVELENGTHS_NM.to_vec() } else { lens.wavelengths_nm };
        let ZmxLens { prescription, beam, has_paraxial_stop, fields, .. } = lens;
        return Ok(LensFile { prescription, wavelengths_nm, beam, has_paraxial_stop, fields });
    }
    let prescription = Prescription::from_toml(&input::read_text(path)?).with_context(name)?;
    let wavelengths_nm = WAVELENGTHS_NM.to_vec();
    Ok(LensFile { prescription, wavelengths_nm, beam: None, has_paraxial_stop: false, fields: Vec::new() })
}

/// Reads a lens and puts what it needs of AGF catalogues among its own materials, so that it stands for itself.
pub fn read_with_glasses(path: &Path, catalogues: &[PathBuf]) -> Result<PrescriptionSpec> {
    let mut spec = PrescriptionSpec::clone(&read_lens(path)?.prescription);
    let catalogues = read_catalogues(catalogues)?;
    for surface in &spec.surfaces {
        let name = &surface.medium;
        if let Some(glass) = catalogues.iter().find_map(|catalogue| catalogue.glass(name)) {
            spec.media.entry(name.clone()).or_insert_with(|| glass.medium().clone());
        }
    }
    Ok(spec)
}

/// Reads AGF catalogues.
pub fn read_catalogues(paths: &[PathBuf]) -> Result<Vec<Catalogue>> {
    let read =
        |path: &PathBuf| Catalogue::from_agf(&input::read_bytes(path)?).with_context(|| path.display().to_string());
    paths.iter().map(read).collect()
}
