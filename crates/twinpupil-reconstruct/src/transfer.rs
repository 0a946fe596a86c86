//! Noise from the frame itself: how much flat places scatter, over how bright they are.
//!
//! J. R. Janesick, "Photon Transfer" (2007): variance over level is a straight line, whose slope is the gain.

use twinpupil_instrument::PlaneView;

use crate::background::quantile;
use crate::likelihood::black::moments;
use crate::noise::Noise;

/// Places of one brightness.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Level {
    /// Mean code.
    code: f64,
    /// Variance of a pixel, codes².
    variance: f64,
    /// Standard deviation of that.
    std: f64,
}

/// Three pixels side by side.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Triple {
    code: f32,
    /// Second difference: a slope does not reach it.
    bend: f32,
    /// How uneven the rows above and below are, whose noise is their own.
    roughness: f32,
}

/// Triples that are looked at, about.
const TRIPLES: usize = 200_000;

/// Bins of brightness, and the fewest triples that tell the noise of one.
const BINS: usize = 40;
const BIN_TRIPLES_MIN: usize = 200;

/// Share of the triples of a bin that counts: the flattest.
const FLAT_SHARE: f64 = 0.3;

/// Variance of a second difference over that of a pixel: 1 + 4 + 1.
const BEND_GAIN: f64 = 6.0;

/// Codes nearer to zero than this, in deviations, do not scatter freely.
const FREE_SIGMAS: f64 = 5.0;

/// The slope of the line is believed if its relative deviation is below this.
const SLOPE_STD_MAX: f64 = 0.1;

impl Noise {
    /// The noise that a plane shows; what it does not show is as `stated`, and so is the black level.
    pub(crate) fn of_plane(plane: &PlaneView<'_>, stated: &Self) -> Self {
        let levels = levels(plane, stated);
        let is_free = |level: &Level| level.code > FREE_SIGMAS * level.variance.sqrt();
        let free: Vec<Level> = levels.iter().filter(|level| is_free(level)).copied().collect();
        // Brighter ones that scatter so much are no levels but edges.
        let darkest = levels.first().filter(|level| !is_free(level));
        let line = Line::through(&free, stated.black_level).filter(Line::is_sure);
        let measured = match (line, darkest) {
            (Some(line), None) => Self { floor_codes2: line.floor, slope_codes: line.slope, ..*stated },
            (Some(line), Some(dark)) => Self { slope_codes: line.slope, ..*stated }.with_floor_of(dark),
            (None, Some(dark)) => stated.with_floor_of(dark).with_slope_of(&free),
            (None, None) => stated.scaled_to(&free),
        };
        Self { floor_codes2: measured.floor_codes2.max(ROUNDING_CODES2), ..measured }
    }

    /// With the floor that makes codes near zero scatter as they do.
    fn with_floor_of(&self, dark: &Level) -> Self {
        const HALVINGS: usize = 40;
        let with_floor = |floor_codes2: f64| Self { floor_codes2, ..*self };
        let (mut low, mut high) = (ROUNDING_CODES2, ROUNDING_CODES2 + 16.0 * dark.variance);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if with_floor(middle).variance_that_reads(dark.code) < dark.variance { low = middle } else { high = middle }
        }
        with_floor(0.5 * (low + high))
    }

    /// With the slope that levels show over the floor; those that scatter far more than others are not flat.
    fn with_slope_of(&self, levels: &[Level]) -> Self {
        const ROUNDS: usize = 3;
        const FAR_SIGMAS: f64 = 4.0;
        let slope = |level: &Level| (level.variance - self.floor_codes2) / (level.code - self.black_level);
        let slope_std = |level: &Level| level.std / (level.code - self.black_level);
        let Some(mut slope_codes) = levels.iter().map(slope).min_by(f64::total_cmp) else { return *self };
        for _ in 0..ROUNDS {
            let near = levels.iter().filter(|level| slope(level) - slope_codes < FAR_SIGMAS * slope_std(level));
            let (sum, weights) = near.fold((0.0, 0.0), |(sum, weights), level| {
                let weight = slope_std(level).powi(-2);
                (sum + weight * slope(level), weights + weight)
            });
            slope_codes = sum / weights;
        }
        if slope_codes.is_finite() && slope_codes > 0.0 { Self { slope_codes, ..*self } } else { *self }
    }

    /// Variance of the codes of a pixel whose mean code is `code`, none of which is below zero.
    fn variance_that_reads(&self, code: f64) -> f64 {
        const HALVINGS: usize = 30;
        let reach = 4.0 * self.floor_codes2.sqrt() + code;
        let (mut low, mut high) = (-reach - self.black_level, reach - self.black_level);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if moments(middle, self).0 + self.black_level < code { low = middle } else { high = middle }
        }
        moments(0.5 * (low + high), self).1
    }

    /// Larger or smaller by what the levels show, where they do not tell floor and slope apart.
    fn scaled_to(&self, levels: &[Level]) -> Self {
        let weight = |level: &Level| (level.variance / level.std).powi(2);
        let weights: f64 = levels.iter().map(weight).sum();
        if weights == 0.0 {
            return *self;
        }
        let ratio = |level: &Level| level.variance / self.variance(level.code) * weight(level);
        let factor = levels.iter().map(ratio).sum::<f64>() / weights;
        Self { floor_codes2: self.floor_codes2 * factor, slope_codes: self.slope_codes * factor, ..*self }
    }
}

