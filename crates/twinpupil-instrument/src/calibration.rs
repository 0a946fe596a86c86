//! How an instrument came to its numbers, and how well they are known.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::{ValueError, within};
use crate::{Instrument, Parameter};

/// `[calibration]`: written by `twinpupil calibrate`, read by whoever wants to know what the numbers are worth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibrationSpec {
    /// Day on which it was computed, YYYY-MM-DD.
    pub date: String,
    /// Name of the target.
    pub target: String,
    /// Root mean square distance of the target's dots from where they should be, px.
    pub rms_px: f64,
    /// χ² of the dots' images over their degrees of freedom.
    pub reduced_chi2: f64,
    /// Keys of the numbers that were determined.
    pub parameters: Vec<String>,
    /// Their standard deviations, in the units of the keys.
    pub std: Vec<f64>,
    /// Their correlations: row by row up to the diagonal, which is 1.
    pub correlation: Vec<Vec<f64>>,
    /// The frames that it was computed from.
    #[serde(default, rename = "frame", skip_serializing_if = "Vec::is_empty")]
    pub frames: Vec<CalibrationFrame>,
}

/// A frame that took part in a calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibrationFrame {
    /// Its file.
    pub file: String,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
    /// Distance of the target, mm.
    pub distance_mm: f64,
    /// Tilt of the target, degrees.
    pub tilt_deg: f64,
    /// Root mean square distance of its dots from where they should be, px.
    pub rms_px: f64,
}

impl CalibrationSpec {
    /// Refuses tables that do not belong together or name what the instrument does not have.
    pub(crate) fn check(&self, instrument: &Instrument) -> Result<(), ValueError> {
        let count = self.parameters.len();
        if self.std.len() != count {
            return Err(ValueError::new("calibration.std", format!("{} values", self.std.len()), count.to_string()));
        }
        let is_triangle = self.correlation.len() == count
            && self.correlation.iter().enumerate().all(|(row, values)| values.len() == row + 1);
        if !is_triangle {
            let legal = format!("{count} rows of 1 to {count} values");
            return Err(ValueError::new("calibration.correlation", format!("{} rows", self.correlation.len()), legal));
        }
        for (index, key) in self.parameters.iter().enumerate() {
            if Parameter::of_key(instrument, key).is_none() {
                let legal = "keys of numbers of this instrument";
                return Err(ValueError::new(format!("calibration.parameters[{index}]"), key, legal));
            }
            within(&format!("calibration.std[{index}]"), self.std[index], 0.0, 1e9)?;
            for (other, value) in self.correlation[index].iter().enumerate() {
                let key = format!("calibration.correlation[{index}][{other}]");
                let (least, most) = if other == index { (1.0, 1.0) } else { (-1.0, 1.0) };
                within(&key, *value, least, most)?;
            }
        }
        Ok(())
    }

    /// Covariance of the determined numbers, row by row.
    pub fn covariance(&self) -> Vec<Vec<f64>> {
        let correlation = |i: usize, k: usize| self.correlation[i.max(k)][i.min(k)];
        let row = |i: usize| (0..self.std.len()).map(|k| self.std[i] * self.std[k] * correlation(i, k)).collect();
        (0..self.std.len()).map(row).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper;

    fn calibrated(edit: impl Fn(&mut CalibrationSpec)) -> Result<Instrument, ValueError> {
        let mut calibration = CalibrationSpec {
            date: "2026-11-25".to_owned(),
            target: "grid".to_owned(),
            rms_px: 0.002,
            reduced_chi2: 1.0,
            parameters: vec!["sensor.distance_mm".to_owned(), "sensor.axis_px[0]".to_owned()],
            std: vec![0.01, 0.2],
            correlation: vec![vec![1.0], vec![-0.5, 1.0]],
            frames: Vec::new(),
        };
        edit(&mut calibration);
        let mut spec = paper::instrument().into_spec();
        spec.calibration = Some(calibration);
        Instrument::new(spec)
    }

    #[test]
    fn a_calibration_is_kept_and_gives_its_covariance() {
        let instrument = calibrated(|_| {}).unwrap();
        assert_eq!(Instrument::from_toml(&instrument.to_toml()).unwrap(), instrument);
        let covariance = instrument.calibration.as_ref().unwrap().covariance();
        assert_eq!(covariance, [[1e-4, -1e-3], [-1e-3, 0.2 * 0.2]].map(Vec::from));
    }

    #[test]
    fn what_does_not_belong_together_is_refused() {
        let message = |edit: &dyn Fn(&mut CalibrationSpec)| calibrated(edit).unwrap_err().to_string();
        assert!(message(&|own| own.std = vec![1.0]).starts_with("`calibration.std` is 1 values; legal: 2"));
        assert!(message(&|own| own.parameters[1] = "sensor.size_px".to_owned()).contains("parameters[1]"));
        assert!(message(&|own| own.correlation[1][0] = 1.5).contains("correlation[1][0]"));
        assert!(message(&|own| own.correlation[1] = vec![1.0]).contains("rows of 1 to 2"));
    }
}
