//! How the surface under each point is tilted, as its neighbours show it.

use crate::fit::{FitPoint, PlaneFit, fit_plane};

/// Neighbours through which a plane is laid, the point itself included.
const NEIGHBOURS: usize = 9;

/// A slope is believed if its deviation, from the scatter of the neighbours about their plane, is below this: what is
/// then left of the error of a tilted disc is about the noise.
const SLOPE_STD_MAX: f64 = 0.1;

/// Slopes dz/dx and dz/dy, at the places `at_mm`, of the surface that the `known_mm` points lie on; `None` where
/// the nearest of them do not lie on a plane.
pub(crate) fn local_slopes(known_mm: &[[f64; 3]], at_mm: &[[f64; 3]]) -> Vec<Option<[f64; 2]>> {
    let mut by_x = known_mm.to_vec();
    by_x.sort_by(|a, b| a[0].total_cmp(&b[0]));
    at_mm.iter().map(|place_mm| slopes_of(&nearest(&by_x, *place_mm))).collect()
}

/// The nearest points to a place, of points in the order of x, searched outwards until none farther along x can be
/// nearer.
fn nearest(by_x: &[[f64; 3]], [x0_mm, y0_mm, _]: [f64; 3]) -> Vec<FitPoint> {
    let mut found: Vec<(f64, usize)> = Vec::with_capacity(NEIGHBOURS + 1);
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
        if found.len() >= NEIGHBOURS && ahead(side) > found[NEIGHBOURS - 1].0 {
            break;
        }
        let distance_mm = (by_x[side][0] - x0_mm).hypot(by_x[side][1] - y0_mm);
        let rank = found.partition_point(|(other_mm, _)| *other_mm <= distance_mm);
        if rank < NEIGHBOURS {
            found.insert(rank, (distance_mm, side));
            found.truncate(NEIGHBOURS);
        }
        if side == right { right += 1 } else { left = side.checked_sub(1) }
    }
    // Without deviations the fit takes those of its parameters from the scatter: it must be the surface that is flat.
    found.iter().map(|&(_, index)| FitPoint { position_mm: by_x[index], z_std_mm: None }).collect()
}

/// Slopes of the plane through the neighbours, without the two that lie farthest off it.
fn slopes_of(neighbours: &[FitPoint]) -> Option<[f64; 2]> {
    const FEWEST: usize = 5;
    const DROPPED: usize = 2;
    let first = fit_plane(neighbours).ok()?;
    let mut kept = neighbours.to_vec();
    kept.sort_by(|a, b| first.distance_mm(a).abs().total_cmp(&first.distance_mm(b).abs()));
    kept.truncate((neighbours.len() - DROPPED).max(FEWEST));
    let PlaneFit { slope_x, slope_y, .. } = fit_plane(&kept).ok()?;
    let sure = kept.len() >= FEWEST && slope_x.std.max(slope_y.std) < SLOPE_STD_MAX;
    sure.then_some([slope_x.value, slope_y.value])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slopes_at(points_mm: &[[f64; 3]]) -> Vec<[f64; 2]> {
        local_slopes(points_mm, points_mm).into_iter().map(Option::unwrap_or_default).collect()
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
