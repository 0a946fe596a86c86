//! What is asked of the contrasts along a run.

use multiversion::multiversion;

use crate::scout::light::RowAgainst;
use crate::scout::run::runs_of_row;

/// Contrasts of neighbouring pixels of a row, from a column on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RowLight<'a> {
    pub(crate) contrasts: &'a [f32],
    pub(crate) first: u32,
}

impl RowLight<'_> {
    /// Calls `found` with the first column, the column behind the last, and the highest pair of every run above a level.
    pub(crate) fn runs_above(&self, level: f32, masks: &mut Vec<u16>, mut found: impl FnMut(u32, u32, f32)) {
        let Self { contrasts, first } = *self;
        let mut add = |start: usize, end: usize| {
            found(first + start as u32, first + end as u32, highest_pair(&contrasts[start..end]));
        };
        // Most runs stay one, with less on both sides.
        let Some(start) = contrasts.iter().position(|contrast| *contrast > level) else { return };
        let end = contrasts.iter().rposition(|contrast| *contrast > level).map_or(start, |last| last + 1);
        let inside = &contrasts[start..end];
        if count_above(inside, level) as usize == inside.len() {
            add(start, end);
        } else {
            let against = RowAgainst::Field { line: inside, limit: level };
            runs_of_row(against, masks, |a, b| add(start + a, start + b));
        }
    }

    /// Number of pixels above a level.
    pub(crate) fn count_above(&self, level: f32) -> u32 {
        count_above(self.contrasts, level)
    }

    /// Sums of the contrasts and of contrast × column.
    pub(crate) fn light(&self) -> [f64; 2] {
        let [light, along, _] = row_sums(self.contrasts);
        [light, along + f64::from(self.first) * light]
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn count_above(contrasts: &[f32], level: f32) -> u32 {
    contrasts.iter().fold(0, |count, contrast| count + u32::from(*contrast > level))
}

/// The highest contrast that two neighbouring pixels both reach; 0 of a single pixel.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn highest_pair(contrasts: &[f32]) -> f32 {
    const LANES: usize = 8;
    let Some(next) = contrasts.get(1..) else { return 0.0 };
    let lower = |a: f32, b: f32| if a < b { a } else { b };
    let higher = |a: f32, b: f32| if a > b { a } else { b };
    let mut lanes = [0.0_f32; LANES];
    let (blocks, next_blocks) = (contrasts[..next.len()].as_chunks::<LANES>(), next.as_chunks::<LANES>());
    for (a, b) in blocks.0.iter().zip(next_blocks.0) {
        for lane in 0..LANES {
            lanes[lane] = higher(lanes[lane], lower(a[lane], b[lane]));
        }
    }
    let rest = blocks.1.iter().zip(next_blocks.1).fold(0.0, |peak, (a, b)| higher(peak, lower(*a, *b)));
    lanes.iter().fold(rest, |peak, lane| higher(peak, *lane))
}

/// Sums of the values of a row, of value × index and of value × index².
///
/// The index is that of a block and the place in it: the sums need only those of value, value × block and value ×
/// block² for every place.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn row_sums(line: &[f32]) -> [f64; 3] {
    const LANES: usize = 8;
    let (blocks, rest) = line.as_chunks::<LANES>();
    let mut sums = [[0.0_f32; LANES]; 3];
    let mut start = 0.0_f32;
    for values in blocks {
        for lane in 0..LANES {
            let weighted = start * values[lane];
            sums[0][lane] += values[lane];
            sums[1][lane] += weighted;
            sums[2][lane] += start * weighted;
        }
        start += LANES as f32;
    }
    for (lane, value) in rest.iter().enumerate() {
        sums[0][lane] += value;
        sums[1][lane] += start * value;
        sums[2][lane] += start * start * value;
    }
    let mut total = [0.0; 3];
    for lane in 0..LANES {
        let place = lane as f64;
        let [s0, s1, s2] = sums.map(|lanes| f64::from(lanes[lane]));
        total[0] += s0;
        total[1] += s1 + place * s0;
        total[2] += s2 + 2.0 * place * s1 + place * place * s0;
    }
    total
}

/// Sum of the squares of the values of a row.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn square_sum(line: &[f32]) -> f64 {
    const LANES: usize = 8;
    let (blocks, rest) = line.as_chunks::<LANES>();
    let mut lanes = [0.0_f32; LANES];
    for values in blocks {
        for lane in 0..LANES {
            lanes[lane] += values[lane] * values[lane];
        }
    }
    f64::from(lanes.iter().sum::<f32>() + rest.iter().map(|value| value * value).sum::<f32>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_a_row_are_those_of_a_plain_loop() {
        for length in [0, 1, 7, 8, 21, 64] {
            let line: Vec<f32> = (0..length).map(|k| (k * 7 % 5) as f32).collect();
            let plain = |power: i32| -> f64 {
                line.iter().enumerate().map(|(k, &v)| f64::from(v) * f64::from(k as u32).powi(power)).sum()
            };
            assert_eq!(row_sums(&line), [plain(0), plain(1), plain(2)]);
        }
    }

    #[test]
    fn a_single_bright_pixel_is_no_peak() {
        for length in [0, 1, 2, 9, 30] {
            let mut line = vec![5.0; length];
            if let Some(middle) = line.get_mut(length / 2) {
                *middle = 4000.0;
            }
            assert_eq!(highest_pair(&line), if length > 1 { 5.0 } else { 0.0 }, "{length}");
        }
    }

    #[test]
    fn a_run_falls_apart_where_it_is_low() {
        let contrasts = [1.0, 5.0, 6.0, 1.0, 7.0, 8.0, 2.0];
        let mut runs = Vec::new();
        RowLight { contrasts: &contrasts, first: 10 }
            .runs_above(3.0, &mut Vec::new(), |a, b, peak| runs.push((a, b, peak)));
        assert_eq!(runs, [(11, 13, 5.0), (14, 16, 7.0)]);
    }
}
