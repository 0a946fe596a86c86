//! A plane seen by blocks of its pixels: where blur is wide, means of a few tell as much as each of them.

use twinpupil_instrument::PlaneView;

use crate::likelihood::chords::{LANES, Lanes};
use crate::noise::Noise;

/// Blocks of `grain × grain` pixels of a plane, side by side.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Blocks<'a> {
    pub(crate) plane: &'a PlaneView<'a>,
    pub(crate) grain: usize,
    /// Middle of the first, and from one to the next, px.
    origin_px: [f64; 2],
    pub(crate) step_px: f64,
    pub(crate) columns: usize,
    pub(crate) rows: usize,
}

/// How much the pixels of a block may differ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Likeness {
    floor_codes2: f32,
    slope_codes: f32,
    black_level: f32,
    /// By the light itself, codes.
    pub(crate) rise: f32,
    saturated: f32,
}

/// Rows of pixels while blocks are made of them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lines {
    sum: Vec<Lanes>,
    lowest: Vec<Lanes>,
    highest: Vec<Lanes>,
}

/// Largest number of pixels along the side of a block.
const GRAIN_MAX: usize = 4;

/// Least blur over the width of a block: then the light across a block is nearly straight, and its mean tells of the edge almost
/// what its pixels do. At 3.9 deviations of depth would be 2 to 3 % smaller.
const BLUR_SHARE: f64 = 3.3;

impl<'a> Blocks<'a> {
    pub(crate) fn of(plane: &'a PlaneView<'a>, grain: usize) -> Self {
        let middle_px = 0.5 * ((grain - 1) * plane.step_px) as f64;
        Self {
            plane,
            grain,
            origin_px: plane.origin_px.map(|px| px as f64 + middle_px),
            step_px: (grain * plane.step_px) as f64,
            columns: plane.columns / grain,
            rows: plane.rows / grain,
        }
    }

    /// Pixels along the side of a block that serves such a blur.
    pub(crate) fn grain_for(blur_px: f64, step_px: usize) -> usize {
        let serves = |grain: &usize| blur_px >= BLUR_SHARE * (grain * step_px) as f64;
        (2..=GRAIN_MAX).rev().find(serves).unwrap_or(1)
    }

    /// Width of the square with the second moment of a block, px: `Σ(x − x̄)²/n = step² (n² − 1)/12`, and a pixel's own.
    pub(crate) fn square_px(&self) -> f64 {
        square_px(self.grain, self.plane.step_px)
    }

    /// Pixels to a block.
    pub(crate) fn pixels(&self) -> f64 {
        (self.grain * self.grain) as f64
    }

    /// Frame column of the middle of a column.
    #[inline(always)]
    pub(crate) fn u_px(&self, column: usize) -> f64 {
        self.origin_px[0] + column as f64 * self.step_px
    }

    /// Frame row of the middle of a row.
    #[inline(always)]
    pub(crate) fn v_px(&self, row: usize) -> f64 {
        self.origin_px[1] + row as f64 * self.step_px
    }

    #[inline(always)]
    pub(crate) fn origin_px(&self) -> [f64; 2] {
        self.origin_px
    }

    /// Reads `count` means of one row from a column on, and what lies beyond them; whether the pixels of each block are alike.
    /// Of single pixels that is not asked.
    #[inline(always)]
    pub(crate) fn read(
        &self,
        row: usize,
        first: usize,
        count: usize,
        likeness: &Likeness,
        lines: &mut Lines,
        means: &mut [Lanes],
    ) -> bool {
        let step = self.plane.step_px;
        let start = first * self.grain * step;
        let line = |part: usize| self.plane.line(row * self.grain + part).get(start..).unwrap_or_default();
        let means = &mut means[..count.div_ceil(LANES)];
        match self.grain {
            1 => {
                add_up([line(0)], step, [means, &mut [], &mut []]);
                true
            }
            2 => lines.take_means::<2>(line, step, count, likeness, means),
            3 => lines.take_means::<3>(line, step, count, likeness, means),
            _ => lines.take_means::<GRAIN_MAX>(line, step, count, likeness, means),
        }
    }
}

/// See [`Blocks::square_px`].
pub(crate) fn square_px(grain: usize, step_px: usize) -> f64 {
    (1.0 + ((grain * grain - 1) * step_px * step_px) as f64).sqrt()
}

impl Likeness {
    /// Of pixels with some noise, between which the light may rise by `rise`, codes.
    pub(crate) fn new(noise: &Noise, rise: f32, code_max: u16) -> Self {
        // Of the difference of two; chance exceeds it in one of ten million blocks.
        const SIGMAS2: f64 = 64.0;
        Self {
            floor_codes2: (SIGMAS2 * noise.floor_codes2) as f32,
            slope_codes: (SIGMAS2 * noise.slope_codes) as f32,
            black_level: noise.black_level as f32,
            rise,
            saturated: f32::from(code_max),
        }
    }

