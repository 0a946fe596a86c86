//! A disc whose pencils the masks cut: the pupil is summed line by line.
//!
//! The unit disc of the pupil is crossed by parallel lines. Masks and dot each leave an interval of every line open, so
//! that the light is a sum of lengths, and its derivatives are what the ends of the dot's intervals add where they lie
//! in the open. The lines are turned from pixel to pixel, so that what their number lacks does not add up.

use multiversion::multiversion;

use crate::likelihood::pencil::Edge;
use crate::likelihood::row::{Local, Pixels, Row};
use crate::likelihood::sharp::{Remains, sharp_row};
use crate::likelihood::soft::soft_row;
use crate::likelihood::spot::Spot;

/// Lines across the pupil.
const LINES: usize = 24;

/// Directions in which the lines run, one after the other.
const TURNS: usize = 8;

/// One value for every line.
type Lines = [f32; LINES];

/// Positions of the lines and half their lengths: midpoints in angle, where a semicircle is smooth.
struct Pupil {
    position: Lines,
    half: Lines,
}

impl Pupil {
    fn new() -> Self {
        let angle = |line: usize| std::f32::consts::PI * (line as f32 + 0.5) / LINES as f32;
        Self { position: std::array::from_fn(|l| angle(l).cos()), half: std::array::from_fn(|l| angle(l).sin()) }
    }

    /// Share of the disc that a unit of length on a line stands for.
    fn share(&self, line: usize) -> f32 {
        self.half[line] / LINES as f32
    }
}

/// What is open of every line: an interval less another.
struct Open {
    low: Lines,
    high: Lines,
    shut_low: Lines,
    shut_high: Lines,
}

impl Open {
    /// The pupil cut by edges, each `(centre, radius, passes inside)`. Of several edges that pass outside, each line
    /// feels the longest.
    #[inline(always)]
    fn of(pupil: &Pupil, edges: &[LocalEdge]) -> Self {
        let mut open = Self {
            low: pupil.half.map(|half| -half),
            high: pupil.half,
            shut_low: [0.0; LINES],
            shut_high: [0.0; LINES],
        };
        for edge in edges {
            for line in 0..LINES {
                let along = pupil.position[line] - edge.x;
                let half = (edge.radius * edge.radius - along * along).max(0.0).sqrt();
                let (low, high) = (edge.y - half, edge.y + half);
                if edge.passes_inside {
                    open.low[line] = open.low[line].max(low);
                    open.high[line] = open.high[line].min(high);
                } else if high - low > open.shut_high[line] - open.shut_low[line] {
                    open.shut_low[line] = low;
                    open.shut_high[line] = high;
                }
            }
        }
        open
    }

    /// Length of a line's part between two ends that is open.
    #[inline(always)]
    fn length(&self, line: usize, low: f32, high: f32) -> f32 {
        let (low, high) = (low.max(self.low[line]), high.min(self.high[line]));
        let shut = high.min(self.shut_high[line]) - low.max(self.shut_low[line]);
        (high - low).max(0.0) - shut.max(0.0)
    }

    /// 1 where a position on a line is open, else 0.
    #[inline(always)]
    fn holds(&self, line: usize, y: f32) -> f32 {
        let shut = y > self.shut_low[line] && y < self.shut_high[line];
        if y > self.low[line] && y < self.high[line] && !shut { 1.0 } else { 0.0 }
    }
}

/// An [`Edge`] as one pixel sees it.
#[derive(Debug, Clone, Copy, Default)]
struct LocalEdge {
    x: f32,
    y: f32,
    radius: f32,
    passes_inside: bool,
}

impl LocalEdge {
    /// Whether it cuts the unit disc.
    #[inline(always)]
    fn cuts(&self) -> bool {
        let offset = (self.x * self.x + self.y * self.y).sqrt();
        if self.passes_inside { offset + 1.0 > self.radius } else { offset - 1.0 < self.radius }
    }
}

/// An [`Edge`] along a row of pixels.
#[derive(Debug, Clone, Copy)]
struct RowEdge {
    first: LocalEdge,
    /// Change of x from pixel to pixel.
    step: f32,
}

/// Edges of one way that are looked at; real masks have one or two.
const EDGES_MAX: usize = 4;

