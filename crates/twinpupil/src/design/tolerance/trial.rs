//! One camera, from what it is off by to what it reads, before it is calibrated and after.

use anyhow::{Context, Result};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Dxsm;
use twinpupil_calibrate::{
    BLUR_STD, Choices, DotImage, Foreign, ImageOf, PositionCalibration, PositionCalibrator, Shown,
};
use twinpupil_instrument::{Grid, Instrument, Lens, LensTerms, PixelPoint};
use twinpupil_optics::{Camera, response_table};

use super::built::Drawing;
use super::sight::{Leak, Reader, Sight};
use super::source::Source;
use super::tolerances::Tolerances;
use super::volume::Volume;

/// Everything that all cameras of a run have in common.
pub struct Trial {
    /// The camera as drawn.
    pub drawing: Drawing,
    /// Where depth is judged.
    pub volume: Volume,
    dot_diameter_mm: f64,
    noise_px: f64,
    nominal: Reader,
    lens: Vec<LensTerms>,
}

/// What one camera reads.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Errors of z at all places as the drawing reads them, mm; NaN where a dot is not seen or not read.
    pub before_mm: Vec<f64>,
    /// The same as the calibrated camera reads them.
    pub after_mm: Vec<f64>,
    /// Root mean square of what calibration leaves of the dots' images, px; NaN where there is none.
    pub residual_px: f64,
}

/// Deviation of images by which a calibration without noise weighs what it knows beforehand, px.
const STD_PX_MIN: f64 = 1e-3;

impl Trial {
    /// Of an instrument.
    pub fn new(instrument: &Instrument, tolerances: &Tolerances) -> Result<Self> {
        let drawing = Drawing::new(instrument, tolerances)?;
        let camera = Camera::new(&drawing.instrument)?;
        Ok(Self {
            volume: Volume::of(&drawing.instrument, &camera),
            dot_diameter_mm: tolerances.filter.dot_diameter_mm,
            noise_px: tolerances.calibration.noise_px,
            nominal: Reader::new(&drawing.instrument)?,
            lens: lens_terms(&drawing.instrument, &camera),
            drawing,
        })
    }

    /// What the camera reads that is off by these numbers, in the order of the sources. It is calibrated at the temperature at
    /// which it was built, and reads at that among its numbers.
    pub fn reading(&self, off: &[f64], noise: &mut Pcg64Dxsm) -> Result<Reading> {
        let cold = self.drawing.built(off, true)?;
        let warm = self.drawing.built(off, false)?;
        let leak = Leak { matrix: &warm.leak, dot_diameter_mm: self.dot_diameter_mm };
        let sight = Sight::new(&warm.instrument)?;
        let moved = |[x, y, z]: [f64; 3], farther_mm: f64| [x, y, z + farther_mm];
        let dot = |place: &[f64; 3]| {
            let shown = sight.dot(moved(*place, warm.farther_mm), &leak)?;
            Some(shown.iter().map(|shown| shown.centre).collect())
        };
        let seen: Vec<Option<Vec<PixelPoint>>> = self.volume.places_mm.iter().map(dot).collect();
        let noise_px = if self.has_noise(off) { self.noise_px } else { 0.0 };
        let cold_sight = Sight::new(&cold.instrument)?;
        let images = self.target_images(&cold_sight, cold.farther_mm, &leak, (noise_px, noise));
        let calibration = self.calibrated(&images)?;
        let datum = calibration.datum(&self.volume.dots_mm, &self.volume.poses).context("the target has no datum")?;
        let calibrated = Reader::new(&calibration.instrument)?;
        let errors_mm = |read: &dyn Fn(&[PixelPoint], [f64; 3]) -> Option<f64>| {
            let error = |(place, seen): (&[f64; 3], &Option<Vec<PixelPoint>>)| {
                seen.as_ref().and_then(|seen| read(seen, *place)).map_or(f64::NAN, |z_mm| z_mm - place[2])
            };
            self.volume.places_mm.iter().zip(&seen).map(error).collect()
        };
        Ok(Reading {
            before_mm: errors_mm(&|seen, place| Some(self.nominal.position_mm(seen, place)?[2])),
            after_mm: errors_mm(&|seen, place| Some(datum.moving(calibrated.position_mm(seen, place)?)[2])),
            residual_px: calibration.rms_px,
        })
    }

    fn has_noise(&self, off: &[f64]) -> bool {
        self.drawing.sources.iter().zip(off).any(|(own, off)| own.source == Source::Noise && *off != 0.0)
    }

    /// What the camera shows of its target.
    fn target_images(
        &self,
        sight: &Sight,
        farther_mm: f64,
        leak: &Leak<'_>,
        (noise_px, noise): (f64, &mut Pcg64Dxsm),
    ) -> Vec<DotImage> {
        let Volume { dots_mm, poses, whole, .. } = &self.volume;
        let mut images = Vec::new();
        for &(frame, dot) in whole {
            let [x, y, z]: [f64; 3] = poses[frame].at(dots_mm[dot]).into();
            let Some(all) = sight.dot([x, y, z + farther_mm], leak) else { continue };
            for (band, shown) in all.into_iter().enumerate() {
                let [u, v, blur]: [f64; 3] = std::array::from_fn(|_| StandardNormal.sample(noise));
                let centre = PixelPoint { u: shown.centre.u + noise_px * u, v: shown.centre.v + noise_px * v };
                let shown = Shown { centre, blur_px: shown.blur_px + BLUR_STD * noise_px * blur };
                images.push(DotImage { frame, band, dot, shown });
            }
        }
        images
    }

    fn calibrated(&self, images: &[DotImage]) -> Result<PositionCalibration> {
        let optics = |instrument: &Instrument| -> Result<ImageOf, Foreign> {
            let sight = Sight::new(instrument)?;
            Ok(Box::new(move |band, object_mm| sight.shown(band, object_mm)))
        };
        let calibrator = PositionCalibrator {
            instrument: &self.drawing.instrument,
            dots_mm: &self.volume.dots_mm,
            choices: &Choices::default(),
            lens: &self.lens,
            std_px: self.noise_px.max(STD_PX_MIN),
            optics: &optics,
        };
        Ok(calibrator.calibrate(images, &self.volume.poses)?)
    }
}

/// What the lens adds to first order, from a table of some nodes.
fn lens_terms(instrument: &Instrument, camera: &Camera) -> Vec<LensTerms> {
    const NODES: [usize; 2] = [12, 5];
    let none = || vec![LensTerms::default(); instrument.bands.len()];
    if matches!(instrument.lens, Lens::Thin(_)) {
        return none();
    }
    let (range, radius_mm) = (instrument.depth_range(), instrument.corner_radius_mm());
    let magnifications = instrument.projections().map(|projection| projection.magnification(range.far_mm).abs());
    let r_mm = Grid::spanning(0.0, radius_mm / magnifications[0].min(magnifications[1]), NODES[0]);
    let z_mm = Grid::spanning(range.near_mm, range.far_mm, NODES[1]);
    let table = response_table(camera, r_mm, z_mm, Grid::spanning(0.0, radius_mm, 2));
    let terms = |(band, own): (usize, &twinpupil_instrument::Band)| {
        table.lens_terms(band, &instrument.projection(own), radius_mm)
    };
    instrument.bands.iter().enumerate().map(terms).collect()
}
