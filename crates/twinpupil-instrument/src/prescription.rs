//! A lens surface by surface, as the user states it.
//!
//! Light runs along +z. A radius is positive if the centre of curvature lies behind the surface, a gap if the next
//! surface does; behind an odd number of mirrors gaps are negative. All lengths are in mm, angles in degrees.

use std::collections::BTreeMap;
use std::ops::Deref;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::{self, ValueError, positive, within};
use crate::{InstrumentError, MediumSpec};

/// A lens surface by surface as it is written; [`Prescription`] is the same, checked.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PrescriptionSpec {
    /// What the user calls the lens.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// Distance of the object from the first surface, mm; infinite if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object_distance_mm: Option<f64>,
    /// The surfaces, in the order in which light from the object meets them. The gap behind the last leads to the image.
    #[serde(rename = "surface")]
    pub surfaces: Vec<SurfaceSpec>,
    /// Shape of the image surface.
    #[serde(default, skip_serializing_if = "Shape::is_plane")]
    pub image: Shape,
    /// Materials of the user's own, by name; they come before the built-in ones.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub media: BTreeMap<String, MediumSpec>,
}

/// One surface and what lies behind it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SurfaceSpec {
    /// Its shape.
    #[serde(default, skip_serializing_if = "Shape::is_plane")]
    pub shape: Shape,
    /// Distance along the axis to the next surface, mm.
    #[serde(default)]
    pub gap_mm: f64,
    /// What lies behind it: a built-in material, one of `media`, or `air`. Behind a mirror or a break it is left out:
    /// there it is what lies before it.
    #[serde(default = "SurfaceSpec::air", skip_serializing_if = "SurfaceSpec::is_air")]
    pub medium: String,
    /// Whether it reflects.
    #[serde(default, skip_serializing_if = "is_false")]
    pub mirror: bool,
    /// Whether it is the aperture stop.
    #[serde(default, skip_serializing_if = "is_false")]
    pub stop: bool,
    /// Radius beyond which no light passes, mm; none if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub semi_diameter_mm: Option<f64>,
    /// Radius within which no light passes, mm.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub hole_radius_mm: f64,
    /// Half width and half height of a rectangle beyond which no light passes, mm; none if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub half_size_mm: Option<[f64; 2]>,
    /// Shift of this surface alone across the axis, x and y, mm. A `break` shifts all that follows.
    #[serde(default, skip_serializing_if = "is_origin")]
    pub decentre_mm: [f64; 2],
    /// Turn of this surface alone about its vertex, after the shift: about x, then y, then z, degrees. A `break` turns
    /// all that follows.
    #[serde(default, skip_serializing_if = "is_upright")]
    pub tilt_deg: [f64; 3],
}

/// The shape of a surface. `s` is its depth behind the vertex at a distance r from the axis.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Shape {
    /// Flat.
    #[default]
    Plane,
    /// A sphere.
    Sphere {
        /// Radius of curvature, mm.
        radius_mm: f64,
    },
    /// `s = c r²/(1 + √(1 − (1 + k) c² r²))`, c = 1/R.
    Conic {
        /// Radius of curvature R at the vertex, mm.
        radius_mm: f64,
        /// k: −1 for a paraboloid, below it a hyperboloid.
        conic_constant: f64,
    },
    /// A conic and `Σ aᵢ r²ⁱ` from i = 1.
    EvenAsphere {
        /// Radius of curvature of the conic at the vertex, mm; flat if left out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        radius_mm: Option<f64>,
        /// k of the conic.
        #[serde(default)]
        conic_constant: f64,
        /// Coefficients of r², r⁴, r⁶, …, in mm⁻¹, mm⁻³, mm⁻⁵, …
        coefficients: Vec<f64>,
    },
    /// A conic and `Σ aᵢ rⁱ` from i = 1.
    OddAsphere {
        /// Radius of curvature of the conic at the vertex, mm; flat if left out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        radius_mm: Option<f64>,
        /// k of the conic.
        #[serde(default)]
        conic_constant: f64,
        /// Coefficients of r, r², r³, …, in 1, mm⁻¹, mm⁻², …
        coefficients: Vec<f64>,
    },
    /// A cylinder.
    Cylinder {
        /// Radius of curvature, mm.
        radius_mm: f64,
        /// The direction in which it is curved.
        curved: Across,
    },
    /// An ideal lens without thickness: slopes change by −height/f.
    ThinLens {
        /// Focal length f in air, mm.
        focal_length_mm: f64,
    },
    /// A plane that bends light as the surface of an even asphere would at the same distance from the axis: a Fresnel
    /// lens with grooves too fine to see.
    Fresnel {
        /// Radius of curvature of the conic at the vertex, mm.
        radius_mm: f64,
        /// k of the conic.
        #[serde(default)]
        conic_constant: f64,
        /// Coefficients of r², r⁴, r⁶, …, in mm⁻¹, mm⁻³, mm⁻⁵, …
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        coefficients: Vec<f64>,
    },
    /// The grooves of a Fresnel lens whose other face is flat: facets, each cut for the plane in which it lies, and walls
    /// between them. The plane of their peaks holds the vertex; there is glass on one side, up to the flat face, and air on
    /// the other. The surface needs a `semi_diameter_mm` or a `half_size_mm`.
    Facets {
        /// Focal length of the lens in air at the design wavelength, mm.
        focal_length_mm: f64,
        /// Width of a groove, mm.
        pitch_mm: f64,
        /// Angle of the walls to the axis, degrees.
        #[serde(default)]
        draft_deg: f64,
        /// Wavelength for which the facets are cut, nm.
        #[serde(default = "Shape::default_design_wavelength_nm")]
        design_wavelength_nm: f64,
    },
    /// No surface: shifts and turns the axis along which everything behind is measured.
    Break,
}

