//! Depth from every way in which planes reach a file: the instruments that ship, each before the paper's plate.
//!
//! The bound on the error is that of the paper's mosaic ([`accuracy`](super::accuracy)): 10 µm rms of z over isolated
//! dots with r ≥ 3. No carrier has fewer pixels a band than the mosaic, so none may be worse.

use twinpupil_instrument::{Instrument, builtin};
use twinpupil_reconstruct::Mode;
use twinpupil_validation::plates::{Pose, Score};
use twinpupil_validation::rig::{Rig, nearest};

const ISOLATED_RMS_MM: f64 = 0.010;

fn instrument(name: &str) -> Instrument {
    Instrument::from_toml(builtin::toml(name).expect("a shipped instrument")).expect("legal")
}

fn recovers_depth(rig: &Rig, rms_mm: f64) -> Score {
    let mut all = Score::default();
    for pose in [Pose::Facing(260.0), Pose::Facing(325.0), Pose::Tilted(30.0)] {
        let score = Score::of(rig, pose, 77);
        assert!(score.recall() >= 0.95, "{pose:?}: {} of {}", score.found, score.whole);
        assert_eq!(score.false_points, 0, "{pose:?}");
        assert!(score.isolated_rms_mm() <= rms_mm, "{pose:?}: {}", score.isolated_rms_mm());
        assert!(score.tilt_error_deg_max() <= 0.1, "{pose:?}: {}", score.tilt_error_deg_max());
        all.merge(score);
    }
    all
}

#[test]
fn a_polarizer_mosaic_tells_depth_through_its_crosstalk() {
    recovers_depth(&Rig::new(instrument("polarizer"), Mode::Centroid), ISOLATED_RMS_MM);
}

#[test]
fn two_sensors_tell_depth_through_their_registration() {
    recovers_depth(&Rig::new(instrument("two-sensors"), Mode::Centroid), ISOLATED_RMS_MM);
}

#[test]
fn a_hyperspectral_cube_tells_depth() {
    recovers_depth(&Rig::new(instrument("hyperspectral"), Mode::Centroid), ISOLATED_RMS_MM);
}

#[test]
fn three_bands_tell_depth_through_their_crosstalk() {
    recovers_depth(&Rig::new(instrument("three-bands"), Mode::Centroid), ISOLATED_RMS_MM);
}

#[test]
fn a_third_band_is_matched_counted_and_no_worse_than_the_pair() {
    let rig = Rig::new(instrument("hyperspectral"), Mode::Centroid);
    let frame = rig.frame(&Pose::Facing(270.0).scene(5), Some(6));
    let reconstruction = rig.read(&frame);
    let green = 2;
    assert_eq!(rig.instrument.bands[green].name, "green");
    assert!(reconstruction.further.iter().all(|image| image.band == green));
    // Only what its own plane's border cuts may lack its third image.
    assert!(reconstruction.further.len() * 10 >= reconstruction.points.len() * 9, "{:?}", reconstruction.further.len());
    let with_three = reconstruction.points.iter().filter(|point| point.match_dof == 3).count();
    assert_eq!(with_three, reconstruction.further.len());
    let found = rig.detected(&frame, green);
    let rejected = reconstruction.rejected.iter().filter(|rejection| rejection.band == "green").count();
    assert_eq!(found, reconstruction.further.len() + rejected);

    // The pair alone, from the same frame: the deviations that are reported grow.
    let mut spec = rig.instrument.clone().into_spec();
    spec.bands.truncate(2);
    for aperture in &mut spec.apertures {
        aperture.zones.iter_mut().for_each(|zone| zone.pass.retain(|band| band != "green"));
    }
    let pair = Rig::new(Instrument::new(spec).expect("the pair is legal"), Mode::Centroid);
    let of_pair = pair.points(&frame);
    for image in &reconstruction.further {
        let point = &reconstruction.points[image.point];
        let alone = nearest(&of_pair, point.position_mm).expect("the pair sees it too");
        assert!(point.std_mm[2] < alone.std_mm[2], "{} {}", point.std_mm[2], alone.std_mm[2]);
    }
}

#[test]
fn model_mode_reads_every_carrier() {
    for name in ["polarizer", "hyperspectral", "three-bands", "two-sensors"] {
        let rig = Rig::new(instrument(name), Mode::Model);
        let score = Score::of(&rig, Pose::Facing(325.0), 77);
        assert!(score.recall() >= 0.95 && score.false_points == 0, "{name}: {score:?}");
        assert!(score.isolated_rms_mm() <= ISOLATED_RMS_MM, "{name}: {}", score.isolated_rms_mm());
    }
}
