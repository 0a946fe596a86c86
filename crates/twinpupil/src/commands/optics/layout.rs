//! A lens in section with rays through it, and with the masks of a camera: z to the right, y up.

use anyhow::{Context, Result};
use twinpupil_instrument::{Aperture, Shape, SurfaceSpec};
use twinpupil_optics::{Imager, Ray, Train};

use super::asked::Asked;
use crate::drawing::{Anchor, Drawing, Pen};
use crate::plot;

/// Points of a surface's section.
const POINTS: usize = 41;

/// Where rays pass the stop of a lens, in its radii, or the narrow pupil of a camera's band.
const PLACES: &[f64] = &[-1.0, -0.5, 0.0, 0.5, 1.0];
const CAMERA_PLACES: &[f64] = &[-1.0, 0.0, 1.0];

/// How far before the lens rays are drawn, in parts of the way from its first surface to the image, and how far at most, in
/// widths of the beam.
const LEAD: f64 = 0.3;
const LEAD_WIDTHS: f64 = 2.0;

/// Width of a drawing.
const WIDTH: f64 = 1000.0;

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
pub(super) fn section(drawn: &Drawn<'_>) -> Result<Drawing> {
    let surfaces: Vec<&SurfaceSpec> = drawn.surfaces.iter().filter(|surface| surface.shape != Shape::Break).collect();
    let inks = drawn.asked.inks();
    let paths: Vec<Path> = drawn.colours.iter().flat_map(|colour| paths(drawn.asked, *colour, inks[*colour])).collect();
    let train = drawn.asked.colours.first().context("no wavelength to draw a lens at")?.imager.train();
    let of_lens: Vec<usize> = (0..train.len()).filter(|met| train.mask_met(*met).is_none()).collect();
    let radii_mm = radii_mm(&surfaces, &of_lens, &paths, drawn.half_sensor_mm);
    let section = |(met, radius_mm): (&usize, &f64)| flat(&train.section(*met, *radius_mm, POINTS));
    let sections: Vec<Line> = of_lens.iter().zip(&radii_mm).map(section).collect();
    let mut sheet = Sheet::around(sections.iter().chain(paths.iter().map(|path| &path.line)));
    sheet.glass(&surfaces, &sections);
    for path in &paths {
        sheet.line(&path.line, Stroke { width: 0.45, ..Stroke::of(path.ink.css()) });
    }
    for (k, section) in sections.iter().enumerate() {
        let stroke = match surfaces.get(k) {
            Some(surface) if surface.stop && surface.medium == "air" => {
                Stroke { dash: Some(3.0), ..Stroke::of("#999") }
            }
            None if drawn.half_sensor_mm.is_some() => Stroke { width: 3.0, ..Stroke::of("#333") },
            _ => Stroke::of("#333"),
        };
        sheet.line(section, stroke);
    }
    sheet.masks(drawn, train, &paths, &inks);
    sheet.legend(drawn, &inks);
    Ok(sheet.drawing)
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

/// How a line is drawn, in strokes.
#[derive(Clone, Copy)]
struct Stroke<'a> {
    ink: &'a str,
    width: f64,
    dash: Option<f64>,
}

impl<'a> Stroke<'a> {
    fn of(ink: &'a str) -> Self {
        Self { ink, width: 1.0, dash: None }
    }
}

