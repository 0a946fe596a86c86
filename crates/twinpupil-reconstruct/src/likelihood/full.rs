//! What the pixels say that a spot fills: they differ by noise and by the illumination's slope alone, so sums tell all.

use nalgebra::{Matrix2, Matrix3, Vector2};

use crate::likelihood::black::Black;
use crate::likelihood::chords::{LANES, Lanes};
use crate::noise::Noise;

/// Sums over the pixels that a spot fills: of their places `p = (u, v)` about the window's centre, and of their codes d
/// above a level near all of them.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Full {
    level: f64,
    /// Pixels of which each value is the mean.
    pixels: f64,
    count: f64,
    /// Σp.
    place: [f64; 2],
    /// Σu², Σuv, Σv².
    places: [f64; 3],
    /// Σd, Σd p, Σd².
    code: f64,
    code_place: [f64; 2],
    code2: f64,
    /// Smallest and largest d.
    lowest: f64,
    highest: f64,
    /// Pixels left out as saturated or as foreign.
    pub(crate) masked: usize,
}

/// Pixels of one row of a plane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FullRow<'a> {
    /// From the first of them on; every `step`-th is the plane's.
    pub(crate) codes: &'a [u16],
    pub(crate) step: usize,
    pub(crate) count: usize,
    /// Place of the first.
    pub(crate) first_px: f64,
    pub(crate) dv_px: f64,
}

/// Codes of pixels side by side: the first `count` of some, and what lies beyond them up to whole [`LANES`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stretch<'a> {
    pub(crate) values: &'a [f32],
    pub(crate) count: usize,
    /// Place of the first, and from each to the next.
    pub(crate) first_px: f64,
    pub(crate) step_px: f64,
    pub(crate) dv_px: f64,
}

/// A level with a slope, `l₀ + g·p`, in codes above that of the sums.
#[derive(Debug, Clone, Copy)]
struct Incline {
    level: f64,
    slope: [f64; 2],
}

/// The light on the pixels that a spot fills: `level · (l₀ + g·p)`, codes above black.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FullLight {
    pub(crate) level: f64,
    /// Illumination in the middle of the window, and its growth, 1/px.
    pub(crate) lit: f64,
    pub(crate) growth: [f64; 2],
}

/// What full pixels add to normal equations: all that they feel changes with the illumination alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FullSums {
    /// `Σ w lit²`, `Σ w lit r`, `Σ w r²`.
    pub(crate) information: f64,
    pub(crate) score: f64,
    pub(crate) chi2: f64,
    pub(crate) used: usize,
}

/// Pixels that lie farther off than so many deviations are not the spot's, unless more than this share do.
const FOREIGN_SIGMAS: f64 = 6.0;
const FOREIGN_SHARE: f64 = 0.02;

impl Full {
    /// Of no pixel yet, about a level.
    fn about(level: f32, pixels: f64) -> Self {
        Self {
            level: f64::from(level),
            pixels,
            count: 0.0,
            place: [0.0; 2],
            places: [0.0; 3],
            code: 0.0,
            code_place: [0.0; 2],
            code2: 0.0,
            lowest: f64::INFINITY,
            highest: f64::NEG_INFINITY,
            masked: 0,
        }
    }

    /// Variance of a value that reads `code`.
    fn variance(&self, noise: &Noise, code: f64) -> f64 {
        noise.variance(code) / self.pixels
    }

    /// Number of values.
    pub(crate) fn count(&self) -> f64 {
        self.count
    }

    /// Whether all pixels are about alike and none is saturated.
    pub(crate) fn is_even(&self, noise: &Noise, code_max: u16) -> bool {
        if self.count == 0.0 {
            return true;
        }
        let mean = self.code / self.count;
        let bound = FOREIGN_SIGMAS * self.variance(noise, self.level + mean).sqrt();
        self.highest + self.level < f64::from(code_max) && self.highest - mean < bound && mean - self.lowest < bound
    }

