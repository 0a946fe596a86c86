//! The pixels of a plane about its spots, read once; where blur is wide, means of blocks of them.

use multiversion::multiversion;
use twinpupil_instrument::PlaneView;

use crate::fetch::fetch;
use crate::likelihood::blocks::{Blocks, Likeness, Lines};
use crate::likelihood::chords::{LANES, Lanes};
use crate::likelihood::crossings::{Crossings, Row, columns, rows};
use crate::likelihood::full::{Full, Stretch, Tally};
use crate::likelihood::light::Places;
use crate::likelihood::outline::Outline;
use crate::likelihood::pencil::length;
use crate::likelihood::spot::{PIXEL_REACH_PX, Spot};
use crate::noise::Noise;

/// Pixels about all spots of a frame, one window after the other.
#[derive(Debug, Clone, Default)]
pub(crate) struct Samples {
    /// Those that feel an edge, those that see nothing but a dot, and those that see none of it.
    zones: [Zone; ZONES],
    crossings: Crossings,
    reading: Reading,
}

/// The row that is read.
#[derive(Debug, Clone, Default)]
struct Reading {
    line: Vec<Lanes>,
    lines: Lines,
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
    /// Pixels along the side of the blocks that serve, and how much the light may rise between two pixels of one, codes.
    pub(crate) grain: usize,
    pub(crate) rise: f32,
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
    /// Pixels to a sample, and the width of the square that it stands for, px.
    pub(crate) pixels: f64,
    pub(crate) square_px: f64,
}

/// Every which row is of the quarter; and where that has so many pixels that feel an edge that half of them tell enough.
const QUARTER: usize = 4;
const EIGHTH: usize = 8;
const EDGE_MANY: f64 = 480.0;

/// A window with fewer samples than this is looked at as a whole.
const SAMPLES_FEW: usize = 256;

/// The edges of a spot may move by so much before its window is read again, px, or by this share of how far they are felt, whichever
/// is more; and those of others against them by as much.
const SLACK_PX: f64 = 1.0;
const SLACK_SHARE: f64 = 0.1;

impl Window {
    /// Whether it still serves a spot with these rings, whose light reaches `reach_px`.
    pub(crate) fn serves(&self, rings: &Rings, reach_px: f64) -> bool {
        let [du, dv] = self.offset_px(rings.outline.centre_px);
        let (moved_px, window_px) = (length([du, dv]), self.rings.window_px);
        let later = rings.felt_by(self.square_px);
        let is_even = |sums: &Full, within_px: f64| sums.count() == 0.0 || moved_px + within_px <= later.even_px;
        self.rings.grain == rings.grain
            && is_even(&self.full, window_px.min(self.rings.even_px))
            && is_even(&self.ground, window_px)
            && moved_px + reach_px <= window_px
            && self.rings.outline.holds(&later.outline)
    }

    /// Whether the light of another spot falls into it.
    pub(crate) fn is_reached(&self, other: &Spot) -> bool {
        let [du, dv] = self.offset_px(other.centre_px);
        length([du, dv]) < self.rings.window_px + other.reach_px()
    }

