//! Dispersion formulas.

use crate::{Formula, MediumSpec};

/// Refractive index by the formula of a medium; NaN where that gives none.
pub(crate) fn index(medium: &MediumSpec, wavelength_nm: f64) -> f64 {
    let um = wavelength_nm / 1000.0;
    let square = um * um;
    let given = &medium.coefficients;
    // What is left out is 0.
    let a = |k: usize| given.get(k).copied().unwrap_or(0.0);
    match medium.formula {
        Formula::Schott => (a(0) + a(1) * square + in_inverse(&given[1..], 1, square)).sqrt(),
        Formula::Sellmeier1 | Formula::Sellmeier3 | Formula::Sellmeier5 => (1.0 + resonances(given, square)).sqrt(),
        Formula::Sellmeier2 => {
            (1.0 + a(0) + a(1) * square / (square - a(2) * a(2)) + a(3) / (square - a(4) * a(4))).sqrt()
        }
        Formula::Sellmeier4 => (a(0) + resonances(given.get(1..).unwrap_or(&[]), square)).sqrt(),
        Formula::Herzberger => {
            let l = 1.0 / (square - 0.028);
            a(0) + l * (a(1) + l * a(2)) + square * (a(3) + square * (a(4) + square * a(5)))
        }
        Formula::Conrady => conrady([a(0), a(1), a(2)], um),
        Formula::Handbook1 => (a(0) + a(1) / (square - a(2)) - a(3) * square).sqrt(),
        Formula::Handbook2 => (a(0) + a(1) * square / (square - a(2)) - a(3) * square).sqrt(),
        Formula::Extended => (a(0) + a(1) * square + in_inverse(&given[1..], 1, square)).sqrt(),
        Formula::Extended2 => {
            let rising = a(0) + square * (a(1) + square * (a(6) + square * a(7)));
            (rising + in_inverse(&given[..given.len().min(6)], 2, square)).sqrt()
        }
        Formula::Extended3 => {
            let rising = a(0) + square * (a(1) + square * a(2));
            (rising + in_inverse(given, 3, square)).sqrt()
        }
        Formula::Cauchy => a(0) + in_inverse(given, 1, square),
        Formula::Constant => a(0),
        Formula::Abbe => conrady(through_abbe_number(a(0), a(1)), um),
        Formula::Table => between(given, wavelength_nm),
    }
}

/// `a₀ λ⁻² + a₁ λ⁻⁴ + …` of the coefficients from `first` on.
fn in_inverse(coefficients: &[f64], first: usize, square: f64) -> f64 {
    coefficients.iter().skip(first).rev().fold(0.0, |sum, coefficient| (coefficient + sum) / square)
}

/// `Σ Bᵢ λ²/(λ² − Cᵢ)`.
fn resonances(coefficients: &[f64], square: f64) -> f64 {
    coefficients.as_chunks::<2>().0.iter().map(|[b, c]| b * square / (square - c)).sum()
}

/// `n = a₀ + a₁/λ + a₂/λ^3.5`.
fn conrady([a0, a1, a2]: [f64; 3], um: f64) -> f64 {
    a0 + a1 / um + a2 / um.powf(3.5)
}

/// Conrady's coefficients of a normal glass of that index in the d line and that Abbe number.
///
/// ```text
/// n_F − n_C = (n_d − 1)/V,    n_g − n_F = (0.6438 − 0.001682 V)(n_F − n_C)        [SCHOTT TIE-29, normal line]
/// ```
fn through_abbe_number(index_d: f64, abbe_number: f64) -> [f64; 3] {
    if abbe_number == 0.0 {
        return [index_d, 0.0, 0.0];
    }
    let [g, f, d, c] = [0.435_834_3, 0.486_132_7, 0.587_561_8, 0.656_272_5].map(|um: f64| [1.0 / um, um.powf(-3.5)]);
    let dispersion = (index_d - 1.0) / abbe_number;
    let [main, blue] = [dispersion, (0.6438 - 0.001_682 * abbe_number) * dispersion];
    let [[p, q], [r, s]] = [[f[0] - c[0], f[1] - c[1]], [g[0] - f[0], g[1] - f[1]]];
    let determinant = p * s - q * r;
    let (a1, a2) = ((main * s - q * blue) / determinant, (p * blue - main * r) / determinant);
    [index_d - a1 * d[0] - a2 * d[1], a1, a2]
}

