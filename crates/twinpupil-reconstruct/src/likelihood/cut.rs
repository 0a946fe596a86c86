//! A disc whose pencils the masks cut.
//!
//! What a mask takes is an area of the pupil's disc P: that of its own shadow M within it and, where the dot D does not
//! fill the pencil, within the dot as well. Lines across the pupil, along the edge of the dot, cross each of the three in
//! one interval, so the areas are sums of lengths:
//!
//! ```text
//! open = 1 − |P∩M|/π        light = (|P∩D| − |P∩D∩M|)/π
//! ```
//!
//! `|P∩D|` is the light of the uncut spot. On a surface that slopes, a pencil meets the dot as a central projection of
//! the pupil, see [`Pencil::skew`](crate::likelihood::pencil::Pencil::skew).

use std::f32::consts::PI;

use multiversion::multiversion;

use crate::likelihood::light::{EdgeView, Light, Local, Places, SHARP_PX};
use crate::likelihood::pencil::Edge;
use crate::likelihood::spot::Spot;

/// Lines across an area.
const LINES: usize = 24;

/// Where the lines lie from −1 to 1 and what they count: Fejér's first rule, which bears that areas end like circles.
const POSITIONS: [f32; LINES] = [
    0.997_858_94,
    0.980_785_25,
    0.946_930_1,
    0.896_872_76,
    0.831_469_6,
    0.751_839_8,
    0.659_345_8,
    0.555_570_24,
    0.442_288_7,
    0.321_439_47,
    0.195_090_32,
    0.065_403_126,
    -0.065_403_126,
    -0.195_090_32,
    -0.321_439_47,
    -0.442_288_7,
    -0.555_570_24,
    -0.659_345_8,
    -0.751_839_8,
    -0.831_469_6,
    -0.896_872_76,
    -0.946_930_1,
    -0.980_785_25,
    -0.997_858_94,
];
const WEIGHTS: [f32; LINES] = [
    0.007_472_589,
    0.026_143_402,
    0.041_683_49,
    0.058_175_642,
    0.072_513_8,
    0.086_469_69,
    0.098_290_75,
    0.108_934_544,
    0.117_329_8,
    0.124_001_5,
    0.128_355_97,
    0.130_628_82,
    0.130_628_82,
    0.128_355_97,
    0.124_001_5,
    0.117_329_8,
    0.108_934_544,
    0.098_290_75,
    0.086_469_69,
    0.072_513_8,
    0.058_175_642,
    0.041_683_49,
    0.026_143_402,
    0.007_472_589,
];

/// Edges of one way that are looked at; real masks have one or two.
const EDGES_MAX: usize = 4;

/// Half the diagonal of a pixel.
const PIXEL_REACH_PX: f32 = 0.71;

/// Below this blur the open part of the pupil only moves and dims the light.
const POINT_PX: f32 = 0.3;

/// Turns the light of an uncut spot into that of the cut one.
pub(crate) fn cut(spot: &Spot, local: &Local, places: &Places, out: &mut Light) {
    if let [way] = spot.ways.as_slice() {
        cut_way(&Way::of(way, spot), local, places, out);
        return;
    }
    let uncut = out.clone();
    let mut sum = Light::default();
    sum.resize(places.len());
    for way in &spot.ways {
        out.clone_from(&uncut);
        cut_way(&Way::of(way, spot), local, places, out);
        sum.add(out);
    }
    *out = sum;
}

/// Light of an uncut spot whose blur reaches so far around the ends of a foreshortened dot that only lines tell it.
#[multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
pub(crate) fn slanted(local: &Local, places: &Places, out: &mut Light) {
    let all = Cuts::default();
    for index in 0..places.len() {
        let (du, dv) = (places.du[index], places.dv[index]);
        let edge = EdgeView::at(local, du, dv);
        if ((1.0 - edge.q) * edge.px).abs() < edge.blur_px.abs() + PIXEL_REACH_PX {
            out.light[index] = lit(local, &edge, [du, dv], |stretch, behind| {
                area(stretch, [all.shut(), all.rims()], Some(behind)).share
            });
        }
    }
}

impl Light {
    fn add(&mut self, other: &Self) {
        let add = |sum: &mut [f32], other: &[f32]| sum.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
        add(&mut self.light, &other.light);
        add(&mut self.with_u, &other.with_u);
        add(&mut self.with_v, &other.with_v);
        add(&mut self.with_radius, &other.with_radius);
        add(&mut self.with_blur, &other.with_blur);
        add(&mut self.open, &other.open);
    }
}

