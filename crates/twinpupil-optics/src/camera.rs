//! An instrument made ready to trace.

use thiserror::Error;
use twinpupil_instrument::{Band, ImagePoint, Instrument, Lens};

use crate::stop::Stop;
use crate::thin::{ThinBand, ThinPrescription};
use crate::{Footprint, ObjectRays, RayLedger, RayStarts};

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
    model: Model,
}

#[derive(Debug, Clone)]
enum Model {
    Thin(ThinBand),
}

impl BandOptics {
    fn new(instrument: &Instrument, band: &Band) -> Result<Self, OpticsError> {
        let stops: Vec<Stop> =
            instrument.apertures.iter().enumerate().map(|(i, mask)| Stop::new(i, mask, &band.name)).collect();
        let projection = instrument.projection(band);
        let pupil = instrument.pupil_index(band);
        let model = match &instrument.lens {
            Lens::Thin(_) => {
                let prescription = ThinPrescription {
                    focal_length_mm: projection.focal_length_mm,
                    sensor_distance_mm: projection.sensor_distance_mm,
                    stops: &stops,
                    pupil,
                    pupil_radius_mm: projection.pupil_radius_mm,
                };
                let position_mm = projection.pupil_position_mm;
                if prescription.cone(position_mm).abs() < SMALLEST_CONE {
                    return Err(OpticsError::PupilInFocus { band: band.name.clone(), aperture: pupil, position_mm });
                }
                Model::Thin(ThinBand::new(&prescription))
            }
            Lens::Fresnel(_) => return Err(OpticsError::Unsupported { model: "fresnel" }),
        };
        Ok(Self { name: band.name.clone(), model })
    }

    /// The band's name.
    pub fn name(&self) -> &str {
        &self.name
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
}

/// Smallest width of a pencil at the pupil relative to the lens at which aiming through the pupil is still sensible.
const SMALLEST_CONE: f64 = 1e-6;
