//! Which of a hyperspectral cube's many planes a band is.

use std::fmt;

/// A plane of a cube as an instrument names it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CubePlane {
    /// By its place, from 0.
    Index(usize),
    /// The one whose wavelength is nearest, nm.
    Wavelength(f64),
}

/// More planes than any cube has.
const INDEX_MAX: usize = 65_535;

impl CubePlane {
    /// Reads `17` or `680 nm`.
    pub fn parse(plane: &str) -> Option<Self> {
        match plane.strip_suffix("nm") {
            Some(number) => {
                let nm: f64 = number.trim().parse().ok()?;
                (nm.is_finite() && nm > 0.0).then_some(Self::Wavelength(nm))
            }
            None => plane.parse().ok().filter(|index| *index <= INDEX_MAX).map(Self::Index),
        }
    }
}

impl fmt::Display for CubePlane {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Index(index) => write!(f, "{index}"),
            Self::Wavelength(nm) => write!(f, "{nm} nm"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_numbers_or_wavelengths() {
        assert_eq!(CubePlane::parse("17"), Some(CubePlane::Index(17)));
        assert_eq!(CubePlane::parse("680 nm"), Some(CubePlane::Wavelength(680.0)));
        assert_eq!(CubePlane::parse("680.5nm"), Some(CubePlane::Wavelength(680.5)));
        for wrong in ["", "nm", "-1", "-680 nm", "nan nm", "inf nm", "99999999", "680 µm"] {
            assert_eq!(CubePlane::parse(wrong), None, "{wrong}");
        }
    }
}
