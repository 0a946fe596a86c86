//! Frames of a coaxial two-aperture camera to 3-D points.
//!
//! ```text
//! Frame → planes → features → pairs → points → fits
//!         detect              matching  position  fit
//! ```
//!
//! [`Reconstructor`] goes all the way; [`detect`] and the fits stand on their own. This crate knows nothing of rays:
//! what a real lens does reaches it as a plain [`ResponseTable`](twinpupil_instrument::ResponseTable).

mod assignment;
mod background;
mod calibrated;
mod cells;
mod centroid;
mod chief;
mod contrast;
mod detect;
mod fetch;
mod fit;
mod flat;
mod flood;
mod further;
mod lattice;
mod likelihood;
mod lone;
mod matching;
mod model;
mod noise;
mod pipeline;
mod planes;
mod position;
mod quantile;
mod register;
mod rejection;
mod relief;
mod response;
mod scout;
mod shading;
mod slope;
mod surface;
mod threads;
mod transfer;
mod unmix;
mod window;

pub use background::Polarity;
pub use chief::ChiefRays;
pub use detect::{DetectOptions, Detection, Detector, Estimator, Feature, detect};
pub use fit::{Estimate, FitError, FitPoint, LineAxis, LineFit, PlaneFit, Quality, fit_line, fit_plane};
pub use flat::{CrosstalkEstimate, FlatError, estimate_crosstalk};
pub use further::FurtherImage;
pub use likelihood::known::{KnownDot, KnownLight, SpotScore};
pub use matching::MatchOptions;
pub use noise::{Noise, NoiseSource};
pub use pipeline::{Mode, Options, Point, ReconstructError, Reconstruction, Reconstructor};
pub use rejection::{Bystander, Rejection, RejectionReason};
pub use slope::surface_slopes;
pub use unmix::noise_gain;
