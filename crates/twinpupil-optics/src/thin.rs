//! The thin lens, where a ray is a handful of linear functions.
//!
//! A backward ray from the physical sensor point `s` through the lens point `a` stands at
//!
//! ```text
//! behind the lens    h(t) = a (1 − t/L) + s t/L
//! in front           x(z) = a + ν z,    ν = a (1/L − 1/f) − s/L
//! ```
//!
//! so at every aperture `h = α a + β s`. A pupil point m fixes `a = (m − β s)/α`, which makes positions at all other
//! apertures and in object space linear in m and s.
//!
//! A thin lens maps tangents, not angles, linearly; its radiometry is paraxial in the same sense and carries no cos⁴θ.
//! With the factor on one side of it only, a uniform object would not give a uniform image of itself.

use multiversion::multiversion;
use twinpupil_instrument::{Annulus, ImagePoint};

use crate::linear::{Disc, Linear};
use crate::masks::Masks;
use crate::stop::{Stop, holds};
use crate::{ObjectRays, Pencil, RayLedger, RayStarts};

/// Rays traced stop by stop before the next ones are started: their positions stay in the first-level cache.
const BLOCK: usize = 256;

/// One band of a camera with a thin lens.
#[derive(Debug, Clone)]
pub(crate) struct ThinBand {
    /// Position in the plane of the lens, mm.
    lens: Linear,
    /// Slope in object space.
    slope: Linear,
    /// Apertures that can stop a ray, from the sensor outwards, with the ray's position from their centre.
    stops: Vec<(Stop, Linear)>,
    /// Weight of a ray that arrives.
    weight: f64,
}

impl ThinBand {
    /// Requires a pupil that is not conjugate to the sensor: its `sensor_pencil` is not zero.
    pub(crate) fn new(masks: &Masks) -> Self {
        let (l, f) = (masks.sensor_distance_mm, masks.focal_length_mm);
        let pupil = masks.pupil();
        let aim = Linear { per_pupil: masks.pupil_radius_mm, per_image: 0.0, constant: pupil.centre_mm };
        // a = (m − β s)/α with s = −p.
        let at_lens = aim.plus_image(pupil.position_mm / l).scaled(1.0 / masks.sensor_pencil(pupil.position_mm));
        let from_centre = |stop: &Stop| {
            let [x, y] = stop.centre_mm;
            let centre = Linear { per_pupil: 0.0, per_image: 0.0, constant: [-x, -y] };
            if std::ptr::eq(stop, pupil) {
                return aim.plus(centre);
            }
            at_lens.scaled(masks.sensor_pencil(stop.position_mm)).plus_image(-stop.position_mm / l).plus(centre)
        };
        let mut stops: Vec<_> = masks
            .stops
            .iter()
            .filter(|stop| !(stop.is_open() || pupil.is_full() && std::ptr::eq(*stop, pupil)))
            .map(|stop| (stop.clone(), from_centre(stop)))
            .collect();
        stops.sort_by(|(a, _), (b, _)| b.position_mm.total_cmp(&a.position_mm));
        Self {
            lens: at_lens,
            slope: at_lens.scaled(1.0 / l - 1.0 / f).plus_image(1.0 / l),
            stops,
            weight: 1.0 / pupil.filled_fraction(masks.pupil_radius_mm),
        }
    }

    pub(crate) fn trace(&self, starts: RayStarts<'_>, rays: &mut ObjectRays, ledger: &mut RayLedger) {
        let count = starts.len();
        rays.resize(count);
        for first in (0..count).step_by(BLOCK) {
            let block = first..count.min(first + BLOCK);
            let starts = starts.slice(block.clone());
            let (x, slope_x) = (&mut rays.x_mm[block.clone()], &mut rays.slope_x[block.clone()]);
            evaluate(self, 0, starts.pupil_x, starts.image_x_mm, x, slope_x);
            let (y, slope_y) = (&mut rays.y_mm[block.clone()], &mut rays.slope_y[block.clone()]);
            evaluate(self, 1, starts.pupil_y, starts.image_y_mm, y, slope_y);
            let weight = &mut rays.weight[block];
            weight.fill(self.weight);
            self.clip(starts, weight, ledger);
        }
    }

