//! Every number behind the plots as CSV.

use super::{Analysis, mode_name};
use crate::io::folder::FolderOutputs;
use crate::io::table::{Cells, Table};
use crate::precision::{Achievement, Located, Place, Sheet, SheetDot, Tally, Trial};

/// Decimals of lengths in mm, of deviations in mm, and of ratios.
const MM: usize = 6;
const STD: usize = 9;
const RATIO: usize = 4;

/// Adds `bounds.csv` and `dots.csv`, and what there is of `achieved.csv`, `readings.csv` and `rejected.csv`.
pub(super) fn add(files: &mut FolderOutputs, analysis: &Analysis, sheets: &[Sheet], trials: &[Trial]) {
    files.add("bounds.csv", bounds(analysis).to_csv());
    files.add("dots.csv", dots(analysis, sheets).to_csv());
    if !trials.is_empty() {
        files.add("achieved.csv", achieved(analysis).to_csv());
        files.add("readings.csv", readings(analysis, sheets, trials).to_csv());
        files.add("rejected.csv", rejected(analysis).to_csv());
    }
}

/// Columns of the rows' places.
fn places(analysis: &Analysis, places: &[Place]) -> Table {
    let real = |value: &dyn Fn(Place) -> f64| Cells::Real(places.iter().map(|place| value(*place)).collect(), MM);
    Table::new().with("z_mm", real(&|place| analysis.z_mm(place))).with("r_mm", real(&|place| analysis.r_mm(place)))
}

/// The bound of every place, for a dot on the x axis.
fn bounds(analysis: &Analysis) -> Table {
    let rows: Vec<Place> = analysis.places().collect();
    let std_mm = |axis: usize| {
        let std_mm = |place: &Place| analysis.bounds.at(*place).map_or(f64::NAN, |bound| bound.std_mm()[axis]);
        Cells::Real(rows.iter().map(std_mm).collect(), STD)
    };
    let dots = |place: &Place| analysis.bounds.at(*place).map_or(0, |bound| bound.dots as i64);
    places(analysis, &rows)
        .with("dots", Cells::Whole(rows.iter().map(dots).collect()))
        .with("x_std_mm", std_mm(0))
        .with("y_std_mm", std_mm(1))
        .with("z_std_mm", std_mm(2))
}

/// Every dot with its own bound, as it lies.
fn dots(analysis: &Analysis, sheets: &[Sheet]) -> Table {
    let rows: Vec<(usize, usize, &SheetDot)> = numbered(sheets).collect();
    let centre = |axis: usize| Cells::Real(rows.iter().map(|(.., dot)| dot.centre_mm[axis]).collect(), STD);
    let covariance = |i: usize, k: usize| {
        rows.iter().map(move |(sheet, index, _)| {
            analysis.bounds.dots[*sheet][*index].map_or(f64::NAN, |bound| bound.covariance_mm2[i][k])
        })
    };
    let std_mm = |axis: usize| Cells::Real(covariance(axis, axis).map(f64::sqrt).collect(), STD);
    let off_diagonal = |i: usize, k: usize| Cells::Scientific(covariance(i, k).collect(), MM);
    Table::new()
        .with("sheet", Cells::Whole(rows.iter().map(|(sheet, ..)| *sheet as i64).collect()))
        .with("id", Cells::Whole(rows.iter().map(|(_, index, _)| *index as i64).collect()))
        .with("x_mm", centre(0))
        .with("y_mm", centre(1))
        .with("z_mm", centre(2))
        .with("x_std_mm", std_mm(0))
        .with("y_std_mm", std_mm(1))
        .with("z_std_mm", std_mm(2))
        .with("xy_cov_mm2", off_diagonal(0, 1))
        .with("xz_cov_mm2", off_diagonal(0, 2))
        .with("yz_cov_mm2", off_diagonal(1, 2))
}

/// Every dot with the numbers of its sheet and of itself.
fn numbered(sheets: &[Sheet]) -> impl Iterator<Item = (usize, usize, &SheetDot)> {
    sheets
        .iter()
        .enumerate()
        .flat_map(|(sheet, own)| own.dots.iter().enumerate().map(move |(index, dot)| (sheet, index, dot)))
}

