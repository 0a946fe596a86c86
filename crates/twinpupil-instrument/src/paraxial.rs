//! First-order properties of a sequence of surfaces, by the y-u trace.

/// A surface as a paraxial ray meets it, light coming from the object. Behind an odd number of mirrors index and gap are
/// negative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParaxialSurface {
    /// Power, `c (n' − n)` for a surface of curvature c, 1/mm.
    pub power_per_mm: f64,
    /// Refractive index behind the surface.
    pub index_behind: f64,
    /// Distance to the next surface, mm; of no effect on the last one.
    pub gap_behind_mm: f64,
}

/// A ray close to the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParaxialRay {
    /// Distance from the axis, mm.
    pub height_mm: f64,
    /// Growth of the height along the axis.
    pub slope: f64,
}

/// Focal length and principal planes of a lens in air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CardinalPoints {
    /// Focal length, mm.
    pub focal_length_mm: f64,
    /// Front principal plane from the first surface, mm, positive towards the image.
    pub front_principal_mm: f64,
    /// Rear principal plane from the last surface, mm, positive towards the image.
    pub rear_principal_mm: f64,
}

impl CardinalPoints {
    /// Traces a parallel paraxial ray each way through `surfaces`, in air.
    ///
    /// ```text
    /// f = −y₁/u'_last,    H' lies (y_last − y₁)/u'_last before the last surface
    /// ```
    pub fn of(surfaces: &[ParaxialSurface]) -> Self {
        let (focal_length_mm, rear_principal_mm) = parallel_ray(surfaces);
        let (_, front_from_first_mm) = parallel_ray(&reversed(surfaces));
        Self { focal_length_mm, front_principal_mm: -front_from_first_mm, rear_principal_mm }
    }
}

/// A ray before the first surface, from a medium of that index, where it meets each surface, with its slope behind it.
///
/// ```text
/// n' u' = n u − y φ,    y₊ = y + u' t        [Kingslake & Johnson, Lens Design Fundamentals, ch. 3]
/// ```
pub fn paraxial_rays(surfaces: &[ParaxialSurface], index_before: f64, ray: ParaxialRay) -> Vec<ParaxialRay> {
    let (mut index, mut gap_mm, mut ray) = (index_before, 0.0, ray);
    let behind = surfaces.iter().map(|surface| {
        let height_mm = ray.height_mm + ray.slope * gap_mm;
        let slope = (index * ray.slope - height_mm * surface.power_per_mm) / surface.index_behind;
        (index, gap_mm, ray) = (surface.index_behind, surface.gap_behind_mm, ParaxialRay { height_mm, slope });
        ray
    });
    behind.collect()
}

/// Focal length, and principal plane from the last surface, of a ray that comes in parallel to the axis.
fn parallel_ray(surfaces: &[ParaxialSurface]) -> (f64, f64) {
    let parallel = ParaxialRay { height_mm: 1.0, slope: 0.0 };
    let ParaxialRay { height_mm, slope } = paraxial_rays(surfaces, 1.0, parallel).last().copied().unwrap_or(parallel);
    (-1.0 / slope, (1.0 - height_mm) / slope)
}

/// The same surfaces met from the other side, from air into air.
fn reversed(surfaces: &[ParaxialSurface]) -> Vec<ParaxialSurface> {
    let before = |i: usize| if i == 0 { None } else { surfaces.get(i - 1) };
    (0..surfaces.len())
        .rev()
        .map(|i| ParaxialSurface {
            power_per_mm: surfaces[i].power_per_mm,
            index_behind: before(i).map_or(1.0, |previous| previous.index_behind),
            gap_behind_mm: before(i).map_or(0.0, |previous| previous.gap_behind_mm),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(power_per_mm: f64, index_behind: f64, gap_behind_mm: f64) -> ParaxialSurface {
        ParaxialSurface { power_per_mm, index_behind, gap_behind_mm }
    }

    #[test]
    fn a_thick_lens_follows_the_lensmaker() {
        // [Hecht, Optics, sec. 6.1]: 1/f = (n−1)(1/R₁ − 1/R₂ + (n−1)d/(n R₁R₂)), h₁ = −f(n−1)d/(n R₂), h₂ = −f(n−1)d/(n R₁).
        let (n, d, r1, r2) = (1.6, 7.0, 50.0, -80.0);
        let f = 1.0 / ((n - 1.0) * (1.0 / r1 - 1.0 / r2 + (n - 1.0) * d / (n * r1 * r2)));
        let found = CardinalPoints::of(&[surface((n - 1.0) / r1, n, d), surface((1.0 - n) / r2, 1.0, 0.0)]);
        assert!((found.focal_length_mm / f - 1.0).abs() < 1e-14);
        assert!((found.front_principal_mm + f * (n - 1.0) * d / (n * r2)).abs() < 1e-12);
        assert!((found.rear_principal_mm + f * (n - 1.0) * d / (n * r1)).abs() < 1e-12);
    }
}