    /// 1 if the pixels of a block between two codes are not alike.
    #[inline(always)]
    fn is_torn(&self, lowest: f32, highest: f32) -> u32 {
        let left = (highest - lowest - self.rise).max(0.0);
        let bound = self.floor_codes2 + self.slope_codes * (highest - self.black_level).max(0.0);
        u32::from((left * left > bound) | (highest >= self.saturated))
    }
}

impl Lines {
    /// Means of N × N pixels, of which `line` gives the N rows; every `step`-th code is a pixel's.
    #[inline(always)]
    fn take_means<'c, const N: usize>(
        &mut self,
        line: impl Fn(usize) -> &'c [u16],
        step: usize,
        count: usize,
        likeness: &Likeness,
        means: &mut [Lanes],
    ) -> bool {
        let length = N * means.len();
        let lines = [&mut self.sum, &mut self.lowest, &mut self.highest].map(|line| {
            if line.len() < length {
                line.resize(length, [0.0; LANES]);
            }
            &mut line[..length]
        });
        add_up::<N>(std::array::from_fn(line), step, lines);
        let means = means.as_flattened_mut();
        let blocks = means.len();
        let [sums, lowest, highest] =
            [&self.sum, &self.lowest, &self.highest].map(|line| &line.as_flattened().as_chunks::<N>().0[..blocks]);
        let per_pixel = 1.0 / (N * N) as f32;
        let mut torn = 0;
        for block in 0..blocks {
            means[block] = per_pixel * sums[block].iter().sum::<f32>();
            let lowest =
                lowest[block].iter().fold(f32::INFINITY, |least, code| if *code < least { *code } else { least });
            let highest = highest[block].iter().fold(0.0, |most, code| if *code > most { *code } else { most });
            let is_asked = u32::from((block as u32) < count as u32);
            torn |= is_asked & likeness.is_torn(lowest, highest);
        }
        torn == 0
    }
}

/// Sums of the codes of N rows, and if there is more than one the lowest and the highest of them, column by column; every
/// `step`-th code is a pixel's, and beyond the rows all are 0.
#[inline(always)]
fn add_up<const N: usize>(rows: [&[u16]; N], step: usize, [sum, lowest, highest]: [&mut [Lanes]; 3]) {
    match step {
        1 => add_up_by::<N, 1>(rows, [sum, lowest, highest]),
        2 => add_up_by::<N, 2>(rows, [sum, lowest, highest]),
        _ => {
            for (place, sum) in sum.iter_mut().enumerate() {
                let own = rows.map(|row| taken::<1>(row.get(place * LANES * step..).unwrap_or_default(), step));
                let range = if N > 1 { place..place + 1 } else { 0..0 };
                let (lowest, highest) = (&mut lowest[range.clone()], &mut highest[range]);
                let rows = own.each_ref().map(|own| own.as_flattened());
                add_up_by::<N, 1>(rows, [std::slice::from_mut(sum), lowest, highest]);
            }
        }
    }
}

/// The same, where every STEP-th code is a pixel's.
#[inline(always)]
fn add_up_by<const N: usize, const STEP: usize>(rows: [&[u16]; N], [sum, lowest, highest]: [&mut [Lanes]; 3]) {
    for (place, sum) in sum.iter_mut().enumerate() {
        let range = place * LANES * STEP..(place + 1) * LANES * STEP;
        let is_whole = rows.iter().all(|row| row.len() >= range.end);
        let last = if is_whole {
            [[[0; STEP]; LANES]; N]
        } else {
            rows.map(|row| taken::<STEP>(row.get(range.start..).unwrap_or_default(), 1))
        };
        let (mut total, mut low, mut high) = ([0.0; LANES], [f32::INFINITY; LANES], [0.0; LANES]);
        for part in 0..N {
            let codes: &[[u16; STEP]] = if is_whole { rows[part][range.clone()].as_chunks().0 } else { &last[part] };
            let codes = &codes[..LANES];
            for column in 0..LANES {
                let code = f32::from(codes[column][0]);
                total[column] += code;
                low[column] = if code < low[column] { code } else { low[column] };
                high[column] = if code > high[column] { code } else { high[column] };
            }
        }
        *sum = total;
        if N > 1 {
            (lowest[place], highest[place]) = (low, high);
        }
    }
}

