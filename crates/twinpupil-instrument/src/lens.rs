//! The lens as the user states it.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::PrescriptionLens;
use crate::check::{ValueError, positive, within};

/// `[lens]`, told apart by its `model`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "model", rename_all = "lowercase")]
pub enum Lens {
    /// An ideal lens without thickness.
    Thin(ThinLens),
    /// A Fresnel lens, grooves on one face and the other flat, traced groove by groove.
    Fresnel(FresnelLens),
    /// A lens surface by surface.
    Prescription(Box<PrescriptionLens>),
}

/// An ideal lens: slopes change by −height/f and nothing else.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ThinLens {
    /// Focal length f, mm.
    pub focal_length_mm: f64,
    /// Focal length of single bands by name, mm, where dispersion makes it differ.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub focal_length_mm_by_band: BTreeMap<String, f64>,
}

/// A Fresnel lens: concentric facets on one face, the other flat.
///
/// The facets are not the slices of one profile pushed back onto a plane, which would smear the focus. Each is a slice
/// of its own conic, cut so that light of the design wavelength that comes parallel to the axis meets in the focal
/// point: exactly, if the grooves face the image; for light through the middle of each facet, if they face the object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FresnelLens {
    /// Focal length at the design wavelength, mm.
    pub focal_length_mm: f64,
    /// Wavelength for which the facets are cut, nm: all of them send light parallel to the axis to one focal point.
    #[serde(default = "FresnelLens::default_design_wavelength_nm")]
    pub design_wavelength_nm: f64,
    /// Name of a built-in material, such as `pmma`.
    #[serde(default = "FresnelLens::default_material")]
    pub material: String,
    /// Full thickness from the groove peaks to the flat face, mm.
    #[serde(default = "FresnelLens::default_thickness_mm")]
    pub thickness_mm: f64,
    /// Radial width of one groove, mm.
    #[serde(default = "FresnelLens::default_groove_pitch_mm")]
    pub groove_pitch_mm: f64,
    /// Angle of the riser between two grooves against the axis, degrees.
    #[serde(default = "FresnelLens::default_draft_deg")]
    pub draft_deg: f64,
    /// Which face carries the grooves.
    #[serde(default = "FresnelLens::default_grooves")]
    pub grooves: GrooveSide,
    /// Width and height of the lens, mm.
    #[serde(default = "FresnelLens::default_size_mm")]
    pub size_mm: [f64; 2],
}

/// The face of a Fresnel lens that carries the grooves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum GrooveSide {
    /// Grooves towards the object, flat face towards the sensor.
    Object,
    /// Flat face towards the object, grooves towards the sensor.
    Image,
}

impl Lens {
    /// The focal length that the data sheet states, mm; of a lens surface by surface that of its design wavelength.
    pub fn focal_length_mm(&self) -> f64 {
        match self {
            Self::Thin(lens) => lens.focal_length_mm,
            Self::Fresnel(lens) => lens.focal_length_mm,
            Self::Prescription(lens) => lens.focal_length_mm.unwrap_or(f64::NAN),
        }
    }

    /// Checks the lens; of one that is given surface by surface it also states the focal length.
    pub(crate) fn settle(&mut self) -> Result<(), ValueError> {
        match self {
            Self::Thin(lens) => lens.check(),
            Self::Fresnel(lens) => lens.check(),
            Self::Prescription(lens) => lens.settle(),
        }
    }
}

impl ThinLens {
    /// Focal length in a band, mm.
    pub fn focal_length_mm(&self, band: &str) -> f64 {
        *self.focal_length_mm_by_band.get(band).unwrap_or(&self.focal_length_mm)
    }

    fn check(&self) -> Result<(), ValueError> {
        within("lens.focal_length_mm", self.focal_length_mm, 0.1, 1e5)?;
        for (band, &focal_length_mm) in &self.focal_length_mm_by_band {
            within(&format!("lens.focal_length_mm_by_band.{band}"), focal_length_mm, 0.1, 1e5)?;
        }
        Ok(())
    }
}

impl FresnelLens {
    fn default_design_wavelength_nm() -> f64 {
        587.6
    }

    fn default_material() -> String {
        "pmma".to_owned()
    }

    fn default_thickness_mm() -> f64 {
        2.0
    }

    fn default_groove_pitch_mm() -> f64 {
        0.25
    }

    fn default_draft_deg() -> f64 {
        3.0
    }

    fn default_grooves() -> GrooveSide {
        GrooveSide::Object
    }

    fn default_size_mm() -> [f64; 2] {
        [77.0, 77.0]
    }

    fn check(&self) -> Result<(), ValueError> {
        within("lens.focal_length_mm", self.focal_length_mm, 0.1, 1e5)?;
        within("lens.design_wavelength_nm", self.design_wavelength_nm, 200.0, 20_000.0)?;
        positive("lens.thickness_mm", self.thickness_mm, 100.0)?;
        within("lens.groove_pitch_mm", self.groove_pitch_mm, 1e-3, 10.0)?;
        within("lens.draft_deg", self.draft_deg, 0.0, 30.0)?;
        positive("lens.size_mm[0]", self.size_mm[0], 1e4)?;
        positive("lens.size_mm[1]", self.size_mm[1], 1e4)
    }
}