/// A drawing in the making.
struct Sheet {
    /// Lower and upper end of z and y, mm.
    low_mm: [f64; 2],
    high_mm: [f64; 2],
    stroke_mm: f64,
    per_mm: f64,
    drawing: Drawing,
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
        let low_mm = [low[0] - margin_mm, low[1] - margin_mm - lacking_mm - 0.05 * size_mm];
        let high_mm = [high[0] + margin_mm, high[1] + margin_mm + lacking_mm + 0.04 * size_mm];
        let per_mm = WIDTH / (high_mm[0] - low_mm[0]);
        let drawing = Drawing::new([WIDTH, (per_mm * (high_mm[1] - low_mm[1])).round()]);
        Self { low_mm, high_mm, stroke_mm: 0.002 * size_mm, per_mm, drawing }
    }

    fn letter_mm(&self) -> f64 {
        9.0 * self.stroke_mm
    }

    /// A place on the drawing.
    fn at(&self, [z_mm, y_mm]: [f64; 2]) -> [f64; 2] {
        [self.per_mm * (z_mm - self.low_mm[0]), self.per_mm * (self.high_mm[1] - y_mm)]
    }

    fn line(&mut self, points_mm: &[[f64; 2]], stroke: Stroke<'_>) {
        let points: Vec<[f64; 2]> = points_mm.iter().map(|at| self.at(*at)).collect();
        let unit = self.per_mm * self.stroke_mm;
        let dash = stroke.dash.map(|strokes| strokes * unit);
        self.drawing.line(&points, Pen { ink: stroke.ink, width: stroke.width * unit, dash });
    }

    fn text(&mut self, at_mm: [f64; 2], anchor: Anchor, text: &str) {
        let size = (self.per_mm * self.letter_mm()).round() as u32;
        self.drawing.text(self.at(at_mm), anchor, size, text);
    }

    fn glass(&mut self, surfaces: &[&SurfaceSpec], sections: &[Line]) {
        let is_glass = |surface: &SurfaceSpec| surface.medium != "air" && !surface.mirror;
        for (_, pair) in surfaces.iter().zip(sections.windows(2)).filter(|(surface, _)| is_glass(surface)) {
            let outline: Vec<[f64; 2]> = pair[0].iter().chain(pair[1].iter().rev()).map(|at| self.at(*at)).collect();
            self.drawing.area(&outline, "#dbe9f6");
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
                    for side in [-1.0, 1.0] {
                        let ends = [inner_mm, outer_mm].map(|mm| [z_mm, centre_mm + side * mm]);
                        self.line(&ends, Stroke { width: 2.5, ..Stroke::of(ink) });
                    }
                }
                inner_mm = outer_mm;
            }
            let label_mm = self.high_mm[1] - 1.5 * self.letter_mm();
            let leader = [centre_mm + end_mm, label_mm - 0.4 * self.letter_mm()].map(|y_mm| [z_mm, y_mm]);
            self.line(&leader, Stroke { width: 0.4, ..Stroke::of("#999") });
            self.text([z_mm, label_mm], Anchor::Middle, &format!("mask {index}"));
        }
    }

    /// What the colours are, and how long a centimetre or so is.
    fn legend(&mut self, drawn: &Drawn<'_>, inks: &[plot::Colour]) {
        let base_mm = self.low_mm[1] + 0.7 * self.letter_mm();
        let mut z_mm = self.low_mm[0] + self.letter_mm();
        for colour in &drawn.colours {
            let name = &drawn.asked.colours[*colour].name;
            let ends = [0.0, 2.0].map(|letters| [z_mm + letters * self.letter_mm(), base_mm + 0.3 * self.letter_mm()]);
            self.line(&ends, Stroke { width: 2.0, ..Stroke::of(inks[*colour].css()) });
            self.text([z_mm + 2.5 * self.letter_mm(), base_mm], Anchor::Start, name);
            z_mm += (4.0 + 0.6 * name.chars().count() as f64) * self.letter_mm();
        }
        let bar_mm = crate::round::round_below(0.2 * (self.high_mm[0] - self.low_mm[0]));
        let right_mm = self.high_mm[0] - self.letter_mm();
        let ends = [right_mm - bar_mm, right_mm].map(|z_mm| [z_mm, base_mm + 1.2 * self.letter_mm()]);
        self.line(&ends, Stroke::of("#333"));
        self.text([right_mm - 0.5 * bar_mm, base_mm], Anchor::Middle, &format!("{bar_mm} mm"));
    }
}
