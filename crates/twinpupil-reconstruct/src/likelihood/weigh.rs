//! How pixels compare with modelled light: weights and residuals.

use multiversion::multiversion;

use crate::likelihood::black::{Black, Reading};
use crate::likelihood::light::{Light, Places};

/// Weights and residuals of pixels, for derivatives of the light alone: what the illumination and the end of the scale
/// do to a code, and so to all of its derivatives, is in the weight.
#[derive(Debug, Clone, Default)]
pub(crate) struct Weights {
    pub(crate) weight: Vec<f32>,
    pub(crate) residual: Vec<f32>,
    /// Modelled light, codes above black.
    model: Vec<f32>,
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
}

/// Light that no sensor tells from that of the bare ground, codes.
const BARE_CODES: f32 = 1e-3;

/// Least change of a code with light that counts.
const SLOPE_MIN: f32 = 1e-3;

impl<'a> Judge<'a> {
    pub(crate) fn new(black: &'a Black, saturated: f32, limit: f32) -> Self {
        const FULL_SIGMAS: f64 = 3.0;
        let noise = black.noise();
        let spread = (FULL_SIGMAS * noise.variance(f64::from(saturated)).sqrt()) as f32;
        let full = saturated - noise.black_level as f32 - spread;
        Self { black, saturated, full, spared: saturated - 2.0 * spread, limit }
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
        let Self { weight, residual, model } = self;
        let count = codes.len();
        for values in [&mut *weight, &mut *residual, &mut *model] {
            values.resize(count, 0.0);
        }
        let ground = Ground::of(levels, judge.black);
        let darkest = weigh(codes, places, light, others, levels, judge, &ground, [weight, residual, model]);
        if darkest < judge.black.light_max {
            self.clip_at_black(codes, places, levels, judge);
        }
    }

    /// Where codes near zero cannot be negative.
    fn clip_at_black(&mut self, codes: &[f32], places: &Places, levels: &Levels, judge: &Judge<'_>) {
        const MANY: usize = 16;
        for start in (0..codes.len()).step_by(MANY) {
            let pixels = start..(start + MANY).min(codes.len());
            // Few pixels that are not bare ground lie near black.
            let dark = self.model[pixels.clone()].iter().map(|light| u32::from(*light < judge.black.light_max));
            if dark.sum::<u32>() > 0 {
                pixels.for_each(|k| self.clip_one(k, codes[k], [places.du[k], places.dv[k]], levels, judge));
            }
        }
    }

    fn clip_one(&mut self, k: usize, code: f32, [du, dv]: [f32; 2], levels: &Levels, judge: &Judge<'_>) {
        let light = self.model[k];
        if light >= judge.black.light_max || code >= judge.saturated {
            return;
        }
        let [gu, gv] = levels.growth;
        let reading = judge.black.read(light);
        let left = code - judge.black.noise().black_level as f32 - reading.mean;
        let slope = reading.slope.max(SLOPE_MIN) * (1.0 + gu * du + gv * dv);
        let out = left * left * reading.trust > judge.limit;
        self.weight[k] = if out { 0.0 } else { reading.trust * slope * slope };
        self.residual[k] = left / slope;
    }
}

/// What pixels of the bare ground read, all of which have the same light: most of those near black are such.
struct Ground {
    /// Their light; nothing is near it where the ground is bright or unevenly lit.
    light: f32,
    reading: Reading,
}

impl Ground {
    fn of(levels: &Levels, black: &Black) -> Self {
        let is_dark = levels.background < black.light_max && levels.growth == [0.0; 2];
        let reading = black.reading(levels.background);
        Self {
            light: if is_dark { levels.background } else { f32::NAN },
            reading: Reading { slope: reading.slope.max(SLOPE_MIN), ..reading },
        }
    }
}

/// Fills weights, residuals and modelled light, that of the bare ground as if it were far from black; the least light of
/// all.
#[expect(clippy::too_many_arguments, reason = "a loop over all that pixels have")]
#[multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
fn weigh(
    codes: &[f32],
    places: &Places,
    light: &Light,
    others: &[f32],
    levels: &Levels,
    judge: &Judge<'_>,
    ground: &Ground,
    [weight, residual, model]: [&mut [f32]; 3],
) -> f32 {
    const LANES: usize = 8;
    let count = codes.len();
    let (du, dv) = (&places.du[..count], &places.dv[..count]);
    let (own, open, others) = (&light.light[..count], &light.open[..count], &others[..count]);
    let (weight, residual, model) = (&mut weight[..count], &mut residual[..count], &mut model[..count]);
    let Levels { contrast, background, growth: [gu, gv] } = *levels;
    let (floor, slope) = (judge.black.noise().floor_codes2 as f32, judge.black.noise().slope_codes as f32);
    let (black_level, saturated, limit) = (judge.black.noise().black_level as f32, judge.saturated, judge.limit);
    for k in 0..count {
        let lit = 1.0 + gu * du[k] + gv * dv[k];
        let lights = others[k] + lit * (contrast * own[k] + background * open[k]);
        let bare = (lights - ground.light).abs() < BARE_CODES;
        let trust = if bare { ground.reading.trust } else { 1.0 / (floor + slope * lights.max(0.0)) };
        let left = codes[k] - black_level - if bare { ground.reading.mean } else { lights };
        let felt = if bare { ground.reading.slope } else { lit };
        let full = (codes[k] >= saturated) | ((lights > judge.full) & (codes[k] > judge.spared));
        let out = full | (left * left * trust > limit);
        weight[k] = if out { 0.0 } else { trust * felt * felt };
        residual[k] = left / felt;
        model[k] = if bare { f32::INFINITY } else { lights };
    }
    let mut darkest = [f32::INFINITY; LANES];
    let (chunks, rest) = model.as_chunks::<LANES>();
    for chunk in chunks {
        for lane in 0..LANES {
            darkest[lane] = darkest[lane].min(chunk[lane]);
        }
    }
    darkest.iter().chain(rest).fold(f32::INFINITY, |least, value| least.min(*value))
}
