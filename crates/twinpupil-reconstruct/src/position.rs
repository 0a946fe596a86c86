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
    let jacobian = jacobian(|object_mm| model.chief_images(object_mm), position_mm);
    Some(Position { position_mm, covariance_mm2: covariance(&jacobian, pair)? })
}

/// The point whose modelled images lie nearest to the measured ones, by weighted least squares over all four image
/// coordinates.
///
/// Gauss–Newton from `start_mm`, with the slopes of the chief rays: what the lens adds to them changes slowly, so the
/// steps still shrink fast, at a tenth of the cost.
pub(crate) fn model_position(model: &Model, pair: &MeasuredPair, disc: &Disc, start_mm: [f64; 3]) -> Option<Position> {
    const ROUNDS: usize = 40;
    const RESTING_MM: f64 = 1e-6;
    let weights = pair.weights();
    let measured = MeasuredPair::vector(pair.images);
    let mut object_mm = start_mm;
    for _ in 0..ROUNDS {
        let slopes = jacobian(|object_mm| model.chief_images(object_mm), object_mm);
        let weighted = Matrix4x3::from_fn(|i, j| slopes[(i, j)] * weights[i]);
        let residual = (measured - MeasuredPair::vector(model.images(object_mm, disc))).component_mul(&weights);
        let step = (weighted.transpose() * weighted).cholesky()?.solve(&(weighted.transpose() * residual));
        for (coordinate, change) in object_mm.iter_mut().zip(step.iter()) {
            *coordinate += change;
        }
        if object_mm[2] <= 0.0 || !object_mm.iter().all(|c| c.is_finite()) {
            return None;
        }
        if step.norm() < RESTING_MM {
            break;
        }
    }
    let covariance_mm2 = covariance(&jacobian(|object_mm| model.chief_images(object_mm), object_mm), pair)?;
    Some(Position { position_mm: object_mm, covariance_mm2 })
}

/// Where the chief rays of the two bands meet, by bisection for the distance at which the ratio of their
/// magnifications is Γ.
pub(crate) fn first_order_position_mm(instrument: &Instrument, model: &Model, pair: &MeasuredPair) -> Option<[f64; 3]> {
    let gamma = pair.gamma();
    let excess = |z_mm: f64| {
        let [telecentric, entocentric] = model.magnifications(z_mm);
        telecentric / entocentric - gamma
    };
    let range = instrument.depth_range();
    let (mut near_mm, mut far_mm) = (0.5 * range.near_mm, 2.0 * range.far_mm);
    if !gamma.is_finite() || excess(near_mm).signum() == excess(far_mm).signum() {
        return None;
    }
    let rising = excess(far_mm) > 0.0;
    while far_mm - near_mm > 1e-6 {
        let middle_mm = 0.5 * (near_mm + far_mm);
        if (excess(middle_mm) > 0.0) == rising { far_mm = middle_mm } else { near_mm = middle_mm }
    }
    let [magnification, _] = model.magnifications(near_mm);
    let ImagePoint { x_mm, y_mm } = pair.images[0];
    Some([x_mm / magnification, y_mm / magnification, near_mm])
}

/// Change of the four image coordinates with the object's three, by central differences.
fn jacobian(images: impl Fn([f64; 3]) -> ImagePair, object_mm: [f64; 3]) -> Matrix4x3<f64> {
    const STEPS_MM: [f64; 3] = [1e-3, 1e-3, 1e-2];
    let mut jacobian = Matrix4x3::zeros();
    for (axis, step_mm) in STEPS_MM.into_iter().enumerate() {
        let at = |sign: f64| {
            let mut moved_mm = object_mm;
            moved_mm[axis] += sign * step_mm;
            MeasuredPair::vector(images(moved_mm))
        };
        jacobian.set_column(axis, &((at(1.0) - at(-1.0)) / (2.0 * step_mm)));
    }
    jacobian
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
