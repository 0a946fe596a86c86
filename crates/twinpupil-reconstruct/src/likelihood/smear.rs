//! The image of a point through a real lens: no even disc.

use nalgebra::{Matrix2, Matrix4};

use crate::likelihood::light::Places;
use crate::likelihood::pencil::{Vector2, length};
use crate::likelihood::spot::Spot;

/// How light that an ideal lens would spread over an even disc of radius B is spread by a real one, by the point w of the
/// pupil. Along the radius of the image, x, and across it, y, it arrives at
///
/// ```text
/// x: −(B + s) w_x + a w_x² + b w_y² − (a + b)/4 − k (w² − ⅔) w_x
/// y: −(B − s) w_y + c w_x w_y                   − k (w² − ⅔) w_y
/// ```
///
/// defocus, astigmatism, coma and spherical aberration; the mean over the pupil is none, and of its light what stands in the
/// table as a shift. B, s and the coma grow outwards over
/// the dot. An edge whose normal is n sees of this what lies along n: how wide that is, and its mean over the light that is as
/// far across the edge. What lies along the edge matters where that is curved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Smear {
    /// Along the radius of the image, as the page shows it.
    pub(crate) outwards: Vector2,
    /// B in the middle of the dot, and what is added to it at the outermost point of the rim, px.
    pub(crate) blur_px: Vector2,
    /// The same of s, with the sign of the blur, px.
    pub(crate) stretch_px: Vector2,
    /// The same of a, b and c, px.
    pub(crate) coma_px: [[f64; 3]; 2],
    /// k, with the sign of the blur, px.
    pub(crate) spherical_px: f64,
    /// Growth of the light outwards to the end of the blur, times that, px.
    pub(crate) light_px: f64,
    /// How much less light pixels get of the middle of the dot than on the axis, and of the outermost point of its rim than of
    /// the middle, relative.
    pub(crate) falloff: Vector2,
    /// What all these terms leave of where light arrives, root mean square along one direction, px.
    pub(crate) left_px: f64,
    /// Distance of the middle of the dot from the axis, and its radius, in parts of their sum: the radius of the image turns
    /// over the dot.
    pub(crate) away: Vector2,
}

/// What is left of the place outwards and across, of the radius and of the blur of noiseless images of dots, over the radius of
/// the even disc that is as wide as the aberrations: root mean squares over a double Gauss, a Cooke triplet, an achromat and an
/// asphere, near, in focus and far.
const LEFT_SHARES: [f64; 4] = [0.01, 0.003, 0.005, 0.02];

/// Half width that the pixel gives to every edge, px: that of an even disc with the moment of a square.
const PIXEL_HALF_PX: f64 = 0.577;

/// Half the width across an edge, and the mean square along it of light in the middle and at the ends of that.
#[derive(Clone, Copy)]
struct Width {
    half_px: f32,
    middle_px2: f32,
    ends_px2: f32,
}

impl Width {
    fn along_px2(&self, square: f32) -> f32 {
        self.middle_px2 * (1.0 - square) * (1.0 / 3.0) + self.ends_px2 * square
    }
}

impl Smear {
    /// How far beyond the disc light may fall, px.
    pub(crate) fn reach_px(&self) -> f64 {
        let sum_px = |px: &[f64]| px.iter().map(|px| px.abs()).sum::<f64>();
        let coma_px = sum_px(&self.coma_px[0]) + sum_px(&self.coma_px[1]);
        self.blur_px[1].abs() + sum_px(&self.stretch_px) + coma_px + self.spherical_px.abs()
    }

    /// Radius of the even disc that spreads light as widely as this, px.
    ///
    /// ```text
    /// B² + s² + (a² + b²)/8 − a b/12 + c²/12 + k²/18
    /// ```
    pub(crate) fn even_blur_px(&self) -> f64 {
        length([self.blur_px[0], self.aberration_px()])
    }

    /// The same of all but the defocus.
    fn aberration_px(&self) -> f64 {
        let ([stretch, _], [a, b, c]) = (self.stretch_px, self.coma_px[0]);
        let coma2 = (a * a + b * b) / 8.0 - a * b / 12.0 + c * c / 12.0;
        (stretch * stretch + coma2 + self.spherical_px.powi(2) / 18.0).sqrt()
    }

