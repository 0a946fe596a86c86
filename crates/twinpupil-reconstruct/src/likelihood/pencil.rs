//! The light that one pixel receives in one band: a pencil of rays through the masks, to first order.
//!
//! A ray is named by the pixel p that it reaches, in mm and upright, and by the point w of the unit disc in which it
//! crosses the band's pupil. Everywhere else it stands at a linear function of both:
//!
//! ```text
//! on the lens         a = (R w + c − β p) / α          α = 1 − t/L,  β = −t/L
//! at another stop     h = α′ a + β′ p                  (in front of the lens α = 1 − t (1/L − 1/f))
//! at distance z       X = (1 + z/L − z/f) a + (z/L) p
//! ```
//!
//! with the pupil of radius R and centre c at t behind a lens of focal length f, and the sensor at L.

use smallvec::SmallVec;
use twinpupil_instrument::{Band, Instrument, Projection};

/// A vector in a plane across the axis.
pub(crate) type Vector2 = [f64; 2];

/// Length of a vector, far from the ends of what numbers can hold.
pub(crate) fn length([x, y]: Vector2) -> f64 {
    (x * x + y * y).sqrt()
}

/// One band's pupil and the other masks in its way.
#[derive(Debug, Clone)]
pub(crate) struct Pencil {
    /// Through the pupil, with the band's own focal length.
    pub(crate) projection: Projection,
    /// Every way through the masks: light passes if it passes all rings of one way.
    ways: Vec<Vec<Ring>>,
}

/// Ways through the masks, each with the edges that cut it; real masks leave one way with few edges.
pub(crate) type Ways = SmallVec<[SmallVec<[Edge; 4]>; 1]>;

/// The circle of a mask's zone in the coordinates of the pupil, about `start + per_image p`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ring {
    start: Vector2,
    per_image: f64,
    inner: f64,
    outer: f64,
}

/// A circle in the unit disc of the pupil that lets light pass inside or outside itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Edge {
    /// Centre for the image point p: `start + per_image p`, p in mm.
    pub(crate) start: Vector2,
    pub(crate) per_image: f64,
    pub(crate) radius: f64,
    pub(crate) passes_inside: bool,
}

impl Pencil {
    /// The pencils of a band; `focal_length_mm` is that of the lens at its wavelength.
    pub(crate) fn of_band(instrument: &Instrument, band: &Band, focal_length_mm: f64) -> Self {
        let projection = Projection { focal_length_mm, ..instrument.projection(band) };
        let pupil = instrument.pupil_index(band);
        let mut ways: Vec<Vec<Ring>> = vec![Vec::new()];
        for (index, aperture) in instrument.ideal_apertures(band).iter().enumerate() {
            let view = StopView::new(&projection, aperture.position_mm, aperture.centre_mm);
            let rings = aperture.annuli(&band.name).into_iter().map(|annulus| {
                // The pupil's own rim is the unit disc, and no mask of its own.
                let rim = index == pupil && annulus.outer_mm == projection.pupil_radius_mm;
                let outer = if rim { f64::INFINITY } else { annulus.outer_mm * view.scale };
                Ring { start: view.start, per_image: view.per_image, inner: annulus.inner_mm * view.scale, outer }
            });
            let rings: Vec<Ring> = rings.collect();
            ways = ways.iter().flat_map(|way| rings.iter().map(|ring| [way.as_slice(), &[*ring]].concat())).collect();
        }
        Self { projection, ways }
    }

    /// The ways through the masks of the light that reaches the disc of image points about `centre_mm`, each with the
    /// edges that cut it; one way without any edge if all of the light passes.
    pub(crate) fn ways_at(&self, centre_mm: Vector2, radius_mm: f64) -> Ways {
        self.ways.iter().filter_map(|rings| edges(rings, centre_mm, radius_mm)).collect()
    }

    /// Width in the object plane at distance z of the unit of the pupil, mm; signed, zero in focus.
    fn object_scale_mm(&self, z_mm: f64) -> f64 {
        let Projection { focal_length_mm: f, sensor_distance_mm: l, pupil_radius_mm, pupil_position_mm: t, .. } =
            self.projection;
        (1.0 + z_mm / l - z_mm / f) * pupil_radius_mm / lens_share(t, l, f)
    }

