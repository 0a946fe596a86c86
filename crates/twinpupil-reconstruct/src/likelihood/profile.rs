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
//! it lies `h²/6r` farther out than its middle, r from the centre. Squares of blocks of pixels are wider. Between nodes A is the cubic through its values and slopes, and between rows of
//! the table a chord, which lies `A″h²/12` off on the average over their distance h: rows are that much off the other way,
//! or every blur would seem too narrow. What little a blur differs from b along the outline is accounted for by the
//! derivative.

use multiversion::multiversion;

use crate::likelihood::chords::{LANES, Lanes, padded};
use crate::likelihood::light::{Light, Local, Places, SHARP_PX};
use crate::likelihood::soft::Overlap;
use crate::likelihood::spot::{PIXEL_REACH_PX, Spot};

/// Nodes of the integrals, and steps between them.
const NODES: usize = 48;
const STEPS: usize = NODES - 1;

/// Rows of the table to a node, and rows in all: a power of two.
const FINENESS: usize = 4;
const ROWS: usize = 256;

/// Light and its derivatives across an edge.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Profile {
    start_px: f32,
    rows_per_px: f32,
    blur_px: f32,
    rows: [Row; ROWS],
}

/// A, its changes with t and with b, per px, and B.
type Row = [f32; 4];

/// The same at all nodes.
type Columns = [[f32; NODES]; 4];

/// The projection of a pixel's square on a direction.
struct Square {
    /// Places and weights of half a Gaussian rule of four points.
    rule: [[f32; 2]; 2],
    /// Mean square of its extent along the edge, at each of them, px².
    along2: [f32; 2],
}

/// Along a row or a column: even from −½ to ½, as high everywhere.
const STRAIGHT: Square =
    Square { rule: [[0.169_990_52, 0.326_072_58], [0.430_568_16, 0.173_927_42]], along2: [1.0 / 12.0; 2] };

/// Along a diagonal: a triangle from −1/√2 to 1/√2.
const DIAGONAL: Square =
    Square { rule: [[0.185_424_5, 0.401_133_7], [0.530_984_3, 0.098_866_305]], along2: [0.090_717_47, 0.010_339_714] };

/// Spots that are less foreshortened than this, and whose blur grows by no more than this share of it, are nearly round.
const ROUND: f64 = 0.01;
const EVEN_BLUR: f64 = 0.03;

/// Fewer samples are seen one by one.
const SAMPLES_FEW: usize = 150;

impl Profile {
    /// Whether it serves the samples of a spot.
    pub(crate) fn serves(spot: &Spot, places: &Places) -> bool {
        places.edge >= SAMPLES_FEW
            && spot.blur_px.abs() >= SHARP_PX
            && spot.blur_px.abs() + PIXEL_REACH_PX * f64::from(places.square_px) < spot.radius_px
            && spot.foreshortening() < ROUND
            && spot.blur_growth_px.abs() < EVEN_BLUR * spot.blur_px.abs()
    }

    /// Of a spot that it serves.
    pub(crate) fn of(local: &Local) -> Self {
        let blur_px = local.blur_px.abs();
        let reach_px = blur_px + 1.02 * PIXEL_REACH_PX as f32 * local.square_px;
        let step_px = 2.0 * reach_px / STEPS as f32;
        let mut columns = [[0.0; NODES]; 4];
        integrate(local, reach_px, &mut columns);
        let mut rows = [Row::default(); ROWS];
        refine(&columns, step_px, &mut rows);
        Self { start_px: -reach_px, rows_per_px: FINENESS as f32 / step_px, blur_px, rows }
    }

    /// Fills light and derivatives of its spot.
    pub(crate) fn fill(&self, local: &Local, places: &Places, out: &mut Light) {
        look_up(self, local, places, out);
    }
}

/// Integrates at nodes that begin `reach_px` within the outline.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma", "x86_64+avx"))]
fn integrate(local: &Local, reach_px: f32, columns: &mut Columns) {
    let Local { radius_px, square_px, .. } = *local;
    let blur_px = local.blur_px.abs();
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
                    let t = start_px + step_px * (node as u32) as f32;
                    let t = t + along2 / (radius_px + t).max(1.0);
                    let Overlap { light, with_q, with_beta } = Overlap::of((1.0 + t * per_radius).max(0.0), beta);
                    of_light[node] += weight * light;
                    of_t[node] += weight * per_radius * with_q;
                    of_blur[node] += weight * per_radius * with_beta;
                    of_turn[node] += turn * weight * light;
                }
            }
        }
    }
}

/// Fills the rows between the nodes.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma", "x86_64+avx"))]
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

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma", "x86_64+avx"))]
fn look_up(profile: &Profile, local: &Local, places: &Places, out: &mut Light) {
    let count = places.edge;
    let Light { light, with_u, with_v, with_radius, with_blur, .. } = out;
    let [(du, last_du), (dv, last_dv)] = [&places.du, &places.dv].map(|px| px[..count].as_chunks::<LANES>());
    let columns = [light, with_u, with_v, with_radius, with_blur].map(|column| column[..count].as_chunks_mut());
    let [(light, last_light), (with_u, last_u), (with_v, last_v), (with_radius, last_radius), (with_blur, last_blur)] =
        columns;
    for (chunk, (du, dv)) in du.iter().zip(dv).enumerate() {
        let seen = profile.look_up_lanes(local, du, dv);
        [light[chunk], with_u[chunk], with_v[chunk], with_radius[chunk], with_blur[chunk]] = seen;
    }
    let seen = profile.look_up_lanes(local, &padded(last_du), &padded(last_dv));
    for (column, seen) in [last_light, last_u, last_v, last_radius, last_blur].into_iter().zip(&seen) {
        column.iter_mut().zip(seen).for_each(|(value, seen)| *value = *seen);
    }
}