    /// Covariance of what is left of the u, v, radius and blur of an image that is fitted by this, px²: what the terms leave of
    /// where light arrives, and a share of what they themselves do, for they are followed to second order.
    pub(crate) fn left_px2(&self) -> Matrix4<f64> {
        let [ox, oy] = self.outwards;
        let turn = Matrix2::new(ox, -oy, oy, ox);
        let [outwards, across, radius, blur] =
            LEFT_SHARES.map(|share| (share * self.aberration_px()).powi(2) + self.left_px.powi(2));
        let mut covariance = Matrix4::from_diagonal(&[outwards, across, radius, blur].into());
        let place = turn * covariance.fixed_view::<2, 2>(0, 0) * turn.transpose();
        covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&place);
        covariance
    }

    /// How wide the edge is whose normal is the unit vector n.
    ///
    /// ```text
    /// h² = (B + s)² n_x² + (B − s)² n_y² + what coma and spherical aberration add along the edge's own line
    /// ```
    #[inline(always)]
    fn width(&self, &Terms { n: [nx, ny], blur, stretch, coma: [a, b, c], ends, middle }: &Terms) -> Width {
        let (hx, hy) = (blur + stretch, blur - stretch);
        let (xx, yy) = (nx * nx, ny * ny);
        let across = hx * hx * xx + hy * hy * yy;
        let least = 1e-6_f32;
        let lean = (hy * hy - hx * hx) * nx * ny;
        // Four times the moments of coma, less those of what it moves on the average.
        let coma = xx * ((a * a + b * b) * 0.25 - a * b * (1.0 / 6.0)) + yy * c * c * (1.0 / 6.0);
        let moved = nx * (ends - middle * (1.0 / 3.0));
        let k = self.spherical_px as f32;
        let more = (coma - 0.25 * moved * moved).max(0.0) + k * k * (1.0 / 36.0);
        let per_across = 1.0 / (across + least);
        Width {
            half_px: (across + more).sqrt(),
            middle_px2: hx * hx * hy * hy * per_across,
            ends_px2: lean * lean * per_across,
        }
    }

    /// Mean along n of what coma and spherical aberration do to the light that is `share` of the way from the middle of the
    /// blur to its end, and how far the edge moves there where the light of the blur grows outwards by γ, for the mean of
    /// all of which it stands already.
    ///
    /// ```text
    /// A share² + C (1 − share²)/3 − n_x (a + b)/4 + k share (2 share² − 1)/3 + n_x γ B ((1 − share²)/3 − ¼)
    /// A = n_x (a n_x² + (b + c) n_y²)        C = n_x ((a − c) n_y² + b n_x²)
    /// ```
    #[inline(always)]
    fn bent_px(&self, &Terms { n: [nx, _], coma: [a, b, _], ends, middle, .. }: &Terms, share: f32) -> f32 {
        let square = share * share;
        let spherical = self.spherical_px as f32 * share * (2.0 * square - 1.0) * (1.0 / 3.0);
        let light = self.light_px as f32;
        let odd = ends * square + (middle + light) * (1.0 - square) * (1.0 / 3.0) - 0.25 * (a + b + light);
        nx * odd + spherical
    }

    /// How far an edge of that curvature has gone in where light is moved along it by coma and spherical aberration, more
    /// than by what [`Width`] tells.
    #[inline(always)]
    fn curled_px(&self, &Terms { n: [nx, ny], blur, coma: [a, b, c], .. }: &Terms, share: f32, per_px: f32) -> f32 {
        let square = share * share;
        let (xx, yy, left) = (nx * nx, ny * ny, 1.0 - square);
        let coma = nx * share * (2.0 * yy * (a - b) + c * (xx - yy));
        let k = self.spherical_px as f32;
        let spherical = k * ((square - 2.0 / 3.0) + 0.6 * left);
        let [stretch, more] = self.stretch_px.map(|px| px as f32);
        let [away, rim] = self.away.map(|share| share as f32);
        let turned = 2.0 * nx * (more * yy + stretch * rim / away.max(rim) * (xx - yy));
        per_px * blur * left * (1.0 / 3.0) * (coma + spherical + turned)
    }

    /// Moves places to where the light of an even disc would be as strong.
    pub(crate) fn even_out(&self, spot: &Spot, places: &mut Places) {
        let [[xx, xy], [yx, yy]] = spot.inverse.map(|row| row.map(|value| value as f32));
        let [shape_u, shape_v] = spot.shape.map(|row| row.map(|value| value as f32));
        let per_rim = 1.0 / self.rim(spot) as f32;
        let [ox, oy] = self.outwards.map(|value| value as f32);
        let (radius_px, blur_px) = (spot.radius_px as f32, spot.blur_px.abs() as f32);
        let square_half_px = PIXEL_HALF_PX * f64::from(places.square_px);
        let even_half_px = length([spot.blur_px, square_half_px]) as f32;
        let even2_px2 = blur_px * blur_px * (1.0 / 3.0);
        let flatness = xx * yy - xy * yx;
        let edge = places.edge;
        for (du, dv) in places.du[..edge].iter_mut().zip(&mut places.dv[..edge]) {
            let (ex, ey) = (xx * *du + xy * *dv, yx * *du + yy * *dv);
            let size = (ex * ex + ey * ey).sqrt().max(1e-6);
            let (gx, gy) = ((ex * xx + ey * yx) / size, (ex * xy + ey * yy) / size);
            let per_gradient = 1.0 / (gx * gx + gy * gy).sqrt();
            let [nu, nv] = [gx * per_gradient, gy * per_gradient];
            let n = [nu * ox + nv * oy, nv * ox - nu * oy];
            let curvature = flatness * flatness * per_gradient.powi(3) / radius_px;
            // The nearest point of the rim, in radii.
            let [ru, rv] = [shape_u, shape_v].map(|[along, across]| (along * ex + across * ey) / size);
            let terms = self.terms(n, [ru * ox + rv * oy, rv * ox - ru * oy], per_rim);
            let width = self.width(&terms);
            let half_px = (width.half_px * width.half_px + (square_half_px * square_half_px) as f32).sqrt();
            let (per_half, narrow) = (1.0 / half_px, width.half_px / half_px);
            let (narrow2, across_px) = (narrow * narrow, (size - radius_px) * per_gradient);
            // What the edge does beyond its own width, by how far across it the light is.
            let beyond_px =
                |share: f32| narrow2 * (self.bent_px(&terms, share) - self.curled_px(&terms, share, curvature));
            let gone_px = |share: f32| 0.5 * curvature * width.along_px2(share * share);
            let at = |share: f32| ((across_px - beyond_px(share) + gone_px(share)) * per_half).clamp(-1.0, 1.0);
            let share = at(at((across_px * per_half).clamp(-1.0, 1.0)));
            let even_gone_px = 0.5 * curvature * even2_px2 * (1.0 - share * share);
            let moved_px = (half_px - even_half_px) * share + beyond_px(share) - gone_px(share) + even_gone_px;
            *du -= moved_px * nu;
            *dv -= moved_px * nv;
        }
    }

    /// Distance from the middle to the outermost point of the rim, in radii.
    pub(crate) fn rim(&self, spot: &Spot) -> f64 {
        let [ox, oy] = self.outwards;
        1.0 / length(spot.inverse.map(|[along, across]| along * ox + across * oy))
    }

    /// What the edge sees whose normal is n, at a place of the rim along the radius of the image and across it, in radii.
    #[inline(always)]
    fn terms(&self, [nx, ny]: [f32; 2], [x, y]: [f32; 2], per_rim: f32) -> Terms {
        let grown = |px: f64, more_px: f64| px as f32 + more_px as f32 * (x * per_rim);
        let [blur, stretch] = [self.blur_px, self.stretch_px].map(|[px, more_px]| grown(px, more_px));
        let [a, b, c] = [0, 1, 2].map(|k| grown(self.coma_px[0][k], self.coma_px[1][k]));
        let [away, rim] = self.away.map(|share| share as f32);
        let (x, y) = (away + rim * x, rim * y);
        let per_length = 1.0 / (x * x + y * y).sqrt().max(1e-6);
        let n = [(x * nx + y * ny) * per_length, (x * ny - y * nx) * per_length];
        let (xx, yy) = (n[0] * n[0], n[1] * n[1]);
        Terms { n, blur, stretch, coma: [a, b, c], ends: a * xx + (b + c) * yy, middle: (a - c) * yy + b * xx }
    }
}