/// A direction across the axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Across {
    /// Along x.
    X,
    /// Along y.
    Y,
}

/// A checked lens; reads like its [`PrescriptionSpec`].
#[derive(Debug, Clone, PartialEq)]
pub struct Prescription {
    spec: PrescriptionSpec,
}

impl Deref for Prescription {
    type Target = PrescriptionSpec;

    fn deref(&self) -> &PrescriptionSpec {
        &self.spec
    }
}

/// Most surfaces of a prescription: more than any lens has, and few enough to trace.
pub const SURFACES_MAX: usize = 2000;

/// Longest length in a prescription, mm; an object farther away is at infinity.
const LENGTH_MAX_MM: f64 = 1e7;

/// Strongest curvature, as the smallest radius, mm.
const RADIUS_MIN_MM: f64 = 1e-3;

/// Longest radius, mm: flatter than any plane can be made.
const RADIUS_MAX_MM: f64 = 1e12;

/// Most coefficients of an asphere.
const COEFFICIENTS_MAX: usize = 20;

impl Prescription {
    /// Checks every value of `spec`.
    pub fn new(spec: PrescriptionSpec) -> Result<Self, ValueError> {
        let count = spec.surfaces.len();
        if count == 0 || count > SURFACES_MAX {
            return Err(ValueError::new("surface", format!("{count} surfaces"), format!("1 to {SURFACES_MAX}")));
        }
        if let Some(distance_mm) = spec.object_distance_mm {
            within("object_distance_mm", distance_mm, -LENGTH_MAX_MM, LENGTH_MAX_MM)?;
        }
        for (name, medium) in &spec.media {
            medium.check(&format!("media.{name}"))?;
        }
        for (i, surface) in spec.surfaces.iter().enumerate() {
            surface.check(&format!("surface[{i}]"))?;
        }
        let stops = spec.surfaces.iter().filter(|surface| surface.stop).count();
        if stops > 1 {
            return Err(ValueError::new("surface[].stop", format!("true {stops} times"), "at most once"));
        }
        match &spec.image {
            shape @ (Shape::Plane | Shape::Sphere { .. } | Shape::Conic { .. }) => shape.check("image")?,
            _ => return Err(ValueError::new("image.kind", "another shape", "plane, sphere, conic")),
        }
        Ok(Self { spec })
    }

    /// Reads and checks a prescription file.
    pub fn from_toml(text: &str) -> Result<Self, InstrumentError> {
        Ok(Self::new(check::parse_toml(text)?)?)
    }

    /// The lens with all its lengths `factor` times as long.
    pub(crate) fn scaled(&self, factor: f64) -> Self {
        let mut spec = self.spec.clone();
        spec.object_distance_mm = spec.object_distance_mm.map(|mm| mm * factor);
        spec.image = spec.image.scaled(factor);
        for surface in &mut spec.surfaces {
            surface.shape = surface.shape.scaled(factor);
            surface.gap_mm *= factor;
            surface.semi_diameter_mm = surface.semi_diameter_mm.map(|mm| mm * factor);
            surface.hole_radius_mm *= factor;
            surface.half_size_mm = surface.half_size_mm.map(|half| half.map(|mm| mm * factor));
            surface.decentre_mm = surface.decentre_mm.map(|mm| mm * factor);
        }
        Self { spec }
    }

    /// The lens with a flat image at a distance behind its last surface.
    pub(crate) fn with_image(&self, behind_mm: f64) -> Self {
        let mut spec = self.spec.clone();
        spec.image = Shape::Plane;
        if let Some(last) = spec.surfaces.last_mut() {
            last.gap_mm = behind_mm;
        }
        Self { spec }
    }

