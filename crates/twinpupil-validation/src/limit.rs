//! Errors beside the Cramér–Rao bound of the very frames on which they were made.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use twinpupil_instrument::{Instrument, Lens, Mosaic, Registration, paper};
use twinpupil_reconstruct::{FitPoint, LineAxis, Mode, Reconstruction, fit_line};
use twinpupil_simulate::{Scene, SceneSpec, dot_bounds};

use crate::plates::{FALSE_MM, Pose, is_within, rms};
use crate::rig::{Rig, nearest_of_all};

/// Rays for every pixel of the frames and of their bounds.
const PUPIL_SAMPLES: usize = 256;

/// A camera of which the noise limit is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Camera {
    /// Every pixel sees both bands.
    Rgb,
    /// The paper's mosaic.
    Rggb,
    /// Every pixel sees both bands, through a lens of 100.64 mm in red and 98.19 mm in blue: PMMA's dispersion.
    Dispersive,
    /// A sensor for each band; the blue one sees a mirror image, turned by 3° and 2 % larger.
    Mirrored,
    /// The mosaic, tilted by 0.5° and 0.3°, behind a lens with a distortion at the corner of 0.3 % in red and −0.2 % in
    /// blue.
    Crooked,
    /// The same with every pixel for both bands.
    CrookedRgb,
    /// Masks 0.05 mm off the axis, to either side.
    Decentred,
    /// Every pixel sees both bands, behind a stop that cuts the telecentric band's pencils from r = 5.6 mm on, most of them at
    /// the end of the plate.
    Vignetted,
}

impl Camera {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Rgb,
        Self::Rggb,
        Self::Dispersive,
        Self::Mirrored,
        Self::Crooked,
        Self::CrookedRgb,
        Self::Decentred,
        Self::Vignetted,
    ];

    /// The instrument: the paper's, but for what the name says.
    pub fn instrument(self) -> Instrument {
        let mut spec = paper::instrument().into_spec();
        if !matches!(self, Self::Rggb | Self::Crooked | Self::Decentred) {
            spec.sensor.mosaic = Mosaic::Rgb;
        }
        match self {
            Self::Mirrored => {
                spec.sensor.mosaic = Mosaic::Sensors;
                for (band, plane) in spec.bands.iter_mut().zip(["0", "1"]) {
                    band.plane = plane.to_owned();
                }
                let (sin, cos) = 3.0_f64.to_radians().sin_cos();
                let (c, s) = (cos / 1.02, sin / 1.02);
                let [u, v] = [959.5, 599.5];
                // About the middle of the sensor, which the beam splitter shifts by some pixels.
                let rows = [[-c, s, u + c * u - s * v + 12.0], [s, c, v - s * u - c * v - 7.0], [0.0, 0.0, 1.0]];
                spec.bands[1].registration = Registration::from_rows(rows);
            }
            Self::Crooked | Self::CrookedRgb => {
                spec.sensor.tilt_deg = [0.5, -0.3];
                // The corner lies 6.63 mm off the axis.
                spec.bands[0].distortion.k1_per_mm2 = 0.003 / 6.63_f64.powi(2);
                spec.bands[1].distortion.k1_per_mm2 = -0.002 / 6.63_f64.powi(2);
                spec.bands[1].distortion.p1_per_mm = 1e-5;
            }
            Self::Decentred => {
                spec.apertures[0].centre_mm = [0.05, -0.02];
                spec.apertures[1].centre_mm = [-0.03, 0.05];
            }
            Self::Vignetted => spec.apertures[2].zones[0].radius_mm = Some(4.5),
            Self::Rgb | Self::Rggb | Self::Dispersive => {}
        }
        if let (Self::Dispersive, Lens::Thin(lens)) = (self, &mut spec.lens) {
            lens.focal_length_mm_by_band = [("red".to_owned(), 100.64), ("blue".to_owned(), 98.19)].into();
        }
        Instrument::new(spec).expect("the paper's instrument, varied within its range")
    }
}

/// How the dots of one or more frames were found, and how well.
#[derive(Debug, Clone, Default)]
pub struct Score {
    /// Dots wholly on the sensor, from r = 2 on.
    pub whole: usize,
    /// Their errors of z, mm, with the deviation that was reported and the bound; those that were not found are missing.
    pub found: Vec<Error>,
    /// Where those are that were not found, mm.
    pub missing_mm: Vec<[f64; 3]>,
    /// Points that belong to no dot.
    pub false_points: usize,
    /// Features that became no point, by their reason.
    pub rejected: BTreeMap<&'static str, usize>,
    /// Root mean square of error over reported deviation, frame by frame.
    pub pulls: Vec<f64>,
    /// Error of the fitted tilt, degrees, and R² of the fit, frame by frame.
    pub tilts: Vec<[f64; 2]>,
    /// Time to reconstruct, frame by frame.
    pub times: Vec<Duration>,
}

/// An error of z beside what was to be expected, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Error {
    /// Found less true.
    pub error_mm: f64,
    /// Deviation that was reported with the point.
    pub std_mm: f64,
    /// Cramér–Rao bound of the dot.
    pub bound_mm: f64,
    /// True position of the dot.
    pub centre_mm: [f64; 3],
    /// χ² of the pixels about their model over their number; NaN if there was no model.
    pub pixel_chi2: f64,
}

