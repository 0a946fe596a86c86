//! A disc blurred by a disc: edges wider than a pixel.
//!
//! In units of the dot's radius, at a distance q from its centre and with a blur of radius β, the light is the share of
//! the blur's disc that lies in the dot: two circular sectors less a kite.
//!
//! ```text
//! I = (β² θ₂ + θ₁ − q y) / πβ²      ∂I/∂q = −2y/πβ²      ∂I/∂β = 2θ₂/πβ − 2I/β
//! ```
//!
//! with y half the chord that both circles share, seen from their centres under θ₁ and θ₂. Where the dot is
//! foreshortened, the blur is an ellipse to it; a nearly straight edge only feels how far that reaches across the edge,
//! so β is taken along the edge's normal.

use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, PI};

use multiversion::multiversion;

use crate::likelihood::cut::by_lines;
use crate::likelihood::light::{Each, EdgeView, Light, Local, Places, Point, SHARP_PX, fill_by};
use crate::likelihood::segment::{Conic, meeting};
use crate::likelihood::sharp::sharply;
use crate::likelihood::spot::Spot;

/// From this blur on the pixel is felt at the ends of the edge alone; where the conic counts, later.
pub(crate) const WIDE_PX: f64 = 2.5;
const SLANTED_WIDE_PX: f64 = 12.0;

/// Share of its radius by which the blur of a dot may reach across the edge at one end and along it at the other before
/// both have to be told apart.
const SLANTED: f64 = 0.012;

/// Smallest blur relative to the dot that the formulas bear.
const BETA_MIN: f32 = 1e-3;

/// Light whose pixels stand at three points across the edge.
struct Narrow;

/// The same, and that of sharper edges where the blur is below [`SHARP_PX`].
struct Focused;

/// Light whose blur is so wide that the pixel matters at the two ends of the edge only, where the profile is not smooth; see
/// [`reach`].
struct Wide;

/// Such light of a spot.
struct Round<'a, E>(&'a Local, E);

/// The same where the blur reaches so far around the ends of a foreshortened dot that only its conic tells it.
struct Slanted<'a, E>(&'a Local, E);

/// Fills light and derivatives of a spot.
pub(crate) fn soft(spot: &Spot, local: &Local, places: &Places, out: &mut Light) {
    let blur_px = spot.blur_px_min();
    // An outline that is more curved than the blur may cross the pupil's rim four times.
    let crosses_twice = spot.blur_px_max() < (1.0 - spot.foreshortening()).powi(2) * spot.radius_px;
    let is_slanted = is_slanted(spot) && places.closely;
    match is_slanted && crosses_twice {
        false if blur_px >= WIDE_PX => wide(local, places, out),
        false if blur_px >= SHARP_PX => narrow(local, places, out),
        false => focused(local, places, out),
        true if blur_px >= SLANTED_WIDE_PX => slanted_wide(local, places, out),
        true if blur_px >= SHARP_PX => slanted_narrow(local, places, out),
        true => slanted_focused(local, places, out),
    }
    if is_slanted && !crosses_twice {
        by_lines(local, places, out);
    }
}