    /// Index of the surface that is the aperture stop, if one is marked.
    pub fn stop(&self) -> Option<usize> {
        self.surfaces.iter().position(|surface| surface.stop)
    }
}

impl SurfaceSpec {
    fn air() -> String {
        "air".to_owned()
    }

    fn is_air(medium: &String) -> bool {
        medium == "air"
    }

    fn check(&self, key: &str) -> Result<(), ValueError> {
        self.shape.check(&format!("{key}.shape"))?;
        within(&format!("{key}.gap_mm"), self.gap_mm, -LENGTH_MAX_MM, LENGTH_MAX_MM)?;
        if (self.mirror || self.shape == Shape::Break) && !Self::is_air(&self.medium) {
            let legal = "left out behind a mirror or a break, where the medium is that before it";
            return Err(ValueError::new(format!("{key}.medium"), &self.medium, legal));
        }
        if let Some(radius_mm) = self.semi_diameter_mm {
            positive(&format!("{key}.semi_diameter_mm"), radius_mm, LENGTH_MAX_MM)?;
        }
        within(&format!("{key}.hole_radius_mm"), self.hole_radius_mm, 0.0, LENGTH_MAX_MM)?;
        for (k, half_mm) in self.half_size_mm.iter().flatten().enumerate() {
            positive(&format!("{key}.half_size_mm[{k}]"), *half_mm, LENGTH_MAX_MM)?;
        }
        for (k, shift_mm) in self.decentre_mm.iter().enumerate() {
            within(&format!("{key}.decentre_mm[{k}]"), *shift_mm, -LENGTH_MAX_MM, LENGTH_MAX_MM)?;
        }
        for (k, tilt_deg) in self.tilt_deg.iter().enumerate() {
            within(&format!("{key}.tilt_deg[{k}]"), *tilt_deg, -360.0, 360.0)?;
        }
        Ok(())
    }
}

impl Default for SurfaceSpec {
    /// A plane in air.
    fn default() -> Self {
        Self {
            shape: Shape::Plane,
            gap_mm: 0.0,
            medium: Self::air(),
            mirror: false,
            stop: false,
            semi_diameter_mm: None,
            hole_radius_mm: 0.0,
            half_size_mm: None,
            decentre_mm: [0.0; 2],
            tilt_deg: [0.0; 3],
        }
    }
}

impl Shape {
    fn is_plane(&self) -> bool {
        *self == Self::Plane
    }

    fn default_design_wavelength_nm() -> f64 {
        587.6
    }

    /// Radius of curvature at the vertex, or the focal length of an ideal lens, mm; `None` where there is neither.
    pub fn radius_mm_mut(&mut self) -> Option<&mut f64> {
        match self {
            Self::Plane | Self::Break => None,
            Self::EvenAsphere { radius_mm, .. } | Self::OddAsphere { radius_mm, .. } => radius_mm.as_mut(),
            Self::Sphere { radius_mm }
            | Self::Conic { radius_mm, .. }
            | Self::Cylinder { radius_mm, .. }
            | Self::Fresnel { radius_mm, .. }
            | Self::Facets { focal_length_mm: radius_mm, .. }
            | Self::ThinLens { focal_length_mm: radius_mm } => Some(radius_mm),
        }
    }

    fn scaled(&self, factor: f64) -> Self {
        let mut scaled = self.clone();
        // A coefficient of rⁱ, from i = `first` in steps of `step`, shrinks with the (i − 1)-th power.
        let shrink = |coefficients: &mut [f64], first: i32, step: i32| {
            for (power, coefficient) in (first - 1..).step_by(step as usize).zip(coefficients) {
                *coefficient /= factor.powi(power);
            }
        };
        if let Some(radius_mm) = scaled.radius_mm_mut() {
            *radius_mm *= factor;
        }
        match &mut scaled {
            Self::Facets { pitch_mm, .. } => *pitch_mm *= factor,
            Self::EvenAsphere { coefficients, .. } | Self::Fresnel { coefficients, .. } => shrink(coefficients, 2, 2),
            Self::OddAsphere { coefficients, .. } => shrink(coefficients, 1, 1),
            _ => {}
        }
        scaled
    }

