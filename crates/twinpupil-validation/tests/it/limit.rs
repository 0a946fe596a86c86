//! The noise limit: errors of the default mode beside the Cramér–Rao bound of the very frames.

use twinpupil_validation::limit::{Camera, Score, model_rig, plate};
use twinpupil_validation::plates::Pose;

/// Error over bound, root mean square of all dots from r = 2 on, that touching skirts and hidden tilts may cost.
const ERROR_OVER_BOUND_MAX: f64 = 1.3;

/// Error over reported deviation. One plate has some fifty dots, so that its root mean square scatters by a tenth.
const ERROR_OVER_STD: std::ops::Range<f64> = 0.8..1.25;

/// Worst tilt of a plate, degrees, and least R².
const TILT_DEG_MAX: f64 = 0.01;
const R_SQUARED_MIN: f64 = 0.99999;

fn holds(camera: Camera, pose: Pose, brightness_e: f64, seed: u64) {
    let score = Score::of(&model_rig(camera), &plate(pose, brightness_e, seed), seed + 5000);
    let label = format!("{camera:?} {pose:?} {brightness_e} e⁻, seed {seed}");
    assert!(score.recall() >= 0.98, "{label}: {} of {}", score.found.len(), score.whole);
    assert_eq!(score.false_points, 0, "{label}");
    assert!(score.error_over_bound() <= ERROR_OVER_BOUND_MAX, "{label}: {} over the bound", score.error_over_bound());
    assert!(ERROR_OVER_STD.contains(&score.error_over_std()), "{label}: {} deviations", score.error_over_std());
    for [tilt_deg, r_squared] in &score.tilts {
        assert!(tilt_deg.abs() < TILT_DEG_MAX && *r_squared > R_SQUARED_MIN, "{label}: {tilt_deg}° {r_squared}");
    }
}

#[test]
fn every_pixel_of_both_bands_is_used() {
    holds(Camera::Rgb, Pose::Facing(300.0), 20_000.0, 11);
}

#[test]
fn a_mosaic_reaches_its_own_bound() {
    holds(Camera::Rggb, Pose::Facing(250.0), 20_000.0, 12);
    holds(Camera::Rggb, Pose::Facing(325.0), 20_000.0, 13);
}

#[test]
fn tilted_plates_reach_it_too() {
    holds(Camera::Rggb, Pose::Tilted(30.0), 20_000.0, 14);
    holds(Camera::Rggb, Pose::Tilted(45.0), 20_000.0, 15);
}

#[test]
fn dispersion_is_part_of_the_model() {
    holds(Camera::Dispersive, Pose::Facing(275.0), 20_000.0, 16);
}

#[test]
fn a_stop_that_cuts_pencils_is_part_of_it_as_well() {
    holds(Camera::Vignetted, Pose::Facing(275.0), 20_000.0, 17);
    holds(Camera::Vignetted, Pose::Facing(325.0), 20_000.0, 18);
}
