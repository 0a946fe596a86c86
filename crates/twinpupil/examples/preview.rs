//! Draws plots, pictures and a report from made-up data, to look at them: `cargo run --example preview -- FOLDER`.
use std::path::PathBuf;

use anyhow::{Context, Result};
use twinpupil::plot::{Chart, Colour, PlotPoint, Stroke};

fn main() -> Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).context("usage: preview FOLDER")?);
    std::fs::create_dir_all(&folder)?;
    std::fs::write(folder.join("fig10.svg"), fig10())?;
    std::fs::write(folder.join("fig11.svg"), fig11())?;
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
