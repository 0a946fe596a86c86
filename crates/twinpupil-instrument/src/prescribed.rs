//! A lens of the camera that is given surface by surface.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::{ValueError, within};
use crate::thick::{MaskImage, ThickLens};
use crate::{Aperture, CardinalPoints, GlassError, Prescription, PrescriptionSpec, Shape};

/// A lens surface by surface, traced ray by ray.
///
/// Object distances count from its front principal plane and image distances from its rear one, both at the design
/// wavelength. The gap behind its last surface and the distance of its object are of no effect: the sensor stands where
/// `[sensor]` says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PrescriptionLens {
    /// Focal length at the design wavelength, mm, to which all of the lens is scaled; its own if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focal_length_mm: Option<f64>,
    /// Wavelength whose principal planes distances count from, nm.
    #[serde(default = "PrescriptionLens::default_design_wavelength_nm")]
    pub design_wavelength_nm: f64,
    /// File of the lens, relative to the instrument's: a `.zmx` file, or a prescription in TOML. Whoever reads it puts its
    /// surfaces into `prescription` instead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// AGF catalogues with glasses of that file, relative to the instrument's.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub catalogues: Vec<String>,
    /// The surfaces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prescription: Option<PrescriptionSpec>,
}

/// Where a mask stands among the surfaces of a lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaskPlace {
    /// The surface from which it is measured.
    pub surface: usize,
    /// Distance behind that surface's vertex, mm; in front of it if negative.
    pub behind_mm: f64,
}

/// A lens as it stands in its camera. Places count from the first vertex, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct LensStand {
    /// Its surfaces, the flat image behind which is the sensor.
    pub prescription: Prescription,
    /// Front principal plane at the design wavelength, from which objects count.
    pub front_principal_mm: f64,
    /// Rear principal plane at the design wavelength, from which the sensor and masks count.
    pub rear_principal_mm: f64,
    /// The last vertex.
    pub length_mm: f64,
}

impl Default for PrescriptionLens {
    /// Without surfaces.
    fn default() -> Self {
        Self {
            focal_length_mm: None,
            design_wavelength_nm: Self::default_design_wavelength_nm(),
            file: None,
            catalogues: Vec::new(),
            prescription: None,
        }
    }
}

impl PrescriptionLens {
    fn default_design_wavelength_nm() -> f64 {
        587.6
    }

    /// Checks the lens and states its focal length where the user has not.
    pub(crate) fn settle(&mut self) -> Result<(), ValueError> {
        within("lens.design_wavelength_nm", self.design_wavelength_nm, 200.0, 20_000.0)?;
        let lens = self.stated()?;
        check_camera_lens(&lens)?;
        let own_mm = ThickLens::new(&lens, self.design_wavelength_nm)
            .map_err(|error| of_glass(error, "lens.design_wavelength_nm"))?
            .focal_length_mm();
        let key = "lens.prescription, by its own focal length,";
        if !own_mm.is_finite() {
            return Err(ValueError::new(key, "a lens that bends no light", "0.1 to 100000"));
        }
        within(key, own_mm, 0.1, 1e5)?;
        within("lens.focal_length_mm", *self.focal_length_mm.get_or_insert(own_mm), 0.1, 1e5)
    }

    /// The lens scaled to its focal length.
    fn scaled(&self) -> Result<Prescription, ValueError> {
        let lens = self.stated()?;
        let Some(focal_length_mm) = self.focal_length_mm else { return Ok(lens) };
        let own = ThickLens::new(&lens, self.design_wavelength_nm);
        let own_mm = own.map_err(|error| of_glass(error, "lens.design_wavelength_nm"))?.focal_length_mm();
        Ok(lens.scaled(focal_length_mm / own_mm))
    }

    /// The lens as it is written.
    fn stated(&self) -> Result<Prescription, ValueError> {
        match (&self.prescription, &self.file) {
            (Some(_), Some(file)) => Err(ValueError::new("lens.file", file, "left out beside `lens.prescription`")),
            (Some(spec), None) => Prescription::new(spec.clone())
                .map_err(|error| ValueError { key: format!("lens.prescription.{}", error.key), ..error }),
            (None, Some(file)) => Err(ValueError::new("lens.file", file, "a file that has been read")),
            (None, None) => Err(ValueError::new("lens.prescription", "missing", "surfaces, or `lens.file`")),
        }
    }

    /// The lens to first order at a wavelength, which the file states under `key`.
    pub(crate) fn thick(&self, wavelength_nm: f64, key: &str) -> Result<ThickLens, ValueError> {
        ThickLens::new(&self.scaled()?, wavelength_nm).map_err(|error| of_glass(error, key))
    }

    /// The lens, scaled and with the sensor as its image.
    ///
    /// # Errors
    /// None for the lens of an [`Instrument`](crate::Instrument).
    pub fn stand(&self, sensor_distance_mm: f64) -> Result<LensStand, ValueError> {
        let design = self.thick(self.design_wavelength_nm, "lens.design_wavelength_nm")?;
        let behind_mm = design.rear_principal_mm() - design.length_mm() + sensor_distance_mm;
        Ok(LensStand {
            prescription: self.scaled()?.with_image(behind_mm),
            front_principal_mm: design.front_principal_mm(),
            rear_principal_mm: design.rear_principal_mm(),
            length_mm: design.length_mm(),
        })
    }

    /// Focal length and principal planes at a wavelength.
    ///
    /// # Errors
    /// Where a material is not known, or not at that wavelength.
    pub fn cardinal_points(&self, wavelength_nm: f64) -> Result<CardinalPoints, ValueError> {
        Ok(self.thick(wavelength_nm, "wavelength_nm")?.points())
    }

