//! What the masks leave of an evenly bright ground: a dark spot about the axis, known from the optics.

use twinpupil_instrument::{PixelPoint, PlaneView, ResponseTable};

use crate::register::Register;
use crate::surface::Sample;

/// Share of the ground's light in every pixel of a plane, row by row.
#[derive(Debug, Clone)]
pub(crate) struct Shading {
    columns: usize,
    shares: Vec<f32>,
}

/// Pixels with less of the ground's light than this say nothing of it.
const SHARE_MIN: f32 = 0.5;

impl Shading {
    /// The shading of a band's plane, whose values stand in the table at the index that the band has in the instrument.
    pub(crate) fn of(table: &ResponseTable, band: usize, register: &Register, plane: &PlaneView<'_>) -> Self {
        let clear_mm = table.ground_clear_mm(band);
        let mut shares = vec![1.0; plane.columns * plane.rows];
        for (row, line) in shares.chunks_exact_mut(plane.columns).enumerate() {
            let v = plane.frame_v_px(row as f64);
            let at = |column: usize| register.page().to_image(PixelPoint { u: plane.frame_u_px(column as f64), v });
            // Rows of the reference frame run along x; those of another page may not.
            if register.is_identity() && at(0).y_mm.abs() > clear_mm {
                continue;
            }
            for (column, share) in line.iter_mut().enumerate() {
                let radius_mm = at(column).radius_mm();
                if radius_mm <= clear_mm {
                    *share = table.ground(band, radius_mm) as f32;
                }
            }
        }
        Self { columns: plane.columns, shares }
    }

    /// Whether it was made for a plane of this size.
    pub(crate) fn fits(&self, plane: &PlaneView<'_>) -> bool {
        self.columns == plane.columns && self.shares.len() == plane.columns * plane.rows
    }

    /// Takes from the light of a row of the ground what the masks take.
    pub(crate) fn shade(&self, row: usize, ground: &mut [f32]) {
        for (light, share) in ground.iter_mut().zip(&self.shares[row * self.columns..]) {
            *light *= share;
        }
    }

    /// Share of the ground's light in one pixel.
    fn at(&self, column: usize, row: usize) -> f32 {
        self.shares[row * self.columns + column]
    }

    /// Divides samples by their share of the light and leaves out those with too little.
    pub(crate) fn undo(&self, samples: &mut Vec<Sample>) {
        samples.retain_mut(|sample| {
            let share = self.at(sample.column as usize, sample.row as usize);
            sample.code /= share;
            share >= SHARE_MIN
        });
    }
}