/// What was achieved at every place.
fn achieved(analysis: &Analysis) -> Table {
    let rows: Vec<(&Tally, Place, &Achievement)> = analysis
        .tallies
        .iter()
        .flat_map(|tally| tally.places.iter().map(move |(place, achievement)| (tally, *place, achievement)))
        .collect();
    let real = |decimals: usize, value: &dyn Fn(&Achievement) -> f64| {
        Cells::Real(rows.iter().map(|(.., achievement)| value(achievement)).collect(), decimals)
    };
    let whole = |value: &dyn Fn(&Achievement) -> usize| {
        Cells::Whole(rows.iter().map(|(.., achievement)| value(achievement) as i64).collect())
    };
    let grid: Vec<Place> = rows.iter().map(|(_, place, _)| *place).collect();
    places(analysis, &grid)
        .with("mode", Cells::Label(rows.iter().map(|(tally, ..)| mode_name(tally.mode).to_owned()).collect()))
        .with("dots", whole(&|a| a.dots))
        .with("found", whole(&|a| a.found))
        .with("x_rms_error_mm", real(STD, &|a| a.rms_error_mm[0]))
        .with("y_rms_error_mm", real(STD, &|a| a.rms_error_mm[1]))
        .with("z_rms_error_mm", real(STD, &|a| a.rms_error_mm[2]))
        .with("x_bias_mm", real(STD, &|a| a.bias_mm[0]))
        .with("y_bias_mm", real(STD, &|a| a.bias_mm[1]))
        .with("z_bias_mm", real(STD, &|a| a.bias_mm[2]))
        .with("z_bias_std_mm", real(STD, &|a| a.bias_std_mm[2]))
        .with("x_error_over_bound", real(RATIO, &|a| a.error_over_bound[0]))
        .with("y_error_over_bound", real(RATIO, &|a| a.error_over_bound[1]))
        .with("z_error_over_bound", real(RATIO, &|a| a.error_over_bound[2]))
        .with("x_error_over_std", real(RATIO, &|a| a.error_over_std[0]))
        .with("y_error_over_std", real(RATIO, &|a| a.error_over_std[1]))
        .with("z_error_over_std", real(RATIO, &|a| a.error_over_std[2]))
}

/// Every dot of every frame in every mode; unknown where it was not found.
fn readings(analysis: &Analysis, sheets: &[Sheet], trials: &[Trial]) -> Table {
    let rows: Vec<(&Trial, usize, Option<Located>)> = trials
        .iter()
        .flat_map(|trial| trial.dots.iter().enumerate().map(move |(index, located)| (trial, index, *located)))
        .collect();
    let grid: Vec<Place> = rows.iter().map(|(trial, index, _)| sheets[trial.sheet].dots[*index].place).collect();
    let whole = |value: &dyn Fn(&Trial, usize) -> usize| {
        Cells::Whole(rows.iter().map(|(trial, index, _)| value(trial, *index) as i64).collect())
    };
    let real = |value: &dyn Fn(&Located) -> f64| {
        Cells::Real(rows.iter().map(|(.., located)| located.as_ref().map_or(f64::NAN, value)).collect(), STD)
    };
    places(analysis, &grid)
        .with("mode", Cells::Label(rows.iter().map(|(trial, ..)| mode_name(trial.mode).to_owned()).collect()))
        .with("sheet", whole(&|trial, _| trial.sheet))
        .with("id", whole(&|_, index| index))
        .with("seed", whole(&|trial, _| trial.seed as usize))
        .with("x_error_mm", real(&|located| located.error_mm[0]))
        .with("y_error_mm", real(&|located| located.error_mm[1]))
        .with("z_error_mm", real(&|located| located.error_mm[2]))
        .with("x_std_mm", real(&|located| located.std_mm[0]))
        .with("y_std_mm", real(&|located| located.std_mm[1]))
        .with("z_std_mm", real(&|located| located.std_mm[2]))
}

/// How many features became no point, at which place, in which band and why.
fn rejected(analysis: &Analysis) -> Table {
    let rows: Vec<_> = analysis
        .tallies
        .iter()
        .flat_map(|tally| {
            tally.rejected.iter().map(move |((place, band, reason), count)| (tally, *place, band, *reason, *count))
        })
        .collect();
    let real = |value: &dyn Fn(Place) -> f64| {
        Cells::Real(rows.iter().map(|(_, place, ..)| place.map_or(f64::NAN, value)).collect(), MM)
    };
    Table::new()
        .with("z_mm", real(&|place| analysis.z_mm(place)))
        .with("r_mm", real(&|place| analysis.r_mm(place)))
        .with("mode", Cells::Label(rows.iter().map(|(tally, ..)| mode_name(tally.mode).to_owned()).collect()))
        .with("band", Cells::Label(rows.iter().map(|(_, _, band, ..)| (*band).clone()).collect()))
        .with("reason", Cells::Label(rows.iter().map(|(.., reason, _)| (*reason).to_owned()).collect()))
        .with("count", Cells::Whole(rows.iter().map(|(.., count)| *count as i64).collect()))
}
