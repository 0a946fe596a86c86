//! Frames of a known target to a calibrated instrument with its covariance.
//!
//! ```text
//! frames → features → rows and columns → poses → bundle adjustment ⇄ pixels → instrument ± covariance
//! ```
//!
//! [`Calibrator`] goes all the way. The rows and columns of the target's dots give a first bundle adjustment; from there
//! every pixel is compared with the forward model, masks and blur included, and the adjustment follows what they ask for.
//! [`PositionCalibrator`] starts from how dots are imaged, for designs of which there are no frames.

mod adjust;
mod advice;
mod approach;
mod axis;
mod blur;
mod calibrate;
mod camera;
mod compare;
mod correction;
mod digits;
mod forward;
mod known;
mod lattice;
mod mask_centre;
mod now;
mod pose;
mod positions;
mod result;
mod seen;
mod sighting;
mod stage;
mod stranger;
mod target;
mod unknown;
mod unseen;

pub use axis::{AxisError, AxisEstimate, AxisFinder};
pub use calibrate::{CalibrateError, Calibrator, Fault, Foreign, FrameFault, Stage};
pub use correction::{CorrectionChoice, CorrectionFinding, CorrectionTrial};
pub use digits::significant;
pub use known::Contradiction;
pub use mask_centre::MaskCentre;
pub use pose::Pose;
pub use positions::{BLUR_STD, DotImage, ImageOf, PositionCalibration, PositionCalibrator, Shown};
pub use result::{Calibration, FrameResult, HeldOut, LeftOpen, Number, OffStage, Residual};
pub use sighting::SightingError;
pub use stage::StagePosition;
pub use target::{Fiducial, Target, TargetDot, TargetError, TargetKind, TargetSpec};
pub use unknown::{Choices, DOT_DIAMETER_KEY, Quantity, UnknownKey, tolerance};
