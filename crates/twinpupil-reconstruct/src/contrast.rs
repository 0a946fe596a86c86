//! One plane of a frame, less its background: features stand out as positive values, whatever their polarity.

use twinpupil_instrument::PlaneView;

use crate::background::{Background, Polarity};
use crate::noise::Noise;

/// A plane of contrast in codes, row by row; features are positive.
#[derive(Debug, Clone)]
pub(crate) struct Contrast {
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    /// Contrast of every pixel, codes.
    pub(crate) signal: Vec<f32>,
    /// The same after a 3×3 binomial filter, for finding features; never for measuring them.
    pub(crate) smooth: Vec<f32>,
    /// Mean of the background, codes.
    pub(crate) ground: f64,
    /// Which side of the background features lie on.
    pub(crate) polarity: Polarity,
    /// Standard deviation of the background in `smooth`, codes.
    pub(crate) smooth_noise: f32,
}

/// Noise that passes the binomial filter [1 2 1]²/16: Σ w² = (6/16)².
const BINOMIAL_GAIN: f64 = 0.375;

impl Contrast {
    /// The contrast of a plane against its local background.
    pub(crate) fn new(plane: &PlaneView<'_>, polarity: Option<Polarity>, noise: Option<&Noise>) -> Self {
        let background = Background::estimate(plane, polarity, noise);
        let mut signal = Vec::with_capacity(plane.columns * plane.rows);
        let mut ground_row = vec![0.0_f32; plane.columns];
        for row in 0..plane.rows {
            background.fill_row(row, &mut ground_row);
            match background.polarity {
                Polarity::Bright => {
                    signal.extend(plane.row(row).zip(&ground_row).map(|(code, ground)| f32::from(code) - ground));
                }
                // A dark feature takes away a share of the light, so uneven light is divided out.
                Polarity::Dark => {
                    let mean = background.mean as f32;
                    signal.extend(
                        plane.row(row).zip(&ground_row).map(|(code, &ground)| {
                            (ground - f32::from(code)) * (mean / ground.max(0.05 * mean).max(1.0))
                        }),
                    );
                }
            }
        }
        let smooth = binomial(&signal, plane.columns, plane.rows);
        Self {
            columns: plane.columns,
            rows: plane.rows,
            signal,
            smooth,
            ground: background.mean,
            polarity: background.polarity,
            smooth_noise: (background.pixel_noise.max(0.3) * BINOMIAL_GAIN) as f32,
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

    /// Filtered contrast of the pixel nearest to a position, `None` outside the plane.
    pub(crate) fn smooth_near(&self, column: f64, row: f64) -> Option<f32> {
        let (c, r) = (column.round(), row.round());
        let inside = c >= 0.0 && r >= 0.0 && c < self.columns as f64 && r < self.rows as f64;
        inside.then(|| self.smooth[r as usize * self.columns + c as usize])
    }

    /// The code that a pixel of this contrast read.
    pub(crate) fn code(&self, signal: f32) -> f64 {
        match self.polarity {
            Polarity::Bright => self.ground + f64::from(signal),
            Polarity::Dark => self.ground - f64::from(signal),
        }
    }
}

/// The filter [1 2 1]/4 along rows and columns, edges repeated.
fn binomial(signal: &[f32], columns: usize, rows: usize) -> Vec<f32> {
    let along_rows: Vec<f32> = {
        let mut out = vec![0.0; signal.len()];
        for (line, smooth) in signal.chunks_exact(columns).zip(out.chunks_exact_mut(columns)) {
            smooth[0] = line[0];
            smooth[columns - 1] = line[columns - 1];
            for (value, three) in smooth[1..].iter_mut().zip(line.windows(3)) {
                *value = 0.25 * (three[0] + 2.0 * three[1] + three[2]);
            }
        }
        out
    };
    let mut out = vec![0.0; signal.len()];
    for (row, smooth) in out.chunks_exact_mut(columns).enumerate() {
        let line = |row: usize| &along_rows[row * columns..(row + 1) * columns];
        let (above, here, below) = (line(row.saturating_sub(1)), line(row), line((row + 1).min(rows - 1)));
        for (((value, a), h), b) in smooth.iter_mut().zip(above).zip(here).zip(below) {
            *value = 0.25 * (a + 2.0 * h + b);
        }
    }
    out
}
