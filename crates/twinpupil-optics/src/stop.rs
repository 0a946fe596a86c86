//! An aperture as one band meets it: rings that pass.

use twinpupil_instrument::{Annulus, Aperture};

use crate::RayFate;
use crate::linear::Disc;

/// The rings of an aperture that pass a band.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Stop {
    /// Index in the instrument's list.
    pub(crate) aperture: usize,
    /// Behind the rear principal plane, mm.
    pub(crate) position_mm: f64,
    pub(crate) centre_mm: [f64; 2],
    pub(crate) rings: Vec<Annulus>,
}

impl Stop {
    pub(crate) fn new(aperture: usize, mask: &Aperture, band: &str) -> Self {
        let (position_mm, centre_mm) = (mask.position_mm, mask.centre_mm);
        Self { aperture, position_mm, centre_mm, rings: mask.annuli(band) }
    }

    /// Whether everything passes everywhere.
    pub(crate) fn is_open(&self) -> bool {
        self.rings.iter().any(|ring| ring.inner_mm == 0.0 && ring.outer_mm == f64::INFINITY)
    }

    /// Area that passes within a disc about the centre, relative to that disc.
    pub(crate) fn filled_fraction(&self, radius_mm: f64) -> f64 {
        let squares = self.rings.iter().map(|ring| ring.outer_mm.min(radius_mm).powi(2) - ring.inner_mm.powi(2));
        squares.sum::<f64>() / (radius_mm * radius_mm)
    }

    /// Whether it passes one whole disc about its centre, and nothing else.
    pub(crate) fn is_full(&self) -> bool {
        self.rings.len() == 1 && self.rings[0].inner_mm == 0.0
    }

    /// Stops a ray at this position in the aperture's plane, or lets it pass.
    pub(crate) fn check(&self, position_mm: [f64; 2]) -> Result<(), RayFate> {
        let (x, y) = (position_mm[0] - self.centre_mm[0], position_mm[1] - self.centre_mm[1]);
        let square = x * x + y * y;
        if self.rings.iter().any(|ring| holds(ring, square)) {
            Ok(())
        } else {
            Err(RayFate::Blocked { aperture: self.aperture })
        }
    }

    /// Whether a whole disc in the aperture's plane passes, short of rounding.
    pub(crate) fn passes_disc(&self, disc: &Disc) -> bool {
        let distance_mm = (disc.centre[0] - self.centre_mm[0]).hypot(disc.centre[1] - self.centre_mm[1]);
        let (nearest_mm, farthest_mm) = (distance_mm - disc.radius, distance_mm + disc.radius);
        let slack_mm = 1e-12 * farthest_mm;
        self.rings.iter().any(|ring| {
            let inside = farthest_mm + slack_mm < ring.outer_mm;
            inside && (ring.inner_mm == 0.0 || nearest_mm - slack_mm > ring.inner_mm)
        })
    }
}

/// Whether a squared distance from the centre lies in a ring.
#[inline(always)]
pub(crate) fn holds(ring: &Annulus, square_mm2: f64) -> bool {
    // No short circuit: both comparisons are cheaper than a branch, and vectorise.
    (square_mm2 >= ring.inner_mm * ring.inner_mm) & (square_mm2 < ring.outer_mm * ring.outer_mm)
}
