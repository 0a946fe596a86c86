//! A drawing that stands for itself in a file: as SVG, or as PNG with the letters of a font that comes with the program.

use anyhow::{Result, anyhow};
use kuva::backend::raster::RasterBackend;
use kuva::backend::svg::SvgBackend;
use kuva::render::render::{PathData, Primitive, Scene, TextAnchor, build_path};

/// What is written is written in.
pub const INK: &str = "#1c2126";

const FONTS: &str = "system-ui, sans-serif";

/// Pixels of a PNG along a unit of the drawing.
const PIXELS: f32 = 2.0;

/// Lines and letters on a white ground, x to the right and y down.
#[derive(Debug)]
pub struct Drawing(Scene);

/// How a line is drawn.
#[derive(Debug, Clone, Copy)]
pub struct Pen<'a> {
    /// Colour, as CSS.
    pub ink: &'a str,
    /// Width of the line.
    pub width: f64,
    /// Length of dashes and of what is between them; `None` for a line that goes through.
    pub dash: Option<f64>,
}

/// Where a text is that is placed at a point.
#[derive(Debug, Clone, Copy)]
pub enum Anchor {
    /// To the right of it.
    Start,
    /// About it.
    Middle,
}

impl Drawing {
    /// An empty drawing.
    pub fn new([width, height]: [f64; 2]) -> Self {
        let mut scene = Scene::new(width, height);
        (scene.text_color, scene.font_family) = (Some(INK.to_owned()), Some(FONTS.to_owned()));
        Self(scene)
    }

    /// A drawing of what the plotting library has laid out.
    pub(crate) fn of(scene: Scene) -> Self {
        Self(scene)
    }

    /// A line through points.
    pub fn line(&mut self, points: &[[f64; 2]], pen: Pen<'_>) {
        self.0.add(Primitive::PolyLine {
            points: points.iter().map(|[x, y]| (*x, *y)).collect(),
            stroke: pen.ink.into(),
            stroke_width: pen.width,
            stroke_dasharray: pen.dash.map(|length| format!("{length:.1} {length:.1}")),
        });
    }

    /// A polygon without a rim.
    pub fn area(&mut self, corners: &[[f64; 2]], ink: &str) {
        let corners: Vec<(f64, f64)> = corners.iter().map(|[x, y]| (*x, *y)).collect();
        self.0.add(Primitive::Path(Box::new(PathData {
            d: build_path(&corners) + "Z",
            fill: Some(ink.into()),
            stroke: "none".into(),
            stroke_width: 0.0,
            opacity: None,
            stroke_dasharray: None,
        })));
    }

    /// A line of text in letters of this size, its base line at a point.
    pub fn text(&mut self, [x, y]: [f64; 2], anchor: Anchor, size: u32, text: &str) {
        self.0.add(Primitive::Text {
            x,
            y,
            content: text.to_owned(),
            size,
            anchor: match anchor {
                Anchor::Start => TextAnchor::Start,
                Anchor::Middle => TextAnchor::Middle,
            },
            rotate: None,
            bold: false,
            color: Some(INK.into()),
        });
    }

    /// Puts another drawing on this one, its corner at a point.
    pub fn place(&mut self, other: Self, [x, y]: [f64; 2]) {
        self.0.defs.extend(other.0.defs);
        let transform = Some(format!("translate({x},{y})"));
        self.0.add(Primitive::GroupStart { transform, title: None, extra_attrs: None });
        other.0.elements.into_iter().for_each(|element| self.0.add(element));
        self.0.add(Primitive::GroupEnd);
    }

    /// As SVG, a line for every element.
    pub fn to_svg(&self) -> String {
        let svg = scalable(&SvgBackend::new().with_pretty(true).render_scene(&self.0));
        svg.trim_end().to_owned() + "\n"
    }

    /// As PNG.
    pub fn into_png(mut self) -> Result<Vec<u8>> {
        self.0.elements = self.0.elements.into_iter().flat_map(with_dashes_drawn).collect();
        RasterBackend::new().with_scale(PIXELS).render_scene(&self.0).map_err(|reason| anyhow!("no PNG: {reason}"))
    }
}

/// A broken line as its dashes, which the library would begin anew at every point of the line.
fn with_dashes_drawn(element: Primitive) -> Vec<Primitive> {
    match element {
        Primitive::PolyLine { points, stroke, stroke_width, stroke_dasharray: Some(pattern) } => {
            let lengths: Vec<f64> = pattern.split([' ', ',']).filter_map(|length| length.parse().ok()).collect();
            let line =
                |points| Primitive::PolyLine { points, stroke: stroke.clone(), stroke_width, stroke_dasharray: None };
            dashes(&points, &lengths).into_iter().map(line).collect()
        }
        other => vec![other],
    }
}