    /// The same pixels without those that are saturated or do not fit to the others.
    pub(crate) fn without_foreign<'r>(
        &self,
        noise: &Noise,
        code_max: u16,
        rows: impl Iterator<Item = FullRow<'r>> + Clone,
    ) -> Self {
        const ROUNDS: usize = 3;
        let whole = self.kept(rows.clone(), code_max, |_, _| true);
        let mut kept = whole.clone();
        for _ in 0..ROUNDS {
            let Some(incline) = kept.incline() else { break };
            let bound = FOREIGN_SIGMAS * self.variance(noise, self.level + incline.level).sqrt();
            kept = self.kept(rows.clone(), code_max, |place, code| (code - incline.at(place)).abs() < bound);
        }
        let foreign = kept.masked - whole.masked;
        if foreign as f64 > FOREIGN_SHARE * self.count { whole } else { kept }
    }

    fn kept<'r>(
        &self,
        rows: impl Iterator<Item = FullRow<'r>>,
        code_max: u16,
        is_own: impl Fn([f64; 2], f64) -> bool,
    ) -> Self {
        let mut kept = Tally::about(self.level as f32, self.pixels);
        let mut masked = 0;
        for row in rows {
            for (k, code) in row.codes.iter().step_by(row.step).take(row.count).enumerate() {
                let place = [row.first_px + (row.step * k) as f64, row.dv_px];
                if *code < code_max && is_own(place, f64::from(*code) - self.level) {
                    let values = &[f32::from(*code); LANES];
                    kept.add(&Stretch { values, count: 1, first_px: place[0], step_px: 1.0, dv_px: place[1] });
                } else {
                    masked += 1;
                }
            }
        }
        Self { masked, ..kept.finish() }
    }

    /// The level with a slope that fits the codes best.
    fn incline(&self) -> Option<Incline> {
        let ([u, v], [uu, uv, vv]) = (self.place, self.places);
        let normal = Matrix3::new(self.count, u, v, u, uu, uv, v, uv, vv);
        let [level, along_u, along_v] =
            (normal.try_inverse()? * nalgebra::Vector3::new(self.code, self.code_place[0], self.code_place[1])).into();
        Some(Incline { level, slope: [along_u, along_v] })
    }

    /// Relative growth of the light in the middle of the pixels, 1/px, and what is known of it.
    ///
    /// ```text
    /// Σ d (p − p̄) = L Σ (p − p̄)(p − p̄)ᵀ g
    /// ```
    pub(crate) fn growth(&self, noise: &Noise) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        let Incline { level, slope } = self.incline()?;
        let (slope, mean) = (Vector2::from(slope), Vector2::from(self.place) / self.count);
        let [uu, uv, vv] = self.places;
        let spread = Matrix2::new(uu, uv, uv, vv) - mean * mean.transpose() * self.count;
        let code = self.level + level + slope.dot(&mean);
        let light = code - noise.black_level;
        (light > 0.0).then(|| (slope / light, spread * (light * light / self.variance(noise, code))))
    }

    /// What the pixels say of their light.
    ///
    /// ```text
    /// r = d + r₀ − L g·p      r₀ = level − black − L l₀
    /// ```
    pub(crate) fn sums(&self, light: &FullLight, black: &Black) -> FullSums {
        let ([u, v], [uu, uv, vv], [gu, gv]) = (self.place, self.places, light.growth);
        let growth = gu * u + gv * v;
        let growth2 = gu * gu * uu + 2.0 * gu * gv * uv + gv * gv * vv;
        let code_growth = gu * self.code_place[0] + gv * self.code_place[1];
        let middle = light.level * light.lit;
        let reading = black.reading(middle as f32);
        let (slope, trust) = (f64::from(reading.slope), self.pixels * f64::from(reading.trust));
        let start = self.level - black.noise().black_level - f64::from(reading.mean);
        let level = slope * light.level;
        let square = light.lit * light.lit * self.count + 2.0 * light.lit * growth + growth2;
        let score = light.lit * (self.code + self.count * start - level * growth) + code_growth + start * growth
            - level * growth2;
        let chi2 = self.code2 + self.count * start * start + level * level * growth2 + 2.0 * start * self.code
            - 2.0 * level * code_growth
            - 2.0 * start * level * growth;
        FullSums {
            information: trust * slope * slope * square,
            score: trust * slope * score,
            chi2: trust * chi2,
            used: self.count as usize,
        }
    }
}

