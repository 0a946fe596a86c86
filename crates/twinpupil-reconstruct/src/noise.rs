//! How much a code scatters.

use twinpupil_instrument::Sensor;

/// Where the noise of pixels is known from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NoiseSource {
    /// The sensor's figures in the instrument file.
    #[default]
    Sensor,
    /// Every frame itself: how much its flat places scatter. What a frame does not show is as the sensor's figures say.
    Frame,
}

/// Variance of a code: a floor from reading and rounding, and a part that grows with the light (photon noise).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Variance of a pixel without light, codes².
    pub floor_codes2: f64,
    /// Growth of the variance with the code, codes² per code: one over the electrons per code.
    pub slope_codes: f64,
    /// Code of a pixel without light.
    pub black_level: f64,
}

impl Noise {
    /// From the sensor's data sheet, for frames whose largest code is `code_max`: read noise, photon noise and
    /// rounding (1/12).
    pub fn of_sensor(sensor: &Sensor, code_max: u16) -> Self {
        // An 8-bit file of a deeper sensor has fewer, larger codes.
        let coarser = f64::from(sensor.code_max()) / f64::from(code_max.max(1));
        let electrons_per_code = sensor.electrons_per_code() * coarser;
        Self {
            floor_codes2: (sensor.read_noise_e / electrons_per_code).powi(2) + 1.0 / 12.0,
            slope_codes: 1.0 / electrons_per_code,
            black_level: f64::from(sensor.black_level) / coarser,
        }
    }

    /// Variance of a pixel that reads `code`, codes².
    pub fn variance(&self, code: f64) -> f64 {
        self.floor_codes2 + self.slope_codes * (code - self.black_level).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use twinpupil_instrument::paper;

    #[test]
    fn the_papers_sensor_is_photon_limited_at_half_its_well() {
        let instrument = paper::instrument();
        let noise = Noise::of_sensor(&instrument.sensor, 4095);
        let electrons_per_code = 32_700.0 / 4095.0;
        let std_e = noise.variance(16_350.0 / electrons_per_code).sqrt() * electrons_per_code;
        let by_hand_e = (16_350.0 + 6.8_f64.powi(2) + electrons_per_code.powi(2) / 12.0).sqrt();
        assert!((std_e - by_hand_e).abs() < 1e-9);
    }
}