/// Variance of rounding to whole codes.
const ROUNDING_CODES2: f64 = 1.0 / 12.0;

/// Variance over the code above black.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    floor: f64,
    slope: f64,
    slope_std: f64,
}

impl Line {
    /// By least squares; levels far above the line are not flat and are left out.
    fn through(levels: &[Level], black_level: f64) -> Option<Self> {
        const ROUNDS: usize = 3;
        const FAR_SIGMAS: f64 = 4.0;
        const FAR_SHARE: f64 = 0.1;
        let mut kept = levels.to_vec();
        let mut line = None;
        for _ in 0..ROUNDS {
            let fitted = Self::of(&kept, black_level)?;
            let excess = |level: &Level| level.variance - fitted.floor - fitted.slope * (level.code - black_level);
            kept.retain(|level| excess(level) < FAR_SIGMAS * level.std + FAR_SHARE * level.variance);
            line = Some(fitted);
        }
        line
    }

    fn of(levels: &[Level], black_level: f64) -> Option<Self> {
        let sum = |value: &dyn Fn(&Level) -> f64| levels.iter().map(|level| value(level) / level.std.powi(2)).sum();
        let light = |level: &Level| level.code - black_level;
        let (count, first, second): (f64, f64, f64) =
            (sum(&|_| 1.0), sum(&light), sum(&|level| light(level) * light(level)));
        let (right, moment): (f64, f64) = (sum(&|level| level.variance), sum(&|level| level.variance * light(level)));
        let determinant = count * second - first * first;
        if levels.len() < 2 || determinant <= 1e-9 * count * second {
            return None;
        }
        Some(Self {
            floor: (second * right - first * moment) / determinant,
            slope: (count * moment - first * right) / determinant,
            slope_std: (count / determinant).sqrt(),
        })
    }

    fn is_sure(&self) -> bool {
        self.slope > 0.0 && self.slope_std < SLOPE_STD_MAX * self.slope
    }
}

/// How much the flat places of every brightness scatter, from dark to bright.
fn levels(plane: &PlaneView<'_>, stated: &Noise) -> Vec<Level> {
    let triples = triples(plane);
    let code_max = f64::from(plane.code_max);
    // Twice as wide as dark pixels ought to scatter, then ever wider.
    let dark = stated.black_level + 2.0 * FREE_SIGMAS * stated.floor_codes2.sqrt();
    let bin = |triple: &Triple| {
        let above = (f64::from(triple.code) - dark) / (code_max - dark).max(1.0);
        if above < 0.0 { 0 } else { 1 + (above.sqrt() * (BINS - 1) as f64) as usize }
    };
    let mut bins: Vec<Vec<Triple>> = vec![Vec::new(); BINS + 1];
    for triple in triples {
        bins[bin(&triple).min(BINS)].push(triple);
    }
    bins.iter_mut().filter_map(|bin| level(bin)).collect()
}

/// Triples spread over a plane, none of whose pixels is saturated.
fn triples(plane: &PlaneView<'_>) -> Vec<Triple> {
    let stride = (plane.columns * plane.rows / (3 * TRIPLES)).max(1);
    let saturated = f32::from(plane.code_max);
    let mut rows = [(); 3].map(|()| vec![0.0_f32; plane.columns]);
    let mut triples = Vec::new();
    for row in (1..plane.rows.saturating_sub(1)).step_by(stride) {
        for (line, row) in rows.iter_mut().zip(row - 1..) {
            plane.read_row(row, line);
        }
        let [above, own, below] = &rows;
        let lines = own.chunks_exact(3).zip(above.chunks_exact(3)).zip(below.chunks_exact(3));
        for ((own, above), below) in lines {
            if own.iter().any(|code| *code >= saturated) {
                continue;
            }
            let bend = |codes: &[f32]| codes[0] - 2.0 * codes[1] + codes[2];
            let sum = |codes: &[f32]| codes.iter().sum::<f32>();
            triples.push(Triple {
                code: sum(own) / 3.0,
                bend: bend(own),
                roughness: bend(above).abs().max(bend(below).abs()).max((sum(above) - sum(below)).abs()),
            });
        }
    }
    triples
}

