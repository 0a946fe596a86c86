//! Where depth is judged, and the target that cameras are calibrated with.

use nalgebra::{Rotation3, Vector3};
use twinpupil_calibrate::Pose;
use twinpupil_instrument::Instrument;
use twinpupil_optics::{BandOptics, Camera};

use crate::design::sweep::seen_radius_mm;

/// Distances at which depth is judged, radii at each, and directions at each of those.
const DEPTHS: usize = 5;
const RADII: usize = 4;
const DIRECTIONS: usize = 3;

/// The nearest radius: so many clipping radii, for what decentred elements do to light that masks cut is not traced; where
/// they cut it everywhere, so many blind radii. This share of what is seen at least.
const CLIPPING_RADII: f64 = 1.25;
const BLIND_RADII: f64 = 1.5;
const INNER: f64 = 0.2;

/// The farthest radius: this share of what is seen all round.
const OUTER: f64 = 0.95;

/// Rows and columns of the target, and how much of what is seen all round its corners fill.
const GRID: [usize; 2] = [4, 5];
const FILLED: f64 = 0.95;

/// Poses of the target: share of the way through the depth range, tilts about x and y, turn, degrees.
const POSES: [[f64; 4]; 7] = [
    [0.06, 0.0, 4.0, 3.0],
    [0.2, 25.0, 0.0, -4.0],
    [0.35, 0.0, -28.0, 8.0],
    [0.5, 0.0, 28.0, 0.0],
    [0.65, -26.0, 0.0, -10.0],
    [0.8, 20.0, 0.0, 5.0],
    [0.94, 0.0, -12.0, 2.0],
];

/// Where depth is judged and what the camera is calibrated with.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    /// Points, mm.
    pub places_mm: Vec<[f64; 3]>,
    /// Dots of the target, on it, mm.
    pub dots_mm: Vec<[f64; 2]>,
    /// Poses of the target.
    pub poses: Vec<Pose>,
    /// Pose and dot of those whose light the masks leave whole; of all, if they leave next to none.
    pub whole: Vec<(usize, usize)>,
}

impl Volume {
    /// What an instrument is for: from where masks cut no light to the radius that it sees all round, over its depth range.
    pub fn of(instrument: &Instrument, camera: &Camera) -> Self {
        let range = instrument.depth_range();
        let depth_mm = |share: f64| range.near_mm + share * (range.far_mm - range.near_mm);
        let depths = (0..DEPTHS).map(|k| depth_mm(k as f64 / (DEPTHS - 1) as f64));
        let dots_mm = grid_mm(FILLED * seen_radius_mm(instrument, depth_mm(0.5)));
        let poses: Vec<Pose> = POSES.map(|[share, a, b, turn]| pose(depth_mm(share), [a, b], turn)).into();
        Self {
            places_mm: depths.enumerate().flat_map(|(k, z_mm)| ring(instrument, camera, k, z_mm)).collect(),
            whole: whole(camera, &dots_mm, &poses),
            dots_mm,
            poses,
        }
    }
}

/// Pose and dot of those that no mask comes near: parts that are off may cut them.
fn whole(camera: &Camera, dots_mm: &[[f64; 2]], poses: &[Pose]) -> Vec<(usize, usize)> {
    let all: Vec<(usize, usize)> =
        (0..poses.len()).flat_map(|pose| (0..dots_mm.len()).map(move |dot| (pose, dot))).collect();
    let is_whole = |&(pose, dot): &(usize, usize)| {
        let [x, y, z]: [f64; 3] = poses[pose].at(dots_mm[dot]).into();
        x.hypot(y) > CLIPPING_RADII * largest(camera, |band| band.clip_radius_mm(z))
    };
    let whole: Vec<(usize, usize)> = all.iter().copied().filter(is_whole).collect();
    if 2 * whole.len() > all.len() { whole } else { all }
}

/// Points at one distance, which is number k: no two in one direction.
fn ring(instrument: &Instrument, camera: &Camera, k: usize, z_mm: f64) -> impl Iterator<Item = [f64; 3]> + use<> {
    let golden_angle = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let reach_mm = seen_radius_mm(instrument, z_mm);
    let clear_mm = CLIPPING_RADII * largest(camera, |band| band.clip_radius_mm(z_mm));
    let seeing_mm = BLIND_RADII * largest(camera, |band| band.blind_radius_mm(z_mm));
    let outer_mm = OUTER * reach_mm;
    let inner_mm = if clear_mm < outer_mm { clear_mm } else { seeing_mm.min(outer_mm) };
    let inner_mm = inner_mm.max(INNER * reach_mm);
    (0..RADII * DIRECTIONS).map(move |n| {
        let r_mm = inner_mm + (outer_mm - inner_mm) * (n % RADII) as f64 / (RADII - 1) as f64;
        let (sin, cos) = (golden_angle * (n + k * RADII * DIRECTIONS) as f64).sin_cos();
        [r_mm * cos, r_mm * sin, z_mm]
    })
}

/// The largest radius of all bands, mm.
fn largest(camera: &Camera, radius_mm: impl Fn(&BandOptics) -> f64) -> f64 {
    camera.bands().iter().map(radius_mm).fold(0.0, f64::max)
}

/// A grid whose corners are so far from its middle.
fn grid_mm(corner_mm: f64) -> Vec<[f64; 2]> {
    let [half_rows, half_columns] = GRID.map(|count| 0.5 * (count - 1) as f64);
    let pitch_mm = corner_mm / half_rows.hypot(half_columns);
    let place = |n: usize| [(n % GRID[1]) as f64 - half_columns, (n / GRID[1]) as f64 - half_rows];
    (0..GRID[0] * GRID[1]).map(|n| place(n).map(|steps| steps * pitch_mm)).collect()
}

fn pose(z_mm: f64, tilts_deg: [f64; 2], turn_deg: f64) -> Pose {
    let [a, b] = tilts_deg.map(f64::to_radians);
    let tilt = Rotation3::new(Vector3::new(a, b, 0.0));
    Pose {
        rotation: tilt * Rotation3::new(Vector3::z() * turn_deg.to_radians()),
        translation_mm: Vector3::new(0.0, 0.0, z_mm),
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;

    #[test]
    fn the_paper_is_judged_where_it_sees_and_its_target_fills_the_view() {
        let instrument = paper::instrument();
        let volume = Volume::of(&instrument, &Camera::new(&instrument).unwrap());
        assert_eq!((volume.places_mm.len(), volume.dots_mm.len(), volume.poses.len()), (60, 20, 7));
        assert!(volume.whole.len() > 80 && volume.whole.len() < 7 * 20, "{}", volume.whole.len());
        let radii = volume.places_mm.iter().map(|[x, y, _]| x.hypot(*y));
        assert!(radii.clone().fold(f64::INFINITY, f64::min) > 1.0 && radii.fold(0.0, f64::max) < 8.6);
        assert_eq!((volume.places_mm[0][2], volume.places_mm[59][2]), (235.0, 370.0));
    }
}
