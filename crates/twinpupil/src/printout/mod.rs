//! Targets to print, true to scale: the dots on a blank ground, and under them what they are and a bar to lay a ruler on.

mod pdf;
mod svg;

use std::path::Path;

use anyhow::{Result, bail};
use twinpupil_calibrate::{Target, TargetSpec};

use crate::round::round_below;

/// Whether dots are dark or light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    /// Black dots on white.
    DarkOnLight,
    /// White dots on black.
    LightOnDark,
}

impl Ink {
    /// Lightness of what is drawn and of the ground, 0 to 1.
    fn greys(self) -> [u8; 2] {
        match self {
            Self::DarkOnLight => [0, 1],
            Self::LightOnDark => [1, 0],
        }
    }
}

/// A file that a target can be printed from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Scalable vector graphics, whose unit is the millimetre.
    Svg,
    /// A PDF of one page.
    Pdf,
}

impl Format {
    /// The format that a file's extension tells.
    pub fn of(path: &Path) -> Result<Self> {
        match path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("svg") => Ok(Self::Svg),
            Some("pdf") => Ok(Self::Pdf),
            _ => bail!("{}: the extension tells no format; legal: .svg, .pdf", path.display()),
        }
    }
}

/// A sheet with a target on it. Positions are in mm from its upper left corner, to the right and down.
#[derive(Debug, Clone, PartialEq)]
pub struct Printout {
    name: String,
    size_mm: [f64; 2],
    ink: Ink,
    discs: Vec<Disc>,
    texts: Vec<Text>,
    bars: Vec<Bar>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Disc {
    centre_mm: [f64; 2],
    radius_mm: f64,
}

/// A line of text that begins on its baseline.
#[derive(Debug, Clone, PartialEq)]
struct Text {
    start_mm: [f64; 2],
    size_mm: f64,
    content: String,
}

/// A filled rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Bar {
    corner_mm: [f64; 2],
    size_mm: [f64; 2],
}

/// Least blank width about the dots if none is asked for, mm and steps of the grid.
const MARGIN_MM: f64 = 10.0;
const MARGIN_STEPS: f64 = 2.0;

/// Height of the text where there is room for it, and the width of its letters over it, typically and at most so.
const TEXT_MM: f64 = 3.0;
const LETTER: f64 = 0.55;

/// Most distance of text and bar from the edges of the sheet, mm.
const INSET_MM: f64 = 5.0;

impl Printout {
    /// A sheet with a target, with a blank margin about its dots.
    pub fn new(target: &Target, ink: Ink, margin_mm: Option<f64>) -> Self {
        let spec = target.spec();
        let margin_mm = margin_mm.unwrap_or_else(|| MARGIN_MM.max(MARGIN_STEPS * spec.pitch_mm));
        let largest_mm = target.dots().iter().map(|dot| dot.diameter_mm).fold(spec.dot_diameter_mm, f64::max);
        let grid_mm = [spec.columns, spec.rows].map(|count| (count - 1) as f64 * spec.pitch_mm + largest_mm);
        let [width_mm, below_mm] = grid_mm.map(|length_mm| length_mm + 2.0 * margin_mm);
        let middle_mm = [0.5 * width_mm, 0.5 * below_mm];
        let disc = |dot: &twinpupil_calibrate::TargetDot| Disc {
            centre_mm: [0, 1].map(|axis| middle_mm[axis] + dot.position_mm[axis]),
            radius_mm: 0.5 * dot.diameter_mm,
        };
        let footer = Footer::new(spec, width_mm, margin_mm);
        Self {
            name: printable(&spec.name),
            size_mm: [width_mm, below_mm + footer.height_mm()],
            ink,
            discs: target.dots().iter().map(disc).collect(),
            texts: footer.texts(below_mm),
            bars: footer.bars(below_mm),
        }
    }

    /// Width and height of the sheet, mm.
    pub fn size_mm(&self) -> [f64; 2] {
        self.size_mm
    }

    /// Number of dots.
    pub fn dots(&self) -> usize {
        self.discs.len()
    }

    /// The file to print.
    pub fn encode(&self, format: Format) -> Result<Vec<u8>> {
        match format {
            Format::Svg => Ok(svg::encode(self).into_bytes()),
            Format::Pdf => pdf::encode(self),
        }
    }
}

/// What stands under the dots.
struct Footer {
    lines: [String; 3],
    bar_mm: f64,
    inset_mm: f64,
    text_mm: f64,
}

impl Footer {
    fn new(spec: &TargetSpec, width_mm: f64, margin_mm: f64) -> Self {
        let TargetSpec { rows, columns, pitch_mm, dot_diameter_mm, .. } = spec;
        let inset_mm = margin_mm.min(INSET_MM);
        let room_mm = width_mm - 2.0 * inset_mm;
        let lines = [
            printable(&spec.name),
            format!("{columns} columns × {rows} rows"),
            format!("pitch {pitch_mm} mm, dots {dot_diameter_mm} mm"),
        ];
        let bar_mm = round_below(room_mm);
        let letters = lines.iter().chain([&label(bar_mm)]).map(|line| line.chars().count()).max().unwrap_or(1);
        Self { lines, bar_mm, inset_mm, text_mm: TEXT_MM.min(room_mm / (LETTER * letters as f64)) }
    }

