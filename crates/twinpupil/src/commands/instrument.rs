//! `twinpupil instrument`: print an instrument file, or explain what it means.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Subcommand;
use twinpupil_instrument::{Instrument, builtin};

use super::destination::{Destination, pretty};
use super::figures::Figures;
use crate::console::Console;
use crate::load::LoadedInstrument;

/// `twinpupil instrument …`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Print the instrument file of the paper, comments and all
    Paper(Destination),
    /// Print that of a camera with a polarizer on every pixel
    Polarizer(Destination),
    /// Print that of a hyperspectral camera, whose frames are ENVI cubes
    Hyperspectral(Destination),
    /// Print that of a camera with a beam splitter and a sensor for each band
    TwoSensors(Destination),
    /// Print that of a camera with a third pupil
    ThreeBands(Destination),
    /// Show what follows from an instrument: magnifications, field of view, blur, depth per pixel
    Show {
        /// Instrument file, or the name of one that ships, such as `paper`
        file: PathBuf,
        /// As JSON
        #[arg(long)]
        json: bool,
        /// Where it goes.
        #[command(flatten)]
        to: Destination,
    },
    /// Check an instrument file and print it back
    Print {
        /// Instrument file, or the name of one that ships, such as `paper`
        file: PathBuf,
        /// Where it goes.
        #[command(flatten)]
        to: Destination,
    },
    /// Print the JSON schema of instrument files
    Schema(Destination),
}

/// Runs `twinpupil instrument`.
pub fn run(command: &Command, console: &Console) -> Result<()> {
    match command {
        Command::Paper(to) => shipped("paper", to),
        Command::Polarizer(to) => shipped("polarizer", to),
        Command::Hyperspectral(to) => shipped("hyperspectral", to),
        Command::TwoSensors(to) => shipped("two-sensors", to),
        Command::ThreeBands(to) => shipped("three-bands", to),
        Command::Print { file, to } => to.write(LoadedInstrument::load(file, console)?.instrument.to_toml()),
        Command::Schema(to) => to.write(pretty(Instrument::json_schema().as_value())?),
        Command::Show { file, json, to } => {
            let figures = Figures::of(&LoadedInstrument::load(file, console)?)?;
            to.write(if *json { pretty(&figures)? } else { figures.to_text() })
        }
    }
}

fn shipped(name: &str, to: &Destination) -> Result<()> {
    let text = builtin::toml(name).with_context(|| format!("no instrument `{name}` ships"))?;
    to.write(text.to_owned())
}
