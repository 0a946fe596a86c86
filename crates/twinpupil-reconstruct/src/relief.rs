//! Contrast, smoothed: where features are faint they are looked for on it, and never measured.

/// Noise that passes the binomial filter [1 2 1]²/16: Σ w² = (6/16)².
pub(crate) const BINOMIAL_GAIN: f32 = 0.375;

/// Smoothed contrasts, row by row.
#[derive(Debug, Clone, Default)]
pub(crate) struct Relief {
    pub(crate) heights: Vec<f32>,
    along_rows: Vec<f32>,
}

impl Relief {
    /// Smooths by the filter [1 2 1]/4 along rows and columns, edges repeated.
    pub(crate) fn smooth(&mut self, contrasts: &[f32], columns: usize) {
        let Self { heights, along_rows } = self;
        along_rows.resize(contrasts.len(), 0.0);
        for (line, smooth) in contrasts.chunks_exact(columns).zip(along_rows.chunks_exact_mut(columns)) {
            smooth[0] = line[0];
            smooth[columns - 1] = line[columns - 1];
            for (value, three) in smooth[1..].iter_mut().zip(line.windows(3)) {
                *value = 0.25 * (three[0] + 2.0 * three[1] + three[2]);
            }
        }
        heights.resize(contrasts.len(), 0.0);
        let rows = contrasts.len() / columns;
        for (row, smooth) in heights.chunks_exact_mut(columns).enumerate() {
            let line = |row: usize| &along_rows[row * columns..(row + 1) * columns];
            let (above, here, below) = (line(row.saturating_sub(1)), line(row), line((row + 1).min(rows - 1)));
            for (((value, a), h), b) in smooth.iter_mut().zip(above).zip(here).zip(below) {
                *value = 0.25 * (a + 2.0 * h + b);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bright_pixel_becomes_a_small_hill() {
        let mut contrasts = [0.0; 25];
        contrasts[12] = 16.0;
        let mut relief = Relief::default();
        relief.smooth(&contrasts, 5);
        assert_eq!(relief.heights[6..9], [1.0, 2.0, 1.0]);
        assert_eq!(relief.heights[11..14], [2.0, 4.0, 2.0]);
    }
}
