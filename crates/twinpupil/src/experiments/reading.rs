//! Recovered dots beside the true ones.

use twinpupil_reconstruct::Point;
use twinpupil_simulate::Dot;

use super::{Case, Experiment, Shot};

/// A recovered point belongs to a dot if it lies within its outline or nearly so, seen along the axis, mm.
///
/// Centres on the paper's plate are at least 1.3 mm apart on the plate, 0.65 mm at 60°.
const REACH_MM: f64 = 0.6;

/// A dot that was recovered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Located {
    /// Its number in the scene.
    pub dot: usize,
    /// Where it is, mm.
    pub true_mm: [f64; 3],
    /// Where it was found, mm.
    pub found_mm: [f64; 3],
}

impl Located {
    /// Distance from the axis, mm.
    pub fn radius_mm(&self) -> f64 {
        self.true_mm[0].hypot(self.true_mm[1])
    }

    /// Recovered less true depth, mm.
    pub fn depth_error_mm(&self) -> f64 {
        self.found_mm[2] - self.true_mm[2]
    }
}

/// One frame, read in one way.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// The lens and the way of reading.
    pub case: Case,
    /// The experiment.
    pub experiment: Experiment,
    /// Where the dots, or the axis of the plate, stand, mm.
    pub z_mm: f64,
    /// The recovered dots, by their number.
    pub dots: Vec<Located>,
    /// Numbers of the dots whose images lie wholly on the sensor.
    pub whole: Vec<usize>,
    /// Points that are no dot, mm.
    pub strays_mm: Vec<[f64; 3]>,
}

impl Reading {
    /// Pairs points with the dots of `shot`, nearest first, each dot with one point.
    pub fn new(case: Case, shot: &Shot, points: &[Point], whole: Vec<usize>) -> Self {
        let positions: Vec<[f64; 3]> = points.iter().map(|point| point.position_mm).collect();
        let (dots, strays_mm) = pair(shot.scene.dots(), &positions);
        Self { case, experiment: shot.experiment, z_mm: shot.z_mm, dots, whole, strays_mm }
    }

    /// All points, those that are no dot included: a user could not leave them out.
    pub fn points_mm(&self) -> impl Iterator<Item = [f64; 3]> {
        self.dots.iter().map(|dot| dot.found_mm).chain(self.strays_mm.iter().copied())
    }

    /// Number of dots that were recovered, of those that lie wholly on the sensor.
    pub fn whole_found(&self) -> usize {
        self.dots.iter().filter(|dot| self.whole.contains(&dot.dot)).count()
    }

    /// Recovered depths of all points, mm.
    pub fn depths_mm(&self) -> Vec<f64> {
        self.points_mm().map(|[_, _, z_mm]| z_mm).collect()
    }

    /// Recovered less true depth of every dot, mm.
    pub fn depth_errors_mm(&self) -> Vec<f64> {
        self.dots.iter().map(Located::depth_error_mm).collect()
    }
}

/// The dots that have a point, and the points that have no dot.
fn pair(truth: &[Dot], points_mm: &[[f64; 3]]) -> (Vec<Located>, Vec<[f64; 3]>) {
    let mut near = Vec::new();
    for (dot, truth) in truth.iter().enumerate() {
        for (point, found_mm) in points_mm.iter().enumerate() {
            let [x_mm, y_mm, _] = truth.centre_mm;
            let distance_mm = (found_mm[0] - x_mm).hypot(found_mm[1] - y_mm);
            if distance_mm < REACH_MM {
                near.push((distance_mm, dot, point));
            }
        }
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut dot_taken, mut point_taken) = (vec![false; truth.len()], vec![false; points_mm.len()]);
    let mut located = Vec::new();
    for (_, dot, point) in near {
        if !dot_taken[dot] && !point_taken[point] {
            (dot_taken[dot], point_taken[point]) = (true, true);
            located.push(Located { dot, true_mm: truth[dot].centre_mm, found_mm: points_mm[point] });
        }
    }
    located.sort_by_key(|located| located.dot);
    let strays = points_mm.iter().zip(point_taken).filter(|(_, taken)| !taken);
    (located, strays.map(|(point_mm, _)| *point_mm).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dot(x_mm: f64) -> Dot {
        Dot { centre_mm: [x_mm, 0.0, 300.0], normal: [0.0, 0.0, -1.0], diameter_mm: 1.0 }
    }

    #[test]
    fn each_dot_takes_its_nearest_point_and_what_is_left_is_no_dot() {
        let truth = [dot(2.0), dot(3.3), dot(7.0)];
        let points_mm = [[3.2, 0.0, 301.0], [2.1, 0.0, 299.0], [2.4, 0.0, 250.0], [-5.0, 0.0, 300.0]];
        let (located, strays_mm) = pair(&truth, &points_mm);
        assert_eq!(located.iter().map(|l| l.dot).collect::<Vec<_>>(), [0, 1]);
        assert_eq!(located[0].depth_error_mm(), -1.0);
        assert_eq!(located[1].depth_error_mm(), 1.0);
        assert_eq!(strays_mm, points_mm[2..]);
    }
}
