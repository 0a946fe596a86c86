//! Cameras as they are built: sensors that are turned, mirrored and tilted, lenses with distortion, masks off the axis.
//!
//! The simulator starts every ray on the sensor's surface in space; the reconstruction goes through one map of a page.
//! Both share the numbers of the instrument file alone, so errors at the Cramér–Rao bound tell that both do what it says.

use twinpupil_instrument::{Distortion, Instrument, Mosaic, Registration, paper};
use twinpupil_reconstruct::Mode;
use twinpupil_validation::limit::{Camera, Score, model_rig, plate};
use twinpupil_validation::plates::{self, Pose};
use twinpupil_validation::rig::{Rig, dots, nearest};

/// As on a camera that is not askew (`limit.rs`).
const ERROR_OVER_BOUND_MAX: f64 = 1.3;
const ERROR_OVER_STD: std::ops::Range<f64> = 0.8..1.25;

/// Mean of error over bound: noise alone makes 0.15 of fifty dots, and three times that is rare.
const BIAS_MAX: f64 = 0.45;

/// Centroid mode, rms of z of dots with r ≥ 3 whose images touch no other (`accuracy.rs`).
const ISOLATED_RMS_MM: f64 = 0.010;

fn reaches_the_bound(camera: Camera, pose: Pose, seed: u64) {
    let score = Score::of(&model_rig(camera), &plate(pose, 20_000.0, seed), seed + 5000);
    let label = format!("{camera:?} {pose:?}, seed {seed}");
    assert!(score.recall() >= 0.98, "{label}: {} of {}", score.found.len(), score.whole);
    assert_eq!(score.false_points, 0, "{label}");
    assert!(score.error_over_bound() <= ERROR_OVER_BOUND_MAX, "{label}: {} over the bound", score.error_over_bound());
    assert!(ERROR_OVER_STD.contains(&score.error_over_std()), "{label}: {} deviations", score.error_over_std());
    let sum: f64 = score.found.iter().map(|error| error.error_mm / error.bound_mm).sum();
    let bias = sum / score.found.len() as f64;
    assert!(bias.abs() < BIAS_MAX, "{label}: {bias}");
}

#[test]
fn a_mirrored_turned_and_larger_page_is_read_to_the_bound() {
    reaches_the_bound(Camera::Mirrored, Pose::Facing(270.0), 21);
    reaches_the_bound(Camera::Mirrored, Pose::Tilted(45.0), 22);
}

#[test]
fn a_tilted_mosaic_behind_a_distorting_lens_is_read_to_the_bound() {
    reaches_the_bound(Camera::Crooked, Pose::Facing(325.0), 23);
    reaches_the_bound(Camera::Crooked, Pose::Tilted(30.0), 24);
}

#[test]
fn with_every_pixel_for_both_bands_too() {
    reaches_the_bound(Camera::CrookedRgb, Pose::Facing(260.0), 25);
}

#[test]
fn masks_off_the_axis_are_part_of_the_model() {
    reaches_the_bound(Camera::Decentred, Pose::Facing(265.0), 26);
    reaches_the_bound(Camera::Decentred, Pose::Facing(340.0), 27);
}

/// Far more askew than any camera is built, all at once, noiseless: depth still comes out.
#[test]
fn all_of_it_at_once_is_read_in_model_mode() {
    const ERROR_MM_MAX: f64 = 0.02;
    let mut spec = Camera::Mirrored.instrument().into_spec();
    spec.sensor.tilt_deg = [-3.0, 2.0];
    spec.sensor.black_level = 200;
    spec.bands[0].distortion = Distortion { k1_per_mm2: -4e-4, p2_per_mm: 1e-4, ..Distortion::default() };
    spec.bands[1].distortion = Distortion { k1_per_mm2: 5e-4, k2_per_mm4: -2e-6, p1_per_mm: -1e-4, p2_per_mm: 0.0 };
    spec.apertures[0].centre_mm = [0.05, 0.1];
    // As far as a quarter turn.
    spec.bands[0].registration = Registration::from_rows([[0.0, -1.1, 1620.0], [1.1, 0.0, -450.0], [2e-6, -3e-6, 1.0]]);
    let rig = Rig::new(Instrument::new(spec).expect("legal"), Mode::Model);
    for z_mm in [265.0, 300.0, 330.0] {
        let centres_mm = [
            [3.1, 0.4, z_mm],
            [2.2, 2.4, z_mm],
            [-2.9, 1.0, z_mm],
            [-1.0, -3.0, z_mm],
            [1.2, -2.9, z_mm],
            [4.5, 2.0, z_mm],
        ];
        let points = rig.points(&rig.frame(&dots(&centres_mm), None));
        let whole = centres_mm.iter().filter(|centre_mm| rig.sees_whole(**centre_mm, 1.0));
        for centre_mm in whole {
            let point = nearest(&points, *centre_mm).unwrap_or_else(|| panic!("{centre_mm:?} is not found"));
            let error_mm = point.position_mm[2] - centre_mm[2];
            assert!(error_mm.abs() < ERROR_MM_MAX, "{centre_mm:?}: {error_mm}");
        }
    }
}

