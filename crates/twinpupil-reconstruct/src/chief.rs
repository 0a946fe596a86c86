//! Points from the images of their chief rays, without pixels.

use twinpupil_instrument::{ImagePoint, Instrument};

use crate::model::{Disc, Model};
use crate::position::{Sighting, first_order_position_mm, model_position};

/// The first-order inverse of an instrument: an ideal lens behind which no mask clips another's light.
///
/// What a real lens and its masks add is the caller's to take off first.
#[derive(Debug, Clone)]
pub struct ChiefRays {
    instrument: Instrument,
    model: Model,
}

/// All bands weigh alike; with the same deviation everywhere its size does not matter, mm.
const STD_MM: f64 = 1e-3;

impl ChiefRays {
    /// Of an instrument.
    pub fn new(instrument: &Instrument) -> Self {
        Self { instrument: instrument.clone(), model: Model::new(instrument, None) }
    }

    /// The point whose chief rays meet the images that all bands show, in the order of the instrument's; `None` on the axis
    /// and far outside the depth range.
    ///
    /// # Panics
    /// If there is not an image for every band.
    pub fn position_mm(&self, images: &[ImagePoint]) -> Option<[f64; 3]> {
        const POINT: Disc = Disc { diameter_mm: 0.0, slopes: [0.0; 2] };
        let sighting = |band: usize| Sighting { band, image: images[self.model.index(band)], std_mm: [STD_MM; 2] };
        let sightings: Vec<Sighting> = (0..self.model.bands()).map(sighting).collect();
        let start_mm = first_order_position_mm(&self.instrument, &self.model, &[sightings[0], sightings[1]])?;
        Some(model_position(&self.model, &sightings, &POINT, start_mm)?.position_mm)
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;

    #[test]
    fn chief_rays_through_masks_off_the_axis_meet_where_they_start() {
        let mut spec = paper::instrument().into_spec();
        spec.apertures[0].centre_mm = [0.1, -0.2];
        spec.apertures[1].centre_mm = [-0.15, 0.05];
        let instrument = Instrument::new(spec).unwrap();
        let chief = ChiefRays::new(&instrument);
        for object_mm in [[3.0, -2.0, 260.0], [-0.5, 6.0, 340.0]] {
            let images: Vec<ImagePoint> =
                instrument.bands.iter().map(|band| instrument.projection(band).image(object_mm)).collect();
            let found_mm = chief.position_mm(&images).unwrap();
            let off_mm = (0..3).map(|k| (found_mm[k] - object_mm[k]).abs()).fold(0.0, f64::max);
            assert!(off_mm < 1e-5, "{found_mm:?}");
        }
        assert_eq!(chief.position_mm(&[ImagePoint { x_mm: 0.0, y_mm: 0.0 }; 2]), None);
    }
}
