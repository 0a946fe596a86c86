//! How the surface under each point is tilted, as its neighbours show it.

use crate::cells::Cells;

/// Neighbours through which a plane is laid, the point itself included.
pub(crate) const NEIGHBOURS: usize = 9;

/// The same where points are only roughly known.
pub(crate) const NEIGHBOURS_ROUGH: usize = 25;

/// A slope is believed if its deviation, from the scatter of the neighbours about their plane, is below this: what is
/// then left of the error of a tilted disc is about the noise.
const SLOPE_STD_MAX: f64 = 0.1;

/// The nearest points to a place, nearest first, with the squares of their distances.
type Nearest = Vec<(f64, u32)>;

/// Slopes dz/dx and dz/dy under each point, as its neighbours show them; none where those do not lie on a plane.
pub fn surface_slopes(points_mm: &[[f64; 3]]) -> Vec<[f64; 2]> {
    let mut slopes = Slopes::default();
    slopes.lay_through(points_mm.iter().copied(), NEIGHBOURS);
    points_mm.iter().map(|point_mm| slopes.at(*point_mm).unwrap_or_default()).collect()
}

/// Points of a surface; its buffers are used again from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Slopes {
    points_mm: Vec<[f64; 3]>,
    /// How many of them a slope is taken from.
    neighbours: usize,
    cells: Cells,
    near: Nearest,
}

impl Slopes {
    /// Lays the surface through points, of which the `neighbours` nearest tell a slope.
    pub(crate) fn lay_through(&mut self, points_mm: impl Iterator<Item = [f64; 3]>, neighbours: usize) {
        const CROWD: f64 = 3.0;
        self.neighbours = neighbours.min(NEIGHBOURS_ROUGH);
        self.points_mm.clear();
        self.points_mm.extend(points_mm);
        self.cells.fill(self.points_mm.iter().map(|point_mm| [point_mm[0], point_mm[1]]), CROWD);
    }

    /// Slopes dz/dx and dz/dy at a place; `None` where the nearest points do not lie on a plane.
    pub(crate) fn at(&mut self, place_mm: [f64; 3]) -> Option<[f64; 2]> {
        let Self { points_mm, neighbours: count, cells, near } = self;
        nearest(points_mm, cells, place_mm, *count, near);
        let mut neighbours = [[0.0; 3]; NEIGHBOURS_ROUGH];
        neighbours.iter_mut().zip(&*near).for_each(|(neighbour, (_, index))| *neighbour = points_mm[*index as usize]);
        slopes_of(&mut neighbours[..near.len()], place_mm)
    }
}

/// The nearest points to a place: in growing squares of cells about it, until none farther out can be nearer.
fn nearest(points_mm: &[[f64; 3]], cells: &Cells, place_mm: [f64; 3], count: usize, found: &mut Nearest) {
    found.clear();
    let home = [0, 1].map(|axis| cells.cell(axis, place_mm[axis]));
    let last = [0, 1].map(|axis| cells.count(axis).saturating_sub(1));
    for reach in 1.. {
        let [first_column, first_row] = home.map(|cell| cell.saturating_sub(reach));
        let [last_column, last_row] = [0, 1].map(|axis| (home[axis] + reach).min(last[axis]));
        for row in first_row..=last_row {
            // What lies inside was looked at before.
            if reach == 1 || row.abs_diff(home[1]) == reach {
                add_nearest(points_mm, cells.row(row, first_column, last_column), place_mm, count, found);
                continue;
            }
            for column in [first_column, last_column] {
                if column.abs_diff(home[0]) == reach {
                    add_nearest(points_mm, cells.row(row, column, column), place_mm, count, found);
                }
            }
        }
        let whole = [first_column, first_row] == [0, 0] && [last_column, last_row] == last;
        // Beyond the outer cells there is nothing.
        let beyond_mm = |axis: usize, first: usize, end: usize| {
            let below = if first == 0 { f64::INFINITY } else { place_mm[axis] - cells.start(axis, first) };
            let above = if end == last[axis] { f64::INFINITY } else { cells.start(axis, end + 1) - place_mm[axis] };
            below.min(above)
        };
        let margin_mm = beyond_mm(0, first_column, last_column).min(beyond_mm(1, first_row, last_row));
        if whole || found.get(count - 1).is_some_and(|(farthest_mm2, _)| *farthest_mm2 <= margin_mm * margin_mm) {
            return;
        }
    }
}

/// Puts points among the nearest ones.
fn add_nearest(
    points_mm: &[[f64; 3]],
    members: &[u32],
    [x0_mm, y0_mm, _]: [f64; 3],
    count: usize,
    found: &mut Nearest,
) {
    for &index in members {
        let [x_mm, y_mm, _] = points_mm[index as usize];
        let distance_mm2 = (x_mm - x0_mm).powi(2) + (y_mm - y0_mm).powi(2);
        if found.get(count - 1).is_none_or(|(farthest_mm2, _)| distance_mm2 < *farthest_mm2) {
            let rank = found.iter().rposition(|(other_mm2, _)| *other_mm2 <= distance_mm2).map_or(0, |rank| rank + 1);
            found.truncate(count - 1);
            found.insert(rank, (distance_mm2, index));
        }
    }
}

