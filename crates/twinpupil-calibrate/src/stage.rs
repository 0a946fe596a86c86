//! A stage that carries the target along a straight way and tells how far it went.

use nalgebra::{Matrix3, SMatrix, SVector, Unit, Vector3};

use crate::pose::Pose;

/// Where a stage says that the middle of the target stood, along a way whose start and direction are sought.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StagePosition {
    /// Distance from the start of the way, mm.
    pub travel_mm: f64,
    /// Standard deviation of that, and of how far the middle of the target is beside the way, mm.
    pub std_mm: f64,
}

/// Numbers of a way: three of its start, two of its direction.
pub(crate) const WAY_SIZE: usize = 5;

/// Units in which those are adjusted: mm and rad, far beyond what is left of them.
const START_UNIT_MM: f64 = 1000.0;
const TURN_UNIT_RAD: f64 = 1.0;

/// A straight way in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Way {
    start_mm: Vector3<f64>,
    direction: Unit<Vector3<f64>>,
}

/// Change of a place on a way with its numbers, in their units.
pub(crate) type WayGradient = SMatrix<f64, 3, WAY_SIZE>;

impl Way {
    /// The way that roughly known poses lie on; `None` if fewer than two of them have different positions.
    pub(crate) fn through(poses: &[Pose], positions: &[Option<StagePosition>]) -> Option<Self> {
        let sights: Vec<(f64, Vector3<f64>)> = poses
            .iter()
            .zip(positions)
            .filter_map(|(pose, position)| Some((position.as_ref()?.travel_mm, pose.translation_mm)))
            .collect();
        let count = sights.len().max(1) as f64;
        let travel_mm = sights.iter().map(|(travel_mm, _)| travel_mm).sum::<f64>() / count;
        let middle_mm: Vector3<f64> = sights.iter().map(|(_, place_mm)| place_mm).sum::<Vector3<f64>>() / count;
        let along: Vector3<f64> =
            sights.iter().map(|(own_mm, place_mm)| (own_mm - travel_mm) * (place_mm - middle_mm)).sum();
        let direction = Unit::try_new(along, 1e-9)?;
        Some(Self { start_mm: middle_mm - travel_mm * direction.into_inner(), direction })
    }

    /// Where the middle of the target is, mm, and how that changes.
    pub(crate) fn at(&self, travel_mm: f64) -> (Vector3<f64>, WayGradient) {
        let mut gradient = WayGradient::zeros();
        gradient.fixed_columns_mut::<3>(0).copy_from(&(Matrix3::identity() * START_UNIT_MM));
        for (k, across) in self.across().into_iter().enumerate() {
            gradient.set_column(3 + k, &(across * (travel_mm * TURN_UNIT_RAD)));
        }
        (self.start_mm + travel_mm * self.direction.into_inner(), gradient)
    }

    /// Moved by a step of its numbers, in their units.
    pub(crate) fn moved(&self, step: &SVector<f64, WAY_SIZE>) -> Self {
        let [first, second] = self.across();
        let turned = self.direction.into_inner() + (step[3] * first + step[4] * second) * TURN_UNIT_RAD;
        Self {
            start_mm: self.start_mm + START_UNIT_MM * step.fixed_rows::<3>(0),
            direction: Unit::new_normalize(turned),
        }
    }

    /// Two unit vectors across it.
    fn across(&self) -> [Vector3<f64>; 2] {
        let away = if self.direction.x.abs() < 0.5 { Vector3::x() } else { Vector3::y() };
        let first = self.direction.cross(&away).normalize();
        [first, self.direction.cross(&first)]
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    fn pose(place_mm: Vector3<f64>) -> Pose {
        Pose { rotation: Rotation3::identity(), translation_mm: place_mm }
    }

    #[test]
    fn a_way_leads_through_its_poses() {
        let direction = Vector3::new(0.02, -0.01, 1.0).normalize();
        let places: Vec<Vector3<f64>> =
            [0.0, 20.0, 50.0].iter().map(|travel| Vector3::new(1.0, 2.0, 260.0) + direction * *travel).collect();
        let poses: Vec<Pose> = places.iter().map(|place_mm| pose(*place_mm)).collect();
        let positions = [0.0, 20.0, 50.0].map(|travel_mm| Some(StagePosition { travel_mm, std_mm: 0.01 }));
        let way = Way::through(&poses, &positions).unwrap();
        for (position, place_mm) in positions.iter().flatten().zip(&places) {
            assert!((way.at(position.travel_mm).0 - place_mm).norm() < 1e-9);
        }
        assert!(Way::through(&poses[..1], &positions[..1]).is_none());
        assert!(Way::through(&poses, &[None, None, None]).is_none());
    }

    #[test]
    fn its_gradient_is_that_of_small_steps() {
        let poses = [pose(Vector3::new(0.0, 0.0, 250.0)), pose(Vector3::new(3.0, -2.0, 340.0))];
        let positions = [0.0, 90.0].map(|travel_mm| Some(StagePosition { travel_mm, std_mm: 0.01 }));
        let way = Way::through(&poses, &positions).unwrap();
        let (_, gradient) = way.at(70.0);
        for k in 0..WAY_SIZE {
            let mut step = SVector::<f64, WAY_SIZE>::zeros();
            step[k] = 1e-6;
            let change = (way.moved(&step).at(70.0).0 - way.moved(&-step).at(70.0).0) / 2e-6;
            assert!((change - gradient.column(k)).norm() < 1e-3 * gradient.column(k).norm(), "{k}");
        }
    }
}
