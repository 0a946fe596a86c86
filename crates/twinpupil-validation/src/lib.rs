//! Simulated frames in, reconstructed points out, truth beside them: what the tests assert and `targets` prints.
//!
//! This crate is the only library that sees both the simulation and the reconstruction.

pub mod calibration;
pub mod limit;
pub mod plates;
pub mod rig;
pub mod rings;
pub mod scenes;
pub mod strangers;
