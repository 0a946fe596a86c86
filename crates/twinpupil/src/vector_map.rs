//! Arrows over a rectangle as SVG, drawn far longer than they are, with one whose length is told.

use crate::plot::Colour;
use crate::report::escaped;
use crate::round::round_below;

/// Width of the drawing in its own units, and the room about the rectangle and for the key below it; the page scales it.
const WIDTH: f64 = 540.0;
const EDGE: f64 = 18.0;
const KEY: f64 = 34.0;

/// Length that long arrows are drawn with.
const LONG: f64 = 34.0;

/// Share of the arrows that are shorter than the long ones.
const LONG_SHARE: f64 = 0.95;

/// Longest arrow drawn: what is longer is cut, so that one wrong spot does not cover the others.
const LONGEST: f64 = 2.5 * LONG;

/// Where something is and how far it lies from where it should.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrow {
    /// Its tail.
    pub at: [f64; 2],
    /// Its tip from there.
    pub offset: [f64; 2],
}

/// A map in the making; y grows downwards.
#[derive(Debug, Clone, PartialEq)]
pub struct VectorMap {
    low: [f64; 2],
    high: [f64; 2],
    arrows: Vec<Arrow>,
    colour: Colour,
}

impl VectorMap {
    /// Arrows over a rectangle; those that are not finite are left out.
    pub fn new([low, high]: [[f64; 2]; 2], arrows: &[Arrow], colour: Colour) -> Self {
        let is_finite = |arrow: &&Arrow| arrow.at.iter().chain(&arrow.offset).all(|value| value.is_finite());
        Self { low, high, arrows: arrows.iter().filter(is_finite).copied().collect(), colour }
    }

    /// The drawing. The key tells lengths in `unit`, with `per_unit` of them to one of the unit in which arrows are.
    pub fn into_svg(self, per_unit: f64, unit: &str) -> String {
        let [width, height] = [0, 1].map(|axis| (self.high[axis] - self.low[axis]).max(f64::MIN_POSITIVE));
        let scale = (WIDTH - 2.0 * EDGE) / width;
        let (box_width, box_height) = (scale * width, (scale * height).min(4.0 * WIDTH));
        let total = box_height + 2.0 * EDGE + KEY;
        let colour = self.colour.css();
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {total:.1}\" width=\"{WIDTH}\" \
             height=\"{total:.1}\" role=\"img\" font-family=\"system-ui, sans-serif\" font-size=\"13\">\n\
             <rect x=\"{EDGE}\" y=\"{EDGE}\" width=\"{box_width:.1}\" height=\"{box_height:.1}\" fill=\"none\" \
             stroke=\"#88888880\"/>\n<g stroke=\"{colour}\" fill=\"{colour}\" stroke-width=\"1.3\">\n"
        );
        let typical = self.typical_length();
        let stretch = LONG / typical;
        for Arrow { at, offset } in &self.arrows {
            let tail = [0, 1].map(|axis| EDGE + scale * (at[axis] - self.low[axis]));
            svg += &drawn(tail, cut(offset.map(|part| stretch * part)));
        }
        let key = round_below(typical * per_unit);
        let (length, middle) = (key / per_unit * stretch, total - 0.5 * KEY);
        svg += &drawn([EDGE, middle], [length, 0.0]);
        let text = escaped(&format!("{key} {unit}"));
        svg += &format!(
            "</g>\n<text x=\"{:.1}\" y=\"{:.1}\" fill=\"currentColor\">{text}</text>\n</svg>",
            EDGE + length + 10.0,
            middle + 4.5
        );
        svg
    }

    /// Length that most arrows do not exceed; above zero.
    fn typical_length(&self) -> f64 {
        let mut lengths: Vec<f64> = self.arrows.iter().map(|arrow| arrow.offset[0].hypot(arrow.offset[1])).collect();
        lengths.sort_by(f64::total_cmp);
        let place = (LONG_SHARE * lengths.len() as f64) as usize;
        lengths.get(place.min(lengths.len().saturating_sub(1))).copied().filter(|length| *length > 0.0).unwrap_or(1.0)
    }
}

/// No longer than arrows may be.
fn cut(offset: [f64; 2]) -> [f64; 2] {
    let length = offset[0].hypot(offset[1]);
    if length > LONGEST { offset.map(|part| part * LONGEST / length) } else { offset }
}

/// A dot, a shaft and a head.
fn drawn([x, y]: [f64; 2], offset: [f64; 2]) -> String {
    const HEAD: f64 = 5.0;
    let length = offset[0].hypot(offset[1]);
    let dot = format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"1.4\" stroke=\"none\"/>");
    if length < 0.5 {
        return dot + "\n";
    }
    let along = offset.map(|part| part / length);
    let head = HEAD.min(0.6 * length);
    let tip = [x + offset[0], y + offset[1]];
    let neck = [tip[0] - head * along[0], tip[1] - head * along[1]];
    let [left, right] = [0.4 * head, -0.4 * head].map(|side| [neck[0] - side * along[1], neck[1] + side * along[0]]);
    format!(
        "{dot}<path d=\"M{x:.1} {y:.1}L{:.1} {:.1}\"/><path d=\"M{:.1} {:.1}L{:.1} {:.1}L{:.1} {:.1}z\" \
         stroke=\"none\"/>\n",
        neck[0], neck[1], tip[0], tip[1], left[0], left[1], right[0], right[1]
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_key_tells_how_long_an_arrow_is() {
        let arrows = [Arrow { at: [10.0, 5.0], offset: [0.003, 0.0] }; 20];
        let svg = VectorMap::new([[0.0, 0.0], [100.0, 50.0]], &arrows, Colour::Blue).into_svg(1e3, "10⁻³ px");
        assert!(svg.contains(">2 10⁻³ px<"), "{svg}");
        // Two thirds of an arrow that is drawn as long as long ones are.
        let end = format!("M{:.1} ", EDGE + 2.0 / 3.0 * LONG);
        assert!(svg.contains(&end), "{end} in {svg}");
        assert_eq!(svg.matches("<circle").count(), 21);
    }

    #[test]
    fn degenerate_maps_are_drawings_too() {
        let nan = Arrow { at: [f64::NAN, 0.0], offset: [0.0; 2] };
        let still = Arrow { at: [0.5, 0.5], offset: [0.0; 2] };
        let far = Arrow { at: [0.5, 0.5], offset: [1e9, 0.0] };
        for arrows in [&[][..], &[nan], &[still], &[still, still, far]] {
            let svg = VectorMap::new([[0.0; 2], [1.0; 2]], arrows, Colour::Green).into_svg(1.0, "px");
            assert!(svg.starts_with("<svg") && svg.ends_with("</svg>"), "{svg}");
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }
}
