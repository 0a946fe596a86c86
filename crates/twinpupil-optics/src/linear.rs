//! Heights and slopes of rays through a thin lens, which are linear in where a ray starts and where it is aimed.

use multiversion::multiversion;
use twinpupil_instrument::ImagePoint;

/// A transverse quantity of a ray: `per_pupil · u + per_image · p + constant` for the unit-disc pupil point u and the
/// upright image position p, both transverse components alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Linear {
    pub(crate) per_pupil: f64,
    pub(crate) per_image: f64,
    pub(crate) constant: [f64; 2],
}

/// All values that a [`Linear`] takes over the unit disc and an image disc: again a disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Disc {
    pub(crate) centre: [f64; 2],
    pub(crate) radius: f64,
}

impl Linear {
    pub(crate) fn scaled(self, factor: f64) -> Self {
        Self {
            per_pupil: factor * self.per_pupil,
            per_image: factor * self.per_image,
            constant: self.constant.map(|value| factor * value),
        }
    }

    pub(crate) fn plus(self, other: Self) -> Self {
        let [x, y] = self.constant;
        Self {
            per_pupil: self.per_pupil + other.per_pupil,
            per_image: self.per_image + other.per_image,
            constant: [x + other.constant[0], y + other.constant[1]],
        }
    }

    pub(crate) fn plus_image(self, per_image: f64) -> Self {
        Self { per_image: self.per_image + per_image, ..self }
    }

    pub(crate) fn moved(self, by: [f64; 2]) -> Self {
        Self { constant: [self.constant[0] + by[0], self.constant[1] + by[1]], ..self }
    }

    /// Component 0 (x) or 1 (y), from the same component of the pupil point and of the image position.
    #[inline(always)]
    pub(crate) fn component(&self, k: usize, pupil: f64, image_mm: f64) -> f64 {
        self.per_pupil * pupil + self.per_image * image_mm + self.constant[k]
    }

    /// The image point whose ray through a pupil point takes these values, mm.
    #[inline]
    pub(crate) fn image_mm(&self, values: [f64; 2], pupil: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| (values[k] - self.component(k, pupil[k], 0.0)) / self.per_image)
    }

    /// Component `k` for many rays.
    pub(crate) fn fill(&self, k: usize, pupil: &[f64], image_mm: &[f64], values: &mut [f64]) {
        fill(self, k, pupil, image_mm, values);
    }

    pub(crate) fn over(&self, centre: ImagePoint, radius_mm: f64) -> Disc {
        Disc {
            centre: [self.component(0, 0.0, centre.x_mm), self.component(1, 0.0, centre.y_mm)],
            radius: self.per_pupil.abs() + self.per_image.abs() * radius_mm,
        }
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn fill(linear: &Linear, k: usize, pupil: &[f64], image_mm: &[f64], values: &mut [f64]) {
    for (value, (pupil, image_mm)) in values.iter_mut().zip(pupil.iter().zip(image_mm)) {
        *value = linear.component(k, *pupil, *image_mm);
    }
}
