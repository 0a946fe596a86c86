//! One plane of a frame, less its background: features stand out as positive values, whatever their polarity.

use twinpupil_instrument::PlaneView;

use crate::background::Polarity;
use crate::scout::ground::Ground;
use crate::scout::light::Light;
use crate::shading::Shading;

/// A plane of contrast in codes, row by row; features are positive.
#[derive(Debug, Clone, Default)]
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

impl Contrast {
    /// Computes the contrast of every pixel of a plane against its ground. `black` is the code of a pixel without light,
    /// `shading` what the masks leave of an even ground.
    pub(crate) fn fill(&mut self, plane: &PlaneView<'_>, ground: &Ground, black: f64, shading: Option<&Shading>) {
        (self.columns, self.rows) = (plane.columns, plane.rows);
        (self.ground, self.polarity, self.pixel_noise) = (ground.level, ground.polarity, ground.pixel_noise);
        self.signal.resize(plane.columns * plane.rows, 0.0);
        let Some(surface) = &ground.surface else {
            let light = Light::Codes { plane: *plane, level: ground.level as f32, polarity: ground.polarity };
            for (row, line) in self.signal.chunks_exact_mut(plane.columns).enumerate() {
                light.read(row, 0, line);
            }
            return;
        };
        let black = black as f32;
        let mut ground_row = vec![0.0_f32; plane.columns];
        let mut lit_row = ground_row.clone();
        for (row, line) in self.signal.chunks_exact_mut(plane.columns).enumerate() {
            surface.fill_row(row, &mut ground_row);
            lit_row.copy_from_slice(&ground_row);
            if let Some(shading) = shading {
                shading.shade(row, &mut lit_row);
            }
            plane.read_row(row, line);
            line.iter_mut().zip(&lit_row).for_each(|(value, lit)| *value -= black + lit);
            if ground.polarity == Polarity::Dark {
                // A dark feature takes away a share of the light, so uneven light is divided out; what the masks take
                // from the ground they take from the feature too, so that stays.
                let mean = surface.mean as f32;
                let least = (0.05 * mean).max(1.0);
                line.iter_mut().zip(&ground_row).for_each(|(value, lit)| *value *= -mean / lit.max(least));
            }
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

    /// The code that a pixel of this contrast read.
    pub(crate) fn code(&self, signal: f32) -> f64 {
        match self.polarity {
            Polarity::Bright => self.ground + f64::from(signal),
            Polarity::Dark => self.ground - f64::from(signal),
        }
    }
}
