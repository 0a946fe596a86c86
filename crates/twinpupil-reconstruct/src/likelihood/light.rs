//! The light of a spot at places on the page, and how it changes with the spot.
//!
//! Products and sums of kernels are fused (`mul_add`): a tenth of the time of slanted edges. So all that calls them in loops has to be
//! made for processors that can fuse (`multiversion`); those that cannot call a function for it, and take several times as long.

use crate::likelihood::chords::{LANES, Lanes, padded};
use crate::likelihood::cut::{Meetings, cut};
use crate::likelihood::profile::Profiles;
use crate::likelihood::sharp::sharp;
use crate::likelihood::soft::soft;
use crate::likelihood::spot::{PIXEL_REACH_PX, Spot};

/// Centres of pixels from the outline's centre, px: first those that may feel the edge of the dot, up to `lit` those that
/// see nothing but the dot, then those that see none of it.
#[derive(Debug, Clone)]
pub(crate) struct Places {
    pub(crate) du: Vec<f32>,
    pub(crate) dv: Vec<f32>,
    pub(crate) edge: usize,
    pub(crate) lit: usize,
    /// Width of the square that a sample stands for, px: a pixel, or the square with the second moment of a block of them.
    pub(crate) square_px: f32,
    /// Whether the light has to be as near as can be: on the way to its place a dot is not helped by conics and lines.
    pub(crate) closely: bool,
}

/// Light in every pixel, relative to a pixel that sees only the dot through an open pupil, and its derivatives, per px; behind
/// them as much as fills the last [`LANES`], finite.
#[derive(Debug, Clone, Default)]
pub(crate) struct Light {
    pub(crate) light: Vec<f32>,
    /// With the centre's u and v.
    pub(crate) with_u: Vec<f32>,
    pub(crate) with_v: Vec<f32>,
    /// With the radius.
    pub(crate) with_radius: Vec<f32>,
    /// With the blur's radius.
    pub(crate) with_blur: Vec<f32>,
    /// Share of the pupil that is open.
    pub(crate) open: Vec<f32>,
    pub(crate) meetings: Meetings,
    /// Samples whose pencils masks leave more of on one side, where that counts.
    pub(crate) lopsided: Vec<u32>,
    /// Places on a page that bends, straightened.
    straight: Places,
}

/// Below this blur the pixel's square shapes the edge.
pub(crate) const SHARP_PX: f64 = 1.0;

/// What the kernels need of a spot.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Local {
    /// From px to the unit disc, without the radius.
    pub(crate) inverse: [[f32; 2]; 2],
    pub(crate) radius_px: f32,
    pub(crate) blur_px: f32,
    /// Growth of the blur to the end of the unit disc's first axis, px.
    pub(crate) blur_growth_px: f32,
    /// Growth of the blur along u and v.
    pub(crate) blur_gradient: [f32; 2],
    /// See [`Spot::skewed_px`].
    pub(crate) skewed_px: [f32; 2],
    /// See [`Places`].
    pub(crate) square_px: f32,
}

impl Default for Places {
    fn default() -> Self {
        Self { du: Vec::new(), dv: Vec::new(), edge: 0, lit: 0, square_px: 1.0, closely: true }
    }
}

impl Places {
    pub(crate) fn clear(&mut self) {
        self.du.clear();
        self.dv.clear();
        (self.edge, self.lit) = (0, 0);
    }

    /// Adds a pixel that may feel the edge.
    pub(crate) fn push(&mut self, du: f32, dv: f32) {
        self.du.push(du);
        self.dv.push(dv);
        (self.edge, self.lit) = (self.du.len(), self.du.len());
    }

    pub(crate) fn len(&self) -> usize {
        self.du.len()
    }
}

impl Light {
    /// Makes place for `count` pixels.
    pub(crate) fn resize(&mut self, count: usize) {
        let Self { light, with_u, with_v, with_radius, with_blur, open, .. } = self;
        for values in [light, with_u, with_v, with_radius, with_blur, open] {
            values.resize(count.next_multiple_of(LANES), 0.0);
        }
    }

    /// Makes place for pixels, of which those that do not feel the edge get all light or none.
    fn prepare(&mut self, places: &Places) {
        self.resize(places.len());
        self.open.fill(1.0);
        self.light[places.edge..places.lit].fill(1.0);
        self.light[places.lit..].fill(0.0);
        for values in [&mut self.with_u, &mut self.with_v, &mut self.with_radius, &mut self.with_blur] {
            values[places.edge..].fill(0.0);
        }
    }

