//! How the surface under each point is tilted, as its neighbours show it.

use multiversion::multiversion;

use crate::cells::Cells;
use crate::threads::{for_each_part, part_length};

/// Neighbours through which a plane is laid, the point itself included; and more of them, where their plane is known better:
/// where the surface is flat as far as they reach, or where the nearest are not in their places yet.
const NEAR: usize = 9;
const AROUND: usize = 25;

/// A slope is believed if its deviation, from the scatter of the neighbours about their plane, is below this: what is
/// then left of the error of a tilted disc is about the noise. A steep one is better believed than left out if its deviation is
/// below this share of it.
const SLOPE_STD_MAX: f64 = 0.1;
const SLOPE_SHARE_MAX: f64 = 0.2;

/// Where a slope's deviation is above this, points about it are not in their places yet: then one plane through points of the
/// whole frame may be known better, however the surface bends.
const ROUGH_SLOPE_STD: f64 = 0.005;

/// Points of the whole frame through which a plane is laid, at most.
const OVERALL: usize = 100;

/// Points near a place, with the squares of their distances.
type Nearest = Vec<(f64, u32)>;

/// Slopes dz/dx and dz/dy under each point, as its neighbours show them; none where those do not lie on a plane.
pub fn surface_slopes(points_mm: &[[f64; 3]]) -> Vec<[f64; 2]> {
    let mut slopes = Slopes::default();
    slopes.lay_through(points_mm.iter().copied());
    points_mm.iter().map(|point_mm| slopes.at(*point_mm).unwrap_or_default()).collect()
}

/// Points of a surface; its buffers are used again from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Slopes {
    points_mm: Vec<[f64; 3]>,
    /// Which of them the surface passes through.
    is_sure: Vec<bool>,
    cells: Cells,
    /// One for every thread.
    near: Vec<Nearest>,
    /// For every point the points about it, as many for each; those nearest to it first.
    lists: Vec<u32>,
    /// The plane through points of the whole frame, once they have moved.
    overall: Option<Fit>,
}

impl Slopes {
    /// Lays the surface through points.
    pub(crate) fn lay_through(&mut self, points_mm: impl Iterator<Item = [f64; 3]>) {
        // With so many in a cell the nearest are mostly found next door.
        const CROWD: f64 = 8.0;
        self.points_mm.clear();
        self.points_mm.extend(points_mm);
        self.is_sure.clear();
        self.is_sure.resize(self.points_mm.len(), true);
        self.cells.fill(self.points_mm.iter().map(|point_mm| [point_mm[0], point_mm[1]]), CROWD);
        self.lists.clear();
        self.overall = None;
    }

    /// Finds what stands about every point, for points that stay about where they are; so many threads share the work.
    pub(crate) fn get_to_know(&mut self, threads: usize) {
        let Self { points_mm, cells, near, lists, .. } = self;
        let count = AROUND.min(points_mm.len());
        lists.resize(points_mm.len() * count, 0);
        let length = part_length(points_mm.len(), threads);
        let parts = points_mm.chunks(length).zip(lists.chunks_mut(length * count.max(1)));
        for_each_part(parts, near, threads, |_, (places_mm, lists), near| {
            for (place_mm, list) in places_mm.iter().zip(lists.chunks_exact_mut(count)) {
                find_nearest(points_mm, cells, *place_mm, near);
                list.iter_mut().zip(&*near).for_each(|(place, (_, index))| *place = *index);
            }
        });
    }

    /// Moves all points, and says through which of them the surface passes.
    pub(crate) fn renew(&mut self, points_mm: impl Iterator<Item = ([f64; 3], bool)>) {
        let places = self.points_mm.iter_mut().zip(&mut self.is_sure);
        places.zip(points_mm).for_each(|((place_mm, is_sure), new)| (*place_mm, *is_sure) = new);
        let Self { points_mm, is_sure, .. } = self;
        let sure_mm =
            || points_mm.iter().zip(&*is_sure).filter(|(_, is_sure)| **is_sure).map(|(point_mm, _)| *point_mm);
        let sample_mm = || sure_mm().step_by(sure_mm().count().div_ceil(OVERALL).max(1));
        self.overall = sample_mm().next().and_then(|origin_mm| fit_overall(&Cloud::of(sample_mm(), origin_mm)));
    }

