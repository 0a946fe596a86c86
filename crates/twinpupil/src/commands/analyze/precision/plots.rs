//! The plots: maps of the bound, and lines over the distance from the axis with what was achieved on them.

use super::text::round;
use super::{Analysis, mode_name};
use crate::heat_map::HeatMap;
use crate::plot::{Chart, Colour, PlotPoint, Stroke};
use crate::precision::{Achievement, Place, Tally};

/// A drawing, the file it also goes to, and what it shows.
pub(super) struct Drawing {
    pub(super) file: &'static str,
    pub(super) svg: String,
    pub(super) caption: String,
}

/// All drawings: maps, the bound of z, then what was achieved.
pub(super) fn figures(analysis: &Analysis) -> Vec<Drawing> {
    let mut drawings = vec![
        map(analysis, 2, "map-z.svg", "σ_z, µm", "Along the axis: smallest standard deviation of depth."),
        depth(analysis),
        map(analysis, 0, "map-x.svg", "σ_x, nm", "Across the axis, outwards: the direction from the axis to the dot."),
        map(analysis, 1, "map-y.svg", "σ_y, nm", "Across the axis, sideways: the direction round the axis."),
    ];
    if let [model, centroid] = &analysis.tallies[..] {
        drawings.extend([
            over_bound(analysis, model, 2, "model-z-over-bound.svg"),
            over_bound(analysis, centroid, 2, "centroid-z-over-bound.svg"),
            over_reported(analysis, model, "model-z-over-reported.svg"),
            over_reported(analysis, centroid, "centroid-z-over-reported.svg"),
            bias(analysis, model, "model-z-bias.svg"),
            over_bound(analysis, model, 0, "model-x-over-bound.svg"),
        ]);
    }
    drawings
}

/// An SVG for a file of its own, on a white ground with dark text.
pub(super) fn standalone(svg: &str) -> String {
    svg.replacen("<svg", "<svg style=\"background: white; color: #1c2126\"", 1)
}

fn map(analysis: &Analysis, axis: usize, file: &'static str, title: &str, caption: &str) -> Drawing {
    let grid = &analysis.grid;
    let per_mm = if axis == 2 { 1e3 } else { 1e6 };
    let value =
        |z: usize, r: usize| analysis.bounds.at(Place { z, r }).map_or(f64::NAN, |bound| per_mm * bound.std_mm()[axis]);
    let values = (0..grid.z_mm.len()).map(|z| (0..grid.r_mm.len()).map(|r| value(z, r)).collect()).collect();
    let names = |values: &[f64]| values.iter().map(|value| round(*value).to_string()).collect();
    let map = HeatMap::new(title, ["r, mm", "z, mm"], names(&grid.r_mm), names(&grid.z_mm), values);
    Drawing { file, svg: map.into_svg(), caption: caption.to_owned() }
}

/// σ_z over r for several z, with what the first mode achieved.
fn depth(analysis: &Analysis) -> Drawing {
    let mut chart = Chart::new("r, mm", "σ_z, µm").log_y();
    let tally = analysis.tallies.first();
    let mut all = Vec::new();
    for (z, colour) in depths(analysis) {
        let bound = |place: Place| Some([analysis.r_mm(place), 1000.0 * analysis.bounds.at(place)?.std_mm()[2]]);
        let line: Vec<[f64; 2]> = at_depth(analysis, z).filter_map(bound).collect();
        all.extend(line.iter().map(|[_, std_um]| *std_um));
        chart = chart.line(&label(analysis, z), colour, Stroke::Solid, &line);
        if let Some(tally) = tally {
            let point = |a: &Achievement, r_mm| PlotPoint {
                x: r_mm,
                y: 1000.0 * a.rms_error_mm[2],
                y_error: 1000.0 * a.rms_error_mm[2] * uncertainty(a),
            };
            let points = points(analysis, tally, z, point);
            all.extend(points.iter().map(|point| point.y));
            chart = chart.points("", colour, &points);
        }
    }
    let [low, high] = around(&all);
    let achieved = match tally {
        Some(tally) => format!(
            " Points: rms error achieved in {} mode by {} dots a place and noise of {} seeds; bars, their own uncertainty.",
            mode_name(tally.mode),
            analysis.bounds.places.values().flatten().map(|bound| bound.dots).max().unwrap_or(0),
            analysis.seeds
        ),
        None => String::new(),
    };
    Drawing {
        file: "bound-z.svg",
        svg: chart.y_range(low, high).into_svg(),
        caption: format!("Lines: the Cramér–Rao bound of depth over the distance from the axis.{achieved}"),
    }
}

fn over_bound(analysis: &Analysis, tally: &Tally, axis: usize, file: &'static str) -> Drawing {
    let (name, letter) = (mode_name(tally.mode), ["x", "y", "z"][axis]);
    let chart = ratio(analysis, tally, &format!("{name}: {letter} error over bound"), |a| a.error_over_bound[axis]);
    let caption =
        format!("In {name} mode: rms error of {letter} over its bound. At 1 no unbiased estimator does better.");
    Drawing { file, svg: chart.into_svg(), caption }
}

