//! A material by its dispersion formula.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::{ValueError, within};

/// A material: its refractive index against air by wavelength.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MediumSpec {
    /// The equation that the coefficients belong to.
    pub formula: Formula,
    /// Its coefficients, in the order of the formula.
    pub coefficients: Vec<f64>,
    /// Shortest and longest wavelength at which it means something, nm.
    #[serde(default = "MediumSpec::default_wavelengths_nm")]
    pub wavelengths_nm: [f64; 2],
}

/// A dispersion formula; λ is in µm. All but the last four are those of AGF catalogues, with the order of their
/// coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Formula {
    /// `n² = a₀ + a₁ λ² + a₂ λ⁻² + a₃ λ⁻⁴ + a₄ λ⁻⁶ + a₅ λ⁻⁸` (AGF 1).
    Schott,
    /// `n² − 1 = Σ Bᵢ λ²/(λ² − Cᵢ)`, three terms B₁, C₁, B₂, C₂, … (AGF 2).
    #[serde(rename = "sellmeier-1")]
    Sellmeier1,
    /// `n = a₀ + a₁ L + a₂ L² + a₃ λ² + a₄ λ⁴ + a₅ λ⁶`, L = 1/(λ² − 0.028) (AGF 3).
    Herzberger,
    /// `n² − 1 = A + B₁ λ²/(λ² − λ₁²) + B₂/(λ² − λ₂²)`, coefficients A, B₁, λ₁, B₂, λ₂ (AGF 4).
    #[serde(rename = "sellmeier-2")]
    Sellmeier2,
    /// `n = a₀ + a₁/λ + a₂/λ^3.5` (AGF 5).
    Conrady,
    /// As `sellmeier-1`, four terms (AGF 6).
    #[serde(rename = "sellmeier-3")]
    Sellmeier3,
    /// `n² = A + B/(λ² − C) − D λ²` (AGF 7).
    #[serde(rename = "handbook-1")]
    Handbook1,
    /// `n² = A + B λ²/(λ² − C) − D λ²` (AGF 8).
    #[serde(rename = "handbook-2")]
    Handbook2,
    /// `n² = A + B λ²/(λ² − C) + D λ²/(λ² − E)` (AGF 9).
    #[serde(rename = "sellmeier-4")]
    Sellmeier4,
    /// `n² = a₀ + a₁ λ² + a₂ λ⁻² + a₃ λ⁻⁴ + … + a₇ λ⁻¹²` (AGF 10).
    Extended,
    /// As `sellmeier-1`, five terms (AGF 11).
    #[serde(rename = "sellmeier-5")]
    Sellmeier5,
    /// `n² = a₀ + a₁ λ² + a₂ λ⁻² + a₃ λ⁻⁴ + a₄ λ⁻⁶ + a₅ λ⁻⁸ + a₆ λ⁴ + a₇ λ⁶` (AGF 12).
    #[serde(rename = "extended-2")]
    Extended2,
    /// `n² = a₀ + a₁ λ² + a₂ λ⁴ + a₃ λ⁻² + a₄ λ⁻⁴ + … + a₈ λ⁻¹²` (AGF 13).
    #[serde(rename = "extended-3")]
    Extended3,
    /// `n = a₀ + a₁ λ⁻² + a₂ λ⁻⁴ + …`.
    Cauchy,
    /// One index for all wavelengths.
    Constant,
    /// A glass known by its index in the d line, 587.56 nm, and its Abbe number: `n = a₀ + a₁/λ + a₂/λ^3.5` with the
    /// partial dispersion of normal glasses, P_gF = 0.6438 − 0.001682 V.
    Abbe,
    /// Pairs of wavelength in nm and index, wavelengths rising; between them a straight line.
    Table,
}

impl Formula {
    /// Whether its coefficients come in pairs.
    pub(crate) fn is_of_pairs(self) -> bool {
        matches!(self, Self::Sellmeier1 | Self::Sellmeier3 | Self::Sellmeier5)
    }

    /// Least and largest number of coefficients.
    pub fn coefficient_counts(self) -> [usize; 2] {
        match self {
            Self::Schott | Self::Herzberger | Self::Sellmeier1 => [1, 6],
            Self::Sellmeier2 | Self::Sellmeier4 => [1, 5],
            Self::Conrady => [1, 3],
            Self::Handbook1 | Self::Handbook2 => [1, 4],
            Self::Sellmeier3 | Self::Extended | Self::Extended2 => [1, 8],
            Self::Extended3 => [1, 9],
            Self::Sellmeier5 => [1, 10],
            Self::Cauchy => [1, 10],
            Self::Constant => [1, 1],
            Self::Abbe => [2, 2],
            Self::Table => [4, 20_000],
        }
    }
}

impl MediumSpec {
    fn default_wavelengths_nm() -> [f64; 2] {
        [200.0, 20_000.0]
    }

    /// Checks numbers and their number; `key` names the medium in messages.
    pub fn check(&self, key: &str) -> Result<(), ValueError> {
        let [shortest_nm, longest_nm] = self.wavelengths_nm;
        within(&format!("{key}.wavelengths_nm[0]"), shortest_nm, 1.0, 1e6)?;
        within(&format!("{key}.wavelengths_nm[1]"), longest_nm, shortest_nm, 1e6)?;
        let [least, most] = self.formula.coefficient_counts();
        let count = self.coefficients.len();
        if count < least || count > most {
            let legal = if least == most { format!("{least}") } else { format!("{least} to {most}") };
            return Err(ValueError::new(format!("{key}.coefficients"), format!("{count} numbers"), legal));
        }
        for (k, coefficient) in self.coefficients.iter().enumerate() {
            within(&format!("{key}.coefficients[{k}]"), *coefficient, -1e12, 1e12)?;
        }
        if self.formula == Formula::Table { self.check_table(key) } else { Ok(()) }
    }

    fn check_table(&self, key: &str) -> Result<(), ValueError> {
        let (pairs, rest) = self.coefficients.as_chunks::<2>();
        let rising = pairs.windows(2).all(|pair| pair[0][0] < pair[1][0]);
        if rising && rest.is_empty() && pairs[0][0] > 0.0 {
            return Ok(());
        }
        Err(ValueError::new(
            format!("{key}.coefficients"),
            "a table",
            "pairs of wavelength_nm, index; wavelengths rising",
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(formula: Formula, coefficients: &[f64]) -> Result<(), ValueError> {
        MediumSpec { formula, coefficients: coefficients.to_vec(), wavelengths_nm: [400.0, 700.0] }.check("media.glass")
    }

    #[test]
    fn coefficients_are_counted_and_must_be_numbers() {
        assert!(check(Formula::Constant, &[1.5]).is_ok());
        let message = check(Formula::Abbe, &[1.5]).unwrap_err().to_string();
        assert_eq!(message, "`media.glass.coefficients` is 1 numbers; legal: 2");
        assert!(check(Formula::Schott, &[2.0, f64::NAN]).is_err());
        assert!(check(Formula::Schott, &[]).is_err());
    }

    #[test]
    fn a_table_has_pairs_that_rise() {
        assert!(check(Formula::Table, &[400.0, 1.53, 700.0, 1.51]).is_ok());
        assert!(check(Formula::Table, &[700.0, 1.53, 400.0, 1.51]).is_err());
        assert!(check(Formula::Table, &[400.0, 1.53, 700.0, 1.51, 800.0]).is_err());
    }
}
