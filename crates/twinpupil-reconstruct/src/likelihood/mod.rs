//! Maximum likelihood: the dots whose modelled light explains the pixels best.

pub(crate) mod body;
mod clipped;
pub(crate) mod joint;
mod normal;
pub(crate) mod pencil;
pub(crate) mod refine;
mod row;
mod sharp;
mod soft;
pub(crate) mod spot;