    /// See [`Rings`]: pixels along the side of its blocks, and how much the light may rise within one, codes.
    pub(crate) fn grain(&self) -> (usize, f32) {
        (self.rings.grain, self.rings.rise)
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

impl Rings {
    /// For samples of squares, which feel an edge from farther away than pixels.
    fn felt_by(&self, square_px: f64) -> Self {
        let farther_px = PIXEL_REACH_PX * (square_px - 1.0);
        Self { outline: self.outline.widened(farther_px), even_px: self.even_px - farther_px, ..*self }
    }
}

impl Samples {
    pub(crate) fn clear(&mut self) {
        self.zones.iter_mut().for_each(|zone| zone.count = 0);
    }

    /// Reads the pixels of a plane within the rings.
    pub(crate) fn read(&mut self, plane: &PlaneView<'_>, noise: &Noise, rings: &Rings) -> Window {
        let slack_px = SLACK_PX.max(SLACK_SHARE * rings.outline.reach_px());
        let (outline, even_px) = (rings.outline.widened(slack_px), rings.even_px - 2.0 * slack_px);
        let rings = Rings { outline, even_px, ..*rings };
        let ([u_px, v_px], window_px) = (rings.outline.centre_px, rings.window_px);
        let pixels = Blocks::of(plane, 1);
        fetch(plane, rows(&pixels, v_px, window_px), columns(plane, u_px, window_px));
        let blocks = (rings.grain > 1).then(|| self.read_blocks(&Blocks::of(plane, rings.grain), noise, &rings));
        if let Some(window) = blocks.flatten() {
            return window;
        }
        let (mut window, _) = self.read_even(&pixels, noise, &rings);
        if !window.full.is_even(noise, plane.code_max) {
            let crossed = (0..self.crossings.len()).map(|row| self.crossings.row(row, &pixels));
            let inside = crossed.map(|row| row.full(&pixels)).filter(|row| row.count > 0);
            window.full = window.full.without_foreign(noise, plane.code_max, inside);
        }
        window
    }

    /// Reads blocks, unless some of their pixels have to be left out.
    fn read_blocks(&mut self, blocks: &Blocks<'_>, noise: &Noise, rings: &Rings) -> Option<Window> {
        let rings = rings.felt_by(blocks.square_px());
        let (window, is_whole) = self.read_even(blocks, noise, &rings);
        let is_whole = is_whole && window.full.is_even(noise, blocks.plane.code_max);
        if !is_whole {
            self.forget(&window);
        }
        is_whole.then_some(window)
    }

    /// Reads samples, with sums over the ground where that is even; whether the pixels of every sample are alike.
    fn read_even(&mut self, blocks: &Blocks<'_>, noise: &Noise, rings: &Rings) -> (Window, bool) {
        let likeness = Likeness::new(noise, rings.rise, blocks.plane.code_max);
        self.crossings.find(rings, blocks);
        let (window, is_whole) = self.read_zones(blocks, &likeness, rings, rings.even_px >= rings.window_px);
        if window.ground.is_even(noise, blocks.plane.code_max) {
            return (window, is_whole);
        }
        // Something lies on the ground: sample by sample it can be left out.
        self.forget(&window);
        self.read_zones(blocks, &likeness, rings, false)
    }

    /// Takes back the window that was read last.
    fn forget(&mut self, window: &Window) {
        self.zones.iter_mut().zip(window.first).for_each(|(zone, first)| zone.count = first);
    }

    fn read_zones(
        &mut self,
        blocks: &Blocks<'_>,
        likeness: &Likeness,
        rings: &Rings,
        sums_ground: bool,
    ) -> (Window, bool) {
        let Self { zones, crossings, reading } = self;
        let area = crossings.len() * (2.0 * rings.window_px / blocks.step_px) as usize;
        let edge = rings.outline.edge_px2() / (blocks.step_px * blocks.step_px);
        let every = match area < SAMPLES_FEW {
            true => 1,
            false if edge < QUARTER as f64 * EDGE_MANY => QUARTER,
            false => EIGHTH,
        };
        let first = counts(zones);
        let mut tallies = rings.levels.map(|level| Tally::about(level, blocks.pixels()));
        let read = Read { blocks, likeness, crossings, sums_ground, every };
        let is_quarter_whole = read_rows(&read, true, reading, zones, &mut tallies);
        let quarter = counts(zones);
        let are_others_whole = read_rows(&read, false, reading, zones, &mut tallies);
        let [full, ground] = tallies.map(Tally::finish);
        let ends = [quarter, counts(zones)];
        let (pixels, square_px) = (blocks.pixels(), blocks.square_px());
        (Window { rings: *rings, first, ends, full, ground, pixels, square_px }, is_quarter_whole && are_others_whole)
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
        (places.square_px, places.closely) = (window.square_px as f32, share == Share::All);
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
        let (start, end) = (self.count, self.count + stretch.count);
        if self.codes.len() < end + LANES {
            self.make_room(end);
        }
        self.count = end;
        let [du, dv, codes] =
            [&mut self.du, &mut self.dv, &mut self.codes].map(|values| values[start..end + LANES].as_chunks_mut().0);
        let (first_px, step_px) = (stretch.first_px as f32, stretch.step_px as f32);
        let mut along_px: [f32; LANES] = std::array::from_fn(|lane| first_px + step_px * (lane as u8) as f32);
        // What is written beyond the end will be overwritten.
        for (((du, dv), code), value) in du.iter_mut().zip(dv).zip(codes).zip(stretch.chunks()) {
            (*du, *dv, *code) = (along_px, [stretch.dv_px as f32; LANES], *value);
            along_px = along_px.map(|px| px + LANES as f32 * step_px);
        }
    }

    #[cold]
    fn make_room(&mut self, end: usize) {
        for values in [&mut self.du, &mut self.dv, &mut self.codes] {
            values.resize(2 * end + LANES, 0.0);
        }
    }
}

/// What is read of rows, and into what parts.
struct Read<'a> {
    blocks: &'a Blocks<'a>,
    likeness: &'a Likeness,
    crossings: &'a Crossings,
    sums_ground: bool,
    /// Every which row is of the quarter, a power of two.
    every: usize,
}

/// Adds the samples of the rows of the quarter, or of all others, to zones, or to the sums over what the spot fills and over
/// the ground; whether the pixels of every sample are alike.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "x86_64+avx"))]
fn read_rows(
    read: &Read<'_>,
    of_quarter: bool,
    reading: &mut Reading,
    zones: &mut [Zone; ZONES],
    tallies: &mut [Tally; 2],
) -> bool {
    let mut is_whole = true;
    for row in 0..read.crossings.len() {
        if of_quarter == (row & (read.every - 1) == 0) {
            is_whole &= read.row(&read.crossings.row(row, read.blocks), reading, zones, tallies);
        }
    }
    is_whole
}

impl Read<'_> {
    #[inline(always)]
    fn row(
        &self,
        row: &Row,
        reading: &mut Reading,
        [edge, inside, beside]: &mut [Zone; ZONES],
        [full, ground]: &mut [Tally; 2],
    ) -> bool {
        let Row { whole, outer, inner, even, .. } = *row;
        // With room for the last stretch to be looked at by whole lanes.
        let wides = whole.len().div_ceil(LANES) + 1;
        let Reading { line, lines } = reading;
        if line.len() < wides {
            line.resize(wides, [0.0; LANES]);
        }
        let is_whole = self.blocks.read(row.row, whole.first, whole.len(), self.likeness, lines, line);
        let line = line[..wides].as_flattened();
        let stretch = |first: usize, end: usize| Stretch {
            values: &line[first - whole.first..],
            count: end - first,
            first_px: row.beside_px(self.blocks, first),
            step_px: self.blocks.step_px,
            dv_px: row.dv_px,
        };
        for outside in [stretch(whole.first, outer.first), stretch(outer.end, whole.end)] {
            if self.sums_ground {
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
        is_whole
    }
}
