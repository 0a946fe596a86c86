//! `twinpupil optics`: what a lens is that is given surface by surface.

mod layout;
mod show;
mod spot;
mod used;

use anyhow::Result;
use clap::Subcommand;

/// `twinpupil optics …`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show focal lengths, pupils and aberrations of third order, and draw the lens
    Show(show::Args),
    /// Show how large points of the field are in the image, where they are and where they should be
    Spot(spot::Args),
}

/// Runs `twinpupil optics`.
pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Show(args) => show::run(args),
        Command::Spot(args) => spot::run(args),
    }
}
