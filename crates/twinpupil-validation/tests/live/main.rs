//! Live use: frames read from a camera's buffer. A test of its own, because the allocator of the whole program counts.

use std::num::NonZeroUsize;

use allocation_counter::measure;
use twinpupil_instrument::paper;
use twinpupil_optics::response_table_for;
use twinpupil_reconstruct::{Mode, Options, Point, ReconstructError, Reconstructor};
use twinpupil_validation::plates::Pose;
use twinpupil_validation::rig::Rig;

fn reader(mode: Mode) -> Reconstructor {
    let instrument = paper::instrument();
    let table = response_table_for(&instrument).expect("the paper's camera can be traced");
    Reconstructor::new(instrument, Some(table), Options { mode, ..Options::default() })
}

#[test]
fn a_warm_reader_allocates_nothing() {
    // Touching skirts, tilted dots, dots that the border cuts.
    let rig = Rig::new(paper::instrument(), Mode::Model);
    let frames = [Pose::Facing(265.0), Pose::Tilted(45.0)].map(|pose| rig.frame(&pose.scene(3), Some(4)));
    for mode in [Mode::Model, Mode::Centroid] {
        let mut reader = reader(mode);
        for frame in frames.iter().chain(&frames) {
            reader.frame(&frame.pages()[0]).expect("a frame of this camera");
        }
        for frame in &frames {
            let mut points = 0;
            let counted = measure(|| points = reader.frame(&frame.pages()[0]).map_or(0, <[Point]>::len));
            assert!(points > 40, "{mode:?}: {points} points");
            assert_eq!(counted.count_total, 0, "{mode:?}: {counted:?}");
        }
    }
}

#[test]
fn the_points_are_those_of_the_frame_read_by_itself() {
    let rig = Rig::new(paper::instrument(), Mode::Model);
    let mut reader = reader(Mode::Model);
    for (pose, seed) in [(Pose::Facing(300.0), 1), (Pose::Tilted(30.0), 2)] {
        let frame = rig.frame(&pose.scene(seed), Some(seed));
        let points = reader.frame(&frame.pages()[0]).expect("a frame of this camera");
        assert_eq!(points, rig.read(&frame).points, "{pose:?}");
    }
}

#[test]
fn the_points_do_not_depend_on_how_many_threads_share_a_frame() {
    let rig = Rig::new(paper::instrument(), Mode::Model);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("three threads");
    for (pose, threads) in [(Pose::Facing(265.0), 2), (Pose::Tilted(45.0), 3)] {
        let frame = rig.frame(&pose.scene(5), Some(6));
        let instrument = paper::instrument();
        let table = response_table_for(&instrument).ok();
        let options = Options { threads: NonZeroUsize::new(threads), ..Options::default() };
        let mut reader = Reconstructor::new(instrument, table, options);
        for _ in 0..2 {
            let points = pool.install(|| reader.frame(&frame.pages()[0]).map(<[Point]>::to_vec));
            assert_eq!(points.expect("a frame of this camera"), rig.read(&frame).points, "{pose:?}");
        }
    }
}

#[test]
fn codes_of_another_sensor_are_refused() {
    let mut reader = reader(Mode::Model);
    assert!(matches!(reader.frame(&[0; 1000]), Err(ReconstructError::Frame(_))));
    assert!(matches!(reader.frame(&[]), Err(ReconstructError::Frame(_))));
}
