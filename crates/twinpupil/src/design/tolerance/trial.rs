//! One camera, from what it is off by to what it reads, before it is calibrated and after.

use anyhow::{Context, Result, bail};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Dxsm;
use twinpupil_calibrate::{
    BLUR_STD, Choices, DotImage, Foreign, ImageOf, Pose, PositionCalibration, PositionCalibrator, Quantity, Shown,
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
    choices: Choices,
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
        let camera = Camera::new(&drawing.instrument)?.smoothed();
        let choices = Choices { prior_std: tolerances.calibration.prior_std.clone(), ..Choices::default() };
        check(&choices, &drawing.instrument)?;
        Ok(Self {
            choices,
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
        let (cold, warm) = (self.drawing.built(off, true)?, self.drawing.built(off, false)?);
        let leak = Leak { matrix: &warm.leak, dot_diameter_mm: self.dot_diameter_mm };
        let sight = Sight::new(&warm.instrument)?;
        let moved = |[x, y, z]: [f64; 3], farther_mm: f64| [x, y, z + farther_mm];
        let dot = |place: &[f64; 3]| {
            let shown = sight.dot(moved(*place, warm.farther_mm), &leak)?;
            Some(shown.iter().map(|shown| shown.centre).collect())
        };
        let seen: Vec<Option<Vec<PixelPoint>>> = self.volume.places_mm.iter().map(dot).collect();
        let noise_px = if self.has_noise(off) { self.noise_px } else { 0.0 };
        let cold_sight = if cold.instrument == warm.instrument { sight } else { Sight::new(&cold.instrument)? };
        let images = self.target_images(&cold_sight, cold.farther_mm, &leak, (noise_px, noise));
        let calibration = self.calibrated(&images)?;
        let datum = calibration.datum(&self.volume.dots_mm, &self.volume.poses).context("the target has no datum")?;
        let calibrated = Reader::new(&calibration.instrument)?;
        let read = |reader: &Reader, datum: Option<&Pose>| -> Vec<f64> {
            let error = |(place, seen): (&[f64; 3], &Option<Vec<PixelPoint>>)| {
                let found_mm = reader.position_mm(seen.as_ref()?, *place)?;
                Some(datum.map_or(found_mm, |datum| datum.moving(found_mm))[2] - place[2])
            };
            let errors_mm = self.volume.places_mm.iter().zip(&seen).map(error);
            errors_mm.map(|error_mm| error_mm.unwrap_or(f64::NAN)).collect()
        };
        Ok(Reading {
            before_mm: read(&self.nominal, None),
            after_mm: read(&calibrated, Some(&datum)),
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
            choices: &self.choices,
            lens: &self.lens,
            std_px: self.noise_px.max(STD_PX_MIN),
            optics: &optics,
        };
        Ok(calibrator.calibrate(images, &self.volume.poses)?)
    }
}

/// Refuses keys that calibration does not know.
fn check(choices: &Choices, instrument: &Instrument) -> Result<()> {
    let known: Vec<String> = Quantity::all(instrument).iter().map(|quantity| quantity.key(instrument)).collect();
    match choices.prior_std.keys().find(|key| !known.contains(key)) {
        Some(key) => {
            bail!("`calibration.prior_std.{key}` is no number of this instrument; legal: {}", known.join(", "))
        }
        None => Ok(()),
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

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{Projection, Zone, paper};
    use twinpupil_reconstruct::{Mode, Options, Reconstructor};
    use twinpupil_simulate::{DotSpec, Scene, SceneSpec, SimulateOptions, simulate};

    use super::super::sight::tests::{FACETS, FRESNEL, grooved};
    use super::super::tolerances::grade;
    use super::*;

    /// f, L and the distance in focus of the paper's camera, mm.
    const F: f64 = 100.0;
    const L: f64 = 151.0;

    /// Errors of second order beside small ones of first order.
    const SMALL: f64 = 1e-4;

    /// The paper's camera with masks that hide nothing of each other, as closed forms have it.
    fn unclipped() -> Instrument {
        let mut spec = paper::instrument().into_spec();
        for (mask, band) in [(0, "blue"), (1, "red")] {
            let own = Zone { radius_mm: Some(0.5), pass: vec![band.to_owned()] };
            let other = ["red", "blue"].into_iter().filter(|name| *name != band).map(str::to_owned).collect::<Vec<_>>();
            // The other band passes everywhere: its light through the middle as well.
            let middle = Zone { pass: vec![own.pass[0].clone(), other[0].clone()], ..own };
            spec.apertures[mask].zones = vec![middle, Zone { radius_mm: None, pass: other }];
        }
        Instrument::new(spec).unwrap()
    }

    fn trial(instrument: &Instrument) -> Trial {
        Trial::new(instrument, &Tolerances::from_toml(grade("commercial").unwrap()).unwrap()).unwrap()
    }

    /// What a camera reads that is off by one number alone.
    fn single(trial: &Trial, source: Source, off: f64) -> Reading {
        let place = trial.drawing.sources.iter().position(|own| own.source == source).unwrap();
        let mut all = vec![0.0; trial.drawing.sources.len()];
        all[place] = off;
        trial.reading(&all, &mut Pcg64Dxsm::new(1, 1)).unwrap()
    }

    /// Whether depths before calibration change as a closed form says, at all places.
    fn agrees(trial: &Trial, source: Source, off: f64, expected_mm: impl Fn([f64; 3]) -> f64) {
        let reading = single(trial, source, off);
        let largest = trial.volume.places_mm.iter().map(|place| expected_mm(*place).abs()).fold(0.0, f64::max);
        for (place, found_mm) in trial.volume.places_mm.iter().zip(&reading.before_mm) {
            let expected_mm = expected_mm(*place);
            assert!((found_mm - expected_mm).abs() < 1e-2 * largest, "{source:?} {place:?}: {found_mm} {expected_mm}");
        }
        // Calibration finds all that its numbers can be.
        assert!(reading.after_mm.iter().all(|mm| mm.abs() < 1e-2 * largest), "{source:?}: {:?}", reading.after_mm);
    }

    #[test]
    fn a_camera_as_drawn_reads_no_errors() {
        let reading = single(&trial(&unclipped()), Source::SensorDistance, 0.0);
        assert!(reading.before_mm.iter().chain(&reading.after_mm).all(|mm| mm.abs() < 1e-5), "{reading:?}");
    }

    #[test]
    fn depth_changes_with_distance_and_focal_length_as_the_equations_say() {
        let trial = trial(&unclipped());
        // z = Γ L f/(L − f)  [Ohno2018, Eq. 12], and of the images r_R = (L/f − 1) r, r_B = L r/z: dz/dL = z f/(L (L − f)).
        agrees(&trial, Source::SensorDistance, SMALL, |[_, _, z]| z * F / (L * (L - F)) * SMALL);
        // With the mask where it was, m_R = (L b − d a)/(d + b z), b = 1 − d/f, a = 1 − L/f: dm_R/m_R = −z df/f².
        let band = trial.drawing.instrument.bands.iter().position(|band| band.name == "red").unwrap();
        let percent = 100.0 * SMALL / F;
        agrees(&trial, Source::BandFocalLength(band), percent, |[_, _, z]| -z * z / (F * F) * SMALL);
        // Images of the entocentric band do not depend on its focal length.
        agrees_with_nothing(&trial, Source::BandFocalLength(1 - band), percent);
    }

    fn agrees_with_nothing(trial: &Trial, source: Source, off: f64) {
        let reading = single(trial, source, off);
        assert!(reading.before_mm.iter().all(|mm| mm.abs() < 1e-5), "{source:?}: {:?}", reading.before_mm);
    }

    #[test]
    fn depth_changes_with_what_is_off_the_axis_as_the_equations_say() {
        let trial = trial(&unclipped());
        // r_R = (L/f − 1) r, r_B = L r/z; an image moved by δ along x moves its radius by δ cos φ, and z ∝ r_R/r_B.
        let radii = |[x, y, z]: [f64; 3]| {
            let r = x.hypot(y);
            ((L / F - 1.0) * r, L / z * r, x / r)
        };
        agrees(&trial, Source::SensorCentre(0), SMALL, |place| {
            // The sensor goes, the image stays.
            let (telecentric, entocentric, cos) = radii(place);
            place[2] * SMALL * cos * (1.0 / telecentric - 1.0 / entocentric)
        });
        // A pupil off by c moves the image by s c, s = −(L + a z)/(d + b z).
        let a = 1.0 - L / F;
        agrees(&trial, Source::MaskCentre(1, 0), SMALL, |place| {
            let (telecentric, _, cos) = radii(place);
            -place[2] * (L + a * place[2]) / F * SMALL * cos / telecentric
        });
        agrees(&trial, Source::MaskCentre(0, 0), SMALL, |place| {
            let (_, entocentric, cos) = radii(place);
            (L + a * place[2]) * SMALL * cos / entocentric
        });
    }

    #[test]
    fn a_mask_off_along_the_axis_is_a_pupil_elsewhere() {
        let trial = trial(&unclipped());
        let magnification = |position_mm: f64, z_mm: f64| {
            let telecentric =
                Projection { pupil_position_mm: position_mm, ..trial.drawing.instrument.projections()[0] };
            telecentric.magnification(z_mm)
        };
        agrees(&trial, Source::MaskPosition(1), SMALL, |[_, _, z]| {
            z * (magnification(F + SMALL, z) / magnification(F, z) - 1.0)
        });
    }

    #[test]
    fn a_camera_behind_facets_is_calibrated_as_well_as_another() {
        let trial = trial(&grooved(FACETS, 2.0));
        let rms_mm =
            |errors_mm: &[f64]| (errors_mm.iter().map(|mm| mm * mm).sum::<f64>() / errors_mm.len() as f64).sqrt();
        // Noise, the focal length, a mask beside the axis: before it is calibrated, the last two leave 1 mm.
        for (source, off) in [(Source::Noise, 1.0), (Source::Radius(0), 0.2), (Source::MaskCentre(1, 0), 0.02)] {
            let reading = single(&trial, source, off);
            assert!(rms_mm(&reading.after_mm) < 0.04, "{source:?}: {:?}", reading.after_mm);
        }
        // Facets that are cut bend light more in denser glass, as they do if they are cut for a shorter focal length.
        const OFF: f64 = 5e-4;
        let denser = single(&trial, Source::Index(0), OFF).before_mm;
        let shorter = single(&trial, Source::Radius(0), -100.0 * OFF / (0.4918 + OFF)).before_mm;
        let apart: Vec<f64> = denser.iter().zip(&shorter).map(|(a, b)| a - b).collect();
        assert!(rms_mm(&denser) > 0.5 && rms_mm(&apart) < 0.2 * rms_mm(&denser), "{denser:?} {shorter:?}");
    }

    #[test]
    fn a_fresnel_lens_is_refused_and_what_is_the_same_is_named() {
        let tolerances = Tolerances::from_toml(grade("commercial").unwrap()).unwrap();
        let said = Trial::new(&grooved(FRESNEL, 1.0), &tolerances).err().unwrap().to_string();
        assert!(said.starts_with("`lens.model` is fresnel,") && said.contains("kind facets"), "{said}");
    }

    #[test]
    fn temperature_after_calibration_is_not_calibrated_away() {
        let trial = trial(&unclipped());
        let reading = single(&trial, Source::Temperature, 1.0);
        // Housing and lens grow as 23.6e-6 and 1.3e-6: f, L and the telecentric mask are all off.
        let alike = |(before, after): (&f64, &f64)| (before - after).abs() < 1e-3 * before.abs() + 1e-5;
        assert!(reading.before_mm.iter().zip(&reading.after_mm).all(alike), "{reading:?}");
        assert!(reading.before_mm.iter().any(|mm| mm.abs() > 1e-3));
    }

    #[test]
    fn keys_that_calibration_does_not_know_are_refused() {
        let mut tolerances = Tolerances::from_toml(grade("precision").unwrap()).unwrap();
        tolerances.calibration.prior_std.insert("sensor.pitch_mm".to_owned(), 1.0);
        let said = Trial::new(&unclipped(), &tolerances).err().unwrap().to_string();
        assert!(said.starts_with("`calibration.prior_std.sensor.pitch_mm` is no number of this instrument"), "{said}");
    }

    /// The paper's camera with pixels twice as wide, all of which see both bands.
    fn coarse() -> Instrument {
        let mut spec = paper::instrument().into_spec();
        spec.sensor.size_px = [960, 600];
        spec.sensor.pitch_mm *= 2.0;
        spec.sensor.axis_px = [479.5, 299.5];
        spec.sensor.mosaic = twinpupil_instrument::Mosaic::Rgb;
        Instrument::new(spec).unwrap()
    }

    #[test]
    fn a_drawn_camera_reads_its_frames_as_foreseen() {
        /// What pixels and rays leave of depths, mm; the errors are some mm.
        const FRAME_MM: f64 = 0.03;
        let instrument = coarse();
        let trial = trial(&instrument);
        let off: Vec<f64> = trial
            .drawing
            .sources
            .iter()
            .enumerate()
            .map(|(k, own)| match own.source {
                Source::Leak(..) | Source::Noise => 0.0,
                _ => 0.4 * own.tolerance * (k as f64 + 1.0).sin(),
            })
            .collect();
        let foreseen = trial.reading(&off, &mut Pcg64Dxsm::new(1, 1)).unwrap();
        let built = trial.drawing.built(&off, false).unwrap().instrument;
        let table = twinpupil_optics::response_table_for(&instrument).unwrap();
        let options = Options { mode: Mode::Centroid, ..Options::default() };
        let reader = Reconstructor::new(instrument.clone(), Some(table), options);
        let mut errors_mm = Vec::new();
        // The farthest dots, in three directions; at the ends of the depth range pairs would be sought beyond it.
        for depth in 1..4 {
            let places: Vec<usize> = (0..12).filter(|n| n % 4 == 3).map(|n| 12 * depth + n).collect();
            let dot = |n: &usize| {
                let [x_mm, y_mm, z_mm] = trial.volume.places_mm[*n];
                DotSpec { x_mm: 0.8 * x_mm, y_mm: 0.8 * y_mm, z_mm, diameter_mm: 0.8 }
            };
            let scene = Scene::new(SceneSpec {
                schema: 1,
                name: "places".to_owned(),
                seed: 0,
                background_e: 0.0,
                brightness_e: 20_000.0,
                illumination: None,
                dots: places.iter().map(dot).collect(),
                plate: None,
            })
            .unwrap();
            let options = SimulateOptions { pupil_samples: 256, seed: None, ..SimulateOptions::default() };
            let frame = simulate(&built, &scene, &built.response_matrix(), &options, &|_| ()).unwrap().frame;
            let points = reader.reconstruct(&frame).unwrap().points;
            let sight = Sight::new(&built).unwrap();
            let leak = Leak { matrix: &[vec![0.0; 2], vec![0.0; 2]], dot_diameter_mm: 0.8 };
            for dot in scene.dots() {
                let shown = sight.dot(dot.centre_mm, &leak).unwrap();
                let pixels: Vec<PixelPoint> = shown.iter().map(|shown| shown.centre).collect();
                let expected_mm = trial.nominal.position_mm(&pixels, dot.centre_mm).unwrap();
                let off_mm = |point: &&twinpupil_reconstruct::Point| {
                    (point.position_mm[0] - expected_mm[0]).hypot(point.position_mm[1] - expected_mm[1])
                };
                let found = points.iter().min_by(|a, b| off_mm(a).total_cmp(&off_mm(b))).unwrap();
                assert!(off_mm(&found) < 0.05, "{found:?} {expected_mm:?}");
                let z_mm = found.position_mm[2];
                assert!((z_mm - expected_mm[2]).abs() < FRAME_MM, "{dot:?}: {z_mm} {}", expected_mm[2]);
                errors_mm.push(z_mm - dot.centre_mm[2]);
            }
        }
        let largest_mm = errors_mm.iter().map(|mm| mm.abs()).fold(0.0, f64::max);
        assert!(errors_mm.len() == 9 && largest_mm > 1.0, "{errors_mm:?}");
        assert!(foreseen.after_mm.iter().all(|mm| mm.abs() < 0.2), "{:?}", foreseen.after_mm);
    }
}
