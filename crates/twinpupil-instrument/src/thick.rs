//! A lens of several surfaces to first order: where its principal planes are, and where masks among its surfaces appear
//! to be.

use crate::{CardinalPoints, Glass, GlassError, ParaxialRay, ParaxialSurface, Prescription, Shape, paraxial_rays};

/// A lens in air to first order at one wavelength, surface by surface. Places count from the first vertex.
#[derive(Debug, Clone)]
pub(crate) struct ThickLens {
    surfaces: Vec<ParaxialSurface>,
    points: CardinalPoints,
    length_mm: f64,
}

/// An image of a mask.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaskImage {
    /// Behind the rear principal plane, mm; if negative, in front of the front one.
    pub position_mm: f64,
    /// Its size relative to the mask; negative if it is upside down.
    pub scale: f64,
}

impl ThickLens {
    /// Of a lens through which light runs straight.
    pub(crate) fn new(lens: &Prescription, wavelength_nm: f64) -> Result<Self, GlassError> {
        let mut index_before = 1.0;
        let mut surfaces = Vec::with_capacity(lens.surfaces.len());
        for (i, surface) in lens.surfaces.iter().enumerate() {
            let key = format!("surface[{i}].medium");
            let index_behind = Glass::named(&surface.medium, &lens.media, &[], &key)?.index(wavelength_nm)?;
            let power_per_mm = match surface.shape {
                Shape::Facets { focal_length_mm, design_wavelength_nm, .. } => {
                    // The glass lies on the side where the index is larger.
                    let (place, index) =
                        if index_behind > index_before { (i, index_behind) } else { (i.max(1) - 1, index_before) };
                    let key = format!("surface[{place}].medium");
                    let glass = Glass::named(&lens.surfaces[place].medium, &lens.media, &[], &key)?;
                    (index - 1.0) / ((glass.index(design_wavelength_nm)? - 1.0) * focal_length_mm)
                }
                _ => power_per_mm(&surface.shape, index_before, index_behind),
            };
            surfaces.push(ParaxialSurface { power_per_mm, index_behind, gap_behind_mm: surface.gap_mm });
            index_before = index_behind;
        }
        let inner = surfaces.len().saturating_sub(1);
        let length_mm = surfaces[..inner].iter().map(|surface| surface.gap_behind_mm).sum();
        Ok(Self { points: CardinalPoints::of(&surfaces), surfaces, length_mm })
    }

    pub(crate) fn points(&self) -> CardinalPoints {
        self.points
    }

    pub(crate) fn focal_length_mm(&self) -> f64 {
        self.points.focal_length_mm
    }

    /// From the first vertex to the last.
    pub(crate) fn length_mm(&self) -> f64 {
        self.length_mm
    }

    pub(crate) fn front_principal_mm(&self) -> f64 {
        self.points.front_principal_mm
    }

    pub(crate) fn rear_principal_mm(&self) -> f64 {
        self.length_mm + self.points.rear_principal_mm
    }

    /// A mask behind the vertex of a surface, or in front of the first one if `behind_mm` is negative there, as it appears
    /// from the image if that is behind the lens, else as it appears from the object.
    pub(crate) fn image_of_mask(&self, surface: usize, behind_mm: f64) -> MaskImage {
        if surface == 0 && behind_mm < 0.0 {
            let position_mm = behind_mm - self.points.front_principal_mm;
            let in_object = MaskImage { position_mm, scale: 1.0 };
            return if position_mm < 0.0 { in_object } else { self.through(in_object) };
        }
        let (axial, beside) = (self.behind(surface, behind_mm, AXIAL), self.behind(surface, behind_mm, BESIDE));
        let from_last_mm = -axial.height_mm / axial.slope;
        let position_mm = from_last_mm - self.points.rear_principal_mm;
        let in_image = MaskImage { position_mm, scale: beside.height_mm + beside.slope * from_last_mm };
        if position_mm >= 0.0 { in_image } else { self.through(in_image) }
    }

    /// An image on the one side of the lens as it appears on the other.
    ///
    /// ```text
    /// 1/z + 1/d = 1/f,    size d/z
    /// ```
    ///
    /// for a mask at d behind the lens, which is at −z; for one at −z it is the same with d and z exchanged.
    fn through(&self, image: MaskImage) -> MaskImage {
        let MaskImage { position_mm, scale } = image;
        let share = self.points.focal_length_mm / (self.points.focal_length_mm + position_mm.abs());
        MaskImage { position_mm: position_mm * share, scale: scale * share }
    }

    /// The ray behind the last surface that is `ray` in the plane of a mask.
    fn behind(&self, surface: usize, behind_mm: f64, ray: ParaxialRay) -> ParaxialRay {
        let gap_mm = if surface + 1 < self.surfaces.len() { self.surfaces[surface].gap_behind_mm } else { 0.0 };
        let next = ParaxialRay { height_mm: ray.height_mm + ray.slope * (gap_mm - behind_mm), ..ray };
        let rest = &self.surfaces[surface + 1..];
        paraxial_rays(rest, self.surfaces[surface].index_behind, next).last().copied().unwrap_or(next)
    }
}

/// From the middle of a mask.
const AXIAL: ParaxialRay = ParaxialRay { height_mm: 0.0, slope: 1.0 };

/// Along the axis, a millimetre beside it.
const BESIDE: ParaxialRay = ParaxialRay { height_mm: 1.0, slope: 0.0 };

/// Power of a surface of revolution at its vertex, 1/mm.
fn power_per_mm(shape: &Shape, index_before: f64, index_behind: f64) -> f64 {
    let conic = |radius_mm: &Option<f64>| radius_mm.map_or(0.0, f64::recip);
    let square = |coefficients: &[f64], place: usize| 2.0 * coefficients.get(place).copied().unwrap_or(0.0);
    let curvature_per_mm = match shape {
        Shape::Plane | Shape::Break | Shape::Cylinder { .. } => 0.0,
        Shape::ThinLens { focal_length_mm } => return 1.0 / focal_length_mm,
        Shape::Sphere { radius_mm } | Shape::Conic { radius_mm, .. } => 1.0 / radius_mm,
        Shape::EvenAsphere { radius_mm, coefficients, .. } => conic(radius_mm) + square(coefficients, 0),
        Shape::OddAsphere { radius_mm, coefficients, .. } => conic(radius_mm) + square(coefficients, 1),
        Shape::Fresnel { radius_mm, coefficients, .. } => 1.0 / radius_mm + square(coefficients, 0),
        // They depend on the glass at another wavelength.
        Shape::Facets { .. } => 0.0,
    };
    curvature_per_mm * (index_behind - index_before)
}
