//! The edge of a spot that is nearly round, tabulated across.
//!
//! A disc of radius R, blurred by a disc of radius b and seen by square pixels, depends on where a pixel lies beyond its
//! outline, t, and only by the turn of the square on the direction θ:
//!
//! ```text
//! I(t, θ) = A(t) + B(t) cos 4θ        A, B = (I(t, 0°) ± I(t, 45°))/2
//! ```
//!
//! Both are means of overlaps of two discs over the projection of the square on the edge's normal: even from −½ to ½, or a
//! triangle from −1/√2 to 1/√2. At x across the edge the square reaches ±h along it, `h = ½` or `1/√2 − |x|`, so that
//! it lies `h²/6r` farther out than its middle, r from the centre. Squares of blocks of pixels are wider. Between nodes A is
//! the cubic through its values and slopes, and between rows of the table a chord, which lies `A″h²/12` off on the average over
//! their distance h: rows are that much off the other way, or every blur would seem too narrow.
//!
//! Spots that are alike share a table. What little a blur differs from b is accounted for by the derivative, and so is what
//! it differs by along the outline. Across an edge of another radius R′ the chord of the blur at t, of half length
//! `√(b² − t²)`, lies farther out, on the average along it, by `(b² − t²)/6 (1/R′ − 1/R)`.

use multiversion::multiversion;

use crate::likelihood::chords::{LANES, Lanes};
use crate::likelihood::light::{Kernel, Light, Local, Places, SHARP_PX, fill_by};
use crate::likelihood::soft::Overlap;
use crate::likelihood::spot::{PIXEL_REACH_PX, Spot};

/// Nodes of the integrals, and steps between them.
const NODES: usize = 48;
const STEPS: usize = NODES - 1;

/// Rows of the table to a node, and rows in all: a power of two.
const FINENESS: usize = 4;
const ROWS: usize = 256;

/// Profiles that were made, of those that share a place the last: a spot is looked at more than once, by itself and by its
/// neighbours.
#[derive(Debug, Clone, Default)]
pub(crate) struct Profiles {
    kept: Vec<Profile>,
}

/// Light and its derivatives across an edge.
#[derive(Debug, Clone)]
struct Profile {
    radius_px: f32,
    blur_px: f32,
    square_px: f32,
    start_px: f32,
    rows_per_px: f32,
    rows: [Row; ROWS],
}

/// A, its changes with t and with b, per px, and B.
type Row = [f32; 4];

/// The same at all nodes.
type Columns = [[f32; NODES]; 4];

/// The projection of a pixel's square on a direction.
struct Square {
    /// Places and weights of half a Gaussian rule of eight points.
    rule: [[f32; 2]; 4],
    /// Mean square of its extent along the edge, at each of them, px².
    along2: [f32; 4],
}

/// Along a row or a column: even from −½ to ½, as high everywhere.
const STRAIGHT: Square = Square {
    rule: [
        [0.091_717_32, 0.181_341_89],
        [0.262_766_2, 0.156_853_32],
        [0.398_333_24, 0.111_190_52],
        [0.480_144_93, 0.050_614_27],
    ],
    along2: [1.0 / 12.0; 4],
};

/// Along a diagonal: a triangle from −1/√2 to 1/√2.
const DIAGONAL: Square = Square {
    rule: [
        [0.109_339_27, 0.268_613_73],
        [0.328_593_12, 0.157_584_23],
        [0.516_277_12, 0.062_272_59],
        [0.648_062_4, 0.011_529_45],
    ],
    along2: [0.119_108_67, 0.047_757_53, 0.012_138_65, 0.001_162_08],
};

/// Spots that are less foreshortened than this, and whose blur grows by no more than this share of it, are nearly round.
const ROUND: f64 = 0.01;
const EVEN_BLUR: f64 = 0.03;

/// Fewer samples are seen one by one.
const SAMPLES_FEW: usize = 50;

/// Profiles that are kept.
const KEPT: usize = 32;

/// Spots whose radius and blur are alike in so many bits behind the first share a profile.
const BITS: u32 = 7;

