//! `twinpupil instrument`: print an instrument file, or explain what it means.

use std::path::PathBuf;

use anyhow::Result;
use clap::Subcommand;
use twinpupil_instrument::{Instrument, paper};

use super::destination::{Destination, pretty};
use super::figures::Figures;
use crate::load::LoadedInstrument;

/// `twinpupil instrument …`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Print the instrument file of the paper, comments and all
    Paper(Destination),
    /// Show what follows from an instrument: magnifications, field of view, blur, depth per pixel
    Show {
        /// Instrument file, or the word `paper`
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
        /// Instrument file, or the word `paper`
        file: PathBuf,
        /// Where it goes.
        #[command(flatten)]
        to: Destination,
    },
    /// Print the JSON schema of instrument files
    Schema(Destination),
}

/// Runs `twinpupil instrument`.
pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Paper(to) => to.write(paper::INSTRUMENT_TOML.to_owned()),
        Command::Print { file, to } => to.write(LoadedInstrument::load(file)?.instrument.to_toml()),
        Command::Schema(to) => to.write(pretty(Instrument::json_schema().as_value())?),
        Command::Show { file, json, to } => {
            let figures = Figures::of(&LoadedInstrument::load(file)?)?;
            to.write(if *json { pretty(&figures)? } else { figures.to_text() })
        }
    }
}
