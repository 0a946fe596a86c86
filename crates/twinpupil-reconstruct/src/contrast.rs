//! One plane of a frame, less its background: features stand out as positive values, whatever their polarity.

use twinpupil_instrument::PlaneView;

use crate::background::{Background, Polarity, quantile};
use crate::noise::Noise;
use crate::shading::Shading;

/// A plane of contrast in codes, row by row; features are positive.
#[derive(Debug, Clone)]
pub(crate) struct Contrast {
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    /// Contrast of every pixel, codes.
    pub(crate) signal: Vec<f32>,
    /// Mean of the background, codes.
    pub(crate) ground: f64,
    /// Which side of the background features lie on.
    pub(crate) polarity: Polarity,
    /// Standard deviation of a pixel of the background, codes.
    pub(crate) pixel_noise: f32,
}

/// Least noise of a pixel: that of rounding to whole codes, 1/√12.
const ROUNDING_NOISE: f64 = 0.29;

impl Contrast {
    /// The contrast of a plane against its local background.
    pub(crate) fn new(
        plane: &PlaneView<'_>,
        polarity: Option<Polarity>,
        noise: Option<&Noise>,
        shading: Option<&Shading>,
    ) -> Self {
        let background = Background::estimate(plane, polarity, noise, shading);
        let black = noise.map_or(0.0, |noise| noise.black_level as f32);
        let mut signal = Vec::with_capacity(plane.columns * plane.rows);
        let line = || vec![0.0_f32; plane.columns];
        let (mut codes, mut ground_row, mut lit_row) = (line(), line(), line());
        for row in 0..plane.rows {
            background.fill_row(row, &mut ground_row);
            lit_row.copy_from_slice(&ground_row);
            if let Some(shading) = shading {
                shading.shade(row, &mut lit_row);
            }
            plane.read_row(row, &mut codes);
            let contrast = codes.iter().zip(&lit_row).map(|(code, lit)| code - black - lit);
            match background.polarity {
                Polarity::Bright => signal.extend(contrast),
                // A dark feature takes away a share of the light, so uneven light is divided out; what the masks take
                // from the ground they take from the feature too, so that stays.
                Polarity::Dark => {
                    let mean = background.mean as f32;
                    let least = (0.05 * mean).max(1.0);
                    signal.extend(
                        contrast.zip(&ground_row).map(|(contrast, ground)| -contrast * mean / ground.max(least)),
                    );
                }
            }
        }
        Self {
            columns: plane.columns,
            rows: plane.rows,
            signal,
            ground: background.mean + f64::from(black),
            polarity: background.polarity,
            pixel_noise: background.pixel_noise.max(ROUNDING_NOISE) as f32,
        }
    }

    /// Contrast between pixels, bilinear; zero outside the plane.
    pub(crate) fn at(&self, column: f64, row: f64) -> f32 {
        let (c, r) = (column.floor(), row.floor());
        if c < 0.0 || r < 0.0 || c + 1.0 >= self.columns as f64 || r + 1.0 >= self.rows as f64 {
            return 0.0;
        }
        let (fc, fr) = ((column - c) as f32, (row - r) as f32);
        let start = r as usize * self.columns + c as usize;
        let (upper, lower) = (&self.signal[start..start + 2], &self.signal[start + self.columns..]);
        (1.0 - fr) * ((1.0 - fc) * upper[0] + fc * upper[1]) + fr * ((1.0 - fc) * lower[0] + fc * lower[1])
    }

    /// Median length of the runs of pixels along rows that are brighter than half of what stands out; 0 without any.
    pub(crate) fn median_run(&self, significant: f32) -> usize {
        const ROWS: usize = 8;
        let lines = || self.signal.chunks_exact(self.columns).step_by(ROWS);
        let mut bright: Vec<f32> =
            lines().flat_map(|line| line.iter().step_by(ROWS)).copied().filter(|s| *s > significant).collect();
        let half = 0.5 * quantile(&mut bright, 0.75).max(significant);
        let mut runs: Vec<usize> = Vec::new();
        for line in lines() {
            runs.extend(line.split(|signal| *signal <= half).map(<[f32]>::len).filter(|run| *run > 0));
        }
        runs.sort_unstable();
        runs.get(runs.len() / 2).copied().unwrap_or(0)
    }

    /// The code that a pixel of this contrast read.
    pub(crate) fn code(&self, signal: f32) -> f64 {
        match self.polarity {
            Polarity::Bright => self.ground + f64::from(signal),
            Polarity::Dark => self.ground - f64::from(signal),
        }
    }
}
