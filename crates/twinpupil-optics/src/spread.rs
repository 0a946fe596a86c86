//! Points that fill discs.

use std::f64::consts::{FRAC_PI_2, TAU};

/// Points on the unit circle.
pub(crate) fn rim(count: usize) -> impl Iterator<Item = [f64; 2]> {
    (0..count).map(move |k| {
        let (sin, cos) = (k as f64 / count as f64 * TAU).sin_cos();
        [cos, sin]
    })
}

/// Points that fill the unit disc evenly, mirrored from quadrant to quadrant: their centroid is the centre.
///
/// Azimuths follow the golden section. No two radii of a quadrant are alike, for rings of points would beat with the
/// rings of grooves.
pub(crate) fn quadrants(count: usize) -> impl Iterator<Item = [f64; 2]> + Clone {
    (0..count).flat_map(move |k| {
        let radius = ((k as f64 + 0.5) / count as f64).sqrt();
        let (sin, cos) = ((k as f64 * GOLDEN_SECTION).fract() * FRAC_PI_2).sin_cos();
        let (x, y) = (radius * cos, radius * sin);
        [[x, y], [-x, y], [-x, -y], [x, -y]]
    })
}

const GOLDEN_SECTION: f64 = 0.618_033_988_749_894_9;
