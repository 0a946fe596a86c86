//! How an answer is given: as a text, as JSON or CSV, and drawn.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::Args;
use serde::Serialize;

use crate::commands::destination::{Destination, pretty};
use crate::commands::options::file_of;
use crate::io::output::Outputs;
use crate::io::table::Table;

/// The forms of an answer. Without one of them, a file is written as its name says: .csv, .json, .svg, or else as text.
#[derive(Debug, Args)]
pub(super) struct Form {
    /// As JSON
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// As CSV
    #[arg(long)]
    csv: bool,
    /// Draw it as SVG
    #[arg(long, value_name = "FILE", value_parser = file_of("svg"))]
    svg: Option<PathBuf>,
    /// Where it goes.
    #[command(flatten)]
    to: Destination,
}

/// Something that can be told in every form.
pub(super) trait Answer: Serialize {
    /// For a terminal.
    fn text(&self) -> String;
    /// As columns.
    fn table(&self) -> Table;
}

impl Form {
    /// Whether a drawing is asked for.
    pub(super) fn is_drawn(&self) -> bool {
        self.svg.is_some() || (ending(self.to.path()) == "svg" && !self.json && !self.csv)
    }

    /// Gives an answer, with its drawing if one is asked for; all files or none are written.
    pub(super) fn give(&self, answer: &impl Answer, svg: impl FnOnce() -> String) -> Result<()> {
        self.give_with(answer, svg, Outputs::new())
    }

    /// The same, with further files.
    pub(super) fn give_with(
        &self,
        answer: &impl Answer,
        svg: impl FnOnce() -> String,
        mut outputs: Outputs,
    ) -> Result<()> {
        let path = self.to.path();
        let ending = ending(path);
        let drawing = if self.is_drawn() { svg().into_bytes() } else { Vec::new() };
        let bytes = match ending.as_str() {
            _ if self.json => pretty(answer)?.into_bytes(),
            _ if self.csv => answer.table().to_csv(),
            "csv" => answer.table().to_csv(),
            "json" => pretty(answer)?.into_bytes(),
            "svg" => drawing.clone(),
            "png" => bail!("an answer is no picture; legal for -o: a name that ends in .csv, .json or .svg, or a text"),
            _ => answer.text().into_bytes(),
        };
        outputs.add_or_print(path, bytes);
        if let Some(path) = &self.svg {
            outputs.add(path, drawing);
        }
        outputs.commit()
    }
}

/// The ending of a file's name in lower case; empty without one.
fn ending(path: Option<&Path>) -> String {
    let ending = path.and_then(Path::extension).map(|ending| ending.to_string_lossy().to_lowercase());
    ending.unwrap_or_default()
}
