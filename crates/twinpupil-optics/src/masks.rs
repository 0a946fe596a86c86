//! One band's apertures about an ideal lens: what clips what, to first order.

use std::f64::consts::PI;

use twinpupil_instrument::{Annulus, ImagePoint, PointSpread};

use crate::point_image::PointImage;
use crate::region::{RingSet, moments};
use crate::stop::Stop;

/// Width of a pencil below which it is a point for all purposes; keeps divisions by it finite.
const NARROWEST_PENCIL: f64 = 1e-9;

/// Throughput short of 1 by more than this is clipping, less is rounding.
const CLIPPED: f64 = 1e-9;

/// A band's ideal lens with all its apertures.
#[derive(Debug, Clone)]
pub(crate) struct Masks {
    /// Focal length of the band, mm.
    pub(crate) focal_length_mm: f64,
    /// Rear principal plane to sensor, mm.
    pub(crate) sensor_distance_mm: f64,
    /// In the order of the instrument's apertures.
    pub(crate) stops: Vec<Stop>,
    /// Index of the pupil among them.
    pub(crate) pupil: usize,
    pub(crate) pupil_radius_mm: f64,
}

impl Masks {
    pub(crate) fn pupil(&self) -> &Stop {
        &self.stops[self.pupil]
    }

    /// Whether the pupil lets a point of its unit disc pass.
    pub(crate) fn is_open(&self, point: [f64; 2]) -> bool {
        let pupil = self.pupil();
        pupil.check([0, 1].map(|k| pupil.centre_mm[k] + self.pupil_radius_mm * point[k])).is_ok()
    }

    /// Width at an aperture of the pencil that leaves a sensor point, relative to its width at the lens.
    pub(crate) fn sensor_pencil(&self, position_mm: f64) -> f64 {
        let (l, f) = (self.sensor_distance_mm, self.focal_length_mm);
        if position_mm >= 0.0 { 1.0 - position_mm / l } else { 1.0 - position_mm * (1.0 / l - 1.0 / f) }
    }

    /// Width at an aperture of the pencil that leaves an object point, relative to its width at the lens; not zero.
    fn object_pencil(&self, position_mm: f64, z_mm: f64) -> f64 {
        let f = self.focal_length_mm;
        let width =
            if position_mm >= 0.0 { 1.0 - position_mm * (1.0 / f - 1.0 / z_mm) } else { 1.0 + position_mm / z_mm };
        if width.abs() < NARROWEST_PENCIL { NARROWEST_PENCIL.copysign(width) } else { width }
    }

    /// A stop as an object point sees it, projected onto the lens.
    ///
    /// The ray from X through the lens point a stands at `h = κ a − X t/z` in the plane of a stop, so a circle of
    /// radius R about c there is one of radius `R/|κ|` about `(c + X t/z)/κ` on the lens.
    fn on_lens(&self, stop: &Stop, [x_mm, y_mm, z_mm]: [f64; 3]) -> RingSet {
        let (t, width) = (stop.position_mm, self.object_pencil(stop.position_mm, z_mm));
        let [centre_x, centre_y] = stop.centre_mm;
        let scaled =
            |ring: &Annulus| Annulus { inner_mm: ring.inner_mm / width.abs(), outer_mm: ring.outer_mm / width.abs() };
        RingSet {
            centre: [(centre_x + x_mm * t / z_mm) / width, (centre_y + y_mm * t / z_mm) / width],
            rings: stop.rings.iter().map(scaled).collect(),
        }
    }

    /// Image point whose rays through the middle of the pupil meet the middle of another mask that is shut there.
    ///
    /// From the physical sensor point s through the lens point a a ray stands at `h = α a + t/L s`; through the middle c
    /// of the pupil `a = (c − d/L s)/α_d`, so with s = −p it meets the middle of another mask for
    ///
    /// ```text
    /// p = (α_t c_d − α_d c_t)/(α_d t/L − α_t d/L)
    /// ```
    pub(crate) fn shade_centre_mm(&self) -> [f64; 2] {
        let pupil = self.pupil();
        let is_shut = |stop: &&Stop| stop.rings.iter().all(|ring| ring.inner_mm > 0.0);
        let Some(mask) = self.stops.iter().filter(|stop| !std::ptr::eq(*stop, pupil)).find(is_shut) else {
            return [0.0; 2];
        };
        let [(alpha_d, beta_d), (alpha_t, beta_t)] = [pupil, mask]
            .map(|stop| (self.sensor_pencil(stop.position_mm), stop.position_mm / self.sensor_distance_mm));
        let per_image = alpha_d * beta_t - alpha_t * beta_d;
        let centre = |axis: usize| (alpha_t * pupil.centre_mm[axis] - alpha_d * mask.centre_mm[axis]) / per_image;
        if per_image == 0.0 { [0.0; 2] } else { [centre(0), centre(1)] }
    }

