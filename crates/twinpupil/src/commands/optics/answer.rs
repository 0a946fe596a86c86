//! How an answer is given: as a text, as JSON or CSV, and drawn.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use serde::Serialize;

use crate::commands::destination::{Destination, pretty};
use crate::io::output::Outputs;
use crate::io::table::Table;

/// The forms of an answer.
#[derive(Debug, Args)]
pub(super) struct Form {
    /// As JSON
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// As CSV, which is also what an output file of that name gets
    #[arg(long)]
    csv: bool,
    /// Draw it as SVG
    #[arg(long, value_name = "FILE")]
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
        let is_csv = path.and_then(|path| path.extension()).is_some_and(|end| end.eq_ignore_ascii_case("csv"));
        let bytes = match () {
            () if self.json => pretty(answer)?.into_bytes(),
            () if self.csv || is_csv => answer.table().to_csv(),
            () => answer.text().into_bytes(),
        };
        outputs.add_or_print(path, bytes);
        if let Some(path) = &self.svg {
            outputs.add(path, svg().into_bytes());
        }
        outputs.commit()
    }
}
