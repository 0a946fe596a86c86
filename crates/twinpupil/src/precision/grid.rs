//! The places at which a camera is examined.

use std::str::FromStr;

use thiserror::Error;
use twinpupil_instrument::Instrument;

/// More values than this are a mistake.
const COUNT_MAX: usize = 200;

/// Depths and distances from the axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Depths, mm, from near to far.
    pub z_mm: Vec<f64>,
    /// Distances from the axis, mm, from the inside outwards.
    pub r_mm: Vec<f64>,
}

impl Grid {
    /// The grid of the steps; what is left out follows from the instrument: its depth range, and all of the field that
    /// the longer side of the sensor sees in focus, for dots of a diameter.
    pub fn new(instrument: &Instrument, z: Option<&Steps>, r: Option<&Steps>, diameter_mm: f64) -> Self {
        const DEPTHS_MIN: usize = 4;
        const DISTANCES_MIN: usize = 8;
        let range = instrument.depth_range();
        let outermost_mm = field_mm(instrument) - diameter_mm;
        let z_mm = z.map_or_else(|| round_values(range.near_mm, range.far_mm, DEPTHS_MIN), |z| z.values.clone());
        let r_mm = r.map_or_else(|| round_values(0.0, outermost_mm, DISTANCES_MIN), |r| r.values.clone());
        Self { z_mm, r_mm: r_mm.into_iter().filter(|r_mm| *r_mm > 0.0).collect() }
    }
}

/// Half of the longer side of what the sensor sees in focus, mm.
fn field_mm(instrument: &Instrument) -> f64 {
    let sensor = &instrument.sensor;
    let longer_mm = sensor.size_px[0].max(sensor.size_px[1]) as f64 * sensor.pitch_mm;
    let [telecentric, _] = instrument.projections();
    0.5 * longer_mm / telecentric.magnification(instrument.focus_distance_mm()).abs()
}

/// Multiples of 1, 2, 2.5 or 5 times a power of ten between two values, at least so many and few more.
fn round_values(low: f64, high: f64, count_min: usize) -> Vec<f64> {
    let coarsest = 10f64.powf(((high - low) / count_min as f64).log10().ceil());
    let steps = [1.0, 0.5, 0.25, 0.2, 0.1].map(|share| share * coarsest);
    let values = |step: f64| {
        let (first, last) = ((low / step).ceil() as i64, (high / step).floor() as i64);
        (first..=last).map(|k| k as f64 * step).collect::<Vec<f64>>()
    };
    steps.map(values).into_iter().find(|values| values.len() >= count_min).unwrap_or_default()
}

/// Equal steps, written FROM:TO:STEP or FROM:TO, or one value.
#[derive(Debug, Clone, PartialEq)]
pub struct Steps {
    /// The values, rising.
    pub values: Vec<f64>,
}

/// Steps that are not legal.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum StepsError {
    /// Not up to three numbers.
    #[error("legal: FROM:TO:STEP, FROM:TO or one value, numbers above 0, TO not below FROM")]
    Syntax,
    /// Too many values.
    #[error("{count} values; legal: up to {COUNT_MAX}")]
    Count {
        /// Their number.
        count: usize,
    },
}

impl FromStr for Steps {
    type Err = StepsError;

    fn from_str(text: &str) -> Result<Self, StepsError> {
        let number = |word: &str| word.trim().parse::<f64>().ok().filter(|value| value.is_finite() && *value > 0.0);
        let numbers = text.split(':').map(number).collect::<Option<Vec<f64>>>().ok_or(StepsError::Syntax)?;
        let (from, to, step) = match numbers[..] {
            [only] => (only, only, 1.0),
            [from, to] => (from, to, (to - from) / 4.0),
            [from, to, step] => (from, to, step),
            _ => return Err(StepsError::Syntax),
        };
        if to < from {
            return Err(StepsError::Syntax);
        }
        // The end belongs to the steps although the steps to it are rounded.
        let steps = if to > from { (to - from) / step + 1e-9 } else { 0.0 };
        if steps >= COUNT_MAX as f64 {
            return Err(StepsError::Count { count: (steps as usize).saturating_add(1) });
        }
        Ok(Self { values: (0..=steps as usize).map(|k| from + k as f64 * step).collect() })
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;

    #[test]
    fn steps_reach_their_end() {
        let values = |text: &str| text.parse::<Steps>().map(|steps| steps.values);
        assert_eq!(values("250:350:25").unwrap(), [250.0, 275.0, 300.0, 325.0, 350.0]);
        assert_eq!(values("1:7").unwrap(), [1.0, 2.5, 4.0, 5.5, 7.0]);
        assert_eq!(values("0.1:0.35:0.1").unwrap().len(), 3);
        assert_eq!(values("300").unwrap(), [300.0]);
        assert_eq!(values("0.1:0.3:0.1").unwrap().len(), 3);
        for wrong in ["", "a", "1:2:3:4", "0:5:1", "5:1:1", "1:nan:1", "-1:2:1"] {
            assert_eq!(values(wrong), Err(StepsError::Syntax), "{wrong}");
        }
        assert_eq!(values("1:1000:1"), Err(StepsError::Count { count: 1000 }));
    }

    #[test]
    fn the_papers_volume_is_found_without_being_told() {
        let grid = Grid::new(&paper::instrument(), None, None, 1.0);
        assert_eq!(grid.z_mm, [250.0, 275.0, 300.0, 325.0, 350.0]);
        assert_eq!(grid.r_mm, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0]);
        let none = Grid::new(&paper::instrument(), None, None, 100.0);
        assert!(none.r_mm.is_empty() && none.z_mm == grid.z_mm);
    }
}
