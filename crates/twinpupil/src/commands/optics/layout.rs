//! A lens in section, with rays through it, as SVG: z to the right, y up, a millimetre a unit.

use std::fmt::Write;

use anyhow::Result;
use twinpupil_instrument::{Shape, SurfaceSpec};
use twinpupil_optics::Ray;

use super::used::Used;

/// Points of a surface's section.
const POINTS: usize = 41;

/// Where rays pass the stop, in its radii.
const PLACES: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];

/// Parts of the field that rays come from.
const FIELDS: [f64; 3] = [0.0, 0.7, 1.0];

/// Shortest and longest wavelength.
const COLOURS: [&str; 2] = ["#2563c9", "#c92a2a"];

/// What is drawn, in the axes of the lens: z and y, mm.
type Line = Vec<[f64; 2]>;

/// The drawing.
pub(super) fn svg(used: &Used) -> Result<String> {
    let ends = used.shortest_and_longest();
    let paths = ends.iter().map(|colour| paths(used, *colour)).collect::<Result<Vec<_>>>()?;
    let rays: Vec<(usize, Vec<Path>)> = paths.into_iter().enumerate().collect();
    let surfaces: Vec<&SurfaceSpec> =
        used.file.prescription.surfaces.iter().filter(|surface| surface.shape != Shape::Break).collect();
    let radii_mm = radii_mm(&surfaces, &rays);
    let sections: Vec<Line> = radii_mm
        .iter()
        .enumerate()
        .map(|(k, radius_mm)| flat(&used.trains[0].section(k, *radius_mm, POINTS)))
        .collect();
    let lines: Vec<(usize, Line)> =
        rays.into_iter().flat_map(|(colour, paths)| paths.into_iter().map(move |path| (colour, path.line))).collect();
    Ok(drawing(&surfaces, &sections, &lines))
}

/// A ray from before the lens as far as it comes.
struct Path {
    line: Line,
    /// Its distance from each surface's vertex across the axis, mm.
    heights_mm: Vec<f64>,
}

fn paths(used: &Used, colour: usize) -> Result<Vec<Path>> {
    let (train, imager) = (&used.trains[colour], used.imager(colour)?);
    let pupil_mm = used.pupil_mm()?;
    let lead_mm = 0.4 * pupil_mm + 0.1 * used.first_order.focal_length_mm.abs().min(10.0 * pupil_mm);
    let places = PLACES.map(|place| [0.0, place]);
    let rays = FIELDS.iter().flat_map(|part| imager.rays(used.field(part * used.field_slope), &places)).flatten();
    let path = |ray: Ray| {
        let (met, _) = train.path(&ray);
        let [dy, dz] = [ray.direction[1], ray.direction[2]];
        let entry = flat(&train.in_lens_axes(&met[..met.len().min(1)]));
        let before = entry.first().map(|[z, y]| [z - lead_mm, y - lead_mm * dy / dz]);
        let line = before.into_iter().chain(flat(&train.in_lens_axes(&met))).collect();
        Path { line, heights_mm: met.iter().map(|ray| ray.position_mm[1].abs()).collect() }
    };
    Ok(rays.map(path).collect())
}

/// How far out each surface is drawn, the image included: to its own rim, or a little beyond the rays; both faces of a piece
/// of glass alike.
fn radii_mm(surfaces: &[&SurfaceSpec], rays: &[(usize, Vec<Path>)]) -> Vec<f64> {
    let reached_mm = |k: usize| {
        let heights = rays.iter().flat_map(|(_, paths)| paths).filter_map(|path| path.heights_mm.get(k));
        1.05 * heights.copied().fold(0.1, f64::max)
    };
    let own_mm = |k: usize| surfaces.get(k).and_then(|surface| surface.semi_diameter_mm).unwrap_or(reached_mm(k));
    let is_glass = |k: usize| surfaces.get(k).is_some_and(|surface| surface.medium != "air");
    let mut radii_mm: Vec<f64> = (0..=surfaces.len()).map(own_mm).collect();
    for k in 0..surfaces.len() {
        if is_glass(k) {
            let wider_mm = radii_mm[k].max(radii_mm[k + 1]);
            (radii_mm[k], radii_mm[k + 1]) = (wider_mm, wider_mm);
        }
    }
    radii_mm
}

/// z and y.
fn flat(places: &[[f64; 3]]) -> Line {
    places.iter().map(|[_, y, z]| [*z, *y]).collect()
}

fn drawing(surfaces: &[&SurfaceSpec], sections: &[Line], rays: &[(usize, Line)]) -> String {
    let drawn = sections.iter().chain(rays.iter().map(|(_, line)| line)).flatten();
    let bounds = drawn.fold([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]], |[low, high], at| {
        [[low[0].min(at[0]), low[1].min(at[1])], [high[0].max(at[0]), high[1].max(at[1])]]
    });
    let [width, height] = [0, 1].map(|k| (bounds[1][k] - bounds[0][k]).max(1e-3));
    let margin = 0.03 * width.max(height);
    let stroke = 0.002 * width.max(height);
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{:.4} {:.4} {:.4} {:.4}\" fill=\"none\" stroke-width=\"{stroke:.4}\">\n",
        bounds[0][0] - margin,
        -bounds[1][1] - margin,
        width + 2.0 * margin,
        height + 2.0 * margin
    );
    for (k, surface) in surfaces.iter().enumerate() {
        if surface.medium != "air" {
            let outline = sections[k].iter().chain(sections[k + 1].iter().rev());
            element(&mut text, "polygon", outline, "fill=\"#dbe9f6\" stroke=\"none\"");
        }
    }
    for (colour, line) in rays {
        let style =
            format!("stroke=\"{}\" stroke-opacity=\"0.7\" stroke-width=\"{:.4}\"", COLOURS[*colour], 0.5 * stroke);
        element(&mut text, "polyline", line.iter(), &style);
    }
    for (k, section) in sections.iter().enumerate() {
        let style = match surfaces.get(k) {
            Some(surface) if surface.stop && surface.medium == "air" => "stroke=\"#999\" stroke-dasharray=\"1 1\"",
            Some(surface) if surface.mirror => "stroke=\"#333\" stroke-linecap=\"round\"",
            _ => "stroke=\"#333\"",
        };
        element(&mut text, "polyline", section.iter(), style);
    }
    text + "</svg>\n"
}

/// A line of points, y up.
fn element<'a>(text: &mut String, kind: &str, points: impl Iterator<Item = &'a [f64; 2]>, style: &str) {
    let points: Vec<String> = points.map(|[z, y]| format!("{z:.4},{:.4}", -y)).collect();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "<{kind} points=\"{}\" {style}/>", points.join(" "));
}
