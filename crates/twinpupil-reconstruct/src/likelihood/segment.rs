//! The part of a pupil before which a dot stands, where the dot's outline crosses the pupil's rim twice: two segments, one
//! of the pupil's circle and one of the outline's ellipse, on the two sides of the chord between the crossings.
//!
//! ```text
//! area = π − (ψ − sinψ cosψ) + K/√det M · (η − sinη cosη)
//! ```
//!
//! with 2ψ the angle of the chord as the pupil's centre sees it, and 2η that as the centre of the ellipse `pᵀMp = K` sees it
//! where the ellipse is a circle.

use std::f32::consts::PI;

use crate::likelihood::light::{EdgeView, Local};
use crate::likelihood::soft::angles;

/// Newton's steps along the rim to a crossing; the first guess is exact where the outline is symmetric.
const STEPS: usize = 2;

/// The longest of them, rad.
const STEP_MAX: f32 = 0.3;

/// `xx x² + 2 xy x y + yy y² + 2 x x + 2 y y + one`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Conic {
    xx: f32,
    xy: f32,
    yy: f32,
    x: f32,
    y: f32,
    one: f32,
}

impl Conic {
    /// The dot behind the pupil of a place, negative where it is, in units of its squared radius: what [`Dots`] hold.
    ///
    /// [`Dots`]: crate::likelihood::chords::Dots
    #[inline(always)]
    pub(crate) fn behind(local: &Local, edge: &EdgeView, [du, dv]: [f32; 2]) -> Self {
        let ([[xx, xy], [yx, yy]], per_radius) = (local.inverse, 1.0 / local.radius_px);
        let turn = |u: f32, v: f32| [xx.mul_add(u, xy * v) * per_radius, yx.mul_add(u, yy * v) * per_radius];
        let (cos, sin, outwards_px) = (edge.normal_u, edge.normal_v, edge.curvature_px());
        let (u, v) = (outwards_px.mul_add(cos, du), outwards_px.mul_add(sin, dv));
        let [sx, sy] = turn(u, v);
        let blur_px = local.blur_growth_px.mul_add(sx, local.blur_px);
        let [growth_u, growth_v] = local.blur_gradient;
        let (g, h) = (growth_u.mul_add(cos, growth_v * sin), growth_v.mul_add(cos, -growth_u * sin));
        let [ax, ay] = turn(blur_px.mul_add(cos, -g * u), blur_px.mul_add(sin, -g * v));
        let [bx, by] = turn(-blur_px.mul_add(sin, h * u), blur_px.mul_add(cos, -h * v));
        Self {
            xx: ax.mul_add(ax, ay.mul_add(ay, -g * g)),
            xy: ax.mul_add(bx, ay.mul_add(by, -g * h)),
            yy: bx.mul_add(bx, by.mul_add(by, -h * h)),
            x: sx.mul_add(ax, sy.mul_add(ay, g)),
            y: sx.mul_add(bx, sy.mul_add(by, h)),
            one: sx.mul_add(sx, sy.mul_add(sy, -1.0)),
        }
    }

    /// In coordinates of which the first runs along (cos, sin).
    #[inline(always)]
    fn turned(self, cos: f32, sin: f32) -> Self {
        let Self { xx, xy, yy, x, y, one } = self;
        let (cos2, sin2, mixed) = (cos * cos, sin * sin, 2.0 * cos * sin * xy);
        Self {
            xx: cos2.mul_add(xx, sin2.mul_add(yy, mixed)),
            xy: (cos2 - sin2).mul_add(xy, cos * sin * (yy - xx)),
            yy: sin2.mul_add(xx, cos2.mul_add(yy, -mixed)),
            x: cos.mul_add(x, sin * y),
            y: cos.mul_add(y, -sin * x),
            one,
        }
    }

    /// In coordinates of which the first runs through the place on the rim where it is least, or greatest, whichever is
    /// nearer to 0.
    #[inline(always)]
    fn upright(self) -> Self {
        let per_growth = 1.0 / self.x.mul_add(self.x, self.y * self.y).max(1e-30).sqrt();
        let outwards = self.turned(self.x * per_growth, self.y * per_growth);
        // Its change along the rim at ±1 is 2 (xy ± y), and grows by 2 (yy − xx ∓ x).
        let side: f32 = if outwards.one + outwards.yy > 0.0 { -1.0 } else { 1.0 };
        let turn =
            side.mul_add(outwards.xy, outwards.y) / side.mul_add(outwards.xx - outwards.yy, outwards.x).max(1e-30);
        let turn = turn.clamp(-STEP_MAX, STEP_MAX);
        let cos = shortened(turn);
        outwards.turned(cos, cos * turn)
    }

