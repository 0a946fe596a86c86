//! One ray in object space.

use twinpupil_optics::ObjectRays;

/// A straight line by its position in the plane z = 0 and its slopes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ray {
    pub(crate) x_mm: f64,
    pub(crate) y_mm: f64,
    pub(crate) slope_x: f64,
    pub(crate) slope_y: f64,
}

impl Ray {
    /// Ray `index` of many.
    pub(crate) fn of(rays: &ObjectRays, index: usize) -> Self {
        Self {
            x_mm: rays.x_mm[index],
            y_mm: rays.y_mm[index],
            slope_x: rays.slope_x[index],
            slope_y: rays.slope_y[index],
        }
    }

    /// Where the ray is at distance z.
    #[inline(always)]
    pub(crate) fn at(&self, z_mm: f64) -> [f64; 2] {
        [self.x_mm + self.slope_x * z_mm, self.y_mm + self.slope_y * z_mm]
    }

    /// Distance z at which the ray meets the plane through `point_mm` with the slopes dz/dx and dz/dy.
    #[inline(always)]
    pub(crate) fn meets_plane(&self, point_mm: [f64; 3], slope: [f64; 2]) -> f64 {
        let ([x_mm, y_mm, z_mm], [a, b]) = (point_mm, slope);
        let rise_mm = a * (self.x_mm - x_mm) + b * (self.y_mm - y_mm);
        (z_mm + rise_mm) / (1.0 - a * self.slope_x - b * self.slope_y)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_ray_is_on_the_plane_where_it_meets_it(
            x_mm in -9.0..9.0_f64, slope_x in -0.1..0.1_f64, slope_y in -0.1..0.1_f64,
            a in -2.0..2.0_f64, b in -2.0..2.0_f64,
        ) {
            let ray = Ray { x_mm, y_mm: 1.5, slope_x, slope_y };
            let z_mm = ray.meets_plane([3.0, -2.0, 300.0], [a, b]);
            let [x_mm, y_mm] = ray.at(z_mm);
            prop_assert!((z_mm - 300.0 - a * (x_mm - 3.0) - b * (y_mm + 2.0)).abs() < 1e-9);
        }
    }
}