/// Which dots count, and which points may be theirs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Terms {
    /// Dots nearer to the axis do not count, mm.
    pub r_min_mm: f64,
    /// How far from a dot its point may lie, across the axis and in depth, mm.
    pub reach_mm: [f64; 2],
}

impl Default for Terms {
    /// Those of the paper's plate.
    fn default() -> Self {
        Self { r_min_mm: 2.0, reach_mm: FALSE_MM }
    }
}

impl Score {
    /// Scores one frame of the paper's plate, or of dots like its own: its noise from `seed`.
    ///
    /// # Panics
    /// If the scene cannot be simulated.
    pub fn of(rig: &Rig, scene: &Scene, seed: u64) -> Self {
        Self::on(Terms::default(), rig, scene, seed)
    }

    /// Scores one frame of a scene on these terms: its noise from `seed`.
    ///
    /// # Panics
    /// If the scene cannot be simulated.
    pub fn on(terms: Terms, rig: &Rig, scene: &Scene, seed: u64) -> Self {
        let is_near = |position_mm, centre_mm| is_within(terms.reach_mm, position_mm, centre_mm);
        let bounds = dot_bounds(&rig.instrument, scene, &rig.response, PUPIL_SAMPLES).expect("the scene can be seen");
        let frame = rig.frame(scene, Some(seed));
        let start = Instant::now();
        let Reconstruction { points, rejected, .. } = rig.read(&frame);
        let mut score = Self { times: vec![start.elapsed()], ..Self::default() };
        for rejection in &rejected {
            *score.rejected.entry(rejection.reason.name()).or_default() += 1;
        }
        for (dot, bound) in scene.dots().iter().zip(&bounds) {
            let Some(bound) = bound.filter(|_| dot.centre_mm[0].hypot(dot.centre_mm[1]) >= terms.r_min_mm) else {
                continue;
            };
            score.whole += 1;
            let point =
                nearest_of_all(&points, dot.centre_mm).filter(|point| is_near(point.position_mm, dot.centre_mm));
            if point.is_none() {
                score.missing_mm.push(dot.centre_mm);
            }
            score.found.extend(point.map(|point| Error {
                error_mm: point.position_mm[2] - dot.centre_mm[2],
                std_mm: point.std_mm[2],
                bound_mm: bound.std_mm()[2],
                centre_mm: dot.centre_mm,
                pixel_chi2: point.pixel_chi2.unwrap_or(f64::NAN),
            }));
        }
        score.pulls.push(score.error_over_std());
        score.false_points = points
            .iter()
            .filter(|point| !scene.dots().iter().any(|dot| is_near(point.position_mm, dot.centre_mm)))
            .count();
        if let Some(plate) = scene.spec().plate.as_ref().filter(|plate| plate.tilt_deg != 0.0) {
            let points: Vec<FitPoint> = points
                .iter()
                .map(|point| FitPoint { position_mm: point.position_mm, z_std_mm: Some(point.std_mm[2]) })
                .collect();
            if let Ok(fit) = fit_line(&points, LineAxis::X) {
                score.tilts.push([fit.tilt_rad.value.to_degrees() - plate.tilt_deg, fit.quality.r_squared]);
            }
        }
        score
    }

    /// Adds another frame's score.
    pub fn merge(&mut self, other: Self) {
        self.whole += other.whole;
        self.found.extend(other.found);
        self.missing_mm.extend(other.missing_mm);
        self.false_points += other.false_points;
        for (reason, count) in other.rejected {
            *self.rejected.entry(reason).or_default() += count;
        }
        self.pulls.extend(other.pulls);
        self.tilts.extend(other.tilts);
        self.times.extend(other.times);
    }

    /// Share of the dots that were found.
    pub fn recall(&self) -> f64 {
        self.found.len() as f64 / self.whole.max(1) as f64
    }

    /// Root mean square error of z, mm.
    pub fn rms_mm(&self) -> f64 {
        rms(self.found.iter().map(|e| e.error_mm))
    }

    /// Root mean square bound of z, mm.
    pub fn bound_mm(&self) -> f64 {
        rms(self.found.iter().map(|e| e.bound_mm))
    }

    /// Root mean square of every error over its dot's own bound.
    pub fn error_over_bound(&self) -> f64 {
        rms(self.found.iter().map(|e| e.error_mm / e.bound_mm))
    }

    /// Root mean square of every error over the deviation that was reported with it.
    pub fn error_over_std(&self) -> f64 {
        rms(self.found.iter().map(|e| e.error_mm / e.std_mm))
    }

    /// Median time to reconstruct a frame.
    pub fn time(&self) -> Duration {
        let mut times = self.times.clone();
        times.sort();
        times.get(times.len() / 2).copied().unwrap_or_default()
    }
}

/// The paper's plate in a pose, as bright as `brightness_e`.
///
/// # Panics
/// If the brightness is not legal.
pub fn plate(pose: Pose, brightness_e: f64, seed: u64) -> Scene {
    Scene::new(SceneSpec { brightness_e, ..pose.scene(seed).spec().clone() }).expect("the paper's plate")
}

/// A rig that reads frames of a camera by its forward model.
pub fn model_rig(camera: Camera) -> Rig {
    Rig::new(camera.instrument(), Mode::Model)
}
