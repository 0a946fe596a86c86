//! `twinpupil optics`: what a lens is that is given surface by surface, and what it makes of points.

mod answer;
mod asked;
mod distortion;
mod fan;
mod layout;
mod mtf;
mod psf;
mod rows;
mod show;
mod show_camera;
mod spot;
mod used;

pub(super) use self::show_camera::camera_drawing;

use anyhow::Result;
use clap::Subcommand;

use crate::console::Console;

/// `twinpupil optics …`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show focal lengths, pupils and aberrations of third order, and draw the lens
    Show(show::Args),
    /// Show how large points of the field are in the image, where they are and where they should be
    Spot(spot::Args),
    /// Show how rays over the pupil miss, and the wavefront
    Fan(fan::Args),
    /// Show where chief rays meet the image, and how it is curved
    Distortion(distortion::Args),
    /// Show the image of a point by diffraction and by rays
    Psf(psf::Args),
    /// Show the contrast of gratings by diffraction and by rays
    Mtf(mtf::Args),
}

/// Runs `twinpupil optics`.
pub fn run(command: &Command, console: &Console) -> Result<()> {
    match command {
        Command::Show(args) => show::run(args, console),
        Command::Spot(args) => spot::run(args, console),
        Command::Fan(args) => fan::run(args, console),
        Command::Distortion(args) => distortion::run(args, console),
        Command::Psf(args) => psf::run(args, console),
        Command::Mtf(args) => mtf::run(args, console),
    }
}
