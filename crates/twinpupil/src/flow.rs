//! The paper's flow: every point's way from its telecentric to its entocentric image, drawn over a frame.

use anyhow::Result;
use twinpupil_instrument::{Frame, Instrument, PixelPoint};
use twinpupil_reconstruct::Point;

use crate::picture::{Overlay, Picture};
use crate::plot::Colour;
use crate::report::Figure;

/// Median flow below which arrows are drawn longer than they are, px.
const FLOW_PX_MIN: f64 = 40.0;

/// What short arrows are stretched by at most.
const STRETCH_MAX: f64 = 20.0;

/// A frame in colour with an arrow for every point.
///
/// Where the flow is short, near focus, arrows are stretched by a round factor, which the caption states.
pub fn figure(frame: &Frame, instrument: &Instrument, points: &[Point], what: &str) -> Result<Figure> {
    let picture = Picture::of_frame(frame, instrument)?.shrunk(2);
    let stretch = stretch(points);
    let mut overlay = Overlay::new();
    for point in points {
        let (from, to) = (point.telecentric.centre, point.entocentric.centre);
        let tip = PixelPoint { u: from.u + stretch * (to.u - from.u), v: from.v + stretch * (to.v - from.v) };
        overlay.arrow(from, tip, Colour::White);
    }
    let length = if stretch == 1.0 { "drawn to scale".to_owned() } else { format!("drawn {stretch} times as long") };
    let caption = format!("{what} Arrows go from the telecentric to the entocentric image, {length}.");
    Ok(Figure::new(overlay.over(&picture)?, caption))
}

fn stretch(points: &[Point]) -> f64 {
    let length_px = |point: &Point| {
        let (from, to) = (point.telecentric.centre, point.entocentric.centre);
        (to.u - from.u).hypot(to.v - from.v)
    };
    let mut lengths_px: Vec<f64> = points.iter().map(length_px).collect();
    lengths_px.sort_by(f64::total_cmp);
    match lengths_px.get(lengths_px.len() / 2) {
        Some(&median_px) if median_px > 0.0 && median_px < FLOW_PX_MIN => {
            (FLOW_PX_MIN / median_px).ceil().min(STRETCH_MAX)
        }
        _ => 1.0,
    }
}
