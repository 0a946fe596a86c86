//! From a pair of image positions to a point in space.

use nalgebra::{Matrix3, Matrix4x3, Vector3, Vector4};
use twinpupil_instrument::{ImagePoint, Instrument, position_from_radii_mm};

use crate::model::{Disc, ImagePair, Model};

/// A point in space with the covariance that the two features' noise gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Position {
    pub(crate) position_mm: [f64; 3],
    /// Of x, y and z, mm².
    pub(crate) covariance_mm2: Matrix3<f64>,
}

/// The two images of one feature as measured, in mm from the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct MeasuredPair {
    pub(crate) images: ImagePair,
    /// Standard deviations along x and y of the telecentric and the entocentric image, mm.
    pub(crate) std_mm: [[f64; 2]; 2],
}

impl MeasuredPair {
    /// Γ, the ratio of the telecentric to the entocentric radius.
    pub(crate) fn gamma(&self) -> f64 {
        self.images[0].radius_mm() / self.images[1].radius_mm()
    }

    fn vector(images: ImagePair) -> Vector4<f64> {
        Vector4::new(images[0].x_mm, images[0].y_mm, images[1].x_mm, images[1].y_mm)
    }

    /// One over the standard deviations, in the order of [`Self::vector`].
    fn weights(&self) -> Vector4<f64> {
        // Features without noise still weigh evenly.
        const STD_MIN_MM: f64 = 1e-9;
        let [telecentric, entocentric] = self.std_mm;
        Vector4::new(telecentric[0], telecentric[1], entocentric[0], entocentric[1])
            .map(|std_mm| 1.0 / std_mm.max(STD_MIN_MM))
    }
}

/// The paper's position: Γ and the mean azimuth through the data sheet's f and L  [Ohno2018, Eqs. 11–13].
pub(crate) fn paper_position(instrument: &Instrument, model: &Model, pair: &MeasuredPair) -> Option<Position> {
    let (f, l) = (instrument.lens.focal_length_mm(), instrument.sensor.distance_mm);
    let [telecentric, entocentric] = pair.images;
    let azimuth_rad = 0.5 * (telecentric.azimuth_rad() + entocentric.azimuth_rad());
    let position_mm = position_from_radii_mm(f, l, telecentric.radius_mm(), entocentric.radius_mm(), azimuth_rad)?;
    Some(Position { position_mm, covariance_mm2: covariance(&chief_slopes(model, position_mm), pair)? })
}

/// The point whose modelled images lie nearest to the measured ones, by weighted least squares over all four image
/// coordinates.
///
/// Gauss–Newton from `start_mm`, with the slopes of the chief rays: what the lens adds to them changes slowly, so the
/// steps still shrink fast, at a tenth of the cost. They end where the next one would be too small to matter.
pub(crate) fn model_position(model: &Model, pair: &MeasuredPair, disc: &Disc, start_mm: [f64; 3]) -> Option<Position> {
    const ROUNDS: usize = 40;
    // A hundredth of the noise at its best.
    const RESTING_MM: f64 = 1e-5;
    const RATIO_UNKNOWN: f64 = 0.5;
    let weights = pair.weights();
    let measured = MeasuredPair::vector(pair.images);
    let mut object_mm = start_mm;
    let mut before_mm: Option<f64> = None;
    for _ in 0..ROUNDS {
        let slopes = chief_slopes(model, object_mm);
        let weighted = Matrix4x3::from_fn(|i, j| slopes[(i, j)] * weights[i]);
        let residual = (measured - MeasuredPair::vector(model.images(object_mm, disc))).component_mul(&weights);
        let step = (weighted.transpose() * weighted).cholesky()?.solve(&(weighted.transpose() * residual));
        for (coordinate, change) in object_mm.iter_mut().zip(step.iter()) {
            *coordinate += change;
        }
        if object_mm[2] <= 0.0 || !object_mm.iter().all(|c| c.is_finite()) {
            return None;
        }
        let step_mm = step.norm();
        let ratio = before_mm.map_or(RATIO_UNKNOWN, |before_mm| (step_mm / before_mm).min(1.0));
        if ratio * step_mm < RESTING_MM {
            break;
        }
        before_mm = Some(step_mm);
    }
    let covariance_mm2 = covariance(&chief_slopes(model, object_mm), pair)?;
    Some(Position { position_mm: object_mm, covariance_mm2 })
}

