//! Finding features fast: one pass over the pixels, then only over those that stand out.
//!
//! ```text
//! rows → runs above the floor → pieces that hang together → parts above half their own height → blobs
//! ```
//!
//! Most pixels are ground and are looked at once, sixteen at a time. A piece that is convex is one feature, and so is
//! what remains of it above half its height. Others are several features whose skirts meet: they are cut higher up until
//! they fall apart, and what hangs together at half its height still is divided at its necks.

mod area;
pub(crate) mod ground;
mod hull;
pub(crate) mod light;
mod neck;
pub(crate) mod row;
pub(crate) mod run;

use std::ops::Range;

use crate::quantile::upper_quantile;
use crate::scout::area::{area, middle};
use crate::scout::hull::Hull;
use crate::scout::light::Light;
use crate::scout::neck::Necks;
use crate::scout::row::{count_above, highest_pair, light_of, parts_above};
use crate::scout::run::{Forest, Run, runs_of_row};

/// A feature as it is found, in pixels of the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Blob {
    /// Centroid of its light above half its height.
    pub(crate) centre: [f64; 2],
    /// Number of pixels above half its height.
    pub(crate) pixels: usize,
    /// Area above half its height, whose border runs between pixels.
    pub(crate) area: f64,
    /// Distance from the centre to the farthest of them.
    pub(crate) extent: f64,
    /// Typical contrast at its top, codes.
    pub(crate) height: f32,
    /// From half its height to its foot.
    pub(crate) edge: f64,
    /// Whether one of its pixels lies on the edge of the plane.
    pub(crate) touches_edge: bool,
    /// Whether it stood alone down to the floor.
    pub(crate) alone: bool,
    /// Its runs among those that [`Scout::runs`] has.
    runs: [u32; 2],
}

/// Pixels that hang together above a level.
#[derive(Debug, Clone)]
struct Piece {
    runs: Range<usize>,
    pixels: u32,
    level: f32,
    /// The highest that two neighbouring pixels both reach.
    peak: f32,
}

/// Finds blobs; its buffers are used again from plane to plane.
#[derive(Debug, Clone, Default)]
pub(crate) struct Scout {
    /// Rows from one that is looked at to the next.
    step: usize,
    /// Runs of all pieces, piece by piece; their rows are counted in steps.
    runs: Vec<Run>,
    /// Pieces that are not yet looked at.
    open: Vec<Piece>,
    cut: Vec<Run>,
    forest: Forest,
    numbers: Vec<u32>,
    trees: Vec<Tree>,
    masks: Vec<u16>,
    /// Contrasts of all runs above the floor, with a pixel on either side of each.
    contrasts: Vec<f32>,
    tops: Vec<f32>,
    /// Lengths of the rows of a piece, and their light.
    lengths: Vec<f64>,
    lights: Vec<f64>,
    hull: Hull,
    necks: Necks,
}

/// What runs that hang together have in common.
#[derive(Debug, Clone, Copy, Default)]
struct Tree {
    runs: u32,
    pixels: u32,
    peak: f32,
    /// Where the next of its runs is put.
    next: usize,
}

/// A piece stands out of another if what holds them together lies below this share of its peak.
const SADDLE: f32 = 0.7;

/// Pieces of fewer pixels are no features: hot pixels stand alone.
const PIXELS_MIN: u32 = 2;

/// A piece that is not convex is cut again at so many times its level.
const CLIMB: f32 = 1.7;

/// Convex pieces fill at least this share of their hull: whole down to their skirts, and above half their height.
const CONVEX: f64 = 0.95;
const CONVEX_AT_HALF: f64 = 0.97;

/// Height is this quantile of the contrasts above half the highest.
const TOP: f64 = 0.7;

impl Scout {
    /// Finds all blobs of a plane that reach above a floor, on every `step`-th of its rows.
    pub(crate) fn find(&mut self, light: &Light<'_>, step: usize, floor: f32, blobs: &mut Vec<Blob>) {
        self.step = step;
        blobs.clear();
        self.runs.clear();
        self.open.clear();
        self.sweep(light, floor);
        self.gather(floor, true);
        while let Some(piece) = self.open.pop() {
            self.explore(light, piece, blobs);
        }
    }