    /// Light of an object point that passes all apertures, and where it lands, exactly.
    pub(crate) fn point_image(&self, object_mm: [f64; 3]) -> PointImage {
        let [x_mm, y_mm, z_mm] = object_mm;
        let pupil = self.on_lens(self.pupil(), object_mm);
        // Counted from the pupil's centre, an unclipped pupil has its centroid at zero without rounding.
        let sets: Vec<RingSet> = self
            .stops
            .iter()
            .filter(|stop| !stop.is_open())
            .map(|stop| self.on_lens(stop, object_mm).shifted([-pupil.centre[0], -pupil.centre[1]]))
            .collect();
        let radius_mm = self.pupil_radius_mm / self.object_pencil(self.pupil().position_mm, z_mm).abs();
        let unclipped_mm2 = PI * radius_mm * radius_mm * self.pupil().filled_fraction(self.pupil_radius_mm);
        let light = moments(&sets);
        let throughput = (light.area / unclipped_mm2).clamp(0.0, 1.0);
        let [lens_x_mm, lens_y_mm] = match light.centroid() {
            Some([x, y]) if throughput > 0.0 => [pupil.centre[0] + x, pupil.centre[1] + y],
            _ => pupil.centre,
        };
        let (l, f) = (self.sensor_distance_mm, self.focal_length_mm);
        let spread = 1.0 - l * (1.0 / f - 1.0 / z_mm);
        let centroid =
            ImagePoint { x_mm: x_mm * l / z_mm - lens_x_mm * spread, y_mm: y_mm * l / z_mm - lens_y_mm * spread };
        PointImage { throughput, centroid, aberration_mm: [0.0; 2], spread: PointSpread::default() }
    }

    /// Radius about the axis inside which the other masks clip the pupil; zero where they do not.
    pub(crate) fn clip_radius_mm(&self, z_mm: f64) -> f64 {
        self.first_radius_mm(z_mm, |throughput| throughput >= 1.0 - CLIPPED)
    }

    /// Radius about the axis inside which no light passes; zero where some does.
    pub(crate) fn blind_radius_mm(&self, z_mm: f64) -> f64 {
        self.first_radius_mm(z_mm, |throughput| throughput > CLIPPED)
    }

    /// Smallest radius along +x beyond which the throughput is as wanted, infinite if it never is.
    fn first_radius_mm(&self, z_mm: f64, wanted: impl Fn(f64) -> bool) -> f64 {
        let mut edges_mm = vec![0.0];
        edges_mm.extend(self.touching_radii_mm(z_mm));
        let middles_mm = edges_mm.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]));
        let beyond_mm = edges_mm[edges_mm.len() - 1] + 1.0;
        let probes_mm = middles_mm.chain([beyond_mm]);
        let found =
            edges_mm.iter().zip(probes_mm).find(|(_, r_mm)| wanted(self.point_image([*r_mm, 0.0, z_mm]).throughput));
        found.map_or(f64::INFINITY, |(edge_mm, _)| *edge_mm)
    }

    /// Radii along +x, rising, at which an edge of one aperture touches an edge of another as seen from the object:
    /// only there can clipping begin or end.
    fn touching_radii_mm(&self, z_mm: f64) -> Vec<f64> {
        // Centres move linearly with the object's radius: two views give their start and their speed.
        let [from, to] = [0.0, 1.0].map(|x_mm| {
            let view = |stop| self.on_lens(stop, [x_mm, 0.0, z_mm]);
            self.stops.iter().map(view).collect::<Vec<_>>()
        });
        let mut radii_mm = Vec::new();
        for (i, a) in from.iter().enumerate() {
            for (j, b) in from.iter().enumerate().skip(i + 1) {
                let apart = [b.centre[0] - a.centre[0], b.centre[1] - a.centre[1]];
                let speed = (to[j].centre[0] - to[i].centre[0]) - apart[0];
                for (ra, rb) in a.circles().flat_map(|(ra, _)| b.circles().map(move |(rb, _)| (ra, rb))) {
                    for touch in [ra + rb, ra - rb] {
                        let along = (touch * touch - apart[1] * apart[1]).sqrt();
                        radii_mm.extend([(along - apart[0]) / speed, (-along - apart[0]) / speed]);
                    }
                }
            }
        }
        // NaN (never touching) and infinity (moving together) fall away here.
        radii_mm.retain(|r_mm| *r_mm > 0.0 && r_mm.is_finite());
        radii_mm.sort_by(f64::total_cmp);
        radii_mm
    }
}
