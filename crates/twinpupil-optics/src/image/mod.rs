//! What a lens makes of a point: rays, wavefront, point spread and contrast.
//!
//! An [`Imager`] is a lens at one wavelength with the pupil through which it images, a [`Sight`] what it makes of one point of
//! the field. Places are told from where the chief ray, through the middle of the pupil, meets the image; the wavefront from
//! the sphere about that place through the middle of the exit pupil.

mod band;
mod bessel;
mod fan;
mod imager;
mod mtf;
mod psf;
mod pupil;
mod reference;

pub use band::BandImager;
pub use fan::{Deviation, Foci};
pub use imager::{Imager, Sight};
pub use mtf::Contrast;
pub use psf::{Encircled, EncircledWaves, Psf};
pub use pupil::PupilFunction;
