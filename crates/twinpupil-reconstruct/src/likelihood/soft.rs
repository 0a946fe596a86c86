//! A disc blurred by a disc: edges much wider than a pixel.

use std::f32::consts::{FRAC_PI_2, PI};

use multiversion::multiversion;

use crate::likelihood::row::{Local, Row};

/// Fills light and derivatives of a spot whose pencils are not cut.
///
/// In units of the dot's radius, at a distance q from its centre and with a blur of radius β, the light is the share of
/// the blur's disc that lies in the dot: two circular sectors less a kite.
///
/// ```text
/// I = (β² θ₂ + θ₁ − q y) / πβ²      ∂I/∂q = −2y/πβ²      ∂I/∂β = 2θ₂/πβ − 2I/β
/// ```
///
/// with y half the chord that both circles share, seen from their centres under θ₁ and θ₂. Where the dot is
/// foreshortened, the blur is an ellipse to it; a straight edge only feels how far that reaches across the edge, so β is
/// taken along the edge's normal. The pixel is felt where the profile is not smooth, at the two ends of the edge; see
/// [`reach`].
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn soft_row(local: &Local, row: &mut Row) {
    let count = row.light.len();
    let (with_u, with_v) = (&mut row.with_u[..count], &mut row.with_v[..count]);
    let (with_radius, with_blur) = (&mut row.with_radius[..count], &mut row.with_blur[..count]);
    let [[xx, xy], [yx, yy]] = local.inverse;
    let per_radius = 1.0 / local.radius_px;
    let blur = local.blur_px.abs() * per_radius;
    for (index, light) in row.light.iter_mut().enumerate() {
        let du = local.du_px + local.step_px * index as f32;
        let (ex, ey) = ((xx * du + xy * local.dv_px) * per_radius, (yx * du + yy * local.dv_px) * per_radius);
        let q = (ex * ex + ey * ey).max(1e-12).sqrt();
        let (nx, ny) = (ex / q, ey / q);
        // Gradient of the distance over the unit disc with the pixel, times the radius.
        let (gx, gy) = (nx * xx + ny * yx, nx * xy + ny * yy);
        let growth = 1.0 + local.blur_slope * ex.clamp(-1.0, 1.0);
        let beta = blur * (gx * gx + gy * gy).sqrt() * growth;
        // Across the edge in px: towards the dot from where the light begins, and outwards from where it is full.
        let px = local.radius_px / (gx * gx + gy * gy).sqrt();
        let (outer, outer_slope) = reach((1.0 + beta - q) * px);
        let (inner, inner_slope) = reach((q - (1.0 - beta).abs()) * px);
        let curvature = per_radius / 24.0;
        let inwards = outer - inner - (1.0 + beta - q - q + (1.0 - beta).abs()) * px - curvature;
        let q = (q - inwards / px).max(1e-6);
        let (with_depth, with_reach) = (outer_slope + inner_slope - 1.0, outer_slope - inner_slope);
        let (t, half_q) = (q - 1.0, 0.5 / q);
        let kite = ((q + 1.0) * (q + 1.0) - beta * beta) * (beta * beta - t * t);
        let y = kite.max(0.0).sqrt() * half_q;
        let dot_angle = angle(y, (q * q + 1.0 - beta * beta) * half_q);
        let blur_angle = angle(y, (q * q - 1.0 + beta * beta) * half_q);
        let share = 1.0 / (PI * beta * beta);
        let value = (beta * beta * blur_angle + dot_angle - q * y) * share;
        let with_q = -2.0 * y * share;
        let with_beta = (2.0 * blur_angle * beta * share) - 2.0 * value / beta - with_q * with_reach;
        let with_q = with_q * with_depth;
        *light = value;
        with_u[index] = -with_q * gx * per_radius;
        with_v[index] = -with_q * gy * per_radius;
        with_radius[index] = -(q * with_q + beta * with_beta) * per_radius;
        with_blur[index] = with_beta * beta / local.blur_px;
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
fn angle(y: f32, x: f32) -> f32 {
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