/// The edges of a way along a row.
fn row_edges(way: &[Edge], spot: &Spot, pixels: &Pixels) -> Vec<RowEdge> {
    let [x_mm, y_mm] = spot.image_mm([pixels.u_px, pixels.v_px]);
    let local = |edge: &Edge| RowEdge {
        first: LocalEdge {
            x: (edge.start[0] + edge.per_image * x_mm) as f32,
            y: (edge.start[1] + edge.per_image * y_mm) as f32,
            radius: edge.radius as f32,
            passes_inside: edge.passes_inside,
        },
        step: (edge.per_image * pixels.step_px * spot.pitch_mm) as f32,
    };
    way.iter().take(EDGES_MAX).map(local).collect()
}

/// Cosine and sine of the directions across the lines.
fn turns() -> [(f32, f32); TURNS] {
    // Steps of the golden angle: any few that follow each other are spread well.
    std::array::from_fn(|turn| {
        let (sin, cos) = (turn as f32 * std::f32::consts::PI * 0.618_034).sin_cos();
        (cos, sin)
    })
}

/// The edges as pixel `index` of the row sees them, in coordinates across and along the lines.
#[inline(always)]
fn edges_at(edges: &[RowEdge], index: usize, (cos, sin): (f32, f32)) -> ([LocalEdge; EDGES_MAX], usize) {
    let mut local = [LocalEdge::default(); EDGES_MAX];
    for (place, edge) in local.iter_mut().zip(edges) {
        let (x, y) = (edge.first.x + edge.step * index as f32, edge.first.y);
        *place = LocalEdge { x: cos * x + sin * y, y: cos * y - sin * x, ..edge.first };
    }
    (local, edges.len().min(EDGES_MAX))
}

/// Fills the light of a spot out of focus. Pixels whose pencils the masks leave alone keep the light of the uncut spot,
/// unless it is so slanted that `everywhere` the lines have to be summed.
pub(crate) fn soft(spot: &Spot, pixels: &Pixels, local: &Local, everywhere: bool, row: &mut Row) {
    // The uncut spot's change with the blur serves; little depth comes from it.
    soft_row(local, row);
    row.open.fill(1.0);
    if let [way] = spot.ways.as_slice() {
        let edges = row_edges(way, spot, pixels);
        add_way(local, &edges, everywhere, true, row);
    } else {
        let Row { light, with_u, with_v, with_radius, open, .. } = row;
        for values in [light, with_u, with_v, with_radius, open] {
            values.fill(0.0);
        }
        for way in &spot.ways {
            add_way(local, &row_edges(way, spot, pixels), true, false, row);
        }
    }
    row.with_blur.iter_mut().zip(&row.open).for_each(|(change, open)| *change *= open);
}

/// Most points of a pixel at which the light is looked at.
const POINTS_MAX: usize = 8;

/// Points along the normal of an edge that stand for the square of a pixel, whose projection is a trapezoid.
struct Across {
    offset: [f32; POINTS_MAX],
    share: [f32; POINTS_MAX],
    count: usize,
}

impl Across {
    /// For an edge with normal (u, v) and a blur in px.
    #[inline(always)]
    fn of(u: f32, v: f32, blur_px: f32) -> Self {
        const WIDE_PX: f32 = 3.0;
        let mut across = Self { offset: [0.0; POINTS_MAX], share: [0.0; POINTS_MAX], count: POINTS_MAX };
        if blur_px >= WIDE_PX {
            // Three points with the trapezoid's second and fourth moments.
            let (uu, vv) = (u * u, v * v);
            let square = 12.0 * ((uu * uu + vv * vv) / 80.0 + uu * vv / 24.0);
            let side = 1.0 / (24.0 * square);
            across.count = 3;
            across.offset[..3].copy_from_slice(&[-square.sqrt(), 0.0, square.sqrt()]);
            across.share[..3].copy_from_slice(&[side, 1.0 - 2.0 * side, side]);
            return across;
        }
        let (long, short) = (u.abs().max(v.abs()), u.abs().min(v.abs()));
        let (outer, inner) = (0.5 * (long + short), 0.5 * (long - short));
        let mut sum = 0.0;
        for point in 0..POINTS_MAX {
            let offset = outer * ((2 * point + 1) as f32 / POINTS_MAX as f32 - 1.0);
            let density = ((outer - offset.abs()) / (outer - inner).max(1e-3)).min(1.0);
            across.offset[point] = offset;
            across.share[point] = density;
            sum += density;
        }
        across.share.iter_mut().for_each(|share| *share /= sum);
        across
    }
}

