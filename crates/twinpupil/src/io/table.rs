//! Named columns: written as CSV or PLY, read back from CSV.

use std::path::Path;

use anyhow::{Context, Result, bail};
use csv::{ReaderBuilder, StringRecord, WriterBuilder};

use super::{input, ply};

/// The values of one column.
#[derive(Debug, Clone, PartialEq)]
pub enum Cells {
    /// Whole numbers.
    Whole(Vec<i64>),
    /// Numbers, and how many decimals a text file gives them. One that is not finite is unknown: an empty field.
    Real(Vec<f64>, usize),
    /// Words; a PLY, which has none, numbers them in the order of their first appearance.
    Label(Vec<String>),
}

/// One named column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Its name, with the unit.
    pub name: &'static str,
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
            Self::Real(values, _) => values.len(),
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
            Self::Real(values, _) if !values[row].is_finite() => String::new(),
            Self::Real(values, decimals) => format!("{:.decimals$}", values[row]),
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
    pub fn with(mut self, name: &'static str, cells: Cells) -> Self {
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
        writer.write_record(self.columns.iter().map(|column| column.name)).expect(into_memory);
        for row in 0..self.rows() {
            writer.write_record(self.columns.iter().map(|column| column.cells.text(row))).expect(into_memory);
        }
        writer.into_inner().expect(into_memory)
    }

    /// By the extension of `path`: PLY for `.ply`, CSV for `.csv` and where there is no path.
    pub fn encode(&self, path: Option<&Path>) -> Result<Vec<u8>> {
        Ok(match TableFile::of(path)? {
            TableFile::Csv => self.to_csv(),
            TableFile::Ply => ply::encode(self),
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
}

impl TableFile {
    fn of(path: Option<&Path>) -> Result<Self> {
        let Some(path) = path else { return Ok(Self::Csv) };
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match extension.as_str() {
            "csv" => Ok(Self::Csv),
            "ply" => Ok(Self::Ply),
            // A device or a pipe has no extension; what comes out of it is text.
            "" if path.exists() && !path.is_file() => Ok(Self::Csv),
            _ => bail!("{}: a table is written as .csv or .ply", path.display()),
        }
    }
}

/// A CSV table as read: columns are found by their name, and every error names line and column.
#[derive(Debug, Clone)]
pub struct CsvTable {
    header: Vec<String>,
    records: Vec<(u64, StringRecord)>,
}

impl CsvTable {
    /// Reads a file, or standard input for `-`; lines that start with `#` are skipped.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&input::read_text(path)?).with_context(|| path.display().to_string())
    }

    /// Reads a text.
    pub fn parse(text: &str) -> Result<Self> {
        let mut reader = ReaderBuilder::new().comment(Some(b'#')).flexible(true).from_reader(text.as_bytes());
        let header: Vec<String> = reader.headers()?.iter().map(|name| name.trim().to_owned()).collect();
        if let Some(i) = (1..header.len()).find(|&i| header[..i].contains(&header[i])) {
            bail!("line 1: column `{}` appears twice", header[i]);
        }
        let mut records = Vec::new();
        for record in reader.into_records() {
            let record = record?;
            let line = record.position().map_or(0, |position| line_of(text, position));
            if record.len() != header.len() {
                bail!("line {line}: {} fields where the header has {}", record.len(), header.len());
            }
            records.push((line, record));
        }
        Ok(Self { header, records })
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.records.len()
    }

    /// Whether there is a column of that name.
    pub fn has(&self, name: &str) -> bool {
        self.header.iter().any(|own| own == name)
    }

    /// A column of finite numbers that must be there.
    pub fn finite(&self, name: &str) -> Result<Vec<f64>> {
        self.parsed(name, "a finite number", |text| text.parse().ok().filter(|value: &f64| value.is_finite()))
    }

    /// A column of numbers where an empty field is unknown and reads NaN; `None` where there is no such column.
    pub fn optional_real(&self, name: &str) -> Result<Option<Vec<f64>>> {
        if !self.has(name) {
            return Ok(None);
        }
        let parse = |text: &str| if text.is_empty() { Some(f64::NAN) } else { text.parse().ok() };
        self.parsed(name, "a number or empty", parse).map(Some)
    }

    /// A column of whole numbers that must be there.
    pub fn whole(&self, name: &str) -> Result<Vec<i64>> {
        self.parsed(name, "a whole number", |text| text.parse().ok())
    }

    /// A column of words that must be there.
    pub fn labels(&self, name: &str) -> Result<Vec<String>> {
        self.parsed(name, "a word", |text| Some(text.to_owned()).filter(|text| !text.is_empty()))
    }

    fn parsed<T>(&self, name: &str, what: &str, parse: impl Fn(&str) -> Option<T>) -> Result<Vec<T>> {
        let Some(index) = self.header.iter().position(|own| own == name) else {
            bail!("line 1: there is no column `{name}`");
        };
        let value = |(line, record): &(u64, StringRecord)| {
            let text = record[index].trim();
            parse(text).with_context(|| format!("line {line}, column `{name}`: `{text}` is not {what}"))
        };
        self.records.iter().map(value).collect()
    }
}

/// Line of the record read from `position` on, where the reader stands before the empty lines and comments it skips.
fn line_of(text: &str, position: &csv::Position) -> u64 {
    let rest = text.get(position.byte() as usize..).unwrap_or_default();
    let skipped = rest.lines().take_while(|line| line.is_empty() || line.starts_with('#')).count();
    position.line() + skipped as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_has_fixed_decimals_and_empty_unknowns() {
        let table = Table::new()
            .with("id", Cells::Whole(vec![1, 2]))
            .with("z_mm", Cells::Real(vec![0.1 + 0.2, f64::NAN], 6))
            .with("band", Cells::Label(vec!["red".to_owned(), "a,b".to_owned()]));
        assert_eq!(String::from_utf8(table.to_csv()).unwrap(), "id,z_mm,band\n1,0.300000,red\n2,,\"a,b\"\n");
    }

    #[test]
    fn a_table_without_rows_is_its_header() {
        let table = Table::new().with("id", Cells::Whole(vec![])).with("z_mm", Cells::Real(vec![], 6));
        assert_eq!(table.to_csv(), b"id,z_mm\n");
    }

    #[test]
    fn errors_name_line_and_column() {
        let message = |text: &str| {
            let table = CsvTable::parse(text)?;
            table.finite("z_mm")?;
            table.optional_real("s_mm")
        };
        let cases = [
            ("id,x_mm\n1,2\n", "line 1: there is no column `z_mm`"),
            ("id,z_mm\n1,2\n\n# note\n2,abc\n", "line 5, column `z_mm`: `abc` is not a finite number"),
            ("id,z_mm\n1,\n", "line 2, column `z_mm`: `` is not a finite number"),
            ("id,z_mm\n1,inf\n", "line 2, column `z_mm`: `inf` is not a finite number"),
            ("id,z_mm\n1\n", "line 2: 1 fields where the header has 2"),
            ("id,z_mm,z_mm\n", "line 1: column `z_mm` appears twice"),
            ("z_mm,s_mm\n1,x\n", "line 2, column `s_mm`: `x` is not a number or empty"),
        ];
        for (text, expected) in cases {
            assert_eq!(message(text).unwrap_err().to_string(), expected);
        }
        let unknown = message("z_mm,s_mm\r\n1,\r\n").unwrap().expect("the column is there");
        assert!(unknown[0].is_nan());
        assert!(message("z_mm\n").unwrap().is_none());
    }
}
