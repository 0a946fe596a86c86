//! How an answer is given: as a text, as JSON or CSV, and drawn.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use serde::Serialize;

use crate::commands::destination::{Destination, pretty};
use crate::commands::options::file_of;
use crate::drawing::Drawing;
use crate::io::output::Outputs;
use crate::io::table::Table;

/// The forms of an answer. Without one of them, a file is written as its name says: .csv, .json, .svg, .png, or else as text.
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
    /// Draw it as PNG
    #[arg(long, value_name = "FILE", value_parser = file_of("png"))]
    png: Option<PathBuf>,
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
    fn is_drawn(&self) -> bool {
        let is_text = !self.json && !self.csv;
        self.svg.is_some()
            || self.png.is_some()
            || (is_text && ["svg", "png"].contains(&ending(self.to.path()).as_str()))
    }

    /// Gives an answer, with its drawing if one is asked for; all files or none are written.
    pub(super) fn give(&self, answer: &impl Answer, drawing: impl FnOnce() -> Result<Drawing>) -> Result<()> {
        self.give_with(answer, drawing, Outputs::new())
    }

    /// The same, with further files.
    pub(super) fn give_with(
        &self,
        answer: &impl Answer,
        drawing: impl FnOnce() -> Result<Drawing>,
        mut outputs: Outputs,
    ) -> Result<()> {
        let path = self.to.path();
        let ending = ending(path);
        let drawing = self.is_drawn().then(drawing).transpose()?;
        let svg = drawing.as_ref().map(Drawing::to_svg).unwrap_or_default().into_bytes();
        let is_png = self.png.is_some() || ending == "png";
        let png = drawing.filter(|_| is_png).map(Drawing::into_png).transpose()?.unwrap_or_default();
        let bytes = match ending.as_str() {
            _ if self.json => pretty(answer)?.into_bytes(),
            _ if self.csv => answer.table().to_csv(),
            "csv" => answer.table().to_csv(),
            "json" => pretty(answer)?.into_bytes(),
            "svg" => svg.clone(),
            "png" => png.clone(),
            _ => answer.text().into_bytes(),
        };
        outputs.add_or_print(path, bytes);
        for (path, drawn) in [(&self.svg, svg), (&self.png, png)] {
            if let Some(path) = path {
                outputs.add(path, drawn);
            }
        }
        outputs.commit()
    }
}

/// The ending of a file's name in lower case; empty without one.
fn ending(path: Option<&Path>) -> String {
    let ending = path.and_then(Path::extension).map(|ending| ending.to_string_lossy().to_lowercase());
    ending.unwrap_or_default()
}
