//! The tilted plate and the line through its dots  [Ohno2018, Fig. 11, Eq. 14].

use anyhow::Result;
use twinpupil_reconstruct::{FitPoint, LineAxis, LineFit, fit_line};

use super::{Experiment, Reading};

/// The line of Eq. 14 through all points of a reading, all weighing the same, as in the paper.
pub fn fit(reading: &Reading) -> Result<LineFit> {
    let point = |position_mm| FitPoint { position_mm, z_std_mm: None };
    let points: Vec<FitPoint> = reading.points_mm().map(point).collect();
    Ok(fit_line(&points, LineAxis::X)?)
}

/// The reading of a tilt.
pub fn of_tilt<'a>(readings: impl IntoIterator<Item = &'a Reading>, tilt_deg: f64) -> Option<&'a Reading> {
    readings.into_iter().find(|reading| reading.experiment == Experiment::Tilt { tilt_deg })
}
