//! Cameras off their data sheet, calibrated from a target: how well the depth of other frames' dots comes out.

use std::borrow::Cow;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use twinpupil_calibrate::{
    AxisError, AxisEstimate, AxisFinder, CalibrateError, Calibration, Calibrator, Choices, StagePosition, Target,
    TargetKind, TargetSpec,
};
use twinpupil_instrument::{Correction, Distortion, Frame, Instrument, InstrumentSpec, Lens, Mosaic, paper};
use twinpupil_optics::response_table_for;
use twinpupil_reconstruct::{Mode, Options, Reconstructor};
use twinpupil_simulate::{Dot, DotGrid, Expectation, Pattern, Plate, Scene, SceneSpec, TiltAxis};

use crate::rig::{Rig, nearest};

/// A pose of the target: distance in mm, tilt in degrees about an axis, turn in degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetPose {
    /// Where the plate meets the axis, mm.
    pub distance_mm: f64,
    /// Its tilt, degrees.
    pub tilt_deg: f64,
    /// The axis of the tilt.
    pub tilt_axis: TiltAxis,
    /// The turn of the grid on it, degrees.
    pub turn_deg: f64,
}

const fn pose(distance_mm: f64, tilt_deg: f64, tilt_axis: TiltAxis, turn_deg: f64) -> TargetPose {
    TargetPose { distance_mm, tilt_deg, tilt_axis, turn_deg }
}

/// Seven poses from 258 to 342 mm with tilts to 30°.
pub const POSES: [TargetPose; 7] = [
    pose(258.0, 0.0, TiltAxis::Y, 3.0),
    pose(272.0, 25.0, TiltAxis::X, -4.0),
    pose(286.0, -30.0, TiltAxis::Y, 8.0),
    pose(300.0, 30.0, TiltAxis::Y, 0.0),
    pose(314.0, -28.0, TiltAxis::X, -10.0),
    pose(328.0, 20.0, TiltAxis::X, 5.0),
    pose(342.0, -15.0, TiltAxis::Y, 2.0),
];

/// The data sheet: the paper's camera with every pixel seeing both bands, or behind a mosaic.
pub fn data_sheet(mosaic: Mosaic) -> Instrument {
    let mut spec = paper::instrument().into_spec();
    spec.sensor.mosaic = mosaic;
    Instrument::new(spec).expect("a legal instrument")
}

/// The same camera as it came off the line: other focal lengths, another distance of the sensor, its axis elsewhere and
/// its masks off centre; with a tilted sensor and distortion if asked.
pub fn off_data_sheet(data_sheet: &Instrument, is_bent: bool) -> Instrument {
    let mut spec = data_sheet.clone().into_spec();
    if let Lens::Thin(lens) = &mut spec.lens {
        let by_band = [("red", 1.009), ("blue", 0.986)];
        lens.focal_length_mm_by_band =
            by_band.map(|(band, factor)| (band.to_owned(), factor * lens.focal_length_mm)).into();
    }
    spec.sensor.distance_mm += 0.7;
    spec.sensor.axis_px = [spec.sensor.axis_px[0] + 5.6, spec.sensor.axis_px[1] - 4.2];
    spec.apertures[0].centre_mm = [0.03, -0.04];
    spec.apertures[1].centre_mm = [-0.04, -0.03];
    if is_bent {
        bend(&mut spec);
    }
    Instrument::new(spec).expect("a legal instrument")
}

/// Tilts the sensor by 0.3° and distorts the images by 0.1 % at its corner.
fn bend(spec: &mut InstrumentSpec) {
    spec.sensor.tilt_deg = [0.24, -0.18];
    let [x_mm, y_mm] = spec.sensor.size_px.map(|size| 0.5 * size as f64 * spec.sensor.pitch_mm);
    let square = x_mm * x_mm + y_mm * y_mm;
    for (band, share) in spec.bands.iter_mut().zip([1e-3, -0.8e-3]) {
        band.distortion = Distortion { k1_per_mm2: share / square, ..Distortion::default() };
    }
}

/// A camera with half as many pixels a side, twice as wide.
pub fn coarse(camera: &Instrument) -> Instrument {
    let mut spec = camera.clone().into_spec();
    spec.sensor.size_px = spec.sensor.size_px.map(|size| size / 2);
    spec.sensor.axis_px = spec.sensor.axis_px.map(|axis| 0.5 * (axis - 0.5));
    spec.sensor.pitch_mm *= 2.0;
    Instrument::new(spec).expect("a legal instrument")
}

