//! A lens in section with rays through it, and with the masks of a camera, as SVG: z to the right, y up, a millimetre a unit.

use std::fmt::Write;

use twinpupil_instrument::{Aperture, Shape, SurfaceSpec};
use twinpupil_optics::{Imager, Ray, Train};

use super::asked::Asked;
use crate::plot;
use crate::report::escaped;

/// Points of a surface's section.
const POINTS: usize = 41;

/// Where rays pass the stop of a lens, in its radii, or the narrow pupil of a camera's band.
const PLACES: &[f64] = &[-1.0, -0.5, 0.0, 0.5, 1.0];
const CAMERA_PLACES: &[f64] = &[-1.0, 0.0, 1.0];

/// How far before the lens rays are drawn, in parts of the way from its first surface to the image, and how far at most, in
/// widths of the beam.
const LEAD: f64 = 0.3;
const LEAD_WIDTHS: f64 = 2.0;

/// The shorter side of a drawing is at least this part of the longer one.
const FLATTEST: f64 = 0.25;

/// What is drawn, in the axes of the lens: z and y, mm.
type Line = Vec<[f64; 2]>;

/// What a drawing is of.
pub(super) struct Drawn<'a> {
    /// The lens as it was asked about.
    pub(super) asked: &'a Asked,
    /// Which colours rays are drawn in.
    pub(super) colours: Vec<usize>,
    /// Surfaces of the lens, from the object on.
    pub(super) surfaces: &'a [SurfaceSpec],
    /// Masks among them.
    pub(super) masks: &'a [Aperture],
    /// Half the height of the sensor, mm, if the image is one.
    pub(super) half_sensor_mm: Option<f64>,
}

/// A ray from before the lens as far as it comes.
struct Path {
    ink: plot::Colour,
    line: Line,
    /// Its distance from the axis where it meets each surface or mask, mm.
    heights_mm: Vec<f64>,
}

/// The drawing.
pub(super) fn svg(drawn: &Drawn<'_>) -> String {
    let surfaces: Vec<&SurfaceSpec> = drawn.surfaces.iter().filter(|surface| surface.shape != Shape::Break).collect();
    let inks = drawn.asked.inks();
    let paths: Vec<Path> = drawn.colours.iter().flat_map(|colour| paths(drawn.asked, *colour, inks[*colour])).collect();
    let Some(train) = drawn.asked.colours.first().map(|colour| colour.imager.train()) else { return String::new() };
    let of_lens: Vec<usize> = (0..train.len()).filter(|met| train.mask_met(*met).is_none()).collect();
    let radii_mm = radii_mm(&surfaces, &of_lens, &paths, drawn.half_sensor_mm);
    let section = |(met, radius_mm): (&usize, &f64)| flat(&train.section(*met, *radius_mm, POINTS));
    let sections: Vec<Line> = of_lens.iter().zip(&radii_mm).map(section).collect();
    let mut sheet = Sheet::around(sections.iter().chain(paths.iter().map(|path| &path.line)));
    sheet.glass(&surfaces, &sections);
    for path in &paths {
        let style = format!(
            "stroke=\"{}\" stroke-opacity=\"0.75\" stroke-width=\"{:.4}\"",
            path.ink.css(),
            0.4 * sheet.stroke_mm
        );
        sheet.element("polyline", path.line.iter(), &style);
    }
    for (k, section) in sections.iter().enumerate() {
        let style = match surfaces.get(k) {
            Some(surface) if surface.stop && surface.medium == "air" => {
                "stroke=\"#999\" stroke-dasharray=\"1 1\"".to_owned()
            }
            Some(surface) if surface.mirror => "stroke=\"#333\" stroke-linecap=\"round\"".to_owned(),
            None if drawn.half_sensor_mm.is_some() => {
                format!("stroke=\"#333\" stroke-width=\"{:.4}\"", 3.0 * sheet.stroke_mm)
            }
            _ => "stroke=\"#333\"".to_owned(),
        };
        sheet.element("polyline", section.iter(), &style);
    }
    sheet.masks(drawn, train, &paths, &inks);
    sheet.legend(drawn, &inks);
    sheet.into_svg()
}

/// Rays of a colour from all points of the field.
fn paths(asked: &Asked, colour: usize, ink: plot::Colour) -> Vec<Path> {
    let imager = &asked.colours[colour].imager;
    let places: Vec<[f64; 2]> =
        if asked.is_camera() { CAMERA_PLACES } else { PLACES }.iter().map(|place| [0.0, *place]).collect();
    let rays: Vec<Ray> = (0..asked.fields.len())
        .filter_map(|field| asked.views_at(field).nth(colour))
        .flat_map(|view| imager.rays(view.point_of_field(), &places))
        .flatten()
        .collect();
    let lead_mm = lead_mm(imager, &rays);
    rays.iter().map(|ray| path(imager.train(), ray, lead_mm, ink)).collect()
}

