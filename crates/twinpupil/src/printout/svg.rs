//! A printout as SVG, one unit of which is a millimetre.

use std::fmt::Write;

use super::{Bar, Disc, Printout, Text};
use crate::report::escaped;

/// The file.
pub(super) fn encode(printout: &Printout) -> String {
    let [width, height] = printout.size_mm.map(nanometres);
    let [ink, ground] = printout.ink.greys().map(|grey| if grey == 0 { "black" } else { "white" });
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {width} \
         {height}\">\n<title>{}</title>\n<rect width=\"{width}\" height=\"{height}\" fill=\"{ground}\"/>\n\
         <g fill=\"{ink}\" font-family=\"Helvetica, Arial, sans-serif\">\n",
        escaped(&printout.name)
    );
    // Writing into a string does not fail.
    for Disc { centre_mm, radius_mm } in &printout.discs {
        let ([x, y], r) = (centre_mm.map(nanometres), nanometres(*radius_mm));
        let _ = writeln!(svg, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{r}\"/>");
    }
    for Text { start_mm, size_mm, content } in &printout.texts {
        let ([x, y], size, content) = (start_mm.map(nanometres), nanometres(*size_mm), escaped(content));
        let _ = writeln!(svg, "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\">{content}</text>");
    }
    for Bar { corner_mm, size_mm } in &printout.bars {
        let ([x, y], [width, height]) = (corner_mm.map(nanometres), size_mm.map(nanometres));
        let _ = writeln!(svg, "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\"/>");
    }
    svg + "</g>\n</svg>\n"
}

/// A length in mm to the nanometre, without the dust of binary fractions.
fn nanometres(length_mm: f64) -> f64 {
    (1e6 * length_mm).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::super::tests::target;
    use super::super::{Format, Ink};
    use super::*;

    #[test]
    fn a_unit_is_a_millimetre() {
        let printout = Printout::new(&target("a < b"), Ink::LightOnDark, Some(3.0));
        let svg = String::from_utf8(printout.encode(Format::Svg).unwrap()).unwrap();
        assert!(svg.contains("width=\"13.5mm\"") && svg.contains("viewBox=\"0 0 13.5 "), "{svg}");
        assert!(svg.contains("<circle cx=\"5.75\" cy=\"3.75\" r=\"0.5\"/>"), "{svg}");
        assert!(svg.contains("fill=\"black\"/>") && svg.contains("<g fill=\"white\"") && svg.contains("a &lt; b"));
        assert_eq!(svg.matches("<circle").count(), 11);
    }
}
