//! Where the rows of a plane cross the curves about a spot.

use std::ops::Range;

use multiversion::multiversion;
use twinpupil_instrument::PlaneView;

use crate::likelihood::blocks::Blocks;
use crate::likelihood::full::FullRow;
use crate::likelihood::outline::{Curve, Side};
use crate::likelihood::samples::Rings;

/// Columns of the rows of a window that lie within the window, within both sides of the edge, and within what is even of that.
#[derive(Debug, Clone, Default)]
pub(crate) struct Crossings {
    first_row: usize,
    centre_px: [f64; 2],
    /// Row by row for each curve; columns `first..end` lie within it.
    first: [Vec<u32>; CURVES],
    end: [Vec<u32>; CURVES],
}

const CURVES: usize = 4;

/// What a row shares with the window, with what lies within the outer side of the edge and within the inner one, and with
/// what is even of that.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    pub(crate) row: usize,
    u_px: f64,
    pub(crate) dv_px: f64,
    pub(crate) whole: Span,
    pub(crate) outer: Span,
    pub(crate) inner: Span,
    pub(crate) even: Span,
}

/// Columns `first..end` of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Span {
    pub(crate) first: usize,
    pub(crate) end: usize,
}

impl Crossings {
    /// Of the window and the rings about a spot with rows of blocks.
    pub(crate) fn find(&mut self, rings: &Rings, blocks: &Blocks<'_>) {
        let Rings { outline, window_px, even_px, .. } = *rings;
        let rows = rows(blocks, outline.centre_px[1], window_px);
        let [outer, inner] = [Side::Outer, Side::Inner].map(|side| outline.curve(side));
        let curves = [Curve::circle(window_px), outer, inner, Curve::circle(even_px.clamp(0.0, window_px))];
        (self.first_row, self.centre_px) = (rows.start, outline.centre_px);
        let from_px = [outline.centre_px[0] - blocks.origin_px()[0], blocks.v_px(rows.start) - outline.centre_px[1]];
        for ((curve, first), end) in curves.iter().zip(&mut self.first).zip(&mut self.end) {
            first.resize(rows.len(), 0);
            end.resize(rows.len(), 0);
            cross(curve, from_px, blocks, first, end);
        }
    }

    /// Number of rows.
    pub(crate) fn len(&self) -> usize {
        self.first[0].len()
    }

    #[inline(always)]
    pub(crate) fn row(&self, index: usize, blocks: &Blocks<'_>) -> Row {
        let span =
            |curve: usize| Span { first: self.first[curve][index] as usize, end: self.end[curve][index] as usize };
        let (row, [u_px, v_px]) = (self.first_row + index, self.centre_px);
        let whole = span(0);
        let outer = span(1).within(whole);
        let inner = span(2).within(outer);
        Row { row, u_px, dv_px: blocks.v_px(row) - v_px, whole, outer, inner, even: span(3).within(inner) }
    }
}

/// Finds the columns of rows within a curve, whose middle lies so far along from column 0, and the first row so far below it.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "x86_64+avx"))]
fn cross(curve: &Curve, [middle_px, below_px]: [f64; 2], blocks: &Blocks<'_>, first: &mut [u32], end: &mut [u32]) {
    // Added to a number below it, it leaves that in the last bits.
    const WHOLE: f64 = 4_503_599_627_370_496.0;
    let Curve { lean, size2, narrowing } = *curve;
    let (step_px, per_px, columns) = (blocks.step_px, 1.0 / blocks.step_px, blocks.columns as f64);
    for (row, (first, end)) in first.iter_mut().zip(end).enumerate() {
        let dv_px = below_px + f64::from(row as i32) * step_px;
        let half2_px = size2 - narrowing * dv_px * dv_px;
        let half_px = half2_px.max(0.0).sqrt();
        let middle_px = middle_px - lean * dv_px;
        let low = ((middle_px - half_px) * per_px).max(0.0).min(columns).ceil();
        let high = ((middle_px + half_px) * per_px + 1.0).max(0.0).min(columns).floor();
        let high = if half2_px > 0.0 { high.max(low) } else { low };
        (*first, *end) = ((low + WHOLE).to_bits() as u32, (high + WHOLE).to_bits() as u32);
    }
}

impl Row {
    /// Where a column lies beside the centre, px.
    #[inline(always)]
    pub(crate) fn beside_px(&self, blocks: &Blocks<'_>, column: usize) -> f64 {
        blocks.u_px(column) - self.u_px
    }

    /// What is even of it, of single pixels.
    pub(crate) fn full<'a>(&self, pixels: &Blocks<'a>) -> FullRow<'a> {
        let plane = pixels.plane;
        FullRow {
            codes: plane.line(self.row).get(self.even.first * plane.step_px..).unwrap_or_default(),
            step: plane.step_px,
            count: self.even.len(),
            first_px: self.beside_px(pixels, self.even.first),
            dv_px: self.dv_px,
        }
    }
}

impl Span {
    #[inline(always)]
    pub(crate) fn len(self) -> usize {
        self.end - self.first
    }