    fn check(&self, key: &str) -> Result<(), ValueError> {
        let (radius_mm, conic_constant, coefficients): (Option<f64>, f64, &[f64]) = match self {
            Self::Plane | Self::Break => (None, 0.0, &[]),
            Self::Sphere { radius_mm } | Self::Cylinder { radius_mm, .. } => (Some(*radius_mm), 0.0, &[]),
            Self::Conic { radius_mm, conic_constant } => (Some(*radius_mm), *conic_constant, &[]),
            Self::EvenAsphere { radius_mm, conic_constant, coefficients }
            | Self::OddAsphere { radius_mm, conic_constant, coefficients } => {
                (*radius_mm, *conic_constant, coefficients)
            }
            Self::Fresnel { radius_mm, conic_constant, coefficients } => {
                (Some(*radius_mm), *conic_constant, coefficients)
            }
            Self::Facets { focal_length_mm, pitch_mm, draft_deg, design_wavelength_nm } => {
                within(&format!("{key}.focal_length_mm"), *focal_length_mm, 0.1, 1e5)?;
                within(&format!("{key}.pitch_mm"), *pitch_mm, 1e-3, 10.0)?;
                within(&format!("{key}.draft_deg"), *draft_deg, 0.0, 30.0)?;
                return within(&format!("{key}.design_wavelength_nm"), *design_wavelength_nm, 200.0, 20_000.0);
            }
            Self::ThinLens { focal_length_mm } => {
                return either_way(&format!("{key}.focal_length_mm"), *focal_length_mm);
            }
        };
        if let Some(radius_mm) = radius_mm {
            either_way(&format!("{key}.radius_mm"), radius_mm)?;
        }
        within(&format!("{key}.conic_constant"), conic_constant, -1e6, 1e6)?;
        if coefficients.len() > COEFFICIENTS_MAX {
            let found = format!("{} numbers", coefficients.len());
            return Err(ValueError::new(format!("{key}.coefficients"), found, format!("at most {COEFFICIENTS_MAX}")));
        }
        for (k, coefficient) in coefficients.iter().enumerate() {
            within(&format!("{key}.coefficients[{k}]"), *coefficient, -1e6, 1e6)?;
        }
        Ok(())
    }
}

/// A radius or focal length: of either sign, and no stronger than can be.
fn either_way(key: &str, length_mm: f64) -> Result<(), ValueError> {
    if (RADIUS_MIN_MM..=RADIUS_MAX_MM).contains(&length_mm.abs()) {
        return Ok(());
    }
    Err(ValueError::new(key, length_mm, format!("{RADIUS_MIN_MM} to {RADIUS_MAX_MM:e} or the same negative")))
}

fn is_false(value: &bool) -> bool {
    !value
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn is_origin(value: &[f64; 2]) -> bool {
    *value == [0.0; 2]
}

fn is_upright(value: &[f64; 3]) -> bool {
    *value == [0.0; 3]
}

#[cfg(test)]
mod tests {
    use super::*;

    const SINGLET: &str = r#"
        name = "singlet"

        [[surface]]
        shape = { kind = "conic", radius_mm = 60.0, conic_constant = -0.5 }
        gap_mm = 10.0
        medium = "my-glass"
        semi_diameter_mm = 12.0
        stop = true

        [[surface]]
        gap_mm = 90.0

        [media.my-glass]
        formula = "abbe"
        coefficients = [1.5168, 64.17]
    "#;

    #[test]
    fn a_prescription_reads_and_prints_to_the_same() {
        let singlet = Prescription::from_toml(SINGLET).unwrap();
        assert_eq!(singlet.stop(), Some(0));
        assert_eq!((singlet.surfaces[1].medium.as_str(), &singlet.image), ("air", &Shape::Plane));
        let printed = toml::to_string(&*singlet).unwrap();
        assert_eq!(Prescription::from_toml(&printed).unwrap(), singlet);
    }

    #[test]
    fn what_is_not_legal_is_named() {
        let said = |from: &str, to: &str| Prescription::from_toml(&SINGLET.replace(from, to)).unwrap_err().to_string();
        assert_eq!(
            said("radius_mm = 60.0", "radius_mm = 0.0"),
            "`surface[0].shape.radius_mm` is 0; legal: 0.001 to 1e12 or the same negative"
        );
        assert!(said("radius_mm = 60.0", "radius_mm = nan").starts_with("`surface[0].shape.radius_mm` is NaN"));
        assert!(said("gap_mm = 90.0", "gap_mm = inf").starts_with("`surface[1].gap_mm` is inf"));
        assert!(said("gap_mm = 90.0", "stop = true").starts_with("`surface[].stop` is true 2 times"));
        assert!(said("gap_mm = 90.0", "thickness = 2.0").contains("unknown field `thickness`"));
        assert!(said("conic_constant = -0.5", "k = -0.5").contains("unknown field `k`"));
        assert!(said("[1.5168, 64.17]", "[1.5168]").starts_with("`media.my-glass.coefficients` is 1 numbers"));
        assert!(said("gap_mm = 90.0", "mirror = true\nmedium = \"N-BK7\"").contains("left out behind a mirror"));
    }
}