impl Profiles {
    /// Whether one serves the samples of a spot.
    pub(crate) fn serves(spot: &Spot, places: &Places) -> bool {
        places.edge >= SAMPLES_FEW
            && spot.blur_px.abs() >= SHARP_PX
            && spot.blur_px.abs() + PIXEL_REACH_PX * f64::from(places.square_px) < spot.radius_px
            && spot.foreshortening() < ROUND
            && spot.blur_growth_px.abs() < EVEN_BLUR * spot.blur_px.abs()
    }

    /// Fills light and derivatives of a spot that one serves.
    pub(crate) fn fill(&mut self, local: &Local, places: &Places, out: &mut Light) {
        look_up(self.of(local), local, places, out);
    }

    fn of(&mut self, local: &Local) -> &Profile {
        if self.kept.is_empty() {
            self.kept.resize(KEPT, Profile::default());
        }
        let made_from = [rounded(local.radius_px), rounded(local.blur_px.abs()), local.square_px];
        // By their last bits, so that those next to each other lie apart.
        let mixed = made_from.iter().fold(0_u32, |mixed, px| (mixed ^ px.to_bits()).wrapping_mul(0x9e37_79b9));
        let profile = &mut self.kept[(mixed >> 16) as usize % KEPT];
        if [profile.radius_px, profile.blur_px, profile.square_px] != made_from {
            profile.make(made_from);
        }
        profile
    }
}

impl Default for Profile {
    fn default() -> Self {
        let (radius_px, blur_px, square_px) = (0.0, 0.0, 0.0);
        Self { radius_px, blur_px, square_px, start_px: 0.0, rows_per_px: 0.0, rows: [Row::default(); ROWS] }
    }
}

impl Profile {
    /// Becomes that of spots with such a radius and blur in squares so wide.
    fn make(&mut self, [radius_px, blur_px, square_px]: [f32; 3]) {
        (self.radius_px, self.blur_px, self.square_px) = (radius_px, blur_px, square_px);
        let reach_px = blur_px + 1.02 * PIXEL_REACH_PX as f32 * square_px;
        let step_px = 2.0 * reach_px / STEPS as f32;
        (self.start_px, self.rows_per_px) = (-reach_px, FINENESS as f32 / step_px);
        let mut columns = [[0.0; NODES]; 4];
        integrate([radius_px, blur_px, square_px], reach_px, &mut columns);
        refine(&columns, step_px, &mut self.rows);
    }
}

/// The number with [`BITS`] behind the first.
fn rounded(number: f32) -> f32 {
    const LAST: u32 = 1 << (f32::MANTISSA_DIGITS - 1 - BITS);
    f32::from_bits((number.to_bits() + LAST / 2) & !(LAST - 1))
}

/// Integrates at nodes that begin `reach_px` within the outline.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn integrate([radius_px, blur_px, square_px]: [f32; 3], reach_px: f32, columns: &mut Columns) {
    let (per_radius, step_px) = (1.0 / radius_px, 2.0 * reach_px / STEPS as f32);
    let beta = blur_px * per_radius;
    let [of_light, of_t, of_blur, of_turn] = columns;
    for (square, turn) in [(STRAIGHT, 1.0), (DIAGONAL, -1.0)] {
        for ([place, weight], along2) in square.rule.into_iter().zip(square.along2) {
            let weight = 0.5 * weight;
            let along2 = 0.5 * square_px * square_px * along2;
            for place in [-place, place] {
                let start_px = square_px * place - reach_px;
                for node in 0..NODES {
                    let t = step_px.mul_add((node as u32) as f32, start_px);
                    let t = t + along2 / (radius_px + t).max(1.0);
                    let Overlap { light, with_q, with_beta } = Overlap::of(t.mul_add(per_radius, 1.0).max(0.0), beta);
                    of_light[node] = weight.mul_add(light, of_light[node]);
                    of_t[node] = (weight * per_radius).mul_add(with_q, of_t[node]);
                    of_blur[node] = (weight * per_radius).mul_add(with_beta, of_blur[node]);
                    of_turn[node] = (turn * weight).mul_add(light, of_turn[node]);
                }
            }
        }
    }
}

