//! The result for the terminal.

use super::{Analysis, mode_name};
use crate::precision::{Achievement, Place, PlaceBound, Tally};
use crate::text_table;

/// The places, then what was achieved on the whole.
pub(super) fn tables(analysis: &Analysis) -> String {
    let kind = &analysis.kind;
    let mut text = format!(
        "{}: smallest standard deviations of dots of {} mm, {} e- on {} e-; x outwards, y sideways\n\n",
        analysis.instrument.name, kind.diameter_mm, kind.brightness_e, kind.background_e
    );
    text += &match &analysis.tallies[..] {
        [model, centroid] => with_achieved(analysis, [model, centroid]),
        _ => bounds(analysis),
    };
    if !analysis.tallies.is_empty() {
        text += "\n";
        text += &overall(analysis);
    }
    text
}

fn bounds(analysis: &Analysis) -> String {
    let rows: Vec<[String; 5]> = analysis.places().map(|place| place_cells(analysis, place)).collect();
    text_table::render(["z, mm", "r, mm", "σ_x, nm", "σ_y, nm", "σ_z, µm"], &rows)
}

fn with_achieved(analysis: &Analysis, tallies: [&Tally; 2]) -> String {
    let names = tallies.map(|tally| format!("{}:", mode_name(tally.mode)));
    let header = ["", "", "", "", "", &names[0], "", "", "", &names[1], "", "", ""];
    let columns = [
        "z, mm",
        "r, mm",
        "σ_x",
        "σ_y",
        "σ_z",
        "z error/σ_z",
        "/reported",
        "bias",
        "found",
        "z error/σ_z",
        "/reported",
        "bias, µm",
        "found",
    ];
    let mut rows = vec![columns.map(str::to_owned)];
    for place in analysis.places() {
        let mut row: Vec<String> = place_cells(analysis, place).into();
        row.extend(tallies.iter().flat_map(|tally| achieved_cells(tally.places.get(&place))));
        rows.extend(<[String; 13]>::try_from(row));
    }
    text_table::render(header, &rows)
}

fn place_cells(analysis: &Analysis, place: Place) -> [String; 5] {
    let [x, y, z] = bound_cells(analysis.bounds.at(place));
    [round(analysis.z_mm(place)).to_string(), round(analysis.r_mm(place)).to_string(), x, y, z]
}

fn achieved_cells(achievement: Option<&Achievement>) -> [String; 4] {
    let Some(achievement) = achievement else { return Default::default() };
    let found = format!("{} of {}", achievement.found, achievement.dots);
    if achievement.found == 0 {
        return [String::new(), String::new(), String::new(), found];
    }
    [
        format!("{:.2}", achievement.error_over_bound[2]),
        format!("{:.2}", achievement.error_over_std[2]),
        format!("{} ± {}", microns(achievement.bias_mm[2], 2), microns(achievement.bias_std_mm[2], 2)),
        found,
    ]
}

fn overall(analysis: &Analysis) -> String {
    let rows: Vec<[String; 7]> = analysis.tallies.iter().flat_map(|tally| overall_rows(analysis, tally)).collect();
    let header = ["", "dots found", "rms z, µm", "z error/σ_z", "/reported", "bias, µm", "false"];
    let reasons = |tally: &Tally| {
        let reasons = rejections(tally);
        format!("{}, {} frames: features rejected: {reasons}\n", mode_name(tally.mode), tally.frames)
    };
    text_table::render(header, &rows) + &analysis.tallies.iter().map(reasons).collect::<String>()
}

/// One mode where the masks clip nothing, and everywhere.
pub(super) fn overall_rows(analysis: &Analysis, tally: &Tally) -> [[String; 7]; 2] {
    let row = |where_: &str, a: Achievement, false_points: String| {
        [
            format!("{}, {where_}", mode_name(tally.mode)),
            format!("{} of {}", a.found, a.dots),
            microns(a.rms_error_mm[2], 2),
            format!("{:.2}", a.error_over_bound[2]),
            format!("{:.2}", a.error_over_std[2]),
            format!("{} ± {}", microns(a.bias_mm[2], 2), microns(a.bias_std_mm[2], 2)),
            false_points,
        ]
    };
    [
        row("where nothing is clipped", tally.over(|place| analysis.is_unclipped(place)), String::new()),
        row("everywhere", tally.over(|_| true), tally.false_points.to_string()),
    ]
}

/// Why features became no point, and how many.
pub(super) fn rejections(tally: &Tally) -> String {
    let reasons: Vec<String> = tally.reasons().iter().map(|(reason, count)| format!("{count} {reason}")).collect();
    if reasons.is_empty() { "none".to_owned() } else { reasons.join(", ") }
}

/// Bounds of x and y in nm and of z in µm.
pub(super) fn bound_cells(bound: Option<&PlaceBound>) -> [String; 3] {
    let Some(bound) = bound else { return ["–"; 3].map(str::to_owned) };
    let [x, y, z] = bound.std_mm();
    [microns(1000.0 * x, 1), microns(1000.0 * y, 1), microns(z, 3)]
}

/// A length in mm as µm.
pub(super) fn microns(length_mm: f64, decimals: usize) -> String {
    format!("{:.decimals$}", 1000.0 * length_mm)
}

/// A value of the grid without the rounding of its steps.
pub(super) fn round(value: f64) -> f64 {
    (1e6 * value).round() / 1e6
}
