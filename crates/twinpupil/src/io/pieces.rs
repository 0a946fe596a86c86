//! A long run as pieces of rows, each a Parquet file that is whole or not there, which together are the whole table.
//!
//! Every file carries what makes the run the same run, as JSON, and which of its rows it holds. So a run that was stopped goes
//! on from its files, and files of other machines belong to it or are refused.

use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::read_table::ReadTable;
use super::table::Table;
use super::{input, output, parquet};

/// What every piece of a run carries.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Stamp {
    /// What makes the run the same run.
    run: Value,
    /// Which rows the file holds.
    rows: Range<usize>,
    /// Rows of the whole run.
    total: usize,
}

/// The note that the stamp is.
const NOTE: &str = "twinpupil.run";

/// A run and the folder that its pieces go into.
#[derive(Debug, Clone)]
pub struct Pieces {
    run: Value,
    total: usize,
    /// Rows of a piece.
    size: usize,
}

/// A piece as read.
#[derive(Debug, Clone)]
pub struct Piece {
    /// Where it was.
    path: PathBuf,
    stamp: Stamp,
    table: ReadTable,
}

impl Pieces {
    /// Of a run of so many rows, in pieces of `size`.
    pub fn new(run: &impl Serialize, total: usize, size: usize) -> Result<Self> {
        Ok(Self { run: serde_json::to_value(run)?, total, size })
    }

    /// Rows of all pieces.
    pub fn ranges(&self) -> Vec<Range<usize>> {
        (0..self.total).step_by(self.size).map(|first| first..self.total.min(first + self.size)).collect()
    }

    /// The file of a piece in a folder.
    pub fn path(&self, folder: &Path, rows: &Range<usize>) -> PathBuf {
        folder.join(format!("rows-{:06}-{:06}.parquet", rows.start, rows.end - 1))
    }

    /// Writes a piece into a folder.
    pub fn store(&self, folder: &Path, rows: &Range<usize>, table: &Table) -> Result<()> {
        let stamp = Stamp { run: self.run.clone(), rows: rows.clone(), total: self.total };
        let bytes = parquet::encode_with_notes(table, &[(NOTE, serde_json::to_string(&stamp)?)])?;
        output::write(Some(&self.path(folder, rows)), bytes)
    }

    /// The piece of these rows from a folder, if it is there; one of another run is refused.
    pub fn load(&self, folder: &Path, rows: &Range<usize>) -> Result<Option<Piece>> {
        let path = self.path(folder, rows);
        if !path.exists() {
            return Ok(None);
        }
        let piece = Piece::read(&path)?;
        let another = "legal: another folder, or none of the files of that run";
        self.check(&piece).map_err(|error| anyhow::anyhow!("{error}; {another}"))?;
        Ok(Some(piece))
    }

    /// Puts pieces together to the tables of the whole run, in the order of its rows.
    pub fn joined(&self, pieces: Vec<Piece>) -> Result<Vec<(Range<usize>, ReadTable)>> {
        let mut pieces = pieces;
        pieces.sort_by_key(|piece| (piece.stamp.rows.start, piece.stamp.rows.end));
        let mut next = 0;
        for (place, piece) in pieces.iter().enumerate() {
            self.check(piece)?;
            let Range { start, end } = piece.stamp.rows;
            if start > next {
                bail!("the piece with rows {next} to {} of {} is missing", start - 1, self.total);
            }
            if start < next {
                let other = pieces[place - 1].path.display();
                bail!("{}: rows from {start} on are in {other} as well; legal: each piece once", piece.path.display());
            }
            next = end;
        }
        if next < self.total {
            bail!("the piece with rows {next} to {} of {} is missing", self.total - 1, self.total);
        }
        Ok(pieces.into_iter().map(|piece| (piece.stamp.rows, piece.table)).collect())
    }

    /// Refuses a piece of another run.
    fn check(&self, piece: &Piece) -> Result<()> {
        let (own, other) = (&self.run, &piece.stamp.run);
        if own == other && self.total == piece.stamp.total {
            return Ok(());
        }
        let path = piece.path.display();
        let (Value::Object(own), Value::Object(other)) = (own, other) else { bail!("{path}: a piece of another run") };
        let Some((key, value)) = own.iter().find(|(key, value)| other.get(*key) != Some(value)) else {
            bail!("{path}: a piece of another run")
        };
        match (number(value), other.get(key).and_then(number)) {
            // Numbers are told, texts are too long.
            (Some(value), Some(found)) => bail!("{path}: a piece of another run: its {key} is {found}, not {value}"),
            _ => bail!("{path}: a piece of another run: its {key} is another"),
        }
    }
}

/// A number as it is told: 300, not 300.0.
fn number(value: &Value) -> Option<String> {
    let number = value.as_number()?;
    Some(number.as_f64().filter(|_| number.is_f64()).map_or_else(|| number.to_string(), |real| real.to_string()))
}

