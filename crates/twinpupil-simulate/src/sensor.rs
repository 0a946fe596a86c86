//! What the sensor makes of light: photon noise, read noise, saturation, quantization.

use rand::RngExt;
use rand_distr::{Distribution, Poisson, StandardNormal};
use rand_pcg::Pcg64Dxsm;
use rayon::prelude::*;
use twinpupil_instrument::Sensor;

/// Mean from which a Poisson distribution is drawn as a normal one of the same mean and variance.
///
/// At 1000 electrons its skewness is 0.03, and a code is worth several electrons.
const NORMAL_FROM_E: f64 = 1000.0;

/// The codes of one page that the sensor delivers for the expected electrons of its pixels, row by row.
///
/// Every row of every page draws from a stream of random numbers of its own, so the codes depend on `seed` alone.
pub(crate) fn noisy_codes(sensor: &Sensor, electrons: &[f64], page: usize, seed: u64) -> Vec<u16> {
    let [width_px, height_px] = sensor.size_px;
    let mut codes = vec![0; electrons.len()];
    let rows = codes.par_chunks_mut(width_px).zip(electrons.par_chunks(width_px)).enumerate();
    rows.for_each(|(row, (codes, electrons))| {
        let mut rng = Pcg64Dxsm::new(u128::from(seed), (page * height_px + row) as u128);
        for (code, &mean_e) in codes.iter_mut().zip(electrons) {
            let read_e = sensor.read_noise_e * rng.sample::<f64, _>(StandardNormal);
            *code = quantize(sensor, photons(mean_e, &mut rng) + read_e);
        }
    });
    codes
}

/// The codes of the expected electrons themselves.
pub(crate) fn expected_codes(sensor: &Sensor, electrons: &[f64]) -> Vec<u16> {
    electrons.par_iter().map(|&mean_e| quantize(sensor, mean_e)).collect()
}

/// Electrons that photons set free where `mean_e` are expected.
fn photons(mean_e: f64, rng: &mut Pcg64Dxsm) -> f64 {
    if mean_e >= NORMAL_FROM_E {
        return (mean_e + mean_e.sqrt() * rng.sample::<f64, _>(StandardNormal)).round();
    }
    // A mean of zero is no distribution: nothing comes.
    Poisson::new(mean_e).map_or(0.0, |poisson| poisson.sample(rng))
}

/// `black level + electrons / electrons per code`, rounded, from 0 to the largest code.
fn quantize(sensor: &Sensor, electrons: f64) -> u16 {
    let code = f64::from(sensor.black_level) + electrons / sensor.electrons_per_code();
    code.round().clamp(0.0, f64::from(sensor.code_max())) as u16
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;

    /// One code for each electron, far from saturation, so that codes are electrons.
    fn counting_sensor(read_noise_e: f64) -> Sensor {
        let black_level = 500;
        let full_well_e = f64::from(u16::MAX - black_level);
        let sensor = paper::instrument().into_spec().sensor;
        Sensor { bit_depth: 16, size_px: [500, 400], read_noise_e, black_level, full_well_e, ..sensor }
    }

    fn moments(codes: &[u16]) -> (f64, f64) {
        let count = codes.len() as f64;
        let mean = codes.iter().map(|&code| f64::from(code)).sum::<f64>() / count;
        let variance = codes.iter().map(|&code| (f64::from(code) - mean).powi(2)).sum::<f64>() / (count - 1.0);
        (mean, variance)
    }

    #[test]
    fn photon_noise_has_the_variance_of_its_mean() {
        let sensor = counting_sensor(0.0);
        for mean_e in [0.3, 5.0, 40.0, 999.0, 1000.0, 20_000.0] {
            let codes = noisy_codes(&sensor, &vec![mean_e; 200_000], 0, 11);
            let (mean, variance) = moments(&codes);
            let standard_error = (mean_e / 200_000.0).sqrt();
            assert!((mean - 500.0 - mean_e).abs() < 4.0 * standard_error, "{mean_e}: {mean}");
            // Rounding a normal deviate to whole electrons adds 1/12; four standard errors of a variance.
            let spread = 4.0 * (mean_e / 200_000.0 + 2.0 * mean_e.powi(2) / 200_000.0).sqrt();
            assert!((variance - mean_e).abs() < spread + 0.1, "{mean_e}: {variance}");
        }
    }

    #[test]
    fn read_noise_adds_to_the_variance_of_darkness() {
        let (mean, variance) = moments(&noisy_codes(&counting_sensor(6.8), &vec![0.0; 200_000], 0, 12));
        assert!((mean - 500.0).abs() < 0.07, "{mean}");
        assert!((variance - 6.8 * 6.8 - 1.0 / 12.0).abs() < 0.6, "{variance}");
    }

    #[test]
    fn rows_and_pages_are_independent() {
        let sensor = counting_sensor(20.0);
        let page = |page| noisy_codes(&sensor, &vec![0.0; 200_000], page, 13);
        let covariance = |a: &[u16], b: &[u16]| {
            let products = a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - 500.0) * (f64::from(b) - 500.0));
            products.sum::<f64>() / a.len().min(b.len()) as f64 / 400.0
        };
        let (first, second) = (page(0), page(1));
        // Five standard errors of a correlation over 200 000 pixels.
        assert!(covariance(&first, &second).abs() < 0.011);
        assert!(covariance(&first, &first[500..]).abs() < 0.011);
    }

    #[test]
    fn codes_are_rounded_and_stay_in_range() {
        let sensor = paper::instrument().into_spec().sensor;
        let step_e = sensor.electrons_per_code();
        let electrons = [-3.0, 0.0, 0.49 * step_e, 0.51 * step_e, 4094.6 * step_e, 1e12];
        assert_eq!(expected_codes(&sensor, &electrons), [0, 0, 0, 1, 4095, 4095]);
        let raised = Sensor { black_level: 100, ..sensor };
        assert_eq!(expected_codes(&raised, &[0.0, 32_700.0]), [100, 4095]);
    }
}
