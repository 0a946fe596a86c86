//! Tables as read, whatever kind of file they come from.

use std::path::Path;

use anyhow::{Context, Result, bail};
use csv::ReaderBuilder;

use super::{input, parquet, ply};

/// A table as read from CSV, PLY or Parquet: columns are found by their name, and every error names row and column.
#[derive(Debug, Clone)]
pub struct ReadTable {
    header: Vec<String>,
    /// Rows with their number.
    records: Vec<(u64, Vec<String>)>,
    /// What the number of a row counts.
    counted: &'static str,
}

impl ReadTable {
    /// Reads a file, or standard input for `-`; the first bytes tell what it is.
    pub fn read(path: &Path) -> Result<Self> {
        Self::of_bytes(input::read_bytes(path)?).with_context(|| path.display().to_string())
    }

    pub(super) fn of_bytes(bytes: Vec<u8>) -> Result<Self> {
        if bytes.starts_with(parquet::MAGIC) {
            return parquet::decode(bytes).and_then(|(header, rows)| Self::of_rows(header, rows));
        }
        if bytes.starts_with(ply::MAGIC) {
            return ply::decode(&bytes).and_then(|(header, rows)| Self::of_rows(header, rows));
        }
        Self::parse(&input::text(bytes)?)
    }

    fn of_rows(header: Vec<String>, rows: Vec<Vec<String>>) -> Result<Self> {
        let records = (1..).zip(rows).collect();
        Self { header, records, counted: "row" }.checked()
    }

    /// Reads a CSV text; lines that start with `#` are skipped.
    pub fn parse(text: &str) -> Result<Self> {
        let mut reader = ReaderBuilder::new().comment(Some(b'#')).flexible(true).from_reader(text.as_bytes());
        let header: Vec<String> = reader.headers()?.iter().map(|name| name.trim().to_owned()).collect();
        let mut records = Vec::new();
        for record in reader.into_records() {
            let record = record?;
            let line = record.position().map_or(0, |position| line_of(text, position));
            if record.len() != header.len() {
                bail!("line {line}: {} fields where the header has {}", record.len(), header.len());
            }
            records.push((line, record.iter().map(str::to_owned).collect()));
        }
        Self { header, records, counted: "line" }.checked()
    }

    /// Refuses a table in which a name does not tell the column.
    fn checked(self) -> Result<Self> {
        let Self { header, .. } = &self;
        if let Some(i) = (1..header.len()).find(|&i| header[..i].contains(&header[i])) {
            bail!("{}: column `{}` appears twice", self.top(), header[i]);
        }
        Ok(self)
    }

    /// Where the names of the columns stand.
    fn top(&self) -> &'static str {
        if self.counted == "line" { "line 1" } else { "header" }
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
        if self.has(name) { self.real(name).map(Some) } else { Ok(None) }
    }

    /// A column of numbers that must be there; an empty field is unknown and reads NaN.
    pub fn real(&self, name: &str) -> Result<Vec<f64>> {
        let parse = |text: &str| if text.is_empty() { Some(f64::NAN) } else { text.parse().ok() };
        self.parsed(name, "a number or empty", parse)
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
            bail!("{}: there is no column `{name}`", self.top());
        };
        let counted = self.counted;
        let value = |(number, record): &(u64, Vec<String>)| {
            let text = record[index].trim();
            parse(text).with_context(|| format!("{counted} {number}, column `{name}`: `{text}` is not {what}"))
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
    use super::super::table::{Cells, Table};
    use super::*;

    #[test]
    fn errors_name_line_and_column() {
        let message = |text: &str| {
            let table = ReadTable::parse(text)?;
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

    #[test]
    fn binary_tables_read_like_text() {
        let written = Table::new()
            .with("x_mm", Cells::Real(vec![1.5, 2.5], 1))
            .with("z_std_mm", Cells::Real(vec![f64::NAN, 0.25], 2))
            .with("ambiguous", Cells::Flag(vec![false, true]));
        for name in ["t.csv", "t.ply", "t.parquet"] {
            let table = ReadTable::of_bytes(written.encode(Some(Path::new(name))).unwrap()).unwrap();
            assert_eq!(table.rows(), 2);
            assert_eq!(table.finite("x_mm").unwrap(), [1.5, 2.5]);
            let deviations = table.optional_real("z_std_mm").unwrap().unwrap();
            assert!(deviations[0].is_nan() && deviations[1] == 0.25, "{name}");
            assert_eq!(table.whole("ambiguous").unwrap(), [0, 1]);
            let error = table.finite("z_std_mm").unwrap_err().to_string();
            assert!(error.ends_with(", column `z_std_mm`: `` is not a finite number"), "{error}");
        }
    }
}
