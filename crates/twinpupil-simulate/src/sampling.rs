//! Low-discrepancy points of the pupil and of the pixel.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// The most samples of one set: the Sobol' sequence used here ends there.
pub const PUPIL_SAMPLES_MAX: usize = 1 << 16;

/// Number of differently scrambled sets, so that the sampling errors of neighbouring pixels do not add up.
const SETS: usize = 16;

/// One set of samples, as structure of arrays.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SampleSet {
    /// Points spread evenly over the unit disc.
    pub(crate) pupil_x: Vec<f64>,
    /// Points spread evenly over the unit disc.
    pub(crate) pupil_y: Vec<f64>,
    /// Places in the pixel from its centre, −0.5 to 0.5 px.
    pub(crate) offset_u_px: Vec<f64>,
    /// Places in the pixel from its centre, −0.5 to 0.5 px.
    pub(crate) offset_v_px: Vec<f64>,
}

/// Several sets of Owen-scrambled Sobol' points in four dimensions.
///
/// B. Burley, "Practical hash-based Owen scrambling", Journal of Computer Graphics Techniques 9(4), 1 (2020).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SampleBank {
    sets: Vec<SampleSet>,
}

impl SampleBank {
    /// Sets of `count` samples each.
    pub(crate) fn new(count: usize) -> Self {
        Self { sets: (0..SETS as u32).map(|seed| SampleSet::new(count as u32, seed)).collect() }
    }

    /// The set that a pixel of a band uses: always the same, and as good as unrelated to its neighbours'.
    pub(crate) fn of_pixel(&self, band: usize, column: usize, row: usize) -> &SampleSet {
        let pixel = ((band as u64) << 48) ^ ((row as u64) << 24) ^ column as u64;
        &self.sets[(mix(pixel) % SETS as u64) as usize]
    }
}

impl SampleSet {
    fn new(count: u32, seed: u32) -> Self {
        let dimension =
            |dimension| (0..count).map(move |index| f64::from(sobol_burley::sample(index, dimension, seed)));
        let (pupil_x, pupil_y) = dimension(0).zip(dimension(1)).map(|(a, b)| disc_from_square(a, b)).unzip();
        let offset_u_px = dimension(2).map(|place| place - 0.5).collect();
        let offset_v_px = dimension(3).map(|place| place - 0.5).collect();
        Self { pupil_x, pupil_y, offset_u_px, offset_v_px }
    }
}

/// Maps the unit square onto the unit disc so that areas keep their ratio and neighbours stay neighbours.
///
/// P. Shirley, K. Chiu, "A low distortion map between disk and square", Journal of Graphics Tools 2(3), 45 (1997).
fn disc_from_square(u: f64, v: f64) -> (f64, f64) {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    if a == 0.0 && b == 0.0 {
        return (0.0, 0.0);
    }
    let (radius, azimuth_rad) =
        if a.abs() > b.abs() { (a, FRAC_PI_4 * b / a) } else { (b, FRAC_PI_2 - FRAC_PI_4 * a / b) };
    let (sin, cos) = azimuth_rad.sin_cos();
    (radius * cos, radius * sin)
}

/// Scatters the bits of `value`: the output step of SplitMix64.
fn mix(mut value: u64) -> u64 {
    value = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    value = (value ^ (value >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    value = (value ^ (value >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    value ^ (value >> 31)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn every_set_fills_the_disc_evenly() {
        let bank = SampleBank::new(256);
        for set in &bank.sets {
            let squares = set.pupil_x.iter().zip(&set.pupil_y).map(|(x, y)| x * x + y * y);
            let mean_square = squares.sum::<f64>() / 256.0;
            let centre = set.pupil_x.iter().sum::<f64>().hypot(set.pupil_y.iter().sum()) / 256.0;
            // The mean of r² over the unit disc is 1/2.
            assert!((mean_square - 0.5).abs() < 2e-3 && centre < 2e-3, "{mean_square} {centre}");
        }
        assert_ne!(bank.sets[0], bank.sets[1]);
    }

    #[test]
    fn neighbouring_pixels_use_all_sets_about_equally() {
        let bank = SampleBank::new(1);
        let mut counts = [0; SETS];
        for pixel in 0..16_000 {
            let set = bank.of_pixel(0, pixel % 160, pixel / 160);
            counts[bank.sets.iter().position(|own| std::ptr::eq(own, set)).unwrap()] += 1;
        }
        assert!(counts.iter().all(|count| (800..1200).contains(count)), "{counts:?}");
    }

    proptest! {
        #[test]
        fn the_square_maps_into_the_disc(u in 0.0..1.0_f64, v in 0.0..1.0_f64) {
            let (x, y) = disc_from_square(u, v);
            // The ring on which a point lies is the square ring it came from.
            let ring = (2.0 * u - 1.0).abs().max((2.0 * v - 1.0).abs());
            prop_assert!((x.hypot(y) - ring).abs() < 1e-12);
        }
    }
}
