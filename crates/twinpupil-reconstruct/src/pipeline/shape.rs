//! What the shape of a feature that is no disc leaves open of its place.

use super::{Placed, Reconstructor};
use crate::model::Disc;
use crate::position::model_position;

/// A surface may lean either way by about 45° where nothing tells its slopes.
const SLOPE_STD: f64 = 1.0;

/// A point in place of a disc, mm.
const POINT_MM: f64 = 1e-6;

impl Reconstructor {
    /// Adds to the covariance of a point that is read by moments how far it moves if its shape is another than the disc that
    /// was taken for it: all light in its middle, so that masks shade no part of it more than others, and, where no surface is
    /// known, a disc that leans. Each is taken as one deviation.
    pub(super) fn doubt_shape(&self, placed: &mut Placed, slopes: Option<[f64; 2]>) {
        let sightings = self.sightings(placed);
        let point = &mut placed.point;
        let (own, diameter_mm) = (slopes.unwrap_or_default(), point.diameter_mm);
        let start_mm = point.position_mm;
        let mut doubt = |disc: Disc, share: f64| {
            let Some(other) = model_position(&self.model, &sightings, &disc, start_mm) else { return };
            let off_mm: [f64; 3] = std::array::from_fn(|axis| other.position_mm[axis] - start_mm[axis]);
            for (row, a_mm) in point.covariance_mm2.iter_mut().zip(off_mm) {
                row.iter_mut().zip(off_mm).for_each(|(covariance, b_mm)| *covariance += share * a_mm * b_mm);
            }
        };
        doubt(Disc { diameter_mm: POINT_MM, slopes: own }, 1.0);
        if slopes.is_none() {
            // Both ways along each axis.
            for slope in [SLOPE_STD, -SLOPE_STD] {
                doubt(Disc { diameter_mm, slopes: [slope, 0.0] }, 0.5);
                doubt(Disc { diameter_mm, slopes: [0.0, slope] }, 0.5);
            }
        }
        point.std_mm = std::array::from_fn(|axis| point.covariance_mm2[axis][axis].sqrt());
    }
}
