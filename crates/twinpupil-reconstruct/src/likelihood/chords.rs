//! Areas of the pupil by lines across it, for many samples side by side.
//!
//! Lines run along the nearest edge of the dot, so that the pupil's disc, a dot behind it and the circle of a mask each
//! cross a line in one interval. Coordinates are those of the unit disc, the first along the edge's normal.

use std::f32::consts::PI;
use std::sync::LazyLock;

use crate::likelihood::light::{EdgeView, Local, Places};
use crate::likelihood::sharp::depth;

/// Samples side by side.
pub(crate) const LANES: usize = 16;

/// A number for each of them.
pub(crate) type Lanes = [f32; LANES];

/// Lines across an area.
pub(crate) const LINES: usize = 16;

/// Where the lines lie from −1 to 1 and what they count, by the Gauss–Chebyshev rule of the second kind: areas end like
/// circles.
pub(crate) const POSITIONS: [f32; LINES] = [
    0.982_973_1,
    0.932_472_2,
    0.850_217_14,
    0.739_008_9,
    0.602_634_6,
    0.445_738_36,
    0.273_662_99,
    0.092_268_36,
    -0.092_268_36,
    -0.273_662_99,
    -0.445_738_36,
    -0.602_634_6,
    -0.739_008_9,
    -0.850_217_14,
    -0.932_472_2,
    -0.982_973_1,
];
const WEIGHTS: [f32; LINES] = [
    0.033_956_833,
    0.066_757_31,
    0.097_284_436,
    0.124_498_664,
    0.147_473_24,
    0.165_425_79,
    0.177_744_97,
    0.184_011_25,
    0.184_011_25,
    0.177_744_97,
    0.165_425_79,
    0.147_473_24,
    0.124_498_664,
    0.097_284_436,
    0.066_757_31,
    0.033_956_833,
];

/// Lines and their weights where a mask takes little.
#[inline(always)]
fn coarse_lines() -> impl Iterator<Item = [f32; 2]> {
    POSITIONS.into_iter().zip(WEIGHTS).map(<[f32; 2]>::from)
}

/// The same where it may take most, whose edge bends the lengths of the lines wherever it meets another.
static FINE_LINES: LazyLock<Vec<[f32; 2]>> = LazyLock::new(|| {
    const COUNT: usize = 64;
    let angle_rad = |line: usize| std::f64::consts::PI * (line + 1) as f64 / (COUNT + 1) as f64;
    let weight = std::f64::consts::PI / (COUNT + 1) as f64;
    (0..COUNT).map(|line| [angle_rad(line).cos() as f32, (weight * angle_rad(line).sin()) as f32]).collect()
});

/// Samples and the edge of the dot that is nearest to each.
pub(crate) struct Edges {
    pub(crate) du: Lanes,
    pub(crate) dv: Lanes,
    /// Outwards.
    pub(crate) normal_u: Lanes,
    pub(crate) normal_v: Lanes,
    /// Depth behind it straight towards the centre, and as a nearly sharp pixel feels it.
    pub(crate) straight_px: Lanes,
    pub(crate) depth_px: Lanes,
    pub(crate) blur_px: Lanes,
    /// See [`EdgeView`].
    pub(crate) curvature: Lanes,
    pub(crate) curvature_px: Lanes,
    pub(crate) per_gradient: Lanes,
    /// Distance and share of the points that stand for the squares of the pixels, see [`EdgeView::pixel_points`].
    pub(crate) point_px: Lanes,
    pub(crate) point_share: Lanes,
}

/// Circles of a mask's edge as each of the samples sees it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Circles {
    pub(crate) x: Lanes,
    pub(crate) y: Lanes,
    pub(crate) radius: f32,
    /// Movement of x with the place, outwards.
    pub(crate) per_px: f32,
}