    /// Runs of a blob that was found last, on the rows that were looked at: row of the plane and columns.
    pub(crate) fn runs_of(&self, blob: &Blob) -> impl Iterator<Item = (usize, Range<usize>)> {
        let runs = &self.runs[blob.runs[0] as usize..blob.runs[1] as usize];
        runs.iter().map(|run| (run.row as usize * self.step, run.first as usize..run.end as usize))
    }

    /// All runs of the plane above the floor.
    fn sweep(&mut self, light: &Light<'_>, floor: f32) {
        let Self { step, cut, masks, contrasts, .. } = self;
        cut.clear();
        contrasts.clear();
        let columns = light.columns();
        for (step_row, row) in (0..light.rows()).step_by(*step).enumerate() {
            runs_of_row(light.against(row, floor), masks, |first, end| {
                let (before, behind) = (first.saturating_sub(1), (end + 1).min(columns));
                let start = contrasts.len();
                contrasts.resize(start + behind - before, 0.0);
                light.read(row, before, &mut contrasts[start..]);
                let at = start + first - before;
                let peak = highest_pair(&contrasts[at..at + end - first]);
                let [row, first, end, at] = [step_row, first, end, at].map(|place| place as u32);
                cut.push(Run { row, first, end, at, peak });
            });
        }
        self.plant();
    }

    /// The runs of a piece above a higher level.
    fn rise(&mut self, piece: &Piece, level: f32) {
        let Self { cut, masks, contrasts, runs, .. } = self;
        cut.clear();
        for run in &runs[piece.runs.clone()] {
            parts_above(run, of_run(contrasts, run), level, masks, |part| cut.push(part));
        }
        self.plant();
    }

    /// Finds which of the cut runs hang together.
    fn plant(&mut self) {
        self.forest.grow(&self.cut);
        self.numbers.clear();
        self.numbers.extend_from_slice(self.forest.numbers());
        self.trees.clear();
        self.trees.resize(self.forest.trees(), Tree::default());
    }

    /// Puts cut runs together by their numbers and opens the pieces that stand out; without any, and unless it must
    /// stand out, the largest.
    fn gather(&mut self, level: f32, must_stand_out: bool) {
        for (run, &number) in self.cut.iter().zip(&self.numbers) {
            let tree = &mut self.trees[number as usize];
            tree.runs += 1;
            tree.pixels += run.pixels();
            tree.peak = tree.peak.max(run.peak);
        }
        let mut next = self.runs.len();
        for tree in &mut self.trees {
            tree.next = next;
            next += tree.runs as usize;
        }
        let none = Run { row: 0, first: 0, end: 0, at: 0, peak: 0.0 };
        self.runs.resize(next, none);
        for (run, &number) in self.cut.iter().zip(&self.numbers) {
            let tree = &mut self.trees[number as usize];
            self.runs[tree.next] = *run;
            tree.next += 1;
        }
        let stands_out = |tree: &&Tree| tree.pixels >= PIXELS_MIN && SADDLE * tree.peak > level;
        let piece = |tree: &Tree| Piece {
            runs: tree.next - tree.runs as usize..tree.next,
            pixels: tree.pixels,
            level,
            peak: tree.peak,
        };
        let before = self.open.len();
        self.open.extend(self.trees.iter().filter(stands_out).map(piece));
        if self.open.len() == before && !must_stand_out {
            self.open.extend(self.trees.iter().max_by_key(|tree| tree.pixels).map(piece));
        }
    }

    /// Follows a piece up to half its height, or to where it falls apart.
    fn explore(&mut self, light: &Light<'_>, piece: Piece, blobs: &mut Vec<Blob>) {
        const NEAR: f32 = 1.1;
        let height = self.height(&piece);
        let half = 0.5 * height;
        if half <= NEAR * piece.level {
            self.close(light, piece, height, None, blobs);
            return;
        }
        let convex = self.hull.filled_share(&self.runs[piece.runs.clone()]) >= CONVEX;
        let climbs = !convex && CLIMB * NEAR * piece.level < half;
        let level = if climbs { CLIMB * piece.level } else { half };
        self.rise(&piece, level);
        let before = self.open.len();
        self.gather(level, false);
        if !climbs
            && self.open.len() == before + 1
            && let Some(top) = self.open.pop()
        {
            self.close(light, top, height, convex.then_some(&piece), blobs);
        }
    }

