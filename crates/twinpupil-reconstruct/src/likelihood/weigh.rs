//! How pixels compare with modelled light: weights and residuals.

use multiversion::multiversion;

use crate::likelihood::black::{Black, Reading};
use crate::likelihood::chords::{LANES, Lanes, lanes, padded};
use crate::likelihood::light::{Light, Places};

/// Weights and residuals of pixels, for derivatives of the light alone: what the illumination and the end of the scale
/// do to a code, and so to all of its derivatives, is in the weight. What fills the last [`LANES`] has neither.
#[derive(Debug, Clone, Default)]
pub(crate) struct Weights {
    pub(crate) weight: Vec<f32>,
    pub(crate) residual: Vec<f32>,
}

/// A dot's light and that of its ground, codes above black, with the growth of the illumination, 1/px.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Levels {
    pub(crate) contrast: f32,
    pub(crate) background: f32,
    pub(crate) growth: [f32; 2],
}

/// The plane's noise, and which pixels do not count.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Judge<'a> {
    pub(crate) black: &'a Black,
    /// Codes from this on are saturated.
    saturated: f32,
    /// Pixels that should read more than the first, and do read more than the second, are spared by their noise alone.
    full: f32,
    spared: f32,
    /// Largest square of a residual over its variance that counts.
    limit: f32,
    /// Part of a pixel's variance that a sample has, the mean of several.
    part: f32,
}

/// Light that no sensor tells from that of the bare ground, codes.
const BARE_CODES: f32 = 1e-3;

/// Least change of a code with light that counts.
const SLOPE_MIN: f32 = 1e-3;

impl<'a> Judge<'a> {
    /// For means of so many `pixels`.
    pub(crate) fn new(black: &'a Black, saturated: f32, limit: f32, pixels: f32) -> Self {
        const FULL_SIGMAS: f64 = 3.0;
        let noise = black.noise();
        let spread = (FULL_SIGMAS * noise.variance(f64::from(saturated)).sqrt()) as f32;
        let full = saturated - noise.black_level as f32 - spread;
        Self { black, saturated, full, spared: saturated - 2.0 * spread, limit, part: 1.0 / pixels }
    }
}

impl Weights {
    /// Compares codes with the light of a spot and `others`, that of its neighbours.
    pub(crate) fn compare(
        &mut self,
        codes: &[f32],
        places: &Places,
        light: &Light,
        others: &[f32],
        levels: &Levels,
        judge: &Judge<'_>,
    ) {
        for values in [&mut self.weight, &mut self.residual] {
            values.resize(codes.len().next_multiple_of(LANES), 0.0);
        }
        weigh(codes, places, light, others, levels, judge, self);
    }
}

/// What pixels of the bare ground read, all of which have the same light: most of those near black are such.
#[derive(Clone, Copy)]
struct Ground {
    /// Their light; nothing is near it where the ground is bright or unevenly lit.
    light: f32,
    reading: Reading,
    variance: f32,
}

impl Ground {
    fn of(levels: &Levels, black: &Black) -> Self {
        let is_dark = levels.background < black.light_max && levels.growth == [0.0; 2];
        let reading = black.reading(levels.background);
        Self {
            light: if is_dark { levels.background } else { f32::NAN },
            reading: Reading { slope: reading.slope.max(SLOPE_MIN), ..reading },
            variance: 1.0 / reading.trust,
        }
    }
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma", "x86_64+avx"))]
fn weigh(
    codes: &[f32],
    places: &Places,
    light: &Light,
    others: &[f32],
    levels: &Levels,
    judge: &Judge<'_>,
    Weights { weight, residual }: &mut Weights,
) {
    let ground = Ground::of(levels, judge.black);
    let pixels = [codes, &places.du, &places.dv, &light.light, &light.open, others];
    let pixels = pixels.map(|values| values[..codes.len()].as_chunks::<LANES>());
    let ((weights, _), (residuals, _)) = (weight.as_chunks_mut::<LANES>(), residual.as_chunks_mut::<LANES>());
    let whole = codes.len() / LANES;
    for (chunk, (weights, residuals)) in weights.iter_mut().zip(&mut *residuals).enumerate().take(whole) {
        (*weights, *residuals) = weigh_lanes(pixels.map(|(chunks, _)| &chunks[chunk]), levels, judge, &ground);
    }
    if let (Some(weights), Some(residuals)) = (weights.get_mut(whole), residuals.get_mut(whole)) {
        let last = pixels.map(|(_, rest)| padded(rest));
        (*weights, *residuals) = weigh_lanes(last.each_ref(), levels, judge, &ground);
        weights[codes.len() % LANES..].fill(0.0);
        residuals[codes.len() % LANES..].fill(0.0);
    }
}

/// Weights and residuals of pixels side by side.
#[inline(always)]
fn weigh_lanes(
    [codes, du, dv, own, open, others]: [&Lanes; 6],
    levels: &Levels,
    judge: &Judge<'_>,
    ground: &Ground,
) -> (Lanes, Lanes) {
    let Levels { contrast, background, growth: [gu, gv] } = *levels;
    let noise = judge.black.noise();
    let (floor, growth) = (noise.floor_codes2 as f32, noise.slope_codes as f32);
    let lit = lanes(|lane| 1.0 + gu * du[lane] + gv * dv[lane]);
    let lights = lanes(|lane| others[lane] + lit[lane] * (contrast * own[lane] + background * open[lane]));
    let (mut mean, mut slope, mut variance) = (lights, [1.0; LANES], [0.0; LANES]);
    let (light_max, mut dark) = (judge.black.light_max, 0);
    for lane in 0..LANES {
        let bare = (lights[lane] - ground.light).abs() < BARE_CODES;
        mean[lane] = if bare { ground.reading.mean } else { lights[lane] };
        slope[lane] = if bare { ground.reading.slope } else { 1.0 };
        variance[lane] = if bare { ground.variance } else { floor + growth * lights[lane].max(0.0) };
        dark |= u32::from((lights[lane] < light_max) & !bare) << lane;
    }
    // Where codes near zero cannot be negative.
    while dark != 0 {
        let lane = dark.trailing_zeros() as usize % LANES;
        let Reading { mean: dark_mean, slope: dark_slope, trust: dark_trust } = judge.black.read(lights[lane]);
        (mean[lane], slope[lane], variance[lane]) = (dark_mean, dark_slope.max(SLOPE_MIN), 1.0 / dark_trust);
        dark &= dark - 1;
    }
    let (mut weights, mut residuals) = ([0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        let left = codes[lane] - noise.black_level as f32 - mean[lane];
        let felt = slope[lane] * lit[lane];
        // One division for both.
        let variance = judge.part * variance[lane];
        let inverse = 1.0 / (variance * felt);
        let trust = inverse * felt;
        let full = (codes[lane] >= judge.saturated) | ((lights[lane] > judge.full) & (codes[lane] > judge.spared));
        let out = full | (left * left * trust > judge.limit);
        weights[lane] = if out { 0.0 } else { trust * felt * felt };
        residuals[lane] = left * inverse * variance;
    }
    (weights, residuals)
}
