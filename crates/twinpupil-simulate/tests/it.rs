//! One program for all tests of this crate: linking each alone takes longer than running it.

mod bound;
mod frame;
mod physics;
