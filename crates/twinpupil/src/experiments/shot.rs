//! The exposures that the paper takes.

use anyhow::Result;
use twinpupil_simulate::{Scene, SceneSpec, paper};

use super::published;

/// Nearest and farthest distance of the paper's dots, mm  [Ohno2018, Figs. 3, 10].
pub(crate) const Z_RANGE_MM: [u32; 2] = [250, 350];

/// Which experiment an exposure belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Experiment {
    /// 22 dots on two rings, without noise  [Ohno2018, Figs. 3, 4].
    Dots,
    /// The plate of random dots across the axis  [Ohno2018, Fig. 10].
    Plate,
    /// The same plate, tilted  [Ohno2018, Fig. 11].
    Tilt {
        /// Tilt, degrees.
        tilt_deg: f64,
    },
}

/// One exposure.
#[derive(Debug, Clone)]
pub struct Shot {
    /// Its experiment.
    pub experiment: Experiment,
    /// Where the dots, or the axis of the plate, stand, mm.
    pub z_mm: f64,
    /// What is before the camera.
    pub scene: Scene,
    /// Whether the sensor is without noise.
    pub noiseless: bool,
    /// Seed of the sensor's noise.
    pub noise_seed: u64,
}

impl Shot {
    /// The 22 dots at a distance.
    pub fn dots(z_mm: f64) -> Result<Self> {
        let scene = paper::twenty_two_dots(z_mm)?;
        Ok(Self { experiment: Experiment::Dots, z_mm, scene, noiseless: true, noise_seed: 0 })
    }

    /// The 22 dots at a distance in three exposures of every third dot.
    ///
    /// Neighbours on the inner ring are 0.13 mm apart and their blurred images overlap; apart, what is measured is
    /// the camera, and not how well a program tells dots from each other.
    pub fn dots_apart(z_mm: f64) -> Result<Vec<Self>> {
        let all = Self::dots(z_mm)?;
        let third = |first: usize| {
            let dots = all.scene.spec().dots.iter().skip(first).step_by(3).copied().collect();
            let scene = Scene::new(SceneSpec { dots, ..all.scene.spec().clone() })?;
            Ok(Self { scene, ..all.clone() })
        };
        (0..3).map(third).collect()
    }

    /// The plate across the axis. The same seed is the same plate at every distance, each with noise of its own.
    pub fn plate(z_mm: f64, seed: u64) -> Result<Self> {
        let scene = paper::random_plate(z_mm, seed)?;
        let noise_seed = noise_seed(seed, z_mm);
        Ok(Self { experiment: Experiment::Plate, z_mm, scene, noiseless: false, noise_seed })
    }

    /// The plate, tilted.
    pub fn tilted(tilt_deg: f64, seed: u64) -> Result<Self> {
        let scene = paper::tilted_plate(tilt_deg, seed)?;
        let experiment = Experiment::Tilt { tilt_deg };
        let noise_seed = noise_seed(seed, tilt_deg);
        Ok(Self { experiment, z_mm: paper::TILT_DISTANCE_MM, scene, noiseless: false, noise_seed })
    }

    /// All exposures of the paper, the distances of 250 to 350 mm in steps of `step_mm`.
    pub fn all(step_mm: u32, seed: u64) -> Result<Vec<Self>> {
        let [near_mm, far_mm] = Z_RANGE_MM;
        let distances = || (near_mm..=far_mm).step_by(step_mm as usize).map(f64::from);
        let dots = distances().map(Self::dots_apart).collect::<Result<Vec<_>>>()?.into_iter().flatten().map(Ok);
        let plates = distances().map(|z_mm| Self::plate(z_mm, seed));
        let tilts = published::TILTS.iter().map(|tilt| Self::tilted(tilt.tilt_deg, seed));
        dots.chain(plates).chain(tilts).collect()
    }
}

/// A seed of its own for every exposure of a plate.
fn noise_seed(seed: u64, what: f64) -> u64 {
    seed.wrapping_mul(1000).wrapping_add(what as u64)
}
