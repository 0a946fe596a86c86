//! Printed disks through a real lens, centres found by other people's program (bllanos/chromatic-aberration).
//!
//! The data are not part of this repository. `TWINPUPIL_REAL_DISKS` names their folder; without it the test passes
//! without looking.

use std::fs::File;
use std::path::{Path, PathBuf};

use tiff::decoder::{Decoder, DecodingResult};
use twinpupil_instrument::{Frame, Mosaic};
use twinpupil_reconstruct::{DetectOptions, Feature, RejectionReason, detect};

/// Largest mean distance from the third-party centres and largest deviation about it, per axis, px.
const TOLERANCE_PX: f64 = 0.06;

#[test]
fn every_listed_disk_is_found_where_another_program_found_it() {
    let Some(folder) = std::env::var_os("TWINPUPIL_REAL_DISKS").map(PathBuf::from) else { return };
    let frame = read(&folder.join("disks_two_colour.tiff"));
    let centres = centres(&folder.join("centres.csv"));
    for (plane, column) in [("b", 1), ("r", 3)] {
        let view = frame.plane(Mosaic::Gbrg, plane).expect("a Bayer frame");
        let found = detect(&view, None, &DetectOptions::default());
        assert_eq!(found.features.len(), centres.len(), "as many features as disks");
        assert!(found.rejected.iter().all(|rejected| rejected.reason == RejectionReason::CutByBorder));
        let offsets: Vec<[f64; 2]> =
            centres.iter().map(|row| offset(&found.features, row[column], row[column + 1])).collect();
        for axis in 0..2 {
            let count = offsets.len() as f64;
            let mean = offsets.iter().map(|offset| offset[axis]).sum::<f64>() / count;
            let variance = offsets.iter().map(|offset| (offset[axis] - mean).powi(2)).sum::<f64>() / count;
            assert!(mean.abs() <= TOLERANCE_PX, "plane {plane}, axis {axis}: mean {mean}");
            assert!(variance.sqrt() <= TOLERANCE_PX, "plane {plane}, axis {axis}: rms {}", variance.sqrt());
        }
    }
}

/// From a listed centre to the nearest feature, which must be within 1 px.
fn offset(features: &[Feature], u: f64, v: f64) -> [f64; 2] {
    let offset = |feature: &Feature| [feature.centre.u - u, feature.centre.v - v];
    features
        .iter()
        .map(offset)
        .find(|[du, dv]| du.hypot(*dv) < 1.0)
        .unwrap_or_else(|| panic!("no feature near ({u}, {v})"))
}

fn read(path: &Path) -> Frame {
    let mut decoder = Decoder::new(File::open(path).expect("the frame is there")).expect("a TIFF");
    let (width, height) = decoder.dimensions().expect("a size");
    let DecodingResult::U16(codes) = decoder.read_image().expect("pixels") else { panic!("16 bits are expected") };
    Frame::new(width as usize, height as usize, u16::MAX, vec![codes]).expect("a frame")
}

fn centres(path: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).expect("the centres are there");
    let number = |cell: &str| cell.parse().expect("a number");
    text.lines().skip(1).map(|line| line.split(',').map(number).collect()).collect()
}
