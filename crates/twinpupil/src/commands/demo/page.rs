//! The result as one page.

use anyhow::Result;
use twinpupil_instrument::Role;

use super::text::{depth_cells, dots, published_numbers, tilt_cells};
use super::{Exposed, Found, Line};
use crate::experiments::published::{self, CITATION};
use crate::experiments::{Reading, Rig};
use crate::flow;
use crate::picture::Picture;
use crate::plot::{Chart, Colour, PlotPoint, Stroke};
use crate::report::{Column, Figure, Headline, Report};

pub(super) fn page(rig: &Rig, exposed: &[Exposed], lines: &[Line]) -> Result<Report> {
    let mut report = Report::new("Depth from one exposure");
    report.lead(&format!(
        "One lens with two concentric colour apertures sees every dot twice, at two radii; their ratio is the dot's \
         depth. Frames of the paper's camera, simulated with photon and read noise and an ideal lens, read by the \
         paper's equations and by twinpupil. {CITATION}."
    ));
    report.headlines(&headlines(lines));
    frames(&mut report, rig, exposed)?;
    report.heading("Depth");
    report.figures(&[
        Figure::new(
            depth_error(exposed),
            "Depth error of every dot over its distance from the axis, at 250, 300 and 350 mm. Near the axis the two \
             masks clip each other's pupils, which the paper's equations do not know and the forward model does.",
        ),
        Figure::new(tilted(exposed, lines), "The plate tilted at 300 mm: recovered z over recovered x."),
    ]);
    table(&mut report, lines);
    report.paragraph(&format!("Published, through the real Fresnel lens: {}.", published_numbers()));
    Ok(report)
}

fn headlines(lines: &[Line]) -> Vec<Headline> {
    let worst = |rms: fn(&Line) -> f64| lines.iter().filter(|line| !line.is_tilted()).map(rms).fold(0.0, f64::max);
    let mut headlines = vec![
        Headline::new(
            format!("{:.3} mm", worst(|line| line.twinpupil.rms_error_mm)),
            "rms depth error of twinpupil, all dots found, at the worst of the three distances",
        ),
        Headline::new(
            format!("{:.3} mm", worst(|line| line.paper.rms_error_mm)),
            format!(
                "the same by the paper's equations; published, with the real lens: {} mm",
                published::STD_AGAINST_IDEAL_MM.text()
            ),
        ),
    ];
    for line in lines.iter().filter(|line| line.is_tilted()) {
        let tilt_deg = line.twinpupil.tilt_deg.unwrap_or(f64::NAN);
        headlines.push(Headline::new(format!("{tilt_deg:.2}°"), format!("fitted tilt, true {}°", line.true_tilt_deg)));
    }
    headlines
}

fn frames(report: &mut Report, rig: &Rig, exposed: &[Exposed]) -> Result<()> {
    report.heading("What the camera sees");
    report.paragraph(
        "60 dots on a plate at 250 mm. Red is the telecentric band, which keeps its size at every distance; blue is \
         the entocentric band, which shrinks with distance.",
    );
    let near = &exposed[0];
    let instrument = &rig.instrument;
    let flow = flow::figure(&near.frame, instrument, &near.reconstruction.points, "Both bands.")?;
    report.figures(&[flow]);
    let band = |role: Role| -> Result<Figure> {
        let band = instrument.band(role);
        let description = format!("The {} band alone, {}.", band.name, role.name());
        let picture = Picture::of_band(&near.frame, instrument, instrument.band_index(role))?.shrunk(2);
        Ok(Figure::new(picture.to_html(&description)?, description))
    };
    report.figures(&[band(Role::Telecentric)?, band(Role::Entocentric)?]);
    Ok(())
}

fn depth_error(exposed: &[Exposed]) -> String {
    let points = |k: usize| -> Vec<PlotPoint> {
        let flat = exposed.iter().map(|exposed| &exposed.readings[k]).filter(|reading| !is_tilted(reading));
        let dots = flat.flat_map(|reading| &reading.dots);
        dots.map(|dot| PlotPoint::from([dot.radius_mm(), dot.depth_error_mm()])).collect()
    };
    Chart::new("distance from the axis, mm", "recovered − true z, mm")
        .points("paper's equations", Colour::Vermilion, &points(0))
        .points("twinpupil", Colour::Green, &points(1))
        .into_svg()
}

fn is_tilted(reading: &Reading) -> bool {
    matches!(reading.experiment, crate::experiments::Experiment::Tilt { .. })
}

fn tilted(exposed: &[Exposed], lines: &[Line]) -> String {
    let readings = || exposed.iter().filter(|exposed| is_tilted(&exposed.readings[0])).map(|exposed| &exposed.readings);
    let points = |k: usize| -> Vec<PlotPoint> {
        let all = readings().flat_map(|readings| readings[k].points_mm());
        all.map(|[x_mm, _, z_mm]| PlotPoint::from([x_mm, z_mm])).collect()
    };
    let slope =
        lines.iter().find(|line| line.is_tilted()).map_or(f64::NAN, |line| line.true_tilt_deg.to_radians().tan());
    let truth = [-7.5, 7.5].map(|x_mm| [x_mm, 300.0 + slope * x_mm]);
    Chart::new("x, mm", "z, mm")
        .line("truth", Colour::Grey, Stroke::Dashed, &truth)
        .points("paper's equations", Colour::Vermilion, &points(0))
        .points("twinpupil", Colour::Green, &points(1))
        .into_svg()
}

fn table(report: &mut Report, lines: &[Line]) {
    let columns = [
        Column::text("plate"),
        Column::text("read by"),
        Column::number("dots"),
        Column::number("mean z, mm"),
        Column::number("rms error, mm"),
        Column::number("tilt"),
        Column::number("R²"),
    ];
    let row = |line: &Line, method: &str, found: &Found| {
        let ([mean_z, rms_error], [tilt, r_squared]) = (depth_cells(found), tilt_cells(found));
        [line.plate(), method.to_owned(), dots(line, found), mean_z, rms_error, tilt, r_squared]
    };
    let rows = lines
        .iter()
        .flat_map(|line| [row(line, "paper's equations", &line.paper), row(line, "twinpupil", &line.twinpupil)]);
    report.table(&columns, &rows.collect::<Vec<_>>());
}
