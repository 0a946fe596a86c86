//! The subcommands, one module each.

pub mod figures;
pub mod instrument;
pub mod simulate;