/// Slopes of the plane through the neighbours of a place, without those that lie farthest off it, two in nine.
fn slopes_of(neighbours_mm: &mut [[f64; 3]], place_mm: [f64; 3]) -> Option<[f64; 2]> {
    const FEWEST: usize = 5;
    let first = Plane::through(neighbours_mm, place_mm)?;
    let mut kept_mm = neighbours_mm;
    for _ in 0..(kept_mm.len() / 4).min(kept_mm.len().saturating_sub(FEWEST)) {
        let last = kept_mm.len() - 1;
        let off_mm = |index: &usize| first.off_mm(&kept_mm[*index]).abs();
        let farthest = (0..=last).max_by(|a, b| off_mm(a).total_cmp(&off_mm(b))).unwrap_or(last);
        kept_mm.swap(farthest, last);
        kept_mm = &mut kept_mm[..last];
    }
    let plane = Plane::through(kept_mm, place_mm)?;
    let sure = kept_mm.len() >= FEWEST && plane.slope_std(kept_mm) < SLOPE_STD_MAX;
    sure.then_some(plane.slopes)
}

/// A plane `z = z₀ + s·(x − x₀)` by least squares.
struct Plane {
    origin_mm: [f64; 3],
    slopes: [f64; 2],
    /// Larger of the slopes' variances for points that scatter by 1 mm about it, 1/mm².
    variance: f64,
}

impl Plane {
    /// Through points, seen from one amid them; `None` if they stand in a line.
    fn through(points_mm: &[[f64; 3]], origin_mm: [f64; 3]) -> Option<Self> {
        const LINE: f64 = 1e-9;
        let share = 1.0 / points_mm.len() as f64;
        let from_origin =
            |point_mm: &[f64; 3]| -> [f64; 3] { std::array::from_fn(|axis| point_mm[axis] - origin_mm[axis]) };
        let (mut sum, mut xx, mut xy, mut yy, mut xz, mut yz) = ([0.0; 3], 0.0, 0.0, 0.0, 0.0, 0.0);
        for [x, y, z] in points_mm.iter().map(from_origin) {
            sum = [sum[0] + x, sum[1] + y, sum[2] + z];
            (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
            (xz, yz) = (xz + x * z, yz + y * z);
        }
        let size = xx * yy;
        let [x, y, z] = sum.map(|sum| sum * share);
        (xx, xy, yy) = (xx - x * sum[0], xy - x * sum[1], yy - y * sum[1]);
        (xz, yz) = (xz - x * sum[2], yz - y * sum[2]);
        let determinant = xx * yy - xy * xy;
        if determinant <= LINE * size || determinant.is_nan() {
            return None;
        }
        let slopes = [(yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant];
        let origin_mm = [origin_mm[0] + x, origin_mm[1] + y, origin_mm[2] + z];
        Some(Self { origin_mm, slopes, variance: xx.max(yy) / determinant })
    }

    fn off_mm(&self, point_mm: &[f64; 3]) -> f64 {
        let [x_mm, y_mm, z_mm] = [0, 1, 2].map(|axis| point_mm[axis] - self.origin_mm[axis]);
        z_mm - self.slopes[0] * x_mm - self.slopes[1] * y_mm
    }

    /// Deviation of the steeper slope, from the scatter of the points: it must be the surface that is flat.
    fn slope_std(&self, points_mm: &[[f64; 3]]) -> f64 {
        let squares: f64 = points_mm.iter().map(|point_mm| self.off_mm(point_mm).powi(2)).sum();
        let variance = squares / (points_mm.len().saturating_sub(3)).max(1) as f64;
        (variance * self.variance).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slopes_at(points_mm: &[[f64; 3]]) -> Vec<[f64; 2]> {
        let mut slopes = Slopes::default();
        slopes.lay_through(points_mm.iter().copied(), NEIGHBOURS);
        points_mm.iter().map(|point_mm| slopes.at(*point_mm).unwrap_or_default()).collect()
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

    #[test]
    fn the_nearest_are_the_nearest_of_all() {
        let known_mm: Vec<[f64; 3]> =
            (0..300_u32).map(|k| [f64::from(k * 37 % 101).powf(1.3), f64::from(k * 53 % 97), 300.0]).collect();
        let mut slopes = Slopes::default();
        slopes.lay_through(known_mm.iter().copied(), NEIGHBOURS);
        for place_mm in [[0.0, 0.0, 0.0], [200.0, 50.0, 0.0], [333.3, 97.1, 0.0], [900.0, -50.0, 0.0], [71.0, 3.0, 0.0]]
        {
            nearest(&slopes.points_mm, &slopes.cells, place_mm, NEIGHBOURS, &mut slopes.near);
            let distance_mm2 = |p: &[f64; 3]| (p[0] - place_mm[0]).powi(2) + (p[1] - place_mm[1]).powi(2);
            let mut all_mm2: Vec<f64> = known_mm.iter().map(distance_mm2).collect();
            all_mm2.sort_by(f64::total_cmp);
            let found_mm2: Vec<f64> = slopes.near.iter().map(|(distance_mm2, _)| *distance_mm2).collect();
            assert_eq!(found_mm2, all_mm2[..NEIGHBOURS], "{place_mm:?}");
        }
    }
}
