//! Isolated dots at given radii: what each mode makes of them without noise.

use crate::rig::{Rig, dots, nearest};

/// A recovered depth beside the true one.
#[derive(Debug, Clone, Copy)]
pub struct Depth {
    /// Distance of the dot from the axis, mm.
    pub r_mm: f64,
    /// Its true distance, mm.
    pub true_mm: f64,
    /// Its recovered distance, mm; `None` if it was not found.
    pub found_mm: Option<f64>,
}

/// Depths of isolated dots, noiseless: `(radius in mm, azimuth in degrees)` each, all at distance z.
pub fn depths(rig: &Rig, places: &[(f64, f64)], z_mm: f64) -> Vec<Depth> {
    let centre = |&(r_mm, azimuth_deg): &(f64, f64)| {
        let (sin, cos) = azimuth_deg.to_radians().sin_cos();
        [r_mm * cos, r_mm * sin, z_mm]
    };
    let centres_mm: Vec<[f64; 3]> = places.iter().map(centre).collect();
    let points = rig.points(&rig.frame(&dots(&centres_mm), None));
    let depth = |(&(r_mm, _), &centre_mm): (&(f64, f64), &[f64; 3])| Depth {
        r_mm,
        true_mm: z_mm,
        found_mm: nearest(&points, centre_mm).map(|point| point.position_mm[2]),
    };
    places.iter().zip(&centres_mm).map(depth).collect()
}

/// Two dots at r = 2 and two at r = 7.5.
pub const PAPER_PLACES: [(f64, f64); 4] = [(2.0, 20.0), (2.0, -110.0), (7.5, -10.0), (7.5, 170.0)];

/// Dots from r = 3 to 7.5, all round.
pub const OUTER_PLACES: [(f64, f64); 10] = [
    (3.0, 20.0),
    (3.0, 90.0),
    (3.25, 200.0),
    (3.5, -60.0),
    (4.0, 130.0),
    (5.0, -20.0),
    (6.0, 40.0),
    (7.0, 160.0),
    (7.5, 10.0),
    (6.5, -165.0),
];
