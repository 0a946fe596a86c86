//! Optical materials.

use std::collections::BTreeMap;

use thiserror::Error;

use crate::{Catalogue, Formula, MediumSpec, dispersion};

/// Why a material has no index.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum GlassError {
    /// A material without a dispersion formula.
    #[error("`{key}` is {material}; legal: one of {count} built-in materials such as PMMA and N-BK7")]
    Unknown {
        /// Where the file asks for it.
        key: String,
        /// What was asked for.
        material: String,
        /// How many there are.
        count: usize,
    },
    /// A wavelength at which a dispersion formula means nothing.
    #[error(
        "a wavelength of {wavelength_nm} nm is outside the dispersion formula of {material}; \
         legal: {min_nm} to {max_nm} nm"
    )]
    Wavelength {
        /// Of a band or of the lens's design, nm.
        wavelength_nm: f64,
        /// The material.
        material: String,
        /// Shortest legal wavelength, nm.
        min_nm: f64,
        /// Longest legal wavelength, nm.
        max_nm: f64,
    },
}

/// An optical material.
#[derive(Debug, Clone, PartialEq)]
pub struct Glass {
    name: String,
    medium: MediumSpec,
}

impl Glass {
    /// A material of that name; `medium` has been checked.
    pub fn new(name: impl Into<String>, medium: MediumSpec) -> Self {
        Self { name: name.into(), medium }
    }

    /// Air, against which all other indices are measured: that of every wavelength is 1.
    pub fn air() -> Self {
        let medium = MediumSpec { formula: Formula::Constant, coefficients: vec![1.0], wavelengths_nm: [1.0, 1e6] };
        Self::new("air", medium)
    }

    /// The built-in material of that name, in upper or lower case, that the file asks for under `key`.
    pub fn built_in(name: &str, key: &str) -> Result<&'static Self, GlassError> {
        let catalogue = Catalogue::built_in();
        catalogue.glass(name).ok_or_else(|| GlassError::Unknown {
            key: key.to_owned(),
            material: name.to_owned(),
            count: catalogue.glasses().len(),
        })
    }

    /// The material of that name, which the file asks for under `key`: one of the user's `own`, of `catalogues` in their
    /// order, or a built-in one.
    pub fn named(
        name: &str,
        own: &BTreeMap<String, MediumSpec>,
        catalogues: &[&Catalogue],
        key: &str,
    ) -> Result<Self, GlassError> {
        if let Some(medium) = own.get(name) {
            return Ok(Self::new(name, medium.clone()));
        }
        if name.eq_ignore_ascii_case("air") {
            return Ok(Self::air());
        }
        match catalogues.iter().find_map(|catalogue| catalogue.glass(name)) {
            Some(glass) => Ok(glass.clone()),
            None => Self::built_in(name, key).cloned(),
        }
    }

    /// The name used in files.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What it is made of: formula and coefficients.
    pub fn medium(&self) -> &MediumSpec {
        &self.medium
    }

    /// Shortest and longest wavelength at which it is known, nm.
    pub fn wavelengths_nm(&self) -> [f64; 2] {
        self.medium.wavelengths_nm
    }

    /// Refractive index against air at a wavelength within its range.
    pub fn index(&self, wavelength_nm: f64) -> Result<f64, GlassError> {
        let [min_nm, max_nm] = self.wavelengths_nm();
        let index = dispersion::index(&self.medium, wavelength_nm);
        if (min_nm..=max_nm).contains(&wavelength_nm) && (INDEX_MIN..=INDEX_MAX).contains(&index) {
            return Ok(index);
        }
        Err(GlassError::Wavelength { wavelength_nm, material: self.name.clone(), min_nm, max_nm })
    }
}

/// Indices beyond which a formula has left the transparent range.
const INDEX_MIN: f64 = 0.5;
const INDEX_MAX: f64 = 10.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pmma_has_its_published_indices() {
        let pmma = Glass::built_in("pmma", "lens.material").unwrap();
        for (wavelength_nm, expected) in [(450.0, 1.50159), (680.0, 1.48938)] {
            assert!((pmma.index(wavelength_nm).unwrap() - expected).abs() < 5e-6);
        }
    }

    #[test]
    fn unknown_names_and_opaque_wavelengths_are_refused() {
        let pmma = Glass::built_in("Pmma", "lens.material").unwrap();
        let message = Glass::built_in("glas", "lens.material").unwrap_err().to_string();
        let count = Catalogue::built_in().glasses().len();
        assert_eq!(
            message,
            format!("`lens.material` is glas; legal: one of {count} built-in materials such as PMMA and N-BK7")
        );
        for wavelength_nm in [349.0, 2001.0, f64::NAN] {
            assert!(pmma.index(wavelength_nm).is_err());
        }
        let message = pmma.index(10_600.0).unwrap_err().to_string();
        assert_eq!(
            message,
            "a wavelength of 10600 nm is outside the dispersion formula of PMMA; legal: 350 to 2000 nm"
        );
    }

    #[test]
    fn air_is_what_indices_are_measured_against() {
        assert_eq!(Glass::air().index(550.0), Ok(1.0));
    }
}
