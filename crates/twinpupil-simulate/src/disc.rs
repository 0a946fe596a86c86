//! How much of what a ray stands for a dot covers.

use multiversion::multiversion;
use twinpupil_optics::ObjectRays;

use crate::dot::Dot;
use crate::ray::Ray;

/// A dot as the rays of one band meet it.
///
/// A ray stands for all rays from anywhere in its pixel through its cell of the pupil, which cast two small squares
/// on the dot, one blurred by the other. Instead of sampling this shadow, the dot's edge is blurred by it: coverage
/// rises over a width w with w² = pixel² + cell², because a square of width w has the variance w²/12 along every
/// direction, and variances add.
///
/// ```text
/// coverage = C(d/w)        d depth of the ray behind the edge
/// ```
///
/// C is the share of a unit square beyond a straight edge with the direction of the nearest one: in focus, where it
/// matters, that is the pixel itself. The edge is bent, though, and on the average over a square it seems to lie farther
/// in. A ray of the slopes s that is moved by ε across the axis moves by `(ε + s κ·ε, κ·ε)` on a dot that rises by
/// (a, b), with `κ = (a, b)/(1 − a s_x − b s_y)`. So a tilted dot is an ellipse `δᵀ M δ < R²` to the rays, with
/// `M = 1 + s κᵀ + κ sᵀ + (1 + s²) κ κᵀ`. Along the normal n of its edge and along the edge itself M is Mₙ and Mₜ, the
/// distance ρ² = δᵀ M δ grows with the slope g = |M δ|/ρ, and to second order
///
/// ```text
/// D = (R − ρ)/g      d = D − (Mₙ − g²) D²/2gR − (R/g)(1 − √(1 − Mₜ w²/12 R²))
/// ```
///
/// That keeps the area of the dot, exactly if it is not tilted. On a dot of hardly a shadow's width, R < √2 w, C is
/// linear whatever the direction, and `d = (R² − ρ²)/2Rg`, which keeps the area of the dot because it depends on ρ². For
/// a dot smaller than the shadow, R < w, the rise does not reach 1 and the area would become `π R (R + w)²/(4 w)`, so
/// coverage is scaled to make up for that.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Disc {
    x_mm: f64,
    y_mm: f64,
    z_mm: f64,
    /// dz/dx and dz/dy on the dot.
    slope: [f64; 2],
    radius_mm: f64,
    /// Width of a ray's shadow across the axis, w.
    pub(crate) shadow_mm: f64,
    /// Unit vector along the rows of pixels.
    along_rows: [f64; 2],
}

impl Disc {
    /// `dot` seen by rays whose shadow on it is `shadow_mm` wide.
    pub(crate) fn new(dot: &Dot, shadow_mm: f64) -> Self {
        let ([x_mm, y_mm, z_mm], [nx, ny, nz]) = (dot.centre_mm, dot.normal);
        Self {
            x_mm,
            y_mm,
            z_mm,
            slope: [-nx / nz, -ny / nz],
            radius_mm: dot.radius_mm(),
            shadow_mm,
            along_rows: [1.0, 0.0],
        }
    }

    /// Seen by pixels whose rows run along a unit vector.
    pub(crate) fn turned(self, along_rows: [f64; 2]) -> Self {
        Self { along_rows, ..self }
    }

    /// Adds to `coverage`, ray by ray, how much this dot covers.
    pub(crate) fn add_coverage(&self, rays: &ObjectRays, coverage: &mut [f64]) {
        if self.slope == [0.0, 0.0] { add_flat(self, rays, coverage) } else { add_tilted(self, rays, coverage) }
    }

    /// How much this dot covers along one ray, and where the ray meets the dot's plane.
    #[inline(always)]
    pub(crate) fn coverage(&self, ray: &Ray) -> (f64, f64) {
        let z_mm = ray.meets_plane([self.x_mm, self.y_mm, self.z_mm], self.slope);
        let [x_mm, y_mm] = ray.at(z_mm);
        let (dx, dy, dz) = (x_mm - self.x_mm, y_mm - self.y_mm, z_mm - self.z_mm);
        let square_mm2 = dx * dx + dy * dy + dz * dz;
        (self.risen(square_mm2, &self.shadow(ray, [dx, dy, dz])), z_mm)
    }

