//! The image of a point through a real lens: no even disc.

use crate::likelihood::light::Places;
use crate::likelihood::pencil::{Vector2, length};
use crate::likelihood::spot::Spot;

/// How light that an ideal lens would spread evenly over a disc is spread by a real one, by the point w of the pupil. Along
/// the radius of the image, x, and across it, y, it lies farther by
///
/// ```text
/// δ_x = −s w_x + a w_x² + b w_y² − (a + b)/4 − k (w² − ⅔) w_x
/// δ_y = +s w_y + c w_x w_y                   − k (w² − ⅔) w_y
/// ```
///
/// astigmatism, coma and spherical aberration; the mean over the pupil is none. The blur itself and s grow outwards over the
/// dot. An edge whose normal is n sees of this what lies along n, on the
/// average over the light that is as far across the edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Smear {
    /// Along the radius of the image, as the page shows it.
    pub(crate) outwards: Vector2,
    /// s in the middle of the dot, and what is added to it at the outermost point of the rim, with the sign of the blur, px.
    pub(crate) stretch_px: Vector2,
    /// Growth of the blur from the middle of the dot to that point, with its sign, px.
    pub(crate) growth_px: f64,
    /// a, b and c, px.
    pub(crate) coma_px: [f64; 3],
    /// k, with the sign of the blur, px.
    pub(crate) spherical_px: f64,
}

/// Half width that the pixel gives to every edge, px: that of an even disc with the moment of a square.
const PIXEL_HALF_PX: f64 = 0.577;

impl Smear {
    /// How far beyond the disc light may fall, px.
    pub(crate) fn reach_px(&self) -> f64 {
        let coma_px: f64 = self.coma_px.iter().map(|px| px.abs()).sum();
        let stretch_px = self.stretch_px[0].abs() + self.stretch_px[1].abs();
        self.growth_px.abs() + stretch_px + coma_px + self.spherical_px.abs()
    }

    /// How far the light is moved along the unit vector n of an edge that is `share` of the way from the middle of the blur
    /// to its end.
    ///
    /// ```text
    /// ⟨δ·n⟩ = g share + s (n_x² − n_y²) share + A share² + C (1 − share²)/3 − n_x (a + b)/4 + k share (2 share² − 1)/3
    /// A = n_x (a n_x² + (b + c) n_y²)        C = n_x ((a − c) n_y² + b n_x²)
    /// ```
    ///
    /// `narrowness` is the blur's radius over the half width of the edge, which the pixel widens.
    #[inline(always)]
    fn along(&self, [nx, ny]: [f32; 2], share: f32, narrowness: f32) -> f32 {
        let [a, b, c] = self.coma_px.map(|px| px as f32);
        let (xx, yy, square) = (nx * nx, ny * ny, share * share);
        let [stretch, more] = self.stretch_px.map(|px| px as f32);
        let even_px = self.growth_px as f32 * nx + self.spherical_px as f32 * (2.0 * square - 1.0) * (1.0 / 3.0);
        let odd = even_px + (stretch + more * nx) * (xx - yy);
        let (ends, middle) = (a * xx + (b + c) * yy, (a - c) * yy + b * xx);
        let bent = nx * (ends * square + middle * (1.0 - square) * (1.0 / 3.0) - 0.25 * (a + b));
        odd * share * narrowness + bent * narrowness * narrowness
    }

    /// Moves places to where the light of an even disc would be as strong.
    pub(crate) fn even_out(&self, spot: &Spot, places: &mut Places) {
        let [[xx, xy], [yx, yy]] = spot.inverse.map(|row| row.map(|value| value as f32));
        let [ox, oy] = self.outwards.map(|value| value as f32);
        let (radius_px, blur_px) = (spot.radius_px as f32, spot.blur_px.abs() as f32);
        let half_px = length([spot.blur_px, PIXEL_HALF_PX]) as f32;
        let (per_half, narrowness) = (1.0 / half_px, blur_px / half_px);
        let edge = places.edge;
        for (du, dv) in places.du[..edge].iter_mut().zip(&mut places.dv[..edge]) {
            let (ex, ey) = (xx * *du + xy * *dv, yx * *du + yy * *dv);
            let size = (ex * ex + ey * ey).sqrt().max(1e-6);
            let (gx, gy) = ((ex * xx + ey * yx) / size, (ex * xy + ey * yy) / size);
            let per_gradient = 1.0 / (gx * gx + gy * gy).sqrt();
            let [nu, nv] = [gx * per_gradient, gy * per_gradient];
            let share = ((size - radius_px) * per_gradient * per_half).clamp(-1.0, 1.0);
            let moved_px = self.along([nu * ox + nv * oy, nv * ox - nu * oy], share, narrowness);
            *du -= moved_px * nu;
            *dv -= moved_px * nv;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean along n of δ over the chord of the unit disc that is `share` across.
    fn by_sum(smear: &Smear, [nx, ny]: [f64; 2], share: f64) -> f64 {
        const STEPS: usize = 2000;
        let half = (1.0 - share * share).sqrt();
        let [a, b, c] = smear.coma_px;
        let of = |k: usize| {
            let along = half * (2.0 * (k as f64 + 0.5) / STEPS as f64 - 1.0);
            // What is imaged at +share across the edge has passed the pupil on its other side.
            let (wx, wy) = (-share * nx - along * ny, -share * ny + along * nx);
            let cubic = smear.spherical_px * (wx * wx + wy * wy - 2.0 / 3.0);
            let x = -smear.stretch_px[0] * wx + a * wx * wx + b * wy * wy - 0.25 * (a + b) - cubic * wx;
            x * nx + (smear.stretch_px[0] * wy + c * wx * wy - cubic * wy) * ny
        };
        (0..STEPS).map(of).sum::<f64>() / STEPS as f64
    }

    #[test]
    fn an_edge_sees_the_mean_over_the_light_that_is_as_far_across_it() {
        let smear = Smear {
            outwards: [1.0, 0.0],
            stretch_px: [0.3, 0.0],
            growth_px: 0.0,
            coma_px: [0.2, 0.05, -0.12],
            spherical_px: 0.15,
        };
        for angle in [0.0_f64, 0.4, 1.3, 2.2, 4.0] {
            for share in [-0.9, -0.3, 0.0, 0.5, 1.0] {
                let n = [angle.cos(), angle.sin()];
                let found = smear.along(n.map(|value| value as f32), share as f32, 1.0);
                assert!((f64::from(found) - by_sum(&smear, n, share)).abs() < 1e-6, "{angle} {share}");
            }
        }
    }
}