/// Whether the blur reaches so far around the ends of a foreshortened dot that only its conic, or lines, tell the light.
pub(crate) fn is_slanted(spot: &Spot) -> bool {
    spot.foreshortening() * spot.blur_px_max() > SLANTED * spot.radius_px
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn narrow(local: &Local, places: &Places, out: &mut Light) {
    fill_by(&Each(Round(local, Narrow)), places, out);
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
pub(crate) fn wide(local: &Local, places: &Places, out: &mut Light) {
    fill_by(&Each(Round(local, Wide)), places, out);
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn focused(local: &Local, places: &Places, out: &mut Light) {
    fill_by(&Each(Round(local, Focused)), places, out);
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn slanted_focused(local: &Local, places: &Places, out: &mut Light) {
    fill_by(&Each(Slanted(local, Focused)), places, out);
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn slanted_narrow(local: &Local, places: &Places, out: &mut Light) {
    fill_by(&Each(Slanted(local, Narrow)), places, out);
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn slanted_wide(local: &Local, places: &Places, out: &mut Light) {
    fill_by(&Each(Slanted(local, Wide)), places, out);
}

/// Light at an edge.
trait Edged {
    /// Light and its changes with u, v, radius and blur.
    fn beside(&self, local: &Local, edge: &EdgeView) -> [f32; 5];
}

impl Edged for Narrow {
    #[inline(always)]
    fn beside(&self, local: &Local, edge: &EdgeView) -> [f32; 5] {
        let (step_px, side) = edge.pixel_points();
        let step = step_px * edge.per_px;
        let (q, beta) = nearest_part(edge);
        let (outer, middle, inner) =
            (Overlap::of(q + step, beta), Overlap::of(q, beta), Overlap::of((q - step).abs(), beta));
        let centre = 1.0 - 2.0 * side;
        let with_q = side.mul_add(outer.with_q + inner.with_q, centre * middle.with_q);
        let with_beta = side.mul_add(outer.with_beta + inner.with_beta, centre * middle.with_beta);
        let light = side.mul_add(outer.light + inner.light, centre * middle.light);
        changes(local, edge, Overlap { light, with_q, with_beta }, beta)
    }
}

impl Edged for Focused {
    #[inline(always)]
    fn beside(&self, local: &Local, edge: &EdgeView) -> [f32; 5] {
        let (soft, sharp) = (Narrow.beside(local, edge), sharply(edge));
        let mut seen = soft;
        // Chosen number by number: lanes must not part here.
        for (own, sharp) in seen.iter_mut().zip(sharp) {
            *own = if edge.blur_px.abs() < SHARP_PX as f32 { sharp } else { *own };
        }
        seen
    }
}

impl Edged for Wide {
    #[inline(always)]
    fn beside(&self, local: &Local, edge: &EdgeView) -> [f32; 5] {
        let square_px = local.square_px;
        let beta = (edge.blur_px.abs() * edge.per_px).max(BETA_MIN);
        let q = edge.q + edge.slanted(beta);
        // Across the edge in px: towards the dot from where the light begins, and outwards from where it is full.
        let (begins, ends) = ((1.0 + beta - q) * edge.px, (q - (1.0 - beta).abs()) * edge.px);
        let per_square = 1.0 / square_px;
        let (outer, outer_slope) = reach(begins * per_square);
        let (inner, inner_slope) = reach(ends * per_square);
        // Along the edge its curvature makes a step inwards of the square's extent, across it one outwards of about half of
        // that: the light changes by `y/q`, y² ∝ ((q + 1)² − β²)(β² − (q − 1)²).
        let gone = (q + beta.max(1.0)) / ((q + 1.0 + beta) * (q + (1.0 - beta).abs()));
        let inwards = (outer - inner) * square_px - begins + ends - gone * edge.curvature_px();
        let overlap = Overlap::of(q - inwards * edge.per_px, beta);
        // Where the blur is the larger the light ends nearer to the centre as it grows.
        let ends_slope = if beta > 1.0 { 2.0 - inner_slope } else { inner_slope };
        let with_beta = overlap.with_beta - overlap.with_q * (outer_slope - ends_slope);
        let with_q = overlap.with_q * (outer_slope + inner_slope - 1.0);
        changes(local, edge, Overlap { with_q, with_beta, ..overlap }, beta)
    }
}

/// Light and its changes with u, v, radius and blur.
#[inline(always)]
fn changes(local: &Local, edge: &EdgeView, Overlap { light, with_q, with_beta }: Overlap, beta: f32) -> [f32; 5] {
    let per_radius = 1.0 / local.radius_px;
    [
        light,
        -with_q * edge.gx * per_radius,
        -with_q * edge.gy * per_radius,
        -edge.q.mul_add(with_q, beta * with_beta) * per_radius,
        (with_beta * edge.per_px).copysign(with_beta * edge.blur_px),
    ]
}

impl<E: Edged> Point for Round<'_, E> {
    #[inline(always)]
    fn seen(&self, du: f32, dv: f32) -> [f32; 5] {
        let Self(local, kernel) = self;
        kernel.beside(local, &EdgeView::outlined(local, du, dv))
    }
}

impl<E: Edged> Point for Slanted<'_, E> {
    /// What the conic tells otherwise changes little across a pixel.
    #[inline(always)]
    fn seen(&self, du: f32, dv: f32) -> [f32; 5] {
        let Self(local, kernel) = self;
        let edge = EdgeView::outlined(local, du, dv);
        let mut seen = kernel.beside(local, &edge);
        let (q, beta) = nearest_part(&edge);
        let more = meeting(Conic::behind(local, &edge, [du, dv])) - Overlap::of(q, beta).light;
        let is_soft = edge.is_felt() & (edge.blur_px.abs() >= SHARP_PX as f32);
        seen[0] += if is_soft { more } else { 0.0 };
        seen
    }
}

/// Distance of a pixel's middle from the centre of the unit disc, and its blur there, as the nearest part of the edge has
/// them.
#[inline(always)]
fn nearest_part(edge: &EdgeView) -> (f32, f32) {
    let beta = (edge.blur_px.abs() * edge.per_px).max(BETA_MIN);
    // Along the edge, its curvature makes a step inwards of the pixel's extent.
    (edge.curvature_px().mul_add(edge.per_px, edge.q + edge.slanted(beta)), beta)
}

/// What [`soft`] would have in the middle of a pixel, were it a point, and did no conic tell it.
#[inline(always)]
pub(crate) fn in_the_middle(local: &Local, du: f32, dv: f32) -> f32 {
    let (q, beta) = nearest_part(&EdgeView::outlined(local, du, dv));
    Overlap::of(q, beta).light
}

/// Share of a disc of radius β, q from the centre of the unit disc, that lies in it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Overlap {
    pub(crate) light: f32,
    pub(crate) with_q: f32,
    pub(crate) with_beta: f32,
}

impl Overlap {
    #[inline(always)]
    pub(crate) fn of(q: f32, beta: f32) -> Self {
        let q = q.max(1e-6);
        let t = q - 1.0;
        let (beta2, q2) = (beta * beta, q * q);
        let kite = (q + 1.0).mul_add(q + 1.0, -beta2) * t.mul_add(-t, beta2);
        // 2 q times the half chord, and what lies between it and either centre.
        let chord = kite.max(0.0).sqrt();
        let (of_dot, of_blur) = (Octant::of(chord, q2 + (1.0 - beta2)), Octant::of(chord, t.mul_add(q + 1.0, beta2)));
        // One division for all.
        let inverse = 1.0 / (q * of_dot.long * of_blur.long);
        let per_q = inverse * of_dot.long * of_blur.long;
        let dot_angle = of_dot.angle(of_dot.short * inverse * q * of_blur.long);
        let blur_angle = of_blur.angle(of_blur.short * inverse * q * of_dot.long);
        let share = (1.0 / beta2) * FRAC_1_PI;
        let light = beta2.mul_add(blur_angle, chord.mul_add(-0.5, dot_angle)) * share;
        let with_beta = 2.0 * share * beta * light.mul_add(-PI, blur_angle);
        Self { light, with_q: -chord * per_q * share, with_beta }
    }
}

/// How far a pixel reaches into the light, on the average over its square, whose centre lies `depth` px behind the line
/// where the light begins; and the change with the depth.
///
/// There the light grows as h³ᐟ². The mean of that over the square, whichever way it is turned, is that of the reach:
/// nothing a pixel's half diagonal before the line, `h + 1/48h + …` far behind it, a fitted polynomial between.
#[inline(always)]
fn reach(depth: f32) -> (f32, f32) {
    const BEFORE: f32 = -0.72;
    const BEHIND: f32 = 1.2;
    const COEFFICIENTS: [f32; 9] = [
        0.168_966_32,
        0.560_940_6,
        0.426_018_13,
        -0.077_413_8,
        0.023_252_24,
        -0.129_168_42,
        -0.112_415_55,
        0.260_754_87,
        -0.100_013_86,
    ];
    let h = depth.clamp(BEFORE, BEHIND);
    let (mut near, mut near_slope) = (0.0_f32, 0.0_f32);
    for coefficient in COEFFICIENTS.iter().rev() {
        near_slope = near_slope.mul_add(h, near);
        near = near.mul_add(h, *coefficient);
    }
    let per_depth = 1.0 / depth.max(BEHIND);
    let far = depth + per_depth * (1.0 / 48.0 + 1.2e-4 * per_depth * per_depth);
    let far_slope = 1.0 - per_depth * per_depth * (1.0 / 48.0 + 3.6e-4 * per_depth * per_depth);
    let (value, slope) = if depth > BEHIND { (far, far_slope) } else { (near.max(0.0), near_slope.max(0.0)) };
    if depth < BEFORE { (0.0, 0.0) } else { (value, slope) }
}

/// A point (x, y), y ≥ 0, by its shorter and its longer coordinate.
#[derive(Debug, Clone, Copy)]
struct Octant {
    short: f32,
    long: f32,
    is_steep: bool,
    is_left: bool,
}

impl Octant {
    #[inline(always)]
    fn of(y: f32, x: f32) -> Self {
        /// So that products of the longer ones have an inverse.
        const LONG_MIN: f32 = 1e-12;
        let size = x.abs();
        Self { short: y.min(size), long: y.max(size).max(LONG_MIN), is_steep: y > size, is_left: x < 0.0 }
    }

    /// From 0 to π, given the shorter over the longer coordinate; 4·10⁻⁸ off at most.
    #[inline(always)]
    fn angle(&self, ratio: f32) -> f32 {
        let arc = arc_tangent(ratio);
        let first = if self.is_steep { FRAC_PI_2 - arc } else { arc };
        if self.is_left { PI - first } else { first }
    }
}

/// Angles of two points (x, y), y ≥ 0, from 0 to π, for one division.
#[inline(always)]
pub(crate) fn angles([first_y, second_y]: [f32; 2], [first_x, second_x]: [f32; 2]) -> [f32; 2] {
    let (first, second) = (Octant::of(first_y, first_x), Octant::of(second_y, second_x));
    let inverse = 1.0 / (first.long * second.long);
    [first.angle(first.short * second.long * inverse), second.angle(second.short * first.long * inverse)]
}

/// Arc tangent on 0 to 1: the polynomial of degree 15 whose largest error is least.
#[inline(always)]
fn arc_tangent(x: f32) -> f32 {
    const COEFFICIENTS: [f32; 8] = [
        0.999_999_33,
        -0.333_298_6,
        0.199_465_4,
        -0.139_085_22,
        0.096_419_63,
        -0.055_909_51,
        0.021_861_203,
        -0.004_054_124,
    ];
    let square = x * x;
    x * COEFFICIENTS.iter().rev().fold(0.0_f32, |sum, coefficient| sum.mul_add(square, *coefficient))
}