impl Piece {
    /// Reads a file.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = input::read_bytes(path)?;
        let piece = || -> Result<Self> {
            if !bytes.starts_with(parquet::MAGIC) {
                bail!("no Parquet file; legal: pieces of a run, as `--shard` leaves them");
            }
            let note = parquet::note(bytes.clone(), NOTE)?.context("no piece of a run")?;
            let stamp: Stamp = serde_json::from_str(&note).ok().context("no piece of a run")?;
            let table = ReadTable::of_bytes(bytes)?;
            if stamp.rows.len() != table.rows() || stamp.rows.end > stamp.total {
                bail!("{} rows where its note says {}: the file is damaged", table.rows(), stamp.rows.len());
            }
            Ok(Self { path: path.to_owned(), stamp, table })
        };
        piece().with_context(|| path.display().to_string())
    }

    /// What makes its run the same run.
    pub fn run<T: serde::de::DeserializeOwned>(&self) -> Result<T> {
        let run = serde_json::from_value(self.stamp.run.clone()).ok();
        run.with_context(|| format!("{}: a piece of a run of another kind", self.path.display()))
    }
}

#[cfg(test)]
mod tests {
    use super::super::table::Cells;
    use super::*;

    #[derive(Serialize)]
    struct Run {
        seed: u64,
        text: &'static str,
    }

    fn pieces(seed: u64, text: &'static str) -> Pieces {
        Pieces::new(&Run { seed, text }, 10, 4).unwrap()
    }

    fn store(pieces: &Pieces, folder: &Path, rows: &Range<usize>) {
        let values = rows.clone().map(|row| 1.0 / (row as f64 + 3.0)).collect();
        pieces.store(folder, rows, &Table::new().with("z_mm", Cells::Real(values, 3))).unwrap();
    }

    fn read_all(pieces: &Pieces, folder: &Path) -> Vec<Piece> {
        pieces.ranges().iter().filter_map(|rows| pieces.load(folder, rows).unwrap()).collect()
    }

    #[test]
    fn a_number_of_a_run_comes_back_as_it_was() {
        for value in [300.0_f64, 0.85 * 310.1, 1.0 / 3.0, 5e-324, 1.797_693_134_862_315_7e308, -0.0] {
            let text = serde_json::to_string(&value).unwrap();
            let read: f64 = serde_json::from_str(&text).unwrap();
            assert_eq!(read.to_bits(), value.to_bits(), "{text}");
        }
    }

    #[test]
    fn pieces_in_any_order_are_the_whole_to_the_last_bit() {
        let folder = tempfile::tempdir().unwrap();
        let pieces = pieces(1, "a");
        assert_eq!(pieces.ranges(), [0..4, 4..8, 8..10]);
        pieces.ranges().iter().for_each(|rows| store(&pieces, folder.path(), rows));
        let mut read = read_all(&pieces, folder.path());
        read.reverse();
        let joined = pieces.joined(read).unwrap();
        let values: Vec<f64> = joined.iter().flat_map(|(_, table)| table.finite("z_mm").unwrap()).collect();
        assert_eq!(values, (0..10).map(|row| 1.0 / (f64::from(row) + 3.0)).collect::<Vec<_>>());
    }

    #[test]
    fn what_does_not_belong_together_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let own = pieces(1, "a");
        store(&own, folder.path(), &(0..4));
        store(&own, folder.path(), &(8..10));
        let read = read_all(&own, folder.path());
        let said = |pieces: &Pieces, read: Vec<Piece>| pieces.joined(read).unwrap_err().to_string();
        assert_eq!(said(&own, read.clone()), "the piece with rows 4 to 7 of 10 is missing");
        assert_eq!(said(&own, read[..1].to_vec()), "the piece with rows 4 to 9 of 10 is missing");
        assert!(said(&own, vec![read[0].clone(), read[0].clone()]).contains("rows from 0 on are in "));
        assert!(said(&pieces(2, "a"), read.clone()).ends_with("another run: its seed is 1, not 2"));
        assert!(said(&pieces(1, "b"), read.clone()).ends_with("another run: its text is another"));
        assert!(said(&pieces(1, "1.5"), read).ends_with("another run: its text is another"));
        let told = |value: Value| number(&value);
        assert_eq!((told(1.5.into()).as_deref(), told(300.0.into()).as_deref()), (Some("1.5"), Some("300")));
        assert_eq!((told(u64::MAX.into()).as_deref(), told("a".into())), (Some("18446744073709551615"), None));
        let refused = pieces(2, "a").load(folder.path(), &(0..4)).unwrap_err().to_string();
        assert!(refused.ends_with("its seed is 1, not 2; legal: another folder, or none of the files of that run"));

        let path = own.path(folder.path(), &(0..4));
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        assert!(format!("{:#}", own.load(folder.path(), &(0..4)).unwrap_err()).contains("cannot be read"));
        std::fs::write(&path, "row\n1\n").unwrap();
        assert!(format!("{:#}", own.load(folder.path(), &(0..4)).unwrap_err()).contains("no Parquet file"));
        std::fs::write(&path, parquet::encode(&Table::new().with("a", Cells::Whole(vec![1]))).unwrap()).unwrap();
        assert!(format!("{:#}", own.load(folder.path(), &(0..4)).unwrap_err()).ends_with("no piece of a run"));
    }
}
