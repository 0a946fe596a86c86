//! Every plotted series as CSV.

use anyhow::Result;

use crate::experiments::{Case, Comparison, Experiment, Located, Reading, Study, published};
use crate::io::folder::FolderOutputs;
use crate::io::table::{Cells, Table};

/// Decimals of lengths in mm.
const MM: usize = 6;

/// Adds `dots.csv`, `rings.csv`, `plate.csv` and `tilts.csv`.
pub(super) fn add(files: &mut FolderOutputs, study: &Study) -> Result<()> {
    files.add("dots.csv", dots(study).to_csv());
    files.add("rings.csv", rings(study).to_csv());
    files.add("plate.csv", plate(study).to_csv());
    files.add("tilts.csv", tilts(study).to_csv());
    Ok(())
}

/// Every recovered dot of every frame.
fn dots(study: &Study) -> Table {
    let rows: Vec<(&Reading, &Located)> = study
        .cases()
        .into_iter()
        .flat_map(|case| &case.readings)
        .flat_map(|reading| reading.dots.iter().map(move |dot| (reading, dot)))
        .collect();
    let real = |value: &dyn Fn(&Reading, &Located) -> f64| {
        Cells::Real(rows.iter().map(|(reading, dot)| value(reading, dot)).collect(), MM)
    };
    let (experiments, cases) = (|reading: &Reading| name(reading.experiment), |reading: &Reading| reading.case.id());
    Table::new()
        .with("experiment", Cells::Label(rows.iter().map(|(reading, _)| experiments(reading).to_owned()).collect()))
        .with("case", Cells::Label(rows.iter().map(|(reading, _)| cases(reading).to_owned()).collect()))
        .with("distance_mm", real(&|reading, _| reading.z_mm))
        .with("tilt_deg", real(&|reading, _| tilt_deg(reading.experiment)))
        .with("true_x_mm", real(&|_, dot| dot.true_mm[0]))
        .with("true_y_mm", real(&|_, dot| dot.true_mm[1]))
        .with("true_z_mm", real(&|_, dot| dot.true_mm[2]))
        .with("x_mm", real(&|_, dot| dot.found_mm[0]))
        .with("y_mm", real(&|_, dot| dot.found_mm[1]))
        .with("z_mm", real(&|_, dot| dot.found_mm[2]))
}

fn name(experiment: Experiment) -> &'static str {
    match experiment {
        Experiment::Dots => "dots",
        Experiment::Plate => "plate",
        Experiment::Tilt { .. } => "tilt",
    }
}

fn tilt_deg(experiment: Experiment) -> f64 {
    match experiment {
        Experiment::Tilt { tilt_deg } => tilt_deg,
        _ => 0.0,
    }
}

/// Mean depth of each ring at each distance.
fn rings(study: &Study) -> Table {
    let rows: Vec<_> = study
        .cases()
        .into_iter()
        .flat_map(|case| case.rings.iter().flatten().map(move |depth| (case.case, depth)))
        .collect();
    Table::new()
        .with("case", labels(rows.iter().map(|(case, _)| *case)))
        .with("r_mm", Cells::Real(rows.iter().map(|(_, depth)| depth.r_mm).collect(), MM))
        .with("true_z_mm", Cells::Real(rows.iter().map(|(_, depth)| depth.true_z_mm).collect(), MM))
        .with("mean_z_mm", Cells::Real(rows.iter().map(|(_, depth)| depth.mean_mm).collect(), MM))
        .with("spread_mm", Cells::Real(rows.iter().map(|(_, depth)| depth.spread_mm).collect(), MM))
        .with("dots", Cells::Whole(rows.iter().map(|(_, depth)| depth.dots as i64).collect()))
}

/// Mean depth of the plate at each distance, and the fitted line there.
fn plate(study: &Study) -> Table {
    let rows: Vec<_> =
        study.cases().into_iter().flat_map(|case| case.line.plates.iter().map(move |plate| (case, plate))).collect();
    let line = |(case, plate): &(&crate::experiments::CaseStudy, &crate::experiments::depth_line::PlateDepth)| {
        case.line.at(plate.true_z_mm)
    };
    Table::new()
        .with("case", labels(rows.iter().map(|(case, _)| case.case)))
        .with("true_z_mm", Cells::Real(rows.iter().map(|(_, plate)| plate.true_z_mm).collect(), MM))
        .with("mean_z_mm", Cells::Real(rows.iter().map(|(_, plate)| plate.mean_mm).collect(), MM))
        .with("spread_mm", Cells::Real(rows.iter().map(|(_, plate)| plate.spread_mm).collect(), MM))
        .with("rms_error_mm", Cells::Real(rows.iter().map(|(_, plate)| plate.rms_error_mm).collect(), MM))
        .with("line_z_mm", Cells::Real(rows.iter().map(line).collect(), MM))
        .with("points", Cells::Whole(rows.iter().map(|(_, plate)| plate.dots as i64).collect()))
}

/// The fitted line of each tilted plate.
fn tilts(study: &Study) -> Table {
    let rows: Vec<_> = study
        .cases()
        .into_iter()
        .flat_map(|case| case.tilts.iter().zip(&published::TILTS).map(move |(fit, tilt)| (case.case, tilt, fit)))
        .collect();
    let deg = |value: f64| value.to_degrees();
    Table::new()
        .with("case", labels(rows.iter().map(|(case, ..)| *case)))
        .with("true_tilt_deg", Cells::Real(rows.iter().map(|(_, tilt, _)| tilt.tilt_deg).collect(), MM))
        .with("tilt_deg", Cells::Real(rows.iter().map(|(.., fit)| deg(fit.tilt_rad.value)).collect(), MM))
        .with("tilt_std_deg", Cells::Real(rows.iter().map(|(.., fit)| deg(fit.tilt_rad.std)).collect(), MM))
        .with("z_fit_mm", Cells::Real(rows.iter().map(|(.., fit)| fit.z_mm.value).collect(), MM))
        .with("r_squared", Cells::Real(rows.iter().map(|(.., fit)| fit.quality.r_squared).collect(), MM))
}

fn labels(cases: impl Iterator<Item = Case>) -> Cells {
    Cells::Label(cases.map(|case| case.id().to_owned()).collect())
}

/// The table of the report, as text cells.
pub(super) fn comparison(comparison: &Comparison) -> Table {
    let rows = || comparison.sections.iter().flat_map(|section| section.rows.iter().map(move |row| (section, row)));
    let cell = |k: usize| Cells::Label(rows().map(|(_, row)| row.cells()[k].clone()).collect());
    let why = rows().map(|(_, row)| row.explanation.number() as i64).collect();
    Table::new()
        .with("experiment", Cells::Label(rows().map(|(section, _)| section.title.to_owned()).collect()))
        .with("quantity", Cells::Label(rows().map(|(_, row)| row.quantity.clone()).collect()))
        .with("published", cell(0))
        .with("thin_paper", cell(1))
        .with("fresnel_paper", cell(2))
        .with("fresnel_twinpupil", cell(3))
        .with("explanation", Cells::Whole(why))
}
