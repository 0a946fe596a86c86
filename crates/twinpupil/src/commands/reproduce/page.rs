//! The report as one page.

use anyhow::Result;
use twinpupil_instrument::Role;

use super::exposures::{Exposures, Shown};
use super::plots;
use crate::experiments::{Comparison, LensModel, Study, published};
use crate::flow;
use crate::picture::Picture;
use crate::report::{Column, Figure, Headline, Report};

pub(super) fn page(
    exposures: &Exposures<'_>,
    study: &Study,
    comparison: &Comparison,
    choices: &[String],
) -> Result<Report> {
    let mut report = Report::new("Depth from two coaxial apertures: the paper, done again");
    report.lead(&format!(
        "{}. Its camera is simulated ray by ray, once with an ideal lens and once with its Fresnel lens, and every \
         frame is read by the paper's own equations and by twinpupil. Published numbers are quoted; all others come \
         from this run.",
        published::CITATION
    ));
    report.headlines(&headlines(study));
    frames(&mut report, exposures)?;
    depths(&mut report, study);
    table(&mut report, comparison);
    report.heading("Stated choices");
    report.paragraph("What an experiment needs and the paper's text leaves open.");
    report.list(choices);
    Ok(report)
}

fn headlines(study: &Study) -> [Headline; 4] {
    let line_mm = |deviation_mm: f64| format!("{:.1} mm", deviation_mm.abs());
    let inner = study.thin_paper.rings[0].iter().map(|depth| (depth.mean_mm - depth.true_z_mm).abs());
    let tilt_off_deg = published::TILTS.iter().zip(&study.fresnel_model.tilts);
    let tilt_off_deg = tilt_off_deg.map(|(tilt, fit)| (fit.tilt_rad.value.to_degrees() - tilt.tilt_deg).abs());
    let published_off_deg = published::TILTS.iter().map(|tilt| (tilt.fitted_deg.value - tilt.tilt_deg).abs());
    let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    [
        Headline::new(
            line_mm(largest(&mut inner.into_iter())),
            "largest depth error at r = 2 by the paper's equations, thin lens, no noise: the masks clip each other",
        ),
        Headline::new(
            line_mm(study.fresnel_paper.line.largest_from_truth().value_mm),
            format!(
                "line of Fig. 10 off the truth by at most, Fresnel lens, paper's equations; published: {} mm",
                published::LINE_OFF_TRUTH_MM.value
            ),
        ),
        Headline::new(
            format!("{:.2} mm", study.fresnel_model.line.std_against_ideal_mm),
            format!(
                "standard deviation of Fig. 10 against the ideal, Fresnel lens, twinpupil; published: {} mm",
                published::STD_AGAINST_IDEAL_MM.value
            ),
        ),
        Headline::new(
            format!("{:.2}°", largest(&mut tilt_off_deg.into_iter())),
            format!(
                "largest error of the three tilts of Fig. 11, Fresnel lens, twinpupil; published: {:.1}°",
                largest(&mut published_off_deg.into_iter())
            ),
        ),
    ]
}

fn frames(report: &mut Report, exposures: &Exposures<'_>) -> Result<()> {
    report.heading("Frames");
    report.paragraph(
        "The plate of 60 random dots. Red is the telecentric band, which keeps its size at every distance; blue is the \
         entocentric band, which shrinks with distance. Nearer than focus (296 mm) blue lies outside red, beyond it \
         inside.",
    );
    let mut pictures = Vec::new();
    for shown in [LensModel::Thin, LensModel::Fresnel].iter().filter_map(|&lens| exposures.shown(lens, 250.0)) {
        let picture = Picture::of_frame(&shown.frame, &shown.rig.instrument)?.shrunk(2);
        let description = format!("{} at {} mm.", name(shown), shown.z_mm);
        pictures.push(Figure::new(picture.to_html(&description)?, description));
    }
    report.figures(&pictures);

    report.heading("Decomposed bands");
    if let Some(shown) = exposures.shown(LensModel::Fresnel, 250.0) {
        report.figures(&[band(shown, Role::Telecentric)?, band(shown, Role::Entocentric)?]);
    }

    report.heading("Flow");
    report.paragraph("Every dot moves along its own radius; how far, relative to where it is, is its depth.");
    let mut flows = Vec::new();
    for shown in [250.0, 350.0].iter().filter_map(|&z_mm| exposures.shown(LensModel::Fresnel, z_mm)) {
        let what = format!("{} at {} mm.", name(shown), shown.z_mm);
        flows.push(flow::figure(&shown.frame, &shown.rig.instrument, &shown.points, &what)?);
    }
    report.figures(&flows);
    Ok(())
}