/// A dot behind the pupil of each sample: `|g₀ + g₁ y| ≤ h₀ + h₁ y` on the line at x, with g₀ and h₀ linear in x.
///
/// On a surface that slopes, a pencil meets the dot as a central projection of the pupil. The dot's point e is imaged at
/// `p = (N e + (b + b′ e₁) w)/(1 + δ e₁)` through the point w of the pupil, where the image of the dot's centre is 0. Solved
/// for e, and seen from the centre of the outline, `a = p + δ N e₁`, with the blur B there and its growth `∇B = N⁻ᵀ e₁
/// (b′ − δ b)` the dot is, to first order in δ,
///
/// ```text
/// |N⁻¹ (a (1 + ∇B·w) − w (B + ∇B·a))| ≤ 1 + ∇B·w
/// ```
///
/// Here w is turned about, so that it counts along the image.
pub(crate) struct Dots {
    start: [Lanes; 2],
    across: [Lanes; 2],
    along: [Lanes; 2],
    radius_px: f32,
    growth_across: Lanes,
    growth_along: Lanes,
    /// The lines that may meet it.
    low: Lanes,
    high: Lanes,
}

impl Edges {
    /// Of samples with these indices; the last is repeated where there are fewer than lanes.
    #[inline(always)]
    pub(crate) fn of(local: &Local, places: &Places, indices: &[u32]) -> Self {
        let index = |lane: usize| indices[lane.min(indices.len() - 1)] as usize;
        let mut edges = Self {
            du: lanes(|lane| places.du[index(lane)]),
            dv: lanes(|lane| places.dv[index(lane)]),
            normal_u: [0.0; LANES],
            normal_v: [0.0; LANES],
            straight_px: [0.0; LANES],
            depth_px: [0.0; LANES],
            blur_px: [0.0; LANES],
            curvature: [0.0; LANES],
            curvature_px: [0.0; LANES],
            per_gradient: [0.0; LANES],
            point_px: [0.0; LANES],
            point_share: [0.0; LANES],
        };
        for lane in 0..LANES {
            let edge = EdgeView::at(local, edges.du[lane], edges.dv[lane]);
            (edges.normal_u[lane], edges.normal_v[lane]) = (edge.normal_u, edge.normal_v);
            (edges.straight_px[lane], edges.depth_px[lane]) = ((1.0 - edge.q) * edge.px, depth(&edge));
            (edges.blur_px[lane], edges.curvature_px[lane]) = (edge.blur_px, edge.curvature_px());
            edges.curvature[lane] = edge.curvature;
            edges.per_gradient[lane] = edge.per_gradient;
            (edges.point_px[lane], edges.point_share[lane]) = edge.pixel_points();
        }
        edges
    }
}

impl Dots {
    /// Seen from places that lie so far outwards of the samples.
    #[inline(always)]
    pub(crate) fn behind(local: &Local, edges: &Edges, outwards_px: &Lanes) -> Self {
        let ([[xx, xy], [yx, yy]], per_radius) = (local.inverse, 1.0 / local.radius_px);
        let mut dots = Self {
            start: [[0.0; LANES]; 2],
            across: [[0.0; LANES]; 2],
            along: [[0.0; LANES]; 2],
            radius_px: local.radius_px,
            growth_across: [0.0; LANES],
            growth_along: [0.0; LANES],
            low: [-1.0; LANES],
            high: [1.0; LANES],
        };
        for (lane, outwards_px) in outwards_px.iter().enumerate() {
            let (cos, sin) = (edges.normal_u[lane], edges.normal_v[lane]);
            let (u, v) = (outwards_px.mul_add(cos, edges.du[lane]), outwards_px.mul_add(sin, edges.dv[lane]));
            let turn = |u: f32, v: f32| [xx.mul_add(u, xy * v), yx.mul_add(u, yy * v)];
            let start = turn(u, v);
            let blur_px = (local.blur_growth_px * per_radius).mul_add(start[0], local.blur_px);
            let [growth_u, growth_v] = local.blur_gradient;
            let growth_across = growth_u.mul_add(cos, growth_v * sin);
            let growth_along = growth_v.mul_add(cos, -growth_u * sin);
            let across = turn(blur_px.mul_add(cos, -growth_across * u), blur_px.mul_add(sin, -growth_across * v));
            let along = turn(-blur_px.mul_add(sin, growth_along * u), blur_px.mul_add(cos, -growth_along * v));
            for axis in 0..2 {
                dots.start[axis][lane] = start[axis];
                dots.across[axis][lane] = across[axis];
                dots.along[axis][lane] = along[axis];
            }
            dots.growth_across[lane] = growth_across;
            dots.growth_along[lane] = growth_along;
            // No line beyond the edge's tangent meets the dot.
            let reach = (edges.straight_px[lane] - outwards_px) / blur_px;
            let reach = reach.abs().copysign(blur_px).mul_add(0.01, reach);
            dots.high[lane] = if blur_px > 0.0 { reach.min(1.0) } else { 1.0 };
            dots.low[lane] = if blur_px > 0.0 { -1.0 } else { reach.max(-1.0) };
        }
        dots
    }