/// What the triples of one brightness show.
fn level(triples: &mut [Triple]) -> Option<Level> {
    const ROUNDS: usize = 5;
    const OUTLIER_SIGMAS: f64 = 5.0;
    if triples.len() < BIN_TRIPLES_MIN {
        return None;
    }
    triples.sort_by(|a, b| a.roughness.total_cmp(&b.roughness));
    let flat = &triples[..(triples.len() as f64 * FLAT_SHARE) as usize];
    let mut sizes: Vec<f32> = flat.iter().map(|triple| triple.bend.abs()).collect();
    // Two thirds of a normal distribution lie within a deviation.
    let mut variance = f64::from(quantile(&mut sizes, 0.68)).powi(2) / BEND_GAIN;
    let mut count = 0;
    for _ in 0..ROUNDS {
        let limit = OUTLIER_SIGMAS * (BEND_GAIN * variance.max(ROUNDING_CODES2)).sqrt();
        let kept = flat.iter().map(|triple| f64::from(triple.bend)).filter(|bend| bend.abs() <= limit);
        let (number, squares) = kept.fold((0, 0.0), |(number, squares), bend| (number + 1, squares + bend * bend));
        variance = squares / (BEND_GAIN * f64::from(number.max(1)));
        count = number;
    }
    let code = flat.iter().map(|triple| f64::from(triple.code)).sum::<f64>() / flat.len() as f64;
    let std = variance.max(ROUNDING_CODES2) * (2.0 / f64::from(count.max(1))).sqrt();
    Some(Level { code, variance, std })
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use twinpupil_instrument::{Frame, Mosaic};

    use super::*;

    /// A frame of 600 × 400 pixels whose light and noise are given, with edges and stuck pixels.
    fn measured(black_level: f64, floor_codes2: f64, slope_codes: f64, levels: &[f64], stated: &Noise) -> Noise {
        let mut rng = rand_pcg::Pcg64Dxsm::seed_from_u64(5);
        let truth = Noise { floor_codes2, slope_codes, black_level };
        let code = |index: usize| {
            let (column, row) = (index % 600, index / 600);
            let light = levels[(column / 100 + row / 100) % levels.len()];
            let sigma = (truth.variance(black_level + light) - ROUNDING_CODES2).sqrt();
            let code = black_level + light + sigma * rng.sample::<f64, _>(StandardNormal);
            if index.is_multiple_of(997) { 4095 } else { code.round().clamp(0.0, 4095.0) as u16 }
        };
        let frame = Frame::new(600, 400, 4095, vec![(0..240_000).map(code).collect()]).expect("a frame");
        Noise::of_plane(&frame.plane(Mosaic::Mono, "0").expect("page 0"), stated)
    }

    const STATED: Noise = Noise { floor_codes2: 0.81, slope_codes: 0.125, black_level: 0.0 };

    #[test]
    fn gain_and_floor_are_read_off_the_frame() {
        let stated = Noise { black_level: 64.0, ..STATED };
        let noise = measured(64.0, 9.0, 0.25, &[0.0, 500.0, 2000.0], &stated);
        assert!((noise.slope_codes / 0.25 - 1.0).abs() < 0.05, "{noise:?}");
        assert!((noise.floor_codes2 / 9.0 - 1.0).abs() < 0.1, "{noise:?}");
    }

    #[test]
    fn darkness_without_a_black_level_is_cut_at_zero() {
        let noise = measured(0.0, 3.24, 0.06, &[0.0, 1500.0], &STATED);
        assert!((noise.slope_codes / 0.06 - 1.0).abs() < 0.05, "{noise:?}");
        assert!((noise.floor_codes2 / 3.24 - 1.0).abs() < 0.1, "{noise:?}");
    }

    #[test]
    fn what_the_frame_does_not_show_is_as_stated() {
        let stated = Noise { black_level: 64.0, ..STATED };
        let noise = measured(64.0, 2.0 * 0.81, 2.0 * 0.125, &[1000.0], &stated);
        assert!((noise.slope_codes / 0.25 - 1.0).abs() < 0.05, "{noise:?}");
        let nothing = Frame::new(4, 4, 4095, vec![vec![7; 16]]).expect("a frame");
        assert_eq!(Noise::of_plane(&nothing.plane(Mosaic::Mono, "0").expect("page 0"), &STATED), STATED);
    }
}
