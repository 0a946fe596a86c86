//! `truth.csv`: where a simulated scene's points are.

use std::path::Path;

use anyhow::{Context, Result};

use super::read_table::ReadTable;
use super::table::{Cells, Table};

/// Decimals of lengths in mm: to a picometre, so that the truth is never the coarser side of a comparison.
const MM_DECIMALS: usize = 9;

/// One row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthRow {
    /// Number of the point in its scene.
    pub id: i64,
    /// x, y and z from the front principal point, mm.
    pub position_mm: [f64; 3],
}

/// The table of `rows`.
pub fn table(rows: &[TruthRow]) -> Table {
    let axis = |axis: usize| Cells::Real(rows.iter().map(|row| row.position_mm[axis]).collect(), MM_DECIMALS);
    Table::new()
        .with("id", Cells::Whole(rows.iter().map(|row| row.id).collect()))
        .with("x_mm", axis(0))
        .with("y_mm", axis(1))
        .with("z_mm", axis(2))
}

/// Reads a table.
pub fn read(path: &Path) -> Result<Vec<TruthRow>> {
    let table = ReadTable::read(path)?;
    rows(&table).with_context(|| path.display().to_string())
}

fn rows(table: &ReadTable) -> Result<Vec<TruthRow>> {
    let (id, position) = (table.whole("id")?, [table.finite("x_mm")?, table.finite("y_mm")?, table.finite("z_mm")?]);
    let row = |row: usize| TruthRow { id: id[row], position_mm: [0, 1, 2].map(|axis| position[axis][row]) };
    Ok((0..table.rows()).map(row).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back() {
        let expected = [TruthRow { id: 0, position_mm: [1.0, -2.000000001, 300.5] }];
        let text = String::from_utf8(table(&expected).to_csv()).unwrap();
        assert_eq!(text, "id,x_mm,y_mm,z_mm\n0,1.000000000,-2.000000001,300.500000000\n");
        assert_eq!(rows(&ReadTable::parse(&text).unwrap()).unwrap(), expected);
    }
}
