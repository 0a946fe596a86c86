//! Where the target stands.

use nalgebra::{Matrix2, Matrix3, Rotation3, Unit, Vector2, Vector3};

/// Rotation and translation of the target: `X = R P + t`, with P on the target and X before the front principal point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// R.
    pub rotation: Rotation3<f64>,
    /// t: where the middle of the target is, mm.
    pub translation_mm: Vector3<f64>,
}

/// A point of the target and where it seems to be, with the weight of its distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sight {
    pub(crate) target_mm: [f64; 2],
    pub(crate) seen_mm: [f64; 3],
    pub(crate) weight: f64,
}

impl Pose {
    /// Position of a point of the target, mm.
    pub fn at(&self, [x_mm, y_mm]: [f64; 2]) -> Vector3<f64> {
        self.rotation * Vector3::new(x_mm, y_mm, 0.0) + self.translation_mm
    }

    /// Where the motion takes a point of space, mm.
    pub fn moving(&self, point_mm: [f64; 3]) -> [f64; 3] {
        (self.rotation * Vector3::from(point_mm) + self.translation_mm).into()
    }

    /// Slopes dz/dx and dz/dy of the target.
    pub fn slopes(&self) -> [f64; 2] {
        let normal = self.rotation * Vector3::z();
        [-normal.x / normal.z, -normal.y / normal.z]
    }

    /// Angle between the target and a plane across the axis.
    pub fn tilt_rad(&self) -> f64 {
        (self.rotation * Vector3::z()).z.abs().clamp(0.0, 1.0).acos()
    }

    /// Turned by a small rotation vector in space, and shifted.
    #[must_use]
    pub fn moved(&self, turn_rad: Vector3<f64>, shift_mm: Vector3<f64>) -> Self {
        Self { rotation: Rotation3::new(turn_rad) * self.rotation, translation_mm: self.translation_mm + shift_mm }
    }

    /// The pose that explains roughly known positions: the plane through their distances, and the turn within it.
    ///
    /// `None` if they lie on one line.
    pub(crate) fn through(sights: &[Sight]) -> Option<Self> {
        let plane = plane(sights)?;
        let normal = Unit::new_normalize(Vector3::new(-plane.y, -plane.z, 1.0));
        let lean = Rotation3::rotation_between(&Vector3::z(), &normal)?;
        let (matrix, start) = affine(sights)?;
        // The images of the target's two axes, laid into its plane.
        let column = |k: usize| {
            let [x, y] = [matrix[(0, k)], matrix[(1, k)]];
            lean.inverse() * Vector3::new(x, y, plane.y * x + plane.z * y)
        };
        let (along, across) = (column(0), column(1));
        let turn_rad = (along.y - across.x).atan2(along.x + across.y);
        let rotation = lean * Rotation3::from_axis_angle(&Vector3::z_axis(), turn_rad);
        let z_mm = plane.x + plane.y * start.x + plane.z * start.y;
        Some(Self { rotation, translation_mm: Vector3::new(start.x, start.y, z_mm) })
    }
}

/// z = a + b x + c y by weighted least squares.
fn plane(sights: &[Sight]) -> Option<Vector3<f64>> {
    let (mut information, mut score) = (Matrix3::zeros(), Vector3::zeros());
    for Sight { seen_mm: [x, y, z], weight, .. } in sights {
        let row = Vector3::new(1.0, *x, *y);
        information += *weight * row * row.transpose();
        score += *weight * *z * row;
    }
    information.cholesky().map(|factor| factor.solve(&score))
}

/// x and y of space as an affine function of those on the target.
fn affine(sights: &[Sight]) -> Option<(Matrix2<f64>, Vector2<f64>)> {
    let (mut information, mut scores) = (Matrix3::zeros(), [Vector3::zeros(); 2]);
    for Sight { target_mm: [x, y], seen_mm, .. } in sights {
        let row = Vector3::new(1.0, *x, *y);
        information += row * row.transpose();
        scores.iter_mut().zip(seen_mm).for_each(|(score, seen)| *score += *seen * row);
    }
    let factor = information.cholesky()?;
    let [first, second] = scores.map(|score| factor.solve(&score));
    Some((Matrix2::new(first.y, first.z, second.y, second.z), Vector2::new(first.x, second.x)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_is_found_again_from_where_its_points_are() {
        for [ax, ay, az] in [[0.0, 0.0, 0.0], [0.3, -0.2, 0.1], [-0.4, 0.35, 3.0], [0.0, 0.5, -1.4]] {
            let rotation = Rotation3::new(Vector3::new(ax, ay, 0.0)) * Rotation3::new(Vector3::z() * az);
            let pose = Pose { rotation, translation_mm: Vector3::new(1.0, -2.0, 290.0) };
            let sights: Vec<Sight> = (0..12)
                .map(|k| {
                    let target_mm = [f64::from(k % 4), f64::from(k / 4)];
                    Sight { target_mm, seen_mm: pose.at(target_mm).into(), weight: 1.0 + f64::from(k) }
                })
                .collect();
            let found = Pose::through(&sights).unwrap();
            assert!((found.rotation.matrix() - rotation.matrix()).norm() < 1e-9, "{found:?} {pose:?}");
            assert!((found.translation_mm - pose.translation_mm).norm() < 1e-9);
        }
    }
}
