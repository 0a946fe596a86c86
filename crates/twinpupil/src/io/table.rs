//! Named columns, written as CSV, PLY or Parquet.

use std::borrow::Cow;
use std::path::Path;

use anyhow::{Result, bail};
use csv::WriterBuilder;

use super::{parquet, ply};

/// The values of one column.
#[derive(Debug, Clone, PartialEq)]
pub enum Cells {
    /// Whole numbers.
    Whole(Vec<i64>),
    /// Numbers, and how many decimals a text file gives them. One that is not finite is unknown: an empty field.
    Real(Vec<f64>, usize),
    /// Numbers of any magnitude, and how many decimals a text file gives them before the exponent.
    Scientific(Vec<f64>, usize),
    /// Yes or no: 1 or 0 where the file has numbers alone.
    Flag(Vec<bool>),
    /// Words; a PLY, which has none, numbers them in the order of their first appearance.
    Label(Vec<String>),
}

/// One named column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Its name, with the unit.
    pub name: Cow<'static, str>,
    /// Its values.
    pub cells: Cells,
}

/// Columns of equal length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    columns: Vec<Column>,
}

impl Cells {
    /// Number of values.
    pub fn len(&self) -> usize {
        match self {
            Self::Whole(values) => values.len(),
            Self::Real(values, _) | Self::Scientific(values, _) => values.len(),
            Self::Flag(values) => values.len(),
            Self::Label(values) => values.len(),
        }
    }

    /// Whether there are no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn text(&self, row: usize) -> String {
        match self {
            Self::Whole(values) => values[row].to_string(),
            Self::Real(values, _) | Self::Scientific(values, _) if !values[row].is_finite() => String::new(),
            Self::Real(values, decimals) => format!("{:.decimals$}", values[row]),
            Self::Scientific(values, decimals) => format!("{:.decimals$e}", values[row]),
            Self::Flag(values) => u8::from(values[row]).to_string(),
            Self::Label(values) => values[row].clone(),
        }
    }
}

impl Table {
    /// A table without columns.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a column on the right, of as many rows as the others have.
    pub fn with(mut self, name: impl Into<Cow<'static, str>>, cells: Cells) -> Self {
        let name = name.into();
        debug_assert!(self.columns.is_empty() || self.rows() == cells.len(), "column {name} has another length");
        self.columns.push(Column { name, cells });
        self
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.columns.iter().map(|column| column.cells.len()).min().unwrap_or(0)
    }

    /// The columns from left to right.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// As CSV: a header, then a line for each row.
    pub fn to_csv(&self) -> Vec<u8> {
        let mut writer = WriterBuilder::new().from_writer(Vec::new());
        let into_memory = "writing into memory does not fail";
        writer.write_record(self.columns.iter().map(|column| column.name.as_bytes())).expect(into_memory);
        for row in 0..self.rows() {
            writer.write_record(self.columns.iter().map(|column| column.cells.text(row))).expect(into_memory);
        }
        writer.into_inner().expect(into_memory)
    }

    /// By the extension of `path`: PLY for `.ply`, Parquet for `.parquet`, CSV for `.csv` and where there is no path.
    pub fn encode(&self, path: Option<&Path>) -> Result<Vec<u8>> {
        Ok(match TableFile::of(path)? {
            TableFile::Csv => self.to_csv(),
            TableFile::Ply => ply::encode(self),
            TableFile::Parquet => parquet::encode(self)?,
        })
    }
}

/// Refuses a path to which no table can be written, before any work is done.
pub fn check_table_path(path: &Path) -> Result<()> {
    TableFile::of(Some(path)).map(|_| ())
}

enum TableFile {
    Csv,
    Ply,
    Parquet,
}

impl TableFile {
    fn of(path: Option<&Path>) -> Result<Self> {
        let Some(path) = path else { return Ok(Self::Csv) };
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match extension.as_str() {
            "csv" => Ok(Self::Csv),
            "ply" => Ok(Self::Ply),
            "parquet" => Ok(Self::Parquet),
            // A device or a pipe has no extension; what comes out of it is text.
            "" if path.exists() && !path.is_file() => Ok(Self::Csv),
            _ => bail!("{}: a table is written as .csv, .ply or .parquet", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_has_fixed_decimals_and_empty_unknowns() {
        let table = Table::new()
            .with("id", Cells::Whole(vec![1, 2]))
            .with("z_mm", Cells::Real(vec![0.1 + 0.2, f64::NAN], 6))
            .with("xz_mm2", Cells::Scientific(vec![-1.25e-9, f64::NAN], 3))
            .with("used", Cells::Flag(vec![true, false]))
            .with("band", Cells::Label(vec!["red".to_owned(), "a,b".to_owned()]));
        let expected = "id,z_mm,xz_mm2,used,band\n1,0.300000,-1.250e-9,1,red\n2,,,0,\"a,b\"\n";
        assert_eq!(String::from_utf8(table.to_csv()).unwrap(), expected);
    }

    #[test]
    fn a_table_without_rows_is_its_header() {
        let table = Table::new().with("id", Cells::Whole(vec![])).with("z_mm", Cells::Real(vec![], 6));
        assert_eq!(table.to_csv(), b"id,z_mm\n");
    }
}