/// The same camera with a smooth field of displacements in every band, root mean square `rms_px` over its circle, that no
/// number of it stands for: terms of orders 3 to 7, drawn by number, the higher the weaker.
pub fn warped(camera: &Instrument, rms_px: f64, seed: u64) -> Instrument {
    const DEGREE: usize = 7;
    let mut spec = camera.clone().into_spec();
    let (pitch_mm, radius_mm) = (spec.sensor.pitch_mm, camera.corner_radius_mm());
    for (band, own) in spec.bands.iter_mut().enumerate() {
        let mut draws = Pcg64Mcg::seed_from_u64(1000 * seed + band as u64);
        let mut correction = Correction::none(radius_mm, DEGREE);
        let mut square = 0.0;
        for (term, (x_mm, y_mm)) in correction.x_mm.iter_mut().zip(&mut correction.y_mm).enumerate() {
            let (order, _) = Correction::orders(term);
            if order < 3 {
                continue;
            }
            let mut draw = || draws.random_range(-1.0..1.0) / order as f64;
            (*x_mm, *y_mm) = (draw(), draw());
            // The mean square of a circle polynomial over the circle is 1/(n + 1).
            square += (x_mm.powi(2) + y_mm.powi(2)) / (order as f64 + 1.0);
        }
        let scale = rms_px * pitch_mm / square.sqrt();
        correction.x_mm.iter_mut().chain(&mut correction.y_mm).for_each(|coefficient| *coefficient *= scale);
        own.correction = Some(correction);
    }
    Instrument::new(spec).expect("a legal instrument")
}

/// A grid of 9 × 7 dots with a pitch of 1.5 mm.
pub fn target() -> Target {
    Target::new(TargetSpec {
        schema: 1,
        name: "9 x 7 dots".to_owned(),
        kind: TargetKind::DotGrid,
        rows: 7,
        columns: 9,
        pitch_mm: 1.5,
        dot_diameter_mm: 0.9,
        fiducials: Vec::new(),
    })
    .expect("a legal target")
}

/// The target in a pose, at 20 000 electrons.
pub fn target_scene(target: &Target, pose: &TargetPose) -> Scene {
    let spec = target.spec();
    let grid = DotGrid {
        rows: spec.rows as u32,
        columns: spec.columns as u32,
        pitch_mm: spec.pitch_mm,
        diameter_mm: spec.dot_diameter_mm,
        turn_deg: pose.turn_deg,
        ..DotGrid::default()
    };
    Scene::new(SceneSpec {
        schema: 1,
        name: "target".to_owned(),
        seed: 0,
        background_e: 0.0,
        brightness_e: 20_000.0,
        illumination: None,
        dots: Vec::new(),
        plate: Some(Plate {
            distance_mm: pose.distance_mm,
            tilt_deg: pose.tilt_deg,
            tilt_axis: pose.tilt_axis,
            pattern: Pattern::Grid(grid),
        }),
    })
    .expect("a legal scene")
}

/// What a camera sees of scenes, exposed as often as asked.
#[derive(Debug)]
pub struct Exposures {
    camera: Rig,
    scenes: Vec<Scene>,
    expectations: Vec<Expectation>,
}

impl Exposures {
    /// Traces the scenes with so many rays a pixel.
    pub fn new(camera: Instrument, scenes: Vec<Scene>, pupil_samples: usize) -> Self {
        let camera = Rig::new(camera, Mode::Model);
        let expectations = scenes.iter().map(|scene| camera.expectation(scene, pupil_samples)).collect();
        Self { camera, scenes, expectations }
    }

    /// The target in all poses.
    pub fn of_target(camera: Instrument, target: &Target, poses: &[TargetPose], pupil_samples: usize) -> Self {
        Self::new(camera, poses.iter().map(|pose| target_scene(target, pose)).collect(), pupil_samples)
    }

    /// One frame of every scene.
    pub fn frames(&self, noise_seed: u64) -> Vec<Frame> {
        let frame = |(k, expectation)| self.camera.exposed(expectation, 1000 * noise_seed + k as u64);
        self.expectations.iter().enumerate().map(frame).collect()
    }

