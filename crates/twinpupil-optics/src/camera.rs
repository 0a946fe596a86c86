//! An instrument made ready to trace.

use thiserror::Error;
use twinpupil_instrument::{Band, ImagePoint, Instrument, Lens, Projection};

use crate::masks::Masks;
use crate::stop::Stop;
use crate::thin::ThinBand;
use crate::{Footprint, ObjectRays, PointImage, RayLedger, RayStarts};

/// Why an instrument cannot be traced.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum OpticsError {
    /// The band's pupil is in focus on the sensor, so that it limits the field and not the pencils.
    #[error(
        "`aperture[{aperture}].position_mm` is {position_mm}, where it is in focus in band `{band}`; \
         legal: a pupil that is out of focus"
    )]
    PupilInFocus {
        /// The band.
        band: String,
        /// Index of its pupil.
        aperture: usize,
        /// Where that stands, mm.
        position_mm: f64,
    },
    /// A lens model that is not traced.
    #[error("`lens.model` is {model}; legal: thin")]
    Unsupported {
        /// The model.
        model: &'static str,
    },
}

/// An instrument made ready to trace.
#[derive(Debug, Clone)]
pub struct Camera {
    bands: Vec<BandOptics>,
}

impl Camera {
    /// Prepares every band of `instrument`.
    pub fn new(instrument: &Instrument) -> Result<Self, OpticsError> {
        let bands = instrument.bands.iter().map(|band| BandOptics::new(instrument, band)).collect::<Result<_, _>>()?;
        Ok(Self { bands })
    }

    /// The bands, in the order of the instrument's.
    pub fn bands(&self) -> &[BandOptics] {
        &self.bands
    }
}

/// One band of a [`Camera`]: its lens, its pupil and the other apertures as its light meets them.
#[derive(Debug, Clone)]
pub struct BandOptics {
    name: String,
    /// To first order, by the data sheet.
    projection: Projection,
    /// To first order, at the band's own wavelength.
    masks: Masks,
    model: Model,
}

#[derive(Debug, Clone)]
enum Model {
    Thin(ThinBand),
}

impl BandOptics {
    fn new(instrument: &Instrument, band: &Band) -> Result<Self, OpticsError> {
        let projection = instrument.projection(band);
        let stops = instrument.apertures.iter().enumerate().map(|(i, mask)| Stop::new(i, mask, &band.name)).collect();
        let masks = Masks {
            focal_length_mm: projection.focal_length_mm,
            sensor_distance_mm: projection.sensor_distance_mm,
            stops,
            pupil: instrument.pupil_index(band),
            pupil_radius_mm: projection.pupil_radius_mm,
        };
        if masks.sensor_pencil(projection.pupil_position_mm).abs() < SMALLEST_PENCIL {
            return Err(OpticsError::PupilInFocus {
                band: band.name.clone(),
                aperture: masks.pupil,
                position_mm: projection.pupil_position_mm,
            });
        }
        let model = match &instrument.lens {
            Lens::Thin(_) => Model::Thin(ThinBand::new(&masks)),
            Lens::Fresnel(_) => return Err(OpticsError::Unsupported { model: "fresnel" }),
        };
        Ok(Self { name: band.name.clone(), projection, masks, model })
    }

    /// The band's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The band's first-order projection, as the instrument states it.
    pub fn projection(&self) -> &Projection {
        &self.projection
    }

    /// Traces rays from the sensor into object space and enters their fates in `ledger`.
    ///
    /// `rays` is overwritten with as many rays as `starts` has, in the same order. The pupil points should sample the
    /// unit disc uniformly; then the mean weight is the irradiance of the image point under a uniform object,
    /// relative to the axis and to an unclipped pupil. Positions and slopes of lost rays (weight 0) mean nothing.
    ///
    /// # Panics
    ///
    /// If the slices of `starts` differ in length.
    pub fn trace(&self, starts: RayStarts<'_>, rays: &mut ObjectRays, ledger: &mut RayLedger) {
        match &self.model {
            Model::Thin(band) => band.trace(starts, rays, ledger),
        }
    }

    /// Circle at distance `z_mm` in object space that holds every ray of the band from the image disc.
    pub fn footprint(&self, centre: ImagePoint, radius_mm: f64, z_mm: f64) -> Footprint {
        match &self.model {
            Model::Thin(band) => band.footprint(centre, radius_mm, z_mm),
        }
    }

    /// Whether it is certain that every ray from the image disc arrives with weight 1.
    ///
    /// True only for a thin lens: through a real one no two rays weigh the same.
    pub fn is_unclipped(&self, centre: ImagePoint, radius_mm: f64) -> bool {
        match &self.model {
            Model::Thin(band) => band.is_unclipped(centre, radius_mm),
        }
    }

    /// What becomes of the light of an object point (x, y, z) in mm, z > 0: exact for a thin lens.
    pub fn point_image(&self, object_mm: [f64; 3]) -> PointImage {
        match &self.model {
            Model::Thin(_) => self.masks.point_image(object_mm),
        }
    }

    /// Radius about the axis at distance `z_mm` inside which other masks clip the band's pupil, mm: 0 if it is clear
    /// on the axis, infinite if it is clear nowhere. To first order, along +x.
    pub fn clip_radius_mm(&self, z_mm: f64) -> f64 {
        self.masks.clip_radius_mm(z_mm)
    }

    /// Radius about the axis at distance `z_mm` inside which no light of the band passes, mm: 0 if some passes on the
    /// axis, infinite if none does anywhere. To first order, along +x.
    pub fn blind_radius_mm(&self, z_mm: f64) -> f64 {
        self.masks.blind_radius_mm(z_mm)
    }
}

/// Smallest width of a pencil at the pupil relative to the lens at which aiming through the pupil is still sensible.
const SMALLEST_PENCIL: f64 = 1e-6;
