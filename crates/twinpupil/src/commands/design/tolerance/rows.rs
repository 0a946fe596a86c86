//! Rows of a tolerance run as a table, and back.

use anyhow::Result;

use crate::commands::parts;
use crate::design::tolerance::{Kind, Reading, Row, Run, RunSpec};
use crate::io::read_table::ReadTable;
use crate::io::table::{Cells, Table};

/// Decimals of mm, px and of a number of any size in text files.
const MM: usize = 6;
const PX: usize = 5;
const ANY: usize = 6;

/// What a row says where there was such a camera.
const FINE: &str = "none";

impl parts::Run for Run {
    type Spec = RunSpec;
    type Row = Row;
    const PIECE: usize = 20;
    const COUNTED: &'static str = "cameras";

    fn of(spec: &RunSpec) -> Result<Self> {
        spec.run()
    }

    fn rows(&self) -> usize {
        Self::rows(self)
    }

    fn row(&self, number: usize) -> Result<Row> {
        Ok(Self::row(self, number))
    }

    fn table(&self, first: usize, rows: &[Row]) -> Table {
        table(self, first, rows)
    }

    fn read(&self, table: &ReadTable) -> Result<Vec<Row>> {
        read(self, table)
    }
}

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
fn read(run: &Run, table: &ReadTable) -> Result<Vec<Row>> {
    let sources = run.trial.drawing.sources.iter();
    let off = sources.map(|own| table.finite(&own.source.column())).collect::<Result<Vec<_>>>()?;
    let places = 0..run.trial.volume.places_mm.len();
    let before = places.clone().map(|place| table.real(&before_column(place))).collect::<Result<Vec<_>>>()?;
    let after = places.map(|place| table.real(&after_column(place))).collect::<Result<Vec<_>>>()?;
    let (residual_px, faults) = (table.real("residual_px")?, table.labels("fault")?);
    let row = |(n, fault): (usize, String)| {
        let of = |columns: &[Vec<f64>]| columns.iter().map(|column| column[n]).collect();
        let reading = Reading { before_mm: of(&before), after_mm: of(&after), residual_px: residual_px[n] };
        Row { off: of(&off), reading: if fault == FINE { Ok(reading) } else { Err(fault) } }
    };
    Ok(faults.into_iter().enumerate().map(row).collect())
}

fn before_column(place: usize) -> String {
    format!("before_{place}_mm")
}

fn after_column(place: usize) -> String {
    format!("after_{place}_mm")
}
