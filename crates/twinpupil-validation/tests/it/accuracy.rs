//! The default mode against the truth of simulated frames.

use twinpupil_instrument::{Instrument, paper};
use twinpupil_reconstruct::Mode;
use twinpupil_validation::plates::{POSES, Pose, Score};
use twinpupil_validation::rig::Rig;
use twinpupil_validation::rings::{OUTER_PLACES, PAPER_PLACES, depths};

/// What codes of 12 bits, 256 rays and a lattice of every other pixel leave at r ≥ 3 without noise.
const NOISELESS_MM: f64 = 0.005;

fn rig(mode: Mode) -> Rig {
    Rig::new(paper::instrument(), mode)
}

#[test]
fn isolated_dots_without_noise_are_within_5_um() {
    let rig = rig(Mode::Centroid);
    for z_mm in (250..=350).step_by(10).map(f64::from) {
        for depth in depths(&rig, &OUTER_PLACES, z_mm) {
            let error_mm = depth.found_mm.expect("every dot is found") - z_mm;
            assert!(error_mm.abs() < NOISELESS_MM, "r = {}, z = {z_mm}: {error_mm}", depth.r_mm);
        }
    }
}

#[test]
fn clipped_dots_are_right_too_where_the_papers_equations_are_not() {
    let rig = rig(Mode::Centroid);
    for z_mm in [250.0, 300.0, 350.0] {
        for depth in depths(&rig, &PAPER_PLACES, z_mm) {
            let error_mm = depth.found_mm.expect("every dot is found") - z_mm;
            assert!(error_mm.abs() < 0.1, "r = {}, z = {z_mm}: {error_mm}", depth.r_mm);
        }
    }
}

#[test]
fn plates_are_found_whole_and_measured_to_10_um() {
    let rig = rig(Mode::Centroid);
    for pose in POSES {
        // Seeds apart from those that the program was tuned on.
        let score = Score::of(&rig, pose, 77);
        assert!(score.recall() >= 0.95, "{pose:?}: {} of {}", score.found, score.whole);
        assert_eq!(score.false_points, 0, "{pose:?}");
        assert!(score.isolated_rms_mm() <= 0.010, "{pose:?}: {}", score.isolated_rms_mm());
        assert!(score.tilt_error_deg_max() <= 0.1, "{pose:?}: {}", score.tilt_error_deg_max());
        assert!(score.r_squared_min() >= 0.99, "{pose:?}: {}", score.r_squared_min());
    }
}

#[test]
fn a_lens_with_dispersion_is_read_as_well_as_an_ideal_one() {
    let text = paper::INSTRUMENT_TOML.replace("# focal_length_mm_by_band", "focal_length_mm_by_band");
    let rig = Rig::new(Instrument::from_toml(&text).expect("legal"), Mode::Centroid);
    let score = Score::of(&rig, Pose::Facing(320.0), 5);
    assert!(score.recall() >= 0.95 && score.false_points == 0);
    assert!(score.isolated_rms_mm() <= 0.010, "{}", score.isolated_rms_mm());
}

#[test]
fn an_rgb_sensor_is_read_better_than_a_mosaic() {
    let text = paper::INSTRUMENT_TOML.replace("mosaic = \"rggb\"", "mosaic = \"rgb\"");
    let rgb = Rig::new(Instrument::from_toml(&text).expect("legal"), Mode::Centroid);
    let score = Score::of(&rgb, Pose::Facing(325.0), 3);
    let mosaic = Score::of(&rig(Mode::Centroid), Pose::Facing(325.0), 3);
    assert!(score.recall() >= 0.95 && score.false_points == 0);
    assert!(score.isolated_rms_mm() < mosaic.isolated_rms_mm());
}