    /// Becomes the light of a spot.
    pub(crate) fn fill(&mut self, spot: &Spot, places: &Places, profiles: &mut Profiles) {
        self.prepare(places);
        let mut straight = std::mem::take(&mut self.straight);
        let places = spot.straightened(places, &mut straight);
        let local = Local::of(spot, places);
        if Profiles::serves(spot, places) {
            profiles.fill(&local, places, self);
        } else if spot.blur_px_max() < SHARP_PX {
            sharp(&local, places, self);
        } else {
            soft(spot, &local, places, self);
        }
        if spot.is_clipped() {
            cut(spot, &local, places, self);
        }
        self.straight = straight;
    }
}

/// Light and its changes with u, v, radius and blur at places side by side that may feel the edge.
pub(crate) trait Kernel {
    fn lanes(&self, du: &Lanes, dv: &Lanes) -> [Lanes; 5];
}

/// The same at one place.
pub(crate) trait Point {
    fn seen(&self, du: f32, dv: f32) -> [f32; 5];
}

/// Light that is found place by place.
pub(crate) struct Each<P>(pub(crate) P);

impl<P: Point> Kernel for Each<P> {
    #[inline(always)]
    fn lanes(&self, du: &Lanes, dv: &Lanes) -> [Lanes; 5] {
        let [mut light, mut with_u, mut with_v, mut with_radius, mut with_blur] = [[0.0; LANES]; 5];
        for lane in 0..LANES {
            let seen = self.0.seen(du[lane], dv[lane]);
            [light[lane], with_u[lane], with_v[lane], with_radius[lane], with_blur[lane]] = seen;
        }
        [light, with_u, with_v, with_radius, with_blur]
    }
}

/// Fills light and derivatives wherever the edge may be felt; for functions that are made for the processor.
#[inline(always)]
pub(crate) fn fill_by(kernel: &impl Kernel, places: &Places, out: &mut Light) {
    let count = places.edge;
    let Light { light, with_u, with_v, with_radius, with_blur, .. } = out;
    let [(du, last_du), (dv, last_dv)] = [&places.du, &places.dv].map(|px| px[..count].as_chunks::<LANES>());
    let columns = [light, with_u, with_v, with_radius, with_blur].map(|column| column[..count].as_chunks_mut());
    let [(light, last_light), (with_u, last_u), (with_v, last_v), (with_radius, last_radius), (with_blur, last_blur)] =
        columns;
    for (chunk, (du, dv)) in du.iter().zip(dv).enumerate() {
        [light[chunk], with_u[chunk], with_v[chunk], with_radius[chunk], with_blur[chunk]] = kernel.lanes(du, dv);
    }
    if !last_du.is_empty() {
        let seen = kernel.lanes(&padded(last_du), &padded(last_dv));
        for (column, seen) in [last_light, last_u, last_v, last_radius, last_blur].into_iter().zip(&seen) {
            column.iter_mut().zip(seen).for_each(|(value, seen)| *value = *seen);
        }
    }
}

impl Local {
    pub(crate) fn of(spot: &Spot, places: &Places) -> Self {
        Self {
            inverse: spot.inverse.map(|row| row.map(|value| value as f32)),
            radius_px: spot.radius_px as f32,
            blur_px: spot.blur_px as f32,
            blur_growth_px: spot.blur_growth_px as f32,
            blur_gradient: spot.blur_gradient().map(|value| value as f32),
            skewed_px: spot.skewed_px().map(|value| value as f32),
            square_px: places.square_px,
        }
    }
}

/// Where a place lies to the edge of a dot, in units of its radius.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EdgeView {
    /// Distance from the centre.
    pub(crate) q: f32,
    /// Change of the distance with the pixel, times the radius.
    pub(crate) gx: f32,
    pub(crate) gy: f32,
    /// Direction of that.
    pub(crate) normal_u: f32,
    pub(crate) normal_v: f32,
    /// Pixels to the unit of distance, and units to a pixel: divisions cost most of what places do.
    pub(crate) px: f32,
    pub(crate) per_px: f32,
    /// Pixels to the unit of distance over the radius.
    pub(crate) per_gradient: f32,
    /// Blur at the nearest part of the edge, px; signed.
    pub(crate) blur_px: f32,
    /// Curvature of the edge there, 1/px.
    pub(crate) curvature: f32,
    /// See [`Places`].
    square_px: f32,
    /// To the unit disc the blur is an ellipse: how far it leans, and its square width along the edge over that across.
    lean: f32,
    stretch: f32,
}

