//! The paper's experiments, simulated and read back: what `reproduce` and `demo` compute.
//!
//! A [`Shot`] is one exposure of the paper, a [`Rig`] a camera that takes it. Reading the frame in one [`Case`] gives a
//! [`Reading`]: every dot with its true and its recovered position. [`rings`], [`depth_line`] and [`tilt`] reduce
//! readings to the numbers that the paper reports and that [`published`] holds; a [`Comparison`] sets them side by
//! side and says why they differ.

mod case;
pub mod choices;
mod comparison;
pub mod depth_line;
mod explanation;
pub mod published;
mod reading;
mod rig;
pub mod rings;
mod shot;
pub mod statistics;
mod study;
pub mod tilt;

pub use case::{Case, LensModel};
pub use comparison::{Comparison, Measured, Row, Section};
pub use explanation::{Explanation, Note, dispersed_depth_mm};
pub use reading::{Located, Reading};
pub use rig::{Rig, fresnel_instrument};
pub use shot::{Experiment, Shot};
pub use study::{CaseStudy, Study};
