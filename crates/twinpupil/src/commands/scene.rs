//! `twinpupil scene`: print a scene file.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Subcommand;
use twinpupil_simulate::Scene;

use super::destination::{Destination, pretty};
use crate::load;

/// `twinpupil scene …`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Print the paper's plate of random dots at 300 mm as a scene file
    Paper(Destination),
    /// Check a scene file and print it back
    Print {
        /// Scene file, or the word `paper`
        file: PathBuf,
        /// Where it goes.
        #[command(flatten)]
        to: Destination,
    },
    /// Print the JSON schema of scene files
    Schema(Destination),
}

/// Runs `twinpupil scene`.
pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Paper(to) => to.write(load::scene(Path::new(load::PAPER))?.to_toml()),
        Command::Print { file, to } => to.write(load::scene(file)?.to_toml()),
        Command::Schema(to) => to.write(pretty(Scene::json_schema().as_value())?),
    }
}
