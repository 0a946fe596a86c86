//! `points.csv`: reconstructed points with their deviations.

use std::path::Path;

use anyhow::{Context, Result};
use twinpupil_reconstruct::Point;

use super::read_table::ReadTable;
use super::table::{Cells, Table};

/// Decimals of lengths in mm: to a nanometre, far below any deviation.
const MM_DECIMALS: usize = 6;
/// Decimals of deviations in mm: the least is some 30 nm, and their squares and the covariances make one matrix.
const STD_DECIMALS: usize = 9;
/// Decimals of covariances before the exponent.
const COVARIANCE_DECIMALS: usize = 6;
/// Decimals of χ².
const CHI2_DECIMALS: usize = 4;
/// Decimals of positions in px: z moves by about 2 nm for each 1e-6 px at r = 2 mm.
const PX_DECIMALS: usize = 6;
/// Decimals of Γ, of which 1e-9 is a third of a nanometre of depth.
const GAMMA_DECIMALS: usize = 9;

/// The points of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FramePoints {
    /// The frame's file.
    pub frame: String,
    /// Its points; their index is their id.
    pub points: Vec<Point>,
    /// Deviations of x, y and z that a calibrated instrument's numbers leave, mm, for every point; none if it was not
    /// calibrated.
    pub calibration_std_mm: Option<Vec<[f64; 3]>>,
}

/// The table of all points, with a column `frame` where there are several frames.
pub fn table(frames: &[FramePoints]) -> Table {
    let points = || frames.iter().flat_map(|frame| &frame.points);
    let real = |decimals, value: fn(&Point) -> f64| Cells::Real(points().map(value).collect(), decimals);
    let flag = |value: fn(&Point) -> bool| Cells::Flag(points().map(value).collect());
    let covariance = |i: usize, k: usize| {
        Cells::Scientific(points().map(|point| point.covariance_mm2[i][k]).collect(), COVARIANCE_DECIMALS)
    };
    let ids = frames.iter().flat_map(|frame| 0..frame.points.len() as i64).collect();
    let table = Table::new()
        .with("id", Cells::Whole(ids))
        .with("x_mm", real(MM_DECIMALS, |point| point.position_mm[0]))
        .with("y_mm", real(MM_DECIMALS, |point| point.position_mm[1]))
        .with("z_mm", real(MM_DECIMALS, |point| point.position_mm[2]))
        .with("x_std_mm", real(STD_DECIMALS, |point| point.std_mm[0]))
        .with("y_std_mm", real(STD_DECIMALS, |point| point.std_mm[1]))
        .with("z_std_mm", real(STD_DECIMALS, |point| point.std_mm[2]))
        .with("gamma", real(GAMMA_DECIMALS, |point| point.gamma))
        .with("telecentric_u_px", real(PX_DECIMALS, |point| point.telecentric.centre.u))
        .with("telecentric_v_px", real(PX_DECIMALS, |point| point.telecentric.centre.v))
        .with("entocentric_u_px", real(PX_DECIMALS, |point| point.entocentric.centre.u))
        .with("entocentric_v_px", real(PX_DECIMALS, |point| point.entocentric.centre.v))
        .with("diameter_mm", real(MM_DECIMALS, |point| point.diameter_mm))
        .with("azimuth_residual_px", real(PX_DECIMALS, |point| point.azimuth_residual_px))
        .with("overlapped", flag(|point| point.telecentric.overlapped || point.entocentric.overlapped))
        .with("ambiguous", flag(|point| point.ambiguous))
        .with("xy_cov_mm2", covariance(0, 1))
        .with("xz_cov_mm2", covariance(0, 2))
        .with("yz_cov_mm2", covariance(1, 2))
        .with("match_chi2", real(CHI2_DECIMALS, |point| point.match_chi2))
        .with("match_dof", Cells::Whole(points().map(|point| point.match_dof as i64).collect()))
        .with("pixel_chi2", real(CHI2_DECIMALS, |point| point.pixel_chi2.unwrap_or(f64::NAN)));
    let table = with_calibration(table, frames);
    if frames.len() < 2 {
        return table;
    }
    let names = frames.iter().flat_map(|frame| frame.points.iter().map(|_| frame.frame.clone())).collect();
    table.with("frame", Cells::Label(names))
}

/// Adds what calibration leaves uncertain, where the frames come from a calibrated instrument.
fn with_calibration(table: Table, frames: &[FramePoints]) -> Table {
    let stds: Option<Vec<&Vec<[f64; 3]>>> = frames.iter().map(|frame| frame.calibration_std_mm.as_ref()).collect();
    let Some(stds) = stds.filter(|stds| !stds.is_empty()) else { return table };
    let names = ["x_calibration_std_mm", "y_calibration_std_mm", "z_calibration_std_mm"];
    names.into_iter().enumerate().fold(table, |table, (axis, name)| {
        let values = stds.iter().flat_map(|stds| stds.iter().map(move |std_mm| std_mm[axis])).collect();
        table.with(name, Cells::Real(values, STD_DECIMALS))
    })
}