/// The edges along one way through the masks.
struct Way {
    /// As the centre of the spot sees them.
    edges: [Circle; EDGES_MAX],
    count: usize,
    /// Movement of their centres with the place, per px.
    per_px: [f32; EDGES_MAX],
}

/// An [`Edge`] in the unit disc of the pupil.
#[derive(Debug, Clone, Copy, Default)]
struct Circle {
    x: f32,
    y: f32,
    radius: f32,
    passes_inside: bool,
}

impl Way {
    fn of(way: &[Edge], spot: &Spot) -> Self {
        let [x_mm, y_mm] = spot.image_mm(spot.centre_px);
        let mut edges = [Circle::default(); EDGES_MAX];
        let mut per_px = [0.0; EDGES_MAX];
        for (place, edge) in way.iter().take(EDGES_MAX).enumerate() {
            edges[place] = Circle {
                x: (edge.start[0] + edge.per_image * x_mm) as f32,
                y: (edge.start[1] + edge.per_image * y_mm) as f32,
                radius: edge.radius as f32,
                passes_inside: edge.passes_inside,
            };
            per_px[place] = (edge.per_image * spot.pitch_mm) as f32;
        }
        Self { edges, count: way.len().min(EDGES_MAX), per_px }
    }

    /// The edges that cut the pupil at a place, in coordinates whose first axis has a direction.
    #[inline(always)]
    fn at(&self, du: f32, dv: f32, cos: f32, sin: f32) -> Cuts {
        let mut cuts = Cuts::default();
        for (edge, per_px) in self.edges[..self.count].iter().zip(self.per_px) {
            let (x, y) = (edge.x + per_px * du, edge.y + per_px * dv);
            let turned = Circle { x: cos * x + sin * y, y: cos * y - sin * x, ..*edge };
            let offset = (x * x + y * y).sqrt();
            if edge.passes_inside && offset + 1.0 > edge.radius {
                cuts.rims[cuts.limits] = turned;
                cuts.limits += 1;
            } else if !edge.passes_inside && offset - 1.0 < edge.radius {
                cuts.shut[cuts.shuts] = turned;
                cuts.shuts += 1;
            }
        }
        cuts
    }
}

/// Circles that cut the pupil at one place: light passes outside the shut ones and inside the others.
#[derive(Debug, Default)]
struct Cuts {
    shut: [Circle; EDGES_MAX],
    shuts: usize,
    rims: [Circle; EDGES_MAX],
    limits: usize,
}

impl Cuts {
    fn shut(&self) -> &[Circle] {
        &self.shut[..self.shuts]
    }

    fn rims(&self) -> &[Circle] {
        &self.rims[..self.limits]
    }
}

/// Area of the pupil over π, and its moments along both axes.
#[derive(Debug, Clone, Copy, Default)]
struct Area {
    share: f32,
    x: f32,
    y: f32,
}

/// A stretch across the lines.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    low: f32,
    high: f32,
}

impl Stretch {
    const PUPIL: Self = Self { low: -1.0, high: 1.0 };

    #[inline(always)]
    fn within(self, circle: &Circle) -> Self {
        Self { low: self.low.max(circle.x - circle.radius), high: self.high.min(circle.x + circle.radius) }
    }

    #[inline(always)]
    fn all_within(self, circles: &[Circle]) -> Self {
        circles.iter().fold(self, |stretch, circle| stretch.within(circle))
    }
}

/// Area that is in the pupil, in all `circles`, and in the dot if there is one.
#[inline(always)]
fn area(stretch: Stretch, circles: [&[Circle]; 2], dot: Option<&Behind>) -> Area {
    let (middle, half) = (0.5 * (stretch.low + stretch.high), 0.5 * (stretch.high - stretch.low));
    if half <= 0.0 {
        return Area::default();
    }
    let (mut low, mut high, mut x) = ([0.0_f32; LINES], [0.0_f32; LINES], [0.0_f32; LINES]);
    for line in 0..LINES {
        x[line] = middle + half * POSITIONS[line];
        high[line] = (1.0 - x[line] * x[line]).max(0.0).sqrt();
        low[line] = -high[line];
    }
    for circle in circles.into_iter().flatten() {
        for line in 0..LINES {
            let off = x[line] - circle.x;
            let chord = (circle.radius * circle.radius - off * off).max(0.0).sqrt();
            low[line] = low[line].max(circle.y - chord);
            high[line] = high[line].min(circle.y + chord);
        }
    }
    if let Some(dot) = dot {
        for line in 0..LINES {
            let (dot_low, dot_high) = dot.interval(x[line]);
            low[line] = low[line].max(dot_low);
            high[line] = high[line].min(dot_high);
        }
    }
    let mut area = Area::default();
    for line in 0..LINES {
        let length = WEIGHTS[line] * (high[line] - low[line]).max(0.0);
        area.share += length;
        area.x += length * x[line];
        area.y += length * 0.5 * (high[line] + low[line]);
    }
    let scale = half / PI;
    Area { share: area.share * scale, x: area.x * scale, y: area.y * scale }
}

