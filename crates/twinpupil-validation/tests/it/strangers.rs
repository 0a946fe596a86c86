//! Cameras and plates that were drawn by chance are read like the paper's: all dots, no others, and errors as reported.

use twinpupil_validation::strangers::Stranger;

/// About three deviations of the mean square over forty dots.
const PULL_MAX: f64 = 1.35;

fn check(number: u64) {
    let score = Stranger::of(number).score();
    assert!(score.whole > 20, "{number}: {} dots", score.whole);
    assert!(score.missing_mm.is_empty(), "{number}: missing {:?}", score.missing_mm);
    assert_eq!(score.false_points, 0, "{number}");
    assert!(score.error_over_std() < PULL_MAX, "{number}: error over σ {:.2}", score.error_over_std());
}

#[test]
fn a_tilted_plate_with_dots_that_hide_each_others_edges() {
    // Two of its dots are found only once the fit has told their light from that of their neighbours.
    check(3);
}

#[test]
fn a_small_sensor_in_little_light() {
    check(10);
}

#[test]
fn a_mosaic_that_begins_with_blue() {
    check(6);
}
