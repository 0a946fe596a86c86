//! Rays through a coaxial two-aperture camera, traced backward: from the sensor through the apertures and the lens
//! out to the object.
//!
//! # Axes and signs
//!
//! Image space is measured along the axis from the rear principal plane, `t`, positive towards the sensor at `t = L`;
//! object space from the front principal plane, `z`, positive towards the object. An aperture in front of the lens
//! stands at `t < 0`, that is at `z = −t`. The transverse x and y are those of the object everywhere, so the physical
//! sensor position is `s = −p`, where `p` is the upright image position of a frame ([`ImagePoint`]).
//!
//! # Light is never lost silently
//!
//! Every ray ends in one [`RayFate`], and a [`RayLedger`] adds them up: launched = arrived + lost, always.
//!
//! [`ImagePoint`]: twinpupil_instrument::ImagePoint

mod aim;
mod camera;
mod conic;
mod envelope;
mod fresnel;
mod grooves;
mod image;
mod lanes;
mod launch;
mod least_squares;
mod ledger;
mod line;
mod linear;
mod masks;
mod paraxial;
mod pencil;
mod plate;
mod point_image;
mod prescribed;
mod ray_map;
mod rays;
mod refraction;
mod region;
mod response;
mod site;
mod spread;
mod stop;
mod stray;
mod thin;
mod train;
mod zmx;

pub use camera::{BandOptics, Camera, OpticsError};
pub use image::{BandImager, Contrast, Deviation, Encircled, EncircledWaves, Foci, Imager, Psf, PupilFunction, Sight};
pub use ledger::{RayFate, RayLedger};
pub use pencil::Pencil;
pub use point_image::PointImage;
pub use ray_map::RayMap;
pub use rays::{Footprint, ObjectRays, RayStarts};
pub use response::{response_grids, response_table, response_table_for, smoothed_response_table_for};
pub use site::{Room, entocentric_place, rooms, telecentric_place};
pub use train::{
    ChromaticSums, Fate, FateLedger, Field, FirstOrder, Mask, Pupil, Ray, Rays, SeidelSums, SurfaceLosses, Train,
};
pub use zmx::{Beam, FieldPoint, ZmxLens};
