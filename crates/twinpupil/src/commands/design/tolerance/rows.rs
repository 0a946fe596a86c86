//! Rows of a tolerance run as a table, and back.

use anyhow::Result;

use crate::design::tolerance::{Kind, Reading, Row, Run};
use crate::io::read_table::ReadTable;
use crate::io::table::{Cells, Table};

/// Decimals of mm, px and of a number of any size in text files.
const MM: usize = 6;
const PX: usize = 5;
const ANY: usize = 6;

/// What a row says where there was such a camera.
const FINE: &str = "none";

/// Rows from number `first` on.
pub(super) fn table(run: &Run, first: usize, rows: &[Row]) -> Table {
    let word = |row: usize| match run.kind(row) {
        Kind::Single(_) => "single".to_owned(),
        Kind::Camera(_) => "camera".to_owned(),
    };
    let numbers = first..first + rows.len();
    let mut table = Table::new()
        .with("row", Cells::Whole(numbers.clone().map(|row| row as i64).collect()))
        .with("kind", Cells::Label(numbers.map(word).collect()));
    for (index, own) in run.trial.drawing.sources.iter().enumerate() {
        let off = rows.iter().map(|row| row.off[index]).collect();
        table = table.with(own.source.column(), Cells::Scientific(off, ANY));
    }
    let column = |of: &dyn Fn(&Reading) -> f64| -> Vec<f64> {
        rows.iter().map(|row| row.reading.as_ref().map_or(f64::NAN, of)).collect()
    };
    table = table.with("residual_px", Cells::Real(column(&|reading| reading.residual_px), PX));
    for place in 0..run.trial.volume.places_mm.len() {
        let before = column(&|reading| reading.before_mm[place]);
        table = table.with(before_column(place), Cells::Real(before, MM));
    }
    for place in 0..run.trial.volume.places_mm.len() {
        let after = column(&|reading| reading.after_mm[place]);
        table = table.with(after_column(place), Cells::Real(after, MM));
    }
    let fault = |row: &Row| row.reading.as_ref().err().cloned().unwrap_or_else(|| FINE.to_owned());
    table.with("fault", Cells::Label(rows.iter().map(fault).collect()))
}

/// The rows of a table.
pub(super) fn rows(run: &Run, table: &ReadTable) -> Result<Vec<Row>> {
    let sources = run.trial.drawing.sources.iter();
    let off = sources.map(|own| table.finite(&own.source.column())).collect::<Result<Vec<_>>>()?;
    let places = 0..run.trial.volume.places_mm.len();
    let before = places.clone().map(|place| known(table, &before_column(place))).collect::<Result<Vec<_>>>()?;
    let after = places.map(|place| known(table, &after_column(place))).collect::<Result<Vec<_>>>()?;
    let (residual_px, faults) = (known(table, "residual_px")?, table.labels("fault")?);
    let row = |(n, fault): (usize, String)| {
        let of = |columns: &[Vec<f64>]| columns.iter().map(|column| column[n]).collect();
        let reading = Reading { before_mm: of(&before), after_mm: of(&after), residual_px: residual_px[n] };
        Row { off: of(&off), reading: if fault == FINE { Ok(reading) } else { Err(fault) } }
    };
    Ok(faults.into_iter().enumerate().map(row).collect())
}

/// A column of numbers, NaN where one is unknown.
fn known(table: &ReadTable, name: &str) -> Result<Vec<f64>> {
    match table.optional_real(name)? {
        Some(values) => Ok(values),
        // Says which column is missing.
        None => table.finite(name),
    }
}

fn before_column(place: usize) -> String {
    format!("before_{place}_mm")
}

fn after_column(place: usize) -> String {
    format!("after_{place}_mm")
}
