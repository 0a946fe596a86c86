//! What the masks leave of an evenly bright ground: a dark spot near the axis, known from the optics.

use twinpupil_instrument::{ImagePoint, PixelPoint, PlaneView, ResponseTable};

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
        let centre_mm = table.bands[band].ground_centre_mm;
        let [low, high] = bounds(register, centre_mm, clear_mm);
        let mut shares = vec![1.0; plane.columns * plane.rows];
        for (row, line) in shares.chunks_exact_mut(plane.columns).enumerate() {
            let v = plane.frame_v_px(row as f64);
            if !(low.v..=high.v).contains(&v) {
                continue;
            }
            for (column, share) in line.iter_mut().enumerate() {
                let u = plane.frame_u_px(column as f64);
                if !(low.u..=high.u).contains(&u) {
                    continue;
                }
                let ImagePoint { x_mm, y_mm } = register.page().to_image(PixelPoint { u, v });
                let radius_mm = (x_mm - centre_mm[0]).hypot(y_mm - centre_mm[1]);
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

/// Corners of a rectangle of a page that holds all of a disc of image points.
fn bounds(register: &Register, centre_mm: [f64; 2], radius_mm: f64) -> [PixelPoint; 2] {
    const STEPS: usize = 64;
    // Between so many points a circle bulges by a thousandth of its radius.
    const MARGIN: f64 = 1.01;
    let places = (0..STEPS).map(|step| {
        let (sin, cos) = (std::f64::consts::TAU * step as f64 / STEPS as f64).sin_cos();
        let along = |centre: f64, share: f64| centre + MARGIN * radius_mm * share;
        register.page().to_page(ImagePoint { x_mm: along(centre_mm[0], cos), y_mm: along(centre_mm[1], sin) })
    });
    let nowhere = [f64::INFINITY, f64::NEG_INFINITY].map(|end| PixelPoint { u: end, v: end });
    places.fold(nowhere, |[low, high], place| {
        [
            PixelPoint { u: low.u.min(place.u), v: low.v.min(place.v) },
            PixelPoint { u: high.u.max(place.u), v: high.v.max(place.v) },
        ]
    })
}
