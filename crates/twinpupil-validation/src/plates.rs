//! The paper's random plate, with noise: what is found, what is not, and how well.

use twinpupil_reconstruct::{FitPoint, LineAxis, LineFit, Point, fit_line};
use twinpupil_simulate::{Scene, paper};

use crate::rig::{Rig, nearest};

/// A pose of the plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pose {
    /// Facing the camera at a distance in mm.
    Facing(f64),
    /// At 300 mm, tilted by degrees so that z grows with x.
    Tilted(f64),
}

/// The poses of the paper's Figs. 10 and 11.
pub const POSES: [Pose; 8] = [
    Pose::Facing(250.0),
    Pose::Facing(275.0),
    Pose::Facing(300.0),
    Pose::Facing(325.0),
    Pose::Facing(350.0),
    Pose::Tilted(30.0),
    Pose::Tilted(45.0),
    Pose::Tilted(60.0),
];

impl Pose {
    /// The plate in this pose.
    ///
    /// # Panics
    /// If the pose is not legal.
    pub fn scene(self, seed: u64) -> Scene {
        match self {
            Self::Facing(z_mm) => paper::random_plate(z_mm, seed),
            Self::Tilted(tilt_deg) => paper::tilted_plate(tilt_deg, seed),
        }
        .expect("a legal pose")
    }
}

/// Points farther from every dot than this, across the axis in mm or in depth in mm, are false.
pub(crate) const FALSE_MM: [f64; 2] = [0.3, 5.0];

/// Dots nearer to the axis than this are clipped by both masks, mm.
const UNCLIPPED_RADIUS_MM: f64 = 3.0;

/// How the dots of one or more plates were found.
#[derive(Debug, Clone, Default)]
pub struct Score {
    /// Dots wholly on the sensor.
    pub whole: usize,
    /// Those of them that were found.
    pub found: usize,
    /// Points that belong to no dot.
    pub false_points: usize,
    /// Errors of z of found dots with r ≥ 3 whose images touch no other, mm, with the deviation that was reported.
    pub isolated_mm: Vec<[f64; 2]>,
    /// Errors of z of all found dots with r ≥ 3 that are wholly on the sensor, mm.
    pub outer_mm: Vec<f64>,
    /// Error of the fitted tilt, degrees, and R² of the fit, frame by frame, over all points with r ≥ 3.
    pub tilts: Vec<[f64; 2]>,
}

impl Score {
    /// Scores a plate in a pose: dots by `seed`, noise by another seed drawn from it.
    pub fn of(rig: &Rig, pose: Pose, seed: u64) -> Self {
        Self::of_scene(rig, &pose.scene(seed), pose, seed)
    }

    /// Scores any scene with a plate in a pose.
    pub fn of_scene(rig: &Rig, scene: &Scene, pose: Pose, seed: u64) -> Self {
        let points = rig.points(&rig.frame(scene, Some(seed + 1000)));
        let mut score = Self::default();
        let centres_mm: Vec<[f64; 3]> = scene.dots().iter().map(|dot| dot.centre_mm).collect();
        for (index, dot) in scene.dots().iter().enumerate() {
            if !rig.sees_whole(dot.centre_mm, dot.diameter_mm) {
                continue;
            }
            score.whole += 1;
            let Some(point) = nearest(&points, dot.centre_mm).filter(|point| !is_false(point, &[dot.centre_mm])) else {
                continue;
            };
            score.found += 1;
            let error_mm = point.position_mm[2] - dot.centre_mm[2];
            if dot.centre_mm[0].hypot(dot.centre_mm[1]) >= UNCLIPPED_RADIUS_MM {
                score.outer_mm.push(error_mm);
                let apart = |(other, centre_mm): (usize, &[f64; 3])| {
                    other == index || rig.sees_apart(dot.centre_mm, *centre_mm, dot.diameter_mm)
                };
                if centres_mm.iter().enumerate().all(apart) {
                    score.isolated_mm.push([error_mm, point.std_mm[2]]);
                }
            }
        }
        score.false_points = points.iter().filter(|point| is_false(point, &centres_mm)).count();
        if let Pose::Tilted(tilt_deg) = pose {
            score
                .tilts
                .extend(tilt(&points).map(|fit| [fit.tilt_rad.value.to_degrees() - tilt_deg, fit.quality.r_squared]));
        }
        score
    }

    /// Adds another plate's score.
    pub fn merge(&mut self, other: Self) {
        self.whole += other.whole;
        self.found += other.found;
        self.false_points += other.false_points;
        self.isolated_mm.extend(other.isolated_mm);
        self.outer_mm.extend(other.outer_mm);
        self.tilts.extend(other.tilts);
    }

    /// Share of the dots wholly on the sensor that were found.
    pub fn recall(&self) -> f64 {
        self.found as f64 / self.whole as f64
    }

    /// Root mean square error of z of isolated dots, mm.
    pub fn isolated_rms_mm(&self) -> f64 {
        rms(self.isolated_mm.iter().map(|[error_mm, _]| *error_mm))
    }

    /// Root mean square error of z over its reported deviation, isolated dots.
    pub fn isolated_error_over_std(&self) -> f64 {
        rms(self.isolated_mm.iter().map(|[error_mm, std_mm]| error_mm / std_mm))
    }

    /// Root mean square error of z of all dots with r ≥ 3, mm.
    pub fn outer_rms_mm(&self) -> f64 {
        rms(self.outer_mm.iter().copied())
    }

    /// Largest error of a fitted tilt, degrees.
    pub fn tilt_error_deg_max(&self) -> f64 {
        self.tilts.iter().map(|[error_deg, _]| error_deg.abs()).fold(0.0, f64::max)
    }

    /// Least R² of a fitted tilt.
    pub fn r_squared_min(&self) -> f64 {
        self.tilts.iter().map(|[_, r_squared]| *r_squared).fold(1.0, f64::min)
    }
}

fn is_false(point: &Point, centres_mm: &[[f64; 3]]) -> bool {
    !centres_mm.iter().any(|centre_mm| is_near(point.position_mm, *centre_mm))
}

/// Whether a point may be that of a dot.
pub(crate) fn is_near(position_mm: [f64; 3], centre_mm: [f64; 3]) -> bool {
    is_within(FALSE_MM, position_mm, centre_mm)
}

/// Whether a position lies within some mm of another, across the axis and in depth.
pub(crate) fn is_within(reach_mm: [f64; 2], position_mm: [f64; 3], centre_mm: [f64; 3]) -> bool {
    let across_mm = (position_mm[0] - centre_mm[0]).hypot(position_mm[1] - centre_mm[1]);
    across_mm < reach_mm[0] && (position_mm[2] - centre_mm[2]).abs() < reach_mm[1]
}

/// Eq. 14 through all points with r ≥ 3.
fn tilt(points: &[Point]) -> Option<LineFit> {
    let outer: Vec<FitPoint> = points
        .iter()
        .filter(|point| point.position_mm[0].hypot(point.position_mm[1]) >= UNCLIPPED_RADIUS_MM)
        .map(|point| FitPoint { position_mm: point.position_mm, z_std_mm: Some(point.std_mm[2]) })
        .collect();
    fit_line(&outer, LineAxis::X).ok()
}

/// Root mean square.
pub(crate) fn rms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    (values.map(|value| value * value).sum::<f64>() / count).sqrt()
}
