//! The report as one page.

use super::plots::Drawing;
use super::text::{bound_cells, microns, overall_rows, rejections, round};
use super::{Analysis, mode_name};
use crate::precision::{Place, Tally};
use crate::report::{Column, Figure, Headline, Report};

pub(super) fn page(analysis: &Analysis, drawings: &[Drawing]) -> Report {
    let (kind, sensor) = (&analysis.kind, &analysis.instrument.sensor);
    let mut report = Report::new(&format!("How precisely {} locates dots", analysis.instrument.name));
    report.lead(&format!(
        "Dots of {} mm, {} electrons on a ground of {}, read noise {} e⁻, {} bit, {} × {} px, {}. The bound is Cramér \
         and Rao's: no unbiased estimator does better when position, diameter, and in both bands brightness and \
         ground are unknown.",
        kind.diameter_mm,
        kind.brightness_e,
        kind.background_e,
        sensor.read_noise_e,
        sensor.bit_depth,
        sensor.size_px[0],
        sensor.size_px[1],
        sensor.mosaic.name()
    ));
    report.headlines(&headlines(analysis));
    let figure = |drawing: &Drawing| Figure::new(drawing.svg.clone(), drawing.caption.clone());
    let figures: Vec<Figure> = drawings.iter().map(figure).collect();
    let (maps, rest) = figures.split_at(figures.len().min(4));
    report.heading("The bound over the working volume");
    report.paragraph(
        "Deviations over the distance r from the optical axis and the depth z, for a dot on the x axis: x is outwards \
         and y sideways there. Empty: no dot of this size is wholly on the sensor, or no light passes.",
    );
    report.figures(maps);
    if !analysis.tallies.is_empty() {
        achieved(&mut report, analysis);
        report.figures(rest);
    }
    report.heading("Every place");
    places(&mut report, analysis);
    report
}

fn headlines(analysis: &Analysis) -> Vec<Headline> {
    let depth_mm = |place: Place| analysis.bounds.at(place).map(|bound| (bound.std_mm()[2], place));
    let mut bounds: Vec<(f64, Place)> = analysis.places().filter_map(depth_mm).collect();
    bounds.sort_by(|a, b| a.0.total_cmp(&b.0));
    let at = |what: &str, (std_mm, place): &(f64, Place)| {
        let where_ = format!("at z = {}, r = {} mm", round(analysis.z_mm(*place)), round(analysis.r_mm(*place)));
        Headline::new(format!("{} µm", microns(*std_mm, 2)), format!("{what} bound of depth, {where_}"))
    };
    let mut headlines: Vec<Headline> = Vec::new();
    headlines.extend(bounds.first().map(|bound| at("smallest", bound)));
    headlines.extend(bounds.last().map(|bound| at("largest", bound)));
    for tally in &analysis.tallies {
        headlines.push(Headline::new(
            format!("{:.2} ×", tally.over(|place| analysis.is_unclipped(place)).error_over_bound[2]),
            format!("the bound: rms depth error of {} mode where the masks clip nothing", mode_name(tally.mode)),
        ));
    }
    headlines
}

fn achieved(report: &mut Report, analysis: &Analysis) {
    report.heading("What simulated frames achieve");
    report.paragraph(&format!(
        "The same dots, simulated with photon noise, read noise and rounding, {} frames of each arrangement, read in \
         every mode. Bars are the uncertainty of the shown value itself.",
        analysis.seeds
    ));
    let columns = [
        Column::text("mode, and where"),
        Column::number("dots found"),
        Column::number("rms z, µm"),
        Column::number("error over bound"),
        Column::number("error over reported"),
        Column::number("bias of z, µm"),
        Column::number("false points"),
    ];
    let rows: Vec<[String; 7]> = analysis.tallies.iter().flat_map(|tally| overall_rows(analysis, tally)).collect();
    report.table(&columns, &rows);
    let reasons =
        |tally: &Tally| format!("In {} mode, features rejected: {}.", mode_name(tally.mode), rejections(tally));
    report.list(&analysis.tallies.iter().map(reasons).collect::<Vec<_>>());
}

fn places(report: &mut Report, analysis: &Analysis) {
    let columns = [
        Column::number("z, mm"),
        Column::number("r, mm"),
        Column::number("σ_x, nm"),
        Column::number("σ_y, nm"),
        Column::number("σ_z, µm"),
    ];
    let row = |place: Place| {
        let [x, y, z] = bound_cells(analysis.bounds.at(place));
        [round(analysis.z_mm(place)).to_string(), round(analysis.r_mm(place)).to_string(), x, y, z]
    };
    let rows: Vec<[String; 5]> = analysis.places().map(row).collect();
    let Some(achieved) = rows_with_achieved(analysis, &rows) else { return report.table(&columns, &rows) };
    let [z, r, sx, sy, sz] = columns;
    let mode = |text: &str| {
        analysis.tallies.iter().map(|t| Column::number(&format!("{} {text}", mode_name(t.mode)))).collect::<Vec<_>>()
    };
    let [bound, reported, found] = ["error/bound", "error/reported", "found"].map(mode);
    let columns = [
        z,
        r,
        sx,
        sy,
        sz,
        bound[0].clone(),
        reported[0].clone(),
        found[0].clone(),
        bound[1].clone(),
        reported[1].clone(),
        found[1].clone(),
    ];
    report.table(&columns, &achieved);
}

/// The rows with what both modes achieved, if there are two.
fn rows_with_achieved(analysis: &Analysis, rows: &[[String; 5]]) -> Option<Vec<[String; 11]>> {
    let [first, second] = &analysis.tallies[..] else { return None };
    let cells = |tally: &Tally, place: Place| match tally.places.get(&place) {
        Some(a) if a.found > 0 => {
            let share = format!("{:.0} %", 100.0 * a.recall());
            [format!("{:.2}", a.error_over_bound[2]), format!("{:.2}", a.error_over_std[2]), share]
        }
        Some(_) => [String::new(), String::new(), "0 %".to_owned()],
        None => Default::default(),
    };
    let row = |(place, row): (Place, &[String; 5])| {
        let [z, r, sx, sy, sz] = row.clone();
        let ([a, b, c], [d, e, f]) = (cells(first, place), cells(second, place));
        [z, r, sx, sy, sz, a, b, c, d, e, f]
    };
    Some(analysis.places().zip(rows).map(row).collect())
}