    /// How a mask appears at a wavelength: from the image, or from the object if that puts it in front of the lens.
    ///
    /// # Errors
    /// Where a material is not known, or not at that wavelength.
    pub fn image_of_mask(&self, place: MaskPlace, wavelength_nm: f64) -> Result<MaskImage, ValueError> {
        Ok(self.images_of_masks(wavelength_nm)?(place))
    }

    /// The same for masks wherever they may be.
    ///
    /// # Errors
    /// Where a material is not known, or not at that wavelength.
    pub fn images_of_masks(&self, wavelength_nm: f64) -> Result<impl Fn(MaskPlace) -> MaskImage + use<>, ValueError> {
        let lens = self.thick(wavelength_nm, "wavelength_nm")?;
        Ok(move |place: MaskPlace| lens.image_of_mask(place.surface, place.behind_mm))
    }

    /// Where masks of a camera stand.
    ///
    /// # Errors
    /// One that names the mask and what is legal, if it would stand in glass.
    pub fn places(&self, masks: &[Aperture]) -> Result<Vec<MaskPlace>, ValueError> {
        let design = self.thick(self.design_wavelength_nm, "lens.design_wavelength_nm")?;
        masks.iter().enumerate().map(|(i, mask)| self.place(i, mask, &design)).collect()
    }

    /// Where the mask `index` of a camera stands, `lens` being this one at its design wavelength.
    fn place(&self, index: usize, mask: &Aperture, lens: &ThickLens) -> Result<MaskPlace, ValueError> {
        let surfaces = self.prescription.as_ref().map_or(&[][..], |spec| &spec.surfaces);
        let last = surfaces.len().saturating_sub(1);
        let position_mm = mask.position_mm;
        let Some(surface) = mask.surface else {
            let (front_mm, behind_mm) =
                (lens.front_principal_mm() + position_mm, lens.rear_principal_mm() + position_mm - lens.length_mm());
            return match position_mm {
                _ if position_mm < 0.0 && front_mm <= 0.0 => Ok(MaskPlace { surface: 0, behind_mm: front_mm }),
                _ if position_mm >= 0.0 && behind_mm >= 0.0 => Ok(MaskPlace { surface: last, behind_mm }),
                _ => Err(within_lens(index, position_mm, lens)),
            };
        };
        let key = |name: &str| format!("aperture[{index}].{name}");
        if surface > last {
            return Err(ValueError::new(key("surface"), surface, format!("0 to {last}, the surfaces of the lens")));
        }
        let gap_mm = surfaces[surface].gap_mm;
        let least_mm = if surface == 0 { -1e5 } else { 0.0 };
        let most_mm = if surface == last { 1e5 } else { gap_mm };
        within(&key("position_mm"), position_mm, least_mm, most_mm)?;
        let medium = &surfaces[surface].medium;
        let is_on_glass = position_mm == 0.0 || position_mm == gap_mm;
        if position_mm > 0.0 && !is_on_glass && !medium.eq_ignore_ascii_case("air") {
            let legal = format!("0 or {gap_mm}, for there is {medium} behind surface {surface}; or another surface");
            return Err(ValueError::new(key("position_mm"), position_mm, legal));
        }
        Ok(MaskPlace { surface, behind_mm: position_mm })
    }
}

/// A mask that would stand within the lens.
fn within_lens(index: usize, position_mm: f64, lens: &ThickLens) -> ValueError {
    let (before_mm, behind_mm) = (-lens.front_principal_mm(), lens.length_mm() - lens.rear_principal_mm());
    let legal = format!(
        "below {before_mm}, in front of the lens, or from {behind_mm}, behind it; within it state `surface` and count \
         `position_mm` from there",
        before_mm = before_mm.min(0.0),
        behind_mm = behind_mm.max(0.0)
    );
    ValueError::new(format!("aperture[{index}].position_mm"), position_mm, legal)
}

/// What light of a camera can go straight through.
fn check_camera_lens(lens: &Prescription) -> Result<(), ValueError> {
    let is_air = |medium: &str| medium.eq_ignore_ascii_case("air");
    let mut before = "air";
    for (i, surface) in lens.surfaces.iter().enumerate() {
        let key = format!("lens.prescription.surface[{i}]");
        if surface.mirror {
            return Err(ValueError::new(key, "a mirror", "surfaces that light passes"));
        }
        if matches!(surface.shape, Shape::Break | Shape::Cylinder { .. }) {
            return Err(ValueError::new(key, "a break or a cylinder", "surfaces of revolution"));
        }
        if matches!(surface.shape, Shape::Facets { .. }) && is_air(&surface.medium) == is_air(before) {
            let legal = "glass on one side of facets and air on the other";
            return Err(ValueError::new(format!("{key}.medium"), &surface.medium, legal));
        }
        before = &surface.medium;
    }
    match lens.surfaces.last() {
        Some(last) if !last.medium.eq_ignore_ascii_case("air") => {
            let key = format!("lens.prescription.surface[{}].medium", lens.surfaces.len() - 1);
            Err(ValueError::new(key, &last.medium, "air behind the last surface"))
        }
        _ => Ok(()),
    }
}

/// A glass that has no index, as a value of the instrument file: of the lens, or of a wavelength under `key`.
fn of_glass(error: GlassError, key: &str) -> ValueError {
    match error {
        GlassError::Unknown { key, material, count } => {
            let legal = format!("one of `lens.prescription.media` or of {count} built-in materials");
            ValueError::new(format!("lens.prescription.{key}"), material, legal)
        }
        GlassError::Wavelength { wavelength_nm, material, min_nm, max_nm } => {
            ValueError::new(key, wavelength_nm, format!("{min_nm} to {max_nm}, where {material} is known"))
        }
    }
}
