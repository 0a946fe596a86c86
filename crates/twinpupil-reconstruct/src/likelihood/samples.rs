//! The pixels of a plane about its spots, read once.

use std::hint::black_box;

use multiversion::multiversion;
use twinpupil_instrument::PlaneView;

use crate::likelihood::full::{Full, FullRow};
use crate::likelihood::light::Places;
use crate::likelihood::outline::{Outline, Side};
use crate::noise::Noise;

/// Pixels about all spots of a frame, one window after the other.
#[derive(Debug, Clone, Default)]
pub(crate) struct Samples {
    /// Those that feel an edge, those that see nothing but a dot, and those that see none of it.
    zones: [Zone; ZONES],
}

/// Pixels and their places about the centres of their windows.
#[derive(Debug, Clone, Default)]
struct Zone {
    du: Vec<f32>,
    dv: Vec<f32>,
    codes: Vec<f32>,
}

const ZONES: usize = 3;
const EDGE: usize = 0;
const INSIDE: usize = 1;
const GROUND: usize = 2;

/// What is to be read about a spot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rings {
    pub(crate) outline: Outline,
    /// Radius of the window.
    pub(crate) window_px: f64,
    /// Whether what the spot fills is equally bright but for noise and the illumination, so that sums tell all of it; and
    /// whether the ground about it is.
    pub(crate) sums_inside: bool,
    pub(crate) sums_ground: bool,
    /// Codes of both, about.
    pub(crate) levels: [f32; 2],
}

/// How many of the rows of a window are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Share {
    Quarter,
    All,
}

/// The pixels about one spot: samples, and sums over those that differ by noise alone.
#[derive(Debug, Clone)]
pub(crate) struct Window {
    rings: Rings,
    first: [usize; ZONES],
    /// Where the samples of the rows of every [`Share`] end.
    ends: [[usize; ZONES]; 2],
    /// Of the pixels that the spot fills, and of the ground.
    pub(crate) full: Full,
    pub(crate) ground: Full,
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
        let [du, dv] = self.offset_px(rings.outline.centre_px);
        let is_summable =
            (rings.sums_inside || self.full.count() == 0.0) && (rings.sums_ground || self.ground.count() == 0.0);
        is_summable && du.hypot(dv) + reach_px <= self.rings.window_px && self.rings.outline.holds(&rings.outline)
    }

    /// The smallest share of it that tells something: small windows are not shared.
    pub(crate) fn share(&self, share: Share) -> Share {
        if self.ends[share as usize] == self.ends[Share::All as usize] { Share::All } else { share }
    }

    /// Where a centre lies in its coordinates, px.
    pub(crate) fn offset_px(&self, centre_px: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| centre_px[axis] - self.rings.outline.centre_px[axis])
    }
}

impl Samples {
    pub(crate) fn clear(&mut self) {
        for Zone { du, dv, codes } in &mut self.zones {
            [du, dv, codes].into_iter().for_each(Vec::clear);
        }
    }

    /// Reads the pixels of a plane within the rings.
    pub(crate) fn read(&mut self, plane: &PlaneView<'_>, noise: &Noise, rings: &Rings) -> Window {
        let rings = Rings { outline: rings.outline.widened(SLACK_PX), ..*rings };
        fetch(plane, &rings);
        let mut window = self.read_zones(plane, &rings);
        if !window.ground.is_even(noise, plane.code_max) {
            // Something lies on the ground: pixel by pixel it can be left out.
            self.zones.iter_mut().zip(window.first).for_each(|(zone, first)| zone.truncate(first));
            window = self.read_zones(plane, &Rings { sums_ground: false, ..rings });
        }
        if !window.full.is_even(noise, plane.code_max) {
            let rows = rows(plane, rings.outline.centre_px[1], rings.window_px);
            let inside = rows.filter_map(|row| {
                let (_, _, inner) = spans(plane, row, &rings)?;
                (inner.end > inner.first).then(|| stretch(plane, row, inner, rings.outline.centre_px))
            });
            window.full = window.full.without_foreign(noise, plane.code_max, inside);
        }
        window
    }

    fn read_zones(&mut self, plane: &PlaneView<'_>, rings: &Rings) -> Window {
        let rows = rows(plane, rings.outline.centre_px[1], rings.window_px);
        let area = rows.len() * (2.0 * rings.window_px / plane.step_px as f64) as usize;
        let every = if area < SAMPLES_FEW { 1 } else { QUARTER };
        let first = self.lengths();
        let [full, ground] = rings.levels.map(Full::about);
        let mut window = Window { rings: *rings, first, ends: [first; 2], full, ground };
        rows.clone().step_by(every).for_each(|row| self.read_row(plane, row, &mut window));
        window.ends[Share::Quarter as usize] = self.lengths();
        let others = rows.enumerate().filter(|(place, _)| place % every != 0);
        others.for_each(|(_, row)| self.read_row(plane, row, &mut window));
        window.ends[Share::All as usize] = self.lengths();
        window
    }

    /// Samples in every zone.
    fn lengths(&self) -> [usize; ZONES] {
        [0, 1, 2].map(|zone: usize| self.zones[zone].codes.len())
    }