/// A point as read back. What is not known is NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointRow {
    /// x, y and z from the front principal point, mm.
    pub position_mm: [f64; 3],
    /// Standard deviations of x, y and z, mm.
    pub std_mm: [f64; 3],
}

/// Reads the positions and deviations of a table of points; only `x_mm`, `y_mm` and `z_mm` must be there.
pub fn read(path: &Path) -> Result<Vec<PointRow>> {
    let table = ReadTable::read(path)?;
    rows(&table).with_context(|| path.display().to_string())
}

fn rows(table: &ReadTable) -> Result<Vec<PointRow>> {
    let position = [table.finite("x_mm")?, table.finite("y_mm")?, table.finite("z_mm")?];
    let deviation = |name| Ok::<_, anyhow::Error>(table.optional_real(name)?.unwrap_or(vec![f64::NAN; table.rows()]));
    let std = [deviation("x_std_mm")?, deviation("y_std_mm")?, deviation("z_std_mm")?];
    let row = |row: usize| PointRow {
        position_mm: [0, 1, 2].map(|axis| position[axis][row]),
        std_mm: [0, 1, 2].map(|axis| std[axis][row]),
    };
    Ok((0..table.rows()).map(row).collect())
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::PixelPoint;
    use twinpupil_reconstruct::Feature;

    use super::*;

    fn point() -> Point {
        let feature = Feature {
            centre: PixelPoint { u: 959.5, v: 1.0 },
            centre_std_px: [0.002, 0.003],
            area_px: 5945.0,
            height_codes: 2500.0,
            ground_codes: 20.0,
            edge_px: 4.0,
            overlapped: false,
            saturated: false,
        };
        Point {
            position_mm: [1.25, -7.5, 300.000001],
            std_mm: [0.0005, 0.001, f64::NAN],
            covariance_mm2: [[2.5e-7, -1e-8, 2e-6], [-1e-8, 1e-6, 0.0], [2e-6, 0.0, f64::NAN]],
            match_chi2: 1.5,
            match_dof: 1,
            pixel_chi2: None,
            gamma: 1.013234567,
            telecentric: feature,
            entocentric: Feature { overlapped: true, ..feature },
            azimuth_residual_px: -0.25,
            diameter_mm: 1.0,
            ambiguous: false,
        }
    }

    fn text(frames: &[FramePoints]) -> String {
        String::from_utf8(table(frames).to_csv()).expect("text")
    }

    #[test]
    fn the_header_is_the_contract() {
        let contract = "id,x_mm,y_mm,z_mm,x_std_mm,y_std_mm,z_std_mm,gamma,telecentric_u_px,telecentric_v_px,\
            entocentric_u_px,entocentric_v_px,";
        assert!(text(&[]).starts_with(contract));
    }

    #[test]
    fn what_else_is_known_of_a_point_follows_its_flags() {
        let text = text(&[FramePoints { frame: String::new(), points: vec![point()], calibration_std_mm: None }]);
        let lines: Vec<&str> = text.lines().collect();
        let columns = ",overlapped,ambiguous,xy_cov_mm2,xz_cov_mm2,yz_cov_mm2,match_chi2,match_dof,pixel_chi2";
        assert!(lines[0].ends_with(columns), "{}", lines[0]);
        let values = ",1,0,-1.000000e-8,2.000000e-6,0.000000e0,1.5000,1,";
        assert!(lines[1].ends_with(values), "{}", lines[1]);
    }

    #[test]
    fn several_frames_are_told_apart() {
        let frame = |name: &str| FramePoints {
            frame: name.to_owned(),
            points: vec![point()],
            calibration_std_mm: Some(vec![[1e-3, 2e-3, 3e-3]]),
        };
        assert!(!text(&[frame("a.png")]).contains("frame"));
        let both = text(&[frame("a.png"), frame("b.png")]);
        assert!(
            both.lines()
                .nth(2)
                .is_some_and(|line| line.starts_with("0,1.250000,") && line.ends_with(",0.003000000,b.png"))
        );
    }

    #[test]
    fn what_is_written_is_read_back() {
        let text = text(&[FramePoints { frame: String::new(), points: vec![point()], calibration_std_mm: None }]);
        let back = rows(&ReadTable::parse(&text).unwrap()).unwrap();
        assert_eq!(back[0].position_mm, [1.25, -7.5, 300.000001]);
        assert_eq!(back[0].std_mm[..2], [0.0005, 0.001]);
        assert!(back[0].std_mm[2].is_nan());
    }

    #[test]
    fn positions_alone_are_enough() {
        let table = ReadTable::parse("z_mm,y_mm,x_mm,colour\n3,2,1,red\n6,5,4,blue\n").unwrap();
        let rows = rows(&table).unwrap();
        assert_eq!(rows[1].position_mm, [4.0, 5.0, 6.0]);
        assert!(rows[0].std_mm[2].is_nan());
    }
}