impl EdgeView {
    #[inline(always)]
    pub(crate) fn at(local: &Local, du: f32, dv: f32) -> Self {
        let [[xx, xy], [yx, yy]] = local.inverse;
        let per_radius = 1.0 / local.radius_px;
        let (ex, ey) = (xx.mul_add(du, xy * dv) * per_radius, yx.mul_add(du, yy * dv) * per_radius);
        let q = ex.mul_add(ex, ey * ey).max(1e-12).sqrt();
        let per_q = 1.0 / q;
        // In the very middle every way leads out.
        let (nx, ny) = if q > 1e-5 { (ex * per_q, ey * per_q) } else { (1.0, 0.0) };
        let (gx, gy) = (nx.mul_add(xx, ny * yx), nx.mul_add(xy, ny * yy));
        let gradient = gx.mul_add(gx, gy * gy).sqrt();
        let per_gradient = 1.0 / gradient;
        // The same along the edge.
        let (hx, hy) = (nx.mul_add(yx, -ny * xx), nx.mul_add(yy, -ny * xy));
        let flatness = (xx * yy - xy * yx) * per_gradient;
        let lean = gx.mul_add(hx, gy * hy) * (per_gradient * per_gradient);
        Self {
            q,
            gx,
            gy,
            normal_u: gx * per_gradient,
            normal_v: gy * per_gradient,
            px: local.radius_px * per_gradient,
            per_px: per_radius * gradient,
            per_gradient,
            blur_px: local.blur_growth_px.mul_add(ex.clamp(-1.0, 1.0), local.blur_px),
            curvature: flatness * flatness * per_gradient * per_radius,
            square_px: local.square_px,
            lean,
            stretch: hx.mul_add(hx, hy * hy).mul_add(per_gradient * per_gradient, -lean * lean),
        }
    }

    /// As the outline has it, which is skewed where the dot is foreshortened.
    #[inline(always)]
    pub(crate) fn outlined(local: &Local, du: f32, dv: f32) -> Self {
        Self::at(local, du - local.skewed_px[0], dv - local.skewed_px[1])
    }

    /// Whether a sample feels the edge, straight towards the centre.
    #[inline(always)]
    pub(crate) fn is_felt(&self) -> bool {
        let depth_px = (1.0 - self.q) * self.px;
        let depth_px = depth_px / (1.0 + self.bend() * depth_px.max(0.0));
        depth_px.abs() < self.blur_px.abs() + PIXEL_REACH_PX as f32 * self.square_px
    }

    /// How much farther in an edge of the unit disc seems where the dot is foreshortened, so that the blur is an ellipse
    /// to it, and not the disc of radius β that reaches as far across the edge.
    ///
    /// At a distance x across the edge the blur lies at y along it, and there the edge has gone in by y²/2. Of an ellipse
    /// that leans by ρ, with a half width h along the edge in its middle, and of a disc:
    ///
    /// ```text
    /// ⟨y²⟩ = ρ² x² + h² (1 − x²/β²)/3        ⟨y²⟩ = β² (1 − x²/β²)/3
    /// ```
    #[inline(always)]
    pub(crate) fn slanted(&self, beta: f32) -> f32 {
        let x2 = (self.q - 1.0) * (self.q - 1.0);
        let per_beta2 = 1.0 / (beta * beta);
        let middle = x2.mul_add(-per_beta2, 1.0).max(0.0) * (1.0 / 3.0);
        let leant = self.lean * self.lean * x2.min(beta * beta);
        0.5 * (beta * beta * (self.stretch - 1.0)).mul_add(middle, leant)
    }

    /// How far in the curvature of the edge lets it seem, on the average along a sample's square, px.
    #[inline(always)]
    pub(crate) fn curvature_px(&self) -> f32 {
        self.curvature * (1.0 / 24.0) * (self.square_px * self.square_px)
    }

    /// How much nearer to the edge a place is than `(1 − q)` pixels times the gradient, over the square of that, 1/px: the
    /// nearest part of a foreshortened edge does not lie straight outwards from the centre.
    #[inline(always)]
    pub(crate) fn bend(&self) -> f32 {
        0.5 * self.lean * self.lean * self.per_px
    }

