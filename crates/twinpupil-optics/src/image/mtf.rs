//! Contrast of a grating in the image: by diffraction, and by rays.

use rustfft::num_complex::Complex;

use super::PupilFunction;
use super::pupil::Cell;

/// Contrast in the image of a grating that has all of it, of some number of lines in a millimetre of the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contrast {
    /// Of lines across y, along which the field lies.
    pub tangential: f64,
    /// Of lines across x.
    pub sagittal: f64,
}

impl PupilFunction {
    /// Contrast by diffraction at frequencies in cycles/mm: the autocorrelation of the pupil function
    /// [Goodman, Introduction to Fourier Optics, sec. 6.4].
    pub fn contrasts(&self, per_mm: &[f64]) -> Vec<Contrast> {
        let light: f64 = self.lit().map(Cell::light).sum();
        let at = |axis: usize, per_mm: f64| self.overlap(axis, per_mm.abs() * self.wavelength_mm / self.step) / light;
        per_mm.iter().map(|per_mm| Contrast { tangential: at(1, *per_mm), sagittal: at(0, *per_mm) }).collect()
    }

    /// Contrast by rays at frequencies in cycles/mm.
    pub fn contrasts_by_rays(&self, per_mm: &[f64]) -> Vec<Contrast> {
        let light: f64 = self.lit().map(Cell::light).sum();
        let at = |axis: usize, per_mm: f64| {
            let wave = |error_mm: f64| Complex::cis(std::f64::consts::TAU * per_mm * error_mm);
            let sum: Complex<f64> = self.lit().map(|cell| wave(cell.deviation.error_mm[axis]) * cell.light()).sum();
            sum.norm() / light
        };
        per_mm.iter().map(|per_mm| Contrast { tangential: at(1, *per_mm), sagittal: at(0, *per_mm) }).collect()
    }

    /// Frequency beyond which there is no contrast, cycles/mm: of lines across y, and across x.
    pub fn cutoffs_per_mm(&self) -> Contrast {
        let [sagittal, tangential] = self.apertures().map(|aperture| 2.0 * aperture / self.wavelength_mm);
        Contrast { tangential, sagittal }
    }

    /// What the pupil function and itself, shifted along an axis by a number of places, have in common. Between places
    /// amplitude and wavefront run straight: the wavefront is no angle, and may change by many wavelengths.
    fn overlap(&self, axis: usize, shift: f64) -> f64 {
        let (whole, part) = (shift.floor(), shift.fract());
        if whole >= self.size as f64 {
            return 0.0;
        }
        let whole = whole as usize;
        let sum: Complex<f64> = (self.cells.iter().enumerate())
            .filter_map(|(n, cell)| {
                let cell = cell.as_ref()?;
                let common = Common::of(cell, [whole, whole + 1].map(|k| self.shifted(n, axis, k)), part)?;
                let phase_rad = std::f64::consts::TAU * common.ahead_mm / self.wavelength_mm;
                Some(Complex::from_polar(common.light, phase_rad))
            })
            .sum();
        sum.norm()
    }

    /// What is so many places farther along an axis.
    fn shifted(&self, n: usize, axis: usize, places: usize) -> Option<Cell> {
        let (at, stride) = if axis == 0 { (n % self.size, 1) } else { (n / self.size, self.size) };
        if at + places < self.size { self.cells[n + places * stride] } else { None }
    }
}

/// What a place has in common with what is between two others.
struct Common {
    /// Product of the amplitudes where both are lit.
    light: f64,
    /// How far the other wavefront is ahead, mm.
    ahead_mm: f64,
}

impl Common {
    /// With a part of the way from one place to the next; nothing comes through a missing one.
    fn of(cell: &Cell, others: [Option<Cell>; 2], part: f64) -> Option<Self> {
        let shares = [1.0 - part, part];
        let light = |other: &Cell| cell.amplitude * other.amplitude * cell.lit.shared(other.lit);
        let ahead_mm = |other: &Cell| other.deviation.opd_mm - cell.deviation.opd_mm;
        match others {
            [Some(one), Some(other)] => Some(Self {
                light: shares[0] * light(&one) + shares[1] * light(&other),
                ahead_mm: shares[0] * ahead_mm(&one) + shares[1] * ahead_mm(&other),
            }),
            [Some(only), None] => Some(Self { light: shares[0] * light(&only), ahead_mm: ahead_mm(&only) }),
            [None, Some(only)] => Some(Self { light: shares[1] * light(&only), ahead_mm: ahead_mm(&only) }),
            [None, None] => None,
        }
    }
}
