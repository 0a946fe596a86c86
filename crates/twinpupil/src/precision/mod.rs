//! How well a camera can locate dots over its working volume, and how well it does: what `analyze precision` computes.
//!
//! A [`Grid`] of depths and distances from the axis is where it is asked. [`Sheet`]s put dots on these places, as many
//! into one scene as find room without touching. The [`BoundStudy`] gives each dot its Cramér–Rao bound; [`Trial`]s
//! simulate noisy frames of the same sheets and read them, and an [`Achievement`] is what they come to at one place.

mod achieved;
mod bound;
mod grid;
mod sheet;
mod trial;

pub use achieved::{Achievement, Tally};
pub use bound::{BoundStudy, PlaceBound};
pub use grid::{Grid, Steps};
pub use sheet::{DotKind, Place, Sheet, SheetDot};
pub use trial::{Examiner, Located, Lost, Trial};

/// x, y and z of a dot as it would have them on the x axis: across the optical axis outwards, across it sideways, and
/// along it.
///
/// ```text
/// C' = R C Rᵀ     R turns by −φ about z
/// ```
pub fn turned_covariance_mm2(covariance_mm2: [[f64; 3]; 3], azimuth_rad: f64) -> [[f64; 3]; 3] {
    let columns = covariance_mm2.map(|row| turned(row, azimuth_rad));
    let turned = |k: usize| turned(std::array::from_fn(|i| columns[i][k]), azimuth_rad);
    let transposed = [turned(0), turned(1), turned(2)];
    std::array::from_fn(|i| std::array::from_fn(|k| transposed[k][i]))
}

/// A vector turned by −`azimuth_rad` about z.
pub fn turned([x, y, z]: [f64; 3], azimuth_rad: f64) -> [f64; 3] {
    let (sin, cos) = azimuth_rad.sin_cos();
    [cos * x + sin * y, cos * y - sin * x, z]
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    #[test]
    fn a_dot_on_the_y_axis_has_its_y_outwards() {
        let covariance = [[4.0, 0.0, 1.0], [0.0, 9.0, 2.0], [1.0, 2.0, 16.0]];
        let turned = turned_covariance_mm2(covariance, FRAC_PI_2);
        let expected = [[9.0, 0.0, 2.0], [0.0, 4.0, -1.0], [2.0, -1.0, 16.0]];
        for (found, expected) in turned.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((found - expected).abs() < 1e-12, "{turned:?}");
        }
    }
}
