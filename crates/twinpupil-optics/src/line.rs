//! Straight lines through a lens, by depth.

use crate::refraction::Vector;

/// A line by the depth below the plane of the groove peaks: no line of interest runs along that plane.
///
/// Light may run along it either way. Snell's law does not care: turning a direction about turns the refracted one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Line {
    /// Where it crosses the plane of the peaks, mm.
    pub(crate) at_peaks_mm: [f64; 2],
    /// Sideways per depth.
    pub(crate) slope: [f64; 2],
}

impl Line {
    #[inline(always)]
    pub(crate) fn at(&self, depth_mm: f64) -> [f64; 2] {
        [0, 1].map(|k| self.at_peaks_mm[k] + self.slope[k] * depth_mm)
    }

    #[inline(always)]
    pub(crate) fn radius_mm(&self, depth_mm: f64) -> f64 {
        let [x, y] = self.at(depth_mm);
        // Not `hypot`, which guards against overflow at ten times the price.
        (x * x + y * y).sqrt()
    }

    /// Direction of growing depth, not of unit length.
    #[inline(always)]
    pub(crate) fn direction(&self) -> Vector {
        let [gx, gy] = self.slope;
        [gx, gy, 1.0]
    }

    /// The line through a point; NaN if depth does not grow along the direction.
    #[inline(always)]
    pub(crate) fn through([x, y, depth_mm]: Vector, direction: Vector) -> Self {
        let per_depth = if direction[2] > 0.0 { 1.0 / direction[2] } else { f64::NAN };
        let slope = [direction[0] * per_depth, direction[1] * per_depth];
        Self { at_peaks_mm: [x - slope[0] * depth_mm, y - slope[1] * depth_mm], slope }
    }
}

/// cos⁴ of the angle to the axis.
#[inline(always)]
pub(crate) fn cos_fourth([gx, gy]: [f64; 2]) -> f64 {
    let secant_squared = 1.0 + gx * gx + gy * gy;
    1.0 / (secant_squared * secant_squared)
}
