//! A lens with the pupil through which it images.

use super::reference::Reference;
use crate::train::{DIFFERENCE, aimed};
use crate::{Fate, Field, Ray, Rays, Train};

/// A lens at one wavelength, and the pupil through which it images. Places in the pupil are in its radii from its middle.
#[derive(Debug, Clone)]
pub struct Imager {
    pub(super) wavelength_mm: f64,
    /// With whatever clips the light.
    pub(super) train: Train,
    /// The same, clear everywhere.
    pub(super) clear: Train,
    /// The surfaces as far as the pupil.
    pub(super) to_pupil: Train,
    /// From the pupil to the image.
    from_pupil: Train,
    pub(super) centre_mm: [f64; 2],
    pub(super) radius_mm: f64,
}

/// What an [`Imager`] makes of one point of the field.
#[derive(Debug, Clone)]
pub struct Sight<'a> {
    pub(super) imager: &'a Imager,
    pub(super) field: Field,
    pub(super) reference: Reference,
}

impl Imager {
    /// Through the stop of a lens: a surface of the prescription, or the plane of the first vertex if it has none.
    pub fn through_stop(train: Train, wavelength_nm: f64, stop: Option<usize>, radius_mm: f64) -> Self {
        let to_pupil = stop.map(|stop| train.clear_to(stop)).filter(|to_stop| !to_stop.is_empty());
        let count = to_pupil.as_ref().map_or(0, Train::len);
        let to_pupil = to_pupil.unwrap_or_else(|| train.plane_in_front());
        let from_pupil = if count > 0 { train.clear().behind(count) } else { train.clear() };
        let clear = train.clear();
        Self { wavelength_mm: 1e-6 * wavelength_nm, train, clear, to_pupil, from_pupil, centre_mm: [0.0; 2], radius_mm }
    }

    /// Through a disc in the plane of a mask.
    pub(super) fn through_mask(
        train: Train,
        wavelength_nm: f64,
        number: usize,
        centre_mm: [f64; 2],
        radius_mm: f64,
    ) -> Self {
        let to_pupil = train.clear_to_mask(number);
        let from_pupil = train.clear().behind(to_pupil.len());
        let clear = train.clear();
        Self { wavelength_mm: 1e-6 * wavelength_nm, train, clear, to_pupil, from_pupil, centre_mm, radius_mm }
    }

    /// The lens with whatever clips the light.
    pub fn train(&self) -> &Train {
        &self.train
    }

    /// Rays before the lens from a point of the field through places of the pupil; `None` where no ray gets there. What clips
    /// the light is not asked.
    pub fn rays(&self, field: Field, places: &[[f64; 2]]) -> Vec<Option<Ray>> {
        let on_pupil = |place: &[f64; 2]| [0, 1].map(|k| self.centre_mm[k] + self.radius_mm * place[k]);
        let places_mm: Vec<[f64; 2]> = places.iter().map(on_pupil).collect();
        aimed(&self.to_pupil, field, &places_mm, self.radius_mm)
    }

    /// What it makes of a point of the field; `None` if no chief ray of it gets to the image.
    pub fn sight(&self, field: Field) -> Option<Sight<'_>> {
        let chief = self.through_all(&self.chief(field)?)?;
        let axial = self.at_pupil(&self.chief(field.on_axis())?)?;
        let [dx, dy, dz] = axial.direction;
        let beside = Ray::new(axial.position_mm, [dx, dy + BESIDE, dz]);
        let [axial, beside] = [axial, beside].map(|ray| image(&self.from_pupil, &ray));
        let reference = Reference::through_exit_pupil(chief, &axial?, &beside?, self.train.index_before_image());
        Some(Sight { imager: self, field, reference })
    }

    fn chief(&self, field: Field) -> Option<Ray> {
        self.rays(field, &[[0.0; 2]])[0]
    }

    fn at_pupil(&self, ray: &Ray) -> Option<Ray> {
        image(&self.to_pupil, ray)
    }

    pub(super) fn through_all(&self, ray: &Ray) -> Option<Ray> {
        image(&self.clear, ray)
    }
}

/// How much a ray from the middle of the pupil is turned to find the image of that: its error is of second order.
const BESIDE: f64 = 1e-5;

/// Where a ray ends behind some surfaces, if it gets there.
fn image(train: &Train, ray: &Ray) -> Option<Ray> {
    let mut rays: Rays = [*ray].into_iter().collect();
    train.trace(&mut rays);
    (rays.fate(0) == Fate::Arrived).then(|| rays.ray(0))
}

impl Sight<'_> {
    /// Where the chief ray meets the image, in its axes, mm.
    pub fn chief_mm(&self) -> [f64; 2] {
        let [x, y, _] = self.reference.chief.position_mm;
        [x, y]
    }

    /// Distance from the middle of the exit pupil to there, mm: negative if it lies behind, infinite for a telecentric lens.
    pub fn exit_pupil_distance_mm(&self) -> f64 {
        1.0 / self.reference.curvature_per_mm
    }

    /// Whether path lengths tell of its wavefront: through an ideal lens they are those of light along its axis.
    pub fn has_wavefront(&self) -> bool {
        !self.imager.train.has_ideal_lens() || self.field == Field::Infinite { slope: [0.0; 2] }
    }

    /// The wavelength, mm.
    pub fn wavelength_mm(&self) -> f64 {
        self.imager.wavelength_mm
    }

    /// Rays through places of the pupil, in the image; `None` where no ray gets there, or something clips it.
    pub fn image_rays(&self, places: &[[f64; 2]]) -> Vec<Option<Ray>> {
        self.traced(&self.imager.train, places)
    }

    /// The same whatever clips the light.
    pub(super) fn clear_rays(&self, places: &[[f64; 2]]) -> Vec<Option<Ray>> {
        self.traced(&self.imager.clear, places)
    }

    fn traced(&self, train: &Train, places: &[[f64; 2]]) -> Vec<Option<Ray>> {
        let starts = self.imager.rays(self.field, places);
        let mut rays: Rays = starts.iter().flatten().copied().collect();
        train.trace_parallel(&mut rays);
        let mut traced = rays.iter();
        let next = |start: &Option<Ray>| {
            let (ray, fate) = start.and_then(|_| traced.next())?;
            (fate == Fate::Arrived).then_some(ray)
        };
        starts.iter().map(next).collect()
    }

    /// Step of difference quotients between rays that are started close to each other, mm.
    pub(super) fn start_step_mm(&self) -> f64 {
        DIFFERENCE * self.imager.radius_mm
    }
}
