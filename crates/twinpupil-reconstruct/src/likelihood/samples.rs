//! The pixels of a plane about one spot.

use twinpupil_instrument::PlaneView;

use crate::likelihood::light::Places;

/// Pixels about a spot: those that its edge or its surroundings share, and those that it fills.
#[derive(Debug, Clone, Default)]
pub(crate) struct Samples {
    /// Places of the first kind, and what they read, codes.
    pub(crate) places: Places,
    pub(crate) codes: Vec<f32>,
    /// Places of the second kind, and what they read, codes.
    pub(crate) full_places: Places,
    pub(crate) full_codes: Vec<f32>,
}

/// Circles about a centre: the window, and within it the pixels that the spot fills.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rings {
    pub(crate) centre_px: [f64; 2],
    pub(crate) window_px: f64,
    pub(crate) full_px: f64,
}

/// Columns `first..end` of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Span {
    first: usize,
    end: usize,
}

impl Samples {
    /// Reads the pixels of a plane within the rings.
    pub(crate) fn gather(&mut self, plane: &PlaneView<'_>, rings: &Rings) {
        self.places.clear();
        self.codes.clear();
        self.full_places.clear();
        self.full_codes.clear();
        let [u_px, v_px] = rings.centre_px;
        for row in rows(plane, v_px, rings.window_px) {
            let dv_px = plane.frame_v_px(row as f64) - v_px;
            let Some(window) = span(plane, u_px, dv_px, rings.window_px) else { continue };
            let full = span(plane, u_px, dv_px, rings.full_px).unwrap_or(Span { first: window.end, end: window.end });
            let row = Row { plane, row, u_px, dv_px };
            row.read(Span { first: window.first, end: full.first }, &mut self.places, &mut self.codes);
            row.read(full, &mut self.full_places, &mut self.full_codes);
            row.read(Span { first: full.end, end: window.end }, &mut self.places, &mut self.codes);
        }
    }
}

/// A row of a plane as seen from a centre.
struct Row<'a> {
    plane: &'a PlaneView<'a>,
    row: usize,
    u_px: f64,
    dv_px: f64,
}

impl Row<'_> {
    /// Adds the pixels of a span.
    fn read(&self, span: Span, places: &mut Places, codes: &mut Vec<f32>) {
        let count = span.end.saturating_sub(span.first);
        if count == 0 {
            return;
        }
        let start = codes.len();
        codes.resize(start + count, 0.0);
        self.plane.read_span(self.row, span.first, &mut codes[start..]);
        let first_px = (self.plane.frame_u_px(span.first as f64) - self.u_px) as f32;
        let step_px = self.plane.step_px as f32;
        places.du.extend((0..count).map(|k| first_px + step_px * k as f32));
        places.dv.resize(start + count, self.dv_px as f32);
    }
}

/// Rows of a plane within a distance of a centre.
fn rows(plane: &PlaneView<'_>, v_px: f64, radius_px: f64) -> std::ops::Range<usize> {
    let (origin, step) = (plane.origin_px[1] as f64, plane.step_px as f64);
    let rows = plane.rows as f64;
    let first = ((v_px - radius_px - origin) / step).ceil().clamp(0.0, rows) as usize;
    let end = (((v_px + radius_px - origin) / step).floor() + 1.0).clamp(0.0, rows) as usize;
    first..end.max(first)
}

/// Columns within a circle of the row that passes `dv_px` below its centre.
fn span(plane: &PlaneView<'_>, u_px: f64, dv_px: f64, radius_px: f64) -> Option<Span> {
    let square = radius_px * radius_px - dv_px * dv_px;
    if square <= 0.0 {
        return None;
    }
    let half_px = square.sqrt();
    let (origin, per_px) = (plane.origin_px[0] as f64, 1.0 / plane.step_px as f64);
    let columns = plane.columns as f64;
    let first = ((u_px - half_px - origin) * per_px).ceil().clamp(0.0, columns) as usize;
    let end = (((u_px + half_px - origin) * per_px).floor() + 1.0).clamp(0.0, columns) as usize;
    (end > first).then_some(Span { first, end })
}
