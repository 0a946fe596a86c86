//! The tables behind the report.

use std::path::Path;

use anyhow::Result;

use super::Toleranced;
use super::rows;
use crate::io::folder::FolderOutputs;
use crate::io::table::{Cells, Table};

/// All cameras as CSV and Parquet, the places at which depth is judged, the contributors.
pub(super) fn add(files: &mut FolderOutputs, toleranced: &Toleranced) -> Result<()> {
    let cameras = rows::table(&toleranced.run, 0, &toleranced.rows);
    files.add("cameras.csv", cameras.to_csv());
    files.add("cameras.parquet", cameras.encode(Some(Path::new("cameras.parquet")))?);
    files.add("places.csv", places(toleranced).to_csv());
    files.add("contributors.csv", contributors(toleranced).to_csv());
    files.add("tolerances.toml", toleranced.spec.tolerances.clone().into_bytes());
    Ok(())
}

fn places(toleranced: &Toleranced) -> Table {
    let places = &toleranced.run.trial.volume.places_mm;
    let along = |axis: usize| Cells::Real(places.iter().map(|place| place[axis]).collect(), 6);
    Table::new()
        .with("place", Cells::Whole((0..places.len() as i64).collect()))
        .with("x_mm", along(0))
        .with("y_mm", along(1))
        .with("z_mm", along(2))
}

fn contributors(toleranced: &Toleranced) -> Table {
    let all = &toleranced.outcome.contributors;
    let real =
        |of: fn(&crate::design::tolerance::Contributor) -> f64| Cells::Scientific(all.iter().map(of).collect(), 6);
    Table::new()
        .with("contributor", Cells::Label(all.iter().map(|own| own.name.clone()).collect()))
        .with("tolerance", real(|own| own.tolerance))
        .with("unit", Cells::Label(all.iter().map(|own| own.unit.to_owned()).collect()))
        .with("before_rms_mm", real(|own| own.rms_mm[0]))
        .with("before_share", real(|own| own.share[0]))
        .with("after_rms_mm", real(|own| own.rms_mm[1]))
        .with("after_share", real(|own| own.share[1]))
}
