//! What a sensor reports near black, where codes cannot be negative.

use crate::noise::Noise;

/// Mean and variance of a code for the light that it stands for.
///
/// A code is what is left of light, noise and black level, rounded and no less than zero. With a black level of a few
/// deviations that is of no account; without one, dark pixels read too bright on the average, by 0.4 deviations, and
/// scatter less. With Q the normal distribution's upper tail and σ the noise before rounding:
///
/// ```text
/// E[c] = Σₙ Q((n − ½ − m)/σ)      E[c²] = Σₙ (2n − 1) Q((n − ½ − m)/σ)      n = 1, 2, …
/// ```
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Black {
    noise: Noise,
    /// Codes of light, above the black level, from which a code is light and noise and no more.
    pub(crate) light_max: f32,
    low: f32,
    per_step: f32,
    /// Mean, slope and trust of [`Reading`], and nothing.
    nodes: [[f32; 4]; NODES],
}

/// What a pixel reads for some light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reading {
    /// Mean code above the black level.
    pub(crate) mean: f32,
    /// Change of the mean with the light.
    pub(crate) slope: f32,
    /// One over the variance.
    pub(crate) trust: f32,
}

/// Deviations from zero within which the end of the scale is felt.
const REACH_SIGMAS: f64 = 5.0;

const NODES: usize = 256;
const LAST_PLACE: f32 = (NODES - 1) as f32 - 1e-3;

impl Black {
    pub(crate) fn new(noise: &Noise) -> Self {
        let floor = noise.floor_codes2.sqrt();
        let low = -3.0 * floor - noise.black_level;
        // At the upper end photon noise counts too: σ² = floor² + slope · light.
        let reach = REACH_SIGMAS * REACH_SIGMAS * noise.slope_codes;
        let high = 0.5 * (reach + (reach * reach + 4.0 * (REACH_SIGMAS * floor).powi(2)).sqrt()) - noise.black_level;
        if high <= 0.0 {
            return Self {
                noise: *noise,
                light_max: f32::NEG_INFINITY,
                low: 0.0,
                per_step: 0.0,
                nodes: [[0.0; 4]; NODES],
            };
        }
        let step = (high - low) / (NODES - 1) as f64;
        let node = |k: usize| {
            let light = low + step * k as f64;
            let (mean, variance) = moments(light, noise);
            let slope = (moments(light + 0.01, noise).0 - moments(light - 0.01, noise).0) / 0.02;
            [mean, slope, 1.0 / variance, 0.0].map(|value| value as f32)
        };
        Self {
            noise: *noise,
            light_max: high as f32,
            low: low as f32,
            per_step: (1.0 / step) as f32,
            nodes: std::array::from_fn(node),
        }
    }

    /// The noise that it was made for.
    pub(crate) fn noise(&self) -> &Noise {
        &self.noise
    }

    /// What pixels read that receive `light`, however much.
    pub(crate) fn reading(&self, light: f32) -> Reading {
        if light < self.light_max {
            return self.read(light);
        }
        let variance = self.noise.variance(self.noise.black_level + f64::from(light));
        Reading { mean: light, slope: 1.0, trust: (1.0 / variance) as f32 }
    }

    /// What pixels read that receive `light`, which lies below [`Self::light_max`].
    #[inline(always)]
    pub(crate) fn read(&self, light: f32) -> Reading {
        let place = ((light - self.low) * self.per_step).clamp(0.0, LAST_PLACE);
        let index = place as i32 as usize;
        let share = place - (index as i32) as f32;
        let [low, high] = [self.nodes[index % NODES], self.nodes[(index + 1) % NODES]];
        let [mean, slope, trust, _]: [f32; 4] = std::array::from_fn(|k| low[k] + share * (high[k] - low[k]));
        Reading { mean, slope, trust }
    }
}

/// Mean above the black level and variance of the code of a pixel with some light above black.
pub(crate) fn moments(light: f64, noise: &Noise) -> (f64, f64) {
    const ROUNDING: f64 = 1.0 / 12.0;
    let sigma = (noise.floor_codes2 - ROUNDING + noise.slope_codes * light.max(0.0)).max(1e-4).sqrt();
    let centre = light + noise.black_level;
    let last = (centre + 8.0 * sigma).ceil().max(1.0) as usize;
    let (mut mean, mut square) = (0.0, 0.0);
    for n in 1..=last {
        let n = n as f64;
        let share = upper_tail((n - 0.5 - centre) / sigma);
        mean += share;
        square += (2.0 * n - 1.0) * share;
    }
    (mean - noise.black_level, (square - mean * mean).max(1e-3))
}

/// Share of a normal distribution above `x` deviations, 10⁻⁷ off at most.
///
/// M. Abramowitz, I. A. Stegun, "Handbook of Mathematical Functions" (1964), 7.1.26.
fn upper_tail(x: f64) -> f64 {
    const COEFFICIENTS: [f64; 5] = [0.254_829_592, -0.284_496_736, 1.421_413_741, -1.453_152_027, 1.061_405_429];
    let size = x.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * size);
    let polynomial = COEFFICIENTS.iter().rev().fold(0.0, |sum, coefficient| sum * t + coefficient) * t;
    let tail = 0.5 * polynomial * (-size * size).exp();
    if x >= 0.0 { tail } else { 1.0 - tail }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAPERS: Noise = Noise { floor_codes2: 0.81, slope_codes: 0.125, black_level: 0.0 };

    #[test]
    fn bright_pixels_read_their_light() {
        let black = Black::new(&PAPERS);
        let reading = black.read(black.light_max - 0.01);
        assert!((reading.mean - black.light_max + 0.01).abs() < 1e-3 && (reading.slope - 1.0).abs() < 1e-3);
        let variance = PAPERS.variance(f64::from(black.light_max - 0.01));
        assert!((f64::from(reading.trust) * variance - 1.0).abs() < 0.01);
    }

    #[test]
    fn dark_pixels_read_too_bright() {
        // Without rounding the mean of a normal deviate cut at zero is σ/√2π and its slope ½.
        let fine = Noise { floor_codes2: 400.0, slope_codes: 0.0, black_level: 0.0 };
        let reading = Black::new(&fine).read(0.0);
        assert!((f64::from(reading.mean) - 20.0 / (2.0 * std::f64::consts::PI).sqrt()).abs() < 0.05);
        assert!((reading.slope - 0.5).abs() < 1e-2);
        let variance = 400.0 * (0.5 - 0.5 / std::f64::consts::PI);
        assert!((f64::from(reading.trust) * variance - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_black_level_leaves_nothing_to_correct() {
        assert!(Black::new(&Noise { black_level: 64.0, ..PAPERS }).light_max < -50.0);
    }
}