/// What an edge sees: its normal along the radius of the image there and across it; B, s, and a, b, c; and the factors of n_x
/// in A and C.
struct Terms {
    n: [f32; 2],
    blur: f32,
    stretch: f32,
    coma: [f32; 3],
    ends: f32,
    middle: f32,
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix2 as Square;

    use super::*;

    const RADIUS_PX: f64 = 40.0;

    fn smear(blur_px: f64) -> Smear {
        Smear {
            outwards: [0.8, 0.6],
            blur_px: [blur_px, 0.3],
            stretch_px: [0.8, -0.2],
            coma_px: [[0.5, 0.15, -0.3], [0.1, 0.05, -0.06]],
            spherical_px: 0.4,
            light_px: 0.0,
            falloff: [0.0; 2],
            left_px: 0.0,
            away: [0.9, 0.1],
        }
    }

    /// Where the point e of the unit disc is imaged through the point w of the pupil, along the radius and across it.
    fn image(smear: &Smear, [ex, ey]: [f64; 2], [wx, wy]: [f64; 2]) -> [f64; 2] {
        let [away, rim] = smear.away;
        let (sin, cos) = (rim * ey).atan2(away + rim * ex).sin_cos();
        let (wx, wy) = (cos * wx + sin * wy, cos * wy - sin * wx);
        let grown = |[px, more]: [f64; 2]| px + more * ex;
        let (blur, stretch) = (grown(smear.blur_px), grown(smear.stretch_px));
        let [a, b, c] = [0, 1, 2].map(|k| smear.coma_px[0][k] + smear.coma_px[1][k] * ex);
        let cubic = smear.spherical_px * (wx * wx + wy * wy - 2.0 / 3.0);
        let x = -(blur + stretch) * wx + a * wx * wx + b * wy * wy - 0.25 * (a + b) - cubic * wx;
        let y = -(blur - stretch) * wy + c * wx * wy - cubic * wy;
        [RADIUS_PX * ex + cos * x - sin * y, RADIUS_PX * ey + sin * x + cos * y]
    }