    /// Sums over `rays` of weight × what [`Disc::sensitivity`] gives.
    pub(crate) fn light_sensitivity(&self, rays: &ObjectRays) -> [f64; 5] {
        sum_sensitivity(self, rays)
    }

    /// The shadow of a ray as the edge feels it that is nearest to where the ray meets the dot, from its centre.
    #[inline(always)]
    fn shadow(&self, ray: &Ray, [dx, dy, dz]: [f64; 3]) -> Shadow {
        let ([a, b], w, r) = (self.slope, self.shadow_mm, self.radius_mm);
        let (sx, sy) = (ray.slope_x, ray.slope_y);
        let tiny = f64::MIN_POSITIVE;
        let steepness = 1.0 / (1.0 - a * sx - b * sy);
        let (kx, ky) = (a * steepness, b * steepness);
        let along_ray = sx * dx + sy * dy + dz;
        let (gx, gy) = (dx + kx * along_ray, dy + ky * along_ray);
        let square = gx * gx + gy * gy + tiny;
        let growth = (square / (dx * dx + dy * dy + dz * dz + tiny)).sqrt();
        let is_small = self.is_small();
        let per_length = 1.0 / square.sqrt();
        let (nx, ny) = (gx * per_length, gy * per_length);
        let ray_square = 1.0 + sx * sx + sy * sy;
        let (rising, leaning) = (kx * nx + ky * ny, sx * nx + sy * ny);
        let along_normal = 1.0 + rising * (2.0 * leaning + ray_square * rising);
        let trace = 2.0 + 2.0 * (kx * sx + ky * sy) + ray_square * (kx * kx + ky * ky);
        let bend = (0.5 * (along_normal - growth * growth) * w / (growth * r)).clamp(0.0, Shadow::BEND_MAX);
        let [cos, sin] = self.along_rows;
        let (across, along) = ((cos * nx + sin * ny).abs(), (cos * ny - sin * nx).abs());
        let (long, short) = (across.max(along), across.min(along));
        Shadow {
            width_mm: w * growth,
            is_small,
            bend,
            inwards: self.inwards(trace - along_normal, growth * w),
            trapezoid: if is_small { Trapezoid::new(1.0, 0.0) } else { Trapezoid::new(long, short) },
        }
    }

    /// How much this dot covers along one ray, and the derivatives of that by the dot's x, y, z and diameter, per mm.
    ///
    /// A ray (x, y, 0) + t s, s = (s_x, s_y, 1), meets the plane through the centre c that rises by a and b along x and
    /// y at t = (c_z + a (x − c_x) + b (y − c_y))/D, D = 1 − a s_x − b s_y, so from the centre e = (x, y, 0) + t s − c
    ///
    /// ```text
    /// ½ ∂ρ²/∂c = (e·s)/D · (−a, −b, 1) − e
    /// ```
    ///
    /// The width of the blurred edge counts as fixed: changing it moves no edge.
    #[inline(always)]
    pub(crate) fn sensitivity(&self, ray: &Ray) -> [f64; 5] {
        let [a, b] = self.slope;
        let z_mm = ray.meets_plane([self.x_mm, self.y_mm, self.z_mm], self.slope);
        let [x_mm, y_mm] = ray.at(z_mm);
        let (dx, dy, dz) = (x_mm - self.x_mm, y_mm - self.y_mm, z_mm - self.z_mm);
        let (square_mm2, shadow) = (dx * dx + dy * dy + dz * dz, self.shadow(ray, [dx, dy, dz]));
        let full = self.full(shadow.width_mm);
        let depth = self.depth(square_mm2, &shadow);
        let (risen, density) = shadow.trapezoid.beyond(depth.widths);
        let coverage = risen * full;
        let along = (dx * ray.slope_x + dy * ray.slope_y + dz) / (1.0 - a * ray.slope_x - b * ray.slope_y);
        let per_half_square = density * full * depth.per_half_square;
        let growth = density * full * depth.per_radius + coverage * self.full_growth(shadow.width_mm);
        [
            coverage,
            per_half_square * (-a * along - dx),
            per_half_square * (-b * along - dy),
            per_half_square * (along - dz),
            0.5 * growth,
        ]
    }

