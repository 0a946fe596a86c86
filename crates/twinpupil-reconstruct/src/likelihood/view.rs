//! One band of a frame, ready to be compared with dots.

use twinpupil_instrument::{Page, PlaneView};

use crate::likelihood::black::Black;
use crate::likelihood::departure::Departures;
use crate::likelihood::pencil::{Pencil, length};
use crate::likelihood::spot::{Dot, Raster, Spot, SpotJacobian};

/// One band of a frame and how it images.
pub(crate) struct BandView<'a> {
    pub(crate) plane: PlaneView<'a>,
    pub(crate) black: &'a Black,
    pub(crate) raster: Raster,
    /// What its page is, unless it is that raster.
    pub(crate) page: Option<&'a Page>,
    pub(crate) pencil: &'a Pencil,
    /// What the lens adds to images, unless it is ideal.
    pub(crate) departures: Option<&'a Departures>,
}

/// Ground about a spot that is fitted along with it: this share of its radius, and at least so many pixels of the plane.
const MARGIN_SHARE: f64 = 0.1;
const MARGIN_SAMPLES: f64 = 2.0;

impl BandView<'_> {
    /// A dot's image in this band, and its changes with the dot.
    pub(crate) fn spot(&self, dot: &Dot) -> (Spot, SpotJacobian) {
        let departure = self.departures.map(|departures| departures.of_dot(dot));
        let (mut spot, mut jacobian) = Spot::with_jacobian(dot, self.pencil, self.raster, departure);
        if let Some(page) = self.page {
            spot.lay_on(page, self.pencil, &mut jacobian);
        }
        (spot, jacobian)
    }

    /// Length of the longer side of its page, px.
    pub(crate) fn size_px(&self) -> f64 {
        (self.plane.columns.max(self.plane.rows) * self.plane.step_px) as f64
    }

    /// Whether an image is no wider than the page, and on it or beside it.
    pub(crate) fn is_near(&self, spot: &Spot) -> bool {
        let (size_px, PlaneView { origin_px, columns, rows, step_px, .. }) = (self.size_px(), self.plane);
        let middle_px = |axis: usize, count: usize| (origin_px[axis] + count * step_px / 2) as f64;
        let off_px = [spot.centre_px[0] - middle_px(0, columns), spot.centre_px[1] - middle_px(1, rows)];
        spot.reach_px() <= 0.5 * size_px && length(off_px) <= size_px
    }

    /// Radius of the window about an image, px.
    pub(crate) fn window_px(&self, spot: &Spot) -> f64 {
        let step_px = self.plane.step_px as f64;
        spot.reach_px() + (MARGIN_SHARE * spot.radius_px).max(MARGIN_SAMPLES * step_px)
    }
}