/// Where the chief rays of the two bands meet, by regula falsi (Illinois) for the distance at which the ratio of their
/// magnifications is Γ.
pub(crate) fn first_order_position_mm(instrument: &Instrument, model: &Model, pair: &MeasuredPair) -> Option<[f64; 3]> {
    const ROUNDS: usize = 60;
    const RESTING_MM: f64 = 1e-6;
    let gamma = pair.gamma();
    let excess = |z_mm: f64| {
        let [telecentric, entocentric] = model.magnifications(z_mm);
        telecentric / entocentric - gamma
    };
    let range = instrument.depth_range();
    let (mut a_mm, mut b_mm) = (0.5 * range.near_mm, 2.0 * range.far_mm);
    let (mut at_a, mut at_b) = (excess(a_mm), excess(b_mm));
    if !gamma.is_finite() || at_a.signum() == at_b.signum() {
        return None;
    }
    // b is always the end that was found last.
    for _ in 0..ROUNDS {
        let z_mm = (a_mm * at_b - b_mm * at_a) / (at_b - at_a);
        let (moved_mm, at_z) = ((z_mm - b_mm).abs(), excess(z_mm));
        if at_z.signum() == at_b.signum() {
            at_a *= 0.5
        } else {
            (a_mm, at_a) = (b_mm, at_b)
        }
        (b_mm, at_b) = (z_mm, at_z);
        if at_z == 0.0 || moved_mm < RESTING_MM {
            break;
        }
    }
    let [magnification, _] = model.magnifications(b_mm);
    let ImagePoint { x_mm, y_mm } = pair.images[0];
    Some([x_mm / magnification, y_mm / magnification, b_mm])
}

/// Change of the four first-order image coordinates with the object's three: along z by central differences.
fn chief_slopes(model: &Model, object_mm: [f64; 3]) -> Matrix4x3<f64> {
    const STEP_MM: f64 = 1e-2;
    let [x_mm, y_mm, z_mm] = object_mm;
    let [r, b] = model.magnifications(z_mm);
    let at = |z_mm: f64| MeasuredPair::vector(model.chief_images([x_mm, y_mm, z_mm]));
    let along_z = (at(z_mm + STEP_MM) - at(z_mm - STEP_MM)) / (2.0 * STEP_MM);
    Matrix4x3::new(r, 0.0, along_z[0], 0.0, r, along_z[1], b, 0.0, along_z[2], 0.0, b, along_z[3])
}

/// `(Jᵀ W J)⁻¹`.
fn covariance(jacobian: &Matrix4x3<f64>, pair: &MeasuredPair) -> Option<Matrix3<f64>> {
    let weights = pair.weights();
    let weighted = Matrix4x3::from_fn(|i, j| jacobian[(i, j)] * weights[i]);
    Some((weighted.transpose() * weighted).cholesky()?.inverse())
}

impl Position {
    /// Standard deviations of x, y and z, mm.
    pub(crate) fn std_mm(&self) -> [f64; 3] {
        let variance: Vector3<f64> = self.covariance_mm2.diagonal();
        [variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt()]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use twinpupil_instrument::paper;

    use super::*;

    const STD_MM: f64 = 5e-5;
    const FACING: Disc = Disc { diameter_mm: 1.0, slopes: [0.0; 2] };

    fn pair(model: &Model, object_mm: [f64; 3]) -> MeasuredPair {
        MeasuredPair { images: model.chief_images(object_mm), std_mm: [[STD_MM; 2]; 2] }
    }

    proptest! {
        #[test]
        fn projecting_and_positioning_is_the_identity(
            r_mm in 0.5..9.0_f64, azimuth_rad in -3.1..3.1_f64, z_mm in 240.0..365.0_f64,
        ) {
            let instrument = paper::instrument();
            let model = Model::new(&instrument, None);
            let object_mm = [r_mm * azimuth_rad.cos(), r_mm * azimuth_rad.sin(), z_mm];
            let pair = pair(&model, object_mm);
            let paper = paper_position(&instrument, &model, &pair).expect("off the axis");
            let start_mm = first_order_position_mm(&instrument, &model, &pair).expect("off the axis");
            let found = model_position(&model, &pair, &FACING, start_mm).expect("off the axis");
            for (axis, expected_mm) in object_mm.into_iter().enumerate() {
                prop_assert!((paper.position_mm[axis] - expected_mm).abs() < 1e-9);
                prop_assert!((found.position_mm[axis] - expected_mm).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn the_depth_deviation_is_that_of_the_ratio() {
        // σ_z = z √((σ/r_R)² + (σ/r_B)²)   from z ∝ r_R / r_B.
        let instrument = paper::instrument();
        let model = Model::new(&instrument, None);
        let pair = pair(&model, [0.0, 4.0, 310.0]);
        let [r, b] = pair.images.map(|image| image.radius_mm());
        let expected_mm = 310.0 * (STD_MM / r).hypot(STD_MM / b);
        let found = model_position(&model, &pair, &FACING, [0.0, 4.0, 310.0]).expect("off the axis");
        assert!((found.std_mm()[2] / expected_mm - 1.0).abs() < 1e-3);
    }

    #[test]
    fn on_axis_has_no_position() {
        let instrument = paper::instrument();
        let model = Model::new(&instrument, None);
        let pair = pair(&model, [0.0, 0.0, 300.0]);
        assert_eq!(paper_position(&instrument, &model, &pair), None);
        assert_eq!(first_order_position_mm(&instrument, &model, &pair), None);
    }
}