    /// Errors of z of the dots with r ≥ 2 that are wholly on the sensor, mm, and the deviations that noise and
    /// calibration give them, as an instrument reads the frames; and how many such dots there are.
    pub fn depth_errors(&self, instrument: &Instrument, noise_seed: u64) -> (Vec<DepthError>, usize) {
        const R_MM_MIN: f64 = 2.0;
        let options = Options { mode: Mode::Model, ..Options::default() };
        let reader = reader(instrument, options);
        let mut errors = Vec::new();
        let mut dots = 0;
        for (scene, frame) in self.scenes.iter().zip(self.frames(noise_seed)) {
            let points = reader.reconstruct(&frame).expect("a frame of this camera").points;
            let is_whole = |dot: &&Dot| {
                let r_mm = dot.centre_mm[0].hypot(dot.centre_mm[1]);
                r_mm >= R_MM_MIN && self.camera.sees_whole(dot.centre_mm, dot.diameter_mm)
            };
            for dot in scene.dots().iter().filter(is_whole) {
                dots += 1;
                let Some(point) = nearest(&points, dot.centre_mm) else { continue };
                let covariance_mm2 = reader.calibration_covariance_mm2(point.position_mm);
                errors.push(DepthError {
                    z_mm: point.position_mm[2] - dot.centre_mm[2],
                    noise_std_mm: point.std_mm[2],
                    calibration_std_mm: covariance_mm2.map_or(0.0, |covariance| covariance[2][2].sqrt()),
                });
            }
        }
        (errors, dots)
    }
}

/// Error of one dot's depth, and what it should be about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthError {
    /// Found less true, mm.
    pub z_mm: f64,
    /// Deviation from noise, mm.
    pub noise_std_mm: f64,
    /// Deviation from the calibration, mm.
    pub calibration_std_mm: f64,
}

impl DepthError {
    /// Root mean square of some.
    pub fn rms_mm(errors: &[Self]) -> f64 {
        (errors.iter().map(|error| error.z_mm.powi(2)).sum::<f64>() / errors.len().max(1) as f64).sqrt()
    }

    /// The largest of some.
    pub fn max_mm(errors: &[Self]) -> f64 {
        errors.iter().map(|error| error.z_mm.abs()).fold(0.0, f64::max)
    }
}

/// The calibrated instrument with the deviations of its numbers, as `twinpupil calibrate` writes it.
///
/// # Panics
/// If the calibration contradicts itself.
pub fn calibrated(calibration: &Calibration) -> Instrument {
    let mut spec = calibration.instrument.clone().into_spec();
    spec.calibration = Some(calibration.to_spec("2026-01-01".to_owned(), "simulated".to_owned(), Vec::new()));
    Instrument::new(spec).expect("a calibration of its own instrument")
}

/// Makes an instrument ready to read frames.
///
/// # Panics
/// If the instrument cannot be traced.
pub fn reader(instrument: &Instrument, options: Options) -> Reconstructor {
    // An ideal lens adds nothing to first order.
    let is_ideal = matches!(instrument.lens, Lens::Thin(_));
    let table = (!is_ideal).then(|| response_table_for(instrument).expect("the instrument can be traced"));
    Reconstructor::new(instrument.clone(), table, options)
}

/// Calibrates an instrument from frames.
pub fn calibrate(
    data_sheet: &Instrument,
    target: &Target,
    frames: &[Frame],
    choices: &Choices,
) -> Result<Calibration, CalibrateError> {
    calibrate_on_stage(data_sheet, target, frames, &[], choices)
}

/// Calibrates an instrument from frames of a target that a stage carries.
pub fn calibrate_on_stage(
    data_sheet: &Instrument,
    target: &Target,
    frames: &[Frame],
    stage: &[Option<StagePosition>],
    choices: &Choices,
) -> Result<Calibration, CalibrateError> {
    let calibrator = Calibrator {
        instrument: data_sheet,
        target,
        choices,
        place_std_mm: None,
        stage,
        reader: &|instrument, mode| Ok(reader(instrument, Options { mode, ..Options::default() })),
        frame: &|frame| Ok(Cow::Borrowed(&frames[frame])),
        progress: &|_| {},
    };
    calibrator.calibrate(frames.len())
}

/// The axis of an instrument from frames of any dots.
pub fn axis(instrument: &Instrument, frames: &[Frame]) -> Result<AxisEstimate, AxisError> {
    AxisFinder { instrument, reader: &|instrument| Ok(reader(instrument, Options::default())), frames }.find()
}
