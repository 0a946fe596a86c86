//! A surface made ready to be traced at one wavelength.

use std::sync::Arc;

use twinpupil_instrument::{Across, Annulus, Shape, SurfaceSpec};

use super::facets::Facets;
use super::rigid::Rigid;

/// A surface made ready to be traced.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Face {
    /// Which one it is: of the prescription, or of the list of masks.
    pub(crate) index: usize,
    pub(crate) profile: Profile,
    pub(crate) action: Action,
    pub(crate) index_before: f64,
    pub(crate) index_behind: f64,
    pub(crate) clear: Clear,
    /// The axis at its vertex.
    pub(crate) axis: Rigid,
    /// Its own place: the axis, and its own shift and tilt.
    pub(crate) place: Rigid,
    /// From the axes of the face before to its own.
    pub(crate) from_previous: Rigid,
    /// Whether rays come to it from anywhere.
    pub(crate) is_first: bool,
}

/// The shape of a face. `c` is the curvature, 1/mm, `k` the conic constant.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Profile {
    Plane,
    Sphere {
        c: f64,
    },
    Conic {
        c: f64,
        k: f64,
    },
    /// Curved along component 0 or 1.
    Cylinder {
        c: f64,
        along: usize,
    },
    Asphere(Polynomial),
    /// A plane with the slopes of an asphere.
    Fresnel(Polynomial),
    /// The facets of a Fresnel lens and the walls between them.
    Facets(Arc<Facets>),
}

/// A conic and a polynomial of r.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Polynomial {
    pub(crate) c: f64,
    pub(crate) k: f64,
    /// Coefficients of r², r⁴, …
    pub(crate) even: Vec<f64>,
    /// Coefficients of r, r³, …
    pub(crate) odd: Vec<f64>,
}

/// What a face does to a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Action {
    Pass,
    Refract {
        index_ratio: f64,
    },
    Reflect,
    /// Slopes change by −height times this, 1/mm.
    ThinLens {
        power_per_mm: f64,
    },
}

/// Where light passes a face.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Clear {
    /// Squares of the inner and the outer radius, mm²: of a place that is not finite none is true.
    pub(crate) squares_mm2: [f64; 2],
    pub(crate) half_size_mm: Option<[f64; 2]>,
    pub(crate) rings: Option<Rings>,
}

/// Rings of a mask that pass a band.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Rings {
    pub(crate) centre_mm: [f64; 2],
    pub(crate) rings: Vec<Annulus>,
}

impl Clear {
    pub(crate) const EVERYWHERE: Self = Self { squares_mm2: [0.0, f64::MAX], half_size_mm: None, rings: None };

    pub(crate) fn of(surface: &SurfaceSpec) -> Self {
        let outer_mm2 = surface.semi_diameter_mm.map_or(f64::MAX, |radius_mm| radius_mm * radius_mm);
        Self {
            squares_mm2: [surface.hole_radius_mm.powi(2), outer_mm2],
            half_size_mm: surface.half_size_mm,
            rings: None,
        }
    }
}

impl Rings {
    /// A ring without end.
    pub(crate) fn everywhere() -> Self {
        Self { centre_mm: [0.0; 2], rings: vec![Annulus { inner_mm: 0.0, outer_mm: f64::INFINITY }] }
    }
}

impl Face {
    /// A flat mask in a medium, `number` in the list of masks.
    pub(crate) fn mask(number: usize, axis: Rigid, medium: f64, rings: Rings) -> Self {
        Self {
            index: number,
            profile: Profile::Plane,
            action: Action::Pass,
            index_before: medium,
            index_behind: medium,
            clear: Clear { rings: Some(rings), ..Clear::EVERYWHERE },
            axis,
            place: axis,
            from_previous: Rigid::IDENTITY,
            is_first: false,
        }
    }

    /// Curvature at the vertex that a paraxial ray meets, 1/mm: along y where x and y differ.
    pub(crate) fn vertex_curvature_per_mm(&self) -> f64 {
        match &self.profile {
            Profile::Plane => 0.0,
            Profile::Sphere { c } | Profile::Conic { c, .. } => *c,
            Profile::Cylinder { c, along } => f64::from(u8::from(*along == 1)) * c,
            Profile::Asphere(polynomial) | Profile::Fresnel(polynomial) => polynomial.vertex_curvature_per_mm(),
            Profile::Facets(facets) => facets.vertex_curvature_per_mm(),
        }
    }
}

impl Polynomial {
    /// The r² term curves the vertex as well.
    fn vertex_curvature_per_mm(&self) -> f64 {
        self.c + 2.0 * self.even.first().unwrap_or(&0.0)
    }

    /// Coefficient of r⁴ in the depth, 1/mm³.
    pub(crate) fn fourth_order_per_mm3(&self) -> f64 {
        (1.0 + self.k) * self.c.powi(3) / 8.0 + self.even.get(1).unwrap_or(&0.0)
    }
}

impl Profile {
    /// That of a shape by itself: facets, which depend on glass and thickness, are [`Facets`].
    pub(crate) fn of(shape: &Shape) -> Self {
        match shape {
            Shape::Plane | Shape::ThinLens { .. } | Shape::Break | Shape::Facets { .. } => Self::Plane,
            Shape::Sphere { radius_mm } => Self::Sphere { c: 1.0 / radius_mm },
            Shape::Conic { radius_mm, conic_constant } => conic(1.0 / radius_mm, *conic_constant),
            Shape::Cylinder { radius_mm, curved } => {
                Self::Cylinder { c: 1.0 / radius_mm, along: usize::from(*curved == Across::Y) }
            }
            Shape::EvenAsphere { radius_mm, conic_constant, coefficients } => {
                let even = without_zeros(coefficients.clone());
                asphere(radius_mm.map_or(0.0, |radius_mm| 1.0 / radius_mm), *conic_constant, even, Vec::new())
            }
            Shape::OddAsphere { radius_mm, conic_constant, coefficients } => {
                let every_other = |first: usize| coefficients.iter().skip(first).step_by(2).copied().collect();
                let [odd, even] = [0, 1].map(|first| without_zeros(every_other(first)));
                asphere(radius_mm.map_or(0.0, |radius_mm| 1.0 / radius_mm), *conic_constant, even, odd)
            }
            Shape::Fresnel { radius_mm, conic_constant, coefficients } => Self::Fresnel(Polynomial {
                c: 1.0 / radius_mm,
                k: *conic_constant,
                even: without_zeros(coefficients.clone()),
                odd: Vec::new(),
            }),
        }
    }
}

fn conic(c: f64, k: f64) -> Profile {
    if k == 0.0 { Profile::Sphere { c } } else { Profile::Conic { c, k } }
}

fn asphere(c: f64, k: f64, even: Vec<f64>, odd: Vec<f64>) -> Profile {
    if even.is_empty() && odd.is_empty() { conic(c, k) } else { Profile::Asphere(Polynomial { c, k, even, odd }) }
}

/// Without the zeros at the end.
fn without_zeros(mut coefficients: Vec<f64>) -> Vec<f64> {
    let last = coefficients.iter().rposition(|coefficient| *coefficient != 0.0);
    coefficients.truncate(last.map_or(0, |last| last + 1));
    coefficients
}