    /// Typical contrast at the top of a piece: robust against single bright pixels.
    fn height(&mut self, piece: &Piece) -> f32 {
        const SAMPLES: u32 = 96;
        let stride = (piece.pixels / SAMPLES).max(1);
        let Self { runs, contrasts, tops, .. } = self;
        tops.clear();
        // Samples go on from run to run, as if all stood in one line.
        let mut next = stride / 2;
        for run in &runs[piece.runs.clone()] {
            let own = of_run(contrasts, run).get(next as usize..).unwrap_or_default();
            tops.extend(own.iter().step_by(stride as usize));
            next = (next + own.len().div_ceil(stride as usize) as u32 * stride) - run.pixels();
        }
        upper_quantile(tops, 0.5 * piece.peak, TOP).unwrap_or(piece.peak)
    }

    /// Makes blobs of a piece at half its height: one if it is convex, else one of every disc in it.
    fn close(&mut self, light: &Light<'_>, piece: Piece, height: f32, skirt: Option<&Piece>, blobs: &mut Vec<Blob>) {
        const PIXELS_TO_DIVIDE: u32 = 12;
        let whole =
            piece.pixels < PIXELS_TO_DIVIDE || self.hull.filled_share(&self.runs[piece.runs.clone()]) >= CONVEX_AT_HALF;
        if !whole {
            let Self { step, necks, runs, cut, numbers, trees, .. } = self;
            let discs = necks.divide(&runs[piece.runs.clone()], *step, cut, numbers);
            if discs > 1 {
                trees.clear();
                trees.resize(discs, Tree::default());
                let before = self.open.len();
                self.gather(piece.level, false);
                while self.open.len() > before
                    && let Some(part) = self.open.pop()
                {
                    blobs.extend(self.blob(light, &part, height, None));
                }
                return;
            }
        }
        blobs.extend(self.blob(light, &piece, height, skirt));
    }

    /// Measures a piece.
    fn blob(&mut self, light: &Light<'_>, piece: &Piece, height: f32, skirt: Option<&Piece>) -> Option<Blob> {
        let Self { runs, contrasts, lengths, lights, step, .. } = self;
        let light_columns = light.columns();
        let (all, step) = (&*runs, *step);
        let runs = &all[piece.runs.clone()];
        let mut upper = 0;
        // Places count from the first pixel, where single precision is fine enough.
        let [left, top] = runs.first().map(|run| [f64::from(run.first), (run.row as usize * step) as f64])?;
        let mut along = 0.0;
        lengths.clear();
        lights.clear();
        for row_runs in runs.chunk_by(|a, b| a.row == b.row) {
            let (mut length, mut row_light) = (0.0, 0.0);
            for run in row_runs {
                let own = of_run(contrasts, run);
                upper += count_above(own, 0.75 * height);
                let first = f64::from(run.first) - left;
                let [light, moment] = light_of(own, first as f32);
                let beyond = beyond(contrasts, run, light_columns, piece.level);
                // What lies between the borders of the outer pixels and where the contrast passes the level.
                let ends = beyond.map(|beyond| (beyond - 0.5) * f64::from(piece.level));
                row_light += light + ends[0] + ends[1];
                along += moment + ends[0] * (first - 0.5) + ends[1] * (first + f64::from(run.pixels()) - 0.5);
                length += f64::from(run.pixels()) - 1.0 + beyond[0] + beyond[1];
            }
            lengths.push(length);
            lights.push(row_light);
        }
        let sum: f64 = lights.iter().sum();
        if sum.is_nan() || sum <= 0.0 {
            return None;
        }
        let above_half = [left + along / sum, top + step as f64 * middle(lights, step)];
        // All rows together tell the middle of all light, however its edges meet the pixels.
        let whole = skirt.filter(|_| step == 1).and_then(|skirt| centroid(&all[skirt.runs.clone()], contrasts));
        let centre = whole.unwrap_or(above_half);
        let step = step as u32;
        let (columns, rows) = (light_columns as u32, (light.rows() as u32).div_ceil(step));
        // Behind the last row that was looked at may lie some that were not.
        let is_above = |column: u32| light.at(column as usize, light.rows() - 1) > piece.level;
        let is_cut_below = |run: &Run| run.row + 1 == rows && (run.first..run.end).any(is_above);
        let on_edge = |run: &Run| run.row == 0 || run.first == 0 || run.end == columns || is_cut_below(run);
        let farthest2 = |run: &Run| {
            let side = (f64::from(run.first) - centre[0]).abs().max((f64::from(run.end) - 1.0 - centre[0]).abs());
            side * side + (f64::from(run.row * step) - centre[1]).powi(2)
        };
        Some(Blob {
            centre,
            pixels: (step * piece.pixels) as usize,
            area: area(lengths, step as usize),
            extent: runs.iter().map(farthest2).fold(0.0, f64::max).sqrt(),
            height,
            edge: edge(
                step * piece.pixels,
                step * upper,
                skirt.map(|skirt| (step * skirt.pixels, skirt.level / height)),
            ),
            touches_edge: runs.iter().any(on_edge),
            alone: skirt.is_some(),
            runs: [piece.runs.start as u32, piece.runs.end as u32],
        })
    }
}

