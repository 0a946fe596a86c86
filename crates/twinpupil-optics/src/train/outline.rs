//! Where surfaces and rays are in the axes of the lens, to be drawn.

use super::face::{Polynomial, Profile};
use super::rigid::{Rigid, apply};
use super::{Ray, Train};

impl Train {
    /// Places that a ray has met, one on each surface as [`Train::path`] has them, in the axes of the lens, whose origin is
    /// where its first surface would stand without a shift of its own.
    pub fn in_lens_axes(&self, met: &[Ray]) -> Vec<[f64; 3]> {
        self.faces.iter().zip(met).map(|(face, ray)| placed(&face.place, ray.position_mm)).collect()
    }

    /// The number of the mask that is met as `met`-th; `None` if that is a surface of the lens or the image.
    pub fn mask_met(&self, met: usize) -> Option<usize> {
        self.faces.get(met).filter(|face| face.clear.rings.is_some()).map(|face| face.index)
    }

    /// The section x = 0 of the surface that is met as `met`-th, below the number of surfaces, from −`half_height_mm` to
    /// `half_height_mm`, in `points` points in the axes of the lens; without those beyond the rim of the surface.
    pub fn section(&self, met: usize, half_height_mm: f64, points: usize) -> Vec<[f64; 3]> {
        let face = &self.faces[met];
        let last = points.saturating_sub(1).max(1) as f64;
        let heights_mm = (0..points).map(|k| half_height_mm * (2.0 * k as f64 / last - 1.0));
        let local = heights_mm.map(|y_mm| [0.0, y_mm, face.profile.depth_mm([0.0, y_mm])]);
        local.filter(|place| place[2].is_finite()).map(|place| placed(&face.place, place)).collect()
    }
}

fn placed(place: &Rigid, local: [f64; 3]) -> [f64; 3] {
    let turned = apply(&place.turn, local);
    [0, 1, 2].map(|k| place.origin[k] + turned[k])
}

impl Profile {
    /// Depth behind the vertex, mm; NaN beyond the rim.
    pub(crate) fn depth_mm(&self, [x, y]: [f64; 2]) -> f64 {
        let square = x * x + y * y;
        match self {
            Self::Plane | Self::Fresnel(_) => 0.0,
            Self::Facets(facets) => facets.depth_mm(square.sqrt()),
            Self::Sphere { c } => conic_depth_mm(*c, 0.0, square),
            Self::Conic { c, k } => conic_depth_mm(*c, *k, square),
            Self::Cylinder { c, along } => conic_depth_mm(*c, 0.0, [x, y][*along].powi(2)),
            Self::Asphere(Polynomial { c, k, even, odd }) => {
                let sum = |coefficients: &[f64]| coefficients.iter().rev().fold(0.0, |sum, a| sum * square + a);
                conic_depth_mm(*c, *k, square) + square * sum(even) + square.sqrt() * sum(odd)
            }
        }
    }
}

fn conic_depth_mm(c: f64, k: f64, square: f64) -> f64 {
    c * square / (1.0 + (1.0 - (1.0 + k) * c * c * square).sqrt())
}
