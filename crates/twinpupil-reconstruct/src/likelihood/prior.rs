//! What is known of a dot before its own pixels tell.

use nalgebra::Vector4;

use crate::likelihood::spot::Dot;

/// About how large a number is, and the standard deviation of that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Expected {
    pub(crate) value: f64,
    pub(crate) std: f64,
}

/// What the other dots let expect of one that a single band shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Prior {
    pub(crate) z_mm: Expected,
    /// Of a dot of which the border shows a part, whose pixels need not tell them.
    pub(crate) diameter_mm: Option<Expected>,
    pub(crate) contrast: Option<Expected>,
}

impl Expected {
    /// What it tells of its number.
    pub(crate) fn information(&self) -> f64 {
        self.std.powi(-2)
    }

    /// How much it asks for a number other than this one.
    fn score(&self, number: f64) -> f64 {
        (self.value - number) * self.information()
    }
}

impl Prior {
    /// Information on x, y, z and diameter: the diagonal of a matrix.
    pub(crate) fn information(&self) -> Vector4<f64> {
        let of_diameter = self.diameter_mm.map_or(0.0, |expected| expected.information());
        Vector4::new(0.0, 0.0, self.z_mm.information(), of_diameter)
    }

    /// The score that it adds to that of a dot's pixels.
    pub(crate) fn score(&self, dot: &Dot) -> Vector4<f64> {
        let of_diameter = self.diameter_mm.map_or(0.0, |expected| expected.score(dot.diameter_mm));
        Vector4::new(0.0, 0.0, self.z_mm.score(dot.centre_mm[2]), of_diameter)
    }
}
