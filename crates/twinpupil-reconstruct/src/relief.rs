//! The surface on which features are looked for: contrast, smoothed and, where features are large, coarser.

use crate::contrast::Contrast;

/// Smoothed contrast; for finding features, never for measuring them.
#[derive(Debug, Clone)]
pub(crate) struct Relief {
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    /// Values row by row, codes.
    pub(crate) heights: Vec<f32>,
    /// Pixels of the plane along one side of a pixel of the relief.
    pub(crate) scale: usize,
    /// Standard deviation of the background, codes.
    pub(crate) noise: f32,
}

/// Noise that passes the binomial filter [1 2 1]²/16: Σ w² = (6/16)².
const BINOMIAL_GAIN: f32 = 0.375;

impl Relief {
    /// The relief of a plane at a scale of 1 or more: means over squares of pixels, then a 3×3 binomial filter. A plane
    /// too small for a scale keeps its own.
    pub(crate) fn of(contrast: &Contrast, scale: usize) -> Self {
        const SIDE_MIN: usize = 8;
        let scale = if contrast.columns.min(contrast.rows) / scale < SIDE_MIN { 1 } else { scale };
        let (columns, rows) = (contrast.columns / scale, contrast.rows / scale);
        let means = match scale {
            1 => None,
            _ => Some(means(contrast, scale)),
        };
        let heights = binomial(means.as_deref().unwrap_or(&contrast.signal), columns, rows);
        Self { columns, rows, heights, scale, noise: contrast.pixel_noise * BINOMIAL_GAIN / scale as f32 }
    }

    /// Position in the plane of a position in the relief.
    pub(crate) fn plane_position(&self, position: f64) -> f64 {
        (position + 0.5) * self.scale as f64 - 0.5
    }

    /// Height at the pixel nearest to a position in the relief, `None` outside.
    pub(crate) fn near(&self, column: f64, row: f64) -> Option<f32> {
        let (c, r) = (column.round(), row.round());
        let inside = c >= 0.0 && r >= 0.0 && c < self.columns as f64 && r < self.rows as f64;
        inside.then(|| self.heights[r as usize * self.columns + c as usize])
    }
}

/// Means over squares of pixels; rows and columns that fill no square are left out.
fn means(contrast: &Contrast, scale: usize) -> Vec<f32> {
    let (columns, rows) = (contrast.columns / scale, contrast.rows / scale);
    let share = 1.0 / (scale * scale) as f32;
    let mut means = vec![0.0; columns * rows];
    for (row, line) in means.chunks_exact_mut(columns).enumerate() {
        for r in row * scale..(row + 1) * scale {
            let start = r * contrast.columns;
            let source = &contrast.signal[start..start + columns * scale];
            for (mean, square) in line.iter_mut().zip(source.chunks_exact(scale)) {
                *mean += share * square.iter().sum::<f32>();
            }
        }
    }
    means
}

/// The filter [1 2 1]/4 along rows and columns, edges repeated.
fn binomial(signal: &[f32], columns: usize, rows: usize) -> Vec<f32> {
    let mut along_rows = vec![0.0; signal.len()];
    for (line, smooth) in signal.chunks_exact(columns).zip(along_rows.chunks_exact_mut(columns)) {
        smooth[0] = line[0];
        smooth[columns - 1] = line[columns - 1];
        for (value, three) in smooth[1..].iter_mut().zip(line.windows(3)) {
            *value = 0.25 * (three[0] + 2.0 * three[1] + three[2]);
        }
    }
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
