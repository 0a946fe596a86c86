//! A camera with the paper's optics and a sensor of 64 × 48 large pixels: frames small enough to fuzz.

use twinpupil_instrument::{Instrument, Mosaic, paper};

/// Columns and rows of the sensor: the paper's field of view, coarsely.
pub const SIZE_PX: [usize; 2] = [64, 48];

/// The small camera with a mosaic.
pub fn instrument(mosaic: Mosaic) -> Instrument {
    let mut spec = paper::instrument().into_spec();
    spec.sensor.size_px = SIZE_PX;
    spec.sensor.pitch_mm = 0.15;
    spec.sensor.axis_px = [31.5, 23.5];
    spec.sensor.mosaic = mosaic;
    if mosaic == Mosaic::Mono {
        for (page, band) in spec.bands.iter_mut().enumerate() {
            band.plane = page.to_string();
        }
    }
    Instrument::new(spec).expect("a legal camera")
}