/// A dot behind the pupil of a pencil, along lines across the first axis: `|g₀ + g₁ y| ≤ h₀ + h₁ y`.
struct Behind {
    start: [f32; 2],
    across: [f32; 2],
    along: [f32; 2],
    radius_px: f32,
    skew_across: f32,
    skew_along: f32,
}

impl Behind {
    /// At a place on the page, with the blur there and the direction of the first axis.
    #[inline(always)]
    fn at(local: &Local, du: f32, dv: f32, blur_px: f32, cos: f32, sin: f32) -> Self {
        let [[xx, xy], [yx, yy]] = local.inverse;
        let turn = |u: f32, v: f32| [xx * u + xy * v, yx * u + yy * v];
        let skew_across = local.skew[0] * cos + local.skew[1] * sin;
        let skew_along = local.skew[1] * cos - local.skew[0] * sin;
        Self {
            start: turn(du, dv),
            across: turn(blur_px * cos - skew_across * du, blur_px * sin - skew_across * dv),
            along: turn(-blur_px * sin - skew_along * du, blur_px * cos - skew_along * dv),
            radius_px: local.radius_px,
            skew_across,
            skew_along,
        }
    }

    /// The part of a line that lies in the dot; empty if none does.
    #[inline(always)]
    fn interval(&self, x: f32) -> (f32, f32) {
        let (g0x, g0y) = (self.start[0] + self.across[0] * x, self.start[1] + self.across[1] * x);
        let [g1x, g1y] = self.along;
        let (h0, h1) = (self.radius_px * (1.0 - self.skew_across * x), -self.radius_px * self.skew_along);
        let a = (g1x * g1x + g1y * g1y - h1 * h1).max(1e-12);
        let b = g0x * g1x + g0y * g1y - h0 * h1;
        let c = g0x * g0x + g0y * g0y - h0 * h0;
        let apart = b * b - a * c;
        let root = apart.max(0.0).sqrt();
        let per_a = 1.0 / a;
        (if apart > 0.0 { (-b - root) * per_a } else { 1e9 }, (-b + root) * per_a)
    }
}

/// Most points of a pixel at which the light is looked at.
const POINTS_MAX: usize = 8;

/// Points across an edge that stand for the square of a pixel.
struct Points {
    offset_px: [f32; POINTS_MAX],
    share: [f32; POINTS_MAX],
    count: usize,
}

impl Points {
    #[inline(always)]
    fn of(edge: &EdgeView) -> Self {
        let mut points = Self { offset_px: [0.0; POINTS_MAX], share: [1.0; POINTS_MAX], count: 3 };
        let blur_px = edge.blur_px.abs();
        if blur_px < SHARP_PX as f32 {
            // Midpoints under the trapezoid that the square's projection is.
            let (u, v) = (edge.normal_u.abs(), edge.normal_v.abs());
            let (outer, inner) = (0.5 * (u + v), 0.5 * (u - v).abs());
            let mut sum = 0.0;
            for point in 0..POINTS_MAX {
                let offset_px = outer * ((2 * point + 1) as f32 / POINTS_MAX as f32 - 1.0);
                points.offset_px[point] = offset_px;
                points.share[point] = ((outer - offset_px.abs()) / (outer - inner).max(1e-3)).min(1.0);
                sum += points.share[point];
            }
            points.share.iter_mut().for_each(|share| *share /= sum);
            points.count = POINTS_MAX;
        } else {
            let (step_px, side) = edge.pixel_points();
            points.offset_px[..3].copy_from_slice(&[-step_px, 0.0, step_px]);
            points.share[..3].copy_from_slice(&[side, 1.0 - 2.0 * side, side]);
        }
        points
    }
}

