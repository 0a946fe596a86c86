//! The pixels of a plane about its spots, read once.

use multiversion::multiversion;
use twinpupil_instrument::PlaneView;

use crate::likelihood::full::{Full, FullRow};
use crate::likelihood::light::Places;
use crate::noise::Noise;

/// Pixels about all spots of a frame, one window after the other.
#[derive(Debug, Clone, Default)]
pub(crate) struct Samples {
    /// Places about the centres of their windows.
    places: Places,
    codes: Vec<f32>,
}

/// Circles about a centre: the window, and within it the pixels that the spot fills.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rings {
    pub(crate) centre_px: [f64; 2],
    pub(crate) window_px: f64,
    pub(crate) full_px: f64,
}

/// How many of the rows of a window are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Share {
    Quarter,
    All,
}

/// The pixels about one spot: samples that its edge or its surroundings share, and sums over those that it fills.
#[derive(Debug, Clone)]
pub(crate) struct Window {
    rings: Rings,
    first: usize,
    /// Samples of the rows of every [`Share`].
    counts: [usize; 2],
    pub(crate) full: Full,
}

/// Every which row is of the quarter.
const QUARTER: usize = 4;

/// A window with fewer samples than this is looked at as a whole.
const SAMPLES_FEW: usize = 256;

/// A spot may move by so much before its window is read again, px.
const SLACK_PX: f64 = 1.0;

impl Window {
    /// Whether it still serves a spot with these rings, whose light reaches `reach_px`.
    pub(crate) fn serves(&self, rings: &Rings, reach_px: f64) -> bool {
        let [du, dv] = [0, 1].map(|axis| rings.centre_px[axis] - self.rings.centre_px[axis]);
        let moved_px = (du * du + dv * dv).sqrt();
        let spare_px = if self.full.count() > 0.0 { rings.full_px - self.rings.full_px } else { f64::INFINITY };
        moved_px <= spare_px && moved_px + reach_px <= self.rings.window_px
    }

    /// The smallest share of it that tells something: small windows are not shared.
    pub(crate) fn share(&self, share: Share) -> Share {
        if self.counts[share as usize] == self.counts[Share::All as usize] { Share::All } else { share }
    }

    /// Where a centre lies in its coordinates, px.
    pub(crate) fn offset_px(&self, centre_px: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| centre_px[axis] - self.rings.centre_px[axis])
    }
}

impl Samples {
    pub(crate) fn clear(&mut self) {
        self.places.clear();
        self.codes.clear();
    }

    /// Reads the pixels of a plane within the rings; the spot fills its inside with about `level` codes.
    pub(crate) fn read(&mut self, plane: &PlaneView<'_>, noise: &Noise, rings: &Rings, level: f32) -> Window {
        let rings = Rings { full_px: (rings.full_px - SLACK_PX).max(0.0), ..*rings };
        let first = self.codes.len();
        let mut full = Full::about(level);
        let rows = rows(plane, rings.centre_px[1], rings.window_px);
        let area = rows.len() * (2.0 * rings.window_px / plane.step_px as f64) as usize;
        let every = if area < SAMPLES_FEW { 1 } else { QUARTER };
        rows.clone().step_by(every).for_each(|row| self.read_row(plane, row, &rings, &mut full));
        let quarter = self.codes.len() - first;
        let others = rows.clone().enumerate().filter(|(place, _)| place % every != 0);
        others.for_each(|(_, row)| self.read_row(plane, row, &rings, &mut full));
        let counts = [quarter, self.codes.len() - first];
        if !full.is_even(noise, plane.code_max) {
            full = full.without_foreign(noise, plane.code_max, rows.filter_map(|row| full_row(plane, row, &rings)));
        }
        Window { rings, first, counts, full }
    }

    fn read_row(&mut self, plane: &PlaneView<'_>, row: usize, rings: &Rings, full: &mut Full) {
        let [u_px, v_px] = rings.centre_px;
        let dv_px = plane.frame_v_px(row as f64) - v_px;
        let Some(window) = span(plane, u_px, dv_px, rings.window_px) else { return };
        let inner = span(plane, u_px, dv_px, rings.full_px).unwrap_or(Span { first: window.end, end: window.end });
        for Span { first, end } in [Span { end: inner.first, ..window }, Span { first: inner.end, ..window }] {
            if end > first {
                let start = self.codes.len();
                let Places { du, dv } = &mut self.places;
                for values in [&mut *du, dv, &mut self.codes] {
                    values.resize(start + end - first, dv_px as f32);
                }
                read_span(plane, row, first, u_px, &mut self.codes[start..], &mut du[start..]);
            }
        }
        if inner.end > inner.first {
            full.add(&full_span(plane, row, inner, rings));
        }
    }

    /// The samples of a window: their codes, and their places about a centre into `places`.
    pub(crate) fn about(&self, window: &Window, share: Share, centre_px: [f64; 2], places: &mut Places) -> &[f32] {
        let range = window.first..window.first + window.counts[share as usize];
        let [offset_u, offset_v] = window.offset_px(centre_px).map(|offset| offset as f32);
        places.clear();
        places.du.extend(self.places.du[range.clone()].iter().map(|du| du - offset_u));
        places.dv.extend(self.places.dv[range.clone()].iter().map(|dv| dv - offset_v));
        &self.codes[range]
    }
}

/// The pixels of a row that the spot fills.
fn full_row<'a>(plane: &PlaneView<'a>, row: usize, rings: &Rings) -> Option<FullRow<'a>> {
    let [u_px, v_px] = rings.centre_px;
    let inner = span(plane, u_px, plane.frame_v_px(row as f64) - v_px, rings.full_px)?;
    Some(full_span(plane, row, inner, rings))
}

fn full_span<'a>(plane: &PlaneView<'a>, row: usize, Span { first, end }: Span, rings: &Rings) -> FullRow<'a> {
    let [u_px, v_px] = rings.centre_px;
    FullRow {
        codes: &plane.line(row)[first * plane.step_px..],
        step: plane.step_px,
        count: end - first,
        first_px: plane.frame_u_px(first as f64) - u_px,
        dv_px: plane.frame_v_px(row as f64) - v_px,
    }
}

/// Reads codes of a row from a column on, and their places along it about `u_px`.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn read_span(plane: &PlaneView<'_>, row: usize, first: usize, u_px: f64, codes: &mut [f32], du: &mut [f32]) {
    let (first_px, step_px) = ((plane.frame_u_px(first as f64) - u_px) as f32, plane.step_px as f32);
    for (k, du) in du.iter_mut().enumerate() {
        *du = first_px + step_px * (k as u32) as f32;
    }
    plane.read_span(row, first, codes);
}

/// Columns `first..end` of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Span {
    first: usize,
    end: usize,
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
