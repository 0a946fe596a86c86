//! What is asked of the contrasts along a run.

use multiversion::multiversion;

use crate::scout::light::RowAgainst;
use crate::scout::run::{Run, runs_of_row};

/// Calls `found` with every part of a run above a level; `contrasts` are the run's.
pub(crate) fn parts_above(run: &Run, contrasts: &[f32], level: f32, masks: &mut Vec<u16>, mut found: impl FnMut(Run)) {
    let mut add = |start: usize, end: usize| {
        let peak = highest_pair(&contrasts[start..end]);
        found(Run { peak, ..run.part(run.first + start as u32, run.first + end as u32) });
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
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn count_above(contrasts: &[f32], level: f32) -> u32 {
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

/// Light of a run whose first pixel lies at `x`, and its first moment along the row.
#[multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
pub(crate) fn light_of(contrasts: &[f32], x: f32) -> [f64; 2] {
    let (mut light, mut along) = ([0.0_f32; LANES], [0.0_f32; LANES]);
    let mut places: [f32; LANES] = std::array::from_fn(|lane| lane as f32);
    let (blocks, rest) = contrasts.as_chunks::<LANES>();
    for block in blocks {
        for lane in 0..LANES {
            light[lane] += block[lane];
            along[lane] += places[lane] * block[lane];
            places[lane] += LANES as f32;
        }
    }
    for (lane, value) in rest.iter().enumerate() {
        light[lane] += value;
        along[lane] += places[lane] * value;
    }
    let total = |lanes: [f32; LANES]| lanes.iter().map(|lane| f64::from(*lane)).sum::<f64>();
    let (light, along) = (total(light), total(along));
    [light, along + f64::from(x) * light]
}

/// Pixels that are summed side by side along a row, and sums that are kept from row to row.
const LANES: usize = 8;

/// Moments of light, summed row by row and in lanes, so that little is added up before the end.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Moments {
    sums: Sums,
    /// What the last rows add to light, squares, first and second moments.
    lanes: [[f32; LANES]; MOMENTS],
    rows: usize,
}

const MOMENTS: usize = 7;

/// Rows whose moments may stay in single precision.
const ROWS: usize = 16;

/// [`Moments`] with their lanes added up.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Sums {
    pub(crate) light: f64,
    pub(crate) squares: f64,
    /// First moments along and across the rows.
    pub(crate) first: [f64; 2],
    /// Second moments: along, both, across.
    pub(crate) second: [f64; 3],
}

impl Moments {
    /// Adds the pixels of a row whose first lies at `[x, y]`.
    pub(crate) fn add(&mut self, contrasts: &[f32], place: [f64; 2]) {
        add_alone(self, contrasts, place);
    }

    /// The same for one who adds many rows, and has been made for the processor.
    #[inline(always)]
    pub(crate) fn add_another(&mut self, contrasts: &[f32], [x, y]: [f64; 2]) {
        add_row(&mut self.lanes, contrasts, [x as f32, y as f32]);
        self.rows += 1;
        if self.rows == ROWS {
            self.settle();
        }
    }

    pub(crate) fn sums(mut self) -> Sums {
        self.settle();
        self.sums
    }

    fn settle(&mut self) {
        let [light, squares, along, across, along2, both, across2] =
            self.lanes.map(|lanes| lanes.iter().map(|lane| f64::from(*lane)).sum::<f64>());
        let Sums { light: l, squares: s, first: [u, v], second: [uu, uv, vv] } = self.sums;
        self.sums = Sums {
            light: l + light,
            squares: s + squares,
            first: [u + along, v + across],
            second: [uu + along2, uv + both, vv + across2],
        };
        (self.lanes, self.rows) = ([[0.0; LANES]; MOMENTS], 0);
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn add_alone(moments: &mut Moments, contrasts: &[f32], place: [f64; 2]) {
    moments.add_another(contrasts, place);
}

#[inline(always)]
fn add_row(sums: &mut [[f32; LANES]; MOMENTS], contrasts: &[f32], [x, y]: [f32; 2]) {
    let (mut light, mut squares) = ([0.0_f32; LANES], [0.0_f32; LANES]);
    let (mut along, mut along2) = ([0.0_f32; LANES], [0.0_f32; LANES]);
    let mut places: [f32; LANES] = std::array::from_fn(|lane| x + lane as f32);
    let (blocks, rest) = contrasts.as_chunks::<LANES>();
    // What fills no lanes is padded with zeros.
    let mut last = [0.0; LANES];
    last.iter_mut().zip(rest).for_each(|(last, value)| *last = *value);
    for block in 0..=blocks.len() {
        let values = blocks.get(block).unwrap_or(&last);
        for lane in 0..LANES {
            let weighted = places[lane] * values[lane];
            light[lane] += values[lane];
            squares[lane] += values[lane] * values[lane];
            along[lane] += weighted;
            along2[lane] += places[lane] * weighted;
            places[lane] += LANES as f32;
        }
    }
    let [of_light, of_squares, of_along, of_across, of_along2, of_both, of_across2] = sums;
    for lane in 0..LANES {
        of_light[lane] += light[lane];
        of_squares[lane] += squares[lane];
        of_along[lane] += along[lane];
        of_across[lane] += y * light[lane];
        of_along2[lane] += along2[lane];
        of_both[lane] += y * along[lane];
        of_across2[lane] += y * y * light[lane];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_a_plain_loop() {
        let mut moments = Moments::default();
        let (mut light, mut first, mut second, mut squares) = (0.0, [0.0; 2], [0.0; 3], 0.0);
        for (y, length) in [(-1.0, 1_usize), (0.5, 7), (2.0, 8), (3.0, 21)] {
            let line: Vec<f32> = (0..length).map(|k| (k * 7 % 5) as f32).collect();
            for (k, value) in line.iter().map(|value| f64::from(*value)).enumerate() {
                let x = k as f64 - 2.25;
                light += value;
                squares += value * value;
                first = [first[0] + x * value, first[1] + y * value];
                second = [second[0] + x * x * value, second[1] + x * y * value, second[2] + y * y * value];
            }
            moments.add(&line, [-2.25, y]);
        }
        assert_eq!(moments.sums(), Sums { light, squares, first, second });
    }

    #[test]
    fn the_light_of_a_run_is_that_of_a_plain_loop() {
        for length in [0, 1, 7, 8, 21] {
            let line: Vec<f32> = (0..length).map(|k| (k * 7 % 5) as f32).collect();
            let light: f32 = line.iter().sum();
            let along: f32 = line.iter().enumerate().map(|(k, value)| (k as f32 - 2.0) * value).sum();
            assert_eq!(light_of(&line, -2.0), [f64::from(light), f64::from(along)]);
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
        let whole = Run { row: 4, first: 10, end: 17, at: 30, peak: 8.0 };
        let mut parts = Vec::new();
        parts_above(&whole, &contrasts, 3.0, &mut Vec::new(), |part| parts.push(part));
        let part = |first, end, at, peak| Run { row: 4, first, end, at, peak };
        assert_eq!(parts, [part(11, 13, 31, 5.0), part(14, 16, 34, 7.0)]);
    }
}