    /// Coverage at the squared distance ρ² from the centre.
    #[inline(always)]
    fn risen(&self, square_mm2: f64, shadow: &Shadow) -> f64 {
        shadow.trapezoid.beyond(self.depth(square_mm2, shadow).widths).0 * self.full(shadow.width_mm)
    }

    /// How deep in the dot the squared distance ρ² from its centre is.
    #[inline(always)]
    fn depth(&self, square_mm2: f64, shadow: &Shadow) -> Depth {
        let (r, w) = (self.radius_mm, shadow.width_mm);
        let distance = square_mm2.max(f64::MIN_POSITIVE).sqrt();
        let straight = (r - distance) / w;
        let near = straight.clamp(-1.0, 1.0);
        let steepness = 1.0 - if near == straight { 2.0 * shadow.bend * near } else { 0.0 };
        let of_squares = (r * r - square_mm2) / (2.0 * r * w);
        if shadow.is_small {
            Depth {
                widths: of_squares,
                per_half_square: -1.0 / (r * w),
                per_radius: (r * r + square_mm2) / (2.0 * r * r * w),
            }
        } else {
            Depth {
                widths: straight - shadow.bend * near * near - shadow.inwards,
                per_half_square: -steepness / (distance * w),
                per_radius: steepness / w,
            }
        }
    }

    /// Whether it is hardly wider than the shadow of a ray.
    #[inline(always)]
    fn is_small(&self) -> bool {
        let ([a, b], w, r) = (self.slope, self.shadow_mm, self.radius_mm);
        r * r < 2.0 * w * w * (1.0 + a * a + b * b)
    }

    /// How much farther in its edge seems to a square, in widths of that along the dot, where M along the edge is Mₜ.
    #[inline(always)]
    fn inwards(&self, along_edge: f64, width_mm: f64) -> f64 {
        let (w, r) = (self.shadow_mm, self.radius_mm);
        let shrunk = (1.0 - along_edge * w * w / (12.0 * r * r)).max(0.0).sqrt();
        r * (1.0 - shrunk) / width_mm
    }

    /// What coverage is scaled with under a shadow of width w: 1 unless the dot is smaller than the shadow.
    #[inline(always)]
    fn full(&self, width_mm: f64) -> f64 {
        let (r, wide) = (self.radius_mm, width_mm.max(self.radius_mm));
        4.0 * r * wide / ((r + wide) * (r + wide))
    }

    /// Relative growth of [`Disc::full`] with the radius, per mm.
    #[inline(always)]
    fn full_growth(&self, width_mm: f64) -> f64 {
        let (r, wide) = (self.radius_mm, width_mm.max(self.radius_mm));
        1.0 / r - 2.0 / (r + wide)
    }
}

/// The square shadow of a ray before the edge of a dot.
#[derive(Debug, Clone, Copy)]
struct Shadow {
    /// Side of the square, along the dot across the edge.
    width_mm: f64,
    /// Whether the dot is hardly wider than that.
    is_small: bool,
    /// How much the depth of a place falls behind its distance from the edge along a ray from the centre, times the
    /// square of that, and how much farther in the edge seems, in widths.
    bend: f64,
    inwards: f64,
    trapezoid: Trapezoid,
}

impl Shadow {
    /// More than this is no small correction any more.
    const BEND_MAX: f64 = 0.25;
}

/// Depth behind an edge in widths of the shadow, and its change with half the squared distance from the centre and with
/// the radius, per mm² and per mm.
#[derive(Debug, Clone, Copy)]
struct Depth {
    widths: f64,
    per_half_square: f64,
    per_radius: f64,
}

/// A unit square, projected on the normal of a straight edge.
#[derive(Debug, Clone, Copy)]
struct Trapezoid {
    /// Half its longer and half its shorter side.
    outer: f64,
    inner: f64,
    /// Density between them, and its fall beyond the inner half.
    height: f64,
    fall: f64,
}

impl Trapezoid {
    /// An edge along the square's sides counts as nearly so.
    const SHORT_MIN: f64 = 1e-6;

