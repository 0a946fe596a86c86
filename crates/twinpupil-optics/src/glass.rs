//! Optical materials.

use crate::OpticsError;

/// A built-in optical material.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Glass {
    /// Polymethyl methacrylate, at 20 °C.
    Pmma,
}

/// Wavelengths at which the built-in dispersion formulas still describe a transparent glass, nm. The fit itself spans
/// 420 to 1620 nm; beyond that it is an extrapolation.
const WAVELENGTHS_NM: std::ops::RangeInclusive<f64> = 350.0..=2000.0;

impl Glass {
    /// All of them.
    pub const ALL: [Self; 1] = [Self::Pmma];

    /// The name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pmma => "pmma",
        }
    }

    /// The glass of that name.
    pub fn from_name(name: &str) -> Result<Self, OpticsError> {
        Self::ALL.into_iter().find(|glass| glass.name() == name).ok_or_else(|| OpticsError::UnknownMaterial {
            material: name.to_owned(),
            legal: Self::ALL.map(Self::name).join(", "),
        })
    }

    /// Refractive index against air at a wavelength of 350 to 2000 nm.
    ///
    /// ```text
    /// n² = 2.1778 + 6.1209e-3 λ² − 1.5004e-3 λ⁴ + 2.3678e-2 λ⁻² − 4.2137e-3 λ⁻⁴ + 7.3417e-4 λ⁻⁶ − 4.5042e-5 λ⁻⁸
    /// ```
    ///
    /// with λ in µm  [Beadie et al., Appl. Opt. 54, F139 (2015)].
    pub fn index(self, wavelength_nm: f64) -> Result<f64, OpticsError> {
        if !WAVELENGTHS_NM.contains(&wavelength_nm) {
            return Err(OpticsError::Wavelength {
                wavelength_nm,
                material: self.name(),
                min_nm: *WAVELENGTHS_NM.start(),
                max_nm: *WAVELENGTHS_NM.end(),
            });
        }
        let square = (wavelength_nm / 1000.0).powi(2);
        let Self::Pmma = self;
        let rising = 2.1778 + square * (6.1209e-3 - square * 1.5004e-3);
        let falling = (2.3678e-2 - (4.2137e-3 - (7.3417e-4 - 4.5042e-5 / square) / square) / square) / square;
        Ok((rising + falling).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pmma_has_its_published_indices() {
        for (wavelength_nm, expected) in [(450.0, 1.50159), (680.0, 1.48938)] {
            assert!((Glass::Pmma.index(wavelength_nm).unwrap() - expected).abs() < 5e-6);
        }
    }

    #[test]
    fn unknown_names_and_opaque_wavelengths_are_refused() {
        assert_eq!(Glass::from_name("pmma"), Ok(Glass::Pmma));
        let message = Glass::from_name("bk7").unwrap_err().to_string();
        assert_eq!(message, "`lens.material` is bk7; legal: pmma");
        for wavelength_nm in [349.0, 2001.0, f64::NAN] {
            assert!(Glass::Pmma.index(wavelength_nm).is_err());
        }
        let message = Glass::Pmma.index(10_600.0).unwrap_err().to_string();
        assert_eq!(
            message,
            "a wavelength of 10600 nm is outside the dispersion formula of pmma; legal: 350 to 2000 nm"
        );
    }
}
