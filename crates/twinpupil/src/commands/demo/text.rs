//! The result for the terminal.

use super::{Found, Line, Summary};
use crate::experiments::published::{self, TILTS};
use crate::text_table;

pub(super) fn text(summary: &Summary) -> String {
    let (tilted, flat): (Vec<&Line>, Vec<&Line>) = summary.lines.iter().partition(|line| line.is_tilted());
    let mut rows = vec![heading("plate", "mean z, mm", "rms error")];
    rows.extend(flat.into_iter().map(|line| row(line, depth_cells)));
    rows.push(Default::default());
    rows.push(heading("", "tilt", "R²"));
    rows.extend(tilted.into_iter().map(|line| row(line, tilt_cells)));
    let methods = ["", "", "paper's equations", "", "", "twinpupil", ""];
    let mut text =
        "The paper's camera, simulated and read: 60 random dots of 1 mm, photon and read noise, ideal lens.\n\n"
            .to_owned();
    text += &text_table::render(methods, &rows);
    text += &format!("\nPublished, through a real lens: {}.\n", published_numbers());
    text + &ending(summary)
}

fn heading(plate: &str, first: &str, second: &str) -> [String; 7] {
    [plate, "dots", first, second, "dots", first, second].map(str::to_owned)
}

/// A line with what each way of reading made of it.
fn row(line: &Line, cells: fn(&Found) -> [String; 2]) -> [String; 7] {
    let [paper_first, paper_second] = cells(&line.paper);
    let [model_first, model_second] = cells(&line.twinpupil);
    let [paper_dots, model_dots] = [&line.paper, &line.twinpupil].map(|found| dots(line, found));
    [line.plate(), paper_dots, paper_first, paper_second, model_dots, model_first, model_second]
}

pub(super) fn depth_cells(found: &Found) -> [String; 2] {
    [format!("{:.3}", found.mean_z_mm), format!("{:.3}", found.rms_error_mm)]
}

pub(super) fn tilt_cells(found: &Found) -> [String; 2] {
    let or_none = |value: Option<String>| value.unwrap_or_else(|| "–".to_owned());
    [
        or_none(found.tilt_deg.map(|tilt_deg| format!("{tilt_deg:.2}°"))),
        or_none(found.r_squared.map(|r_squared| format!("{r_squared:.5}"))),
    ]
}

/// Dots found of those wholly on the sensor.
pub(super) fn dots(line: &Line, found: &Found) -> String {
    let strays = match found.false_points {
        0 => String::new(),
        count => format!(" + {count} false"),
    };
    format!("{} of {}{strays}", found.dots, line.whole_dots)
}

/// The paper's own numbers for the same experiments.
pub(super) fn published_numbers() -> String {
    let tilt = TILTS[1];
    format!(
        "standard deviation of z {} mm; a plate tilted by {}° read as {}°, R² {} [Ohno2018, Figs. 10, 11]",
        published::STD_AGAINST_IDEAL_MM.text(),
        tilt.tilt_deg,
        tilt.fitted_deg.text(),
        tilt.r_squared.text()
    )
}

/// Where the files are and what to try next, with the program called as it was.
fn ending(summary: &Summary) -> String {
    let program = std::env::args().next().unwrap_or_else(|| "twinpupil".to_owned());
    let folder = std::path::Path::new(&summary.folder);
    format!(
        "\n{} shows it; beside it frame.png (the tilted plate, raw), points.csv, points.ply and truth.csv. {:.1} s.\n\n\
         Next:\n  {program} fit plane {}\n  {program} reproduce\n",
        folder.join("report.html").display(),
        summary.seconds,
        folder.join("points.csv").display(),
    )
}
