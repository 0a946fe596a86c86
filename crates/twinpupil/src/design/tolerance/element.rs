//! The elements of a lens: what is moved as one, glass from air to air.

use std::ops::Range;

use twinpupil_instrument::{PrescriptionSpec, Shape};

/// An element, single or cemented.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Element {
    /// Its surfaces.
    pub surfaces: Range<usize>,
}

impl Element {
    /// Those of a lens, from the object on.
    pub fn of(lens: &PrescriptionSpec) -> Vec<Self> {
        let mut elements = Vec::new();
        let mut first = None;
        for (index, surface) in lens.surfaces.iter().enumerate() {
            let is_before_air = surface.medium.eq_ignore_ascii_case("air");
            match (first, is_before_air) {
                (None, false) => first = Some(index),
                (Some(start), true) => {
                    elements.push(Self { surfaces: start..index + 1 });
                    first = None;
                }
                // An ideal lens bends light without glass.
                (None, true) if matches!(surface.shape, Shape::ThinLens { .. }) => {
                    elements.push(Self { surfaces: index..index + 1 })
                }
                _ => {}
            }
        }
        elements
    }

    /// Its surfaces as words.
    pub fn name(&self) -> String {
        let (first, last) = (self.surfaces.start, self.last());
        if first == last { format!("surface {first}") } else { format!("surfaces {first}–{last}") }
    }

    /// Its last surface.
    pub fn last(&self) -> usize {
        self.surfaces.end - 1
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::SurfaceSpec;

    use super::*;

    #[test]
    fn cemented_glass_is_one_element_and_a_stop_is_none() {
        let surface = |medium: &str| SurfaceSpec { medium: medium.to_owned(), ..SurfaceSpec::default() };
        let ideal = SurfaceSpec { shape: Shape::ThinLens { focal_length_mm: 100.0 }, ..surface("air") };
        let surfaces = ["N-BK7", "F2", "Air", "air", "N-SF11", "air"].map(surface).into_iter().chain([ideal]).collect();
        let elements = Element::of(&PrescriptionSpec { surfaces, ..PrescriptionSpec::default() });
        assert_eq!(elements.iter().map(|element| element.surfaces.clone()).collect::<Vec<_>>(), [0..3, 4..6, 6..7]);
        assert_eq!((elements[0].name(), elements[2].name()), ("surfaces 0–2".to_owned(), "surface 6".to_owned()));
    }
}