/// Light and its derivatives through the open part of the pupil, at one place of the page.
#[derive(Default)]
struct Lit {
    light: f32,
    with_u: f32,
    with_v: f32,
    with_radius: f32,
}

/// How a dot lies behind the pupil of a band, as seen along its lines.
struct Behind {
    inverse: [[f32; 2]; 2],
    radius_px: f32,
    /// From x in the pupil to the page, px.
    across: [f32; 2],
    /// From y in the pupil to the unit disc of the dot, in px.
    along: [f32; 2],
    along_square: f32,
    /// Lines that only graze the dot weigh no more than this.
    grazing: f32,
}

impl Behind {
    #[inline(always)]
    fn of(local: &Local, blur_px: f32, (cos, sin): (f32, f32)) -> Self {
        let [[xx, xy], [yx, yy]] = local.inverse;
        let along = [blur_px * (xy * cos - xx * sin), blur_px * (yy * cos - yx * sin)];
        let along_square = (along[0] * along[0] + along[1] * along[1]).max(1e-12);
        Self {
            inverse: local.inverse,
            radius_px: local.radius_px,
            across: [blur_px * cos, blur_px * sin],
            along,
            along_square,
            grazing: 0.15 * along_square.sqrt() * local.radius_px,
        }
    }

    /// The light at a place `du`, `dv` from the dot's centre, px.
    #[inline(always)]
    fn lit(&self, pupil: &Pupil, open: &Open, du: f32, dv: f32) -> Lit {
        let [[xx, xy], [yx, yy]] = self.inverse;
        let [ax, ay] = self.along;
        let mut lit = Lit::default();
        for line in 0..LINES {
            let (u, v) = (du + self.across[0] * pupil.position[line], dv + self.across[1] * pupil.position[line]);
            let (ex, ey) = (xx * u + xy * v, yx * u + yy * v);
            let along = ex * ax + ey * ay;
            let apart = along * along - self.along_square * (ex * ex + ey * ey - self.radius_px * self.radius_px);
            let root = apart.max(0.0).sqrt();
            let (low, high) = ((-along - root) / self.along_square, (-along + root) / self.along_square);
            let share = pupil.share(line);
            lit.light += share * open.length(line, low, high);
            let hit = if apart > 0.0 { share / root.max(self.grazing) } else { 0.0 };
            let (at_low, at_high) = (hit * open.holds(line, low), hit * open.holds(line, high));
            let (lx, ly) = (ex + ax * low, ey + ay * low);
            let (hx, hy) = (ex + ax * high, ey + ay * high);
            lit.with_u += at_low * (lx * xx + ly * yx) + at_high * (hx * xx + hy * yx);
            lit.with_v += at_low * (lx * xy + ly * yy) + at_high * (hx * xy + hy * yy);
            lit.with_radius += (at_low + at_high) * self.radius_px;
        }
        lit
    }
}

/// Adds the light that takes one way through the masks to what is there, or puts it in its `place`; everywhere, or only
/// where the way's edges cut the pupil.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn add_way(local: &Local, edges: &[RowEdge], everywhere: bool, place: bool, row: &mut Row) {
    const PIXEL_REACH_PX: f32 = 0.71;
    let pupil = Pupil::new();
    let turns = turns();
    // Rows start at different turns too.
    let first_turn = (local.dv_px.abs() * 3.0) as usize;
    let [[xx, xy], [yx, yy]] = local.inverse;
    for index in 0..row.light.len() {
        let turn = turns[(first_turn + index) % TURNS];
        let (edges, count) = edges_at(edges, index, turn);
        if !everywhere && !edges[..count].iter().any(LocalEdge::cuts) {
            continue;
        }
        let open = Open::of(&pupil, &edges[..count]);
        let area: f32 = (0..LINES).map(|line| pupil.share(line) * open.length(line, -1.0, 1.0)).sum();
        if place {
            row.open[index] = 0.0;
            row.light[index] = 0.0;
            row.with_u[index] = 0.0;
            row.with_v[index] = 0.0;
            row.with_radius[index] = 0.0;
        }
        row.open[index] += area;
        let du = local.du_px + local.step_px * index as f32;
        let (ex, ey) = (xx * du + xy * local.dv_px, yx * du + yy * local.dv_px);
        let e = (ex * ex + ey * ey).max(1e-12).sqrt();
        let (gx, gy) = ((ex * xx + ey * yx) / e, (ex * xy + ey * yy) / e);
        let gradient = (gx * gx + gy * gy).sqrt();
        let depth_px = (local.radius_px - e) / gradient;
        let blur = local.blur_px * (1.0 + local.blur_slope * (ex / local.radius_px).clamp(-1.0, 1.0));
        let blur_px = blur.abs();
        if depth_px > blur_px + PIXEL_REACH_PX {
            row.light[index] += area;
        } else if depth_px > -blur_px - PIXEL_REACH_PX {
            let (u, v) = (gx / gradient, gy / gradient);
            let across = Across::of(u, v, blur_px);
            let behind = Behind::of(local, blur, turn);
            for point in 0..across.count {
                let (offset, share) = (across.offset[point], across.share[point]);
                let lit = behind.lit(&pupil, &open, du + offset * u, local.dv_px + offset * v);
                row.light[index] += share * lit.light;
                row.with_u[index] += share * lit.with_u;
                row.with_v[index] += share * lit.with_v;
                row.with_radius[index] += share * lit.with_radius;
            }
        }
    }
}