/// Centroid of the light of runs; `None` without light.
fn centroid(runs: &[Run], contrasts: &[f32]) -> Option<[f64; 2]> {
    let [left, top] = runs.first().map(|run| [f64::from(run.first), f64::from(run.row)])?;
    let (mut sum, mut along, mut down) = (0.0, 0.0, 0.0);
    for run in runs {
        let [light, moment] = light_of(of_run(contrasts, run), (f64::from(run.first) - left) as f32);
        (sum, along, down) = (sum + light, along + moment, down + (f64::from(run.row) - top) * light);
    }
    (sum > 0.0).then(|| [left + along / sum, top + down / sum])
}

/// The contrasts of a run.
fn of_run<'a>(contrasts: &'a [f32], run: &Run) -> &'a [f32] {
    &contrasts[run.at as usize..(run.at + run.pixels()) as usize]
}

/// How far beyond the centres of its first and its last pixel a run reaches, to where the contrast passes its level,
/// pixels; half a pixel where it ends in another feature.
fn beyond(contrasts: &[f32], run: &Run, columns: usize, level: f32) -> [f64; 2] {
    let at = |place: u32| contrasts[place as usize];
    let beyond = |inside: f32, outside: Option<f32>| match outside {
        Some(outside) if outside <= level => f64::from((inside - level) / (inside - outside)),
        _ => 0.5,
    };
    let end = run.at + run.pixels();
    let left = beyond(at(run.at), (run.first > 0).then(|| at(run.at - 1)));
    let right = beyond(at(end - 1), ((run.end as usize) < columns).then(|| at(end)));
    [left, right]
}

/// From half the height to the foot of an edge that is blurred over a disc, pixels: from how much wider the feature is
/// at a lower level, if it stands alone, else from how much narrower it is at three quarters of its height.
fn edge(pixels: u32, upper: u32, skirt: Option<(u32, f32)>) -> f64 {
    const LOWEST: f32 = 0.02;
    const HIGHEST: f32 = 0.35;
    const EDGE_MIN: f64 = 0.5;
    let radius = |pixels: u32| (f64::from(pixels) / std::f64::consts::PI).sqrt();
    let edge = match skirt {
        Some((pixels_there, share)) if share < HIGHEST => {
            (radius(pixels_there) - radius(pixels)) / blurred_edge(f64::from(share.max(LOWEST)))
        }
        _ => (radius(pixels) - radius(upper)) / blurred_edge(0.25),
    };
    edge.max(EDGE_MIN)
}

/// Where a straight edge that is blurred over the unit disc has a share of its light, beyond where it has half:
///
/// ```text
/// share = ½ − (t √(1 − t²) + asin t)/π
/// ```
fn blurred_edge(share: f64) -> f64 {
    const ROUNDS: usize = 4;
    let target = std::f64::consts::PI * (0.5 - share);
    // Newton's steps; the left side rises by 2 √(1 − t²).
    (0..ROUNDS).fold(1.0 - 1.5 * share, |t: f64, _| {
        let root = (1.0 - t * t).max(0.01).sqrt();
        (t + (target - t * root - t.asin()) / (2.0 * root)).clamp(0.0, 0.98)
    })
}

#[cfg(test)]
mod tests;