    fn read_row(&mut self, plane: &PlaneView<'_>, row: usize, window: &mut Window) {
        let Some((whole, outer, inner)) = spans(plane, row, &window.rings) else { return };
        let centre_px = window.rings.outline.centre_px;
        let [edge, inside, ground] = &mut self.zones;
        for span in [Span { end: outer.first, ..whole }, Span { first: outer.end, ..whole }] {
            if window.rings.sums_ground {
                window.ground.add(&stretch(plane, row, span, centre_px));
            } else {
                ground.read(plane, row, span, centre_px);
            }
        }
        for span in [Span { end: inner.first, ..outer }, Span { first: inner.end, ..outer }] {
            edge.read(plane, row, span, centre_px);
        }
        if window.rings.sums_inside {
            window.full.add(&stretch(plane, row, inner, centre_px));
        } else {
            inside.read(plane, row, inner, centre_px);
        }
    }

    /// The samples of a window, zone by zone: their codes, and their places about a centre.
    pub(crate) fn about(
        &self,
        window: &Window,
        share: Share,
        centre_px: [f64; 2],
        places: &mut Places,
        codes: &mut Vec<f32>,
    ) {
        let [offset_u, offset_v] = window.offset_px(centre_px).map(|offset| offset as f32);
        places.clear();
        codes.clear();
        for (zone, Zone { du, dv, codes: of_zone }) in self.zones.iter().enumerate() {
            let range = window.first[zone]..window.ends[share as usize][zone];
            places.du.extend(du[range.clone()].iter().map(|du| du - offset_u));
            places.dv.extend(dv[range.clone()].iter().map(|dv| dv - offset_v));
            codes.extend_from_slice(&of_zone[range]);
            match zone {
                EDGE => places.edge = codes.len(),
                INSIDE => places.lit = codes.len(),
                _ => {}
            }
        }
    }
}

impl Zone {
    fn truncate(&mut self, count: usize) {
        let Self { du, dv, codes } = self;
        [du, dv, codes].into_iter().for_each(|values| values.truncate(count));
    }

    fn read(&mut self, plane: &PlaneView<'_>, row: usize, Span { first, end }: Span, [u_px, v_px]: [f64; 2]) {
        if end <= first {
            return;
        }
        let Self { du, dv, codes } = self;
        let start = codes.len();
        let dv_px = plane.frame_v_px(row as f64) - v_px;
        for values in [&mut *du, dv, codes] {
            values.resize(start + end - first, dv_px as f32);
        }
        read_span(plane, row, first, u_px, &mut codes[start..], &mut du[start..]);
    }
}

/// Looks at the pixels of a window here and there, so that memory answers for many rows at a time rather than for each
/// when its turn comes.
fn fetch(plane: &PlaneView<'_>, Rings { outline, window_px, .. }: &Rings) {
    const LINE: usize = 32;
    let [u_px, v_px] = outline.centre_px;
    let Span { first, end } = columns(plane, u_px, [-window_px, *window_px]);
    let codes = rows(plane, v_px, *window_px).flat_map(|row| {
        let line = plane.line(row);
        line[..line.len().min(end * plane.step_px)].iter().skip(first * plane.step_px).step_by(LINE)
    });
    black_box(codes.map(|code| u32::from(*code)).sum::<u32>());
}

/// What a row shares with the window, with the outer side of the edge and with the inner one.
fn spans(plane: &PlaneView<'_>, row: usize, rings: &Rings) -> Option<(Span, Span, Span)> {
    let Rings { outline, window_px, .. } = rings;
    let [u_px, v_px] = outline.centre_px;
    let dv_px = plane.frame_v_px(row as f64) - v_px;
    let half_px = (window_px * window_px - dv_px * dv_px).max(0.0).sqrt();
    let whole = columns(plane, u_px, [-half_px, half_px]);
    let within = |side: Side, around: Span| match outline.crossings_px(side, dv_px) {
        Some(crossings_px) => columns(plane, u_px, crossings_px).within(around),
        None => Span { first: around.end, end: around.end },
    };
    let outer = within(Side::Outer, whole);
    (whole.end > whole.first).then(|| (whole, outer, within(Side::Inner, outer)))
}

/// Columns between two places beside `u_px`.
fn columns(plane: &PlaneView<'_>, u_px: f64, [low_px, high_px]: [f64; 2]) -> Span {
    let (origin, per_px) = (plane.origin_px[0] as f64, 1.0 / plane.step_px as f64);
    let columns = plane.columns as f64;
    let first = ((u_px + low_px - origin) * per_px).ceil().clamp(0.0, columns) as usize;
    let end = (((u_px + high_px - origin) * per_px).floor() + 1.0).clamp(0.0, columns) as usize;
    Span { first, end: end.max(first) }
}

/// Pixels of one row, their places about a centre.
fn stretch<'a>(plane: &PlaneView<'a>, row: usize, Span { first, end }: Span, [u_px, v_px]: [f64; 2]) -> FullRow<'a> {
    FullRow {
        codes: plane.line(row).get(first * plane.step_px..).unwrap_or_default(),
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

impl Span {
    /// The part of it in another.
    fn within(self, around: Self) -> Self {
        let first = self.first.clamp(around.first, around.end);
        Self { first, end: self.end.clamp(first, around.end) }
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
