//! The shape of a Fresnel lens: concentric facets, each a slice of its own conic, and the risers between them.
//!
//! Depths count from the plane of the groove peaks into the glass; the flat face lies at the lens's thickness. Groove
//! k starts at depth 0 at its peak, radius `k · pitch`, and falls towards the next peak. There a riser leads down
//! again: a cone, wider at its foot by the draft angle so that the mould comes off, which eats into the facet inside.
//!
//! A lens whose profile is one conic, cut up and pushed back onto a plane, has its focus pushed along, by up to 2.6 mm
//! of 100 for light at 16 mm from the axis. Real Fresnel lenses are cut for the plane they lie in, and so is this one.
//! Every facet has the conic constant of the plano-convex lens that is free of spherical aberration, with the vertex
//! and curvature that put its focus where that of the central groove is:
//!
//! - Grooves towards the image: hyperboloids, k = −n², about the focal point. A parallel beam meets there exactly.
//! - Grooves towards the object: ellipsoids, k = −1/n², about points within the glass that the flat face images into
//!   the focal point, exactly for light through the middle of the facet.
//!
//! Facet 0 is the base profile of either kind, `c = 1/((n − 1) f)`.

use twinpupil_instrument::{FresnelLens, GrooveSide};

use crate::OpticsError;
use crate::conic::Conic;

/// More grooves than any lens has; keeps a slip of the pen in the pitch from filling the memory.
const GROOVES_MAX: f64 = 200_000.0;

/// One facet and the riser at its outer end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Groove {
    pub(crate) facet: Conic,
    /// Radius of its peak, mm.
    pub(crate) peak_mm: f64,
    /// Radius of its valley, where the riser starts, mm.
    pub(crate) valley_mm: f64,
    /// Depth of its valley, mm.
    pub(crate) depth_mm: f64,
    /// Depth of the foot of the riser from its peak, the valley of the groove inside; 0 for the central groove.
    pub(crate) foot_mm: f64,
    /// Depth of the valley two grooves farther out: no line that leaves by this groove meets anything deeper.
    pub(crate) floor_mm: f64,
}

/// The grooves that cover `lens`, from the centre outwards; `index` is that of its glass at the design wavelength.
pub(crate) fn grooves(lens: &FresnelLens, index: f64) -> Result<Vec<Groove>, OpticsError> {
    let half_diagonal_mm = 0.5 * lens.size_mm[0].hypot(lens.size_mm[1]);
    let count = (half_diagonal_mm / lens.groove_pitch_mm).ceil();
    if count > GROOVES_MAX {
        return Err(OpticsError::TooManyGrooves { groove_pitch_mm: lens.groove_pitch_mm, count });
    }
    // One more than the lens holds, for lines that leave it at a slant.
    let mut grooves: Vec<Groove> = (0..=count as usize).map(|k| groove(lens, index, k)).collect::<Result<_, _>>()?;
    let depths_mm: Vec<f64> = grooves.iter().map(|groove| groove.depth_mm).collect();
    for (k, groove) in grooves.iter_mut().enumerate() {
        groove.foot_mm = if k == 0 { 0.0 } else { depths_mm[k - 1] };
        groove.floor_mm = depths_mm[depths_mm.len().min(k + 3) - 1];
    }
    Ok(grooves)
}

fn groove(lens: &FresnelLens, index: f64, k: usize) -> Result<Groove, OpticsError> {
    let pitch_mm = lens.groove_pitch_mm;
    let (peak_mm, next_peak_mm) = (k as f64 * pitch_mm, (k + 1) as f64 * pitch_mm);
    let facet = match lens.grooves {
        GrooveSide::Image => hyperboloid(lens.focal_length_mm, index, peak_mm),
        GrooveSide::Object => {
            // The central facet is whole: its focus is the paraxial one.
            let middle_mm = if k == 0 { 0.0 } else { peak_mm + 0.5 * pitch_mm };
            ellipsoid(lens, index, peak_mm, middle_mm)
        }
    };
    let valley_mm = valley_mm(&facet, peak_mm, next_peak_mm, lens.draft_deg.to_radians().tan());
    let depth_mm = facet.depth_mm(valley_mm);
    let deepest_mm = facet.depth_mm(next_peak_mm);
    // Also false for NaN: no such facet.
    if !(facet.curvature_per_mm > 0.0 && deepest_mm < lens.thickness_mm) {
        return Err(OpticsError::GrooveTooDeep { radius_mm: next_peak_mm, thickness_mm: lens.thickness_mm });
    }
    // Its neighbours give the other depths.
    Ok(Groove { facet, peak_mm, valley_mm, depth_mm, foot_mm: 0.0, floor_mm: depth_mm })
}

/// The facet of an infinitely narrow groove with its peak at a radius.
pub(crate) fn facet_at(lens: &FresnelLens, index: f64, r_mm: f64) -> Conic {
    match lens.grooves {
        GrooveSide::Image => hyperboloid(lens.focal_length_mm, index, r_mm),
        GrooveSide::Object => ellipsoid(lens, index, r_mm, r_mm),
    }
}

/// The hyperboloid through the peak whose focus is the focal point, f outside the plane of the peaks.
///
/// Equal optical paths from a plane wave in the glass to the focus: `n (depth of the vertex) + q = f_k`, q from the
/// peak to the focus, f_k from the vertex to the focus.
fn hyperboloid(f_mm: f64, n: f64, peak_mm: f64) -> Conic {
    let vertex_to_focus_mm = (n * f_mm - peak_mm.hypot(f_mm)) / (n - 1.0);
    Conic {
        vertex_mm: vertex_to_focus_mm - f_mm,
        curvature_per_mm: 1.0 / ((n - 1.0) * vertex_to_focus_mm),
        conic_constant: -n * n,
    }
}

