//! Draws plots, pictures and a report from made-up data, to look at them: `cargo run --example preview -- FOLDER`.
use std::path::PathBuf;

use anyhow::{Context, Result};
use twinpupil::picture::{Overlay, Picture};
use twinpupil::plot::{Chart, Colour, PlotPoint, Stroke};
use twinpupil::report::{Column, Figure, Report};
use twinpupil_instrument::{Frame, PixelPoint, paper};

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

/// Discs on the two sub-lattices, drawn without any optics.
fn frame(pairs: &[(PixelPoint, PixelPoint)]) -> Result<Frame> {
    let sensor = &paper::instrument().sensor.clone();
    let [width, height] = sensor.size_px;
    let code = |i: usize| {
        let (u, v) = (i % width, i / width);
        let lit = |centre: PixelPoint| {
            let distance_px = (u as f64 - centre.u).hypot(v as f64 - centre.v);
            2500.0 * ((43.0 - distance_px) / 12.0 + 0.5).clamp(0.0, 1.0)
        };
        let noise = ((i as f64 * 12.9898).sin() * 43758.547).fract().abs() * 30.0;
        let signal: f64 = match (u % 2, v % 2) {
            (0, 0) => pairs.iter().map(|pair| lit(pair.0)).sum(),
            (1, 1) => pairs.iter().map(|pair| lit(pair.1)).sum(),
            _ => 0.0,
        };
        (signal + noise).min(4095.0) as u16
    };
    Ok(Frame::new(width, height, sensor.code_max(), vec![(0..width * height).map(code).collect()])?)
}

fn report() -> Result<String> {
    let instrument = paper::instrument();
    let pairs: Vec<(PixelPoint, PixelPoint)> = (0..40)
        .map(|i| {
            let (radius_px, azimuth_rad) = (180.0 + 11.0 * f64::from(i), 2.4 * f64::from(i));
            let at = |scale: f64| PixelPoint {
                u: 959.5 + scale * radius_px * azimuth_rad.cos(),
                v: 599.5 + scale * radius_px * azimuth_rad.sin(),
            };
            (at(1.0), at(1.13))
        })
        .collect();
    let frame = frame(&pairs)?;
    let picture = Picture::of_frame(&frame, &instrument)?.shrunk(2);
    let mut overlay = Overlay::new();
    for (telecentric, entocentric) in &pairs {
        overlay.circle(*telecentric, 43.0, Colour::White);
        overlay.circle(*entocentric, 43.0, Colour::White);
        overlay.arrow(*telecentric, *entocentric, Colour::Orange);
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