/// Fills the light of a spot in or near focus.
pub(crate) fn sharp(spot: &Spot, pixels: &Pixels, local: &Local, row: &mut Row) {
    let mut sums = Sums::new(pixels.count);
    for way in &spot.ways {
        sums.add_way(&row_edges(way, spot, pixels));
    }
    sums.divide();
    row.open.copy_from_slice(&sums.open);
    let remains = Remains { open: &sums.open, x: &sums.x, y: &sums.y, extent: &sums.square };
    sharp_row(local, Some(remains), row);
}

/// Moments of the open part of the pupil, pixel by pixel.
struct Sums {
    open: Vec<f32>,
    x: Vec<f32>,
    y: Vec<f32>,
    square: Vec<f32>,
}

impl Sums {
    fn new(count: usize) -> Self {
        let zeros = || vec![0.0; count];
        Self { open: zeros(), x: zeros(), y: zeros(), square: zeros() }
    }

    fn add_way(&mut self, edges: &[RowEdge]) {
        add_moments(edges, self);
    }

    /// From sums to the share that is open, its centroid, and its extent relative to that of the unit disc, whose mean
    /// square distance from its centre is one half.
    fn divide(&mut self) {
        const EXTENT_MIN: f32 = 0.05;
        let rest = self.x.iter_mut().zip(&mut self.y).zip(&mut self.square);
        for (open, ((x, y), square)) in self.open.iter().zip(rest) {
            let per_area = 1.0 / open.max(1e-6);
            (*x, *y) = (*x * per_area, *y * per_area);
            let spread = *square * per_area - *x * *x - *y * *y;
            *square = (2.0 * spread).max(EXTENT_MIN * EXTENT_MIN).sqrt().min(1.0);
        }
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn add_moments(edges: &[RowEdge], sums: &mut Sums) {
    let pupil = Pupil::new();
    for index in 0..sums.open.len() {
        let (edges, count) = edges_at(edges, index, (1.0, 0.0));
        let open = Open::of(&pupil, &edges[..count]);
        let (mut area, mut x, mut y, mut square) = (0.0, 0.0, 0.0, 0.0);
        for line in 0..LINES {
            let (low, high) = (open.low[line], open.high[line].max(open.low[line]));
            let (shut_low, shut_high) = (open.shut_low[line].max(low), open.shut_high[line].min(high));
            let shut = if shut_high > shut_low { 1.0 } else { 0.0 };
            let share = pupil.share(line);
            let length = high - low - shut * (shut_high - shut_low);
            let first = 0.5 * (high * high - low * low - shut * (shut_high * shut_high - shut_low * shut_low));
            let second = (high.powi(3) - low.powi(3) - shut * (shut_high.powi(3) - shut_low.powi(3))) / 3.0;
            area += share * length;
            x += share * length * pupil.position[line];
            y += share * first;
            square += share * (length * pupil.position[line] * pupil.position[line] + second);
        }
        sums.open[index] += area;
        sums.x[index] += x;
        sums.y[index] += y;
        sums.square[index] += square;
    }
}
