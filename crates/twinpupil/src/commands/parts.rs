//! A long run in parts: computed piece by piece, by one machine or by many, and put together.

use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use rayon::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::console::Console;
use crate::io::pieces::{Piece, Pieces};
use crate::io::read_table::ReadTable;
use crate::io::shard::Shard;
use crate::io::table::Table;

/// A run whose rows are computed each by itself.
pub trait Run: Sized + Sync {
    /// What makes it the same run, in plain text.
    type Spec: Serialize + DeserializeOwned;
    /// What is computed.
    type Row: Send;
    /// Rows of a piece: some seconds of work.
    const PIECE: usize;
    /// What its rows are.
    const COUNTED: &'static str;

    /// Ready to compute.
    fn of(spec: &Self::Spec) -> Result<Self>;
    /// Number of rows.
    fn rows(&self) -> usize;
    /// A row by its number from 0.
    fn row(&self, number: usize) -> Result<Self::Row>;
    /// Rows from number `first` on as a table.
    fn table(&self, first: usize, rows: &[Self::Row]) -> Table;
    /// The rows of such a table.
    fn read(&self, table: &ReadTable) -> Result<Vec<Self::Row>>;
}

/// The folder of pieces beside the results.
const FOLDER: &str = "pieces";

/// Computes a shard in the pieces of `output` that are not there yet; all rows of the run, if all its pieces are there then.
pub fn shared<R: Run>(
    spec: &R::Spec,
    run: &R,
    shard: Shard,
    output: &Path,
    console: &Console,
) -> Result<Option<Vec<R::Row>>> {
    let pieces = Pieces::new(spec, run.rows(), R::PIECE)?;
    let folder = output.join(FOLDER);
    work(run, &pieces, shard, &folder, console)?;
    let ready = ready(&pieces, &folder)?;
    let (done, all) = (ready.len(), pieces.ranges().len());
    if done < all {
        console.note(format!(
            "shard {shard} is done: {done} of {all} pieces are in {}; --merge puts all together",
            folder.display()
        ));
        return Ok(None);
    }
    rows(run, &pieces, ready).map(Some)
}

/// Puts pieces from anywhere together: files, or folders that hold them.
pub fn merged<R: Run>(paths: &[PathBuf]) -> Result<(R::Spec, R, Vec<R::Row>)> {
    let mut files = Vec::new();
    for path in paths {
        files.extend(pieces_at(path)?);
    }
    let read = files.iter().map(|path| Piece::read(path)).collect::<Result<Vec<_>>>()?;
    let Some(first) = read.first() else { bail!("there is no piece to merge") };
    let spec: R::Spec = first.run()?;
    let run = R::of(&spec).context("the run that the pieces are of")?;
    let rows = rows(&run, &Pieces::new(&spec, run.rows(), R::PIECE)?, read)?;
    Ok((spec, run, rows))
}

/// Computes the pieces of a shard that are not there yet.
fn work<R: Run>(run: &R, pieces: &Pieces, shard: Shard, folder: &Path, console: &Console) -> Result<()> {
    let mut open = Vec::new();
    let mut done = 0;
    for (_, rows) in pieces.ranges().into_iter().enumerate().filter(|(number, _)| shard.holds(*number)) {
        match pieces.load(folder, &rows)? {
            Some(_) => done += rows.len(),
            None => open.push(rows),
        }
    }
    if done > 0 {
        console.note(format!("{done} rows are in {} already", folder.display()));
    }
    if open.is_empty() {
        return Ok(());
    }
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let length = done + open.iter().map(Range::len).sum::<usize>();
    let bar = console.progress(length as u64, R::COUNTED);
    bar.inc(done as u64);
    for rows in open {
        let row = |row: usize| {
            let computed = run.row(row);
            bar.inc(1);
            computed
        };
        let computed = rows.clone().into_par_iter().map(row).collect::<Result<Vec<_>>>()?;
        pieces.store(folder, &rows, &run.table(rows.start, &computed))?;
    }
    bar.finish_and_clear();
    Ok(())
}

/// The pieces of a run that are in a folder.
fn ready(pieces: &Pieces, folder: &Path) -> Result<Vec<Piece>> {
    let load = |rows: &Range<usize>| pieces.load(folder, rows).transpose();
    pieces.ranges().iter().filter_map(load).collect()
}

/// All rows of a run from its pieces.
fn rows<R: Run>(run: &R, pieces: &Pieces, read: Vec<Piece>) -> Result<Vec<R::Row>> {
    let mut rows = Vec::new();
    for (_, table) in pieces.joined(read)? {
        rows.extend(run.read(&table)?);
    }
    Ok(rows)
}

/// A file, or the pieces in a folder or in that of its pieces.
fn pieces_at(path: &Path) -> Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let inner = path.join(FOLDER);
    let folder = if inner.is_dir() { inner } else { path.to_owned() };
    let entries = std::fs::read_dir(&folder).with_context(|| folder.display().to_string())?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "parquet"));
    paths.sort();
    if paths.is_empty() {
        bail!("{}: there is no piece of a run in this folder", folder.display());
    }
    Ok(paths)
}