impl Stretch<'_> {
    /// By whole lanes.
    #[inline(always)]
    pub(crate) fn chunks(&self) -> &[Lanes] {
        let lanes = self.count.div_ceil(LANES);
        &self.values.as_chunks().0[..lanes]
    }
}

impl Incline {
    fn at(&self, [u, v]: [f64; 2]) -> f64 {
        self.level + self.slope[0] * u + self.slope[1] * v
    }
}

/// Rows whose sums may stay in single precision.
const ROWS: usize = 32;

/// Adds up rows of pixels.
#[derive(Debug, Clone)]
pub(crate) struct Tally {
    full: Full,
    rows: usize,
    /// Σd, Σdu, Σdv and Σd² of the rows that are not in the sums yet.
    sums: [Lanes; 4],
    lowest: Lanes,
    highest: Lanes,
}

impl Tally {
    /// Of no pixel yet, about a level; every value will be the mean of so many.
    pub(crate) fn about(level: f32, pixels: f64) -> Self {
        Self {
            full: Full::about(level, pixels),
            rows: 0,
            sums: [[0.0; LANES]; 4],
            lowest: [f32::INFINITY; LANES],
            highest: [f32::NEG_INFINITY; LANES],
        }
    }

    /// Adds pixels of a row.
    #[inline(always)]
    pub(crate) fn add(&mut self, stretch: &Stretch<'_>) {
        if stretch.count == 0 {
            return;
        }
        self.place(stretch);
        let (first_px, step_px) = (stretch.first_px as f32, stretch.step_px as f32);
        let mut along_px: Lanes = std::array::from_fn(|lane| first_px + step_px * (lane as u8) as f32);
        let (chunks, rest) = (stretch.chunks(), stretch.count % LANES);
        let (chunks, last) = if rest == 0 { (chunks, None) } else { (&chunks[..chunks.len() - 1], chunks.last()) };
        for chunk in chunks {
            self.add_lanes(chunk, &[1.0; LANES], &along_px, stretch.dv_px as f32);
            along_px = along_px.map(|px| px + LANES as f32 * step_px);
        }
        if let Some(last) = last {
            // Others in the places of those that do not count.
            let (mut own, mut counts) = (*last, [0.0; LANES]);
            for lane in 0..LANES {
                let is_own = (lane as u32) < rest as u32;
                own[lane] = if is_own { own[lane] } else { last[0] };
                counts[lane] = if is_own { 1.0 } else { 0.0 };
            }
            self.add_lanes(&own, &counts, &along_px, stretch.dv_px as f32);
        }
        self.rows += 1;
        if self.rows == ROWS {
            self.settle();
        }
    }

    /// Adds pixels; those whose count is 0 only repeat another's code.
    #[inline(always)]
    fn add_lanes(&mut self, values: &Lanes, counts: &Lanes, along_px: &Lanes, dv_px: f32) {
        let level = self.full.level as f32;
        let [code, code_u, code_v, code2] = &mut self.sums;
        for lane in 0..LANES {
            let away = values[lane] - level;
            let d = away * counts[lane];
            self.lowest[lane] = if away < self.lowest[lane] { away } else { self.lowest[lane] };
            self.highest[lane] = if away > self.highest[lane] { away } else { self.highest[lane] };
            code[lane] += d;
            code_u[lane] += d * along_px[lane];
            code_v[lane] += d * dv_px;
            code2[lane] += d * d;
        }
    }

    /// Adds where pixels of a row lie.
    #[inline(always)]
    fn place(&mut self, Stretch { count, first_px, step_px: step, dv_px, .. }: &Stretch<'_>) {
        let n = *count as f64;
        // The places are evenly spaced about their middle: Σ(k − k̄)² = n (n² − 1)/12.
        let middle = first_px + 0.5 * step * (n - 1.0);
        let Full { count, place, places, .. } = &mut self.full;
        *count += n;
        place[0] += n * middle;
        place[1] += n * dv_px;
        places[0] += n * (middle * middle + step * step * (n * n - 1.0) * (1.0 / 12.0));
        places[1] += n * middle * dv_px;
        places[2] += n * dv_px * dv_px;
    }

