//! The sphere that a wavefront is compared with.

use crate::Ray;
use crate::refraction::{Vector, dot};

/// A sphere about the image of the chief ray. All formulas hold for a plane, whose curvature is 0: an exit pupil at infinity.
///
/// With e from its centre to where a ray meets the image, d the ray's direction and κ the curvature, positive if light runs
/// from the sphere to its centre:
///
/// ```text
/// q = e² − (e·d)²,    s = 1/κ + e·d − κ q/(1 + √(1 − κ² q))      back along the ray to the sphere
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reference {
    /// Where it meets the image.
    pub(crate) chief: Ray,
    /// κ, 1/mm.
    pub(crate) curvature_per_mm: f64,
    /// Refractive index before the image.
    pub(crate) index: f64,
}

impl Reference {
    /// About the image of a chief ray, through the point of the exit pupil in which two rays from the middle of the pupil
    /// cross that run close to each other.
    pub(crate) fn through_exit_pupil(chief: Ray, axial: &Ray, beside: &Ray, index: f64) -> Self {
        let toward = axial.direction;
        let turn = minus(beside.direction, toward);
        let apart = minus(beside.position_mm, axial.position_mm);
        let across = minus(apart, toward.map(|c| c * dot(apart, toward)));
        // 1/R along the axial ray; 0 if the two are parallel.
        let axial_per_mm = dot(turn, across) / dot(across, across);
        let aside = minus(chief.position_mm, axial.position_mm);
        let from_pupil = [0, 1, 2].map(|k| toward[k] + axial_per_mm * aside[k]);
        let curvature_per_mm = axial_per_mm / dot(from_pupil, from_pupil).sqrt();
        Self { chief, curvature_per_mm: if curvature_per_mm.is_finite() { curvature_per_mm } else { 0.0 }, index }
    }

    /// How much shorter the way of a ray to the sphere is than that of the chief ray, mm: positive where the wavefront is
    /// ahead of the sphere.
    pub(crate) fn lead_mm(&self, ray: &Ray) -> f64 {
        self.chief.path_mm - ray.path_mm + self.index * self.back_mm(ray)
    }

    /// The direction from where a ray passes the sphere to its centre, times the refractive index: x and y.
    pub(crate) fn aperture(&self, ray: &Ray) -> [f64; 2] {
        let (kappa, e, back_mm) = (self.curvature_per_mm, self.aside(ray), self.back_mm(ray));
        [0, 1].map(|k| self.index * (ray.direction[k] * (1.0 + kappa * back_mm) - kappa * e[k]))
    }

    /// s − 1/κ.
    fn back_mm(&self, ray: &Ray) -> f64 {
        let (kappa, e) = (self.curvature_per_mm, self.aside(ray));
        let along = dot(e, ray.direction);
        let square = dot(e, e) - along * along;
        along - kappa * square / (1.0 + (1.0 - kappa * kappa * square).sqrt())
    }

    /// e.
    fn aside(&self, ray: &Ray) -> Vector {
        minus(ray.position_mm, self.chief.position_mm)
    }
}

fn minus(a: Vector, b: Vector) -> Vector {
    [0, 1, 2].map(|k| a[k] - b[k])
}