/// Fills the rows between the nodes.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn refine([light, with_t, with_blur, turned]: &Columns, step_px: f32, rows: &mut [Row; ROWS]) {
    // A″h²/12 over the second derivative by the share of a step.
    const CHORD: f32 = 1.0 / (12 * FINENESS * FINENESS) as f32;
    let mut ends = None;
    for (step, rows) in rows[..STEPS * FINENESS].as_chunks_mut::<FINENESS>().0.iter_mut().enumerate() {
        let next = step + 1;
        let rise = light[next] - light[step];
        // How A leaves the chord between the nodes, and how it meets it again.
        let (leaves, meets) = (step_px * with_t[step] - rise, rise - step_px * with_t[next]);
        let curvature = |share: f32| 2.0 * (meets - 2.0 * leaves) - 6.0 * share * (meets - leaves);
        let begins = curvature(0.0);
        for (place, row) in rows.iter_mut().enumerate() {
            let share = place as f32 / FINENESS as f32;
            let left = 1.0 - share;
            let bend = share * left * (left * leaves + share * meets);
            // Two cubics meet in a node.
            let own = if place == 0 { 0.5 * (begins + ends.unwrap_or(begins)) } else { curvature(share) };
            let mix = |column: &[f32; NODES]| column[step] + share * (column[next] - column[step]);
            *row = [mix(light) + bend - CHORD * own, mix(with_t), mix(with_blur), mix(turned)];
        }
        ends = Some(curvature(1.0));
    }
    rows[STEPS * FINENESS] = [light[STEPS], with_t[STEPS], with_blur[STEPS], turned[STEPS]];
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn look_up(profile: &Profile, local: &Local, places: &Places, out: &mut Light) {
    fill_by(&Tabulated { profile, local }, places, out);
}

/// Light that is looked up.
struct Tabulated<'a> {
    profile: &'a Profile,
    local: &'a Local,
}