    /// Across the square of a sample: distance of the two points and their shares that together with a third, in the
    /// middle, have the second and the fourth moment of its projection.
    #[inline(always)]
    pub(crate) fn pixel_points(&self) -> (f32, f32) {
        // From 0.15 along a row to 0.2 along a diagonal: series about the middle tell its root and its inverse.
        const MIDDLE: f32 = 0.175;
        const MIDDLE_ROOT: f32 = 0.418_33;
        let (uu, vv) = (self.normal_u * self.normal_u, self.normal_v * self.normal_v);
        // 12 ((u⁴ + v⁴)/80 + u²v²/24), and u² + v² = 1.
        let x = (uu * vv).mul_add(0.2 / MIDDLE, 0.15 / MIDDLE - 1.0);
        let root = x.mul_add(x.mul_add(x.mul_add(x.mul_add(-0.039_062_5, 0.0625), -0.125), 0.5), 1.0);
        let inverse = x.mul_add(x.mul_add(x.mul_add(x.mul_add(x.mul_add(-1.0, 1.0), -1.0), 1.0), -1.0), 1.0);
        (MIDDLE_ROOT * root * self.square_px, inverse * (1.0 / (24.0 * MIDDLE)))
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{Instrument, paper};

    use super::*;
    use crate::likelihood::blocks::square_px;
    use crate::likelihood::pencil::Pencil;
    use crate::likelihood::spot::{Dot, Raster};

    const F_MM: f64 = 100.0;
    const L_MM: f64 = 151.0;
    const PITCH_MM: f64 = 0.00586;
    const AXIS_PX: [f64; 2] = [959.5, 599.5];
    const STOP_MM: f64 = 40.0;
    const PAPERS_STOP_MM: f64 = 8.0;

    /// Below this blur sums run over the pupil first.
    const PUPIL_FIRST_PX: f64 = 1.2;

    /// Gauss–Legendre rules of 4 and 8 points: places from 0 to 1 and weights of half the rule.
    const FOUR: [[f64; 2]; 2] =
        [[0.339_981_043_584_856, 0.652_145_154_862_546], [0.861_136_311_594_053, 0.347_854_845_137_454]];
    const EIGHT: [[f64; 2]; 4] = [
        [0.183_434_642_495_65, 0.362_683_783_378_362],
        [0.525_532_409_916_329, 0.313_706_645_877_887],
        [0.796_666_477_413_627, 0.222_381_034_453_374],
        [0.960_289_856_497_536, 0.101_228_536_290_376],
    ];

    /// A whole rule on −½ to ½.
    fn gauss(half: &[[f64; 2]]) -> Vec<[f64; 2]> {
        half.iter().flat_map(|[x, w]| [[0.5 * x, 0.5 * w], [-0.5 * x, 0.5 * w]]).collect()
    }

    /// Angles between 0 and π of lines across the disc: their positions are the cosines, half their lengths the sines.
    fn lines(count: usize) -> impl Iterator<Item = (f64, f64)> {
        let angle_rad = move |line: usize| std::f64::consts::PI * (line as f64 + 0.5) / count as f64;
        (0..count).map(move |line| (angle_rad(line).cos(), angle_rad(line).sin()))
    }

    /// The light of a dot in one band of the paper's camera, ray by ray.
    struct Exact<'a> {
        dot: &'a Dot,
        band: usize,
        blur_px: f64,
        is_clipped: bool,
        /// Radius of the stop.
        stop_mm: f64,
    }

    impl Exact<'_> {
        fn image_mm([u_px, v_px]: [f64; 2]) -> [f64; 2] {
            [(u_px - AXIS_PX[0]) * PITCH_MM, (v_px - AXIS_PX[1]) * PITCH_MM]
        }

        /// Where a ray through w of the pupil's unit disc meets the lens.
        fn lens(&self, p: f64, w: f64) -> f64 {
            if self.band == 0 { (0.5 * w + p * F_MM / L_MM) / (1.0 - F_MM / L_MM) } else { w }
        }

        /// Distance from the dot's edge in its plane, negative within, times what makes of that a quadratic in p and w.
        fn outside(&self, p: [f64; 2], w: [f64; 2]) -> f64 {
            let ([x0, y0, z0], [sx, sy]) = (self.dot.centre_mm, self.dot.slopes);
            let [ax, ay] = [0, 1].map(|k| self.lens(p[k], w[k]));
            let slope = |a: f64, p: f64| a * (1.0 / L_MM - 1.0 / F_MM) + p / L_MM;
            let (nx, ny) = (slope(ax, p[0]), slope(ay, p[1]));
            let steepness = 1.0 - sx * nx - sy * ny;
            let z = (z0 + sx * (ax - x0) + sy * (ay - y0)) / steepness;
            let (dx, dy, dz) = (ax + nx * z - x0, ay + ny * z - y0, z - z0);
            (dx * dx + dy * dy + dz * dz - 0.25 * self.dot.diameter_mm * self.dot.diameter_mm) * steepness * steepness
        }

