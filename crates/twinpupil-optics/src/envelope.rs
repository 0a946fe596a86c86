//! What the facets of a Fresnel lens tend to as its grooves get finer: the plane of the peaks with the slope of a facet at
//! every radius, and no walls.

use twinpupil_instrument::FresnelLens;

use crate::grooves::facet_at;
use crate::least_squares::least_squares;
use crate::refraction::Vector;

/// The slope over the radius, a polynomial in x = 2 (r/R)² − 1.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Envelope {
    coefficients_per_mm: Vec<f64>,
    radius_mm: f64,
}

/// Its degree, and the radii that it is fitted at: the slope of a facet differs from it by 1e-9.
const DEGREE: usize = 14;
const NODES: u32 = 60;

impl Envelope {
    /// That of a lens; `index` is that of its glass at the design wavelength.
    pub(crate) fn of(lens: &FresnelLens, index: f64) -> Self {
        let radius_mm = 0.5 * lens.size_mm[0].hypot(lens.size_mm[1]);
        // Those of Chebyshev, which keep the ends from swinging.
        let places: Vec<f64> =
            (0..NODES).map(|k| (std::f64::consts::PI * (f64::from(k) + 0.5) / f64::from(NODES)).cos()).collect();
        let slope_per_mm = |x: &f64| {
            let r_mm = radius_mm * (0.5 * (1.0 + x)).sqrt();
            facet_at(lens, index, r_mm).slope(r_mm) / r_mm
        };
        let slopes_per_mm: Vec<f64> = places.iter().map(slope_per_mm).collect();
        let column = |power: i32| places.iter().map(|x| x.powi(power)).collect();
        let rights = [slopes_per_mm, vec![0.0; places.len()]];
        let factors = least_squares((0..=DEGREE as i32).map(column).collect(), rights);
        Self { coefficients_per_mm: factors.into_iter().map(|[factor, _]| factor).collect(), radius_mm }
    }

    /// A normal at a place in the plane of the peaks, not of unit length.
    pub(crate) fn normal(&self, [x_mm, y_mm, _]: Vector) -> Vector {
        let x = 2.0 * (x_mm * x_mm + y_mm * y_mm) / (self.radius_mm * self.radius_mm) - 1.0;
        let slope_per_mm = self.coefficients_per_mm.iter().rev().fold(0.0, |sum: f64, factor| sum.mul_add(x, *factor));
        [slope_per_mm * x_mm, slope_per_mm * y_mm, -1.0]
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::GrooveSide;

    use super::*;

    #[test]
    fn it_has_the_slopes_of_facets() {
        const INDEX: f64 = 1.4918;
        for side in [GrooveSide::Object, GrooveSide::Image] {
            let lens = crate::plate::tests::lens(side);
            let envelope = Envelope::of(&lens, INDEX);
            for r_mm in [0.01, 1.0, 7.3, 20.0, 37.9, 54.0] {
                let [nx, _, nz] = envelope.normal([r_mm, 0.0, 0.0]);
                let own = facet_at(&lens, INDEX, r_mm).slope(r_mm);
                assert!((nx / -nz - own).abs() < 1e-8 * r_mm, "{side:?} {r_mm}: {} {own}", nx / -nz);
                // That of a facet is the same where it starts, but for what it is cut for the middle of itself.
                let coarse = crate::grooves::grooves(&lens, INDEX).unwrap()[(r_mm / lens.groove_pitch_mm) as usize];
                let off =
                    coarse.facet.slope(coarse.peak_mm) - facet_at(&lens, INDEX, coarse.peak_mm).slope(coarse.peak_mm);
                assert!(off.abs() < 1e-3, "{side:?} {r_mm}: {off}");
            }
        }
    }
}
