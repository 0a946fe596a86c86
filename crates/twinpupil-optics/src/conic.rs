//! Conics of revolution.

use crate::line::Line;
use crate::refraction::Vector;

/// A conic of revolution about the axis: depth s behind its vertex at radius r.
///
/// ```text
/// c (r² + (1 + k) s²) − 2 s = 0        s = c r² / (1 + √(1 − (1 + k) c² r²))
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Conic {
    /// Depth of the vertex, mm.
    pub(crate) vertex_mm: f64,
    /// c, 1/mm.
    pub(crate) curvature_per_mm: f64,
    /// k: −n² for the hyperbola and −1/n² for the ellipse that focus a parallel beam, 0 for a sphere.
    pub(crate) conic_constant: f64,
}

impl Conic {
    /// Depth at a radius, mm; NaN beyond the rim of an ellipsoid.
    pub(crate) fn depth_mm(&self, r_mm: f64) -> f64 {
        let (c, q) = (self.curvature_per_mm, 1.0 + self.conic_constant);
        self.vertex_mm + c * r_mm * r_mm / (1.0 + (1.0 - q * (c * r_mm).powi(2)).sqrt())
    }

    /// Growth of the depth with the radius.
    pub(crate) fn slope(&self, r_mm: f64) -> f64 {
        let [x, _, z] = self.normal([r_mm, 0.0, self.depth_mm(r_mm)]);
        x / -z
    }

    /// Depth at which a line meets the sheet about the vertex; NaN if it does not.
    #[inline(always)]
    pub(crate) fn meets(&self, line: &Line) -> f64 {
        let (c, q, v) = (self.curvature_per_mm, 1.0 + self.conic_constant, self.vertex_mm);
        let ([x, y], [gx, gy]) = (line.at_peaks_mm, line.slope);
        let a = c * (gx * gx + gy * gy + q);
        let half_b = c * (x * gx + y * gy - q * v) - 1.0;
        let constant = c * (x * x + y * y + q * v * v) + 2.0 * v;
        // This root goes over into that of the plane, half_b → −1, as the curvature vanishes.
        let depth_mm = constant / ((half_b * half_b - a * constant).sqrt() - half_b);
        if half_b < 0.0 { depth_mm } else { f64::NAN }
    }

    /// A normal at a point on the conic, not of unit length.
    #[inline(always)]
    pub(crate) fn normal(&self, [x, y, depth_mm]: Vector) -> Vector {
        let c = self.curvature_per_mm;
        [c * x, c * y, c * (1.0 + self.conic_constant) * (depth_mm - self.vertex_mm) - 1.0]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_line_meets_the_conic_on_the_conic(
            c in -0.03..0.03_f64, k in -3.0..1.0_f64, v in -1.0..1.0_f64,
            x in -15.0..15.0_f64, y in -15.0..15.0_f64, gx in -0.3..0.3_f64, gy in -0.3..0.3_f64,
        ) {
            let conic = Conic { vertex_mm: v, curvature_per_mm: c, conic_constant: k };
            let line = Line { at_peaks_mm: [x, y], slope: [gx, gy] };
            let depth_mm = conic.meets(&line);
            let [px, py] = line.at(depth_mm);
            prop_assert!((conic.depth_mm(px.hypot(py)) - depth_mm).abs() < 1e-11);
            // The normal is that of a finite difference of the depth along x.
            let step = 1e-5;
            let slope = (conic.depth_mm((px + step).hypot(py)) - conic.depth_mm((px - step).hypot(py))) / (2.0 * step);
            let normal = conic.normal([px, py, depth_mm]);
            prop_assert!((normal[0] / -normal[2] - slope).abs() < 1e-7);
        }
    }
}