    /// Slopes dz/dx and dz/dy at a place; `None` where the nearest points do not lie on a plane.
    pub(crate) fn at(&mut self, place_mm: [f64; 3]) -> Option<[f64; 2]> {
        let Self { points_mm, is_sure, cells, near, overall, .. } = self;
        if near.is_empty() {
            near.push(Nearest::default());
        }
        let near = &mut near[0];
        find_nearest(points_mm, cells, place_mm, near);
        let sure = near.iter().map(|(_, index)| *index as usize).filter(|index| is_sure[*index]);
        slopes_of(sure.map(|index| points_mm[index]), place_mm, *overall)
    }

    /// The same at a point that is known.
    pub(crate) fn at_known(&self, index: usize) -> Option<[f64; 2]> {
        let count = AROUND.min(self.points_mm.len());
        let list = self.lists.get(index * count..(index + 1) * count)?.iter().map(|other| *other as usize);
        let sure_mm = list.filter(|other| self.is_sure[*other]).map(|other| self.points_mm[other]);
        slopes_of(sure_mm, self.points_mm[index], self.overall)
    }
}

/// The nearest [`AROUND`] points to a place, the nearest [`NEAR`] before the others: in growing squares of cells about it,
/// until none farther out can be nearer.
fn find_nearest(points_mm: &[[f64; 3]], cells: &Cells, place_mm: [f64; 3], found: &mut Nearest) {
    found.clear();
    let home = [0, 1].map(|axis| cells.cell(axis, place_mm[axis]));
    let last = [0, 1].map(|axis| cells.count(axis).saturating_sub(1));
    for reach in 1.. {
        let [first_column, first_row] = home.map(|cell| cell.saturating_sub(reach));
        let [last_column, last_row] = [0, 1].map(|axis| (home[axis] + reach).min(last[axis]));
        for row in first_row..=last_row {
            // What lies inside was looked at before.
            if reach == 1 || row.abs_diff(home[1]) == reach {
                add(points_mm, cells.row(row, first_column, last_column), place_mm, found);
                continue;
            }
            for column in [first_column, last_column] {
                if column.abs_diff(home[0]) == reach {
                    add(points_mm, cells.row(row, column, column), place_mm, found);
                }
            }
        }
        let whole = [first_column, first_row] == [0, 0] && [last_column, last_row] == last;
        let farthest_mm2 = keep_nearest(found, AROUND);
        // Beyond the outer cells there is nothing.
        let beyond_mm = |axis: usize, first: usize, end: usize| {
            let below = if first == 0 { f64::INFINITY } else { place_mm[axis] - cells.start(axis, first) };
            let above = if end == last[axis] { f64::INFINITY } else { cells.start(axis, end + 1) - place_mm[axis] };
            below.min(above)
        };
        let margin_mm = beyond_mm(0, first_column, last_column).min(beyond_mm(1, first_row, last_row));
        if whole || found.len() == AROUND && farthest_mm2 <= margin_mm * margin_mm {
            break;
        }
    }
    if found.len() > NEAR {
        found.select_nth_unstable_by(NEAR - 1, by_distance);
    }
}

fn by_distance(a: &(f64, u32), b: &(f64, u32)) -> std::cmp::Ordering {
    a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
}

/// Adds points with their distances.
fn add(points_mm: &[[f64; 3]], members: &[u32], [x0_mm, y0_mm, _]: [f64; 3], found: &mut Nearest) {
    found.extend(members.iter().map(|&index| {
        let [x_mm, y_mm, _] = points_mm[index as usize];
        ((x_mm - x0_mm).powi(2) + (y_mm - y0_mm).powi(2), index)
    }));
}

/// Keeps so many of the nearest points; the square of the distance to the farthest of them.
fn keep_nearest(found: &mut Nearest, count: usize) -> f64 {
    if found.len() > count {
        found.select_nth_unstable_by(count - 1, by_distance);
        found.truncate(count);
    }
    found.iter().map(|(distance_mm2, _)| *distance_mm2).fold(0.0, f64::max)
}

/// Slopes of the surface about a place: of the plane through the points about it, or of that through those nearest to it, which
/// come first; by the scatter about it, whichever is known better.
///
/// A curved surface scatters more as more of it is taken. By scatter alone, few points that happen to lie on some plane would
/// count for more than many whose places are still rough.
fn slopes_of(about_mm: impl Iterator<Item = [f64; 3]>, place_mm: [f64; 3], overall: Option<Fit>) -> Option<[f64; 2]> {
    let cloud = Cloud::<AROUND_LANES>::of(about_mm, place_mm);
    let [near, all] = fits_about(&cloud);
    let std = |fit: Option<Fit>| fit.map_or(f64::INFINITY, |fit| fit.slope_std());
    let local = if std(all) < std(near) { all } else { near };
    let is_rough = std(local) > ROUGH_SLOPE_STD && std(overall) < std(local);
    let fit = if is_rough { overall } else { local };
    fit.filter(Fit::is_believed).map(|fit| fit.plane.slopes)
}

