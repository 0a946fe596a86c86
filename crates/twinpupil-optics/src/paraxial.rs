//! First-order properties of a Fresnel lens.

use twinpupil_instrument::{CardinalPoints, FresnelLens, Glass, GlassError, GrooveSide, ParaxialSurface};

/// Focal length and principal planes of a Fresnel lens at a wavelength: a plano-convex lens whose convex vertex touches the groove peaks.
pub(crate) fn cardinal_points(lens: &FresnelLens, wavelength_nm: f64) -> Result<CardinalPoints, GlassError> {
    Ok(CardinalPoints::of(&surfaces(lens, wavelength_nm)?))
}

/// Base curvature of a Fresnel lens, by the lensmaker's equation for a plano-convex lens: `c = 1/((n − 1) f)`, 1/mm.
pub(crate) fn base_curvature_per_mm(lens: &FresnelLens) -> Result<f64, GlassError> {
    let index = Glass::built_in(&lens.material, "lens.material")?.index(lens.design_wavelength_nm)?;
    Ok(1.0 / ((index - 1.0) * lens.focal_length_mm))
}

fn surfaces(lens: &FresnelLens, wavelength_nm: f64) -> Result<[ParaxialSurface; 2], GlassError> {
    let index = Glass::built_in(&lens.material, "lens.material")?.index(wavelength_nm)?;
    let curvature_per_mm = base_curvature_per_mm(lens)?;
    let (first, last) = match lens.grooves {
        GrooveSide::Object => (curvature_per_mm, 0.0),
        GrooveSide::Image => (0.0, -curvature_per_mm),
    };
    Ok([
        ParaxialSurface { power_per_mm: first * (index - 1.0), index_behind: index, gap_behind_mm: lens.thickness_mm },
        ParaxialSurface { power_per_mm: last * (1.0 - index), index_behind: 1.0, gap_behind_mm: 0.0 },
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plate::tests::lens;

    #[test]
    fn a_fresnel_lens_has_its_focal_length_and_a_principal_plane_at_the_peaks() {
        for grooves in [GrooveSide::Object, GrooveSide::Image] {
            let lens = lens(grooves);
            let n = Glass::built_in("pmma", "lens.material").unwrap().index(587.6).unwrap();
            let found = cardinal_points(&lens, 587.6).unwrap();
            assert!((found.focal_length_mm - 100.0).abs() < 1e-12);
            let (at_peaks, inside) = match grooves {
                GrooveSide::Object => (found.front_principal_mm, -found.rear_principal_mm),
                GrooveSide::Image => (found.rear_principal_mm, found.front_principal_mm),
            };
            assert!(at_peaks.abs() < 1e-12 && (inside - 2.0 / n).abs() < 1e-12);
        }
    }

    #[test]
    fn dispersion_moves_the_focal_length_as_design_says() {
        for (wavelength_nm, expected_mm) in [(450.0, 98.19), (680.0, 100.64)] {
            let found = cardinal_points(&lens(GrooveSide::Object), wavelength_nm).unwrap();
            assert!((found.focal_length_mm - expected_mm).abs() < 0.005, "{found:?}");
        }
    }
}
