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
    /// Contrast of every pixel, codes.
    pub(crate) signal: Vec<f32>,
    ground_row: Vec<f32>,
    lit_row: Vec<f32>,
}

impl Contrast {
    /// Computes the contrast of every pixel of a plane against its ground. `black` is the code of a pixel without light,
    /// `shading` what the masks leave of an even ground.
    pub(crate) fn fill(&mut self, plane: &PlaneView<'_>, ground: &Ground, black: f64, shading: Option<&Shading>) {
        let Self { columns, signal, ground_row, lit_row } = self;
        *columns = plane.columns;
        signal.resize(plane.columns * plane.rows, 0.0);
        let Some(surface) = &ground.surface else {
            let light = Light::Codes { plane: *plane, level: ground.level as f32, polarity: ground.polarity };
            for (row, line) in signal.chunks_exact_mut(plane.columns).enumerate() {
                light.read(row, 0, line);
            }
            return;
        };
        let black = black as f32;
        ground_row.resize(plane.columns, 0.0);
        lit_row.resize(plane.columns, 0.0);
        for (row, line) in signal.chunks_exact_mut(plane.columns).enumerate() {
            surface.fill_row(row, ground_row);
            lit_row.copy_from_slice(ground_row);
            if let Some(shading) = shading {
                shading.shade(row, lit_row);
            }
            plane.read_row(row, line);
            line.iter_mut().zip(&*lit_row).for_each(|(value, lit)| *value -= black + lit);
            if ground.polarity == Polarity::Dark {
                // A dark feature takes away a share of the light, so uneven light is divided out; what the masks take
                // from the ground they take from the feature too, so that stays.
                let mean = surface.mean as f32;
                let least = (0.05 * mean).max(1.0);
                line.iter_mut().zip(&*ground_row).for_each(|(value, lit)| *value *= -mean / lit.max(least));
            }
        }
    }
}
