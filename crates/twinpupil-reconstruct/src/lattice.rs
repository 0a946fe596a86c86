//! What a coarse lattice of pixels does to the centroid of a feature with sharp edges.
//!
//! On a mosaic each plane sees every other pixel, so an edge that is sharper than the lattice falls between pixels and
//! the centroid jumps by some hundredths of a pixel: near focus, ten times the noise. The jump depends on nothing but
//! the feature's outline, so it is computed for an ellipse of the feature's own second moments and edge width, and
//! taken off. (It is a control variate: whatever of the feature the ellipse does not describe stays in the centroid.)

/// An evenly lit ellipse with an edge, in pixels of the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ellipse {
    /// Its matrix S, as cc, cr, rr: the edge is where `uᵀ S⁻¹ u = 1`.
    matrix: [f64; 3],
    /// Radius of the blur of its edge.
    blur: f64,
}

/// Edges blurred over a larger radius than this are smooth on the lattice.
pub(crate) const BLUR_MAX: f64 = 1.5;

/// What a window holds, summed about its centre.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Shape {
    pub(crate) light: f64,
    pub(crate) squares: f64,
    /// Sum of the pixels' variances.
    pub(crate) scatter: f64,
    /// Second moments, as cc, cr, rr.
    pub(crate) second: [f64; 3],
}

/// Moves a centroid by what the lattice does to it, to the centroid of the light between the pixels too.
///
/// `pixel_width` is the side of a pixel in units of the lattice: 1/2 on a Bayer mosaic.
pub(crate) fn off_lattice(shape: &Shape, centre: [f64; 2], pixel_width: f64) -> [f64; 2] {
    const SMALL: f64 = 0.005;
    let Some(ellipse) = Ellipse::of(shape, pixel_width).filter(|ellipse| ellipse.blur <= BLUR_MAX) else {
        return centre;
    };
    let sway = ellipse.sway(pixel_width);
    let settled = |shift: [f64; 2]| [centre[0] - shift[0], centre[1] - shift[1]];
    // The jump as it is at the centroid, and if that is not small, as it is where the feature then seems to be.
    let shift = sway.at(centre);
    if shift[0].abs().max(shift[1].abs()) < SMALL {
        return settled(shift);
    }
    settled(sway.at(settled(shift)))
}

impl Ellipse {
    /// The ellipse of a feature's second moments. Its edge is as wide as the half-lit light on it demands:
    ///
    /// ```text
    /// Σ (I/A)(1 − I/A) = perimeter · σ/√π          for an edge that rises like a normal distribution of width σ
    /// ```
    fn of(shape: &Shape, pixel_width: f64) -> Option<Self> {
        let Shape { light, squares, scatter, second } = *shape;
        // Second moments of an ellipse are a quarter of its matrix.
        let [cc, cr, rr] = second.map(|moment| 4.0 * moment / light);
        if !(light > 0.0 && cc > 0.0 && cc * rr - cr * cr > 1.0) {
            return None;
        }
        let (a, b) = semi_axes(cc, cr, rr);
        let height = light / (std::f64::consts::PI * a * b);
        let half_lit = (light - (squares - scatter) / height) / height;
        // Ramanujan's perimeter.
        let perimeter = std::f64::consts::PI * (3.0 * (a + b) - ((3.0 * a + b) * (a + 3.0 * b)).sqrt());
        let width = half_lit.max(0.0) / perimeter * std::f64::consts::PI.sqrt();
        // The pixel's own share of the width has a variance of 1/12 of its side squared, the blur's a quarter of its
        // radius squared.
        let blur = 2.0 * (width * width - pixel_width * pixel_width / 12.0).max(0.0).sqrt();
        Some(Self { matrix: [cc, cr, rr], blur })
    }

    /// Centroid of the ellipse as the pixels see it, less its centre c.
    ///
    /// The sum over the lattice is one over its waves (Poisson's summation), of which few are left:
    ///
    /// ```text
    /// shift = Σ_G 2 sin(G·c) ∇F(G)                    G = 2π (m, n), one of each pair ±G
    /// F(k)  = 2 J₁(q)/q · sinc(k₁ w/2) sinc(k₂ w/2) · 2 J₁(|k| b)/(|k| b)          q = √(kᵀ S k)
    /// ```
    ///
    /// for pixels of width w and a blur of radius b. The waves are those at their crests, sin(G·c) = 1. Only the ellipse's own factor changes fast enough with k for its
    /// slope to matter: d(2 J₁(q)/q)/dq = −2 J₂(q)/q.
    fn sway(&self, pixel_width: f64) -> Sway {
        let [cc, cr, rr] = self.matrix;
        // Of the orders 0, 1 and 3, and of the waves whose squared lengths are 1, 2, 9 and 10 turns.
        let seen = [0.0, 1.0, 3.0].map(|order| sinc(std::f64::consts::PI * order * pixel_width));
        let blurred =
            [1.0_f64, 2.0, 9.0, 10.0].map(|turns2| bessel_1_over(self.blur * std::f64::consts::TAU * turns2.sqrt()));
        let pull = |[m, n]: [i32; 2]| {
            let [k1, k2] = [m, n].map(|order| std::f64::consts::TAU * f64::from(order));
            let through = seen[place(m.unsigned_abs())] * seen[place(n.unsigned_abs())];
            if through.abs() < 1e-9 {
                return [0.0; 2];
            }
            let pull = [cc * k1 + cr * k2, cr * k1 + rr * k2];
            let q2 = k1 * pull[0] + k2 * pull[1];
            let blurred = match m * m + n * n {
                1 => blurred[0],
                2 => blurred[1],
                9 => blurred[2],
                _ => blurred[3],
            };
            let size = -4.0 * bessel_2(q2.sqrt()) / q2 * through * blurred;
            pull.map(|pull| size * pull)
        };
        Sway { pulls: WAVES.map(pull) }
    }
}

