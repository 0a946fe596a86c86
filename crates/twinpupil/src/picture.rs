//! Frames and planes as pictures to look at, with what was found drawn over them. For display only: nothing is measured
//! on them.

use std::fmt::Write;

use anyhow::Result;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use twinpupil_instrument::{Band, Frame, FrameError, Instrument, Mosaic, PixelPoint, PlaneView};

use crate::io::encode_rgb8;
use crate::plot::Colour;

/// Share of the darkest pixels that are shown black.
const BLACK_SHARE: f64 = 0.01;
/// Share of the brightest pixels that are shown at full brightness.
const WHITE_SHARE: f64 = 0.001;
/// Codes are proportional to light, displays are not.
const DISPLAY_GAMMA: f64 = 2.2;

/// 8 bit RGB pixels, each of which covers `step_px` × `step_px` pixels of the frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Pixels of the frame to a pixel of the picture, both ways.
    pub step_px: usize,
    rgb: Vec<u8>,
}

impl Picture {
    /// A frame in colour.
    ///
    /// A mosaic is shown at half size: each cell's red, green and blue pixel make one of the picture. The pages of a
    /// frame with a page for each band are laid over each other in the tints of their bands.
    pub fn of_frame(frame: &Frame, instrument: &Instrument) -> Result<Self, FrameError> {
        let mosaic = instrument.sensor.mosaic;
        if !mosaic.has_page_for_each_band() && !matches!(mosaic, Mosaic::Polarizer(_)) {
            let tints = [("r", [1.0, 0.0, 0.0]), ("g", [0.0, 1.0, 0.0]), ("b", [0.0, 0.0, 1.0])];
            let plane = |(name, tint)| Ok((frame.plane(mosaic, name)?, tint));
            return Ok(Self::of_planes(&tints.map(plane).into_iter().collect::<Result<Vec<_>, FrameError>>()?));
        }
        let tinted = |band: &Band| Ok((instrument.plane(frame, band)?, tint(band.wavelength_nm)));
        Ok(Self::of_planes(&instrument.bands.iter().map(tinted).collect::<Result<Vec<_>, FrameError>>()?))
    }

    /// One band of a frame in its own tint, on its own sub-lattice.
    pub fn of_band(frame: &Frame, instrument: &Instrument, band: usize) -> Result<Self, FrameError> {
        let band = &instrument.bands[band];
        Ok(Self::of_planes(&[(instrument.plane(frame, band)?, tint(band.wavelength_nm))]))
    }

