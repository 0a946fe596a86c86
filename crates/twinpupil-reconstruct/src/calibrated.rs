//! What the uncertainty of an instrument's numbers does to points.

use nalgebra::Dyn;
use nalgebra::{DMatrix, Matrix3, OMatrix, SMatrix, SVector, U3};
use twinpupil_instrument::{Instrument, InstrumentSpec, Page, Parameter, Projection, Role};

/// An instrument whose numbers have a covariance.
#[derive(Debug, Clone)]
pub(crate) struct Calibrated {
    pair: Pair,
    /// The same with one number after the other a step away, and the step.
    moved: Vec<(Pair, f64)>,
    covariance: DMatrix<f64>,
}

/// How the telecentric and the entocentric band image.
#[derive(Debug, Clone)]
struct Pair([(Projection, Page); 2]);

/// Images of a point in both bands, px.
type Images = SVector<f64, 4>;

impl Calibrated {
    /// `None` if the instrument was not calibrated.
    pub(crate) fn of(instrument: &Instrument) -> Option<Self> {
        // Of a deviation: small enough for a straight line, large enough to be felt.
        const STEP: f64 = 0.1;
        let calibration = instrument.calibration.as_ref()?;
        let rows = calibration.covariance();
        let covariance = DMatrix::from_fn(rows.len(), rows.len(), |i, k| rows[i][k]);
        // What is known of the numbers need not be checked with every step.
        let plain = InstrumentSpec { calibration: None, ..instrument.clone().into_spec() };
        let moved = calibration.parameters.iter().zip(&calibration.std).map(|(key, std)| {
            let parameter = Parameter::of_key(instrument, key)?;
            let step = (STEP * std).max(1e-9 * parameter.value(instrument).abs()).max(1e-15);
            let mut spec = plain.clone();
            parameter.set(&mut spec, parameter.value(instrument) + step);
            Some((Pair::of(&Instrument::new(spec).ok()?), step))
        });
        Some(Self { pair: Pair::of(instrument), moved: moved.collect::<Option<_>>()?, covariance })
    }

    /// Covariance of a point from that of the numbers: `G C Gᵀ` with `G = −A⁺ B`, A the change of both images with the
    /// point and B that with the numbers.
    pub(crate) fn covariance_mm2(&self, position_mm: [f64; 3]) -> Option<[[f64; 3]; 3]> {
        const STEP_MM: f64 = 1e-3;
        let images = self.pair.images(position_mm);
        let mut with_point = SMatrix::<f64, 4, 3>::zeros();
        for axis in 0..3 {
            let mut moved_mm = position_mm;
            moved_mm[axis] += STEP_MM;
            with_point.set_column(axis, &((self.pair.images(moved_mm) - images) / STEP_MM));
        }
        let inverse = (with_point.transpose() * with_point).try_inverse()? * with_point.transpose();
        let mut gain = OMatrix::<f64, U3, Dyn>::zeros(self.moved.len());
        for (column, (pair, step)) in self.moved.iter().enumerate() {
            gain.set_column(column, &(inverse * (images - pair.images(position_mm)) / *step));
        }
        let covariance: Matrix3<f64> = &gain * &self.covariance * gain.transpose();
        let is_sound = covariance.iter().all(|value| value.is_finite());
        is_sound.then(|| std::array::from_fn(|i| std::array::from_fn(|k| covariance[(i, k)])))
    }
}

impl Pair {
    fn of(instrument: &Instrument) -> Self {
        Self([Role::Telecentric, Role::Entocentric].map(|role| {
            let band = instrument.band(role);
            (instrument.projection(band), instrument.page(band))
        }))
    }

    fn images(&self, position_mm: [f64; 3]) -> Images {
        let [t, e] = [0, 1].map(|band: usize| {
            let (projection, page) = &self.0[band];
            page.to_page(projection.image(position_mm))
        });
        Images::new(t.u, t.v, e.u, e.v)
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{CalibrationSpec, paper};

    use super::*;

    fn calibrated(parameters: &[(&str, f64)]) -> Calibrated {
        let mut spec = paper::instrument().into_spec();
        let row = |row: usize| (0..=row).map(|column| f64::from(u8::from(column == row))).collect();
        spec.calibration = Some(CalibrationSpec {
            date: "2026-11-25".to_owned(),
            target: "none".to_owned(),
            rms_px: 0.0,
            reduced_chi2: 1.0,
            parameters: parameters.iter().map(|(key, _)| (*key).to_owned()).collect(),
            std: parameters.iter().map(|(_, std)| *std).collect(),
            correlation: (0..parameters.len()).map(row).collect(),
            frames: Vec::new(),
        });
        Calibrated::of(&Instrument::new(spec).unwrap()).unwrap()
    }

    #[test]
    fn the_focal_length_of_the_telecentric_band_scales_what_it_sees() {
        // r_R = (L/f − 1) r and z = L r / r_B: with dm/m = −L/(f² m) df both r and z change by that share.
        let std_mm = 0.01;
        let own = calibrated(&[("lens.focal_length_mm_by_band.red", std_mm)]);
        let covariance = own.covariance_mm2([3.0, 4.0, 280.0]).unwrap();
        // The mask stays at 100 mm, where it is no longer in the focal plane: m = (L b − d a)/(d + b z).
        let magnification = |f: f64| {
            let (l, d, z) = (151.0, 100.0, 280.0);
            (l * (1.0 - d / f) - d * (1.0 - l / f)) / (d + (1.0 - d / f) * z)
        };
        let share = (magnification(100.0 + std_mm) / magnification(100.0) - 1.0).abs();
        assert!((covariance[2][2].sqrt() / (280.0 * share) - 1.0).abs() < 1e-3, "{covariance:?}");
        assert!((covariance[0][0].sqrt() / (3.0 * share) - 1.0).abs() < 1e-3, "{covariance:?}");
    }

    #[test]
    fn an_uncertain_axis_matters_most_near_it() {
        let own = calibrated(&[("sensor.axis_px[0]", 0.1), ("sensor.axis_px[1]", 0.1)]);
        let z_std_mm = |r_mm: f64| own.covariance_mm2([r_mm, 0.0, 250.0]).unwrap()[2][2].sqrt();
        assert!((z_std_mm(2.0) / z_std_mm(6.0) - 3.0).abs() < 0.01);
        assert!(own.covariance_mm2([0.0, 0.0, 250.0]).is_none_or(|covariance| covariance[2][2] > 1.0));
    }
}
