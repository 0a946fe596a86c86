//! A lens made into a camera with two pupils: where the masks go, how far the sensor, how wide the pupils.

mod check;
mod masks;
mod sweep;
pub mod tolerance;

pub use check::{Check, check};
pub use masks::{Design, Wishes, design};
pub use sweep::{Choice, Light, best, choices, sweep};