/// Blur grows along a tilted sensor: without that dots would lie 7e-5 mm beside themselves on the average, the one way before
/// the focus and the other behind it.
#[test]
fn a_blur_that_grows_along_the_sensor_moves_no_dot() {
    const MEAN_MM_MAX: f64 = 1.5e-5;
    let mut spec = paper::instrument().into_spec();
    spec.sensor.tilt_deg = [2.0, 0.0];
    spec.sensor.mosaic = Mosaic::Rgb;
    spec.sensor.black_level = 200;
    let rig = Rig::new(Instrument::new(spec).expect("legal"), Mode::Model);
    for z_mm in [262.0, 338.0] {
        let at = |k: usize| {
            let (sin, cos) = (0.2 + 0.1 * k as f64 * std::f64::consts::TAU).sin_cos();
            [4.2 * cos, 4.2 * sin, z_mm]
        };
        let centres_mm: Vec<[f64; 3]> = (0..10).map(at).collect();
        let points = rig.points(&rig.frame(&dots(&centres_mm), None));
        let off_mm =
            centres_mm.iter().filter_map(|centre_mm| Some(nearest(&points, *centre_mm)?.position_mm[0] - centre_mm[0]));
        let off_mm: Vec<f64> = off_mm.collect();
        let mean_mm = off_mm.iter().sum::<f64>() / off_mm.len() as f64;
        assert!(off_mm.len() >= 6 && mean_mm.abs() < MEAN_MM_MAX, "{z_mm}: {mean_mm} of {}", off_mm.len());
    }
}

#[test]
fn centroid_mode_goes_through_the_same_map() {
    for (camera, seed) in [(Camera::Mirrored, 31), (Camera::Crooked, 32)] {
        let rig = Rig::new(camera.instrument(), Mode::Centroid);
        for pose in [Pose::Facing(325.0), Pose::Tilted(30.0)] {
            let score = plates::Score::of(&rig, pose, seed);
            assert!(score.recall() >= 0.95 && score.false_points == 0, "{camera:?} {pose:?}: {score:?}");
            let rms_mm = score.isolated_rms_mm();
            assert!(rms_mm <= ISOLATED_RMS_MM, "{camera:?} {pose:?}: {rms_mm}");
        }
    }
}

/// What the map is good for: without it the same frames are read far off.
#[test]
fn who_leaves_tilt_or_distortion_out_is_far_off() {
    const ERROR_MM_MIN: f64 = 0.1;
    let crooked = Camera::CrookedRgb.instrument();
    let centres_mm = [[5.4, 1.0, 280.0], [-5.2, 2.0, 280.0], [0.5, 3.6, 280.0], [-3.0, -3.4, 280.0]];
    let frame = Rig::new(crooked.clone(), Mode::Centroid).frame(&dots(&centres_mm), None);
    let worst_mm = |change: &dyn Fn(&mut twinpupil_instrument::InstrumentSpec)| {
        let mut spec = crooked.clone().into_spec();
        change(&mut spec);
        let points = Rig::new(Instrument::new(spec).expect("legal"), Mode::Model).points(&frame);
        let error_mm = |centre_mm: &[f64; 3]| {
            nearest(&points, *centre_mm).map_or(f64::INFINITY, |point| (point.position_mm[2] - centre_mm[2]).abs())
        };
        centres_mm.iter().map(error_mm).fold(0.0, f64::max)
    };
    assert!(worst_mm(&|_| {}) < 0.02);
    assert!(worst_mm(&|spec| spec.sensor.tilt_deg = [0.0; 2]) > ERROR_MM_MIN);
    assert!(worst_mm(&|spec| spec.bands[0].distortion = Distortion::default()) > ERROR_MM_MIN);
    assert_eq!(crooked.sensor.mosaic, Mosaic::Rgb);
}
