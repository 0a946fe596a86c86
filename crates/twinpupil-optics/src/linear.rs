//! Heights and slopes of rays through a thin lens, which are linear in where a ray starts and where it is aimed.

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

    #[inline(always)]
    pub(crate) fn x(&self, pupil_x: f64, image_x_mm: f64) -> f64 {
        self.per_pupil * pupil_x + self.per_image * image_x_mm + self.constant[0]
    }

    #[inline(always)]
    pub(crate) fn y(&self, pupil_y: f64, image_y_mm: f64) -> f64 {
        self.per_pupil * pupil_y + self.per_image * image_y_mm + self.constant[1]
    }

    pub(crate) fn over(&self, centre: ImagePoint, radius_mm: f64) -> Disc {
        Disc {
            centre: [self.x(0.0, centre.x_mm), self.y(0.0, centre.y_mm)],
            radius: self.per_pupil.abs() + self.per_image.abs() * radius_mm,
        }
    }
}