/// Place of an order among 0, 1 and 3.
fn place(order: u32) -> usize {
    order.min(2) as usize
}

/// How the centroid moves against the centre wherever on the lattice that lies: what every wave adds at its crest.
struct Sway {
    pulls: [[f64; 2]; WAVES.len()],
}

impl Sway {
    /// The move at a centre.
    fn at(&self, centre: [f64; 2]) -> [f64; 2] {
        let turns = centre.map(|coordinate| (std::f64::consts::TAU * coordinate.fract()).sin_cos());
        let mut shift = [0.0; 2];
        for ([m, n], pull) in WAVES.into_iter().zip(&self.pulls) {
            let ((sin_1, cos_1), (sin_2, cos_2)) = (multiple(turns[0], m), multiple(turns[1], n));
            let wave = sin_1 * cos_2 + cos_1 * sin_2;
            shift = [shift[0] + wave * pull[0], shift[1] + wave * pull[1]];
        }
        shift
    }
}

/// Waves of the lattice that matter. They fall with |G|^(−3/2) and with both orders, so that the largest that is left
/// out, [5, 0], is a fiftieth of the first.
const WAVES: [[i32; 2]; 10] = [[1, 0], [0, 1], [1, 1], [1, -1], [3, 0], [0, 3], [3, 1], [3, -1], [1, 3], [1, -3]];

/// Sine and cosine of an angle times −3, −1, 0, 1 or 3.
fn multiple((sin, cos): (f64, f64), times: i32) -> (f64, f64) {
    let sign = f64::from(times.signum());
    match times.abs() {
        0 => (0.0, 1.0),
        1 => (sign * sin, cos),
        _ => (sign * sin * (3.0 - 4.0 * sin * sin), cos * (4.0 * cos * cos - 3.0)),
    }
}

fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-9 { 1.0 } else { x.sin() / x }
}

/// J₂ of a large argument, by the first two terms of Hankel's expansion  [Abramowitz and Stegun, 9.2.5].
fn bessel_2(x: f64) -> f64 {
    let (sin, cos) = (x - 1.25 * std::f64::consts::PI).sin_cos();
    (2.0 / (std::f64::consts::PI * x)).sqrt() * (cos - 15.0 / (8.0 * x) * sin)
}

/// 2 J₁(x)/x, 1 at zero  [Abramowitz and Stegun, 9.4.4, 9.2.5].
fn bessel_1_over(x: f64) -> f64 {
    const SERIES: [f64; 7] =
        [0.5, -0.562_499_85, 0.210_935_73, -0.039_542_89, 0.004_433_19, -0.000_317_61, 0.000_011_09];
    if x < 3.0 {
        let y = (x / 3.0).powi(2);
        return 2.0 * SERIES.iter().rev().fold(0.0, |sum, term| sum * y + term);
    }
    let (sin, cos) = (x - 0.75 * std::f64::consts::PI).sin_cos();
    2.0 / x * (2.0 / (std::f64::consts::PI * x)).sqrt() * (cos - 3.0 / (8.0 * x) * sin)
}

/// Semi-axes of the ellipse with a matrix.
fn semi_axes(cc: f64, cr: f64, rr: f64) -> (f64, f64) {
    let half = 0.5 * (cc - rr);
    let (mean, difference) = (0.5 * (cc + rr), (half * half + cr * cr).sqrt());
    ((mean + difference).sqrt(), (mean - difference).max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bessel_functions_have_their_tabulated_values() {
        for (x, j1) in [(0.5, 0.242_268), (2.0, 0.576_725), (5.0, -0.327_579), (9.0, 0.245_312)] {
            assert!((0.5 * x * bessel_1_over(x) - j1).abs() < 4e-3, "{x}");
        }
        for (x, j2) in [(10.0, 0.254_630), (20.0, -0.160_341)] {
            assert!((bessel_2(x) - j2).abs() < 4e-3, "{x}");
        }
    }

    /// Centroid of a sharp disc on a lattice of pixels, integrated by brute force.
    fn sampled_centroid(centre: [f64; 2], radius: f64, pixel_width: f64) -> [f64; 2] {
        const FINE: usize = 40;
        let (mut light, mut moment) = (0.0, [0.0; 2]);
        for row in 0..60 {
            for column in 0..60 {
                let offset = |k: usize| pixel_width * ((k as f64 + 0.5) / FINE as f64 - 0.5);
                let inside = (0..FINE * FINE)
                    .filter(|k| {
                        let (u, v) = (f64::from(column) + offset(k % FINE), f64::from(row) + offset(k / FINE));
                        (u - centre[0]).hypot(v - centre[1]) < radius
                    })
                    .count();
                light += inside as f64;
                moment[0] += inside as f64 * f64::from(column);
                moment[1] += inside as f64 * f64::from(row);
            }
        }
        moment.map(|m| m / light)
    }

    #[test]
    fn the_jump_of_a_sharp_disc_is_foreseen() {
        let (centre, radius) = ([29.37, 30.21], 21.7);
        let ellipse = Ellipse { matrix: [radius * radius, 0.0, radius * radius], blur: 0.0 };
        let shift = ellipse.sway(0.5).at(centre);
        let sampled = sampled_centroid(centre, radius, 0.5);
        for axis in 0..2 {
            let jump = sampled[axis] - centre[axis];
            assert!(jump.abs() > 5e-4 && (shift[axis] - jump).abs() < 0.1 * jump.abs(), "{shift:?} {sampled:?}");
        }
    }
}
