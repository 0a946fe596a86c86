//! A plane seen by blocks of its pixels: where blur is wide, means of a few tell as much as each of them.

use twinpupil_instrument::PlaneView;

use crate::noise::Noise;
use crate::scout::light::read_every;

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
    row: Vec<f32>,
    sum: Vec<f32>,
    lowest: Vec<f32>,
    highest: Vec<f32>,
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

    /// Reads as many means of one row as `means` holds, from a column on; whether the pixels of each block are alike. Of single
    /// pixels that is not asked.
    #[inline(always)]
    pub(crate) fn read(
        &self,
        row: usize,
        first: usize,
        likeness: &Likeness,
        lines: &mut Lines,
        means: &mut [f32],
    ) -> bool {
        let codes = |part: usize| {
            let line = self.plane.line(row * self.grain + part);
            line.get(first * self.grain * self.plane.step_px..).unwrap_or_default()
        };
        let step = self.plane.step_px;
        match self.grain {
            1 => {
                read_every(codes(0), step, f32::from, means);
                true
            }
            2 => lines.take_means::<2>(codes, step, likeness, means),
            3 => lines.take_means::<3>(codes, step, likeness, means),
            _ => lines.take_means::<GRAIN_MAX>(codes, step, likeness, means),
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
    /// Means of N × N pixels, of which `codes` gives the N rows.
    #[inline(always)]
    fn take_means<'c, const N: usize>(
        &mut self,
        codes: impl Fn(usize) -> &'c [u16],
        step: usize,
        likeness: &Likeness,
        means: &mut [f32],
    ) -> bool {
        let count = N * means.len();
        if self.row.len() < count {
            for line in [&mut self.row, &mut self.sum, &mut self.lowest, &mut self.highest] {
                line.resize(count, 0.0);
            }
        }
        let [row, sum, lowest, highest] =
            [&mut self.row, &mut self.sum, &mut self.lowest, &mut self.highest].map(|line| &mut line[..count]);
        read_every(codes(0), step, f32::from, sum);
        lowest.copy_from_slice(sum);
        highest.copy_from_slice(sum);
        for part in 1..N {
            read_every(codes(part), step, f32::from, row);
            for (((code, sum), lowest), highest) in row.iter().zip(&mut *sum).zip(&mut *lowest).zip(&mut *highest) {
                *sum += code;
                *lowest = if *code < *lowest { *code } else { *lowest };
                *highest = if *code > *highest { *code } else { *highest };
            }
        }
        let per_pixel = 1.0 / (N * N) as f32;
        let (sums, lowest, highest) = (sum.as_chunks::<N>().0, lowest.as_chunks::<N>().0, highest.as_chunks::<N>().0);
        let mut torn = 0;
        for (((mean, sum), lowest), highest) in means.iter_mut().zip(sums).zip(lowest).zip(highest) {
            *mean = per_pixel * sum.iter().sum::<f32>();
            let lowest = lowest.iter().fold(f32::INFINITY, |least, code| if *code < least { *code } else { least });
            let highest = highest.iter().fold(0.0, |most, code| if *code > most { *code } else { most });
            torn |= likeness.is_torn(lowest, highest);
        }
        torn == 0
    }
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
                let mut means = vec![0.0; blocks[0] - 1];
                assert!(seen.read(0, 1, &likeness, &mut Lines::default(), &mut means));
                for (column, mean) in means.iter().enumerate() {
                    assert_eq!(f64::from(*mean), [seen.u_px(column + 1), seen.v_px(0)][axis]);
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
            Blocks::of(&plane, 2).read(0, 0, &likeness, &mut Lines::default(), &mut [0.0; 4])
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