    fn height_mm(&self) -> f64 {
        7.6 * self.text_mm + self.inset_mm
    }

    fn texts(&self, top_mm: f64) -> Vec<Text> {
        let [name, grid, pitch] = self.lines.clone();
        let lines = [(1.0, name), (2.4, grid), (3.8, pitch), (7.4, label(self.bar_mm))];
        let text = |(down, content)| Text {
            start_mm: [self.inset_mm, top_mm + down * self.text_mm],
            size_mm: self.text_mm,
            content,
        };
        lines.map(text).into()
    }

    /// A line with eleven ticks whose middles are a tenth of its length apart, the outer ones longer.
    fn bars(&self, top_mm: f64) -> Vec<Bar> {
        let thick_mm = (0.01 * self.bar_mm).min(0.06 * self.text_mm);
        let below_mm = top_mm + 6.0 * self.text_mm;
        let line = Bar {
            corner_mm: [self.inset_mm - 0.5 * thick_mm, below_mm - thick_mm],
            size_mm: [self.bar_mm + thick_mm, thick_mm],
        };
        let tick = |k: u8| {
            let height_mm = self.text_mm * if k.is_multiple_of(10) { 1.2 } else { 0.6 };
            let x_mm = self.inset_mm + f64::from(k) / 10.0 * self.bar_mm;
            Bar { corner_mm: [x_mm - 0.5 * thick_mm, below_mm - height_mm], size_mm: [thick_mm, height_mm] }
        };
        [line].into_iter().chain((0..=10).map(tick)).collect()
    }
}

fn label(bar_mm: f64) -> String {
    format!("{bar_mm} mm if printed to scale")
}

/// Text of one line.
fn printable(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use twinpupil_calibrate::{Fiducial, TargetKind};

    use super::*;

    pub(super) fn target(name: &str) -> Target {
        let fiducials = vec![
            Fiducial { row: 0, column: 0, diameter_mm: None },
            Fiducial { row: 2, column: 3, diameter_mm: Some(1.5) },
        ];
        let spec = TargetSpec {
            schema: 1,
            name: name.to_owned(),
            kind: TargetKind::DotGrid,
            rows: 3,
            columns: 4,
            pitch_mm: 2.0,
            dot_diameter_mm: 1.0,
            fiducials,
        };
        Target::new(spec).unwrap()
    }

    #[test]
    fn dots_lie_about_the_middle_with_the_margin_about_them() {
        let printout = Printout::new(&target("t"), Ink::DarkOnLight, Some(3.0));
        assert_eq!(printout.dots(), 11);
        assert_eq!(printout.size_mm()[0], 3.0 * 2.0 + 1.5 + 2.0 * 3.0);
        // The dot beside the missing one, and the large one in the opposite corner.
        assert_eq!(printout.discs[0], Disc { centre_mm: [5.75, 3.75], radius_mm: 0.5 });
        assert_eq!(printout.discs[10], Disc { centre_mm: [9.75, 7.75], radius_mm: 0.75 });
        let lowest_mm = 7.75 + 0.75 + 3.0;
        assert!(printout.bars.iter().all(|bar| bar.corner_mm[1] > lowest_mm), "{:?}", printout.bars);
        assert!(printout.bars.iter().all(|bar| bar.corner_mm[1] + bar.size_mm[1] < printout.size_mm()[1]));
    }

    #[test]
    fn the_outer_ticks_are_as_far_apart_as_the_label_says() {
        let printout = Printout::new(&target("t"), Ink::DarkOnLight, None);
        let middle_mm = |bar: &Bar| bar.corner_mm[0] + 0.5 * bar.size_mm[0];
        let [first, last] = [&printout.bars[1], &printout.bars[11]];
        assert!((middle_mm(last) - middle_mm(first) - 10.0).abs() < 1e-12);
        assert_eq!(printout.texts[3].content, "10 mm if printed to scale");
    }

    #[test]
    fn text_fits_whatever_the_name() {
        for name in ["", "a\nb", &"long ".repeat(99)] {
            let printout = Printout::new(&target(name), Ink::LightOnDark, Some(0.0));
            for Text { start_mm, size_mm, content } in &printout.texts {
                let end_mm = start_mm[0] + LETTER * size_mm * content.chars().count() as f64;
                assert!(*size_mm > 0.0 && end_mm <= printout.size_mm()[0] + 1e-9, "{content}");
                assert!(!content.contains('\n'));
            }
        }
    }

    #[test]
    fn the_extension_tells_the_format() {
        assert_eq!(Format::of(Path::new("a.SVG")).unwrap(), Format::Svg);
        assert_eq!(Format::of(Path::new("b.pdf")).unwrap(), Format::Pdf);
        assert!(Format::of(Path::new("c.png")).unwrap_err().to_string().contains("legal: .svg, .pdf"));
    }
}
