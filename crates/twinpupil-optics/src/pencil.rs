//! All rays of one band from a small disc on the sensor, held together.

use twinpupil_instrument::ImagePoint;

use crate::Footprint;
use crate::linear::{Disc, Linear};

/// All rays of one band from a disc on the sensor: the rays of an ideal lens, moved sideways and tilted together, and
/// how far the true ones stray from these at most.
///
/// Ideal rays are linear in where they start, which makes the circles that hold them cheap to find for any distance
/// and for any part of the disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pencil {
    pub(crate) centre: ImagePoint,
    pub(crate) radius_mm: f64,
    /// Position in the plane z = 0, mm.
    pub(crate) lens: Linear,
    /// Slope in object space.
    pub(crate) slope: Linear,
    /// How far the true rays are from there, mm.
    pub(crate) stray_mm: f64,
    /// How far the true slopes are from there.
    pub(crate) stray_slope: f64,
}

impl Pencil {
    /// The rays from a smaller disc within the disc.
    pub fn part(&self, centre: ImagePoint, radius_mm: f64) -> Self {
        Self { centre, radius_mm, ..*self }
    }

    /// Circle at distance `z_mm` > 0 in object space that holds every ray of the pencil.
    pub fn footprint(&self, z_mm: f64) -> Footprint {
        let ideal = self.lens.plus(self.slope.scaled(z_mm));
        let Disc { centre: [x_mm, y_mm], radius } = ideal.over(self.centre, self.radius_mm);
        // Rounding must not let a ray escape.
        let slack_mm = 1e-12 * (x_mm.abs() + y_mm.abs() + radius);
        let stray_mm = self.stray_mm + self.stray_slope * z_mm;
        Footprint { x_mm, y_mm, radius_mm: radius + slack_mm + stray_mm }
    }
}
