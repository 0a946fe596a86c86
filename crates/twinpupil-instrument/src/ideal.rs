//! A camera to first order: what an ideal lens would have to be, and where the masks would stand about it.

use crate::check::ValueError;
use crate::{Aperture, InstrumentSpec, Lens, PrescriptionLens};

/// An ideal lens that does to a band what the camera's lens does to first order.
///
/// Its principal planes are those of the band. Object distances count from the front principal plane at the design
/// wavelength all the same: by how much the band's lies elsewhere is for the response table to say.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct IdealBand {
    pub(crate) focal_length_mm: f64,
    pub(crate) sensor_distance_mm: f64,
    /// The masks as they appear from the image, or from the object if that puts them in front of the lens.
    pub(crate) apertures: Vec<Aperture>,
}

impl IdealBand {
    /// For every band.
    pub(crate) fn of(spec: &InstrumentSpec) -> Result<Vec<Self>, ValueError> {
        let sensor_distance_mm = spec.sensor.distance_mm;
        let plain =
            |focal_length_mm: f64| Self { focal_length_mm, sensor_distance_mm, apertures: spec.apertures.clone() };
        match &spec.lens {
            Lens::Thin(lens) => Ok(spec.bands.iter().map(|band| plain(lens.focal_length_mm(&band.name))).collect()),
            Lens::Fresnel(lens) => Ok(spec.bands.iter().map(|_| plain(lens.focal_length_mm)).collect()),
            Lens::Prescription(lens) => Self::of_prescription(spec, lens),
        }
    }

    fn of_prescription(spec: &InstrumentSpec, lens: &PrescriptionLens) -> Result<Vec<Self>, ValueError> {
        let design = lens.thick(lens.design_wavelength_nm, "lens.design_wavelength_nm")?;
        let places = lens.places(&spec.apertures)?;
        let bands = spec.bands.iter().enumerate().map(|(i, band)| {
            let thick = lens.thick(band.wavelength_nm, &format!("band[{i}].wavelength_nm"))?;
            let apertures = spec.apertures.iter().zip(&places).enumerate().map(|(k, (mask, place))| {
                let image = thick.image_of_mask(place.surface, place.behind_mm);
                if image.scale > 0.0 && image.position_mm.is_finite() {
                    return Ok(mask.imaged(image.position_mm, image.scale));
                }
                let legal = "a place that the lens does not image upside down or to infinity";
                Err(ValueError::new(format!("aperture[{k}].position_mm"), mask.position_mm, legal))
            });
            let apertures = apertures.collect::<Result<Vec<_>, _>>()?;
            Ok(Self {
                focal_length_mm: thick.focal_length_mm(),
                sensor_distance_mm: spec.sensor.distance_mm + design.rear_principal_mm() - thick.rear_principal_mm(),
                apertures,
            })
        });
        bands.collect()
    }
}
