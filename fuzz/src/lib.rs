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
    for (index, band) in spec.bands.iter_mut().enumerate() {
        if mosaic.has_page_for_each_band() {
            band.plane = index.to_string();
        } else if matches!(mosaic, Mosaic::Polarizer(_)) {
            band.plane = ["0", "90"][index % 2].to_owned();
        }
    }
    Instrument::new(spec).expect("a legal camera")
}
