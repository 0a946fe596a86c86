//! Rays through single places of the pupil.

use super::Sight;
use crate::Ray;

/// What a ray does beside the chief ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviation {
    /// Where it meets the image, from the chief ray, mm.
    pub error_mm: [f64; 2],
    /// Optical path difference: how far the wavefront is ahead of the reference sphere, mm.
    pub opd_mm: f64,
}

/// Where light close to the chief ray comes together, along the axis from where the chief ray meets the image, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foci {
    /// Light that is spread along y, in the plane of the field.
    pub tangential_mm: f64,
    /// Light that is spread along x, across it.
    pub sagittal_mm: f64,
}

/// How far beside the chief ray rays are whose crossing is the focus, in radii of the pupil: what they miss it by is of second
/// order, and rounding takes 1e-13 over this.
const CLOSE: f64 = 1e-3;

impl Sight<'_> {
    /// What rays through places of the pupil do; `None` for those that do not arrive.
    pub fn deviations(&self, places: &[[f64; 2]]) -> Vec<Option<Deviation>> {
        self.image_rays(places).into_iter().map(|ray| Some(self.deviation(&ray?))).collect()
    }

    pub(super) fn deviation(&self, ray: &Ray) -> Deviation {
        let chief_mm = self.chief_mm();
        Deviation { error_mm: [0, 1].map(|k| ray.position_mm[k] - chief_mm[k]), opd_mm: self.reference.lead_mm(ray) }
    }

    /// Where light close to the chief ray comes together: by real rays on either side of it, which is what Coddington's
    /// equations give [Welford, Aberrations of Optical Systems, sec. 9.6].
    pub fn foci(&self) -> Option<Foci> {
        let rays = self.clear_rays(&[[0.0, -CLOSE], [0.0, CLOSE], [-CLOSE, 0.0], [CLOSE, 0.0]]);
        let [Some(below), Some(above), Some(left), Some(right)] = rays[..] else { return None };
        Some(Foci {
            tangential_mm: self.crossing_mm(&below, &above, 1),
            sagittal_mm: self.crossing_mm(&left, &right, 0),
        })
    }

    /// Where two rays cross along an axis, from the place of the chief ray, mm.
    fn crossing_mm(&self, one: &Ray, other: &Ray, axis: usize) -> f64 {
        let depth_mm = self.reference.chief.position_mm[2];
        let [a, b] = [one, other].map(|ray| {
            let slope = ray.direction[axis] / ray.direction[2];
            (ray.position_mm[axis] + slope * (depth_mm - ray.position_mm[2]), slope)
        });
        -(b.0 - a.0) / (b.1 - a.1)
    }
}
