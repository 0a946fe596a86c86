//! The subcommands, one module each.

pub mod analyze;
pub mod calibrate;
pub mod crosstalk;
pub mod demo;
pub mod design;
pub mod destination;
pub mod detect;
pub mod figures;
pub mod fit;
pub mod instrument;
pub mod optics;
pub mod options;
pub mod parts;
pub mod reconstruct;
pub mod reproduce;
pub mod scene;
pub mod simulate;
pub mod target;
