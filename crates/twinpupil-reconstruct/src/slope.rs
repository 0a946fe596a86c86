//! How the surface under each point is tilted, as its neighbours show it.

use nalgebra::{Matrix3, Vector3};

/// Neighbours through which a plane is laid, the point itself included.
pub(crate) const NEIGHBOURS: usize = 9;

/// The same where points are only roughly known.
pub(crate) const NEIGHBOURS_ROUGH: usize = 25;

/// A slope is believed if its deviation, from the scatter of the neighbours about their plane, is below this: what is
/// then left of the error of a tilted disc is about the noise.
const SLOPE_STD_MAX: f64 = 0.1;

/// Slopes dz/dx and dz/dy, at the places `at_mm`, of the surface that the `known_mm` points lie on; `None` where
/// the nearest of them do not lie on a plane.
pub(crate) fn local_slopes(known_mm: &[[f64; 3]], at_mm: &[[f64; 3]], count: usize) -> Vec<Option<[f64; 2]>> {
    let mut by_x = known_mm.to_vec();
    by_x.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut near = Vec::with_capacity(count + 1);
    let slopes = |place_mm: &[f64; 3]| {
        nearest(&by_x, *place_mm, count, &mut near);
        let mut neighbours = [[0.0; 3]; NEIGHBOURS_ROUGH];
        neighbours.iter_mut().zip(&near).for_each(|(neighbour, (_, index))| *neighbour = by_x[*index]);
        slopes_of(&mut neighbours[..near.len()], *place_mm)
    };
    at_mm.iter().map(slopes).collect()
}

/// The nearest points to a place, of points in the order of x, searched outwards until none farther along x can be
/// nearer.
fn nearest(by_x: &[[f64; 3]], [x0_mm, y0_mm, _]: [f64; 3], count: usize, found: &mut Vec<(f64, usize)>) {
    found.clear();
    let start = by_x.partition_point(|point_mm| point_mm[0] < x0_mm);
    let (mut left, mut right) = (start.checked_sub(1), start);
    loop {
        let ahead = |side: usize| (by_x[side][0] - x0_mm).abs();
        let side = match (left, by_x.get(right)) {
            (Some(l), Some(_)) if ahead(l) <= ahead(right) => l,
            (Some(l), None) => l,
            (_, Some(_)) => right,
            (None, None) => break,
        };
        if found.len() >= count && ahead(side).powi(2) > found[count - 1].0 {
            break;
        }
        let distance_mm2 = (by_x[side][0] - x0_mm).powi(2) + (by_x[side][1] - y0_mm).powi(2);
        let rank = found.partition_point(|(other_mm2, _)| *other_mm2 <= distance_mm2);
        if rank < count {
            found.insert(rank, (distance_mm2, side));
            found.truncate(count);
        }
        if side == right { right += 1 } else { left = side.checked_sub(1) }
    }
}

/// Slopes of the plane through the neighbours of a place, without those that lie farthest off it, two in nine.
fn slopes_of(neighbours_mm: &mut [[f64; 3]], place_mm: [f64; 3]) -> Option<[f64; 2]> {
    const FEWEST: usize = 5;
    let first = Plane::through(neighbours_mm, place_mm)?;
    let off_mm = |point_mm: &[f64; 3]| first.off_mm(point_mm).abs();
    neighbours_mm.sort_by(|a, b| off_mm(a).total_cmp(&off_mm(b)));
    let kept_mm =
        &neighbours_mm[..(neighbours_mm.len() - neighbours_mm.len() / 4).max(FEWEST).min(neighbours_mm.len())];
    let plane = Plane::through(kept_mm, place_mm)?;
    let sure = kept_mm.len() >= FEWEST && plane.slope_std(kept_mm) < SLOPE_STD_MAX;
    sure.then_some(plane.slopes)
}

/// A plane `z = z₀ + s·(x − x₀)` by least squares.
struct Plane {
    origin_mm: [f64; 3],
    slopes: [f64; 2],
    /// Inverse of the normal matrix, for z₀ and both slopes.
    inverse: Matrix3<f64>,
}

impl Plane {
    /// Through points, seen from one amid them; `None` if they stand in a line.
    fn through(points_mm: &[[f64; 3]], origin_mm: [f64; 3]) -> Option<Self> {
        const LINE: f64 = 1e-9;
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for point_mm in points_mm {
            let row = Vector3::new(1.0, point_mm[0] - origin_mm[0], point_mm[1] - origin_mm[1]);
            normal += row * row.transpose();
            right += row * (point_mm[2] - origin_mm[2]);
        }
        let size = normal.diagonal().product();
        let inverse = normal.try_inverse().filter(|_| normal.determinant() > LINE * size)?;
        let [z_mm, sx, sy] = (inverse * right).into();
        let origin_mm = [origin_mm[0], origin_mm[1], origin_mm[2] + z_mm];
        Some(Self { origin_mm, slopes: [sx, sy], inverse })
    }

    fn off_mm(&self, point_mm: &[f64; 3]) -> f64 {
        let [x_mm, y_mm, z_mm] = [0, 1, 2].map(|axis| point_mm[axis] - self.origin_mm[axis]);
        z_mm - self.slopes[0] * x_mm - self.slopes[1] * y_mm
    }

    /// Deviation of the steeper slope, from the scatter of the points: it must be the surface that is flat.
    fn slope_std(&self, points_mm: &[[f64; 3]]) -> f64 {
        let squares: f64 = points_mm.iter().map(|point_mm| self.off_mm(point_mm).powi(2)).sum();
        let variance = squares / (points_mm.len().saturating_sub(3)).max(1) as f64;
        (variance * self.inverse[(1, 1)].max(self.inverse[(2, 2)])).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slopes_at(points_mm: &[[f64; 3]]) -> Vec<[f64; 2]> {
        local_slopes(points_mm, points_mm, NEIGHBOURS).into_iter().map(Option::unwrap_or_default).collect()
    }

    fn points(z_mm: impl Fn(f64, f64) -> f64) -> Vec<[f64; 3]> {
        let place = |k: u32| (1.5 * f64::from(k % 6), 1.5 * f64::from(k / 6));
        (0..36).map(place).map(|(x_mm, y_mm)| [x_mm, y_mm, z_mm(x_mm, y_mm)]).collect()
    }

    #[test]
    fn a_tilted_plane_has_its_slopes_everywhere() {
        for [sx, sy] in slopes_at(&points(|x, y| 300.0 + 0.7 * x - 0.2 * y)) {
            assert!((sx - 0.7).abs() < 1e-9 && (sy + 0.2).abs() < 1e-9);
        }
    }

    #[test]
    fn scattered_points_have_none() {
        let slopes = slopes_at(&points(|x, y| 300.0 + 20.0 * (7.1 * x + 3.3 * y).sin()));
        assert!(slopes.iter().all(|slope| *slope == [0.0; 2]));
    }

    #[test]
    fn few_points_have_none() {
        assert_eq!(slopes_at(&points(|x, _| x)[..4]), vec![[0.0; 2]; 4]);
        assert!(slopes_at(&[]).is_empty());
    }
}