    /// Narrows the intervals of the lines at x to what lies in the dots.
    #[inline(always)]
    fn narrow(&self, x: &Lanes, low: &mut Lanes, high: &mut Lanes) {
        let r = self.radius_px;
        for lane in 0..LANES {
            let x = x[lane];
            let g0 = [0, 1].map(|axis: usize| self.across[axis][lane].mul_add(x, self.start[axis][lane]));
            let g1 = [0, 1].map(|axis: usize| self.along[axis][lane]);
            let (h0, h1) = (r * self.growth_across[lane].mul_add(-x, 1.0), -r * self.growth_along[lane]);
            let a = g1[0].mul_add(g1[0], g1[1].mul_add(g1[1], -h1 * h1)).max(1e-12);
            let b = g0[0].mul_add(g1[0], g0[1].mul_add(g1[1], -h0 * h1));
            let c = g0[0].mul_add(g0[0], g0[1].mul_add(g0[1], -h0 * h0));
            let apart = b.mul_add(b, -a * c);
            let root = apart.max(0.0).sqrt();
            let per_a = 1.0 / a;
            low[lane] = low[lane].max(if apart > 0.0 { (-b - root) * per_a } else { 1e9 });
            high[lane] = high[lane].min((-b + root) * per_a);
        }
    }
}

/// Share of the pupils that lies in all `circles`, and in the dots if there are any.
#[inline(always)]
pub(crate) fn share(dots: Option<&Dots>, circles: &[Circles]) -> Lanes {
    let mut sum = [0.0; LANES];
    let half = cross(dots, circles, coarse_lines(), |_, low, high, weight| {
        for lane in 0..LANES {
            sum[lane] = weight.mul_add((high[lane] - low[lane]).max(0.0), sum[lane]);
        }
    });
    lanes(|lane| sum[lane] * half[lane] / PI)
}

/// First moments of what [`share`] measures, across the edge and along it, over the area of the pupil.
#[inline(always)]
pub(crate) fn moments(dots: Option<&Dots>, circles: &[Circles]) -> [Lanes; 2] {
    let (mut across, mut along) = ([0.0; LANES], [0.0; LANES]);
    let half = cross(dots, circles, coarse_lines(), |x, low, high, weight| {
        for lane in 0..LANES {
            let weighted = weight * (high[lane] - low[lane]).max(0.0);
            across[lane] += weighted * x[lane];
            along[lane] += weighted * 0.5 * (low[lane] + high[lane]);
        }
    });
    [across, along].map(|sum| lanes(|lane| sum[lane] * half[lane] / PI))
}

/// Share of the pupils within all rims and outside the shut circles, which lie apart, and in the dots if there are any.
#[inline(always)]
pub(crate) fn passing(dots: Option<&Dots>, shuts: &[Circles], rims: &[Circles]) -> Lanes {
    let mut sum = [0.0; LANES];
    let half = cross(dots, rims, FINE_LINES.iter().copied(), |x, low, high, weight| {
        let open = open_lengths(x, low, high, shuts, &[]);
        for lane in 0..LANES {
            sum[lane] += weight * open[lane];
        }
    });
    lanes(|lane| sum[lane] * half[lane] / PI)
}