    /// Before an edge whose normal has a longer and a shorter component.
    #[inline(always)]
    fn new(long: f64, short: f64) -> Self {
        let (long, short) = (long.max(Self::SHORT_MIN), short.max(Self::SHORT_MIN));
        // One division, as they are slow.
        let fall = 1.0 / (long * short);
        Self { outer: 0.5 * (long + short), inner: 0.5 * (long - short), height: short * fall, fall }
    }

    /// Share of the square beyond an edge that lies `depth` before its centre, and the change with the depth.
    #[inline(always)]
    fn beyond(&self, depth: f64) -> (f64, f64) {
        let size = depth.abs();
        let left = (self.outer - size).max(0.0);
        let is_inner = size <= self.inner;
        let tail = if is_inner { 0.5 - size * self.height } else { 0.5 * left * left * self.fall };
        let density = if is_inner { self.height } else { left * self.fall };
        (if depth > 0.0 { 1.0 - tail } else { tail }, density)
    }
}

/// On a dot across the axis `ρ² = δ²`, g = 1 and n = δ/ρ: of the shadow of a ray nothing depends on where it falls but the
/// direction of the edge.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn add_flat(disc: &Disc, rays: &ObjectRays, coverage: &mut [f64]) {
    let (r, w, [cos, sin]) = (disc.radius_mm, disc.shadow_mm, disc.along_rows);
    let (is_small, inwards, full) = (disc.is_small(), disc.inwards(1.0, w), disc.full(w));
    let (per_width, per_area) = (1.0 / w, 1.0 / (2.0 * r * w));
    let positions = rays.x_mm.iter().zip(&rays.y_mm);
    let slopes = rays.slope_x.iter().zip(&rays.slope_y);
    for ((coverage, (x_mm, y_mm)), (slope_x, slope_y)) in coverage.iter_mut().zip(positions).zip(slopes) {
        let (dx, dy) = (x_mm + slope_x * disc.z_mm - disc.x_mm, y_mm + slope_y * disc.z_mm - disc.y_mm);
        let square = dx * dx + dy * dy + f64::MIN_POSITIVE;
        let distance = square.sqrt();
        let per_distance = 1.0 / distance;
        let across = (cos * dx + sin * dy).abs() * per_distance;
        let along = (cos * dy - sin * dx).abs() * per_distance;
        let straight = Trapezoid::new(across.max(along), across.min(along));
        let trapezoid = if is_small { Trapezoid::new(1.0, 0.0) } else { straight };
        let depth = if is_small { (r * r - square) * per_area } else { (r - distance) * per_width - inwards };
        *coverage += trapezoid.beyond(depth).0 * full;
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn add_tilted(disc: &Disc, rays: &ObjectRays, coverage: &mut [f64]) {
    let positions = rays.x_mm.iter().zip(&rays.y_mm);
    let slopes = rays.slope_x.iter().zip(&rays.slope_y);
    for ((coverage, (x_mm, y_mm)), (slope_x, slope_y)) in coverage.iter_mut().zip(positions).zip(slopes) {
        let ray = Ray { x_mm: *x_mm, y_mm: *y_mm, slope_x: *slope_x, slope_y: *slope_y };
        *coverage += disc.coverage(&ray).0;
    }
}

/// Rays summed side by side, so that they vectorise.
const LANES: usize = 8;

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn sum_sensitivity(disc: &Disc, rays: &ObjectRays) -> [f64; 5] {
    let mut sums = [[0.0; LANES]; 5];
    for first in (0..rays.len()).step_by(LANES) {
        // The last rays may be fewer; the others weigh nothing.
        let padded = |values: &[f64]| -> [f64; LANES] {
            let mut lanes = [0.0; LANES];
            let values = &values[first..values.len().min(first + LANES)];
            lanes[..values.len()].copy_from_slice(values);
            lanes
        };
        let (x_mm, y_mm, weight) = (padded(&rays.x_mm), padded(&rays.y_mm), padded(&rays.weight));
        let (slope_x, slope_y) = (padded(&rays.slope_x), padded(&rays.slope_y));
        for lane in 0..LANES {
            let ray = Ray { x_mm: x_mm[lane], y_mm: y_mm[lane], slope_x: slope_x[lane], slope_y: slope_y[lane] };
            let values = disc.sensitivity(&ray);
            for (sums, value) in sums.iter_mut().zip(values) {
                // Positions of lost rays mean nothing and may be NaN.
                sums[lane] += if weight[lane] > 0.0 { weight[lane] * value } else { 0.0 };
            }
        }
    }
    sums.map(|lanes| lanes.iter().sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dot(diameter_mm: f64, tilt_deg: f64) -> Dot {
        let (sin, cos) = f64::to_radians(tilt_deg).sin_cos();
        Dot { centre_mm: [0.0, 0.0, 300.0], normal: [sin, 0.0, -cos], diameter_mm }
    }

    fn along_axis(x_mm: f64, y_mm: f64) -> Ray {
        Ray { x_mm, y_mm, slope_x: 0.0, slope_y: 0.0 }
    }

    /// Area seen along the axis, by parallel rays on a fine grid.
    fn area_mm2(disc: &Disc, half_width_mm: f64) -> f64 {
        let steps = 1000;
        let step_mm = 2.0 * half_width_mm / f64::from(steps);
        let place_mm = |k: i32| (f64::from(k) + 0.5) * step_mm - half_width_mm;
        let row = |j: i32| (0..steps).map(|i| disc.coverage(&along_axis(place_mm(i), place_mm(j))).0).sum::<f64>();
        (0..steps).map(row).sum::<f64>() * step_mm * step_mm
    }

    #[test]
    fn the_area_of_a_dot_is_kept_whatever_the_pixel() {
        for tilt_deg in [0.0, 30.0, 60.0_f64] {
            for shadow_mm in [0.01, 0.3, 0.5, 0.7, 3.0] {
                let disc = Disc::new(&dot(1.0, tilt_deg), shadow_mm);
                let expected_mm2 = std::f64::consts::PI * 0.25 * tilt_deg.to_radians().cos();
                let error = area_mm2(&disc, 1.4) / expected_mm2 - 1.0;
                assert!(error.abs() < 2e-4, "tilt {tilt_deg}, shadow {shadow_mm}: {error}");
            }
        }
    }

    #[test]
    fn coverage_is_the_share_of_the_rays_of_a_square_that_meet_the_dot() {
        const STEPS: i32 = 400;
        let shadow_mm = 0.0115;
        for (tilt_deg, slope_x) in [(0.0, 0.02), (60.0, 0.02), (-60.0, 0.02), (45.0, -0.01)] {
            let disc = Disc::new(&dot(1.0, tilt_deg), shadow_mm);
            let dot = dot(1.0, tilt_deg);
            let meets = |x_mm: f64, y_mm: f64| {
                // All rays of the square are parallel; where they cross the dot's depth is what moves them.
                let ray = Ray { x_mm: x_mm - 300.0 * slope_x, y_mm, slope_x, slope_y: 0.0 };
                let z_mm = ray.meets_plane(dot.centre_mm, disc.slope);
                let [x_mm, y_mm] = ray.at(z_mm);
                (ray, x_mm * x_mm + y_mm * y_mm + (z_mm - 300.0).powi(2) < 0.25)
            };
            for angle_rad in [0.0, 0.3, 0.8, 1.2, 1.5, 2.5, 3.1_f64] {
                // The rim as these rays see it, and places up to half a square beside it.
                let rim = |scale: f64| meets(scale * angle_rad.cos(), scale * angle_rad.sin()).1;
                let (mut inner, mut outer) = (0.1, 0.9);
                for _ in 0..50 {
                    let middle = 0.5 * (inner + outer);
                    if rim(middle) { inner = middle } else { outer = middle }
                }
                for beside in [-0.4, -0.1, 0.0, 0.3] {
                    let scale = inner + beside * shadow_mm;
                    let (x_mm, y_mm) = (scale * angle_rad.cos(), scale * angle_rad.sin());
                    let offset = |place: f64| ((place + 0.5) / f64::from(STEPS) - 0.5) * shadow_mm;
                    // Rows are shifted against each other, so that no edge follows the grid.
                    let shift = |j: i32| (0.618 * f64::from(j)).fract() - 0.5;
                    let row = |j: i32| {
                        let place = |i: i32| (x_mm + offset(f64::from(i) + shift(j)), y_mm + offset(f64::from(j)));
                        (0..STEPS).map(place).filter(|(x_mm, y_mm)| meets(*x_mm, *y_mm).1).count()
                    };
                    let expected = (0..STEPS).map(row).sum::<usize>() as f64 / f64::from(STEPS * STEPS);
                    let found = disc.coverage(&meets(x_mm, y_mm).0).0;
                    assert!((found - expected).abs() < 2e-3, "{tilt_deg}, {angle_rad}, {beside}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn both_loops_agree_with_one_ray_at_a_time() {
        let rays = ObjectRays {
            x_mm: vec![0.1, -3.0, 2.5, 0.5, 0.49],
            y_mm: vec![0.2, 0.0, -0.1, 0.0, 0.0],
            slope_x: vec![0.0, 0.01, -0.009, 0.0, 0.0],
            slope_y: vec![0.0; 5],
            weight: vec![1.0; 5],
        };
        for tilt_deg in [0.0, 45.0] {
            let disc = Disc::new(&dot(1.0, tilt_deg), 0.05);
            let mut coverage = vec![0.25; 5];
            disc.add_coverage(&rays, &mut coverage);
            for (i, together) in coverage.iter().enumerate() {
                let alone = disc.coverage(&Ray::of(&rays, i)).0;
                assert!((together - 0.25 - alone).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn derivatives_are_those_of_the_coverage() {
        let step_mm = 1e-6;
        let ray = Ray { x_mm: -8.63, y_mm: 0.22, slope_x: 0.03, slope_y: -0.0001 };
        for (tilt_deg, shadow_mm) in [(0.0, 0.5), (0.0, 2.0), (50.0, 0.6), (-50.0, 0.5), (50.0, 3.0)] {
            let moved = |unknown: usize, step_mm: f64| {
                let mut dot = dot(1.0, tilt_deg);
                match unknown {
                    3 => dot.diameter_mm += step_mm,
                    axis => dot.centre_mm[axis] += step_mm,
                }
                // The blur of the edge is held as it is where the ray meets the dot.
                let disc = Disc::new(&dot, 1.0);
                let z_mm = ray.meets_plane(dot.centre_mm, disc.slope);
                let [x_mm, y_mm] = ray.at(z_mm);
                let e = [x_mm - dot.centre_mm[0], y_mm - dot.centre_mm[1], z_mm - dot.centre_mm[2]];
                (disc, e.iter().map(|c| c * c).sum::<f64>(), e)
            };
            let here = Disc::new(&dot(1.0, tilt_deg), shadow_mm);
            let [dx, dy, dz] = moved(0, 0.0).2;
            let shadow = here.shadow(&ray, [dx, dy, dz]);
            let found = here.sensitivity(&ray);
            assert_eq!(found[0], here.coverage(&ray).0);
            assert!(found[0] > 0.05 && found[0] < 0.95, "{found:?}");
            for unknown in 0..4 {
                let at = |step_mm: f64| {
                    let (disc, square_mm2, _) = moved(unknown, step_mm);
                    disc.risen(square_mm2, &shadow)
                };
                let expected = (at(step_mm) - at(-step_mm)) / (2.0 * step_mm);
                let error = (found[1 + unknown] - expected).abs();
                assert!(error < 1e-6, "tilt {tilt_deg}, {unknown}: {} is not {expected}", found[1 + unknown]);
            }
        }
    }

    #[test]
    fn a_tilted_dot_is_met_where_the_ray_crosses_its_plane() {
        let disc = Disc::new(&dot(1.0, 45.0), 0.01);
        let (coverage, z_mm) = disc.coverage(&along_axis(0.2, 0.0));
        assert!((z_mm - 300.2).abs() < 1e-12 && coverage == 1.0);
        // The rim lies at x = R cos 45°; the pixel's square sees it farther in by w²/12 times half its curvature there.
        let rim_mm = 0.5 * 0.5_f64.sqrt();
        let inwards_mm = 0.5 * rim_mm / (0.5 * 0.5) * 0.01 * 0.01 / 12.0;
        let (rim, _) = disc.coverage(&along_axis(rim_mm - inwards_mm, 0.0));
        assert!((rim - 0.5).abs() < 1e-6, "{rim}");
    }
}
