//! Noisy frames of the sheets, read.

use anyhow::Result;
use rayon::prelude::*;
use twinpupil_instrument::{Instrument, PixelPoint, ResponseMatrix};
use twinpupil_reconstruct::{Mode, Options, Point, Reconstruction, Reconstructor, Rejection, RejectionReason};
use twinpupil_simulate::{SimulateOptions, simulate};

use super::{Sheet, SheetDot, turned};

/// A camera that takes frames of sheets and reads them in several modes.
#[derive(Debug, Clone)]
pub struct Examiner {
    instrument: Instrument,
    response: ResponseMatrix,
    pupil_samples: usize,
    readers: Vec<(Mode, Reconstructor)>,
}

/// A frame of a sheet, read in one mode.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Index of the sheet.
    pub sheet: usize,
    /// Seed of the frame's noise.
    pub seed: u64,
    /// How it was read.
    pub mode: Mode,
    /// For every dot of the sheet what was found of it.
    pub dots: Vec<Option<Located>>,
    /// Points that are no dot of the sheet.
    pub false_points: usize,
    /// Features that became no point.
    pub lost: Vec<Lost>,
}

/// A dot that was found. Errors are turned so that x is outwards and y sideways.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Located {
    /// Found less true x, y and z, mm.
    pub error_mm: [f64; 3],
    /// Deviations that were reported, turned likewise, mm.
    pub std_mm: [f64; 3],
}

/// A feature that became no point.
#[derive(Debug, Clone, PartialEq)]
pub struct Lost {
    /// Index of the dot on whose image it lies.
    pub dot: Option<usize>,
    /// Its band.
    pub band: String,
    /// Why.
    pub reason: RejectionReason,
}

impl Examiner {
    /// A camera of `instrument`, whose lens the reading knows exactly.
    pub fn new(
        instrument: &Instrument,
        response: ResponseMatrix,
        modes: &[Mode],
        pupil_samples: usize,
    ) -> Result<Self> {
        let table = twinpupil_optics::response_table_for(instrument)?;
        let reader = |&mode: &Mode| {
            let options = Options { mode, ..Options::default() };
            (mode, Reconstructor::new(instrument.clone(), Some(table.clone()), options).unmixing(&response))
        };
        let readers = modes.iter().map(reader).collect();
        Ok(Self { instrument: instrument.clone(), response, pupil_samples, readers })
    }

    /// Takes and reads frames of every sheet with the noise of `seeds` seeds; `done` is called after every frame.
    pub fn trials(&self, sheets: &[Sheet], seeds: u64, done: impl Fn() + Sync) -> Result<Vec<Trial>> {
        let exposures: Vec<(usize, u64)> =
            (0..sheets.len()).flat_map(|sheet| (0..seeds).map(move |seed| (sheet, seed))).collect();
        let trials = exposures.into_par_iter().map_init(
            || self.readers.clone(),
            |readers, (sheet, seed)| {
                let trials = self.read(readers, &sheets[sheet], sheet, seed);
                done();
                trials
            },
        );
        Ok(trials.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect())
    }

    fn read(
        &self,
        readers: &mut [(Mode, Reconstructor)],
        sheet: &Sheet,
        index: usize,
        seed: u64,
    ) -> Result<Vec<Trial>> {
        // Frames of two sheets with the same seed would share their read noise pixel for pixel.
        let noise_seed = seed + ((index as u64) << 32);
        let options =
            SimulateOptions { pupil_samples: self.pupil_samples, seed: Some(noise_seed), ..SimulateOptions::default() };
        let frame = simulate(&self.instrument, &sheet.scene, &self.response, &options, &|_| ())?.frame;
        let trial = |(mode, reader): &mut (Mode, Reconstructor)| {
            let Reconstruction { points, rejected, .. } = reader.reconstruct(&frame)?;
            let (dots, false_points) = located(&sheet.dots, &points);
            let lost = rejected.iter().map(|rejection| self.lost(&sheet.dots, rejection)).collect();
            Ok(Trial { sheet: index, seed, mode: *mode, dots, false_points, lost })
        };
        readers.iter_mut().map(trial).collect()
    }