fn name(shown: &Shown<'_>) -> &'static str {
    match shown.rig.lens {
        LensModel::Thin => "Thin lens, plate",
        LensModel::Fresnel => "Fresnel lens, plate",
    }
}

fn band(shown: &Shown<'_>, role: Role) -> Result<Figure> {
    let instrument = &shown.rig.instrument;
    let picture = Picture::of_band(&shown.frame, instrument, instrument.band_index(role))?.shrunk(2);
    let band = instrument.band(role);
    let description = format!("{} at {} mm, {} band, {}.", name(shown), shown.z_mm, band.name, role.name());
    Ok(Figure::new(picture.to_html(&description)?, description))
}

fn depths(report: &mut Report, study: &Study) {
    report.heading("Two rings: Figs. 3 and 4");
    report.paragraph(
        "Depth error of the two rings, without noise. Clipping bends the depth of the inner ring; the Fresnel lens's \
         dispersion shifts both. Bars are the spread within a ring.",
    );
    let caption = ["r = 2.0 mm, where the masks clip each other's pupils.", "r = 7.5 mm, where they do not."];
    report.figures(&[0, 1].map(|ring| Figure::new(plots::ring(study, ring), caption[ring])));
    report.heading("Plate across the axis: Fig. 10");
    report.figures(&[
        Figure::new(
            plots::depth(study),
            "Recovered against true depth: mean of all dots, bars their standard deviation, and the line through all \
             of them.",
        ),
        Figure::new(
            plots::depth_error(study),
            "The same less the truth. The band is the largest deviation that the paper states for its own fitted line.",
        ),
    ]);
    report.heading("Tilted plate: Fig. 11");
    let caption = |case: &crate::experiments::CaseStudy| {
        let r_squared = case.tilts.iter().map(|fit| format!("{:.5}", fit.quality.r_squared)).collect::<Vec<_>>();
        let [lens, reading] = case.case.heading();
        format!("True and fitted tilts: {lens}, {reading}. R² {}.", r_squared.join(", "))
    };
    let mut figures = study.cases().map(|case| Figure::new(plots::tilts(case), caption(case))).to_vec();
    let r_squared = published::TILTS.map(|tilt| tilt.r_squared.text()).join(", ");
    let errors = format!("How far the fitted tilts are off. Published R²: {r_squared}.");
    figures.push(Figure::new(plots::tilt_error(study), errors));
    report.figures(&figures);
}

fn table(report: &mut Report, comparison: &Comparison) {
    report.heading("As published and as found");
    let [published, thin_paper, fresnel_paper, fresnel_model] = Comparison::headings()
        .map(|[first, second]| if second.is_empty() { first.to_owned() } else { format!("{first}, {second}") });
    for section in &comparison.sections {
        report.subheading(section.title);
        let columns = [
            Column::text("quantity"),
            Column::number(&published),
            Column::number(&thin_paper),
            Column::number(&fresnel_paper),
            Column::number(&fresnel_model),
            Column::number("why"),
        ];
        let rows = section.rows.iter().map(|row| {
            let [published, thin_paper, fresnel_paper, fresnel_model] = row.cells();
            let why = row.explanation.number().to_string();
            [row.quantity.clone(), published, thin_paper, fresnel_paper, fresnel_model, why]
        });
        report.table(&columns, &rows.collect::<Vec<_>>());
    }
    report.subheading("Why the columns differ");
    report.numbered(&comparison.notes.iter().map(|note| note.text.clone()).collect::<Vec<_>>());
}
