//! What a camera's lens makes of points in one band, through its masks.

use twinpupil_instrument::{Band, Instrument, Lens};

use super::Imager;
use crate::prescribed::BandTrain;
use crate::{Field, OpticsError};

/// A camera's lens, given surface by surface, with its masks, in one band. The pupil is the hole of the band's mask.
#[derive(Debug, Clone)]
pub struct BandImager {
    /// The lens. In its axes y points up.
    pub imager: Imager,
    /// The front principal plane, from which objects count, behind the plane from which rays before the lens are counted.
    front_principal_mm: f64,
}

impl BandImager {
    /// `None` for a lens that is not given surface by surface.
    pub fn new(instrument: &Instrument, band: &Band) -> Result<Option<Self>, OpticsError> {
        let Lens::Prescription(lens) = &instrument.lens else { return Ok(None) };
        let BandTrain { with_masks, front_principal_mm, .. } = BandTrain::new(instrument, lens, band)?;
        let pupil = instrument.pupil_index(band);
        let mask = &instrument.apertures[pupil];
        let radius_mm = mask.annuli(&band.name).last().map_or(0.0, |ring| ring.outer_mm);
        let [x_mm, y_mm] = mask.centre_mm;
        let front_principal_mm = front_principal_mm - with_masks.first_depth_mm();
        let imager = Imager::through_mask(with_masks, band.wavelength_nm, pupil, [x_mm, -y_mm], radius_mm);
        Ok(Some(Self { imager, front_principal_mm }))
    }

    /// A point in front of the camera, x to the right, y down and z from the front principal plane, mm.
    pub fn field(&self, [x_mm, y_mm, z_mm]: [f64; 3]) -> Field {
        Field::Point { position_mm: [x_mm, -y_mm, self.front_principal_mm - z_mm] }
    }
}
