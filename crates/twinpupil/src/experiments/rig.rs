//! A camera that takes the exposures and reads them.

use anyhow::{Context, Result};
use twinpupil_instrument::check::ValueError;
use twinpupil_instrument::{Frame, Instrument, InstrumentSpec, Lens, ResponseMatrix, ResponseTable, paper};
use twinpupil_reconstruct::{Mode, Options, Reconstruction, Reconstructor};
use twinpupil_simulate::{Scene, SimulateOptions, simulate};

use super::{Case, LensModel, Reading, Shot};

/// The paper's camera with one of the two lenses.
#[derive(Debug, Clone)]
pub struct Rig {
    /// Which lens it has.
    pub lens: LensModel,
    /// The camera.
    pub instrument: Instrument,
    pupil_samples: usize,
    response: ResponseMatrix,
    table: ResponseTable,
}

impl Rig {
    /// The paper's camera; frames are simulated with `pupil_samples` rays for every pixel and band.
    pub fn new(lens: LensModel, pupil_samples: usize) -> Result<Self> {
        let instrument = match lens {
            LensModel::Thin => paper::instrument(),
            LensModel::Fresnel => fresnel_instrument()?,
        };
        let response = ResponseMatrix::ideal(&instrument.bands);
        let table = twinpupil_optics::response_table_for(&instrument)?;
        Ok(Self { lens, instrument, pupil_samples, response, table })
    }

    /// Rays over the pupil for every pixel and band.
    pub fn pupil_samples(&self) -> usize {
        self.pupil_samples
    }

    /// Takes an exposure.
    pub fn expose(&self, shot: &Shot) -> Result<Frame> {
        let options = SimulateOptions {
            pupil_samples: self.pupil_samples,
            noiseless: shot.noiseless,
            seed: Some(shot.noise_seed),
            ..SimulateOptions::default()
        };
        let simulation = simulate(&self.instrument, &shot.scene, &self.response, &options, &|_| ());
        Ok(simulation.with_context(|| format!("scene {}", shot.scene.name))?.frame)
    }

    /// Reads a frame of this camera. The paper's equations take f and L from the data sheet; the default inverts the
    /// response of the lens that took the frame.
    pub fn reconstruct(&self, frame: &Frame, mode: Mode) -> Result<Reconstruction> {
        let table = (mode != Mode::Paper).then(|| self.table.clone());
        let reconstructor = Reconstructor::new(self.instrument.clone(), table, Options { mode, ..Options::default() });
        Ok(reconstructor.reconstruct(frame)?)
    }

    /// Reads a frame of this camera and compares it with the truth.
    pub fn read(&self, shot: &Shot, frame: &Frame, case: Case) -> Result<Reading> {
        let reconstruction = self.reconstruct(frame, case.mode())?;
        Ok(Reading::new(case, shot, &reconstruction.points, self.whole_dots(&shot.scene)))
    }

    /// Numbers of the dots whose images, blur included, lie wholly on the sensor in both bands, to first order.
    pub fn whole_dots(&self, scene: &Scene) -> Vec<usize> {
        let sensor = &self.instrument.sensor;
        let inside = |centre_px: f64, reach_px: f64, size_px: usize| {
            centre_px - reach_px > 0.0 && centre_px + reach_px < (size_px - 1) as f64
        };
        let whole = |dot: &twinpupil_simulate::Dot| {
            self.instrument.projections().iter().all(|projection| {
                let z_mm = dot.centre_mm[2];
                let radius_mm = 0.5 * dot.diameter_mm * projection.magnification(z_mm).abs();
                let reach_px = (radius_mm + projection.blur_radius_mm(z_mm)) / sensor.pitch_mm;
                let centre = sensor.pixel_from_image(projection.image(dot.centre_mm));
                inside(centre.u, reach_px, sensor.size_px[0]) && inside(centre.v, reach_px, sensor.size_px[1])
            })
        };
        (0..scene.dots().len()).filter(|&dot| whole(&scene.dots()[dot])).collect()
    }
}

/// The paper's instrument with its Fresnel lens as the defaults of `[lens] model = "fresnel"` have it, for what the
/// paper does not state.
pub fn fresnel_instrument() -> Result<Instrument, ValueError> {
    const LENS: &str = "model = \"fresnel\"\nfocal_length_mm = 100.0\n";
    let lens: Lens = toml::from_str(LENS).expect("a constant that a test reads");
    Instrument::new(InstrumentSpec { lens, name: "ohno-2018-fresnel".to_owned(), ..paper::instrument().into_spec() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fresnel_instrument_is_the_papers_but_for_its_lens() {
        let fresnel = fresnel_instrument().unwrap();
        assert!(matches!(fresnel.lens, Lens::Fresnel(_)));
        assert_eq!(fresnel.lens.focal_length_mm(), 100.0);
        assert_eq!(fresnel.apertures, paper::instrument().apertures);
    }
}
