//! From the image positions of one thing to a point in space.

use nalgebra::{Matrix2x3, Matrix3, Vector2, Vector3};
use twinpupil_instrument::{ImagePoint, Instrument, position_from_radii_mm};

use crate::model::{Disc, Model};

/// A point in space with the covariance that its features' noise gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Position {
    pub(crate) position_mm: [f64; 3],
    /// Of x, y and z, mm².
    pub(crate) covariance_mm2: Matrix3<f64>,
    /// How far the images lie from the modelled ones, in deviations, squared and added up.
    pub(crate) chi2: f64,
}

/// An image of one thing as a band measures it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sighting {
    /// Index of the band in the model.
    pub(crate) band: usize,
    /// In mm from the axis.
    pub(crate) image: ImagePoint,
    /// Standard deviations along x and y, mm.
    pub(crate) std_mm: [f64; 2],
}

impl Sighting {
    /// One over the standard deviations.
    fn weights(&self) -> Vector2<f64> {
        // Features without noise still weigh evenly.
        const STD_MIN_MM: f64 = 1e-9;
        Vector2::from(self.std_mm.map(|std_mm| 1.0 / std_mm.max(STD_MIN_MM)))
    }
}

/// Γ, the ratio of the telecentric to the entocentric radius.
pub(crate) fn gamma(pair: &[Sighting; 2]) -> f64 {
    pair[0].image.radius_mm() / pair[1].image.radius_mm()
}

/// The paper's position: Γ and the mean azimuth through the data sheet's f and L  [Ohno2018, Eqs. 11–13].
pub(crate) fn paper_position(instrument: &Instrument, model: &Model, pair: &[Sighting; 2]) -> Option<Position> {
    let (f, l) = (instrument.lens.focal_length_mm(), instrument.sensor.distance_mm);
    let [telecentric, entocentric] = [pair[0].image, pair[1].image];
    let azimuth_rad = 0.5 * (telecentric.azimuth_rad() + entocentric.azimuth_rad());
    let position_mm = position_from_radii_mm(f, l, telecentric.radius_mm(), entocentric.radius_mm(), azimuth_rad)?;
    let Normal { information, chi2, .. } =
        Normal::of(model, pair, position_mm, |band, object_mm| model.chief_image(band, object_mm));
    Some(Position { position_mm, covariance_mm2: information.cholesky()?.inverse(), chi2 })
}

