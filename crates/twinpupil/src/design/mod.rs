//! A lens made into a camera with two pupils: where the masks go, how far the sensor, how wide the pupils.

mod check;
mod masks;
mod pairs;
mod sweep;
pub mod tolerance;

pub use check::{Check, check};
pub use masks::{Design, Wishes, design};
pub use pairs::{Pairs, PairsSpec};
pub use sweep::{Choice, Light, best, choices, sweep};
