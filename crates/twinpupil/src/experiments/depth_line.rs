//! Recovered over true depth of the plate across the axis  [Ohno2018, Fig. 10].

use anyhow::Result;
use twinpupil_reconstruct::{FitPoint, LineAxis, fit_line};

use super::statistics::{mean, rms, spread};
use super::{Experiment, Reading};

/// The plate at one distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateDepth {
    /// True distance, mm.
    pub true_z_mm: f64,
    /// Mean of the recovered depths, mm.
    pub mean_mm: f64,
    /// Their standard deviation about the mean, mm.
    pub spread_mm: f64,
    /// Root of their mean square distance from the truth, mm.
    pub rms_error_mm: f64,
    /// Number of points.
    pub dots: usize,
}

/// All distances together.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthLine {
    /// By distance.
    pub plates: Vec<PlateDepth>,
    /// Slope of the line through all points of all distances; ideally 1.
    pub slope: f64,
    /// Its value at z = 0, mm.
    pub offset_mm: f64,
    /// Root of the mean square distance of all points from the truth, mm.
    pub std_against_ideal_mm: f64,
}

/// A deviation with the distance at which it occurs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviation {
    /// Signed, mm.
    pub value_mm: f64,
    /// True distance, mm.
    pub at_z_mm: f64,
}

impl DepthLine {
    /// Reduces the readings of the plate across the axis; the others are left out.
    pub fn new<'a>(readings: impl IntoIterator<Item = &'a Reading>) -> Result<Self> {
        let of_plate = readings.into_iter().filter(|reading| reading.experiment == Experiment::Plate);
        let (mut plates, mut points, mut errors_mm) = (Vec::new(), Vec::new(), Vec::new());
        for reading in of_plate {
            plates.push(PlateDepth::new(reading));
            errors_mm.extend(errors(reading));
            // Depth over depth: the true one takes the place of x.
            let point = |z_mm| FitPoint { position_mm: [reading.z_mm, 0.0, z_mm], z_std_mm: None };
            points.extend(reading.depths_mm().into_iter().map(point));
        }
        let fit = fit_line(&points, LineAxis::X)?;
        Ok(Self {
            plates,
            slope: fit.tilt_rad.value.tan(),
            offset_mm: fit.z_mm.value,
            std_against_ideal_mm: rms(&errors_mm),
        })
    }

    /// The line's value at a true distance, mm.
    pub fn at(&self, z_mm: f64) -> f64 {
        self.offset_mm + self.slope * z_mm
    }

    /// The largest deviation of the line from the truth.
    pub fn largest_from_truth(&self) -> Deviation {
        self.largest(|plate| plate.true_z_mm)
    }

    /// The largest deviation of the line from the mean depths of `simulation`, which has the same distances.
    pub fn largest_from(&self, simulation: &Self) -> Deviation {
        self.largest(|plate| simulation.mean_at(plate.true_z_mm))
    }

    fn largest(&self, reference_mm: impl Fn(&PlateDepth) -> f64) -> Deviation {
        let deviations = self.plates.iter().map(|plate| {
            let value_mm = self.at(plate.true_z_mm) - reference_mm(plate);
            Deviation { value_mm, at_z_mm: plate.true_z_mm }
        });
        let nothing = Deviation { value_mm: f64::NAN, at_z_mm: f64::NAN };
        deviations.max_by(|a, b| a.value_mm.abs().total_cmp(&b.value_mm.abs())).unwrap_or(nothing)
    }

    /// Root of the mean square distance of all points from the mean depths of `simulation`, mm.
    ///
    /// ```text
    /// Σ (z − s)² = Σ (z − z̄)² + n (z̄ − s)²        at every distance
    /// ```
    pub fn std_against_mm(&self, simulation: &Self) -> f64 {
        let dots: f64 = self.plates.iter().map(|plate| plate.dots as f64).sum();
        let squares = self.plates.iter().map(|plate| {
            let bias_mm = plate.mean_mm - simulation.mean_at(plate.true_z_mm);
            plate.dots as f64 * (plate.spread_mm.powi(2) + bias_mm.powi(2))
        });
        (squares.sum::<f64>() / dots).sqrt()
    }

    fn mean_at(&self, z_mm: f64) -> f64 {
        self.plates.iter().find(|plate| plate.true_z_mm == z_mm).map_or(f64::NAN, |plate| plate.mean_mm)
    }
}

impl PlateDepth {
    /// Reduces one reading.
    pub fn new(reading: &Reading) -> Self {
        let depths_mm = reading.depths_mm();
        Self {
            true_z_mm: reading.z_mm,
            mean_mm: mean(&depths_mm),
            spread_mm: spread(&depths_mm),
            rms_error_mm: rms(&errors(reading)),
            dots: depths_mm.len(),
        }
    }
}

/// Distances of all points from the plate, mm.
fn errors(reading: &Reading) -> Vec<f64> {
    reading.depths_mm().into_iter().map(|z_mm| z_mm - reading.z_mm).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiments::{Case, Located};

    fn reading(z_mm: f64, found: &[f64]) -> Reading {
        let located = |&found: &f64| Located { dot: 0, true_mm: [3.0, 0.0, z_mm], found_mm: [3.0, 0.0, found] };
        let dots = found.iter().map(located).collect();
        Reading { case: Case::ThinPaper, experiment: Experiment::Plate, z_mm, dots, whole: vec![0], strays_mm: vec![] }
    }

    #[test]
    fn two_distances_by_hand() {
        let simulation = DepthLine::new(&[reading(250.0, &[250.0, 250.0]), reading(350.0, &[350.0, 350.0])]).unwrap();
        let line = DepthLine::new(&[reading(250.0, &[249.0, 251.0]), reading(350.0, &[353.0, 355.0])]).unwrap();
        assert!((line.slope - 1.04).abs() < 1e-12 && (line.at(250.0) - 250.0).abs() < 1e-9);
        let largest = line.largest_from_truth();
        assert!((largest.value_mm - 4.0).abs() < 1e-9 && largest.at_z_mm == 350.0);
        assert_eq!(line.largest_from(&simulation), largest);
        // √((1 + 1 + 9 + 25)/4) = 3
        assert!((line.std_against_ideal_mm - 3.0).abs() < 1e-12);
        assert!((line.std_against_mm(&simulation) - 3.0).abs() < 1e-12);
    }
}