fn path(train: &Train, ray: &Ray, lead_mm: f64, ink: plot::Colour) -> Path {
    let (met, _) = train.path(ray);
    let [dy, dz] = [ray.direction[1], ray.direction[2]];
    let places = flat(&train.in_lens_axes(&met));
    let before = places.first().map(|[z, y]| [z - lead_mm, y - lead_mm * dy / dz]);
    Path {
        ink,
        line: before.into_iter().chain(places).collect(),
        heights_mm: met.iter().map(|ray| ray.position_mm[1].abs()).collect(),
    }
}

/// How far before the lens rays are drawn, mm.
fn lead_mm(imager: &Imager, rays: &[Ray]) -> f64 {
    let train = imager.train();
    let ends = |met: usize| flat(&train.section(met, 0.0, 1)).first().map_or(0.0, |[z, _]| *z);
    let length_mm = (ends(train.len() - 1) - ends(0)).abs();
    let reached_mm = rays.iter().flat_map(|ray| train.path(ray).0).map(|ray| ray.position_mm[1].abs());
    let width_mm = 2.0 * reached_mm.fold(0.0, f64::max);
    (LEAD * length_mm).min(LEAD_WIDTHS * width_mm.max(0.1 * length_mm))
}

/// How far out each surface is drawn, the image included: to its own rim, or a little beyond the rays; both faces of a piece
/// of glass alike.
fn radii_mm(surfaces: &[&SurfaceSpec], of_lens: &[usize], paths: &[Path], half_image_mm: Option<f64>) -> Vec<f64> {
    let reached_mm = |met: usize| {
        let heights = paths.iter().filter_map(|path| path.heights_mm.get(met));
        1.05 * heights.copied().fold(0.1, f64::max)
    };
    let own_mm = |(k, met): (usize, &usize)| {
        let stated_mm = match surfaces.get(k) {
            Some(surface) => surface.semi_diameter_mm,
            None => half_image_mm,
        };
        stated_mm.unwrap_or_else(|| reached_mm(*met))
    };
    let is_glass = |k: usize| surfaces.get(k).is_some_and(|surface| surface.medium != "air");
    let mut radii_mm: Vec<f64> = of_lens.iter().enumerate().map(own_mm).collect();
    for k in 0..surfaces.len().min(radii_mm.len().saturating_sub(1)) {
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

/// An SVG in the making.
struct Sheet {
    /// Lower and upper end of z and y, mm.
    low_mm: [f64; 2],
    high_mm: [f64; 2],
    stroke_mm: f64,
    body: String,
}

impl Sheet {
    /// With room for lines, and for a legend below.
    fn around<'a>(lines: impl Iterator<Item = &'a Line>) -> Self {
        let (low, high) = lines.flatten().fold(([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]), |(low, high), at| {
            ([low[0].min(at[0]), low[1].min(at[1])], [high[0].max(at[0]), high[1].max(at[1])])
        });
        let size_mm = (high[0] - low[0]).max(high[1] - low[1]).max(1e-3);
        // A flat drawing gets some room above and below, for what is written there.
        let lacking_mm = (0.5 * (FLATTEST * size_mm - (high[1] - low[1]))).max(0.0);
        let margin_mm = 0.03 * size_mm;
        Self {
            low_mm: [low[0] - margin_mm, low[1] - margin_mm - lacking_mm - 0.05 * size_mm],
            high_mm: [high[0] + margin_mm, high[1] + margin_mm + lacking_mm + 0.04 * size_mm],
            stroke_mm: 0.002 * size_mm,
            body: String::new(),
        }
    }

    fn letter_mm(&self) -> f64 {
        9.0 * self.stroke_mm
    }

    /// A line of points, y up.
    fn element<'a>(&mut self, kind: &str, points: impl Iterator<Item = &'a [f64; 2]>, style: &str) {
        let points: Vec<String> = points.map(|[z, y]| format!("{z:.4},{:.4}", -y)).collect();
        // Writing to a string cannot fail.
        let _ = writeln!(self.body, "<{kind} points=\"{}\" {style}/>", points.join(" "));
    }

    fn text(&mut self, [z_mm, y_mm]: [f64; 2], anchor: &str, ink: &str, text: &str) {
        let _ = writeln!(
            self.body,
            "<text x=\"{z_mm:.4}\" y=\"{:.4}\" text-anchor=\"{anchor}\" fill=\"{ink}\" stroke=\"none\" \
             font-family=\"system-ui, sans-serif\" font-size=\"{:.4}\">{}</text>",
            -y_mm,
            self.letter_mm(),
            escaped(text)
        );
    }

    fn glass(&mut self, surfaces: &[&SurfaceSpec], sections: &[Line]) {
        for (surface, pair) in surfaces.iter().zip(sections.windows(2)).filter(|(surface, _)| surface.medium != "air") {
            let outline = pair[0].iter().chain(pair[1].iter().rev());
            let style = if surface.mirror { "fill=\"none\"" } else { "fill=\"#dbe9f6\" stroke=\"none\"" };
            self.element("polygon", outline, style);
        }
    }

    /// Masks edge on: what passes one colour alone in that colour, what passes none in black, what passes all not at all.
    fn masks(&mut self, drawn: &Drawn<'_>, train: &Train, paths: &[Path], inks: &[plot::Colour]) {
        for met in 0..train.len() {
            let Some((index, mask)) = train.mask_met(met).and_then(|index| Some((index, drawn.masks.get(index)?)))
            else {
                continue;
            };
            let [z_mm, centre_mm] =
                [flat(&train.section(met, 0.0, 1)).first().map_or(0.0, |at| at[0]), -mask.centre_mm[1]];
            let widest_mm = mask.zones.iter().filter_map(|zone| zone.radius_mm).fold(0.0, f64::max);
            let reached_mm = paths.iter().filter_map(|path| path.heights_mm.get(met)).copied().fold(0.0, f64::max);
            let end_mm = (2.0 * widest_mm).max(1.3 * reached_mm).max(8.0 * self.stroke_mm);
            let mut inner_mm = 0.0;
            let opaque =
                std::iter::once(None).filter(|_| mask.zones.last().is_none_or(|zone| zone.radius_mm.is_some()));
            for zone in mask.zones.iter().map(Some).chain(opaque) {
                let outer_mm = zone.and_then(|zone| zone.radius_mm).unwrap_or(end_mm);
                let passed: Vec<usize> = (0..inks.len())
                    .filter(|k| zone.is_some_and(|zone| zone.pass.contains(&drawn.asked.colours[*k].name)))
                    .collect();
                let ink = match passed[..] {
                    [] => Some("#111"),
                    [only] if inks.len() > 1 => Some(inks[only].css()),
                    _ => None,
                };
                if let Some(ink) = ink {
                    let style = format!("stroke=\"{ink}\" stroke-width=\"{:.4}\"", 2.5 * self.stroke_mm);
                    for side in [-1.0, 1.0] {
                        let ends = [inner_mm, outer_mm].map(|mm| [z_mm, centre_mm + side * mm]);
                        self.element("polyline", ends.iter(), &style);
                    }
                }
                inner_mm = outer_mm;
            }
            let label_mm = self.high_mm[1] - 1.5 * self.letter_mm();
            let leader = [centre_mm + end_mm, label_mm - 0.4 * self.letter_mm()].map(|y_mm| [z_mm, y_mm]);
            let style = format!("stroke=\"#999\" stroke-width=\"{:.4}\"", 0.4 * self.stroke_mm);
            self.element("polyline", leader.iter(), &style);
            self.text([z_mm, label_mm], "middle", "#333", &format!("mask {index}"));
        }
    }

    /// What the colours are, and how long a centimetre or so is.
    fn legend(&mut self, drawn: &Drawn<'_>, inks: &[plot::Colour]) {
        let base_mm = self.low_mm[1] + 0.7 * self.letter_mm();
        let mut z_mm = self.low_mm[0] + self.letter_mm();
        for colour in &drawn.colours {
            let name = &drawn.asked.colours[*colour].name;
            let style = format!("stroke=\"{}\" stroke-width=\"{:.4}\"", inks[*colour].css(), 2.0 * self.stroke_mm);
            let ends = [0.0, 2.0].map(|letters| [z_mm + letters * self.letter_mm(), base_mm + 0.3 * self.letter_mm()]);
            self.element("polyline", ends.iter(), &style);
            self.text([z_mm + 2.5 * self.letter_mm(), base_mm], "start", "#333", name);
            z_mm += (4.0 + 0.6 * name.chars().count() as f64) * self.letter_mm();
        }
        let bar_mm = crate::round::round_below(0.2 * (self.high_mm[0] - self.low_mm[0]));
        let right_mm = self.high_mm[0] - self.letter_mm();
        let ends = [right_mm - bar_mm, right_mm].map(|z_mm| [z_mm, base_mm + 1.2 * self.letter_mm()]);
        self.element("polyline", ends.iter(), "stroke=\"#333\"");
        self.text([right_mm - 0.5 * bar_mm, base_mm], "middle", "#333", &format!("{bar_mm} mm"));
    }

    fn into_svg(self) -> String {
        let [left, top] = [self.low_mm[0], -self.high_mm[1]];
        let [width, height] = [0, 1].map(|k| self.high_mm[k] - self.low_mm[k]);
        let wide = 1000.0;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{left:.4} {top:.4} {width:.4} {height:.4}\" width=\"{wide}\" \
             height=\"{:.0}\" fill=\"none\" stroke-width=\"{:.4}\">\n<rect x=\"{left:.4}\" y=\"{top:.4}\" \
             width=\"{width:.4}\" height=\"{height:.4}\" fill=\"white\"/>\n{}</svg>\n",
            wide * height / width,
            self.stroke_mm,
            self.body
        )
    }
}
