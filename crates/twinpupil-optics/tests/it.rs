//! One program for all tests of this crate: linking each alone takes longer than running it.

mod fresnel;
mod image;
mod prescribed;
mod prescriptions;
mod thin;
