//! What a lens is to first order, at one wavelength.

use super::Train;
use super::face::{Action, Face};
use twinpupil_instrument::{ParaxialRay, ParaxialSurface, paraxial_rays};

/// Focal length, principal planes and pupils of a lens at one wavelength, light coming from the object. Places count along
/// the axis, positive towards the image: those in front from the first surface, those behind from the last.
#[derive(Debug, Clone, PartialEq)]
pub struct FirstOrder {
    /// Focal length, mm.
    pub focal_length_mm: f64,
    /// Front focal point from the first surface, mm.
    pub front_focus_mm: f64,
    /// Rear focal point from the last surface, mm.
    pub rear_focus_mm: f64,
    /// Front principal plane from the first surface, mm.
    pub front_principal_mm: f64,
    /// Rear principal plane from the last surface, mm.
    pub rear_principal_mm: f64,
    /// The stop as seen from the object, if there is one.
    pub entrance_pupil: Option<Pupil>,
    /// The stop as seen from the image, if there is one.
    pub exit_pupil: Option<Pupil>,
}

/// An image of the stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pupil {
    /// Where it is: the entrance pupil from the first surface, the exit pupil from the last, mm. Infinite in a
    /// telecentric space.
    pub position_mm: f64,
    /// Its size relative to the stop.
    pub magnification: f64,
}

impl FirstOrder {
    /// The marginal ray in front of the first surface, for an entrance pupil of that diameter and an object at infinity
    /// or at a distance in front of the first surface.
    pub fn marginal_ray(&self, pupil_diameter_mm: f64, object_distance_mm: Option<f64>) -> ParaxialRay {
        let radius_mm = 0.5 * pupil_diameter_mm;
        let Some(distance_mm) = object_distance_mm else { return ParaxialRay { height_mm: radius_mm, slope: 0.0 } };
        let pupil_mm = self.entrance_pupil.map_or(0.0, |pupil| pupil.position_mm);
        let slope = radius_mm / (distance_mm + pupil_mm);
        ParaxialRay { height_mm: slope * distance_mm, slope }
    }

    /// The chief ray of that slope in front of the first surface: through the middle of the entrance pupil, or through the
    /// vertex of a lens without a stop.
    pub fn chief_ray(&self, slope: f64) -> ParaxialRay {
        let pupil_mm = self.entrance_pupil.map_or(0.0, |pupil| pupil.position_mm);
        ParaxialRay { height_mm: -slope * pupil_mm, slope }
    }
}

impl Train {
    /// What the lens is to first order. `stop` is the surface of the prescription that is the stop.
    pub fn first_order(&self, stop: Option<usize>) -> FirstOrder {
        let surfaces = self.paraxial_surfaces();
        let index_before = self.lens_faces().next().map_or(1.0, |face| face.index_before);
        let parallel = ParaxialRay { height_mm: 1.0, slope: 0.0 };
        let back = paraxial_rays(&surfaces, index_before, parallel).last().copied().unwrap_or(parallel);
        let front = in_front(&surfaces, index_before, parallel);
        let index_behind = surfaces.last().map_or(1.0, |last| last.index_behind);
        let at = stop.and_then(|stop| self.lens_faces().position(|face| face.index == stop));
        FirstOrder {
            focal_length_mm: -1.0 / (index_behind * back.slope),
            front_focus_mm: -front.height_mm / front.slope,
            rear_focus_mm: -back.height_mm / back.slope,
            front_principal_mm: (1.0 - front.height_mm) / front.slope,
            rear_principal_mm: (1.0 - back.height_mm) / back.slope,
            entrance_pupil: at.map(|at| {
                // The power of the stop's own surface does not move its image.
                let before = |ray| in_front(&surfaces[..at], index_before, at_previous(&surfaces[..at], ray));
                pupil(before(AXIAL), before(parallel))
            }),
            exit_pupil: at.map(|at| {
                let (gap_mm, index) = (surfaces[at].gap_behind_mm, surfaces[at].index_behind);
                let behind = |ray: ParaxialRay| match surfaces.get(at + 1..) {
                    Some(rest) if !rest.is_empty() => {
                        let next = ParaxialRay { height_mm: ray.height_mm + ray.slope * gap_mm, ..ray };
                        paraxial_rays(rest, index, next).last().copied().unwrap_or(next)
                    }
                    _ => ray,
                };
                pupil(behind(AXIAL), behind(parallel))
            }),
        }
    }

    /// The surfaces of the lens as paraxial rays meet them, without masks and image.
    pub fn paraxial_surfaces(&self) -> Vec<ParaxialSurface> {
        let faces: Vec<&Face> = self.lens_faces().collect();
        let mut sense = 1.0;
        let surfaces = faces.iter().enumerate().map(|(k, face)| {
            let index_before = sense * face.index_before;
            if face.action == Action::Reflect {
                sense = -sense;
            }
            let index_behind = sense * face.index_behind;
            let power_per_mm = match face.action {
                Action::ThinLens { power_per_mm } => power_per_mm * face.index_behind,
                _ => face.vertex_curvature_per_mm() * (index_behind - index_before),
            };
            let next = faces.get(k + 1).map_or(face.axis, |next| next.axis);
            ParaxialSurface { power_per_mm, index_behind, gap_behind_mm: face.axis.from(&next).origin[2] }
        });
        surfaces.collect()
    }
}

/// From the middle of the stop.
const AXIAL: ParaxialRay = ParaxialRay { height_mm: 0.0, slope: 1.0 };

/// The image of a stop of radius 1, from rays outside the lens: one from the middle of the stop, one that passes its rim
/// along the axis.
fn pupil(axial: ParaxialRay, beside: ParaxialRay) -> Pupil {
    let position_mm = -axial.height_mm / axial.slope;
    Pupil { position_mm, magnification: beside.height_mm + beside.slope * position_mm }
}

/// The ray at the last of `surfaces` that is `ray` where it meets what follows.
fn at_previous(surfaces: &[ParaxialSurface], ray: ParaxialRay) -> ParaxialRay {
    let gap_mm = surfaces.last().map_or(0.0, |last| last.gap_behind_mm);
    ParaxialRay { height_mm: ray.height_mm - ray.slope * gap_mm, ..ray }
}

/// The ray in front of the first surface that is `ray` behind the last.
fn in_front(surfaces: &[ParaxialSurface], index_before: f64, ray: ParaxialRay) -> ParaxialRay {
    (0..surfaces.len()).rev().fold(ray, |ray, k| {
        let (before, surface) = (&surfaces[..k], surfaces[k]);
        let index = before.last().map_or(index_before, |previous| previous.index_behind);
        let slope = (surface.index_behind * ray.slope + ray.height_mm * surface.power_per_mm) / index;
        at_previous(before, ParaxialRay { slope, ..ray })
    })
}
