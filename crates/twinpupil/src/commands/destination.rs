//! Where a command's text goes.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use serde::Serialize;

use crate::io::output;

/// `-o FILE`, or standard output.
#[derive(Debug, Args)]
pub struct Destination {
    /// File to write; standard output if left out
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

impl Destination {
    /// The file, if it is not standard output.
    pub fn path(&self) -> Option<&Path> {
        self.output.as_deref()
    }

    /// Writes a text.
    pub fn write(&self, text: String) -> Result<()> {
        output::write(self.output.as_deref(), text.into_bytes())
    }
}

/// A value as indented JSON.
pub fn pretty(value: &impl Serialize) -> Result<String> {
    Ok(serde_json::to_string_pretty(value)? + "\n")
}
