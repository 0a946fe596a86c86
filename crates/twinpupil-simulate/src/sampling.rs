//! Evenly spread points of the pupil and of the pixel.

use std::f64::consts::TAU;

/// The most samples of one set: the Sobol' sequence that is used here ends there.
pub const PUPIL_SAMPLES_MAX: usize = 1 << 16;

/// Number of different sets, so that the sampling errors of neighbouring pixels do not add up.
pub(crate) const SETS: usize = 16;

/// (1 + √5)/2.
const GOLDEN_RATIO: f64 = 1.618_033_988_749_895;

/// One set of samples, as structure of arrays.
///
/// Pupil points are the florets of a sunflower, which divide the disc into cells of equal area and much the same
/// shape:  r² = u = (i + ½)/N, φ = i · golden angle.  H. Vogel, "A better way to construct the sunflower head",
/// Mathematical Biosciences 44, 179 (1979).
///
/// Dots are blurred by those cells ([`Disc`](crate::disc::Disc)), and those of the outermost points reach beyond the
/// disc: without more, the light of a dot out of focus would be too wide, by 0.2 % at 256 points. So the outermost
/// points are drawn in, such that points and cells together have the second moment of the disc:
///
/// ```text
/// r² = u − κ uᵖ      p = 1/cell,  κ = (p + 1) cell²/6
/// ```
///
/// Places in the pixel are Owen-scrambled Sobol' points.  B. Burley, "Practical hash-based Owen scrambling", Journal
/// of Computer Graphics Techniques 9(4), 1 (2020). Every stretch of such a sequence is even by itself, so every ring of
/// the pupil sees all of the pixel.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SampleSet {
    /// Points of the unit disc.
    pub(crate) pupil_x: Vec<f64>,
    /// Points of the unit disc.
    pub(crate) pupil_y: Vec<f64>,
    /// Places in the pixel from its centre, −0.5 to 0.5 px.
    pub(crate) offset_u_px: Vec<f64>,
    /// Places in the pixel from its centre, −0.5 to 0.5 px.
    pub(crate) offset_v_px: Vec<f64>,
}

/// Sets of samples whose sunflowers are turned against each other.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SampleBank {
    sets: Vec<SampleSet>,
    /// By how many sets every pixel is ahead of where it would be.
    turn: usize,
}

impl SampleBank {
    /// Sets of `count` samples each. With another `turn`, below [`SETS`], every pixel uses another set.
    pub(crate) fn new(count: usize, turn: usize) -> Self {
        Self { sets: (0..SETS).map(|set| SampleSet::new(count, set)).collect(), turn }
    }

    /// The set that a pixel of a band uses: always the same, and as good as unrelated to its neighbours'.
    pub(crate) fn of_pixel(&self, band: usize, column: usize, row: usize) -> &SampleSet {
        let pixel = ((band as u64) << 48) ^ ((row as u64) << 24) ^ column as u64;
        &self.sets[((mix(pixel) % SETS as u64) as usize + self.turn) % SETS]
    }
}

impl SampleSet {
    /// Number of samples.
    pub(crate) fn len(&self) -> usize {
        self.pupil_x.len()
    }

    fn new(count: usize, set: usize) -> Self {
        let golden_angle_rad = TAU * (1.0 - 1.0 / GOLDEN_RATIO);
        let turn_rad = TAU * set as f64 / SETS as f64;
        let floret = |index: usize| {
            let radius = drawn_in((index as f64 + 0.5) / count as f64, count).sqrt();
            let (sin, cos) = (index as f64 * golden_angle_rad + turn_rad).sin_cos();
            (radius * cos, radius * sin)
        };
        let (pupil_x, pupil_y) = (0..count).map(floret).unzip();
        let offset_px = |dimension: u32| {
            let place = move |index| f64::from(sobol_burley::sample(index, dimension, set as u32)) - 0.5;
            (0..count as u32).map(place).collect()
        };
        Self { pupil_x, pupil_y, offset_u_px: offset_px(0), offset_v_px: offset_px(1) }
    }
}

/// Width of the cell of each of `count` points of the unit disc: the side of a square of its area.
pub(crate) fn pupil_cell(count: usize) -> f64 {
    (std::f64::consts::PI / count as f64).sqrt()
}

/// Square of a point's radius, for a share `u` of the disc within it.
fn drawn_in(u: f64, count: usize) -> f64 {
    let cell = pupil_cell(count);
    let power = 1.0 / cell;
    (u - (power + 1.0) * cell * cell / 6.0 * u.powf(power)).max(0.0)
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
    use super::*;

    #[test]
    fn every_set_fills_the_disc_evenly() {
        let bank = SampleBank::new(256, 0);
        for set in &bank.sets {
            let points = || set.pupil_x.iter().zip(&set.pupil_y);
            let moment = |power: i32| points().map(|(x, y)| x.hypot(*y).powi(power)).sum::<f64>() / 256.0;
            // The means of r² and r⁴ over the unit disc are 1/2 and 1/3; a cell adds cell²/6 and 4 · cell²/12 to them.
            let cell2 = pupil_cell(256).powi(2);
            let (second, fourth) = (moment(2) + cell2 / 6.0, moment(4) + cell2 / 3.0);
            assert!((second - 0.5).abs() < 2e-5 && (fourth - 1.0 / 3.0).abs() < 1e-3, "{second} {fourth}");
            let (x, y): (f64, f64) = points().fold((0.0, 0.0), |(x, y), point| (x + point.0, y + point.1));
            assert!(x.hypot(y) / 256.0 < 3e-3, "{x} {y}");
            let wedges = |from_rad: f64| points().filter(move |(x, y)| (y.atan2(**x) - from_rad).rem_euclid(TAU) < 1.0);
            // One radian of the disc holds 256/2π points.
            assert!((0..6).all(|k| (wedges(f64::from(k)).count() as f64 - 40.7).abs() < 4.0));
        }
        assert_ne!(bank.sets[0], bank.sets[1]);
    }

    #[test]
    fn every_ring_sees_all_of_the_pixel() {
        let bank = SampleBank::new(256, 0);
        for set in &bank.sets {
            for ring in set.offset_u_px.chunks(64).chain(set.offset_v_px.chunks(64)) {
                assert!(ring.iter().all(|offset| (-0.5..0.5).contains(offset)));
                assert!(ring.iter().sum::<f64>().abs() / 64.0 < 0.01);
            }
        }
    }

    #[test]
    fn neighbouring_pixels_use_all_sets_about_equally() {
        let bank = SampleBank::new(1, 0);
        let mut counts = [0; SETS];
        for pixel in 0..16_000 {
            let set = bank.of_pixel(0, pixel % 160, pixel / 160);
            counts[bank.sets.iter().position(|own| std::ptr::eq(own, set)).unwrap()] += 1;
        }
        assert!(counts.iter().all(|count| (800..1200).contains(count)), "{counts:?}");
        let turned: Vec<SampleBank> = (0..SETS).map(|turn| SampleBank::new(2, turn)).collect();
        let own = |turn: usize| turned[turn].of_pixel(1, 7, 9);
        assert!((0..SETS).all(|a| (0..a).all(|b| own(a) != own(b))), "every turn has a set of its own");
    }
}
