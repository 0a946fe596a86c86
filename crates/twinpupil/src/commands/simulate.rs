//! `twinpupil simulate`: instrument + scene → frame.

use anyhow::Result;

use crate::console::Console;

/// `twinpupil simulate …`.
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs `twinpupil simulate`.
pub fn run(_args: &Args, _console: &Console) -> Result<()> {
    Ok(())
}