    fn settle(&mut self) {
        let [code, code_u, code_v, code2] = self.sums.map(|lanes| f64::from(lanes.iter().sum::<f32>()));
        self.full.code += code;
        self.full.code_place[0] += code_u;
        self.full.code_place[1] += code_v;
        self.full.code2 += code2;
        self.sums = [[0.0; LANES]; 4];
        self.rows = 0;
    }

    /// The sums over all rows.
    pub(crate) fn finish(mut self) -> Full {
        self.settle();
        self.full.lowest = self.lowest.iter().fold(f64::INFINITY, |least, d| least.min(f64::from(*d)));
        self.full.highest = self.highest.iter().fold(f64::NEG_INFINITY, |most, d| most.max(f64::from(*d)));
        self.full
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: Noise = Noise { floor_codes2: 1.0, slope_codes: 0.1, black_level: 8.0 };

    /// Every second code of `codes`, in rows of `width`.
    fn rows(codes: &[u16], width: usize) -> Vec<FullRow<'_>> {
        let row = |(index, codes)| FullRow {
            codes,
            step: 2,
            count: width / 2,
            first_px: -0.3 * width as f64,
            dv_px: 2.0 * index as f64 - 9.0,
        };
        codes.chunks(width).enumerate().map(row).collect()
    }

    fn of(rows: &[FullRow<'_>]) -> Full {
        let mut tally = Tally::about(990.0, 1.0);
        for FullRow { codes, step, first_px, dv_px, .. } in rows {
            let mut values: Vec<f32> = codes.iter().step_by(*step).map(|code| f32::from(*code)).collect();
            let (count, step_px) = (values.len(), *step as f64);
            values.resize(count + LANES, f32::NAN);
            tally.add(&Stretch { values: &values, count, first_px: *first_px, step_px, dv_px: *dv_px });
        }
        tally.finish()
    }

    fn codes() -> Vec<u16> {
        (0..520_u32).map(|k| (1000 + (k * k) % 17) as u16).collect()
    }

    #[test]
    fn the_sums_are_those_over_pixels() {
        let codes = codes();
        let rows = rows(&codes, 52);
        let light = FullLight { level: 995.0, lit: 1.02, growth: [3e-4, -2e-4] };
        let sums = of(&rows).sums(&light, &Black::new(&NOISE));
        let trust = 1.0 / NOISE.variance(light.level * light.lit + NOISE.black_level);
        let (mut information, mut score, mut chi2) = (0.0, 0.0, 0.0);
        for row in &rows {
            for k in 0..row.count {
                let lit = light.lit + light.growth[0] * (row.first_px + 2.0 * k as f64) + light.growth[1] * row.dv_px;
                let left = f64::from(row.codes[2 * k]) - NOISE.black_level - light.level * lit;
                information += trust * lit * lit;
                score += trust * lit * left;
                chi2 += trust * left * left;
            }
        }
        let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-5, "{a} {b}");
        near(sums.information, information);
        near(sums.score, score);
        near(sums.chi2, chi2);
    }

    #[test]
    fn hot_and_saturated_pixels_are_left_out() {
        let mut codes = codes();
        let clean = of(&rows(&codes, 52));
        assert!(clean.is_even(&NOISE, 4095));
        (codes[40], codes[300]) = (4095, 100);
        let rows = rows(&codes, 52);
        let full = of(&rows);
        assert!(!full.is_even(&NOISE, 4095));
        let kept = full.without_foreign(&NOISE, 4095, rows.iter().copied());
        assert_eq!((kept.masked, kept.count()), (2, clean.count() - 2.0));
        assert!(kept.is_even(&NOISE, 4095));
    }

    #[test]
    fn a_pattern_is_no_defect() {
        let codes: Vec<u16> = (0..520).map(|k| if (k / 20) % 2 == 0 { 1000 } else { 1500 }).collect();
        let rows = rows(&codes, 52);
        let kept = of(&rows).without_foreign(&NOISE, 4095, rows.iter().copied());
        assert_eq!(kept.masked, 0);
    }
}