/// The ellipsoid through the peak whose focus within the glass is imaged into the focal point by the flat face, for
/// light that meets it at the radius `middle_mm`.
fn ellipsoid(lens: &FresnelLens, n: f64, peak_mm: f64, middle_mm: f64) -> Conic {
    let mut depth_mm = 0.0;
    let mut facet = about_focus_in_glass(n * lens.focal_length_mm, n, peak_mm);
    // The depth at which the light meets the facet depends on the facet, weakly.
    for _ in 0..4 {
        facet = about_focus_in_glass(focus_in_glass_mm(lens, n, middle_mm, depth_mm), n, peak_mm);
        depth_mm = facet.depth_mm(middle_mm);
    }
    facet
}

/// The ellipsoid through the peak with a focus at a depth: equal optical paths, as for the hyperboloid.
fn about_focus_in_glass(focus_mm: f64, n: f64, peak_mm: f64) -> Conic {
    let vertex_to_focus_mm = (n * peak_mm.hypot(focus_mm) - focus_mm) / (n - 1.0);
    Conic {
        vertex_mm: focus_mm - vertex_to_focus_mm,
        curvature_per_mm: n / ((n - 1.0) * vertex_to_focus_mm),
        conic_constant: -1.0 / (n * n),
    }
}

/// Depth at which a ray from (radius, depth) would cross the axis within the glass if, beyond the flat face, it is to
/// cross it in the focal point.
fn focus_in_glass_mm(lens: &FresnelLens, n: f64, radius_mm: f64, depth_mm: f64) -> f64 {
    if radius_mm == 0.0 {
        return n * lens.focal_length_mm;
    }
    // The rear principal plane lies thickness/n before the flat face.
    let (air_mm, glass_mm) = (lens.focal_length_mm - lens.thickness_mm / n, lens.thickness_mm - depth_mm);
    // Newton's method for the sine w of the angle in air: air tan θ_air + glass tan θ_glass = radius.
    let tan = |sine: f64| sine / (1.0 - sine * sine).sqrt();
    let mut w = radius_mm / radius_mm.hypot(air_mm + glass_mm / n);
    for _ in 0..20 {
        let excess_mm = air_mm * tan(w) + glass_mm * tan(w / n) - radius_mm;
        let rate_mm = air_mm * (1.0 - w * w).powf(-1.5) + glass_mm / n * (1.0 - w * w / (n * n)).powf(-1.5);
        w = (w - excess_mm / rate_mm).clamp(0.0, 1.0 - 1e-12);
    }
    depth_mm + radius_mm / tan(w / n)
}

/// Where a facet meets the riser that comes down from the next peak, by bisection.
fn valley_mm(facet: &Conic, peak_mm: f64, next_peak_mm: f64, tan_draft: f64) -> f64 {
    let (mut inside, mut outside) = (peak_mm, next_peak_mm);
    for _ in 0..60 {
        let middle = 0.5 * (inside + outside);
        if middle + tan_draft * facet.depth_mm(middle) < next_peak_mm { inside = middle } else { outside = middle }
    }
    0.5 * (inside + outside)
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::Glass;

    use super::*;
    use crate::paraxial::base_curvature_per_mm;

    fn made(lens: &FresnelLens) -> Result<Vec<Groove>, OpticsError> {
        grooves(lens, Glass::built_in(&lens.material, "lens.material")?.index(lens.design_wavelength_nm)?)
    }

    #[test]
    fn facets_start_at_their_peaks_and_the_first_is_the_base_profile() {
        for side in [GrooveSide::Object, GrooveSide::Image] {
            let lens = crate::plate::tests::lens(side);
            let grooves = made(&lens).unwrap();
            let base = base_curvature_per_mm(&lens).unwrap();
            assert!((grooves[0].facet.curvature_per_mm / base - 1.0).abs() < 1e-12);
            assert!(grooves[0].facet.vertex_mm.abs() < 1e-12);
            for pair in grooves.windows(2) {
                let [groove, next] = [pair[0], pair[1]];
                assert!(groove.facet.depth_mm(groove.peak_mm).abs() < 1e-10);
                assert!(groove.peak_mm < groove.valley_mm && groove.valley_mm < next.peak_mm);
                // Facets grow steeper outwards, valleys deeper.
                assert!(groove.depth_mm < next.depth_mm);
            }
        }
    }

    #[test]
    fn impossible_grooves_are_refused() {
        let lens = crate::plate::tests::lens(GrooveSide::Object);
        let thin = FresnelLens { thickness_mm: 0.05, ..lens.clone() };
        assert!(matches!(made(&thin), Err(OpticsError::GrooveTooDeep { .. })));
        let short = FresnelLens { focal_length_mm: 20.0, grooves: GrooveSide::Image, ..lens.clone() };
        assert!(matches!(made(&short), Err(OpticsError::GrooveTooDeep { .. })));
        let fine = FresnelLens { groove_pitch_mm: 1e-3, size_mm: [1e4, 1e4], ..lens };
        assert!(matches!(made(&fine), Err(OpticsError::TooManyGrooves { .. })));
    }
}
