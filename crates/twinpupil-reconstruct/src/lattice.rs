//! What a coarse lattice of pixels does to the centroid of a feature with sharp edges.
//!
//! On a mosaic each plane sees every other pixel, so an edge that is sharper than the lattice falls between pixels and
//! the centroid jumps by some hundredths of a pixel: near focus, ten times the noise. The jump depends on nothing but
//! the feature's outline, so it is computed for an ellipse of the feature's own second moments and edge width, and
//! taken off. (It is a control variate: whatever of the feature the ellipse does not describe stays in the centroid.)

use crate::contrast::Contrast;
use crate::noise::Noise;
use crate::window::Windows;

/// An evenly lit ellipse with an edge, in pixels of the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ellipse {
    /// Inverse of its matrix: the edge is where `uᵀ S⁻¹ u = 1`.
    inverse: [f64; 3],
    /// Extent along columns and rows.
    extent: [f64; 2],
    /// Its shorter semi-axis.
    semi_minor: f64,
    /// Radius of the blur of its edge.
    blur: f64,
}

/// Edges blurred over a larger radius than this are smooth on the lattice.
pub(crate) const BLUR_MAX: f64 = 1.5;

/// Moves centres by what the lattice does to them.
///
/// `pixel_width` is the side of a pixel in units of the lattice: 1/2 on a Bayer mosaic. `centre` is the centroid as
/// measured in the feature's window; the return value is the centroid of the light between the pixels too.
pub(crate) fn off_lattice(
    windows: &Windows<'_>,
    contrast: &Contrast,
    noise: &Noise,
    feature: usize,
    centre: [f64; 2],
    pixel_width: f64,
) -> [f64; 2] {
    const SMALL: f64 = 0.005;
    let Some(ellipse) = Ellipse::of(windows, contrast, noise, feature, pixel_width) else { return centre };
    if ellipse.blur > BLUR_MAX {
        return centre;
    }
    let settled = |shift: [f64; 2]| [centre[0] - shift[0], centre[1] - shift[1]];
    // The jump as it is at the centroid, and if that is not small, as it is where the feature then seems to be.
    let shift = ellipse.lattice_shift(centre, pixel_width);
    if shift[0].abs().max(shift[1].abs()) < SMALL {
        return settled(shift);
    }
    settled(ellipse.lattice_shift(settled(shift), pixel_width))
}

impl Ellipse {
    /// The ellipse of a feature's second moments. Its edge is as wide as the half-lit light on it demands:
    ///
    /// ```text
    /// Σ (I/A)(1 − I/A) = perimeter · σ/√π          for an edge that rises like a normal distribution of width σ
    /// ```
    fn of(windows: &Windows<'_>, contrast: &Contrast, noise: &Noise, feature: usize, pixel_width: f64) -> Option<Self> {
        let [c0, r0] = windows.centres[feature];
        let (mut sum, mut squares, mut scatter, mut second) = (0.0, 0.0, 0.0, [0.0; 3]);
        windows.for_each_pixel(feature, |pixel| {
            let (dc, dr) = (pixel.column - c0, pixel.row - r0);
            sum += pixel.signal;
            squares += pixel.signal * pixel.signal;
            scatter += pixel.share * pixel.share * noise.variance(contrast.code(pixel.contrast));
            second[0] += dc * dc * pixel.signal;
            second[1] += dc * dr * pixel.signal;
            second[2] += dr * dr * pixel.signal;
        });
        // Second moments of an ellipse are a quarter of its matrix.
        let [cc, cr, rr] = second.map(|moment| 4.0 * moment / sum);
        let determinant = cc * rr - cr * cr;
        if !(sum > 0.0 && cc > 0.0 && determinant > 1.0) {
            return None;
        }
        let (a, b) = semi_axes(cc, cr, rr);
        let height = sum / (std::f64::consts::PI * a * b);
        let half_lit = (sum - (squares - scatter) / height) / height;
        // Ramanujan's perimeter.
        let perimeter = std::f64::consts::PI * (3.0 * (a + b) - ((3.0 * a + b) * (a + 3.0 * b)).sqrt());
        let width = half_lit.max(0.0) / perimeter * std::f64::consts::PI.sqrt();
        // The pixel's own share of the width has a variance of 1/12 of its side squared, the blur's a quarter of its
        // radius squared.
        let blur = 2.0 * (width * width - pixel_width * pixel_width / 12.0).max(0.0).sqrt();
        Some(Self {
            inverse: [rr / determinant, -cr / determinant, cc / determinant],
            extent: [cc.sqrt(), rr.sqrt()],
            semi_minor: b,
            blur,
        })
    }

