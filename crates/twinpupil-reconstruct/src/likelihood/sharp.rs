//! A disc in or near focus: edges about as wide as a pixel, whose square shape then matters.

use multiversion::multiversion;

use crate::likelihood::row::{Local, Row};

/// What the masks leave of the pencils of a row's pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Remains<'a> {
    /// Share of the pupil that is open.
    pub(crate) open: &'a [f32],
    /// Centroid of the open part, units of the pupil.
    pub(crate) x: &'a [f32],
    pub(crate) y: &'a [f32],
    /// Its extent relative to that of the open pupil.
    pub(crate) extent: &'a [f32],
}

/// Lines through the blur's disc: positions and shares of its light, by the Gauss–Chebyshev rule of the second kind,
/// whose weight is the length of the disc's chords.
const LINES: usize = 8;
const LINE_POSITIONS: [f32; LINES] =
    [0.939_692_6, 0.766_044_44, 0.5, 0.173_648_18, -0.173_648_18, -0.5, -0.766_044_44, -0.939_692_6];
const LINE_SHARES: [f32; LINES] =
    [0.025_995_06, 0.091_816_88, 0.166_666_67, 0.215_521_4, 0.215_521_4, 0.166_666_67, 0.091_816_88, 0.025_995_06];

/// Fills light and derivatives of a spot; `remains` is what the masks leave of the pencils, if they take something.
///
/// At a depth d behind an edge with normal n the light is the edge's step averaged over the chords of the blur, and over
/// the square of the pixel, whose projection on n is a trapezoid. The edge's curvature κ moves the half-lit line inwards
/// by half the curvature times the mean square of both along the edge, `(b²/4 + 1/12) κ/2`.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn sharp_row(local: &Local, remains: Option<Remains<'_>>, row: &mut Row) {
    let count = row.light.len();
    let (with_u, with_v) = (&mut row.with_u[..count], &mut row.with_v[..count]);
    let (with_radius, with_blur) = (&mut row.with_radius[..count], &mut row.with_blur[..count]);
    let [[xx, xy], [yx, yy]] = local.inverse;
    let determinant = xx * yy - xy * yx;
    let per_radius = 1.0 / local.radius_px;
    for index in 0..count {
        let (open, shift_x, shift_y, extent) = match &remains {
            Some(remains) => (remains.open[index], remains.x[index], remains.y[index], remains.extent[index]),
            None => (1.0, 0.0, 0.0, 1.0),
        };
        let du = local.du_px + local.step_px * index as f32 + local.blur_px * shift_x;
        let dv = local.dv_px + local.blur_px * shift_y;
        let (ex, ey) = ((xx * du + xy * dv) * per_radius, (yx * du + yy * dv) * per_radius);
        let q = (ex * ex + ey * ey).max(1e-12).sqrt();
        let (nx, ny) = (ex / q, ey / q);
        let (gx, gy) = (nx * xx + ny * yx, nx * xy + ny * yy);
        let per_gradient = 1.0 / (gx * gx + gy * gy).sqrt();
        let (normal_u, normal_v) = (gx * per_gradient, gy * per_gradient);
        let blur = local.blur_px.abs() * (1.0 + local.blur_slope * ex.clamp(-1.0, 1.0)) * extent;
        let curvature = per_radius * determinant * determinant * per_gradient * per_gradient * per_gradient;
        let inwards = 0.5 * curvature * (0.25 * blur * blur + 1.0 / 12.0);
        let depth = (1.0 - q) * per_gradient * local.radius_px - inwards;
        let pixel = Trapezoid::of(normal_u.abs(), normal_v.abs());
        let (mut light, mut density, mut with_lines) = (0.0, 0.0, 0.0);
        for line in 0..LINES {
            let (step, slope) = pixel.step(depth + blur * LINE_POSITIONS[line]);
            light += LINE_SHARES[line] * step;
            density += LINE_SHARES[line] * slope;
            with_lines += LINE_SHARES[line] * slope * LINE_POSITIONS[line];
        }
        row.light[index] = open * light;
        with_u[index] = open * density * normal_u;
        with_v[index] = open * density * normal_v;
        with_radius[index] = open * density * per_gradient;
        with_blur[index] = open * with_lines * extent * if local.blur_px < 0.0 { -1.0 } else { 1.0 };
    }
}

/// The square of a pixel, projected on the normal of an edge.
struct Trapezoid {
    /// Half its longer and its shorter side.
    outer: f32,
    inner: f32,
    /// Density between them.
    height: f32,
    /// Fall of the density beyond the inner half.
    fall: f32,
}

impl Trapezoid {
    /// From the sizes of the normal's components.
    #[inline(always)]
    fn of(u: f32, v: f32) -> Self {
        const FLATTEST: f32 = 1e-3;
        let (long, short) = (u.max(v), u.min(v).max(FLATTEST));
        Self {
            outer: 0.5 * (long + short),
            inner: 0.5 * (long - short),
            height: 1.0 / long,
            fall: 1.0 / (long * short),
        }
    }

    /// Share of the pixel behind an edge that lies `depth` before its centre, and the change with the depth.
    #[inline(always)]
    fn step(&self, depth: f32) -> (f32, f32) {
        let size = depth.abs();
        let left = (self.outer - size).max(0.0);
        let tail = if size <= self.inner { 0.5 - size * self.height } else { 0.5 * left * left * self.fall };
        let density = if size <= self.inner { self.height } else { left * self.fall };
        (if depth > 0.0 { 1.0 - tail } else { tail }, density)
    }
}
