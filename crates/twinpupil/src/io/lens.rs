//! Lenses that are given surface by surface: `.zmx` files, or prescriptions in TOML.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use twinpupil_instrument::check::SyntaxError;
use twinpupil_instrument::{Catalogue, Glass, Prescription, PrescriptionSpec};
use twinpupil_optics::{Beam, FieldPoint, ZmxLens};

use super::input;

/// A lens and what its file says of its use.
#[derive(Debug)]
pub struct LensFile {
    path: PathBuf,
    /// The line on which the medium behind each surface is stated, where files are read by lines.
    medium_lines: Vec<usize>,
    /// What the file says beyond the lens that is read, line by line.
    pub notes: Vec<SyntaxError>,
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

/// Whether a file is a `.zmx` file, by its extension.
pub fn is_zmx(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("zmx"))
}

/// Reads a lens: a `.zmx` file by its extension, else a prescription.
fn read_lens(path: &Path) -> Result<LensFile> {
    let name = || path.display().to_string();
    if is_zmx(path) {
        let lens = ZmxLens::read(&input::read_bytes(path)?).with_context(name)?;
        let wavelengths_nm = if lens.wavelengths_nm.is_empty() { WAVELENGTHS_NM.to_vec() } else { lens.wavelengths_nm };
        let ZmxLens { prescription, beam, has_paraxial_stop, fields, medium_lines, notes, .. } = lens;
        let path = path.to_owned();
        return Ok(LensFile {
            path,
            medium_lines,
            notes,
            prescription,
            wavelengths_nm,
            beam,
            has_paraxial_stop,
            fields,
        });
    }
    let prescription = Prescription::from_toml(&input::read_text(path)?).with_context(name)?;
    Ok(LensFile {
        path: path.to_owned(),
        medium_lines: Vec::new(),
        notes: Vec::new(),
        prescription,
        wavelengths_nm: WAVELENGTHS_NM.to_vec(),
        beam: None,
        has_paraxial_stop: false,
        fields: Vec::new(),
    })
}

impl LensFile {
    /// What the user should know of the file, each with its name and line.
    pub fn warnings(&self) -> impl Iterator<Item = String> {
        self.notes.iter().map(|note| format!("{}: {note}", self.path.display()))
    }

    /// Refuses a lens of a material that is known nowhere.
    fn check_glasses(&self, catalogues: &[Catalogue]) -> Result<()> {
        let catalogues: Vec<&Catalogue> = catalogues.iter().collect();
        for (index, surface) in self.prescription.surfaces.iter().enumerate() {
            let key = format!("surface[{index}].medium");
            Glass::named(&surface.medium, &self.prescription.media, &catalogues, &key).with_context(|| {
                let line = self.medium_lines.get(index).map_or(String::new(), |line| format!(": line {line}"));
                format!("{}{line}", self.path.display())
            })?;
        }
        Ok(())
    }
}

/// Reads a lens and the AGF catalogues of its glasses, all of which must be known.
pub fn read_with_catalogues(path: &Path, catalogues: &[PathBuf]) -> Result<(LensFile, Vec<Catalogue>)> {
    let (file, catalogues) = (read_lens(path)?, read_catalogues(catalogues)?);
    file.check_glasses(&catalogues)?;
    Ok((file, catalogues))
}

/// Reads a lens and puts what it needs of AGF catalogues among its own materials, so that it stands for itself; beside it
/// what the user should know of the file.
pub fn read_with_glasses(path: &Path, catalogues: &[PathBuf]) -> Result<(PrescriptionSpec, Vec<String>)> {
    let (file, catalogues) = read_with_catalogues(path, catalogues)?;
    let mut spec = PrescriptionSpec::clone(&file.prescription);
    for surface in &spec.surfaces {
        let name = &surface.medium;
        if let Some(glass) = catalogues.iter().find_map(|catalogue| catalogue.glass(name)) {
            spec.media.entry(name.clone()).or_insert_with(|| glass.medium().clone());
        }
    }
    Ok((spec, file.warnings().collect()))
}

/// Reads AGF catalogues.
fn read_catalogues(paths: &[PathBuf]) -> Result<Vec<Catalogue>> {
    let read =
        |path: &PathBuf| Catalogue::from_agf(&input::read_bytes(path)?).with_context(|| path.display().to_string());
    paths.iter().map(read).collect()
}
