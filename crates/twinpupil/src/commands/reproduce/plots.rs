//! The paper's plots, drawn again.

use crate::experiments::{Case, CaseStudy, Study, published, tilt};
use crate::plot::{Chart, Colour, PlotPoint, Stroke};

/// The colour of a case in every plot.
fn colour(case: Case) -> Colour {
    match case {
        Case::ThinPaper | Case::ThinModel => Colour::Blue,
        Case::FresnelPaper => Colour::Vermilion,
        Case::FresnelModel => Colour::Green,
    }
}

/// Depth error of one ring over true depth, the index of its radius in [`RADII_MM`].
///
/// [`RADII_MM`]: crate::experiments::rings::RADII_MM
pub(super) fn ring(study: &Study, ring: usize) -> String {
    let ends = ends(study);
    let zero = ends.map(|z_mm| [z_mm, 0.0]);
    let mut chart = Chart::new("true z, mm", "recovered − true z, mm").line("", Colour::Grey, Stroke::Dashed, &zero);
    for case in study.cases() {
        let points: Vec<PlotPoint> = case.rings[ring]
            .iter()
            .map(|depth| PlotPoint { x: depth.true_z_mm, y: depth.mean_mm - depth.true_z_mm, y_error: depth.spread_mm })
            .collect();
        let line: Vec<[f64; 2]> = points.iter().map(|point| [point.x, point.y]).collect();
        chart = chart.line("", colour(case.case), Stroke::Solid, &line).points(
            &case.case.label(),
            colour(case.case),
            &points,
        );
    }
    chart.y_range(-9.0, 7.0).into_svg()
}

/// Recovered over true depth of the plate, with the fitted lines  [Ohno2018, Fig. 10].
pub(super) fn depth(study: &Study) -> String {
    let ends = ends(study);
    let ideal = ends.map(|z_mm| [z_mm, z_mm]);
    let mut chart = Chart::new("true z, mm", "recovered z, mm").line("truth", Colour::Grey, Stroke::Dashed, &ideal);
    for case in study.cases() {
        let points = means(case, |_| 0.0);
        let line = ends.map(|z_mm| [z_mm, case.line.at(z_mm)]);
        chart = chart.line("", colour(case.case), Stroke::Solid, &line).points(
            &case.case.label(),
            colour(case.case),
            &points,
        );
    }
    chart.into_svg()
}

/// The same less the truth, beside what the paper prints for its fitted line.
pub(super) fn depth_error(study: &Study) -> String {
    let ends = ends(study);
    let published_mm = published::LINE_OFF_TRUTH_MM.value;
    let band = format!("published: line within ±{published_mm} mm");
    let mut chart = Chart::new("true z, mm", "recovered − true z, mm")
        .band(&band, Colour::Grey, ends, [-published_mm, published_mm])
        .line("", Colour::Grey, Stroke::Dashed, &ends.map(|z_mm| [z_mm, 0.0]));
    for case in study.cases() {
        let points = means(case, |z_mm| z_mm);
        let line = ends.map(|z_mm| [z_mm, case.line.at(z_mm) - z_mm]);
        chart = chart.line("", colour(case.case), Stroke::Solid, &line).points(
            &case.case.label(),
            colour(case.case),
            &points,
        );
    }
    chart.into_svg()
}

/// Mean depths of the plate less `reference`, with their spread.
fn means(case: &CaseStudy, reference: impl Fn(f64) -> f64) -> Vec<PlotPoint> {
    let point = |plate: &crate::experiments::depth_line::PlateDepth| PlotPoint {
        x: plate.true_z_mm,
        y: plate.mean_mm - reference(plate.true_z_mm),
        y_error: plate.spread_mm,
    };
    case.line.plates.iter().map(point).collect()
}

/// The nearest and the farthest distance, mm.
fn ends(study: &Study) -> [f64; 2] {
    let plates = &study.thin_paper.line.plates;
    [plates.first(), plates.last()].map(|plate| plate.map_or(f64::NAN, |plate| plate.true_z_mm))
}

/// Recovered z over recovered x of the tilted plates, with the fitted lines  [Ohno2018, Fig. 11].
pub(super) fn tilts(case: &CaseStudy) -> String {
    let colours = [Colour::Blue, Colour::Vermilion, Colour::Green];
    let mut chart = Chart::new("x, mm", "z, mm").x_range(-8.0, 8.0).y_range(280.0, 315.0);
    for ((tilt, fit), colour) in published::TILTS.iter().zip(&case.tilts).zip(colours) {
        let reading = tilt::of_tilt(&case.readings, tilt.tilt_deg);
        let points: Vec<PlotPoint> = reading
            .into_iter()
            .flat_map(|reading| reading.points_mm())
            .map(|[x_mm, _, z_mm]| PlotPoint::from([x_mm, z_mm]))
            .collect();
        let slope = fit.tilt_rad.value.tan();
        let line: Vec<[f64; 2]> = [-7.5, 7.5].iter().map(|&x_mm| [x_mm, fit.z_mm.value + slope * x_mm]).collect();
        let label = format!("{}°: {:.2}°", tilt.tilt_deg, fit.tilt_rad.value.to_degrees());
        chart = chart.line("", colour, Stroke::Solid, &line).points(&label, colour, &points);
    }
    chart.into_svg()
}

/// Fitted less true tilt, as published and as found.
pub(super) fn tilt_error(study: &Study) -> String {
    let printed = published::TILTS.map(|tilt| [tilt.tilt_deg, tilt.fitted_deg.value - tilt.tilt_deg]);
    let ends = [25.0, 65.0];
    let mut chart = Chart::new("true tilt, degrees", "fitted − true tilt, degrees")
        .x_range(ends[0], ends[1])
        .line("", Colour::Grey, Stroke::Dashed, &ends.map(|tilt_deg| [tilt_deg, 0.0]))
        .points("published", Colour::Grey, &printed.map(PlotPoint::from));
    for case in study.cases() {
        let error = |(tilt, fit): (&published::PublishedTilt, &twinpupil_reconstruct::LineFit)| {
            PlotPoint::from([tilt.tilt_deg, fit.tilt_rad.value.to_degrees() - tilt.tilt_deg])
        };
        let points: Vec<PlotPoint> = published::TILTS.iter().zip(&case.tilts).map(error).collect();
        chart = chart.points(&case.case.label(), colour(case.case), &points);
    }
    chart.y_range(-6.0, 2.0).into_svg()
}
