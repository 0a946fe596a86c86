//! `twinpupil analyze`: what a design is worth before it is built.

use anyhow::Result;
use clap::Subcommand;

use crate::console::Console;

pub mod precision;

/// `twinpupil analyze …`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// How well dots can be located over the working volume, and how well they are
    Precision(precision::Args),
}

/// Runs `twinpupil analyze`.
pub fn run(command: &Command, console: &Console) -> Result<()> {
    match command {
        Command::Precision(args) => precision::run(args, console),
    }
}