    /// Sets the weight of blocked rays to zero.
    fn clip(&self, starts: RayStarts<'_>, weight: &mut [f64], ledger: &mut RayLedger) {
        let mut alive = weight.len() as u64;
        ledger.launched += alive;
        for (stop, position) in &self.stops {
            let passed = match stop.rings.as_slice() {
                [ring] => pass_ring(ring, position, starts, weight),
                rings => pass_rings(rings, position, starts, weight),
            };
            *ledger.blocked_by(stop.aperture) += alive - passed;
            alive = passed;
        }
        ledger.arrived += alive;
    }

    /// Position at distance z in object space, mm.
    pub(crate) fn object_map(&self, z_mm: f64) -> Linear {
        self.lens.plus(self.slope.scaled(z_mm))
    }

    pub(crate) fn pencil(&self, centre: ImagePoint, radius_mm: f64) -> Pencil {
        Pencil { centre, radius_mm, lens: self.lens, slope: self.slope, stray_mm: 0.0, stray_slope: 0.0 }
    }

    pub(crate) fn is_unclipped(&self, centre: ImagePoint, radius_mm: f64) -> bool {
        self.weight == 1.0
            && self.stops.iter().all(|(stop, position)| {
                // `position` counts from the stop's centre already.
                let Disc { centre: [x, y], radius } = position.over(centre, radius_mm);
                stop.passes_disc(&Disc { centre: [x + stop.centre_mm[0], y + stop.centre_mm[1]], radius })
            })
    }
}

/// Position at the lens and slope beyond it, one component of all rays.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn evaluate(band: &ThinBand, k: usize, pupil: &[f64], image_mm: &[f64], lens_mm: &mut [f64], slope: &mut [f64]) {
    let outputs = lens_mm.iter_mut().zip(slope);
    for ((pupil, image_mm), (lens_mm, slope)) in pupil.iter().zip(image_mm).zip(outputs) {
        *lens_mm = band.lens.component(k, *pupil, *image_mm);
        *slope = band.slope.component(k, *pupil, *image_mm);
    }
}

/// Lets through what lies in `ring`, and counts it.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn pass_ring(ring: &Annulus, position: &Linear, starts: RayStarts<'_>, weight: &mut [f64]) -> u64 {
    let image = starts.image_x_mm.iter().zip(starts.image_y_mm);
    let pupil = starts.pupil_x.iter().zip(starts.pupil_y);
    let mut passed = 0;
    for ((weight, (pupil_x, pupil_y)), (image_x_mm, image_y_mm)) in weight.iter_mut().zip(pupil).zip(image) {
        let (x, y) = (position.component(0, *pupil_x, *image_x_mm), position.component(1, *pupil_y, *image_y_mm));
        *weight = if holds(ring, x * x + y * y) { *weight } else { 0.0 };
        passed += u64::from(*weight > 0.0);
    }
    passed
}

/// Lets through what lies in any of several rings, and counts it.
fn pass_rings(rings: &[Annulus], position: &Linear, starts: RayStarts<'_>, weight: &mut [f64]) -> u64 {
    let mut passed = 0;
    for (k, weight) in weight.iter_mut().enumerate() {
        let x = position.component(0, starts.pupil_x[k], starts.image_x_mm[k]);
        let y = position.component(1, starts.pupil_y[k], starts.image_y_mm[k]);
        if !rings.iter().any(|ring| holds(ring, x * x + y * y)) {
            *weight = 0.0;
        }
        passed += u64::from(*weight > 0.0);
    }
    passed
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{Instrument, paper};

    use crate::{Camera, ObjectRays, RayLedger, RayStarts};

    #[test]
    fn a_chief_ray_of_the_paper_is_projected_back() {
        let instrument: Instrument = paper::instrument();
        let camera = Camera::new(&instrument).unwrap();
        for (band, optics) in instrument.bands.iter().zip(camera.bands()) {
            let image = instrument.projection(band).image([7.5, -2.0, 320.0]);
            let starts =
                RayStarts { image_x_mm: &[image.x_mm], image_y_mm: &[image.y_mm], pupil_x: &[0.0], pupil_y: &[0.0] };
            let (mut rays, mut ledger) = (ObjectRays::default(), RayLedger::default());
            optics.trace(starts, &mut rays, &mut ledger);
            assert_eq!((ledger.launched, ledger.arrived, rays.weight[0]), (1, 1, 1.0));
            assert!((rays.x_mm[0] + 320.0 * rays.slope_x[0] - 7.5).abs() < 1e-12);
            assert!((rays.y_mm[0] + 320.0 * rays.slope_y[0] + 2.0).abs() < 1e-12);
        }
    }
}
