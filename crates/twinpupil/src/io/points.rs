//! `points.csv`: reconstructed points with their deviations.

use std::path::Path;

use anyhow::{Context, Result};
use twinpupil_instrument::PixelPoint;

use super::table::{Cells, CsvTable, Table};

/// Decimals of lengths in mm: to a nanometre, far below any deviation.
const MM_DECIMALS: usize = 6;
/// Decimals of positions in px: z moves by about 2 nm for each 1e-6 px at r = 2 mm.
const PX_DECIMALS: usize = 6;
/// Decimals of Γ, of which 1e-9 is a third of a nanometre of depth.
const GAMMA_DECIMALS: usize = 9;

/// One row. What is not known is NaN.
#[derive(Debug, Clone, PartialEq)]
pub struct PointRow {
    /// Number of the point in its frame.
    pub id: i64,
    /// x, y and z from the front principal point, mm.
    pub position_mm: [f64; 3],
    /// Standard deviations of x, y and z, mm.
    pub std_mm: [f64; 3],
    /// Γ = r_R / r_B  [Ohno2018, Eq. 12].
    pub gamma: f64,
    /// Where the telecentric band sees the point, px.
    pub telecentric: PixelPoint,
    /// Where the entocentric band sees the point, px.
    pub entocentric: PixelPoint,
}

/// The table of `rows`.
pub fn table(rows: &[PointRow]) -> Table {
    let real = |decimals, value: fn(&PointRow) -> f64| Cells::Real(rows.iter().map(value).collect(), decimals);
    Table::new()
        .with("id", Cells::Whole(rows.iter().map(|row| row.id).collect()))
        .with("x_mm", real(MM_DECIMALS, |row| row.position_mm[0]))
        .with("y_mm", real(MM_DECIMALS, |row| row.position_mm[1]))
        .with("z_mm", real(MM_DECIMALS, |row| row.position_mm[2]))
        .with("x_std_mm", real(MM_DECIMALS, |row| row.std_mm[0]))
        .with("y_std_mm", real(MM_DECIMALS, |row| row.std_mm[1]))
        .with("z_std_mm", real(MM_DECIMALS, |row| row.std_mm[2]))
        .with("gamma", real(GAMMA_DECIMALS, |row| row.gamma))
        .with("telecentric_u_px", real(PX_DECIMALS, |row| row.telecentric.u))
        .with("telecentric_v_px", real(PX_DECIMALS, |row| row.telecentric.v))
        .with("entocentric_u_px", real(PX_DECIMALS, |row| row.entocentric.u))
        .with("entocentric_v_px", real(PX_DECIMALS, |row| row.entocentric.v))
}

/// Reads a table of which only `x_mm`, `y_mm` and `z_mm` must be there; rows without `id` are numbered from 0.
pub fn read(path: &Path) -> Result<Vec<PointRow>> {
    let table = CsvTable::read(path)?;
    rows(&table).with_context(|| path.display().to_string())
}

fn rows(table: &CsvTable) -> Result<Vec<PointRow>> {
    let position = [table.finite("x_mm")?, table.finite("y_mm")?, table.finite("z_mm")?];
    let optional = |name| Ok::<_, anyhow::Error>(table.optional_real(name)?.unwrap_or(vec![f64::NAN; table.rows()]));
    let std = [optional("x_std_mm")?, optional("y_std_mm")?, optional("z_std_mm")?];
    let gamma = optional("gamma")?;
    let telecentric = [optional("telecentric_u_px")?, optional("telecentric_v_px")?];
    let entocentric = [optional("entocentric_u_px")?, optional("entocentric_v_px")?];
    let id = if table.has("id") { table.whole("id")? } else { (0..table.rows() as i64).collect() };
    Ok((0..table.rows())
        .map(|row| PointRow {
            id: id[row],
            position_mm: [0, 1, 2].map(|axis| position[axis][row]),
            std_mm: [0, 1, 2].map(|axis| std[axis][row]),
            gamma: gamma[row],
            telecentric: PixelPoint { u: telecentric[0][row], v: telecentric[1][row] },
            entocentric: PixelPoint { u: entocentric[0][row], v: entocentric[1][row] },
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_is_the_contract() {
        let header = "id,x_mm,y_mm,z_mm,x_std_mm,y_std_mm,z_std_mm,gamma,telecentric_u_px,telecentric_v_px,\
            entocentric_u_px,entocentric_v_px\n";
        assert_eq!(String::from_utf8(table(&[]).to_csv()).unwrap(), header);
    }

    #[test]
    fn what_is_written_is_read_back() {
        let row = PointRow {
            id: 3,
            position_mm: [1.25, -7.5, 300.000001],
            std_mm: [0.0005, 0.001, f64::NAN],
            gamma: 1.013234567,
            telecentric: PixelPoint { u: 959.5, v: 1.0 },
            entocentric: PixelPoint { u: f64::NAN, v: -2.0 },
        };
        let text = String::from_utf8(table(std::slice::from_ref(&row)).to_csv()).unwrap();
        let back = rows(&CsvTable::parse(&text).unwrap()).unwrap();
        assert_eq!(format!("{back:?}"), format!("{:?}", [row]));
    }

    #[test]
    fn positions_alone_are_enough() {
        let table = CsvTable::parse("z_mm,y_mm,x_mm,colour\n3,2,1,red\n6,5,4,blue\n").unwrap();
        let rows = rows(&table).unwrap();
        assert_eq!((rows[1].id, rows[1].position_mm), (1, [4.0, 5.0, 6.0]));
        assert!(rows[0].std_mm[2].is_nan());
    }
}
