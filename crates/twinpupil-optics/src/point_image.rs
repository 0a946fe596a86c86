//! What the optics make of one object point.

use twinpupil_instrument::{ImagePoint, PointSpread};

/// The image of a point: how much light there is and where its centroid lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointImage {
    /// Light that arrives, relative to the unclipped pupil of the ideal lens.
    pub throughput: f64,
    /// Upright centroid of the light on the sensor; of the unclipped pupil if no light arrives.
    pub centroid: ImagePoint,
    /// How much farther out than the ideal lens the lens images the point through the whole pupil, as pixels see it: a
    /// mean in which rays count alike, wherever they spread the light of its surroundings.
    pub aberration_mm: [f64; 2],
    /// How the lens spreads the light of the whole pupil, with x along the radius from the axis; as an ideal lens does where it
    /// is not known.
    pub spread: PointSpread,
}