    /// Radius of the image of a point at distance z, which the band images with `magnification`, mm; negative if the
    /// image is turned against the pupil.
    pub(crate) fn signed_blur_mm(&self, z_mm: f64, magnification: f64) -> f64 {
        self.object_scale_mm(z_mm) * magnification
    }
}

/// Height at a stop of the ray from the axis on the sensor, over its height at the lens.
fn lens_share(position_mm: f64, l: f64, f: f64) -> f64 {
    if position_mm >= 0.0 { 1.0 - position_mm / l } else { 1.0 - position_mm * (1.0 / l - 1.0 / f) }
}

/// A stop as it is seen in the unit disc of the pupil.
struct StopView {
    start: Vector2,
    per_image: f64,
    /// Units of the pupil per mm at the stop.
    scale: f64,
}

impl StopView {
    /// `h = (α′/α)(R w + c − β p) + β′ p`, solved for the w of the stop's centre.
    fn new(projection: &Projection, position_mm: f64, centre_mm: Vector2) -> Self {
        let Projection { focal_length_mm: f, sensor_distance_mm: l, pupil_position_mm, pupil_radius_mm, .. } =
            *projection;
        let share = lens_share(position_mm, l, f) / lens_share(pupil_position_mm, l, f);
        let unit_mm = share * pupil_radius_mm;
        let (beta, pupil_beta) = (-position_mm / l, -pupil_position_mm / l);
        let start = |axis: usize| (centre_mm[axis] - share * projection.pupil_centre_mm[axis]) / unit_mm;
        Self {
            start: [start(0), start(1)],
            per_image: (share * pupil_beta - beta) / unit_mm,
            scale: 1.0 / unit_mm.abs(),
        }
    }
}

/// The edges of rings that cut the unit disc somewhere in the disc of image points; `None` if a ring blocks all of it.
fn edges(rings: &[Ring], centre_mm: Vector2, radius_mm: f64) -> Option<SmallVec<[Edge; 4]>> {
    let mut edges = SmallVec::new();
    for ring in rings {
        let Ring { start, per_image, .. } = *ring;
        let [x, y] = [0, 1].map(|axis| start[axis] + per_image * centre_mm[axis]);
        let offset = (x * x + y * y).sqrt();
        let sweep = (per_image * radius_mm).abs();
        let (nearest, farthest) = ((offset - sweep).max(0.0), offset + sweep);
        if nearest - 1.0 >= ring.outer || farthest + 1.0 <= ring.inner {
            return None;
        }
        if farthest + 1.0 > ring.outer {
            edges.push(Edge { start, per_image, radius: ring.outer, passes_inside: true });
        }
        if ring.inner > 0.0 && nearest - 1.0 < ring.inner {
            edges.push(Edge { start, per_image, radius: ring.inner, passes_inside: false });
        }
    }
    Some(edges)
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{Instrument, paper};

    use super::*;

    fn pencils() -> [Pencil; 2] {
        let instrument: Instrument = paper::instrument();
        [0, 1].map(|band| Pencil::of_band(&instrument, &instrument.bands[band], 100.0))
    }

    #[test]
    fn the_blur_is_the_projections() {
        for pencil in pencils() {
            for z_mm in [250.0, 296.0, 350.0] {
                let blur_mm = pencil.signed_blur_mm(z_mm, pencil.projection.magnification(z_mm)).abs();
                let difference_mm = blur_mm - pencil.projection.blur_radius_mm(z_mm);
                assert!(difference_mm.abs() < 1e-12, "{z_mm}: {difference_mm}");
            }
        }
    }

    #[test]
    fn the_papers_masks_cut_each_other_near_the_axis_only() {
        // Red: the pupil, 0.5 in the focal plane, is as wide as 0.5 L/(L − f) = 1.48 on the lens seen from the sensor;
        // it passes the centre of the lens at p f/(L − f) and the blue disc of 1 there cuts it within 2.48.
        let [red, blue] = pencils();
        let reach_mm = (0.5 * 151.0 / 51.0 + 1.0) * 51.0 / 100.0;
        for pencil in [&red, &blue] {
            let clear = pencil.ways_at([0.0, reach_mm + 1e-9], 0.0);
            assert!(clear.len() == 1 && clear[0].is_empty(), "{clear:?}");
            let cut = pencil.ways_at([0.0, reach_mm - 1e-9], 0.0);
            assert!(cut.len() == 1 && cut[0].len() == 1 && !cut[0][0].passes_inside, "{cut:?}");
        }
    }
}