/// Lengths of the lines at x, from low to high, within all rims and outside the shut circles, which lie apart.
#[inline(always)]
pub(crate) fn open_lengths(x: &Lanes, low: &Lanes, high: &Lanes, shuts: &[Circles], rims: &[Circles]) -> Lanes {
    let (mut low, mut high) = (*low, *high);
    for rim in rims {
        rim.narrow(x, &mut low, &mut high);
    }
    let mut open = lanes(|lane| (high[lane] - low[lane]).max(0.0));
    for shut in shuts {
        let chord = shut.chord(x);
        for lane in 0..LANES {
            let (y, chord) = (shut.y[lane], chord[lane]);
            open[lane] -= (high[lane].min(y + chord) - low[lane].max(y - chord)).max(0.0);
        }
    }
    lanes(|lane| open[lane].max(0.0))
}

/// Calls `add` for every line across what lies in all `circles` and in the dots, with where it begins and ends and with what
/// it counts, and returns half the width of that.
#[inline(always)]
fn cross(
    dots: Option<&Dots>,
    circles: &[Circles],
    lines: impl IntoIterator<Item = [f32; 2]>,
    mut add: impl FnMut(&Lanes, &Lanes, &Lanes, f32),
) -> Lanes {
    let (mut first, mut last) = dots.map_or(([-1.0; LANES], [1.0; LANES]), |dots| (dots.low, dots.high));
    for circle in circles {
        for lane in 0..LANES {
            first[lane] = first[lane].max(circle.x[lane] - circle.radius);
            last[lane] = last[lane].min(circle.x[lane] + circle.radius);
        }
    }
    let middle = lanes(|lane| 0.5 * (first[lane] + last[lane]));
    let half = lanes(|lane| (0.5 * (last[lane] - first[lane])).max(0.0));
    for [position, weight] in lines {
        let x = lanes(|lane| half[lane].mul_add(position, middle[lane]));
        let mut high = lanes(|lane| x[lane].mul_add(-x[lane], 1.0).max(0.0).sqrt());
        let mut low = lanes(|lane| -high[lane]);
        for circle in circles {
            circle.narrow(&x, &mut low, &mut high);
        }
        if let Some(dots) = dots {
            dots.narrow(&x, &mut low, &mut high);
        }
        add(&x, &low, &high, weight);
    }
    half
}

impl Circles {
    /// Moves to where they are seen from places so far outwards.
    #[inline(always)]
    pub(crate) fn step(&mut self, outwards_px: &Lanes) {
        for (x, outwards_px) in self.x.iter_mut().zip(outwards_px) {
            *x += self.per_px * outwards_px;
        }
    }

    /// Narrows the intervals of the lines at x to what lies in the circles.
    #[inline(always)]
    fn narrow(&self, x: &Lanes, low: &mut Lanes, high: &mut Lanes) {
        let chord = self.chord(x);
        for lane in 0..LANES {
            low[lane] = low[lane].max(self.y[lane] - chord[lane]);
            high[lane] = high[lane].min(self.y[lane] + chord[lane]);
        }
    }

    /// Half the length of the lines at x within the circles.
    #[inline(always)]
    pub(crate) fn chord(&self, x: &Lanes) -> Lanes {
        lanes(|lane| {
            let off = x[lane] - self.x[lane];
            off.mul_add(-off, self.radius * self.radius).max(0.0).sqrt()
        })
    }
}

/// The numbers that a function gives for the lanes.
#[inline(always)]
pub(crate) fn lanes(number: impl Fn(usize) -> f32) -> Lanes {
    let mut lanes = [0.0; LANES];
    for (lane, value) in lanes.iter_mut().enumerate() {
        *value = number(lane);
    }
    lanes
}

/// Numbers that do not fill the lanes, with zeros behind them.
#[inline(always)]
pub(crate) fn padded<const N: usize>(rest: &[f32]) -> [f32; N] {
    let mut lanes = [0.0; N];
    lanes.iter_mut().zip(rest).for_each(|(lane, number)| *lane = *number);
    lanes
}
