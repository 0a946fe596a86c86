//! Choices as a table, and back.

use anyhow::Result;

use crate::commands::parts;
use crate::design::{Choice, Pairs, PairsSpec};
use crate::io::read_table::ReadTable;
use crate::io::table::{Cells, Table};

/// Decimals in text files.
const DIGITS: usize = 6;

/// A number of a choice, by its column.
type Number = (&'static str, fn(&Choice) -> f64);

/// The numbers of a choice.
const COLUMNS: [Number; 9] = [
    ("telecentric_radius_mm", |choice| choice.radii_mm[0]),
    ("entocentric_radius_mm", |choice| choice.radii_mm[1]),
    ("telecentric_share", |choice| choice.shares[0]),
    ("entocentric_share", |choice| choice.shares[1]),
    ("electrons", |choice| choice.electrons),
    ("blur_near_px", |choice| choice.blur_px[0]),
    ("blur_far_px", |choice| choice.blur_px[1]),
    ("blind_mm", |choice| choice.blind_mm),
    ("z_std_mm", |choice| choice.z_std_mm),
];

impl parts::Run for Pairs {
    type Spec = PairsSpec;
    type Row = Choice;
    const PIECE: usize = 1;
    const COUNTED: &'static str = "pupils";

    fn of(spec: &PairsSpec) -> Result<Self> {
        spec.pairs()
    }

    fn rows(&self) -> usize {
        self.radii_mm.len()
    }

    fn row(&self, number: usize) -> Result<Choice> {
        self.choice(number)
    }

    fn table(&self, first: usize, rows: &[Choice]) -> Table {
        table(first, rows)
    }

    fn read(&self, table: &ReadTable) -> Result<Vec<Choice>> {
        read(table)
    }
}

/// Choices from number `first` on.
fn table(first: usize, choices: &[Choice]) -> Table {
    let numbers = (first..first + choices.len()).map(|number| number as i64).collect();
    let mut table = Table::new().with("row", Cells::Whole(numbers));
    for (name, of) in COLUMNS {
        table = table.with(name, Cells::Scientific(choices.iter().map(of).collect(), DIGITS));
    }
    table.with("fit", Cells::Flag(choices.iter().map(|choice| choice.is_fit).collect()))
}

/// The choices of a table.
fn read(table: &ReadTable) -> Result<Vec<Choice>> {
    let columns = COLUMNS.iter().map(|(name, _)| table.real(name)).collect::<Result<Vec<_>>>()?;
    let fit = table.whole("fit")?;
    let choice = |(n, fit): (usize, i64)| {
        let at = |column: usize| columns[column][n];
        Choice {
            radii_mm: [at(0), at(1)],
            shares: [at(2), at(3)],
            electrons: at(4),
            blur_px: [at(5), at(6)],
            // A band that sees nothing at all is blind to any radius.
            blind_mm: if at(7).is_nan() { f64::INFINITY } else { at(7) },
            z_std_mm: at(8),
            is_fit: fit == 1,
        }
    };
    Ok(fit.into_iter().enumerate().map(choice).collect())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn a_choice_comes_back_as_it_was() {
        let choice = Choice {
            radii_mm: [0.33, 0.61],
            shares: [1.0 / 3.0, 0.1 + 0.2],
            electrons: 19_520.7,
            blur_px: [1e-300, 2.5],
            blind_mm: 0.7,
            z_std_mm: std::f64::consts::PI,
            is_fit: true,
        };
        let blind = Choice { blind_mm: f64::INFINITY, z_std_mm: f64::NAN, is_fit: false, ..choice };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("choices.parquet");
        let bytes = table(3, &[choice, blind]).encode(Some(Path::new("choices.parquet"))).unwrap();
        std::fs::write(&path, bytes).unwrap();
        let found = read(&ReadTable::read(&path).unwrap()).unwrap();
        assert_eq!(found[0], choice);
        assert!(found[1].z_std_mm.is_nan() && !found[1].is_fit && found[1].blind_mm == f64::INFINITY);
    }
}
