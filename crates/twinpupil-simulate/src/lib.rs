//! What the camera would deliver: every pixel is an integral of the scene over the pupil, then the sensor adds noise.
//!
//! A [`Scene`] is flat discs and at most one picture before the camera. For every pixel and band, rays spread over the
//! pupil are traced backward through all masks into the scene, so that defocus, clipping and vignetting follow from
//! the rays. [`expected_electrons`] returns the result of that, [`standard_errors`] how far it may be off; [`simulate`] adds photon noise, read noise, saturation
//! and quantization and returns a [`Frame`](twinpupil_instrument::Frame).
//!
//! Nothing here does I/O. The same scene, instrument and seed give the same bytes on any number of threads.

mod bound;
mod bundle;
mod defects;
mod disc;
mod dot;
mod illumination;
mod index;
mod light;
mod packing;
pub mod paper;
mod patches;
mod plate;
mod progress;
mod ray;
mod render;
mod sampling;
mod scene;
mod sensitivity;
mod sensor;
mod simulate;
mod standard_error;
mod surface;
mod texture;

pub use bound::{Bound, DotInformation, dot_bounds};
pub use defects::Defects;
pub use dot::{Dot, DotSpec};
pub use illumination::Illumination;
pub use packing::{PackingError, RandomDots};
pub use plate::{DotGrid, GridFiducial, ImagePattern, Pattern, Plate, Pose, TiltAxis};
pub use sampling::PUPIL_SAMPLES_MAX;
pub use scene::{DOT_COUNT_MAX, Scene, SceneError, SceneSpec};
pub use simulate::{Expectation, SimulateError, SimulateOptions, Simulation, expected_electrons, expose, simulate};
pub use standard_error::{REPLICATES, standard_errors};
pub use texture::{Picture, PictureError, Texture};