impl Kernel for Tabulated<'_> {
    #[inline(always)]
    fn lanes(&self, du: &Lanes, dv: &Lanes) -> [Lanes; 5] {
        // Added to a number below it, it leaves the nearest whole number in the last bits.
        const WHOLE: f32 = 8_388_608.0;
        let Self { local, profile: &Profile { start_px, rows_per_px, blur_px, ref rows, .. } } = *self;
        let more_curved = 1.0 / local.radius_px - 1.0 / self.profile.radius_px;
        let (radius_px, per_radius) = (local.radius_px, 1.0 / local.radius_px);
        let [[xx, xy], [yx, yy]] = local.inverse;
        let (square_u, square_v) = (xx * xx + yx * yx - 1.0, xy * xy + yy * yy - 1.0);
        let (mean, product) = (0.5 * (square_u + square_v), 2.0 * (xx * xy + yx * yy));
        let sign = 1.0_f32.copysign(local.blur_px);
        let [mut out_px, mut wider_px, mut normal_u, mut normal_v] = [[0.0; LANES]; 4];
        let (mut row, mut shares) = ([0; LANES], [Row::default(); LANES]);
        for lane in 0..LANES {
            let (u, v) = (du[lane] - local.skewed_px[0], dv[lane] - local.skewed_px[1]);
            let distance = u.mul_add(u, v * v).max(1e-12).sqrt();
            let per_distance = 1.0 / distance;
            let (n_u, n_v) = (u * per_distance, v * per_distance);
            let excess = (square_u * n_u).mul_add(n_u, square_v.mul_add(n_v, product * n_u) * n_v);
            let outside = radius_px.mul_add(-excess.mul_add(-excess.mul_add(-0.375, 0.5), 1.0), distance);
            let chord2 = outside.mul_add(-outside, blur_px * blur_px).max(0.0);
            let rounder = (0.25 * per_radius).mul_add(mean - excess, (1.0 / 6.0) * more_curved) * chord2;
            let along = (xx.mul_add(u, xy * v) * per_radius).clamp(-1.0, 1.0);
            wider_px[lane] = local.blur_growth_px.mul_add(along, local.blur_px).abs() - blur_px;
            (out_px[lane], normal_u[lane], normal_v[lane]) = (distance, n_u, n_v);
            let place = ((outside + rounder - start_px) * rows_per_px).clamp(0.0, (STEPS * FINENESS) as f32);
            let whole = (place - 0.5).max(0.0) + WHOLE;
            row[lane] = whole.to_bits();
            shares[lane] = [place - (whole - WHOLE); 4];
        }
        let (mut low, mut high) = ([Row::default(); LANES], [Row::default(); LANES]);
        for lane in 0..LANES {
            let row = row[lane] as usize;
            low[lane] = rows[row % ROWS];
            high[lane] = rows[(row + 1) % ROWS];
        }
        let mut seen = low;
        for ((seen, high), share) in
            seen.as_flattened_mut().iter_mut().zip(high.as_flattened()).zip(shares.as_flattened())
        {
            *seen = share.mul_add(high - *seen, *seen);
        }
        let [mut light, mut with_u, mut with_v, mut with_radius, mut with_blur] = [[0.0; LANES]; 5];
        for lane in 0..LANES {
            let [shared, with_t, with_b, turned] = seen[lane];
            let (uu, vv) = (normal_u[lane] * normal_u[lane], normal_v[lane] * normal_v[lane]);
            light[lane] = (8.0 * uu).mul_add(-vv, 1.0).mul_add(turned, with_b.mul_add(wider_px[lane], shared));
            with_u[lane] = -with_t * normal_u[lane];
            with_v[lane] = -with_t * normal_v[lane];
            with_radius[lane] = -out_px[lane].mul_add(with_t, blur_px * with_b) * per_radius;
            with_blur[lane] = with_b * sign;
        }
        [light, with_u, with_v, with_radius, with_blur]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::likelihood::soft;

    #[test]
    fn profile_and_wide_edge_are_the_mean_over_the_square() {
        const FINE: usize = 200;
        // Half way between those that profiles are made from; and blurs that are wider than the dot.
        let cases = [1.2, 2.505, 3.007, 12.03].map(|blur_px| (45.12_f32, blur_px, 1.0_f32)).into_iter();
        let cases = cases.chain([(12.03, 3.6), (16.06, 4.0), (20.06, 4.0)].map(|(blur, square)| (45.12, blur, square)));
        for (radius_px, blur_px, square_px) in cases.chain([(3.0, 6.0, 1.0), (2.0, 6.0, 1.0)]) {
            let local = Local {
                inverse: [[1.0, 0.0], [0.0, 1.0]],
                radius_px,
                blur_px: -blur_px,
                blur_growth_px: 0.0,
                blur_gradient: [0.0; 2],
                skewed_px: [0.0; 2],
                square_px,
            };
            let mut places = Places { square_px, ..Places::default() };
            let reach_px = blur_px + square_px;
            for turn in 0..40 {
                let (sin, cos) = (0.3 * turn as f32).sin_cos();
                let distance_px = radius_px + reach_px * (turn as f32 / 20.0 - 1.0);
                places.push(distance_px * cos, distance_px * sin);
            }
            let mut light = Light::default();
            light.resize(places.len());
            let is_served = blur_px < radius_px;
            if is_served {
                Profiles::default().fill(&local, &places, &mut light);
            }
            let mut wide = Light::default();
            wide.resize(places.len());
            soft::wide(&local, &places, &mut wide);
            for (index, light) in light.light[..places.len()].iter().enumerate() {
                let part = |k: usize| square_px * ((k as f32 + 0.5) / FINE as f32 - 0.5);
                let row = |v: f32| -> f64 {
                    let share = |k: usize| {
                        let q = (places.du[index] + part(k)).hypot(v) / radius_px;
                        f64::from(Overlap::of(q, blur_px / radius_px).light)
                    };
                    (0..FINE).map(share).sum()
                };
                let mean = (0..FINE).map(|k| row(places.dv[index] + part(k))).sum::<f64>() / (FINE * FINE) as f64;

                let near = |light: f32, off: f64| (f64::from(light) - mean).abs() < off;
                let case = format!("{radius_px} {blur_px} {square_px} at {index}: {mean}");
                assert!(!is_served || near(*light, if blur_px < 2.0 { 8e-4 } else { 3e-4 }), "{case} {light}");
                let (is_wide, peak) = (f64::from(blur_px) >= soft::WIDE_PX, f64::from(radius_px / blur_px).powi(2));
                let wide = wide.light[index];
                assert!(!is_wide || near(wide, (1e-3 * peak).min(6e-4)), "{case} {wide}");
            }
        }
    }
}
