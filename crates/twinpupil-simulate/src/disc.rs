//! How much of what a ray stands for a dot covers.

use multiversion::multiversion;
use twinpupil_optics::ObjectRays;

use crate::dot::Dot;
use crate::ray::Ray;

/// A dot as the rays of one band meet it.
///
/// A ray stands for all rays from anywhere in its pixel through its cell of the pupil, which cast two small squares
/// on the dot, one blurred by the other. Instead of sampling this shadow, the dot's edge is blurred by it: coverage
/// rises linearly over a width w with w² = pixel² + cell², because a square of width w has the variance w²/12 along
/// every direction, like the linear rise, and variances add.
///
/// ```text
/// coverage = ½ + (R² − ρ²)/(2 R w), from 0 to 1        ρ distance of the ray from the centre, R radius of the dot
/// ```
///
/// Being linear in ρ² it keeps the area of the dot exactly. For a dot smaller than the shadow, R < w, the rise
/// does not reach 1 and the area would become `π R (R + w)²/(4 w)`, so coverage is scaled to make up for that.
///
/// On a tilted dot the shadow is wider along the tilt; w is its width in the direction of the nearest edge.
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
}

impl Disc {
    /// `dot` seen by rays whose shadow on it is `shadow_mm` wide.
    pub(crate) fn new(dot: &Dot, shadow_mm: f64) -> Self {
        let ([x_mm, y_mm, z_mm], [nx, ny, nz]) = (dot.centre_mm, dot.normal);
        Self { x_mm, y_mm, z_mm, slope: [-nx / nz, -ny / nz], radius_mm: dot.radius_mm(), shadow_mm }
    }

    /// Adds to `coverage`, ray by ray, how much this dot covers.
    pub(crate) fn add_coverage(&self, rays: &ObjectRays, coverage: &mut [f64]) {
        if self.slope == [0.0, 0.0] { add_flat(self, rays, coverage) } else { add_tilted(self, rays, coverage) }
    }

    /// How much this dot covers along one ray, and where the ray meets the dot's plane.
    #[inline(always)]
    pub(crate) fn coverage(&self, ray: &Ray) -> (f64, f64) {
        let z_mm = ray.meets_plane([self.x_mm, self.y_mm, self.z_mm], self.slope);
        let ([x_mm, y_mm], [a, b]) = (ray.at(z_mm), self.slope);
        let (dx, dy, dz) = (x_mm - self.x_mm, y_mm - self.y_mm, z_mm - self.z_mm);
        let square_mm2 = dx * dx + dy * dy + dz * dz;
        // Length on the dot of a step across the axis, straight towards the nearest edge; 1 in the centre.
        let (gx, gy) = (dx + a * dz, dy + b * dz);
        let tiny = f64::MIN_POSITIVE;
        let stretch = ((gx * gx + gy * gy + tiny) / (square_mm2 + tiny)).sqrt();
        (self.risen(square_mm2, self.shadow_mm * stretch), z_mm)
    }

    /// Coverage at the squared distance ρ² from the centre, under a shadow of width w.
    #[inline(always)]
    fn risen(&self, square_mm2: f64, width_mm: f64) -> f64 {
        let (r, w) = (self.radius_mm, width_mm);
        let coverage = (0.5 + (r * r - square_mm2) * (0.5 / (r * w))).clamp(0.0, 1.0);
        // 1 unless the dot is smaller than the shadow.
        let wide = w.max(r);
        coverage * (4.0 * r * wide / ((r + wide) * (r + wide)))
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn add_flat(disc: &Disc, rays: &ObjectRays, coverage: &mut [f64]) {
    let positions = rays.x_mm.iter().zip(&rays.y_mm);
    let slopes = rays.slope_x.iter().zip(&rays.slope_y);
    for ((coverage, (x_mm, y_mm)), (slope_x, slope_y)) in coverage.iter_mut().zip(positions).zip(slopes) {
        let ray = Ray { x_mm: *x_mm, y_mm: *y_mm, slope_x: *slope_x, slope_y: *slope_y };
        let [x_mm, y_mm] = ray.at(disc.z_mm);
        let (dx, dy) = (x_mm - disc.x_mm, y_mm - disc.y_mm);
        *coverage += disc.risen(dx * dx + dy * dy, disc.shadow_mm);
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
    fn both_loops_agree_with_one_ray_at_a_time() {
        let rays = ObjectRays {
            x_mm: vec![0.1, -3.0, 2.5, 0.5, f64::NAN],
            y_mm: vec![0.2, 0.0, -0.1, 0.0, 0.0],
            slope_x: vec![0.0, 0.01, -0.009, 0.0, 0.0],
            slope_y: vec![0.0; 5],
            weight: vec![1.0; 5],
        };
        for tilt_deg in [0.0, 45.0] {
            let disc = Disc::new(&dot(1.0, tilt_deg), 0.05);
            let mut coverage = vec![0.25; 5];
            disc.add_coverage(&rays, &mut coverage);
            for (i, together) in coverage[..4].iter().enumerate() {
                let alone = disc.coverage(&Ray::of(&rays, i)).0;
                assert!((together - 0.25 - alone).abs() < 1e-12);
            }
            assert!(coverage[4].is_nan());
        }
    }

    #[test]
    fn a_tilted_dot_is_met_where_the_ray_crosses_its_plane() {
        let disc = Disc::new(&dot(1.0, 45.0), 0.01);
        let (coverage, z_mm) = disc.coverage(&along_axis(0.2, 0.0));
        assert!((z_mm - 300.2).abs() < 1e-12 && coverage == 1.0);
        // The rim lies at x = R cos 45°.
        let (rim, _) = disc.coverage(&along_axis(0.5 * 0.5_f64.sqrt(), 0.0));
        assert!((rim - 0.5).abs() < 1e-9);
    }
}
