//! Draws plots of made-up data and pictures of a simulated frame, to look at them: `cargo run --example preview -- FOLDER`.
use std::path::PathBuf;

use anyhow::{Context, Result};
use twinpupil::picture::{Overlay, Picture};
use twinpupil::plot::{Chart, Colour, PlotPoint, Stroke};
use twinpupil::report::{Column, Figure, Report};
use twinpupil_instrument::ResponseMatrix;
use twinpupil_reconstruct::{Options, Reconstructor};
use twinpupil_simulate::{SimulateOptions, paper, simulate};

fn main() -> Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).context("usage: preview FOLDER")?);
    std::fs::create_dir_all(&folder)?;
    std::fs::write(folder.join("fig10.svg"), fig10())?;
    std::fs::write(folder.join("fig11.svg"), fig11())?;
    std::fs::write(folder.join("report.html"), report()?)?;
    Ok(())
}

fn fig10() -> String {
    let z: Vec<f64> = (0..=10).map(|i| 250.0 + 10.0 * f64::from(i)).collect();
    let points: Vec<PlotPoint> =
        z.iter().map(|&z| PlotPoint { x: z, y: z + (z - 300.0) * 0.07 + (z * 7.3).sin(), y_error: 2.2 }).collect();
    let ideal: Vec<[f64; 2]> = vec![[250.0, 250.0], [350.0, 350.0]];
    let fitted: Vec<[f64; 2]> = vec![[250.0, 246.5], [350.0, 353.5]];
    Chart::new("true z, mm", "recovered z, mm")
        .line("truth", Colour::Grey, Stroke::Dashed, &ideal)
        .line("fitted line", Colour::Blue, Stroke::Solid, &fitted)
        .points("mean of 60 dots ± standard deviation", Colour::Vermilion, &points)
        .into_svg()
}

fn fig11() -> String {
    let mut chart = Chart::new("x, mm", "z, mm").x_range(-8.0, 8.0);
    for (angle, colour) in [(30.0_f64, Colour::Vermilion), (45.0, Colour::Blue), (60.0, Colour::Green)] {
        let t = angle.to_radians().tan();
        let points: Vec<PlotPoint> = (0..40)
            .map(|i| {
                let x = -6.0 + 0.3 * f64::from(i);
                PlotPoint::from([x, 300.0 + t * x + (f64::from(i) * 12.9).sin() * 0.8])
            })
            .collect();
        chart = chart.points(&format!("{angle}°"), colour, &points).line(
            "",
            colour,
            Stroke::Solid,
            &[[-6.0, 300.0 - 6.0 * t], [6.0, 300.0 + 6.0 * t]],
        );
    }
    chart.into_svg()
}

fn report() -> Result<String> {
    let instrument = twinpupil_instrument::paper::instrument();
    let scene = paper::tilted_plate(30.0, 1)?;
    let response = ResponseMatrix::ideal(&instrument.bands);
    let frame = simulate(&instrument, &scene, &response, &SimulateOptions::default(), &|_| ())?.frame;
    let points = Reconstructor::new(instrument.clone(), None, Options::default()).frame(&frame)?.points;
    let picture = Picture::of_frame(&frame, &instrument)?.shrunk(2);
    let mut overlay = Overlay::new();
    for point in &points {
        let radius_px = |area_px: f64| (area_px / std::f64::consts::PI).sqrt();
        let (telecentric, entocentric) = (point.telecentric, point.entocentric);
        overlay.circle(telecentric.centre, radius_px(telecentric.area_px), Colour::White);
        overlay.circle(entocentric.centre, radius_px(entocentric.area_px), Colour::White);
        overlay.arrow(telecentric.centre, entocentric.centre, Colour::Orange);
    }

    let mut report = Report::new("The paper, done again");
    report.lead("Made-up numbers, to see what a report looks like. Ohno, Optics Express 26(20), 25880 (2018).");
    report.heading("As published and as found");
    let columns = [
        Column::text("what"),
        Column::number("as published"),
        Column::number("thin lens"),
        Column::number("Fresnel lens"),
        Column::text("explanation"),
    ];
    let rows = [
        ["Tilt of a plate at 30°", "28.1°", "30.02°", "28.3°", "The two masks clip each other near the axis."],
        ["R² at 30°", "0.62", "0.999", "0.71", "The same."],
        ["Largest deviation of the fitted line, mm", "3.6", "0.004", "3.1", "Dispersion: f differs in the two bands."],
    ];
    report.table(&columns, &rows.map(|row| row.map(str::to_owned)));
    report.heading("Frame and bands");
    report.figures(&[Figure::new(overlay.over(&picture)?, "Flow from the telecentric to the entocentric image.")]);
    report.figures(&[
        Figure::new(Picture::of_band(&frame, &instrument, 0)?.shrunk(2).to_html("red band")?, "Telecentric band."),
        Figure::new(Picture::of_band(&frame, &instrument, 1)?.shrunk(2).to_html("blue band")?, "Entocentric band."),
    ]);
    report.heading("Depth");
    report.figures(&[
        Figure::new(fig10(), "Fig. 10: recovered against true depth."),
        Figure::new(fig11(), "Fig. 11: tilted plates."),
    ]);
    Ok(report.into_html())
}
