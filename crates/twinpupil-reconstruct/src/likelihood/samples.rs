//! The pixels of a plane about its spots, read once.

use multiversion::multiversion;
use twinpupil_instrument::PlaneView;

use crate::fetch::fetch;
use crate::likelihood::full::{Full, FullRow, Stretch, Tally};
use crate::likelihood::light::Places;
use crate::likelihood::outline::{Curve, Outline, Side};
use crate::likelihood::pencil::length;
use crate::likelihood::spot::Spot;
use crate::noise::Noise;
use crate::scout::light::read_every;

/// Pixels about all spots of a frame, one window after the other.
#[derive(Debug, Clone, Default)]
pub(crate) struct Samples {
    /// Those that feel an edge, those that see nothing but a dot, and those that see none of it.
    zones: [Zone; ZONES],
    /// The row that is read.
    line: Vec<f32>,
}

/// The first `count` pixels, and their places about the centres of their windows; the rest is room for more.
#[derive(Debug, Clone, Default)]
struct Zone {
    count: usize,
    du: Vec<f32>,
    dv: Vec<f32>,
    codes: Vec<f32>,
}

const ZONES: usize = 3;
const EDGE: usize = 0;
const INSIDE: usize = 1;

/// What is to be read about a spot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rings {
    pub(crate) outline: Outline,
    /// Radius of the window.
    pub(crate) window_px: f64,
    /// Distance from the centre within which what the spot fills is equally bright but for noise and the illumination, so
    /// that sums tell all of it, and the ground too where it reaches beyond the window.
    pub(crate) even_px: f64,
    /// Codes of what the spot fills and of the ground, about.
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

/// Pixels side by side.
const LANES: usize = 8;

/// Every which row is of the quarter; and where that has so many pixels that feel an edge that half of them tell enough.
const QUARTER: usize = 4;
const EIGHTH: usize = 8;
const EDGE_MANY: f64 = 480.0;

/// A window with fewer samples than this is looked at as a whole.
const SAMPLES_FEW: usize = 256;

/// A spot may move by so much before its window is read again, px.
const SLACK_PX: f64 = 1.0;

impl Window {
    /// Whether it still serves a spot with these rings, whose light reaches `reach_px`.
    pub(crate) fn serves(&self, rings: &Rings, reach_px: f64) -> bool {
        let [du, dv] = self.offset_px(rings.outline.centre_px);
        let (moved_px, window_px) = (length([du, dv]), self.rings.window_px);
        let is_even = |sums: &Full, within_px: f64| sums.count() == 0.0 || moved_px + within_px <= rings.even_px;
        is_even(&self.full, window_px.min(self.rings.even_px))
            && is_even(&self.ground, window_px)
            && moved_px + reach_px <= window_px
            && self.rings.outline.holds(&rings.outline)
    }

    /// Whether the light of another spot falls into it.
    pub(crate) fn is_reached(&self, other: &Spot) -> bool {
        let [du, dv] = self.offset_px(other.centre_px);
        length([du, dv]) < self.rings.window_px + other.reach_px()
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
        self.zones.iter_mut().for_each(|zone| zone.count = 0);
    }

    /// Reads the pixels of a plane within the rings.
    pub(crate) fn read(&mut self, plane: &PlaneView<'_>, noise: &Noise, rings: &Rings) -> Window {
        let rings = Rings { outline: rings.outline.widened(SLACK_PX), even_px: rings.even_px - SLACK_PX, ..*rings };
        let ([u_px, v_px], window_px) = (rings.outline.centre_px, rings.window_px);
        let Span { first, end } = columns(plane, u_px, [-window_px, window_px]);
        fetch(plane, rows(plane, v_px, window_px), first..end);
        let mut window = self.read_zones(plane, &rings, rings.even_px >= rings.window_px);
        if !window.ground.is_even(noise, plane.code_max) {
            // Something lies on the ground: pixel by pixel it can be left out.
            self.zones.iter_mut().zip(window.first).for_each(|(zone, first)| zone.count = first);
            window = self.read_zones(plane, &rings, false);
        }
        if !window.full.is_even(noise, plane.code_max) {
            let curves = Curves::of(&rings);
            let inside = rows(plane, rings.outline.centre_px[1], rings.window_px)
                .map(|row| curves.row(plane, row))
                .map(|row| row.full(plane))
                .filter(|row| row.count > 0);
            window.full = window.full.without_foreign(noise, plane.code_max, inside);
        }
        window
    }