/// Between the two nearest of pairs of wavelength and index.
fn between(pairs: &[f64], wavelength_nm: f64) -> f64 {
    let pairs = pairs.as_chunks::<2>().0;
    let behind = pairs.partition_point(|[nm, _]| *nm < wavelength_nm).clamp(1, pairs.len() - 1);
    let ([nm, index], [next_nm, next_index]) = (pairs[behind - 1], pairs[behind]);
    index + (next_index - index) * (wavelength_nm - nm) / (next_nm - nm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Catalogue;

    fn at(formula: Formula, coefficients: &[f64], wavelength_nm: f64) -> f64 {
        let medium = MediumSpec { formula, coefficients: coefficients.to_vec(), wavelengths_nm: [200.0, 3000.0] };
        index(&medium, wavelength_nm)
    }

    /// Every formula at 500 nm, where λ² = 1/4, by hand.
    #[test]
    fn formulas_have_the_values_that_a_reader_works_out() {
        for (formula, coefficients, expected) in [
            (Formula::Schott, &[2.0, 0.4, 0.02, 0.005][..], (2.0_f64 + 0.1 + 0.08 + 0.08).sqrt()),
            (Formula::Sellmeier1, &[1.2, 0.05, 0.5, 0.125], (1.0_f64 + 1.5 + 1.0).sqrt()),
            (Formula::Sellmeier2, &[0.2, 0.6, 0.25, 0.1, 0.3], (1.2_f64 + 0.8 + 0.1 / 0.16).sqrt()),
            (Formula::Sellmeier4, &[1.5, 0.9, 0.025, 0.1, 100.0], (1.5_f64 + 1.0 - 0.025 / 99.75).sqrt()),
            (Formula::Herzberger, &[1.5, 0.0222, 0.0, 0.04, 0.16], 1.5 + 0.1 + 0.01 + 0.01),
            (Formula::Conrady, &[1.5, 0.01, 0.001], 1.5 + 0.02 + 0.001 * 128_f64.sqrt()),
            (Formula::Handbook1, &[2.2, 0.02, 0.05, 0.04], (2.2_f64 + 0.1 - 0.01).sqrt()),
            (Formula::Handbook2, &[1.2, 0.8, 0.05, 0.04], (1.2_f64 + 1.0 - 0.01).sqrt()),
            (Formula::Extended, &[2.0, 0.4, 0.02, 0.005], (2.0_f64 + 0.1 + 0.08 + 0.08).sqrt()),
            (
                Formula::Extended2,
                &[2.0, 0.4, 0.02, 0.005, 0.0, 0.0, 0.16, 0.64],
                (2.0_f64 + 0.1 + 0.08 + 0.08 + 0.01 + 0.01).sqrt(),
            ),
            (Formula::Extended3, &[2.0, 0.4, 0.16, 0.02, 0.005], (2.0_f64 + 0.1 + 0.01 + 0.08 + 0.08).sqrt()),
            (Formula::Cauchy, &[1.5, 0.004, 0.001], 1.5 + 0.016 + 0.016),
            (Formula::Constant, &[1.7], 1.7),
            (Formula::Table, &[400.0, 1.6, 600.0, 1.5, 800.0, 1.4], 1.55),
        ] {
            let found = at(formula, coefficients, 500.0);
            assert!((found - expected).abs() < 1e-14, "{formula:?}: {found} {expected}");
        }
    }

    #[test]
    fn a_glass_by_its_abbe_number_is_within_the_scatter_of_real_ones() {
        for name in ["N-BK7", "F2", "N-SK16", "N-SF6", "N-LAK22"] {
            let glass = Catalogue::built_in().glass(name).unwrap();
            let [f, d, c] = [486.1327, 587.5618, 656.2725].map(|nm| glass.index(nm).unwrap());
            let abbe = [d, (d - 1.0) / (f - c)];
            for (wavelength_nm, tolerance) in [(450.0, 5e-4), (486.1327, 2e-4), (587.5618, 1e-9), (680.0, 2e-4)] {
                let (found, expected) = (at(Formula::Abbe, &abbe, wavelength_nm), glass.index(wavelength_nm).unwrap());
                assert!((found - expected).abs() < tolerance, "{name} {wavelength_nm}: {found} {expected}");
            }
        }
    }
}
