//! How the surface under each point is tilted, as its neighbours show it.

use crate::fit::{FitPoint, PlaneFit, fit_plane};
use crate::pipeline::Point;

/// Neighbours through which a plane is laid, the point itself included.
const NEIGHBOURS: usize = 9;

/// A slope is believed if its deviation, from the scatter of the neighbours about their plane, is below this: what is
/// then left of the error of a tilted disc is about the noise.
const SLOPE_STD_MAX: f64 = 0.1;

/// Slopes dz/dx and dz/dy of the surface at every point; zero where the neighbours do not lie on a plane.
pub(crate) fn local_slopes(points: &[Point]) -> Vec<[f64; 2]> {
    let mut by_x: Vec<usize> = (0..points.len()).collect();
    by_x.sort_by(|&a, &b| points[a].position_mm[0].total_cmp(&points[b].position_mm[0]));
    let mut slopes = vec![[0.0; 2]; points.len()];
    for place in 0..by_x.len() {
        slopes[by_x[place]] = slopes_of(&nearest(points, &by_x, place));
    }
    slopes
}

/// The nearest points to the one at `place` in the order along x, searched outwards until none farther along x can be
/// nearer.
fn nearest(points: &[Point], by_x: &[usize], place: usize) -> Vec<FitPoint> {
    let [x0_mm, y0_mm, _] = points[by_x[place]].position_mm;
    let mut found: Vec<(f64, usize)> = vec![(0.0, by_x[place])];
    let (mut left, mut right) = (place.checked_sub(1), place + 1);
    loop {
        let ahead = |side: usize| (points[by_x[side]].position_mm[0] - x0_mm).abs();
        let side = match (left, by_x.get(right)) {
            (Some(l), Some(_)) if ahead(l) <= ahead(right) => l,
            (Some(l), None) => l,
            (_, Some(_)) => right,
            (None, None) => break,
        };
        if found.len() >= NEIGHBOURS && ahead(side) > found[NEIGHBOURS - 1].0 {
            break;
        }
        let [x_mm, y_mm, _] = points[by_x[side]].position_mm;
        let distance_mm = (x_mm - x0_mm).hypot(y_mm - y0_mm);
        let rank = found.partition_point(|(other_mm, _)| *other_mm <= distance_mm);
        if rank < NEIGHBOURS {
            found.insert(rank, (distance_mm, by_x[side]));
            found.truncate(NEIGHBOURS);
        }
        if side == right { right += 1 } else { left = side.checked_sub(1) }
    }
    // Without deviations the fit takes those of its parameters from the scatter: it must be the surface that is flat.
    found.iter().map(|&(_, index)| FitPoint { position_mm: points[index].position_mm, z_std_mm: None }).collect()
}

/// Slopes of the plane through the neighbours, without the two that lie farthest off it.
fn slopes_of(neighbours: &[FitPoint]) -> [f64; 2] {
    const FEWEST: usize = 5;
    const DROPPED: usize = 2;
    let Ok(first) = fit_plane(neighbours) else { return [0.0; 2] };
    let mut kept = neighbours.to_vec();
    kept.sort_by(|a, b| first.distance_mm(a).abs().total_cmp(&first.distance_mm(b).abs()));
    kept.truncate((neighbours.len() - DROPPED).max(FEWEST));
    match fit_plane(&kept) {
        Ok(PlaneFit { slope_x, slope_y, .. })
            if kept.len() >= FEWEST && slope_x.std.max(slope_y.std) < SLOPE_STD_MAX =>
        {
            [slope_x.value, slope_y.value]
        }
        _ => [0.0; 2],
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::PixelPoint;

    use super::*;
    use crate::detect::Feature;

    fn points(z_mm: impl Fn(f64, f64) -> f64) -> Vec<Point> {
        let feature = Feature {
            centre: PixelPoint::default(),
            centre_std_px: [0.01; 2],
            area_px: 100.0,
            height_codes: 1000.0,
            ground_codes: 0.0,
            edge_px: 4.0,
            overlapped: false,
        };
        (0..36)
            .map(|k| {
                let (x_mm, y_mm) = (1.5 * f64::from(k % 6), 1.5 * f64::from(k / 6));
                Point {
                    position_mm: [x_mm, y_mm, z_mm(x_mm, y_mm)],
                    std_mm: [0.001; 3],
                    gamma: 1.0,
                    telecentric: feature,
                    entocentric: feature,
                    azimuth_residual_px: 0.0,
                    diameter_mm: 1.0,
                    ambiguous: false,
                }
            })
            .collect()
    }

    #[test]
    fn a_tilted_plane_has_its_slopes_everywhere() {
        for [sx, sy] in local_slopes(&points(|x, y| 300.0 + 0.7 * x - 0.2 * y)) {
            assert!((sx - 0.7).abs() < 1e-9 && (sy + 0.2).abs() < 1e-9);
        }
    }

    #[test]
    fn scattered_points_have_none() {
        let slopes = local_slopes(&points(|x, y| 300.0 + 20.0 * (7.1 * x + 3.3 * y).sin()));
        assert!(slopes.iter().all(|slope| *slope == [0.0; 2]));
    }

    #[test]
    fn few_points_have_none() {
        assert_eq!(local_slopes(&points(|x, _| x)[..4]), vec![[0.0; 2]; 4]);
        assert!(local_slopes(&[]).is_empty());
    }
}
