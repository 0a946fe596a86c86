//! The planes of one frame, freed of crosstalk, with the noise of their codes.

use smallvec::SmallVec;
use twinpupil_instrument::{Frame, FrameError, FrameView, Instrument, PlaneView};

use crate::noise::{Noise, NoiseSource};
use crate::unmix::Crosstalk;

/// A frame without crosstalk.
pub(crate) struct Planes<'a> {
    instrument: &'a Instrument,
    codes: Codes<'a>,
    /// In the order of the instrument's bands.
    noises: SmallVec<[Noise; 4]>,
}

enum Codes<'a> {
    AsRead(FrameView<'a>),
    Unmixed(Frame),
}

impl<'a> Planes<'a> {
    /// Takes the crosstalk off a frame, where there is some.
    pub(crate) fn of(
        instrument: &'a Instrument,
        crosstalk: Option<&Crosstalk>,
        frame: FrameView<'a>,
        source: NoiseSource,
    ) -> Result<Self, FrameError> {
        let noise = Noise::of_sensor(&instrument.sensor, frame.code_max());
        let bands = 0..instrument.bands.len();
        let planes = match crosstalk {
            None => Self {
                instrument,
                codes: Codes::AsRead(frame),
                noises: SmallVec::from_elem(noise, instrument.bands.len()),
            },
            Some(crosstalk) => Self {
                instrument,
                codes: Codes::Unmixed(crosstalk.unmixed(frame, instrument)?),
                noises: bands.clone().map(|band| crosstalk.noise(band, noise)).collect(),
            },
        };
        if source == NoiseSource::Sensor {
            return Ok(planes);
        }
        let shown = |band: usize| planes.of_band(band).map(|(plane, stated)| Noise::of_plane(&plane, &stated));
        let noises = bands.map(shown).collect::<Result<_, _>>()?;
        Ok(Self { noises, ..planes })
    }

    /// The plane of a band, by its index in the instrument.
    pub(crate) fn of_band(&self, band: usize) -> Result<(PlaneView<'_>, Noise), FrameError> {
        let frame = match &self.codes {
            Codes::AsRead(frame) => *frame,
            Codes::Unmixed(frame) => frame.into(),
        };
        Ok((self.instrument.plane(frame, &self.instrument.bands[band])?, self.noises[band]))
    }
}