    /// The part of it in another.
    #[inline(always)]
    fn within(self, around: Self) -> Self {
        let first = self.first.clamp(around.first, around.end);
        Self { first, end: self.end.clamp(first, around.end) }
    }
}

/// Columns of pixels within a distance of a centre.
pub(crate) fn columns(plane: &PlaneView<'_>, u_px: f64, radius_px: f64) -> Range<usize> {
    within([u_px - radius_px, u_px + radius_px], plane.origin_px[0] as f64, plane.step_px as f64, plane.columns)
}

/// Rows within a distance of a centre.
pub(crate) fn rows(blocks: &Blocks<'_>, v_px: f64, radius_px: f64) -> Range<usize> {
    within([v_px - radius_px, v_px + radius_px], blocks.origin_px()[1], blocks.step_px, blocks.rows)
}

/// Those of `count` that lie between two places.
fn within([low_px, high_px]: [f64; 2], origin_px: f64, step_px: f64, count: usize) -> Range<usize> {
    let first = ((low_px - origin_px) / step_px).ceil().clamp(0.0, count as f64) as usize;
    let end = (((high_px - origin_px) / step_px).floor() + 1.0).clamp(0.0, count as f64) as usize;
    first..end.max(first)
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{Frame, Mosaic, paper};

    use super::*;
    use crate::likelihood::outline::Outline;
    use crate::likelihood::pencil::{Pencil, length};
    use crate::likelihood::spot::{Dot, Raster, Spot};

    const COLUMNS: usize = 160;
    const ROWS: usize = 120;

    fn rings(centre_px: [f64; 2], even_px: f64) -> Rings {
        let instrument = paper::instrument();
        let pencil = Pencil::of_band(&instrument, &instrument.bands[1], 100.0);
        let raster = Raster { axis_px: [959.5, 599.5], pitch_mm: 0.00586 };
        let dot = Dot { centre_mm: [4.0, -3.0, 310.0], diameter_mm: 1.0, slopes: [0.9, 0.3] };
        let spot = Spot { centre_px, ..Spot::of(&dot, &pencil, raster, None) };
        let window_px = spot.reach_px() + 5.0;
        Rings { outline: Outline::of(&spot), window_px, even_px, levels: [0.0; 2], grain: 1, rise: 0.0 }
    }

    #[test]
    fn rows_hold_what_lies_within_the_curves() {
        let frame = Frame::new(COLUMNS, ROWS, 4095, vec![vec![0; COLUMNS * ROWS]]).expect("a legal frame");
        let places_px = [[80.3, 59.8], [1.0, 2.0], [158.5, 118.2], [-20.0, 60.0], [700.0, -300.0]];
        for (step, origin) in [(1, 0), (2, 1), (3, 2)] {
            let mut plane = frame.plane(Mosaic::Mono, "0").expect("page 0");
            (plane.step_px, plane.origin_px) = (step, [origin; 2]);
            (plane.columns, plane.rows) = ((COLUMNS - origin).div_ceil(step), (ROWS - origin).div_ceil(step));
            for (centre_px, even_px) in
                places_px.into_iter().flat_map(|place| [-3.0, 20.17, f64::INFINITY].map(|even_px| (place, even_px)))
            {
                for grain in 1..=4 {
                    check(&rings(centre_px, even_px), &Blocks::of(&plane, grain));
                }
            }
        }
    }

    fn check(rings: &Rings, blocks: &Blocks<'_>) {
        let mut crossings = Crossings::default();
        crossings.find(rings, blocks);
        let [u_px, v_px] = rings.outline.centre_px;
        let [outer, inner] = [Side::Outer, Side::Inner].map(|side| rings.outline.curve(side));
        // Beyond the curve if above 0.
        let beyond = |curve: &Curve, [du, dv]: [f64; 2]| {
            (du + curve.lean * dv).powi(2) - (curve.size2 - curve.narrowing * dv * dv)
        };
        let mut found = 0;
        for row in (0..crossings.len()).map(|index| crossings.row(index, blocks)) {
            for column in 0..blocks.columns {
                let place = [blocks.u_px(column) - u_px, blocks.v_px(row.row) - v_px];
                let holds = |span: Span| (span.first..span.end).contains(&column);
                let (is_whole, is_outer) = (length(place) <= rings.window_px, beyond(&outer, place) <= 0.0);
                let (is_inner, is_even) = (beyond(&inner, place) <= 0.0, length(place) <= rings.even_px);
                let expected = [is_whole, is_whole && is_outer, is_whole && is_outer && is_inner];
                assert_eq!([row.whole, row.outer, row.inner].map(holds), expected, "{place:?}");
                assert_eq!(holds(row.even), expected[2] && is_even, "{place:?}");
                found += usize::from(is_whole);
            }
        }
        let is_near = |row: usize, column: usize| {
            length([blocks.u_px(column) - u_px, blocks.v_px(row) - v_px]) <= rings.window_px
        };
        let all = (0..blocks.rows).flat_map(|row| (0..blocks.columns).map(move |column| (row, column)));
        assert_eq!(found, all.filter(|(row, column)| is_near(*row, *column)).count());
    }
}
