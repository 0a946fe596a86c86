//! A disc in or near focus: edges about as wide as a pixel, whose square shape then matters.

use multiversion::multiversion;

use crate::likelihood::light::{Each, EdgeView, Light, Local, Places, Point, fill_by};

/// Lines through the blur's disc: positions and shares of its light, by the Gauss–Chebyshev rule of the second kind,
/// whose weight is the length of the disc's chords.
const LINES: usize = 8;
const LINE_POSITIONS: [f32; LINES] =
    [0.939_692_6, 0.766_044_44, 0.5, 0.173_648_18, -0.173_648_18, -0.5, -0.766_044_44, -0.939_692_6];
const LINE_SHARES: [f32; LINES] =
    [0.025_995_062, 0.091_816_87, 0.166_666_67, 0.215_521_4, 0.215_521_4, 0.166_666_67, 0.091_816_87, 0.025_995_062];

/// Distance from an edge up to which its bend counts.
const NEAR_PX: f32 = 2.0;

/// Light of an edge that is nearly sharp.
///
/// At a depth d behind an edge with normal n the light is the edge's step averaged over the chords of the blur, and over
/// the square of the pixel, whose projection on n is a trapezoid. The edge's curvature κ moves the half-lit line inwards
/// by half the curvature times the mean square of both along the edge, `(b²/4 + 1/12) κ/2`.
struct Sharp<'a> {
    local: &'a Local,
}

/// Fills light and derivatives of a spot whose blur is below [`SHARP_PX`](crate::likelihood::light::SHARP_PX) everywhere.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
pub(crate) fn sharp(local: &Local, places: &Places, out: &mut Light) {
    fill_by(&Each(Sharp { local }), places, out);
}

impl Point for Sharp<'_> {
    #[inline(always)]
    fn seen(&self, du: f32, dv: f32) -> [f32; 5] {
        sharply(&EdgeView::outlined(self.local, du, dv))
    }
}

/// Light and its changes with u, v, radius and blur beside an edge that is nearly sharp.
#[inline(always)]
pub(crate) fn sharply(edge: &EdgeView) -> [f32; 5] {
    let (blur, depth) = (edge.blur_px.abs(), depth(edge));
    let pixel = Trapezoid::of(edge.normal_u.abs(), edge.normal_v.abs());
    let (mut light, mut density, mut with_lines) = (0.0, 0.0, 0.0);
    for line in 0..LINES {
        let (step, slope) = pixel.step(depth + blur * LINE_POSITIONS[line]);
        light += LINE_SHARES[line] * step;
        density += LINE_SHARES[line] * slope;
        with_lines += LINE_SHARES[line] * slope * LINE_POSITIONS[line];
    }
    [
        light,
        density * edge.normal_u,
        density * edge.normal_v,
        density * edge.per_gradient,
        with_lines.copysign(with_lines * edge.blur_px),
    ]
}

/// Depth behind the edge of a dot, px, as a nearly sharp pixel feels it.
#[inline(always)]
pub(crate) fn depth(edge: &EdgeView) -> f32 {
    let inwards = 0.5 * edge.curvature * (0.25 * edge.blur_px * edge.blur_px + 1.0 / 12.0);
    let straight = (1.0 - edge.q) * edge.px;
    straight - edge.bend() * (straight * straight).min(NEAR_PX * NEAR_PX) - inwards
}

/// The square of a pixel, projected on the normal of an edge.
pub(crate) struct Trapezoid {
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
    pub(crate) fn of(u: f32, v: f32) -> Self {
        const FLATTEST: f32 = 1e-3;
        let (long, short) = (u.max(v), u.min(v).max(FLATTEST));
        let fall = 1.0 / (long * short);
        Self { outer: 0.5 * (long + short), inner: 0.5 * (long - short), height: short * fall, fall }
    }

    /// Share of the pixel behind an edge that lies `depth` before its centre, and the change with the depth.
    #[inline(always)]
    pub(crate) fn step(&self, depth: f32) -> (f32, f32) {
        let size = depth.abs();
        let left = (self.outer - size).max(0.0);
        let tail = if size <= self.inner { 0.5 - size * self.height } else { 0.5 * left * left * self.fall };
        let density = if size <= self.inner { self.height } else { left * self.fall };
        (if depth > 0.0 { 1.0 - tail } else { tail }, density)
    }
}