/// The point whose modelled images lie nearest to the measured ones, by weighted least squares over both coordinates of
/// all images.
///
/// ```text
/// X ← X + (Σ_bands Jᵀ W J)⁻¹ Σ_bands Jᵀ W (p − p(X))        covariance (Σ Jᵀ W J)⁻¹
/// ```
///
/// Gauss–Newton from `start_mm`, with the slopes of the chief rays: what the lens adds to them changes slowly, so the
/// steps still shrink fast, at a tenth of the cost. They end where the next one would be too small to matter.
pub(crate) fn model_position(
    model: &Model,
    sightings: &[Sighting],
    disc: &Disc,
    start_mm: [f64; 3],
) -> Option<Position> {
    const ROUNDS: usize = 40;
    // A hundredth of the noise at its best.
    const RESTING_MM: f64 = 1e-5;
    const RATIO_UNKNOWN: f64 = 0.5;
    let normal_at =
        |object_mm| Normal::of(model, sightings, object_mm, |band, object_mm| model.image(band, object_mm, disc));
    let mut object_mm = start_mm;
    let mut before_mm: Option<f64> = None;
    for _ in 0..ROUNDS {
        let Normal { information, score, .. } = normal_at(object_mm);
        let step = information.cholesky()?.solve(&score);
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
    let Normal { information, chi2, .. } = normal_at(object_mm);
    Some(Position { position_mm: object_mm, covariance_mm2: information.cholesky()?.inverse(), chi2 })
}

/// The normal equations of the images about one point.
struct Normal {
    /// `Σ Jᵀ W J`.
    information: Matrix3<f64>,
    /// `Σ Jᵀ W (measured − modelled)`.
    score: Vector3<f64>,
    chi2: f64,
}

impl Normal {
    fn of(
        model: &Model,
        sightings: &[Sighting],
        object_mm: [f64; 3],
        image: impl Fn(usize, [f64; 3]) -> ImagePoint,
    ) -> Self {
        let mut normal = Self { information: Matrix3::zeros(), score: Vector3::zeros(), chi2: 0.0 };
        for sighting in sightings {
            let weights = sighting.weights();
            let slopes = jacobian(|object_mm| model.chief_image(sighting.band, object_mm), object_mm);
            let weighted = Matrix2x3::from_fn(|i, j| slopes[(i, j)] * weights[i]);
            let modelled = image(sighting.band, object_mm);
            let residual = Vector2::new(sighting.image.x_mm - modelled.x_mm, sighting.image.y_mm - modelled.y_mm)
                .component_mul(&weights);
            normal.information += weighted.transpose() * weighted;
            normal.score += weighted.transpose() * residual;
            normal.chi2 += residual.norm_squared();
        }
        normal
    }
}

/// Where the chief rays of the two bands meet, by regula falsi (Illinois) for the distance at which the ratio of their
/// magnifications is Γ.
pub(crate) fn first_order_position_mm(
    instrument: &Instrument,
    model: &Model,
    pair: &[Sighting; 2],
) -> Option<[f64; 3]> {
    const ROUNDS: usize = 60;
    const RESTING_MM: f64 = 1e-6;
    let gamma = gamma(pair);
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
    let ImagePoint { x_mm, y_mm } = pair[0].image;
    Some([x_mm / magnification, y_mm / magnification, b_mm])
}

/// Change of an image's two coordinates with the object's three, by central differences.
fn jacobian(image: impl Fn([f64; 3]) -> ImagePoint, object_mm: [f64; 3]) -> Matrix2x3<f64> {
    const STEPS_MM: [f64; 3] = [1e-3, 1e-3, 1e-2];
    let mut jacobian = Matrix2x3::zeros();
    for (axis, step_mm) in STEPS_MM.into_iter().enumerate() {
        let at = |sign: f64| {
            let mut moved_mm = object_mm;
            moved_mm[axis] += sign * step_mm;
            let ImagePoint { x_mm, y_mm } = image(moved_mm);
            Vector2::new(x_mm, y_mm)
        };
        jacobian.set_column(axis, &((at(1.0) - at(-1.0)) / (2.0 * step_mm)));
    }
    jacobian
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
    use twinpupil_instrument::{builtin, paper};

    use super::*;

    const STD_MM: f64 = 5e-5;
    const FACING: Disc = Disc { diameter_mm: 1.0, slopes: [0.0; 2] };

    fn sighting(model: &Model, band: usize, object_mm: [f64; 3]) -> Sighting {
        Sighting { band, image: model.chief_image(band, object_mm), std_mm: [STD_MM; 2] }
    }

    fn pair(model: &Model, object_mm: [f64; 3]) -> [Sighting; 2] {
        [0, 1].map(|band| sighting(model, band, object_mm))
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
        let [r, b] = pair.map(|sighting| sighting.image.radius_mm());
        let expected_mm = 310.0 * (STD_MM / r).hypot(STD_MM / b);
        let found = model_position(&model, &pair, &FACING, [0.0, 4.0, 310.0]).expect("off the axis");
        assert!((found.std_mm()[2] / expected_mm - 1.0).abs() < 1e-3);
    }

    #[test]
    fn a_third_pupil_adds_its_information() {
        // σ_z⁻² of three collinear radii p_k = m_k(z) r with r unknown: Σ p′² − (Σ m p′)²/Σ m², p′ = m′(z) r, over σ².
        let instrument = Instrument::from_toml(builtin::toml("three-bands").unwrap()).unwrap();
        let model = Model::new(&instrument, None);
        let object_mm = [0.0, 4.0, 310.0];
        let sightings = [0, 1, 2].map(|band| sighting(&model, band, object_mm));
        let m = [0, 1, 2].map(|band| model.magnification(band, 310.0));
        let slope = |band| (model.magnification(band, 310.01) - model.magnification(band, 309.99)) / 0.02 * 4.0;
        let p = [0, 1, 2].map(slope);
        let sum = |f: &dyn Fn(usize) -> f64| (0..3).map(f).sum::<f64>();
        let left = sum(&|k| p[k] * p[k]) - sum(&|k| m[k] * p[k]).powi(2) / sum(&|k| m[k] * m[k]);
        let found = model_position(&model, &sightings, &FACING, [0.1, 3.9, 305.0]).expect("off the axis");
        assert!((found.std_mm()[2] / (STD_MM / left.sqrt()) - 1.0).abs() < 1e-3, "{found:?}");
        assert!((found.position_mm[2] - 310.0).abs() < 1e-6 && found.chi2 < 1e-9, "{found:?}");
        let of_pair = model_position(&model, &sightings[..2], &FACING, object_mm).expect("off the axis");
        assert!(found.std_mm()[2] < of_pair.std_mm()[2]);
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
