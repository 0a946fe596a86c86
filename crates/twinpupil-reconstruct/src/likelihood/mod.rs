//! Maximum likelihood: the dots whose modelled light explains the pixels best.

pub(crate) mod black;
pub(crate) mod body;
mod cut;
mod illumination;
pub(crate) mod joint;
mod light;
mod normal;
pub(crate) mod pencil;
pub(crate) mod refine;
mod samples;
mod sharp;
mod soft;
pub(crate) mod spot;