    fn of_planes(tinted: &[(PlaneView<'_>, [f64; 3])]) -> Self {
        let planes: Vec<PlaneView<'_>> = tinted.iter().map(|(plane, _)| *plane).collect();
        let smallest = |size: fn(&PlaneView<'_>) -> usize| planes.iter().map(size).min().unwrap_or(0);
        let (width, height) = (smallest(|plane| plane.columns), smallest(|plane| plane.rows));
        let stretch = Stretch::of(&planes);
        let mut rgb = Vec::with_capacity(3 * width * height);
        for row in 0..height {
            let rows: Vec<Vec<u16>> = planes.iter().map(|plane| plane.row(row).take(width).collect()).collect();
            for column in 0..width {
                let light = rows.iter().map(|row| stretch.light(row[column]));
                let mixed = light.zip(tinted).fold([0.0; 3], |sum, (light, (_, tint))| {
                    [0, 1, 2].map(|channel| sum[channel] + light * tint[channel])
                });
                rgb.extend(mixed.map(display_code));
            }
        }
        Self { width, height, step_px: planes.first().map_or(1, |plane| plane.step_px), rgb }
    }

    /// The picture with `factor` × `factor` pixels made one: smaller, and less noisy.
    pub fn shrunk(&self, factor: usize) -> Self {
        let factor = factor.clamp(1, self.width.min(self.height).max(1));
        let (width, height) = (self.width / factor, self.height / factor);
        let mut rgb = Vec::with_capacity(3 * width * height);
        for row in 0..height {
            for column in 0..width {
                rgb.extend([0, 1, 2].map(|channel| self.mean(column * factor, row * factor, factor, channel)));
            }
        }
        Self { width, height, step_px: self.step_px * factor, rgb }
    }

    fn mean(&self, column: usize, row: usize, size: usize, channel: usize) -> u8 {
        let pixels = (row..row + size).flat_map(|row| (column..column + size).map(move |column| (column, row)));
        let sum: usize =
            pixels.map(|(column, row)| usize::from(self.rgb[3 * (row * self.width + column) + channel])).sum();
        (sum / (size * size)) as u8
    }

    /// As a PNG file.
    pub fn to_png(&self) -> Result<Vec<u8>> {
        encode_rgb8([self.width, self.height], &self.rgb)
    }

    /// As an `<img>` that carries its own data.
    pub fn to_html(&self, description: &str) -> Result<String> {
        let (width, height) = (self.width, self.height);
        let description = crate::report::escaped(description);
        let uri = self.data_uri()?;
        Ok(format!("<img src=\"{uri}\" width=\"{width}\" height=\"{height}\" alt=\"{description}\">"))
    }

    fn data_uri(&self) -> Result<String> {
        Ok(format!("data:image/png;base64,{}", STANDARD.encode(self.to_png()?)))
    }
}

/// What is drawn over a picture, in pixels of the frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Overlay {
    shapes: String,
}

impl Overlay {
    /// Nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds an arrow, such as the flow of a point from the telecentric to the entocentric image. One that is not
    /// finite is left out.
    pub fn arrow(&mut self, from: PixelPoint, to: PixelPoint, colour: Colour) {
        if [from.u, from.v, to.u, to.v].into_iter().all(f64::is_finite) {
            let (x1, y1, x2, y2) = (from.u, from.v, to.u, to.v);
            let colour = colour.css();
            let line =
                format!("<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"{colour}\"/>");
            self.shapes += &line;
            self.head(from, to, colour);
        }
    }

    /// Adds a circle. One that is not finite is left out.
    pub fn circle(&mut self, centre: PixelPoint, radius_px: f64, colour: Colour) {
        if [centre.u, centre.v, radius_px].into_iter().all(f64::is_finite) {
            let (u, v, colour) = (centre.u, centre.v, colour.css());
            // Writing into a string does not fail.
            let _ =
                write!(self.shapes, "<circle cx=\"{u:.1}\" cy=\"{v:.1}\" r=\"{radius_px:.1}\" stroke=\"{colour}\"/>");
        }
    }

    /// Adds a short text, with its middle at `at`.
    pub fn label(&mut self, at: PixelPoint, text: &str, colour: Colour) {
        if at.u.is_finite() && at.v.is_finite() {
            let (u, v, colour, text) = (at.u, at.v, colour.css(), crate::report::escaped(text));
            let _ = write!(self.shapes, "<text x=\"{u:.1}\" y=\"{v:.1}\" fill=\"{colour}\">{text}</text>");
        }
    }

    /// The head of an arrow: as long as the arrow where that is short, so that no head points past its tail.
    fn head(&mut self, from: PixelPoint, to: PixelPoint, colour: &str) {
        let (du, dv) = (to.u - from.u, to.v - from.v);
        let length_px = du.hypot(dv);
        if length_px == 0.0 {
            return;
        }
        let size_px = length_px.min(ARROW_HEAD_PX);
        let (eu, ev) = (du / length_px * size_px, dv / length_px * size_px);
        let (base_u, base_v) = (to.u - eu, to.v - ev);
        let [(au, av), (bu, bv)] = [0.45, -0.45].map(|side| (base_u - side * ev, base_v + side * eu));
        let (u, v) = (to.u, to.v);
        let points = format!("{u:.1},{v:.1} {au:.1},{av:.1} {bu:.1},{bv:.1}");
        let _ = write!(self.shapes, "<polygon points=\"{points}\" fill=\"{colour}\" stroke=\"none\"/>");
    }

    /// The picture with the overlay on it, as SVG that carries its own data.
    pub fn over(&self, picture: &Picture) -> Result<String> {
        let uri = picture.data_uri()?;
        let [width, height] = [picture.width, picture.height].map(|size| size * picture.step_px);
        // The centre of the first pixel is (0, 0), so the frame begins half a pixel before.
        Ok(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"-0.5 -0.5 {width} {height}\" width=\"{width}\" \
             height=\"{height}\" role=\"img\"><image href=\"{uri}\" x=\"-0.5\" y=\"-0.5\" width=\"{width}\" \
             height=\"{height}\"/><g fill=\"none\" stroke-width=\"4\" font-size=\"28\" text-anchor=\"middle\" \
             font-family=\"system-ui, sans-serif\">{}</g></svg>",
            self.shapes
        ))
    }
}

/// Length of an arrow's head, px of the frame.
const ARROW_HEAD_PX: f64 = 24.0;

/// Codes to shares of full brightness, one scale for all planes so that their balance is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stretch {
    black: f64,
    white: f64,
}

