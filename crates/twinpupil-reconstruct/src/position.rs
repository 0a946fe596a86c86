//! From the image positions of one thing to a point in space.

use nalgebra::{Matrix3, Vector3};
use twinpupil_instrument::{ImagePoint, Instrument, position_from_radii_mm};

use crate::model::{Disc, DiscImage, Model};

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
    let mut normal = Normal::default();
    pair.iter().for_each(|sighting| normal.add(sighting, &model.chief_disc(sighting.band, position_mm)));
    let Normal { information, chi2, .. } = normal;
    Some(Position { position_mm, covariance_mm2: information.cholesky()?.inverse(), chi2 })
}

/// The point whose modelled images lie nearest to the measured ones, by weighted least squares over both coordinates of
/// all images; `None` where there is none near the start.
///
/// ```text
/// X ← X + (Σ_bands Jᵀ W J)⁻¹ Σ_bands Jᵀ W (p − p(X))        covariance (Σ Jᵀ W J)⁻¹
/// ```
///
/// Gauss–Newton from `start_mm`. Steps end where the next one would be too small to matter.
pub(crate) fn model_position(
    model: &Model,
    sightings: &[Sighting],
    disc: &Disc,
    start_mm: [f64; 3],
) -> Option<Position> {
    const ROUNDS: usize = 40;
    // A hundredth of the noise at its best.
    const RESTING_MM: f64 = 1e-5;
    let mut object_mm = start_mm;
    let mut before_mm: Option<f64> = None;
    for _ in 0..ROUNDS {
        let (normal, uneven) = Normal::of_discs(model, sightings, object_mm, disc);
        let factor = normal.information.cholesky()?;
        let mut step = factor.solve(&normal.score);
        let mut step_mm = step.norm();
        // Where the lens bends the image a step may lead too far.
        if before_mm.is_some_and(|before_mm| step_mm > 0.5 * before_mm) {
            step *= 0.5;
            step_mm *= 0.5;
        }
        object_mm = std::array::from_fn(|axis| object_mm[axis] + step[axis]);
        if object_mm[2] <= 0.0 || !object_mm.iter().all(|coordinate| coordinate.is_finite()) {
            return None;
        }
        if shrinkage(before_mm, step_mm, object_mm, uneven) * step_mm < RESTING_MM {
            let chi2 = (normal.chi2 - step.dot(&normal.score)).max(0.0);
            return Some(Position { position_mm: object_mm, covariance_mm2: factor.inverse(), chi2 });
        }
        before_mm = Some(step_mm);
    }
    None
}

/// Share of a step that the next one will be.
fn shrinkage(before_mm: Option<f64>, step_mm: f64, [x_mm, y_mm, _]: [f64; 3], uneven: bool) -> f64 {
    const UNKNOWN: f64 = 0.5;
    match before_mm {
        Some(before_mm) => (step_mm / before_mm).min(1.0),
        None if uneven => UNKNOWN,
        // The slopes of an even image change in proportion to the distance from the axis.
        None => step_mm / (x_mm * x_mm + y_mm * y_mm).sqrt().max(step_mm),
    }
}

/// The normal equations of the images about one point.
#[derive(Default)]
struct Normal {
    /// `Σ Jᵀ W J`.
    information: Matrix3<f64>,
    /// `Σ Jᵀ W (measured − modelled)`.
    score: Vector3<f64>,
    chi2: f64,
}

impl Normal {
    /// Of the images of a point's disc, and whether the lens makes one of them uneven.
    fn of_discs(model: &Model, sightings: &[Sighting], object_mm: [f64; 3], disc: &Disc) -> (Self, bool) {
        let (mut normal, mut uneven) = (Self::default(), false);
        for sighting in sightings {
            let modelled = model.image(sighting.band, object_mm, disc);
            normal.add(sighting, &modelled);
            uneven |= modelled.uneven;
        }
        (normal, uneven)
    }

    /// Adds what one band sees.
    fn add(&mut self, sighting: &Sighting, modelled: &DiscImage) {
        // Features without noise still weigh evenly.
        const STD_MIN_MM: f64 = 1e-9;
        let off_mm = [sighting.image.x_mm - modelled.image.x_mm, sighting.image.y_mm - modelled.image.y_mm];
        for ((off_mm, std_mm), slopes) in off_mm.into_iter().zip(sighting.std_mm).zip(modelled.slopes) {
            let weight = std_mm.max(STD_MIN_MM).powi(-2);
            let row = Vector3::from(slopes);
            self.information += (weight * row) * row.transpose();
            self.score += weight * off_mm * row;
            self.chi2 += weight * off_mm * off_mm;
        }
    }
}

/// Where the chief rays of the two bands meet: one over their magnifications is linear in the distance z, so
///
/// ```text
/// Γ = n_e(z)/n_t(z)        n = 1/m,  n′ = −m′/m²
/// ```
///
/// has one solution; `None` if it lies far outside the depth range.
pub(crate) fn first_order_position_mm(
    instrument: &Instrument,
    model: &Model,
    pair: &[Sighting; 2],
) -> Option<[f64; 3]> {
    let range = instrument.depth_range();
    let gamma = gamma(pair);
    let [(t, t_slope), (e, e_slope)] = [0, 1].map(|band| model.reduction(band, range.near_mm));
    let z_mm = range.near_mm + (e - gamma * t) / (gamma * t_slope - e_slope);
    if !(z_mm >= 0.5 * range.near_mm && z_mm <= 2.0 * range.far_mm) {
        return None;
    }
    let magnification = model.magnification(0, z_mm);
    let ImagePoint { x_mm, y_mm } = pair[0].image;
    Some([x_mm / magnification, y_mm / magnification, z_mm])
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