/// The pieces of a line that are drawn where it goes on and pauses for these lengths, round and round.
fn dashes(points: &[(f64, f64)], lengths: &[f64]) -> Vec<Vec<(f64, f64)>> {
    if lengths.is_empty() || lengths.iter().any(|length| *length <= 0.0 || !length.is_finite()) {
        return vec![points.to_vec()];
    }
    let mut pieces = Vec::new();
    let mut piece: Vec<(f64, f64)> = points.first().copied().into_iter().collect();
    let (mut turn, mut left) = (0, lengths[0]);
    for ends in points.windows(2) {
        let [mut at, end] = [ends[0], ends[1]];
        loop {
            let rest = (end.0 - at.0).hypot(end.1 - at.1);
            if rest < left {
                left -= rest;
                piece.push(end);
                break;
            }
            let part = left / rest;
            at = (at.0 + part * (end.0 - at.0), at.1 + part * (end.1 - at.1));
            piece.push(at);
            if turn % 2 == 0 {
                pieces.push(std::mem::take(&mut piece));
            }
            piece = vec![at];
            turn += 1;
            left = lengths[turn % lengths.len()];
        }
    }
    if turn % 2 == 0 && piece.len() > 1 {
        pieces.push(piece);
    }
    pieces
}

/// Gives an SVG a view box, so that a page may scale it.
pub(crate) fn scalable(svg: &str) -> String {
    let number = |key: &str| svg.split_once(key)?.1.split('"').next()?.parse::<f64>().ok();
    match (number(" width=\""), number(" height=\"")) {
        (Some(width), Some(height)) => {
            let sized = format!(" width=\"{width}\" height=\"{height}\"");
            let boxed = format!(" viewBox=\"0 0 {width} {height}\"{sized} role=\"img\"");
            svg.replacen(&sized, &boxed, 1)
        }
        _ => svg.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dashes_go_round_corners() {
        // Four along x, then four up: dashes of 3 and pauses of 2.
        let drawn = dashes(&[(0.0, 0.0), (4.0, 0.0), (4.0, 4.0)], &[3.0, 2.0]);
        assert_eq!(drawn, [vec![(0.0, 0.0), (3.0, 0.0)], vec![(4.0, 1.0), (4.0, 4.0)]]);
        // The pattern goes on over points that are closer together than a dash is long.
        let fine: Vec<(f64, f64)> = (0..=96).map(|k| (0.25 * f64::from(k), 0.0)).collect();
        let drawn = dashes(&fine, &[3.0, 2.0]);
        assert_eq!(drawn.iter().map(|dash| dash[0].0).collect::<Vec<_>>(), [0.0, 5.0, 10.0, 15.0, 20.0]);
        assert_eq!(dashes(&fine, &[0.0, 0.0]), std::slice::from_ref(&fine));
        assert!(dashes(&[], &[1.0]).is_empty() && dashes(&fine[..1], &[1.0]).is_empty());
    }

    #[test]
    fn a_png_shows_lines_areas_and_letters_of_placed_drawings() {
        let mut inner = Drawing::new([20.0, 20.0]);
        inner.area(&[[5.0, 5.0], [15.0, 5.0], [15.0, 15.0], [5.0, 15.0]], "#0000ff");
        let mut sheet = Drawing::new([60.0, 40.0]);
        sheet.place(inner, [30.0, 10.0]);
        sheet.line(&[[0.0, 30.0], [20.0, 30.0]], Pen { ink: "#ff0000", width: 4.0, dash: None });
        sheet.text([2.0, 14.0], Anchor::Start, 12, "µ°");
        let svg = sheet.to_svg();
        assert!(svg.starts_with("<svg") && svg.contains("viewBox=\"0 0 60 40\"") && svg.ends_with("</svg>\n"), "{svg}");
        assert!(svg.contains("translate(30,10)") && svg.contains("µ°"), "{svg}");
        let bytes = sheet.into_png().expect("a picture");
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().expect("a PNG");
        let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
        let info = reader.next_frame(&mut pixels).expect("pixels");
        assert_eq!((info.width, info.height), (120, 80));
        let at = |x: usize, y: usize| pixels[4 * (120 * y + x)..][..3].to_vec();
        assert_eq!([at(80, 40), at(20, 60), at(100, 70)], [vec![0, 0, 255], vec![255, 0, 0], vec![255, 255, 255]]);
        let dark = (0..30).flat_map(|y| (0..40).map(move |x| (x, y))).filter(|(x, y)| at(*x, *y)[0] < 128).count();
        assert!(dark > 20, "{dark} pixels of letters");
    }
}