    /// Newton's way along the rim from x to where it is 0, above and below the axis.
    #[inline(always)]
    fn crossings(&self, x: f32, y: f32) -> [(f32, f32); 2] {
        let (mut above, mut below) = ((x, y), (x, -y));
        for _ in 0..STEPS {
            let ([value_a, slope_a], [value_b, slope_b]) = (self.along_rim(above), self.along_rim(below));
            // One division for both.
            let inverse = 1.0 / (slope_a * slope_b);
            above = stepped(above, value_a * slope_b * inverse);
            below = stepped(below, value_b * slope_a * inverse);
        }
        [above, below]
    }

    /// Its value on the rim, and its change along that.
    #[inline(always)]
    fn along_rim(&self, (x, y): (f32, f32)) -> [f32; 2] {
        let along_x = self.xx.mul_add(x, self.xy.mul_add(y, self.x));
        let along_y = self.xy.mul_add(x, self.yy.mul_add(y, self.y));
        let value = (along_x + self.x).mul_add(x, (along_y + self.y).mul_add(y, self.one));
        let slope = 2.0 * along_y.mul_add(x, -along_x * y);
        [value, slope.abs().max(1e-6).copysign(slope)]
    }
}

/// A point of the rim after a step against it.
#[inline(always)]
fn stepped((x, y): (f32, f32), step: f32) -> (f32, f32) {
    let step = step.clamp(-STEP_MAX, STEP_MAX);
    let share = shortened(step);
    (share * step.mul_add(y, x), share * step.mul_add(-x, y))
}

/// `1/√(1 + t²)` up to [`STEP_MAX`], 10⁻⁷ off at most.
#[inline(always)]
fn shortened(t: f32) -> f32 {
    let square = t * t;
    square.mul_add(square.mul_add(square.mul_add(square.mul_add(0.25, -0.3125), 0.375), -0.5), 1.0)
}

/// Share of the unit disc in which a quadratic is negative that is no more curved than the disc.
#[inline(always)]
pub(crate) fn meeting(conic: Conic) -> f32 {
    let conic = conic.upright();
    let Conic { xx: a, xy: b, yy: c, x: g, y: e, one } = conic;
    // Where the rim is crossed if both sides are alike.
    let x0 = -(one + c) / (g + g.mul_add(g, -(a - c) * (one + c)).max(0.0).sqrt()).max(1e-30);
    let y0 = x0.mul_add(-x0, 1.0).max(0.0).sqrt();
    let (start, is_crossed) = (x0.clamp(-1.0, 1.0), x0.abs() < 1.0);
    let [(x1, y1), (x2, y2)] = conic.crossings(start, y0);
    let (dx, dy) = (x1 - x2, y1 - y2);
    // Times the chord's length: half of it, and how far it lies along its normal from the centre of the disc.
    let half_square = 0.5 * dx.mul_add(dx, dy * dy).max(1e-12);
    let beyond = 0.5 * (x1 + x2).mul_add(dy, -(y1 + y2) * dx);
    // Times det M: where the centre of the ellipse lies, K, and times the chord's length too how far that lies from there.
    let det = a.mul_add(c, -b * b).max(1e-14);
    let (middle_x, middle_y) = (b.mul_add(e, -g * c), g.mul_add(b, -a * e));
    let beyond_ellipse = beyond.mul_add(det, middle_y.mul_add(dx, -middle_x * dy));
    let square = (-g.mul_add(middle_x, e.mul_add(middle_y, one * det))).max(1e-6 * det);
    // One division for the inverse of K, det²/square det, and that of det M.
    let inverse = 1.0 / (square * det);
    let per_det = square * inverse;
    let along = 0.25 * (a * dx).mul_add(dx, (2.0 * b).mul_add(dx, c * dy) * dy);
    let sin2 = (along * inverse * (det * det)).min(1.0);
    let size = square * (per_det * per_det) * det.sqrt();
    // η − sinη cosη of both segments.
    let product = sin2.mul_add(-sin2, sin2).sqrt();
    let is_acute = beyond_ellipse > 0.0;
    let product = if is_acute { product } else { -product };
    let [of_disc, of_ellipse] = angles([half_square, sin2], [beyond, product]);
    let of_ellipse = if is_acute && sin2 < SERIES { small_segment(product, sin2) } else { of_ellipse - product };
    let area = size.mul_add(of_ellipse, beyond.mul_add(0.5, PI - of_disc));
    let crossed = (area * (1.0 / PI)).clamp(0.0, 1.0);
    let uncrossed = if x0 > 0.0 { 1.0 } else { 0.0 };
    if is_crossed { crossed } else { uncrossed }
}

