//! Straight lines through a lens, by depth.

use crate::refraction::Vector;

/// A line by the depth below the plane of the groove peaks: no line of interest runs along that plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Line {
    /// Where it crosses the plane of the peaks, mm.
    pub(crate) at_peaks_mm: [f64; 2],
    /// Sideways per depth.
    pub(crate) slope: [f64; 2],
}

/// Which way light runs along a [`Line`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Heading {
    /// Depth grows: from the grooves into the lens.
    Down,
    /// Depth falls: from the flat face towards the grooves.
    Up,
}

impl Line {
    pub(crate) fn at(&self, depth_mm: f64) -> [f64; 2] {
        [0, 1].map(|k| self.at_peaks_mm[k] + self.slope[k] * depth_mm)
    }

    pub(crate) fn radius_mm(&self, depth_mm: f64) -> f64 {
        let [x, y] = self.at(depth_mm);
        // Not `hypot`, which guards against overflow at ten times the price.
        (x * x + y * y).sqrt()
    }

    /// Unit direction of light that runs along the line.
    pub(crate) fn direction(&self, heading: Heading) -> Vector {
        let [gx, gy] = self.slope;
        let step = heading.sign() / (gx * gx + gy * gy + 1.0).sqrt();
        [gx * step, gy * step, step]
    }

    /// The line through a point, or `None` if the direction does not have that heading.
    pub(crate) fn through([x, y, depth_mm]: Vector, direction: Vector, heading: Heading) -> Option<Self> {
        if direction[2] * heading.sign() <= 0.0 {
            return None;
        }
        let slope = [direction[0] / direction[2], direction[1] / direction[2]];
        Some(Self { at_peaks_mm: [x - slope[0] * depth_mm, y - slope[1] * depth_mm], slope })
    }
}

impl Heading {
    pub(crate) fn sign(self) -> f64 {
        match self {
            Self::Down => 1.0,
            Self::Up => -1.0,
        }
    }
}