fn over_reported(analysis: &Analysis, tally: &Tally, file: &'static str) -> Drawing {
    let name = mode_name(tally.mode);
    let chart = ratio(analysis, tally, &format!("{name}: z error over reported"), |a| a.error_over_std[2]);
    let caption =
        format!("In {name} mode: rms error of z over the deviation reported with it. At 1 error bars are true.");
    Drawing { file, svg: chart.into_svg(), caption }
}

fn bias(analysis: &Analysis, tally: &Tally, file: &'static str) -> Drawing {
    let name = mode_name(tally.mode);
    let mut chart = Chart::new("r, mm", &format!("{name}: mean z error, µm"));
    chart = chart.line("", Colour::Grey, Stroke::Dashed, &ends(analysis).map(|r_mm| [r_mm, 0.0]));
    for (z, colour) in depths(analysis) {
        let point =
            |a: &Achievement, r_mm| PlotPoint { x: r_mm, y: 1000.0 * a.bias_mm[2], y_error: 1000.0 * a.bias_std_mm[2] };
        chart = joined(chart, &label(analysis, z), colour, &points(analysis, tally, z, point));
    }
    let caption = format!("In {name} mode: mean error of z, what is left when noise is averaged away.");
    Drawing { file, svg: chart.into_svg(), caption }
}

/// A ratio that should be 1, over r, for several z. Factors look the same everywhere.
fn ratio(analysis: &Analysis, tally: &Tally, y_label: &str, of: impl Fn(&Achievement) -> f64) -> Chart {
    let ideal = ends(analysis).map(|r_mm| [r_mm, 1.0]);
    let mut chart = Chart::new("r, mm", y_label).log_y().line("", Colour::Grey, Stroke::Dashed, &ideal);
    let mut all = vec![0.7, 1.5];
    for (z, colour) in depths(analysis) {
        let point = |a: &Achievement, r_mm| PlotPoint { x: r_mm, y: of(a), y_error: of(a) * uncertainty(a) };
        let points = points(analysis, tally, z, point);
        all.extend(points.iter().map(|point| point.y));
        chart = joined(chart, &label(analysis, z), colour, &points);
    }
    let [low, high] = around(&all);
    chart.y_range(low, high)
}

/// A range for a logarithmic axis with some room around its values.
fn around(values: &[f64]) -> [f64; 2] {
    const ROOM: f64 = 1.25;
    let shown = values.iter().filter(|value| value.is_finite() && **value > 0.0);
    let [low, high] = shown.fold([f64::INFINITY, 0.0], |[low, high], &value| [value.min(low), value.max(high)]);
    if low < high { [low / ROOM, high * ROOM] } else { [0.1, 10.0] }
}

fn joined(chart: Chart, name: &str, colour: Colour, points: &[PlotPoint]) -> Chart {
    let line: Vec<[f64; 2]> = points.iter().map(|point| [point.x, point.y]).collect();
    chart.line("", colour, Stroke::Solid, &line).points(name, colour, points)
}

/// Relative standard deviation of a root mean square of n normal errors, 1/√(2n).
fn uncertainty(achievement: &Achievement) -> f64 {
    (2.0 * achievement.found as f64).powf(-0.5)
}

fn points(
    analysis: &Analysis,
    tally: &Tally,
    z: usize,
    point: impl Fn(&Achievement, f64) -> PlotPoint,
) -> Vec<PlotPoint> {
    let found = |place: Place| tally.places.get(&place).filter(|a| a.found > 0).map(|a| point(a, analysis.r_mm(place)));
    at_depth(analysis, z).filter_map(found).collect()
}

fn at_depth(analysis: &Analysis, z: usize) -> impl Iterator<Item = Place> {
    (0..analysis.grid.r_mm.len()).map(move |r| Place { z, r })
}

/// As many depths as there are colours, spread over all, each with its colour.
fn depths(analysis: &Analysis) -> Vec<(usize, Colour)> {
    let (all, shown) = (analysis.grid.z_mm.len(), Colour::SERIES.len().min(analysis.grid.z_mm.len()));
    let depth = |k: usize| if shown < 2 { 0 } else { k * (all - 1) / (shown - 1) };
    (0..shown).map(|k| (depth(k), Colour::SERIES[k])).collect()
}

fn label(analysis: &Analysis, z: usize) -> String {
    format!("z = {} mm", round(analysis.grid.z_mm[z]))
}

/// The innermost and the outermost distance.
fn ends(analysis: &Analysis) -> [f64; 2] {
    let r_mm = &analysis.grid.r_mm;
    [r_mm.first(), r_mm.last()].map(|end| end.copied().unwrap_or(f64::NAN))
}