/// Every `step`-th code of a row, as far as it goes.
#[inline(always)]
fn taken<const STEP: usize>(row: &[u16], step: usize) -> [[u16; STEP]; LANES] {
    let mut taken = [[0; STEP]; LANES];
    taken.as_flattened_mut().iter_mut().zip(row.iter().step_by(step)).for_each(|(own, code)| *own = *code);
    taken
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{Frame, Mosaic};

    use super::*;

    const NOISE: Noise = Noise { floor_codes2: 1.0, slope_codes: 0.1, black_level: 8.0 };

    fn frame(code: impl Fn(usize, usize) -> u16) -> Frame {
        let codes = (0..12).flat_map(|v| (0..18).map(move |u| (u, v))).map(|(u, v)| code(u, v)).collect();
        Frame::new(18, 12, 4095, vec![codes]).expect("a legal frame")
    }

    #[test]
    fn means_are_those_of_the_pixels_about_the_middle() {
        // Where codes are their places, means are the middles.
        for (grain, blocks) in [(1, [9, 6]), (2, [4, 3]), (3, [3, 2]), (4, [2, 1])] {
            for (axis, frame) in [frame(|u, _| u as u16), frame(|_, v| v as u16)].iter().enumerate() {
                let plane = frame.plane(Mosaic::Rggb, "b").expect("rggb has b");
                let seen = Blocks::of(&plane, grain);
                assert_eq!([seen.columns, seen.rows], blocks);
                let likeness = Likeness::new(&NOISE, 0.0, 4095);
                let (count, mut means) = (blocks[0] - 1, [[0.0; LANES]]);
                assert!(seen.read(0, 1, count, &likeness, &mut Lines::default(), &mut means));
                for (column, mean) in means.as_flattened()[..count].iter().enumerate() {
                    assert_eq!(f64::from(*mean), [seen.u_px(column + 1), seen.v_px(0)][axis]);
                }
            }
        }
    }

    #[test]
    fn rows_are_read_to_their_ends() {
        // Wider than the lanes, and ending between them.
        let (columns, rows) = (39, 8);
        for step in 1..=3 {
            let code = |place: usize| (7 * place % 251) as u16;
            let codes: Vec<u16> = (0..columns * step * rows * step).map(code).collect();
            let frame = Frame::new(columns * step, rows * step, 4095, vec![codes]).expect("a legal frame");
            let mut plane = frame.plane(Mosaic::Mono, "0").expect("page 0");
            (plane.columns, plane.rows, plane.step_px) = (columns, rows, step);
            for grain in 1..=GRAIN_MAX {
                let (seen, first) = (Blocks::of(&plane, grain), 2);
                let (count, mut means) = (seen.columns - first, [[0.0; LANES]; 3]);
                seen.read(1, first, count, &Likeness::new(&NOISE, 0.0, 4095), &mut Lines::default(), &mut means);
                for (block, mean) in means.as_flattened()[..count].iter().enumerate() {
                    let places = (0..grain * grain).map(|k| [grain + k / grain, grain * (first + block) + k % grain]);
                    let sum: u32 = places.map(|[row, column]| u32::from(plane.code(column, row))).sum();
                    assert_eq!(*mean, (1.0 / (grain * grain) as f32) * sum as f32, "{step} {grain} {block}");
                }
            }
        }
    }

    #[test]
    fn blocks_are_torn_by_pixels_unlike_the_others() {
        let likeness = Likeness::new(&NOISE, 20.0, 4095);
        let reads = |code: u16| {
            let frame = frame(|u, v| if (u, v) == (5, 3) { code } else { 1000 });
            let plane = frame.plane(Mosaic::Rggb, "b").expect("rggb has b");
            Blocks::of(&plane, 2).read(0, 0, 4, &likeness, &mut Lines::default(), &mut [[0.0; LANES]])
        };
        // √(1 + 99.2) is 10.
        assert!(reads(1000) && reads(1090) && reads(910));
        assert!(!reads(1110) && !reads(890) && !reads(4095) && !reads(0));
    }

    #[test]
    fn the_square_of_a_block_has_its_second_moment() {
        assert_eq!(square_px(1, 2), 1.0);
        // Pixels side by side are a square.
        assert_eq!([square_px(2, 1), square_px(4, 1)], [2.0, 4.0]);
        assert!((square_px(2, 2).powi(2) / 12.0 - (1.0 + 1.0 / 12.0)).abs() < 1e-12);
    }

    #[test]
    fn blocks_are_narrow_beside_the_blur() {
        let grains =
            |step_px: usize| [2.0, 7.9, 10.0, 15.8, 20.0, 32.0].map(|blur_px| Blocks::grain_for(blur_px, step_px));
        assert_eq!((grains(1), grains(2)), ([1, 2, 3, 4, 4, 4], [1, 1, 1, 2, 3, 4]));
    }
}