    fn lost(&self, dots: &[SheetDot], rejection: &Rejection) -> Lost {
        let is_telecentric = rejection.band == self.instrument.band(twinpupil_instrument::Role::Telecentric).name;
        let image = if is_telecentric { 0 } else { 1 };
        let dot = dots.iter().position(|dot| dot.images[image].covers(rejection.position));
        Lost { dot, band: rejection.band.clone(), reason: rejection.reason }
    }
}

/// What was found of every dot, and how many points are none. A point belongs to a dot if its two features lie on the
/// dot's two images; of several, the nearest does.
fn located(dots: &[SheetDot], points: &[Point]) -> (Vec<Option<Located>>, usize) {
    let features = |point: &Point| [point.telecentric.centre, point.entocentric.centre];
    let nearest = |dot: &SheetDot| {
        let on_dot = points.iter().filter(|point| lies_on(dot, features(point)));
        on_dot.min_by(|a, b| off_px(dot, features(a)).total_cmp(&off_px(dot, features(b))))
    };
    let found: Vec<Option<Located>> =
        dots.iter().map(|dot| nearest(dot).map(|point| Located::new(dot, point))).collect();
    let false_points = points.len() - found.iter().flatten().count();
    (found, false_points)
}

fn lies_on(dot: &SheetDot, features: [PixelPoint; 2]) -> bool {
    dot.images.iter().zip(features).all(|(image, feature)| image.covers(feature))
}

fn off_px(dot: &SheetDot, features: [PixelPoint; 2]) -> f64 {
    dot.images.iter().zip(features).map(|(image, feature)| image.distance_px(feature)).sum()
}

impl Located {
    fn new(dot: &SheetDot, point: &Point) -> Self {
        let azimuth_rad = dot.azimuth_rad();
        let error_mm = [0, 1, 2].map(|axis| point.position_mm[axis] - dot.centre_mm[axis]);
        let covariance = super::turned_covariance_mm2(point.covariance_mm2, azimuth_rad);
        Self { error_mm: turned(error_mm, azimuth_rad), std_mm: [0, 1, 2].map(|axis| covariance[axis][axis].sqrt()) }
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::super::{DotKind, Grid};
    use super::*;

    #[test]
    fn every_dot_is_found_near_where_it_is_and_every_seed_is_another_frame() {
        let instrument = paper::instrument();
        let grid = Grid { z_mm: vec![300.0], r_mm: vec![4.0, 6.0] };
        let kind = DotKind { diameter_mm: 1.0, brightness_e: 20_000.0, background_e: 100.0 };
        let sheets = Sheet::all(&instrument, &grid, &kind, 3).unwrap();
        assert_eq!(sheets.len(), 1);
        let response = ResponseMatrix::ideal(&instrument.bands);
        let examiner = Examiner::new(&instrument, response, &[Mode::Centroid, Mode::Model], 16).unwrap();
        let trials = examiner.trials(&sheets, 2, || ()).unwrap();
        assert_eq!(
            trials.iter().map(|trial| (trial.seed, trial.mode)).collect::<Vec<_>>(),
            [(0, Mode::Centroid), (0, Mode::Model), (1, Mode::Centroid), (1, Mode::Model)]
        );
        for trial in &trials {
            assert_eq!((trial.false_points, trial.lost.len()), (0, 0), "{trial:?}");
            for dot in &trial.dots {
                let Located { error_mm, std_mm } = dot.unwrap();
                assert!(error_mm[2].abs() < 0.05 && error_mm[0].abs() < 0.001 && error_mm[1].abs() < 0.001);
                assert!(std_mm.iter().all(|std_mm| *std_mm > 0.0 && *std_mm < 0.05));
            }
        }
        assert_ne!(trials[0].dots, trials[2].dots);
    }
}