    /// Share of the light of a pixel at a place that comes from the dot, ray by ray.
    fn by_rays(place: [f64; 2], image: impl Fn([f64; 2], [f64; 2]) -> [f64; 2]) -> f64 {
        const RINGS: usize = 40;
        const SPOKES: usize = 96;
        const PIXEL: [f64; 4] = [-0.375, -0.125, 0.125, 0.375];
        let mut inside = 0;
        for ring in 0..RINGS {
            let rho = ((ring as f64 + 0.5) / RINGS as f64).sqrt();
            for spoke in 0..SPOKES {
                let (sin, cos) = (std::f64::consts::TAU * (spoke as f64 + 0.5) / SPOKES as f64).sin_cos();
                for (du, dv) in PIXEL.iter().flat_map(|du| PIXEL.map(|dv| (du, dv))) {
                    let mut e = [0.0; 2];
                    for _ in 0..6 {
                        let at = image(e, [rho * cos, rho * sin]);
                        e[0] += (place[0] + du - at[0]) / RADIUS_PX;
                        e[1] += (place[1] + dv - at[1]) / RADIUS_PX;
                    }
                    inside += usize::from(e[0] * e[0] + e[1] * e[1] < 1.0);
                }
            }
        }
        inside as f64 / (RINGS * SPOKES * PIXEL.len() * PIXEL.len()) as f64
    }

    #[test]
    fn evened_out_an_edge_is_that_of_an_even_disc() {
        // Of what there is between the dot and its ground; 4000 rays of 16 places are good to 0.0005. A blur as wide as the
        // aberrations is told less well.
        for (blur_px, light_max) in [(12.0, 1e-3), (3.0, 7e-3)] {
            let smear = smear(blur_px);
            let even_px = smear.even_blur_px();
            let mut spot = spot(even_px);
            spot.smear = Some(smear);
            let turn = Square::new(0.8, -0.6, 0.6, 0.8);
            for angle in [0.0_f64, 0.7, 1.6, 2.4, 3.1, 5.0] {
                for across_px in [-0.7, -0.2, 0.3, 0.6].map(|share| share * even_px) {
                    let n = [angle.cos(), angle.sin()];
                    let place = n.map(|along| along * (RADIUS_PX + across_px));
                    let on_page = turn * nalgebra::Vector2::from(place);
                    let mut places = Places::default();
                    places.push(on_page.x as f32, on_page.y as f32);
                    smear.even_out(&spot, &mut places);
                    let moved = turn.transpose() * nalgebra::Vector2::new(places.du[0], places.dv[0]).map(f64::from);
                    let exact = by_rays(place, |e, w| image(&smear, e, w));
                    let found = by_rays([moved.x, moved.y], |e, w| [0, 1].map(|k| RADIUS_PX * e[k] - even_px * w[k]));
                    let miss = found - exact;
                    assert!(miss.abs() < light_max, "{blur_px} {angle} {across_px}: {found} {exact}");
                }
            }
        }
    }

    fn spot(blur_px: f64) -> Spot {
        Spot {
            centre_px: [0.0; 2],
            radius_px: RADIUS_PX,
            blur_px,
            blur_growth_px: 0.0,
            shape: [[1.0, 0.0], [0.0, 1.0]],
            inverse: [[1.0, 0.0], [0.0, 1.0]],
            ways: Default::default(),
            axis_px: [0.0; 2],
            pitch_mm: 0.01,
            smear: None,
            bend: None,
        }
    }
}