#[multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
fn cut_way(way: &Way, local: &Local, places: &Places, out: &mut Light) {
    for index in 0..places.len() {
        let (du, dv) = (places.du[index], places.dv[index]);
        let edge = EdgeView::at(local, du, dv);
        let (cos, sin) = (edge.normal_u, edge.normal_v);
        let cuts = way.at(du, dv, cos, sin);
        if cuts.shuts + cuts.limits == 0 {
            continue;
        }
        let rims = cuts.rims();
        let pupil = Stretch::PUPIL.all_within(rims);
        let mut open =
            if rims.is_empty() { Area { share: 1.0, x: 0.0, y: 0.0 } } else { area(pupil, [rims, &[]], None) };
        for shut in cuts.shut() {
            let shut = area(pupil.within(shut), [rims, std::slice::from_ref(shut)], None);
            open = Area { share: open.share - shut.share, x: open.x - shut.x, y: open.y - shut.y };
        }
        open.share = open.share.clamp(0.0, 1.0);
        out.open[index] = open.share;
        let depth_px = (1.0 - edge.q) * edge.px;
        let blur_px = edge.blur_px.abs();
        let far = depth_px.abs() > blur_px + PIXEL_REACH_PX;
        let passes = if far || blur_px < POINT_PX {
            // Where the light only just touches the pencil, its open part may lie to one side.
            let per_open = edge.blur_px / open.share.max(1e-3);
            let (x, y) = (open.x * per_open, open.y * per_open);
            let (u, v) = (cos * x - sin * y, sin * x + cos * y);
            let moved = out.light[index] - out.with_u[index] * u - out.with_v[index] * v;
            out.light[index] = open.share * moved.clamp(0.0, 1.0);
            open.share
        } else {
            let taken = taken(local, &edge, [du, dv], &cuts);
            let uncut = out.light[index].max(1e-6);
            out.light[index] = (out.light[index] - taken.light).max(0.0);
            out.with_blur[index] *= out.light[index] / uncut;
            taken.passes
        };
        out.with_u[index] *= passes;
        out.with_v[index] *= passes;
        out.with_radius[index] *= passes;
        if far || blur_px < POINT_PX {
            out.with_blur[index] *= open.share;
        }
    }
}

/// What the masks take of the light at the edge of a dot, and what they let pass of the edge itself.
struct Taken {
    light: f32,
    passes: f32,
}

#[inline(always)]
fn taken(local: &Local, edge: &EdgeView, place: [f32; 2], cuts: &Cuts) -> Taken {
    let rims = cuts.rims();
    let light = lit(local, edge, place, |lit, behind| {
        let mut share = 0.0;
        if !rims.is_empty() {
            let limited = area(lit.all_within(rims), [rims, &[]], Some(behind));
            share += area(lit, [&[], &[]], Some(behind)).share - limited.share;
        }
        for shut in cuts.shut() {
            let stretch = lit.all_within(rims).within(shut);
            share += area(stretch, [rims, std::slice::from_ref(shut)], Some(behind)).share;
        }
        share
    });
    Taken { light, passes: passes(edge, cuts) }
}

/// Mean over a pixel of what `share` makes of the stretch of the pupil that may see the dot, and of the dot behind it.
#[inline(always)]
fn lit(local: &Local, edge: &EdgeView, [du, dv]: [f32; 2], share: impl Fn(Stretch, &Behind) -> f32) -> f32 {
    let (cos, sin) = (edge.normal_u, edge.normal_v);
    let [[xx, xy], _] = local.inverse;
    let points = Points::of(edge);
    let mut light = 0.0;
    for point in 0..points.count {
        let offset_px = points.offset_px[point];
        let (u, v) = (du + offset_px * cos, dv + offset_px * sin);
        let blur_px = local.blur_px + local.blur_growth_px * (xx * u + xy * v) / local.radius_px;
        let behind = Behind::at(local, u, v, blur_px, cos, sin);
        // No line beyond the edge's tangent meets the dot.
        let reach = ((1.0 - edge.q) * edge.px - offset_px) / blur_px;
        let reach = reach + 0.01 * reach.abs() * blur_px.signum();
        let stretch = if blur_px > 0.0 {
            Stretch { high: reach.min(1.0), ..Stretch::PUPIL }
        } else {
            Stretch { low: reach.max(-1.0), ..Stretch::PUPIL }
        };
        light += points.share[point] * share(stretch, &behind);
    }
    light
}

/// The part of a dot's edge across a pencil that the masks leave in the light.
#[inline(always)]
fn passes(edge: &EdgeView, cuts: &Cuts) -> f32 {
    let x = (((1.0 - edge.q) * edge.px) / edge.blur_px).clamp(-0.99, 0.99);
    let half = (1.0 - x * x).sqrt();
    let chord = |circle: &Circle| {
        let off = x - circle.x;
        let chord = (circle.radius * circle.radius - off * off).max(0.0).sqrt();
        ((circle.y + chord).min(half) - (circle.y - chord).max(-half)).max(0.0)
    };
    let inside: f32 = cuts.rims().iter().map(|rim| 2.0 * half - chord(rim)).sum();
    let shut: f32 = cuts.shut().iter().map(chord).sum();
    (1.0 - 0.5 * (inside + shut) / half).clamp(0.0, 1.0)
}
