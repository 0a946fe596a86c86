//! Frames of a known target to a calibrated instrument with its covariance.

mod forward;
mod lattice;
mod pose;
mod sighting;
mod target;

pub use pose::Pose;
pub use sighting::SightingError;
pub use target::{Fiducial, Target, TargetDot, TargetError, TargetKind, TargetSpec};
