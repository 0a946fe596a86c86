//! `twinpupil fit`: a line or a plane through points.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::{Args, Subcommand, ValueEnum};
use serde::Serialize;
use twinpupil_reconstruct::{Estimate, FitPoint, LineAxis, Quality, fit_line, fit_plane};

use super::destination::{Destination, pretty};
use crate::io::points;

/// `twinpupil fit …`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// z = z_fit + t tan θ, with t = x or y: Eq. 14 of the paper
    Line {
        /// The coordinate that the line runs along
        #[arg(long, value_enum, default_value_t = AxisOption::X)]
        axis: AxisOption,
        /// What is fitted.
        #[command(flatten)]
        common: Common,
    },
    /// z = z_fit + x tan θ_x + y tan θ_y
    Plane {
        /// What is fitted.
        #[command(flatten)]
        common: Common,
    },
}

/// A coordinate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AxisOption {
    /// z over x
    X,
    /// z over y
    Y,
}

/// Options of both fits.
#[derive(Debug, Args)]
pub struct Common {
    /// Points: CSV, PLY or Parquet with x_mm, y_mm, z_mm and, to weight them, z_std_mm; `-` is standard input
    points: PathBuf,
    /// Weight all points alike, whatever their deviations
    #[arg(long)]
    unweighted: bool,
    /// As JSON
    #[arg(long)]
    json: bool,
    /// Where it goes.
    #[command(flatten)]
    to: Destination,
}

/// A fitted parameter, as printed.
#[derive(Debug, Serialize)]
struct Parameter {
    name: &'static str,
    value: f64,
    std: f64,
}

/// A fit, as printed.
#[derive(Debug, Serialize)]
struct Summary {
    parameters: Vec<Parameter>,
    points: usize,
    r_squared: f64,
    rms_mm: f64,
    reduced_chi2: Option<f64>,
}

/// Runs `twinpupil fit`.
pub fn run(command: &Command) -> Result<()> {
    let common = match command {
        Command::Line { common, .. } | Command::Plane { common } => common,
    };
    let points = read(common)?;
    let summary = match command {
        Command::Line { axis, .. } => line(&points, *axis),
        Command::Plane { .. } => plane(&points),
    }
    .with_context(|| common.points.display().to_string())?;
    common.to.write(if common.json { pretty(&summary)? } else { summary.to_text() })
}

fn read(common: &Common) -> Result<Vec<FitPoint>> {
    let rows = points::read(&common.points)?;
    // A weight needs a deviation above zero for every point; with one missing, all count alike.
    let weighted = !common.unweighted && rows.iter().all(|row| row.std_mm[2] > 0.0);
    let point =
        |row: &points::PointRow| FitPoint { position_mm: row.position_mm, z_std_mm: weighted.then_some(row.std_mm[2]) };
    Ok(rows.iter().map(point).collect())
}

fn line(points: &[FitPoint], axis: AxisOption) -> Result<Summary> {
    let axis = match axis {
        AxisOption::X => LineAxis::X,
        AxisOption::Y => LineAxis::Y,
    };
    let fit = fit_line(points, axis)?;
    let parameters = vec![degrees("tilt_deg", fit.tilt_rad), parameter("z_mm", fit.z_mm)];
    Ok(Summary::new(parameters, fit.quality))
}

fn plane(points: &[FitPoint]) -> Result<Summary> {
    let fit = fit_plane(points)?;
    let parameters = vec![
        degrees("tilt_deg", fit.tilt_rad),
        parameter("z_mm", fit.z_mm),
        parameter("slope_x", fit.slope_x),
        parameter("slope_y", fit.slope_y),
    ];
    Ok(Summary::new(parameters, fit.quality))
}

fn parameter(name: &'static str, estimate: Estimate) -> Parameter {
    Parameter { name, value: estimate.value, std: estimate.std }
}

fn degrees(name: &'static str, estimate_rad: Estimate) -> Parameter {
    Parameter { name, value: estimate_rad.value.to_degrees(), std: estimate_rad.std.to_degrees() }
}

impl Summary {
    fn new(parameters: Vec<Parameter>, quality: Quality) -> Self {
        let Quality { points, r_squared, rms_mm, reduced_chi2 } = quality;
        Self { parameters, points, r_squared, rms_mm, reduced_chi2 }
    }

    fn to_text(&self) -> String {
        let width = "reduced_chi2".len();
        let line = |Parameter { name, value, std }: &Parameter| format!("{name:<width$}  {value:.6} ± {std:.6}\n");
        let mut text: String = self.parameters.iter().map(line).collect();
        text += &format!("{:<width$}  {:.6}\n", "r_squared", self.r_squared);
        text += &format!("{:<width$}  {:.6}\n", "rms_mm", self.rms_mm);
        if let Some(reduced_chi2) = self.reduced_chi2 {
            text += &format!("{:<width$}  {reduced_chi2:.3}\n", "reduced_chi2");
        }
        text + &format!("{:<width$}  {}\n", "points", self.points)
    }
}