    /// Centroid of the ellipse as the pixels see it, less its centre.
    fn lattice_shift(&self, centre: [f64; 2], pixel_width: f64) -> [f64; 2] {
        let margin = self.blur + pixel_width;
        // Below the first level a pixel lies wholly inside, above the second wholly outside.
        let certain = [(1.0 - margin / self.semi_minor).max(0.0).powi(2), (1.0 + margin / self.semi_minor).powi(2)];
        let (mut light, mut moment) = (0.0, [0.0; 2]);
        let rows = (centre[1] - self.extent[1] - margin).ceil() as i64..=(centre[1] + self.extent[1] + margin) as i64;
        let columns =
            (centre[0] - self.extent[0] - margin).ceil() as i64..=(centre[0] + self.extent[0] + margin) as i64;
        for row in rows {
            for column in columns.clone() {
                let u = [column as f64 - centre[0], row as f64 - centre[1]];
                let level2 = self.level2(u);
                if level2 > certain[1] {
                    continue;
                }
                let seen = if level2 < certain[0] { 1.0 } else { self.pixel(u, pixel_width, margin) };
                light += seen;
                moment[0] += seen * u[0];
                moment[1] += seen * u[1];
            }
        }
        if light > 0.0 { moment.map(|m| m / light) } else { [0.0; 2] }
    }

    /// `uᵀ S⁻¹ u`: 1 on the edge.
    fn level2(&self, u: [f64; 2]) -> f64 {
        let [cc, cr, rr] = self.inverse;
        cc * u[0] * u[0] + 2.0 * cr * u[0] * u[1] + rr * u[1] * u[1]
    }

    /// Light in a pixel centred at `u` from the ellipse's centre, 0 to 1.
    fn pixel(&self, u: [f64; 2], pixel_width: f64, margin: f64) -> f64 {
        let [cc, cr, rr] = self.inverse;
        let gradient = [cc * u[0] + cr * u[1], cr * u[0] + rr * u[1]];
        let level = self.level2(u).sqrt();
        let steepness = (gradient[0] * gradient[0] + gradient[1] * gradient[1]).sqrt() / level.max(1e-12);
        let depth = (1.0 - level) / steepness.max(1e-12);
        if level < 1e-6 || depth >= margin {
            return 1.0;
        }
        if depth <= -margin {
            return 0.0;
        }
        let normal = gradient.map(|g| (g / (steepness * level)).abs() * pixel_width);
        // Positions across a round blur that stand for a sixth of its light each.
        const ACROSS: [f64; 3] = [0.131, 0.404, 0.724];
        let blurred = |s: f64| half_plane(depth + s * self.blur, normal) + half_plane(depth - s * self.blur, normal);
        ACROSS.iter().map(|&s| blurred(s)).sum::<f64>() / (2 * ACROSS.len()) as f64
    }
}

/// Semi-axes of the ellipse with a matrix.
fn semi_axes(cc: f64, cr: f64, rr: f64) -> (f64, f64) {
    let (mean, difference) = (0.5 * (cc + rr), (0.5 * (cc - rr)).hypot(cr));
    ((mean + difference).sqrt(), (mean - difference).max(0.0).sqrt())
}

/// Share of a square pixel that lies inside a straight edge `depth` beyond its centre, for the pixel's side times the
/// absolute components of the edge's normal. Seen along the normal the pixel is a trapezoid.
fn half_plane(depth: f64, side_normal: [f64; 2]) -> f64 {
    let (wide, narrow) = (side_normal[0].max(side_normal[1]), side_normal[0].min(side_normal[1]).max(1e-9));
    let (foot, top) = (0.5 * (wide + narrow), 0.5 * (wide - narrow));
    let outside = |t: f64| (foot - t).powi(2) / (2.0 * wide * narrow);
    match depth {
        t if t >= foot => 1.0,
        t if t <= -foot => 0.0,
        t if t > top => 1.0 - outside(t),
        t if t < -top => outside(-t),
        t => 0.5 + t / wide,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_pixel_lies_inside_an_edge_through_its_centre() {
        for normal in [[1.0, 0.0], [0.6, 0.8], [0.707, 0.707]] {
            assert!((half_plane(0.0, normal) - 0.5).abs() < 1e-12);
            assert_eq!((half_plane(1.0, normal), half_plane(-1.0, normal)), (1.0, 0.0));
        }
        // A diagonal edge through a corner of the inner square: the triangle outside has area (√½ − t)².
        let t = 0.5;
        let diagonal = 0.5_f64.sqrt();
        assert!((half_plane(t, [diagonal, diagonal]) - (1.0 - (diagonal - t).powi(2))).abs() < 1e-9);
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
        let ellipse = Ellipse {
            inverse: [1.0 / (radius * radius), 0.0, 1.0 / (radius * radius)],
            extent: [radius; 2],
            semi_minor: radius,
            blur: 0.0,
        };
        let shift = ellipse.lattice_shift(centre, 0.5);
        let sampled = sampled_centroid(centre, radius, 0.5);
        for axis in 0..2 {
            let jump = sampled[axis] - centre[axis];
            assert!(jump.abs() > 5e-4 && (shift[axis] - jump).abs() < 0.1 * jump.abs(), "{shift:?} {sampled:?}");
        }
    }
}
