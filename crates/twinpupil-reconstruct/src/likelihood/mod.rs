//! Maximum likelihood: the dots whose modelled light explains the pixels best.

pub(crate) mod black;
pub(crate) mod body;
mod chords;
mod coupling;
mod covariance;
mod cut;
mod full;
mod illumination;
pub(crate) mod joint;
pub(crate) mod known;
mod laid;
mod light;
mod neighbours;
mod normal;
mod outline;
pub(crate) mod pencil;
pub(crate) mod prior;
mod profile;
pub(crate) mod refine;
mod samples;
mod segment;
mod sharp;
mod soft;
pub(crate) mod spot;
mod weigh;
