//! Takes every exposure with both lenses and reads it in every way.

use anyhow::Result;
use twinpupil_instrument::Frame;
use twinpupil_reconstruct::{Mode, Point};

use crate::console::Console;
use crate::experiments::{Case, Experiment, LensModel, Reading, Rig, Shot};

/// Distances of the plate whose frames the report shows, mm.
const SHOWN_MM: [f64; 2] = [250.0, 350.0];

/// A frame to show.
pub(super) struct Shown<'a> {
    pub(super) rig: &'a Rig,
    pub(super) z_mm: f64,
    pub(super) frame: Frame,
    /// What the default reads in it.
    pub(super) points: Vec<Point>,
}

/// All readings, and the frames to show.
pub(super) struct Exposures<'a> {
    pub(super) readings: Vec<Reading>,
    pub(super) shown: Vec<Shown<'a>>,
}

impl<'a> Exposures<'a> {
    pub(super) fn take(thin: &'a Rig, fresnel: &'a Rig, step_mm: u32, seed: u64, console: &Console) -> Result<Self> {
        let shots = Shot::all(step_mm, seed)?;
        console.note(format!("{} exposures through each of two lenses", shots.len()));
        let bar = console.progress(2 * shots.len() as u64, "exposing and reading");
        let mut exposures = Self { readings: Vec::new(), shown: Vec::new() };
        for shot in &shots {
            for rig in [thin, fresnel] {
                exposures.add(rig, shot)?;
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        Ok(exposures)
    }

    fn add(&mut self, rig: &'a Rig, shot: &Shot) -> Result<()> {
        let frame = rig.expose(shot)?;
        for case in Case::REPRODUCED.into_iter().filter(|case| case.lens() == rig.lens) {
            self.readings.push(rig.read(shot, &frame, case)?);
        }
        if shot.experiment == Experiment::Plate && SHOWN_MM.contains(&shot.z_mm) {
            let points = rig.reconstruct(&frame, Mode::Centroid)?.points;
            self.shown.push(Shown { rig, z_mm: shot.z_mm, frame, points });
        }
        Ok(())
    }

    /// The frame of the plate at a distance through a lens.
    pub(super) fn shown(&self, lens: LensModel, z_mm: f64) -> Option<&Shown<'a>> {
        self.shown.iter().find(|shown| shown.rig.lens == lens && shown.z_mm == z_mm)
    }
}