/// Up to this sin²η [`small_segment`] is good to 10⁻⁷.
const SERIES: f32 = 0.12;

/// `η − sinη cosη` of a small angle, by `η = sinη cosη (1 + 2/3 sin²η + 2·4/(3·5) sin⁴η + …)`.
#[inline(always)]
fn small_segment(product: f32, sin2: f32) -> f32 {
    const COEFFICIENTS: [f32; 6] = [2.0 / 3.0, 8.0 / 15.0, 16.0 / 35.0, 128.0 / 315.0, 256.0 / 693.0, 1024.0 / 3003.0];
    product * sin2 * COEFFICIENTS.iter().rev().fold(0.0_f32, |sum, coefficient| sum.mul_add(sin2, *coefficient))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Share of the unit disc in which a conic is negative, by lines along the direction in which it changes least.
    fn counted(conic: Conic) -> f64 {
        const LINES: usize = 4000;
        let Conic { xx, xy, yy, x, y, one } = conic;
        let [xx, xy, yy, x, y, one] = [xx, xy, yy, x, y, one].map(f64::from);
        let mut sum = 0.0;
        for line in 0..LINES {
            let v = (line as f64 + 0.5) / LINES as f64 * 2.0 - 1.0;
            let rim = (1.0 - v * v).sqrt();
            // xx u² + 2 (xy v + x) u + (yy v² + 2 y v + one) < 0
            let (b, c) = (xy * v + x, yy * v * v + 2.0 * y * v + one);
            let root = b * b - xx * c;
            if root > 0.0 {
                let (low, high) = ((-b - root.sqrt()) / xx, (-b + root.sqrt()) / xx);
                sum += (high.min(rim) - low.max(-rim)).max(0.0);
            }
        }
        sum * 2.0 / LINES as f64 / std::f64::consts::PI
    }

    impl Conic {
        fn scaled(self, by: f32) -> Self {
            let Self { xx, xy, yy, x, y, one } = self;
            Self { xx: by * xx, xy: by * xy, yy: by * yy, x: by * x, y: by * y, one: by * one }
        }
    }

    /// The disc of radius `size` about (u, v), sheared.
    fn ellipse(size: f32, u: f32, v: f32, shear: f32, narrow: f32) -> Conic {
        // |((x − u) + shear (y − v), (y − v)/narrow)|² < size²
        let (xx, xy, yy) = (1.0, shear, shear * shear + 1.0 / (narrow * narrow));
        Conic {
            xx,
            xy,
            yy,
            x: -(xx * u + xy * v),
            y: -(xy * u + yy * v),
            one: xx * u * u + 2.0 * xy * u * v + yy * v * v - size * size,
        }
    }

    #[test]
    fn two_segments_make_the_meeting() {
        for size in [2.0_f32, 5.0, 20.0, 200.0] {
            for narrow in [0.8_f32, 1.0] {
                for shear in [-0.3, 0.0, 0.2] {
                    for angle_rad in [0.0_f32, 0.7, 1.6, 3.0, 4.4] {
                        for off in [-0.95, -0.7, -0.2, 0.0, 0.4, 0.8, 0.95] {
                            let reach = size + off;
                            let (u, v) = (reach * angle_rad.cos(), reach * narrow * angle_rad.sin());
                            // In units of the dot's radius, as it is of a dot behind the pupil.
                            let conic = ellipse(size, u, v, shear, narrow).scaled(1.0 / (size * size));
                            let (found, expected) = (f64::from(meeting(conic)), counted(conic));
                            assert!(
                                (found - expected).abs() < 1e-4,
                                "{size} {narrow} {shear} {angle_rad} {off}: {found} is not {expected}"
                            );
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn what_does_not_cross_is_all_or_nothing() {
        assert_eq!(meeting(ellipse(5.0, 1.0, 0.5, 0.1, 0.9)), 1.0);
        assert_eq!(meeting(ellipse(5.0, 7.0, 0.5, 0.1, 0.9)), 0.0);
    }
}