impl Stretch {
    fn of(planes: &[PlaneView<'_>]) -> Self {
        let mut counts = vec![0_usize; 1 << 16];
        for plane in planes {
            for row in 0..plane.rows {
                plane.row(row).for_each(|code| counts[usize::from(code)] += 1);
            }
        }
        let total: usize = counts.iter().sum();
        let below = |share: f64| {
            let mut left = (share * total as f64) as usize;
            let position = counts.iter().position(|&count| {
                let reached = count > left;
                left = left.saturating_sub(count);
                reached
            });
            position.unwrap_or(0) as f64
        };
        let (black, white) = (below(BLACK_SHARE), below(1.0 - WHITE_SHARE));
        // Few bright pixels in a dark frame: the share alone would show nothing.
        let brightest = counts.iter().rposition(|&count| count > 0).unwrap_or(0) as f64;
        Self { black, white: if white > black { white } else { brightest.max(black + 1.0) } }
    }

    fn light(self, code: u16) -> f64 {
        ((f64::from(code) - self.black) / (self.white - self.black)).clamp(0.0, 1.0)
    }
}

fn display_code(light: f64) -> u8 {
    (255.0 * light.clamp(0.0, 1.0).powf(1.0 / DISPLAY_GAMMA)).round() as u8
}

/// A tint that tells bands apart: blue, green or red by wavelength, a little desaturated so that detail stays visible.
fn tint(wavelength_nm: f64) -> [f64; 3] {
    match wavelength_nm {
        nm if nm < 490.0 => [0.12, 0.35, 1.0],
        nm if nm < 580.0 => [0.12, 1.0, 0.25],
        _ => [1.0, 0.2, 0.08],
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;

    fn frame(code: impl Fn(usize, usize) -> u16) -> Frame {
        let codes = (0..6 * 4).map(|i| code(i % 6, i / 6)).collect();
        Frame::new(6, 4, 4095, vec![codes]).expect("a legal frame")
    }

    #[test]
    fn a_mosaic_is_shown_at_half_size_with_each_colour_from_its_pixels() {
        let lit_red = frame(|column, row| if column % 2 == 0 && row % 2 == 0 && column > 0 { 4000 } else { 10 });
        let picture = Picture::of_frame(&lit_red, &paper::instrument()).expect("a picture");
        assert_eq!((picture.width, picture.height, picture.step_px), (3, 2, 2));
        assert_eq!(picture.rgb[..6], [0, 0, 0, 255, 0, 0]);
    }

    #[test]
    fn even_frames_make_pictures() {
        for code in [0, 7, 4095] {
            let frame = frame(|_, _| code);
            let picture = Picture::of_band(&frame, &paper::instrument(), 1).expect("a picture");
            assert!(picture.to_png().expect("encodes").starts_with(b"\x89PNG"));
            let small = picture.shrunk(2);
            assert_eq!((small.width, small.height, small.step_px), (1, 1, 4));
            assert_eq!(picture.shrunk(99).height, 1);
        }
    }

    #[test]
    fn what_is_not_finite_is_not_drawn() {
        let (here, nowhere) = (PixelPoint { u: 1.0, v: 2.0 }, PixelPoint { u: f64::NAN, v: 0.0 });
        let mut overlay = Overlay::new();
        overlay.arrow(here, nowhere, Colour::Green);
        overlay.circle(here, f64::INFINITY, Colour::Green);
        assert_eq!(overlay, Overlay::new());
        overlay.arrow(here, here, Colour::Green);
        overlay.label(here, "<1>", Colour::Green);
        let svg = overlay.over(&Picture::of_band(&frame(|c, _| c as u16), &paper::instrument(), 0).unwrap()).unwrap();
        assert!(!svg.contains("NaN") && svg.contains("&lt;1&gt;"), "{svg}");
    }
}