        /// Where a quadratic is negative between −h and h.
        fn within(h: f64, g: impl Fn(f64) -> f64) -> [f64; 2] {
            let (gm, g0, gp) = (g(-h), g(0.0), g(h));
            let (a, b) = ((gp + gm - 2.0 * g0) / (2.0 * h * h), (gp - gm) / (2.0 * h));
            if a < 1e-14 {
                return if g0 > 0.0 { [0.0, 0.0] } else { [-h, h] };
            }
            let root = (b * b - 4.0 * a * g0).max(0.0).sqrt();
            [-root, root].map(|root| ((root - b) / (2.0 * a)).clamp(-h, h))
        }

        /// The part of the line at x, from −h to h, that the other band's disc shuts for the image point p.
        fn shut(&self, p: [f64; 2], x: f64, h: f64) -> [f64; 2] {
            // Band 0 passes beyond 1 on the lens, band 1 beyond 0.5 in the focal plane.
            let (per_image, radius) = if self.band == 0 {
                (-F_MM / L_MM / 0.5, (1.0 - F_MM / L_MM) / 0.5)
            } else {
                (F_MM / L_MM / (1.0 - F_MM / L_MM), 0.5 / (1.0 - F_MM / L_MM))
            };
            let half = (radius * radius - (x - per_image * p[0]).powi(2)).max(0.0).sqrt();
            [-half, half].map(|half| (per_image * p[1] + half).clamp(-h, h))
        }

        /// The part of the line at x, from −h to h, that the stop leaves.
        fn stopped(&self, p: [f64; 2], x: f64, h: f64) -> [f64; 2] {
            let height = |p: f64, w: f64| {
                let lens = self.lens(p, w);
                lens - (p + lens) * STOP_MM / L_MM
            };
            let outside = |y: f64| height(p[0], x).powi(2) + height(p[1], y).powi(2) - self.stop_mm.powi(2);
            Self::within(h, outside)
        }

        /// Share of the pencil of an image point that is open and, if asked, meets the dot.
        fn pencil(&self, p: [f64; 2], count: usize, dot: bool) -> f64 {
            let line = |(x, h): (f64, f64)| {
                let [first, last] = self.stopped(p, x, h);
                let [low, high] = if dot { Self::within(h, |y| self.outside(p, [x, y])) } else { [-h, h] };
                let (low, high) = (low.max(first), high.min(last));
                let [shut_low, shut_high] = self.shut(p, x, h);
                (high - low - (high.min(shut_high) - low.max(shut_low)).max(0.0)).max(0.0) * h
            };
            lines(count).map(line).sum::<f64>() / count as f64
        }

        fn open(&self, pixel: [f64; 2]) -> f64 {
            self.pencil(Self::image_mm(pixel), 400, false)
        }

        fn light(&self, pixel: [f64; 2]) -> f64 {
            if self.blur_px < PUPIL_FIRST_PX { self.pupil_first(pixel) } else { self.pixel_first(pixel) }
        }

        fn pixel_first(&self, [u_px, v_px]: [f64; 2]) -> f64 {
            let (places, count) = if self.is_clipped { (gauss(&FOUR), 240) } else { (gauss(&EIGHT), 80) };
            let column = |[x, wx]: &[f64; 2]| -> f64 {
                let row = |[y, wy]: &[f64; 2]| wx * wy * self.pencil(Self::image_mm([u_px + x, v_px + y]), count, true);
                places.iter().map(row).sum()
            };
            places.iter().map(column).sum()
        }

        /// Every ray of the pupil by itself: what it shows of the pixel is found line by line.
        fn pupil_first(&self, pixel: [f64; 2]) -> f64 {
            const CHORDS: usize = 48;
            let mut sum = 0.0;
            for (x, h) in lines(CHORDS) {
                let [shut_low, shut_high] = self.shut(Self::image_mm(pixel), x, h);
                let [first, last] = self.stopped(Self::image_mm(pixel), x, h);
                for (low, high) in [(first, shut_low.min(last)), (shut_high.max(first), last)] {
                    for [place, weight] in gauss(&FOUR) {
                        let y = 0.5 * (low + high) + place * (high - low);
                        sum += weight * (high - low) * h / CHORDS as f64 * self.pixel_share(pixel, [x, y]);
                    }
                }
            }
            sum
        }

