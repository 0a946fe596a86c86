//! How far the rays of a real lens are from those of the ideal one.

use twinpupil_instrument::ImagePoint;

use crate::Pencil;
use crate::linear::Linear;
use crate::spread::{quadrants, rim};

/// How much farther rays may stray from the ideal ones than those that were probed.
const STRAY_MARGIN: f64 = 2.0;

/// Share of its width by which a pencil may stray where no ray gets through to be probed.
const STRAY_UNPROBED: f64 = 0.25;

/// How far a ray is from the ideal one in the plane z = 0, and its slope.
pub(crate) struct Stray {
    pub(crate) position_mm: [f64; 2],
    pub(crate) slope: [f64; 2],
}

/// Image and pupil points from which a pencil is probed: the centre and the rim of its image disc, and all over the pupil.
pub(crate) fn probes(
    centre: ImagePoint,
    radius_mm: f64,
    per_quadrant: usize,
) -> impl Iterator<Item = ([f64; 2], [f64; 2])> {
    let image =
        rim(6).chain([[0.0, 0.0]]).map(move |[x, y]| [centre.x_mm + radius_mm * x, centre.y_mm + radius_mm * y]);
    image.flat_map(move |image_mm| quadrants(per_quadrant).map(move |pupil| (image_mm, pupil)))
}

impl Pencil {
    /// The pencil of a real lens about this ideal one, from some of its rays. What these stray from their mean tells how
    /// far others may; `slack` is how much farther still, in position (mm) and slope.
    pub(crate) fn strayed(self, strays: &[Stray], slack: [f64; 2]) -> Self {
        if strays.is_empty() {
            let width = |linear: &Linear| STRAY_UNPROBED * linear.over(self.centre, self.radius_mm).radius;
            return Self { stray_mm: width(&self.lens), stray_slope: width(&self.slope), ..self };
        }
        let (position, slope) = (strays.iter().map(|stray| stray.position_mm), strays.iter().map(|stray| stray.slope));
        let (centre_mm, stray_mm) = middle_and_reach(position);
        let (tilt, stray_slope) = middle_and_reach(slope);
        Self {
            lens: self.lens.moved(centre_mm),
            slope: self.slope.moved(tilt),
            stray_mm: STRAY_MARGIN * stray_mm + slack[0],
            stray_slope: STRAY_MARGIN * stray_slope + slack[1],
            ..self
        }
    }
}

/// Mean of places, and the distance of the farthest one from it.
fn middle_and_reach(places: impl ExactSizeIterator<Item = [f64; 2]> + Clone) -> ([f64; 2], f64) {
    let count = places.len() as f64;
    let middle = [0, 1].map(|k| places.clone().map(|place| place[k]).sum::<f64>() / count);
    (middle, places.map(|place| (place[0] - middle[0]).hypot(place[1] - middle[1])).fold(0.0, f64::max))
}
