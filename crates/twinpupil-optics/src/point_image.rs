//! What the optics make of one object point.

use twinpupil_instrument::ImagePoint;

/// The image of a point: how much light there is and where its centroid lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointImage {
    /// Light that arrives, relative to the unclipped pupil of the ideal lens.
    pub throughput: f64,
    /// Upright centroid of the light on the sensor; of the unclipped pupil if no light arrives.
    pub centroid: ImagePoint,
}