        /// Share of a pixel that a point of the pupil sees on the dot.
        fn pixel_share(&self, [u_px, v_px]: [f64; 2], w: [f64; 2]) -> f64 {
            const ROWS: usize = 24;
            let g = |u: f64, v: f64| self.outside(Self::image_mm([u_px + u, v_px + v]), w);
            let along_v = (g(0.0, 0.5) - g(0.0, -0.5)).abs() > (g(0.5, 0.0) - g(-0.5, 0.0)).abs();
            let row = |row: usize| {
                let s = (row as f64 + 0.5) / ROWS as f64 - 0.5;
                let [low, high] = Self::within(0.5, |t| if along_v { g(s, t) } else { g(t, s) });
                high - low
            };
            (0..ROWS).map(row).sum::<f64>() / ROWS as f64
        }
    }

    /// What the model's errors do to a fitted number, and the deviation that noise gives it.
    #[derive(Debug, Clone, Copy)]
    struct Bias {
        px: f64,
        std_px: f64,
    }

    /// Of u, v, radius and blur at 20 000 electrons in every pixel; one of `stride` pixels of as many lines is looked at.
    fn biases(dot: &Dot, band: usize, stride: usize) -> [Bias; 4] {
        biases_of_blocks(dot, band, stride, 1, PAPERS_STOP_MM)
    }

    /// The same where means of `grain × grain` pixels of every other column and row are looked at, behind a stop of this radius.
    fn biases_of_blocks(dot: &Dot, band: usize, stride: usize, grain: usize, stop_mm: f64) -> [Bias; 4] {
        const STEP_PX: usize = 2;
        use nalgebra::{Matrix6, Vector6};
        let mut spec = paper::instrument().into_spec();
        spec.apertures[2].zones[0].radius_mm = Some(stop_mm);
        let instrument = Instrument::new(spec).unwrap();
        let pencil = Pencil::of_band(&instrument, &instrument.bands[band], F_MM);
        let spot = Spot::of(dot, &pencil, Raster { axis_px: AXIS_PX, pitch_mm: PITCH_MM }, None);
        let exact = Exact { dot, band, blur_px: spot.blur_px_min(), is_clipped: spot.is_clipped(), stop_mm };
        let reach = spot.reach_px().ceil() + 3.0;
        let (mut information, mut score) = (Matrix6::zeros(), Vector6::zeros());
        let [first_u, first_v] = spot.centre_px.map(|centre_px| (centre_px - reach).floor());
        let lines = || (0..(2.0 * reach) as usize).step_by(stride).map(|line| line as f64);
        let pixels: Vec<[f64; 2]> = lines().flat_map(|v| lines().map(move |u| [first_u + u, first_v + v])).collect();
        let mut places = Places { square_px: square_px(grain, STEP_PX) as f32, ..Places::default() };
        for [u_px, v_px] in &pixels {
            places.push((u_px - spot.centre_px[0]) as f32, (v_px - spot.centre_px[1]) as f32);
        }
        let mut row = Light::default();
        row.fill(&spot, &places, &mut Profiles::default());
        let offset_px = |k: usize| STEP_PX as f64 * (k as f64 - 0.5 * (grain - 1) as f64);
        let block =
            |[u, v]: [f64; 2]| (0..grain * grain).map(move |k| [u + offset_px(k % grain), v + offset_px(k / grain)]);
        let mean =
            |pixel: [f64; 2], of: &dyn Fn([f64; 2]) -> f64| block(pixel).map(of).sum::<f64>() / (grain * grain) as f64;
        for (k, pixel) in pixels.into_iter().enumerate() {
            let light = f64::from(row.light[k]);
            // Far from the edge all or nothing of the open pencil is lit.
            let open = mean(pixel, &|pixel| exact.open(pixel));
            let flat = if light > 0.5 * open { open } else { 0.0 };
            let expected = if row.with_radius[k] == 0.0 { flat } else { mean(pixel, &|pixel| exact.light(pixel)) };
            let jacobian = Vector6::from_iterator(
                [row.with_u[k], row.with_v[k], row.with_radius[k], row.with_blur[k], row.light[k], row.open[k]]
                    .map(f64::from),
            );
            let weight = (20_000.0 * stride as f64).powi(2) / (52.0 + 20_000.0 * light);
            information += jacobian * jacobian.transpose() * weight;
            score += jacobian * ((expected - light) * weight);
        }
        let covariance = information.try_inverse().unwrap();
        let step = covariance * score;
        [0, 1, 2, 3].map(|k| Bias { px: step[k], std_px: covariance[(k, k)].sqrt() })
    }

    #[test]
    fn blocks_bias_no_unknown() {
        const SIGMAS_MAX: f64 = 4.5;
        let mut report = Vec::new();
        for z_mm in [250.0, 340.0] {
            for centre_mm in [[4.0, -3.0, z_mm], [1.76, -1.32, z_mm]] {
                for (slopes, band) in [([0.0; 2], 0), ([0.0; 2], 1), ([0.2, -0.1], 0), ([0.2, -0.1], 1)] {
                    let dot = Dot { centre_mm, diameter_mm: 1.0, slopes };
                    for grain in if band == 0 { 2..4 } else { 2..3 } {
                        let biases = biases_of_blocks(&dot, band, 5, grain, PAPERS_STOP_MM);
                        let bias = biases.map(|bias| bias.px / bias.std_px);
                        if bias.iter().any(|bias| bias.abs() > SIGMAS_MAX) {
                            report.push(format!("{centre_mm:?} {slopes:.2?} {band} {grain}: {bias:.2?}"));
                        }
                    }
                }
            }
        }
        assert!(report.is_empty(), "\n{}", report.join("\n"));
    }

    #[test]
    fn images_on_sloping_surfaces_are_not_shifted() {
        const PX_MAX: f64 = 4e-4;
        for z_mm in [314.0, 340.0] {
            // Narrow and wide blur: the one along the edge's normal, the other by lines across the pupil.
            let dot = Dot { centre_mm: [4.0, 2.5, z_mm], diameter_mm: 0.9, slopes: [0.0, -0.53] };
            let [u, v, ..] = biases(&dot, 1, 1);
            assert!(u.px.abs() < PX_MAX && v.px.abs() < PX_MAX, "{z_mm}: {u:?} {v:?}");
        }
    }

    /// Many dots of a target tell the radius of a mask to some 10⁻⁵ of it.
    #[test]
    fn no_blur_seems_too_wide_or_too_narrow() {
        const SHARE_MAX: f64 = 2e-4;
        const MEAN_MAX: f64 = 2.5e-5;
        let distances_mm = [256.0, 266.0, 276.0, 284.0, 312.0, 318.0, 328.0, 338.0];
        for slopes in [[0.0; 2], [0.5, -0.2]] {
            let share = |z_mm: f64| {
                let dot = Dot { centre_mm: [4.0, 2.5, z_mm], diameter_mm: 0.9, slopes };
                let blur_px = 0.5 * (L_MM + (1.0 - L_MM / F_MM) * z_mm) / F_MM / PITCH_MM;
                biases(&dot, 0, 3)[3].px / blur_px
            };
            let shares = distances_mm.map(share);
            let mean = shares.iter().sum::<f64>() / shares.len() as f64;
            assert!(mean.abs() < MEAN_MAX, "{slopes:?}: {mean} {shares:?}");
            assert!(shares.iter().all(|share| share.abs() < SHARE_MAX), "{slopes:?}: {shares:?}");
        }
    }

    #[test]
    fn a_stop_that_cuts_pencils_biases_no_unknown() {
        const NARROW_MM: f64 = 4.5;
        const SIGMAS_MAX: f64 = 4.0;
        let mut report = Vec::new();
        for z_mm in [250.0, 297.5, 303.0, 312.0, 340.0] {
            for (r_mm, slopes) in [(5.6, [0.0; 2]), (6.4, [0.2, -0.1]), (7.2, [0.0; 2])] {
                let dot = Dot { centre_mm: [0.8 * r_mm, -0.6 * r_mm, z_mm], diameter_mm: 1.0, slopes };
                let bias = biases_of_blocks(&dot, 0, 3, 1, NARROW_MM).map(|bias| bias.px / bias.std_px);
                if !bias.iter().all(|bias| bias.abs() < SIGMAS_MAX) {
                    report.push(format!("z {z_mm}, r {r_mm}, {slopes:.2?}: {bias:.2?}"));
                }
            }
        }
        assert!(report.is_empty(), "\n{}", report.join("\n"));
    }

    #[test]
    fn the_light_biases_no_unknown() {
        // Of the deviations that 20 000 electrons in every pixel give.
        const SIGMAS_MAX: f64 = 4.5;
        let slopes = |tilt_deg: f64, azimuth_deg: f64| {
            let (sin, cos) = azimuth_deg.to_radians().sin_cos();
            [cos, sin].map(|part| part * tilt_deg.to_radians().tan())
        };
        let far = |z_mm: f64| [4.0, -3.0, z_mm];
        let near = |z_mm: f64| [1.76, -1.32, z_mm];
        let mut cases =
            vec![(far(250.0), [0.0; 2]), (far(350.0), [0.0; 2]), (near(250.0), [0.0; 2]), (near(350.0), [0.0; 2])];
        for z_mm in [290.0, 296.5, 297.5, 303.0, 312.0] {
            for centre_mm in [far(z_mm), near(z_mm)] {
                let tilts = [slopes(0.0, 0.0), slopes(45.0, 90.0), slopes(60.0, 0.0), slopes(60.0, 225.0)];
                cases.extend(tilts.map(|slopes| (centre_mm, slopes)));
            }
        }
        let mut report = Vec::new();
        for (centre_mm, slopes) in cases {
            for band in [0, 1] {
                let biases = biases(&Dot { centre_mm, diameter_mm: 1.0, slopes }, band, 3);
                let bias = biases.map(|bias| bias.px / bias.std_px);
                if bias.iter().any(|bias| bias.abs() > SIGMAS_MAX) {
                    report.push(format!("{centre_mm:?} {slopes:.2?} {band}: {bias:.2?}"));
                }
            }
        }
        assert!(report.is_empty(), "\n{}", report.join("\n"));
    }

    /// How far the derivatives of the light are from its differences, over those, root mean square over the pixels.
    fn derivative_errors(spot: &Spot) -> [f64; 4] {
        const STEP_PX: f64 = 0.05;
        let reach = spot.reach_px().ceil() as i32;
        let pixels: Vec<[f64; 2]> = (-reach..reach)
            .step_by(2)
            .flat_map(|v| (-reach..reach).step_by(2).map(move |u| [f64::from(u), f64::from(v)]))
            .collect();
        let fill = |spot: &Spot, moved_px: [f64; 2]| {
            let (mut places, mut light) = (Places::default(), Light::default());
            pixels.iter().for_each(|[u, v]| places.push((u - moved_px[0]) as f32, (v - moved_px[1]) as f32));
            light.fill(spot, &places, &mut Profiles::default());
            light
        };
        let at = fill(spot, [0.0; 2]);
        let moved = |unknown: usize, step_px: f64| {
            let mut spot = spot.clone();
            let mut moved_px = [0.0; 2];
            match unknown {
                0 | 1 => {
                    spot.centre_px[unknown] += step_px;
                    moved_px[unknown] = step_px;
                }
                2 => spot.radius_px += step_px,
                _ => spot.blur_px += step_px,
            }
            fill(&spot, moved_px).light
        };
        let derivatives = [&at.with_u, &at.with_v, &at.with_radius, &at.with_blur];
        [0, 1, 2, 3].map(|unknown| {
            let (more, less) = (moved(unknown, STEP_PX), moved(unknown, -STEP_PX));
            let (mut errors2, mut all2) = (0.0, 0.0);
            for (k, (more, less)) in more.iter().zip(&less).enumerate() {
                let difference = f64::from(more - less) / (2.0 * STEP_PX);
                errors2 += (f64::from(derivatives[unknown][k]) - difference).powi(2);
                all2 += difference.powi(2);
            }
            (errors2 / all2).sqrt()
        })
    }

    #[test]
    fn derivatives_are_those_of_the_light() {
        // With the place and the radius, and with the blur; of dots that pencils reach around, whose edges bend within them.
        const ERROR_MAX: [f64; 2] = [0.04, 0.06];
        const ERROR_MAX_SMALL: [f64; 2] = [0.18, 0.22];
        let places = [(250.0, [0.0; 2]), (270.0, [0.0; 2]), (270.0, [0.4, -0.3]), (325.0, [0.0; 2]), (350.0, [0.0; 2])];
        let mut report = Vec::new();
        // Whole pencils, and such as masks or a narrow stop cut.
        for (stop_mm, r_mm, diameter_mm) in
            [(8.0, 5.0, 1.0), (8.0, 2.2, 1.0), (4.5, 5.8, 1.0), (4.5, 7.2, 1.0), (8.0, 2.2, 0.25), (4.5, 6.5, 0.25)]
        {
            let mut spec = paper::instrument().into_spec();
            spec.apertures[2].zones[0].radius_mm = Some(stop_mm);
            let instrument = Instrument::new(spec).unwrap();
            for (band, (z_mm, slopes)) in [0, 1].into_iter().flat_map(|band| places.map(|place| (band, place))) {
                let pencil = Pencil::of_band(&instrument, &instrument.bands[band], F_MM);
                let dot = Dot { centre_mm: [0.8 * r_mm, -0.6 * r_mm, z_mm], diameter_mm, slopes };
                let spot = Spot::of(&dot, &pencil, Raster { axis_px: AXIS_PX, pitch_mm: PITCH_MM }, None);
                let [u, v, radius, blur] = derivative_errors(&spot);
                let error_max = if diameter_mm < 0.5 { ERROR_MAX_SMALL } else { ERROR_MAX };
                if u.max(v).max(radius) > error_max[0] || blur > error_max[1] {
                    let case = format!("stop {stop_mm}, r {r_mm}, {diameter_mm}, band {band}, z {z_mm}, {slopes:?}");
                    report.push(format!("{case}: {u:.3} {v:.3} {radius:.3} {blur:.3}"));
                }
            }
        }
        assert!(report.is_empty(), "\n{}", report.join("\n"));
    }
}