    fn read_zones(&mut self, plane: &PlaneView<'_>, rings: &Rings, sums_ground: bool) -> Window {
        let rows = rows(plane, rings.outline.centre_px[1], rings.window_px);
        let area = rows.len() * (2.0 * rings.window_px / plane.step_px as f64) as usize;
        let edge = rings.outline.edge_px2() / (plane.step_px * plane.step_px) as f64;
        let every = match area < SAMPLES_FEW {
            true => 1,
            false if edge < QUARTER as f64 * EDGE_MANY => QUARTER,
            false => EIGHTH,
        };
        let first = counts(&self.zones);
        let curves = Curves::of(rings);
        let mut tallies = rings.levels.map(Tally::about);
        let Self { zones, line } = self;
        let first_row = rows.start;
        let is_of_quarter = |row: &usize| (row - first_row).is_multiple_of(every);
        read_rows(plane, &curves, rows.clone().step_by(every), sums_ground, line, zones, &mut tallies);
        let quarter = counts(zones);
        let others = rows.filter(|row| !is_of_quarter(row));
        read_rows(plane, &curves, others, sums_ground, line, zones, &mut tallies);
        let [full, ground] = tallies.map(Tally::finish);
        Window { rings: *rings, first, ends: [quarter, counts(zones)], full, ground }
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
        for (zone, Zone { du, dv, codes: of_zone, .. }) in self.zones.iter().enumerate() {
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

/// Samples in every zone.
fn counts(zones: &[Zone; ZONES]) -> [usize; ZONES] {
    zones.each_ref().map(|zone| zone.count)
}

impl Zone {
    /// Adds pixels of a row.
    #[inline(always)]
    fn add(&mut self, stretch: &Stretch<'_>) {
        if stretch.values.is_empty() {
            return;
        }
        let (start, end) = (self.count, self.count + stretch.values.len());
        if self.codes.len() < end + LANES {
            self.make_room(end);
        }
        self.count = end;
        let Self { du, dv, codes, .. } = self;
        let (du, dv) = (du[start..end + LANES].as_chunks_mut::<LANES>().0, dv[start..end + LANES].as_chunks_mut().0);
        let (first_px, step_px) = (stretch.first_px as f32, stretch.step_px as f32);
        let mut along_px: [f32; LANES] = std::array::from_fn(|lane| first_px + step_px * (lane as u8) as f32);
        // What is written beyond the end will be overwritten.
        for (du, dv) in du.iter_mut().zip(dv).take(stretch.values.len().div_ceil(LANES)) {
            (*du, *dv) = (along_px, [stretch.dv_px as f32; LANES]);
            along_px = along_px.map(|px| px + LANES as f32 * step_px);
        }
        codes[start..end].iter_mut().zip(stretch.values).for_each(|(code, value)| *code = *value);
    }

    #[cold]
    fn make_room(&mut self, end: usize) {
        for values in [&mut self.du, &mut self.dv, &mut self.codes] {
            values.resize(2 * end + LANES, 0.0);
        }
    }
}

/// Adds the pixels of rows to zones, or to the sums over what the spot fills and over the ground.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "x86_64+avx"))]
fn read_rows(
    plane: &PlaneView<'_>,
    curves: &Curves,
    rows: impl Iterator<Item = usize>,
    sums_ground: bool,
    line: &mut Vec<f32>,
    zones: &mut [Zone; ZONES],
    tallies: &mut [Tally; 2],
) {
    for row in rows {
        read_row(plane, &curves.row(plane, row), sums_ground, line, zones, tallies);
    }
}

#[inline(always)]
fn read_row(
    plane: &PlaneView<'_>,
    row: &Row,
    sums_ground: bool,
    line: &mut Vec<f32>,
    [edge, inside, beside]: &mut [Zone; ZONES],
    [full, ground]: &mut [Tally; 2],
) {
    let Row { whole, outer, inner, even, .. } = *row;
    if line.len() < whole.len() {
        line.resize(whole.len(), 0.0);
    }
    let line = &mut line[..whole.len()];
    let codes = plane.line(row.row).get(whole.first * plane.step_px..).unwrap_or_default();
    read_every(codes, plane.step_px, f32::from, line);
    let stretch = |first: usize, end: usize| Stretch {
        values: &line[first - whole.first..end - whole.first],
        first_px: row.beside_px(plane, first),
        step_px: plane.step_px as f64,
        dv_px: row.dv_px,
    };
    for outside in [stretch(whole.first, outer.first), stretch(outer.end, whole.end)] {
        if sums_ground {
            ground.add(&outside);
        } else {
            beside.add(&outside);
        }
    }
    edge.add(&stretch(outer.first, inner.first));
    edge.add(&stretch(inner.end, outer.end));
    inside.add(&stretch(inner.first, even.first));
    inside.add(&stretch(even.end, inner.end));
    full.add(&stretch(even.first, even.end));
}

/// The window, both sides of the edge and what is even within them, ready to be crossed by rows.
struct Curves {
    centre_px: [f64; 2],
    lean: [f64; CURVES],
    size2: [f64; CURVES],
    narrowing: [f64; CURVES],
}

const CURVES: usize = 4;

/// What a row shares with the window, with what lies within the outer side of the edge and within the inner one, and with
/// what is even of that.
struct Row {
    row: usize,
    u_px: f64,
    dv_px: f64,
    whole: Span,
    outer: Span,
    inner: Span,
    even: Span,
}

impl Curves {
    fn of(&Rings { outline, window_px, even_px, .. }: &Rings) -> Self {
        let [outer, inner] = [Side::Outer, Side::Inner].map(|side| outline.curve(side));
        let curves = [Curve::circle(window_px), outer, inner, Curve::circle(even_px.clamp(0.0, window_px))];
        Self {
            centre_px: outline.centre_px,
            lean: curves.map(|curve| curve.lean),
            size2: curves.map(|curve| curve.size2),
            narrowing: curves.map(|curve| curve.narrowing),
        }
    }

    #[inline(always)]
    fn row(&self, plane: &PlaneView<'_>, row: usize) -> Row {
        // Added to a number below it, it leaves that in the last bits.
        const WHOLE: f64 = 4_503_599_627_370_496.0;
        let [u_px, v_px] = self.centre_px;
        let dv_px = plane.frame_v_px(row as f64) - v_px;
        let (middle_px, per_px) = (u_px - plane.origin_px[0] as f64, 1.0 / plane.step_px as f64);
        let columns = plane.columns as f64;
        let (mut first, mut end) = ([0; CURVES], [0; CURVES]);
        for curve in 0..CURVES {
            let half2_px = self.size2[curve] - self.narrowing[curve] * dv_px * dv_px;
            let half_px = half2_px.max(0.0).sqrt();
            let middle_px = middle_px - self.lean[curve] * dv_px;
            let low = ((middle_px - half_px) * per_px).max(0.0).min(columns).ceil();
            let high = ((middle_px + half_px) * per_px + 1.0).max(0.0).min(columns).floor();
            let high = if half2_px > 0.0 { high.max(low) } else { low };
            first[curve] = (low + WHOLE).to_bits() as u32;
            end[curve] = (high + WHOLE).to_bits() as u32;
        }
        let span = |curve: usize| Span { first: first[curve] as usize, end: end[curve] as usize };
        let whole = span(0);
        let outer = span(1).within(whole);
        let inner = span(2).within(outer);
        Row { row, u_px, dv_px, whole, outer, inner, even: span(3).within(inner) }
    }
}

impl Row {
    /// Where a column lies beside the centre, px.
    #[inline(always)]
    fn beside_px(&self, plane: &PlaneView<'_>, column: usize) -> f64 {
        plane.frame_u_px(column as f64) - self.u_px
    }

    /// What is even of it.
    fn full<'a>(&self, plane: &PlaneView<'a>) -> FullRow<'a> {
        FullRow {
            codes: plane.line(self.row).get(self.even.first * plane.step_px..).unwrap_or_default(),
            step: plane.step_px,
            count: self.even.len(),
            first_px: self.beside_px(plane, self.even.first),
            dv_px: self.dv_px,
        }
    }
}

/// Columns between two places beside `u_px`; none if there is nothing between them.
fn columns(plane: &PlaneView<'_>, u_px: f64, [low_px, high_px]: [f64; 2]) -> Span {
    let (origin, per_px) = (plane.origin_px[0] as f64, 1.0 / plane.step_px as f64);
    let columns = plane.columns as f64;
    let low = ((u_px + low_px - origin) * per_px).clamp(0.0, columns);
    let high = ((u_px + high_px - origin) * per_px + 1.0).clamp(0.0, columns);
    // Rounded up and down: casts cut what is behind the point.
    let first = low as usize + usize::from((low as usize) as f64 != low);
    let end = high as usize;
    if high_px > low_px { Span { first, end: end.max(first) } } else { Span { first, end: first } }
}

/// Columns `first..end` of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Span {
    first: usize,
    end: usize,
}

impl Span {
    #[inline(always)]
    fn len(self) -> usize {
        self.end - self.first
    }

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
