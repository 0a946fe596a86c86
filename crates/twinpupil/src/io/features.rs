//! `features.csv`: what was found in each band.

use std::path::Path;

use anyhow::{Context, Result};
use twinpupil_instrument::PixelPoint;

use super::table::{Cells, CsvTable, Table};

/// Decimals of positions in px.
const PX_DECIMALS: usize = 6;
/// Decimals of areas in square px.
const AREA_DECIMALS: usize = 3;

/// One row. What is not known is NaN.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureRow {
    /// Name of the band.
    pub band: String,
    /// Number of the feature in its band.
    pub id: i64,
    /// Its centre in the frame, px.
    pub centre: PixelPoint,
    /// Standard deviations of the centre in u and v, px.
    pub std_px: [f64; 2],
    /// Its area in square pixels of the frame.
    pub area_px: f64,
}

/// The table of `rows`.
pub fn table(rows: &[FeatureRow]) -> Table {
    let real = |decimals, value: fn(&FeatureRow) -> f64| Cells::Real(rows.iter().map(value).collect(), decimals);
    Table::new()
        .with("band", Cells::Label(rows.iter().map(|row| row.band.clone()).collect()))
        .with("id", Cells::Whole(rows.iter().map(|row| row.id).collect()))
        .with("u_px", real(PX_DECIMALS, |row| row.centre.u))
        .with("v_px", real(PX_DECIMALS, |row| row.centre.v))
        .with("u_std_px", real(PX_DECIMALS, |row| row.std_px[0]))
        .with("v_std_px", real(PX_DECIMALS, |row| row.std_px[1]))
        .with("area_px", real(AREA_DECIMALS, |row| row.area_px))
}

/// Reads a table of which `band`, `id`, `u_px` and `v_px` must be there.
pub fn read(path: &Path) -> Result<Vec<FeatureRow>> {
    let table = CsvTable::read(path)?;
    rows(&table).with_context(|| path.display().to_string())
}

fn rows(table: &CsvTable) -> Result<Vec<FeatureRow>> {
    let (bands, id) = (table.labels("band")?, table.whole("id")?);
    let (u, v) = (table.finite("u_px")?, table.finite("v_px")?);
    let optional = |name| Ok::<_, anyhow::Error>(table.optional_real(name)?.unwrap_or(vec![f64::NAN; table.rows()]));
    let (u_std, v_std, area) = (optional("u_std_px")?, optional("v_std_px")?, optional("area_px")?);
    let row = |(row, band): (usize, String)| FeatureRow {
        band,
        id: id[row],
        centre: PixelPoint { u: u[row], v: v[row] },
        std_px: [u_std[row], v_std[row]],
        area_px: area[row],
    };
    Ok(bands.into_iter().enumerate().map(row).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back() {
        let row = FeatureRow {
            band: "red".to_owned(),
            id: 4,
            centre: PixelPoint { u: 12.5, v: 100.000001 },
            std_px: [0.002, 0.003],
            area_px: 5945.0,
        };
        let text = String::from_utf8(table(std::slice::from_ref(&row)).to_csv()).unwrap();
        assert!(text.starts_with("band,id,u_px,v_px,u_std_px,v_std_px,area_px\nred,4,12.500000,100.000001,"), "{text}");
        assert_eq!(rows(&CsvTable::parse(&text).unwrap()).unwrap(), [row]);
    }
}
