//! The two kinds of image position that must not be confused.

/// A position on the sensor in pixels: the centre of the first pixel is (0, 0), u to the right, v down.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PixelPoint {
    /// Column, px.
    pub u: f64,
    /// Row, px.
    pub v: f64,
}

/// A position on the sensor in mm from the optical axis, in the upright frame: +x is +u, +y is +v.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ImagePoint {
    /// Towards +u, mm.
    pub x_mm: f64,
    /// Towards +v, mm.
    pub y_mm: f64,
}

impl ImagePoint {
    /// Distance from the axis, mm.
    pub fn radius_mm(self) -> f64 {
        self.x_mm.hypot(self.y_mm)
    }

    /// Azimuth in (−π, π], from +x towards +y.
    pub fn azimuth_rad(self) -> f64 {
        self.y_mm.atan2(self.x_mm)
    }
}
