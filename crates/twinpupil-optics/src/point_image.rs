//! What the optics make of one object point.

use twinpupil_instrument::{ImagePoint, PointSpread};

/// The image of a point: how much light there is and where its centroid lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointImage {
    /// Light that arrives, relative to the unclipped pupil of the ideal lens.
    pub throughput: f64,
    /// Upright centroid of the light on the sensor; of the unclipped pupil if no light arrives.
    pub centroid: ImagePoint,
    /// How the lens spreads the light of the whole pupil, with x along the radius from the axis; as an ideal lens does where it
    /// is not known.
    pub spread: PointSpread,
}