/// Numbers side by side, and how many of them hold what belongs together.
const LANES: usize = 8;
const NEAR_LANES: usize = NEAR.next_multiple_of(LANES);
const AROUND_LANES: usize = AROUND.next_multiple_of(LANES);
const OVERALL_LANES: usize = OVERALL.next_multiple_of(LANES);

/// Points as one of them, or a place amid them, sees them, mm; behind the last are zeros.
#[derive(Debug, Clone)]
struct Cloud<const N: usize> {
    origin_mm: [f64; 3],
    x: [f64; N],
    y: [f64; N],
    z: [f64; N],
    count: usize,
}

#[inline(always)]
fn total(lanes: &[f64; LANES]) -> f64 {
    let mut halves = [0.0; LANES / 2];
    for lane in 0..LANES / 2 {
        halves[lane] = lanes[lane] + lanes[lane + LANES / 2];
    }
    (halves[0] + halves[2]) + (halves[1] + halves[3])
}

/// The planes through the nearest points of a cloud, and through all if there are more.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma", "x86_64+avx"))]
fn fits_about(cloud: &Cloud<AROUND_LANES>) -> [Option<Fit>; 2] {
    [cloud.nearest().fit(), if cloud.count > NEAR { cloud.fit() } else { None }]
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma", "x86_64+avx"))]
fn fit_overall(cloud: &Cloud<OVERALL_LANES>) -> Option<Fit> {
    cloud.fit()
}

impl Cloud<AROUND_LANES> {
    /// The nearest of its points, which come first.
    #[inline(always)]
    fn nearest(&self) -> Cloud<NEAR_LANES> {
        let Self { origin_mm, x, y, z, count } = self;
        let count = NEAR.min(*count);
        let mut near =
            Cloud { origin_mm: *origin_mm, x: [0.0; NEAR_LANES], y: [0.0; NEAR_LANES], z: [0.0; NEAR_LANES], count };
        for (near, all) in [&mut near.x, &mut near.y, &mut near.z].into_iter().zip([x, y, z]) {
            near[..NEAR].copy_from_slice(&all[..NEAR]);
        }
        near
    }
}

impl<const N: usize> Cloud<N> {
    fn of(points_mm: impl Iterator<Item = [f64; 3]>, origin_mm: [f64; 3]) -> Self {
        let mut cloud = Self { origin_mm, x: [0.0; N], y: [0.0; N], z: [0.0; N], count: 0 };
        let places = cloud.x.iter_mut().zip(&mut cloud.y).zip(&mut cloud.z);
        for (((x, y), z), point_mm) in places.zip(points_mm) {
            [*x, *y, *z] = [0, 1, 2].map(|axis| point_mm[axis] - origin_mm[axis]);
            cloud.count += 1;
        }
        cloud
    }

    /// The plane through its points, without those that lie farthest off it, two in nine.
    #[inline(always)]
    fn fit(&self) -> Option<Fit> {
        const FEWEST: usize = 5;
        let count = self.count;
        if count < FEWEST {
            return None;
        }
        let mut counts = [0.0; N];
        counts[..count].fill(1.0);
        let off2 = self.off2(&self.plane(&counts, count as f64)?);
        let mut as_far = [0.0; N];
        for other in &off2[..count] {
            for (as_far, off2) in as_far.iter_mut().zip(&off2) {
                *as_far += if other >= off2 { 1.0 } else { 0.0 };
            }
        }
        // Of those that are as far off as one another all are kept.
        let left_out = (count / 4).min(count - FEWEST) as f64;
        for (counts, as_far) in counts[..count].iter_mut().zip(&as_far) {
            *counts = if *as_far > left_out { 1.0 } else { 0.0 };
        }
        let kept = counts.iter().sum::<f64>();
        let plane = self.plane(&counts, kept)?;
        let off2 = self.off2(&plane);
        let squares: f64 = off2.iter().zip(&counts).map(|(off2, counts)| off2 * counts).sum();
        Some(Fit { plane, scatter_mm2: squares / (kept - 3.0) })
    }

    /// Squares of the distances of all points from a plane along z, mm².
    #[inline(always)]
    fn off2(&self, plane: &Plane) -> [f64; N] {
        let [x0, y0, z0] = [0, 1, 2].map(|axis| plane.origin_mm[axis] - self.origin_mm[axis]);
        let ([sx, sy], mut off2) = (plane.slopes, [0.0; N]);
        for (off2, ((x, y), z)) in off2.iter_mut().zip(self.x.iter().zip(&self.y).zip(&self.z)) {
            let off = (z - z0) - sx * (x - x0) - sy * (y - y0);
            *off2 = off * off;
        }
        off2
    }

    /// The plane `z = z₀ + s·(x − x₀)` through those points that count, by least squares; `None` if they stand in one place.
    ///
    /// Points in a line tell the slope along it alone. Their errors lie along their chief rays, so that a plane through them
    /// and the camera would seem to be as good as any: nothing is seen of a surface that stands edge on.
    #[inline(always)]
    fn plane(&self, counts: &[f64; N], count: f64) -> Option<Plane> {
        const LINE: f64 = 1e-5;
        let [x, y, z, counts] = [&self.x, &self.y, &self.z, counts].map(|column| column.as_chunks::<LANES>().0);
        let mut sums = [[0.0; LANES]; 8];
        for chunk in 0..N / LANES {
            for lane in 0..LANES {
                let (x, y) = (counts[chunk][lane] * x[chunk][lane], counts[chunk][lane] * y[chunk][lane]);
                let z = counts[chunk][lane] * z[chunk][lane];
                sums[0][lane] += x;
                sums[1][lane] += y;
                sums[2][lane] += z;
                sums[3][lane] += x * x;
                sums[4][lane] += x * y;
                sums[5][lane] += y * y;
                sums[6][lane] += x * z;
                sums[7][lane] += y * z;
            }
        }
        let mut totals = [0.0; 8];
        for (sum, lanes) in totals.iter_mut().zip(&sums) {
            *sum = total(lanes);
        }
        let [x, y, z, xx, xy, yy, xz, yz] = totals;
        let share = 1.0 / count;
        let [mx, my, mz] = [share * x, share * y, share * z];
        let [xx, xy, yy] = [xx - mx * x, xy - mx * y, yy - my * y];
        let [xz, yz] = [xz - mx * z, yz - my * z];
        let origin_mm = [self.origin_mm[0] + mx, self.origin_mm[1] + my, self.origin_mm[2] + mz];
        let determinant = xx * yy - xy * xy;
        if determinant > LINE * (xx + yy) * (xx + yy) {
            let slopes = [(yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant];
            let plane = Plane { origin_mm, slopes, variance: xx.max(yy) / determinant };
            if !plane.is_edge_on() {
                return Some(plane);
            }
        }
        Plane::along(origin_mm, [xx, xy, yy], [xz, yz])
    }
}

/// A plane through points, and how they scatter about it.
#[derive(Debug, Clone, Copy)]
struct Fit {
    plane: Plane,
    scatter_mm2: f64,
}

impl Fit {
    fn is_believed(&self) -> bool {
        let [sx, sy] = self.plane.slopes;
        self.slope_std() < SLOPE_STD_MAX.max(SLOPE_SHARE_MAX * (sx * sx + sy * sy).sqrt())
    }

    /// Deviation of the steeper slope, from the scatter of the points: it must be the surface that is flat.
    fn slope_std(&self) -> f64 {
        (self.scatter_mm2 * self.plane.variance).sqrt()
    }
}

/// A plane `z = z₀ + s·(x − x₀)`.
#[derive(Debug, Clone, Copy)]
struct Plane {
    origin_mm: [f64; 3],
    slopes: [f64; 2],
    /// Larger of the slopes' variances for points that scatter by 1 mm about it, 1/mm².
    variance: f64,
}

impl Plane {
    /// That rises along a line through points alone, from their sums of products.
    fn along(origin_mm: [f64; 3], [xx, xy, yy]: [f64; 3], [xz, yz]: [f64; 2]) -> Option<Self> {
        // The larger eigenvalue of the points' spread, and the longer of two forms of its vector.
        let spread = 0.5 * (xx + yy) + (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        let [along_x, along_y] = if xx > yy { [spread - yy, xy] } else { [xy, spread - xx] };
        let slope = (along_x * xz + along_y * yz) / (spread * (along_x * along_x + along_y * along_y));
        let slopes = [slope * along_x, slope * along_y];
        slope.is_finite().then_some(Self { origin_mm, slopes, variance: 1.0 / spread })
    }

    /// Whether dots on it would look like lines.
    fn is_edge_on(&self) -> bool {
        const FLATTEST: f64 = 0.2;
        let ([x_mm, y_mm, z_mm], [sx, sy]) = (self.origin_mm, self.slopes);
        let facing = z_mm - sx * x_mm - sy * y_mm;
        let across_mm2 = (1.0 + sx * sx + sy * sy) * (x_mm * x_mm + y_mm * y_mm + z_mm * z_mm);
        facing * facing < FLATTEST * FLATTEST * across_mm2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slopes_at(points_mm: &[[f64; 3]]) -> Vec<[f64; 2]> {
        let mut slopes = Slopes::default();
        slopes.lay_through(points_mm.iter().copied());
        slopes.get_to_know(2);
        let known = (0..points_mm.len()).map(|index| slopes.at_known(index).unwrap_or_default()).collect();
        let at_places: Vec<[f64; 2]> =
            points_mm.iter().map(|point_mm| slopes.at(*point_mm).unwrap_or_default()).collect();
        assert_eq!(at_places, known);
        known
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
    fn points_that_are_none_of_them_off_their_plane_are_all_kept() {
        let mut slopes = Slopes::default();
        slopes.lay_through(points(|_, _| 300.0).into_iter());
        assert_eq!(slopes.at([2.0, 3.0, 300.0]), Some([0.0; 2]));
    }

    #[test]
    fn scattered_points_have_none() {
        let slopes = slopes_at(&points(|x, y| 300.0 + 20.0 * (7.1 * x + 3.3 * y).sin()));
        assert!(slopes.iter().all(|slope| *slope == [0.0; 2]));
    }

    #[test]
    fn points_in_rough_places_take_the_plane_of_all() {
        let rough_mm = points(|x, y| 300.0 + 0.2 * x - 1.1 * y + 0.5 * (37.0 * x + 11.0 * y * y).sin());
        let mut slopes = Slopes::default();
        slopes.lay_through(rough_mm.iter().copied());
        slopes.get_to_know(2);
        slopes.renew(rough_mm.iter().map(|point_mm| (*point_mm, true)));
        let off = |index: usize| {
            let [sx, sy] = slopes.at_known(index).expect("a plane");
            (sx - 0.2).hypot(sy + 1.1)
        };
        // Nine that lie on some plane by chance are believed, but they are few.
        let far = (0..rough_mm.len()).filter(|index| off(*index) > 0.1).count();
        assert!(far <= 3, "{far}");
    }

    #[test]
    fn points_in_a_line_have_the_slope_along_it() {
        // Errors of depth move points along their rays.
        let point = |k: u32| {
            let (y, z) = (1.4 * f64::from(k) - 3.4, 300.0 + 0.5 * (1.4 * f64::from(k) - 3.4));
            let seen = 1.0 + 1e-4 * (7.0 * f64::from(k)).sin();
            [3.5, y, z].map(|mm| seen * mm)
        };
        for [sx, sy] in slopes_at(&(0..6).map(point).collect::<Vec<_>>()) {
            assert!(sx.abs() < 1e-3 && (sy - 0.5).abs() < 0.01, "{sx} {sy}");
        }
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
        let (mut slopes, mut near) = (Slopes::default(), Nearest::default());
        slopes.lay_through(known_mm.iter().copied());
        for place_mm in [[0.0, 0.0, 0.0], [200.0, 50.0, 0.0], [333.3, 97.1, 0.0], [900.0, -50.0, 0.0], [71.0, 3.0, 0.0]]
        {
            find_nearest(&slopes.points_mm, &slopes.cells, place_mm, &mut near);
            let distance_mm2 = |p: &[f64; 3]| (p[0] - place_mm[0]).powi(2) + (p[1] - place_mm[1]).powi(2);
            let mut all_mm2: Vec<f64> = known_mm.iter().map(distance_mm2).collect();
            all_mm2.sort_by(f64::total_cmp);
            let mut found_mm2: Vec<f64> = near.iter().map(|(distance_mm2, _)| *distance_mm2).collect();
            found_mm2[..NEAR].sort_by(f64::total_cmp);
            assert_eq!(found_mm2[..NEAR], all_mm2[..NEAR], "{place_mm:?}");
            found_mm2.sort_by(f64::total_cmp);
            assert_eq!(found_mm2, all_mm2[..AROUND], "{place_mm:?}");
        }
    }

    #[test]
    fn a_curved_surface_has_the_slopes_of_the_nearest_points() {
        let slopes = slopes_at(&points(|x, y| 300.0 + 0.2 * (x - 3.7) * (x - 3.7) + 0.1 * y));
        // In the middle of the sixth part of the grid, where the curve rises by 0.4 a mm.
        let [sx, sy] = slopes[14];
        assert!((sx - 0.4 * (3.0 - 3.7)).abs() < 0.05 && (sy - 0.1).abs() < 0.02, "{sx} {sy}");
    }
}
