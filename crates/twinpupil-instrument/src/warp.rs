//! Where a lens's light lands beside that of an ideal one.

use crate::{Band, Correction, Displacement, Distortion};

/// The map of the ideal image plane of a band onto the plane across the axis at `sensor.distance_mm`: its `distortion`,
/// and what its `correction` adds.
#[derive(Debug, Clone, PartialEq)]
pub struct Warp {
    distortion: Distortion,
    displacement: Option<Displacement>,
}

impl Warp {
    /// That of a band.
    pub fn of(band: &Band) -> Self {
        let correction = band.correction.as_ref().filter(|correction| !correction.is_none());
        Self { distortion: band.distortion, displacement: correction.map(Correction::displacement) }
    }

    /// Whether every point stays where it is.
    pub fn is_none(&self) -> bool {
        self.distortion.is_none() && self.displacement.is_none()
    }

    /// Where an ideal image point (x, y) is imaged, mm.
    #[inline]
    pub fn map(&self, ideal: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.distortion.map(ideal);
        let Some(displacement) = &self.displacement else { return [x, y] };
        let [dx, dy] = displacement.at(ideal);
        [x + dx, y + dy]
    }

    /// How that changes with x and y, row by row.
    #[inline]
    pub(crate) fn jacobian(&self, ideal: [f64; 2]) -> [[f64; 2]; 2] {
        let [[a, b], [c, d]] = self.distortion.jacobian(ideal);
        let Some(displacement) = &self.displacement else { return [[a, b], [c, d]] };
        let [[da, db], [dc, dd]] = displacement.jacobian(ideal);
        [[a + da, b + db], [c + dc, d + dd]]
    }

    /// Second derivatives of both coordinates: by x twice, by x and y, by y twice.
    #[inline]
    pub(crate) fn second_derivatives(&self, ideal: [f64; 2]) -> [[f64; 3]; 2] {
        let mut second = self.distortion.second_derivatives(ideal);
        if let Some(displacement) = &self.displacement {
            let more = displacement.second_derivatives(ideal);
            second.iter_mut().flatten().zip(more.iter().flatten()).for_each(|(sum, more)| *sum += more);
        }
        second
    }
}
