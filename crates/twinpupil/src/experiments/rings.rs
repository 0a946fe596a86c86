//! The two rings of the simulated dots  [Ohno2018, Figs. 3, 4].

use twinpupil_simulate::paper::{INNER_RADIUS_MM, OUTER_RADIUS_MM};

use super::statistics::{mean, spread};
use super::{Experiment, Reading};

/// The radii of the rings, mm.
pub const RADII_MM: [f64; 2] = [INNER_RADIUS_MM, OUTER_RADIUS_MM];

/// Recovered depth of one ring at one distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RingDepth {
    /// Radius of the ring, mm.
    pub r_mm: f64,
    /// True distance, mm.
    pub true_z_mm: f64,
    /// Mean of the recovered depths, mm.
    pub mean_mm: f64,
    /// Their standard deviation about the mean, mm.
    pub spread_mm: f64,
    /// Number of dots recovered.
    pub dots: usize,
}

/// The depths of the ring at `r_mm`, by distance.
pub fn ring<'a>(readings: impl IntoIterator<Item = &'a Reading>, r_mm: f64) -> Vec<RingDepth> {
    let mut depths: Vec<(f64, Vec<f64>)> = Vec::new();
    for reading in readings.into_iter().filter(|reading| reading.experiment == Experiment::Dots) {
        // The exposures of one distance follow each other.
        if depths.last().is_none_or(|(z_mm, _)| *z_mm != reading.z_mm) {
            depths.push((reading.z_mm, Vec::new()));
        }
        let on_ring = reading.dots.iter().filter(|dot| (dot.radius_mm() - r_mm).abs() < 0.5);
        let found_mm = on_ring.map(|dot| dot.found_mm[2]);
        depths.last_mut().into_iter().for_each(|(_, depths_mm)| depths_mm.extend(found_mm.clone()));
    }
    let depth = |(true_z_mm, depths_mm): (f64, Vec<f64>)| RingDepth {
        r_mm,
        true_z_mm,
        mean_mm: mean(&depths_mm),
        spread_mm: spread(&depths_mm),
        dots: depths_mm.len(),
    };
    depths.into_iter().map(depth).collect()
}
