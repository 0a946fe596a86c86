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

use std::f32::consts::{FRAC_PI_2, PI};

use multiversion::multiversion;

use crate::likelihood::light::{EdgeView, Light, Local, Places};

/// Smallest blur relative to the dot that the formulas bear.
const BETA_MIN: f32 = 1e-3;

/// Fills light and derivatives of a spot; a pixel's square stands at three points across the edge.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma", "x86_64+avx"))]
pub(crate) fn soft(local: &Local, places: &Places, out: &mut Light) {
    let count = places.edge;
    let (du, dv) = (&places.du[..count], &places.dv[..count]);
    let light = &mut out.light[..count];
    let (with_u, with_v) = (&mut out.with_u[..count], &mut out.with_v[..count]);
    let (with_radius, with_blur) = (&mut out.with_radius[..count], &mut out.with_blur[..count]);
    for index in 0..count {
        let edge = EdgeView::at(local, du[index] - local.skewed_px[0], dv[index] - local.skewed_px[1]);
        let (step_px, side) = edge.pixel_points();
        let step = step_px / edge.px;
        let (q, beta) = nearest_part(&edge);
        let (outer, middle, inner) =
            (Overlap::of(q + step, beta), Overlap::of(q, beta), Overlap::of((q - step).abs(), beta));
        let centre = 1.0 - 2.0 * side;
        let with_q = side * (outer.with_q + inner.with_q) + centre * middle.with_q;
        let with_beta = side * (outer.with_beta + inner.with_beta) + centre * middle.with_beta;
        light[index] = side * (outer.light + inner.light) + centre * middle.light;
        with_u[index] = -with_q * edge.gx / local.radius_px;
        with_v[index] = -with_q * edge.gy / local.radius_px;
        with_radius[index] = -(edge.q * with_q + beta * with_beta) / local.radius_px;
        with_blur[index] = (with_beta / edge.px).copysign(with_beta * edge.blur_px);
    }
}

/// Distance of a pixel's middle from the centre of the unit disc, and its blur there, as the nearest part of the edge has
/// them.
#[inline(always)]
fn nearest_part(edge: &EdgeView) -> (f32, f32) {
    let beta = (edge.blur_px.abs() / edge.px).max(BETA_MIN);
    // Along the edge, its curvature makes a step inwards of the pixel's extent.
    (edge.q + edge.curvature_px() / edge.px + edge.slanted(beta), beta)
}

/// What [`soft`] and [`wide`] would have in the middle of a pixel, were it a point.
#[inline(always)]
pub(crate) fn in_the_middle(local: &Local, du: f32, dv: f32) -> f32 {
    let edge = EdgeView::at(local, du - local.skewed_px[0], dv - local.skewed_px[1]);
    let (q, beta) = nearest_part(&edge);
    Overlap::of(q, beta).light
}

/// Fills light and derivatives of a spot whose blur is so wide that the pixel matters at the two ends of the edge only,
/// where the profile is not smooth; see [`reach`].
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma", "x86_64+avx"))]
pub(crate) fn wide(local: &Local, places: &Places, out: &mut Light) {
    let count = places.edge;
    let (du, dv) = (&places.du[..count], &places.dv[..count]);
    let light = &mut out.light[..count];
    let (with_u, with_v) = (&mut out.with_u[..count], &mut out.with_v[..count]);
    let (with_radius, with_blur) = (&mut out.with_radius[..count], &mut out.with_blur[..count]);
    for index in 0..count {
        let edge = EdgeView::at(local, du[index] - local.skewed_px[0], dv[index] - local.skewed_px[1]);
        let beta = (edge.blur_px.abs() / edge.px).max(BETA_MIN);
        // Across the edge in px: towards the dot from where the light begins, and outwards from where it is full.
        let q = edge.q + edge.slanted(beta);
        // Across the edge in px: towards the dot from where the light begins, and outwards from where it is full.
        let (begins, ends) = ((1.0 + beta - q) * edge.px, (q - (1.0 - beta).abs()) * edge.px);
        let (outer, outer_slope) = reach(begins);
        let (inner, inner_slope) = reach(ends);
        let inwards = outer - inner - begins + ends - edge.curvature_px();
        let overlap = Overlap::of(q - inwards / edge.px, beta);
        let with_beta = overlap.with_beta - overlap.with_q * (outer_slope - inner_slope);
        let with_q = overlap.with_q * (outer_slope + inner_slope - 1.0);
        light[index] = overlap.light;
        with_u[index] = -with_q * edge.gx / local.radius_px;
        with_v[index] = -with_q * edge.gy / local.radius_px;
        with_radius[index] = -(edge.q * with_q + beta * with_beta) / local.radius_px;
        with_blur[index] = (with_beta / edge.px).copysign(with_beta * edge.blur_px);
    }
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
        let (t, half_q) = (q - 1.0, 0.5 / q);
        let kite = ((q + 1.0) * (q + 1.0) - beta * beta) * (beta * beta - t * t);
        let y = kite.max(0.0).sqrt() * half_q;
        let dot_angle = angle(y, (q * q + 1.0 - beta * beta) * half_q);
        let blur_angle = angle(y, (q * q - 1.0 + beta * beta) * half_q);
        let share = 1.0 / (PI * beta * beta);
        let light = (beta * beta * blur_angle + dot_angle - q * y) * share;
        Self { light, with_q: -2.0 * y * share, with_beta: 2.0 * blur_angle * beta * share - 2.0 * light / beta }
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
    let (mut near, mut near_slope) = (0.0, 0.0);
    for coefficient in COEFFICIENTS.iter().rev() {
        near_slope = near_slope * h + near;
        near = near * h + coefficient;
    }
    let per_depth = 1.0 / depth.max(BEHIND);
    let far = depth + per_depth * (1.0 / 48.0 + 1.2e-4 * per_depth * per_depth);
    let far_slope = 1.0 - per_depth * per_depth * (1.0 / 48.0 + 3.6e-4 * per_depth * per_depth);
    let (value, slope) = if depth > BEHIND { (far, far_slope) } else { (near.max(0.0), near_slope.max(0.0)) };
    if depth < BEFORE { (0.0, 0.0) } else { (value, slope) }
}

/// Angle of the point (x, y), y ≥ 0, from 0 to π; 4·10⁻⁸ off at most.
#[inline(always)]
pub(crate) fn angle(y: f32, x: f32) -> f32 {
    let steep = y > x.abs();
    let ratio = y.min(x.abs()) / y.max(x.abs()).max(1e-30);
    let arc = arc_tangent(ratio);
    let first = if steep { FRAC_PI_2 - arc } else { arc };
    if x < 0.0 { PI - first } else { first }
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
    x * COEFFICIENTS.iter().rev().fold(0.0, |sum, coefficient| sum * square + coefficient)
}
