//! The planes of one frame, freed of crosstalk, with the noise of their codes.

use std::borrow::Cow;

use twinpupil_instrument::{Frame, FrameError, Instrument, PlaneView};

use crate::noise::Noise;
use crate::unmix::Crosstalk;

/// A frame without crosstalk.
pub(crate) struct Planes<'a> {
    instrument: &'a Instrument,
    frame: Cow<'a, Frame>,
    /// In the order of the instrument's bands.
    noises: Vec<Noise>,
}

impl<'a> Planes<'a> {
    /// Takes the crosstalk off a frame, where there is some.
    pub(crate) fn of(
        instrument: &'a Instrument,
        crosstalk: Option<&Crosstalk>,
        frame: &'a Frame,
    ) -> Result<Self, FrameError> {
        let noise = Noise::of_sensor(&instrument.sensor, frame.code_max());
        let Some(crosstalk) = crosstalk else {
            let noises = vec![noise; instrument.bands.len()];
            return Ok(Self { instrument, frame: Cow::Borrowed(frame), noises });
        };
        let noises = (0..instrument.bands.len()).map(|band| crosstalk.noise(band, noise)).collect();
        Ok(Self { instrument, frame: Cow::Owned(crosstalk.unmixed(frame, instrument)?), noises })
    }

    /// The plane of a band, by its index in the instrument.
    pub(crate) fn of_band(&self, band: usize) -> Result<(PlaneView<'_>, Noise), FrameError> {
        Ok((self.instrument.plane(&self.frame, &self.instrument.bands[band])?, self.noises[band]))
    }
}