impl Profile {
    /// Light and its changes with u, v, radius and blur at places side by side.
    #[inline(always)]
    fn look_up_lanes(&self, local: &Local, du: &Lanes, dv: &Lanes) -> [Lanes; 5] {
        // Added to a number below it, it leaves the nearest whole number in the last bits.
        const WHOLE: f32 = 8_388_608.0;
        let Self { start_px, rows_per_px, blur_px, ref rows } = *self;
        let (radius_px, per_radius) = (local.radius_px, 1.0 / local.radius_px);
        let [[xx, xy], [yx, yy]] = local.inverse;
        let (square_u, square_v) = (xx * xx + yx * yx - 1.0, xy * xy + yy * yy - 1.0);
        let (mean, product) = (0.5 * (square_u + square_v), 2.0 * (xx * xy + yx * yy));
        let sign = 1.0_f32.copysign(local.blur_px);
        let [mut out_px, mut wider_px, mut normal_u, mut normal_v] = [[0.0; LANES]; 4];
        let (mut row, mut shares) = ([0; LANES], [Row::default(); LANES]);
        for lane in 0..LANES {
            let (u, v) = (du[lane] - local.skewed_px[0], dv[lane] - local.skewed_px[1]);
            let distance = (u * u + v * v).max(1e-12).sqrt();
            let per_distance = 1.0 / distance;
            let (n_u, n_v) = (u * per_distance, v * per_distance);
            let excess = square_u * n_u * n_u + square_v * n_v * n_v + product * n_u * n_v;
            let outside = distance - radius_px * (1.0 - excess * (0.5 - 0.375 * excess));
            let rounder = 0.25 * (mean - excess) * per_radius * (blur_px * blur_px - outside * outside).max(0.0);
            let along = ((xx * u + xy * v) * per_radius).clamp(-1.0, 1.0);
            wider_px[lane] = (local.blur_px + local.blur_growth_px * along).abs() - blur_px;
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
            *seen += share * (high - *seen);
        }
        let [mut light, mut with_u, mut with_v, mut with_radius, mut with_blur] = [[0.0; LANES]; 5];
        for lane in 0..LANES {
            let [shared, with_t, with_b, turned] = seen[lane];
            let (uu, vv) = (normal_u[lane] * normal_u[lane], normal_v[lane] * normal_v[lane]);
            light[lane] = shared + (1.0 - 8.0 * uu * vv) * turned + with_b * wider_px[lane];
            with_u[lane] = -with_t * normal_u[lane];
            with_v[lane] = -with_t * normal_v[lane];
            with_radius[lane] = -(out_px[lane] * with_t + blur_px * with_b) * per_radius;
            with_blur[lane] = with_b * sign;
        }
        [light, with_u, with_v, with_radius, with_blur]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::likelihood::light::WIDE_PX;
    use crate::likelihood::soft;

    #[test]
    fn profile_and_wide_edge_are_the_mean_over_the_square() {
        const FINE: usize = 200;
        const RADIUS_PX: f32 = 45.0;
        for (blur_px, square_px) in [(1.2_f32, 1.0_f32), (3.0, 1.0), (12.0, 1.0), (12.0, 3.6), (16.0, 4.0), (20.0, 4.0)]
        {
            let local = Local {
                inverse: [[1.0, 0.0], [0.0, 1.0]],
                radius_px: RADIUS_PX,
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
                let distance_px = RADIUS_PX + reach_px * (turn as f32 / 20.0 - 1.0);
                places.push(distance_px * cos, distance_px * sin);
            }
            let mut light = Light::default();
            light.resize(places.len());
            Profile::of(&local).fill(&local, &places, &mut light);
            let mut wide = Light::default();
            wide.resize(places.len());
            soft::wide(&local, &places, &mut wide);
            for (index, light) in light.light.iter().enumerate() {
                let part = |k: usize| square_px * ((k as f32 + 0.5) / FINE as f32 - 0.5);
                let row = |v: f32| -> f64 {
                    let share = |k: usize| {
                        let q = (places.du[index] + part(k)).hypot(v) / RADIUS_PX;
                        f64::from(Overlap::of(q, blur_px / RADIUS_PX).light)
                    };
                    (0..FINE).map(share).sum()
                };
                let mean = (0..FINE).map(|k| row(places.dv[index] + part(k))).sum::<f64>() / (FINE * FINE) as f64;

                let near = |light: f32, off: f64| (f64::from(light) - mean).abs() < off;
                assert!(
                    near(*light, if square_px > 1.0 { 3e-4 } else { 1.5e-3 }),
                    "{blur_px} at {index}: {light} {mean}"
                );
                let is_wide = f64::from(blur_px) >= WIDE_PX;
                assert!(
                    !is_wide || near(wide.light[index], 5e-4),
                    "{blur_px} at {index}: {} {mean}",
                    wide.light[index]
                );
            }
        }
    }
}
