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
        let light: f64 = self.lit().map(|cell| cell.amplitude.powi(2)).sum();
        let at = |axis: usize, per_mm: f64| self.overlap(axis, per_mm.abs() * self.wavelength_mm / self.step) / light;
        per_mm.iter().map(|per_mm| Contrast { tangential: at(1, *per_mm), sagittal: at(0, *per_mm) }).collect()
    }

    /// Contrast by rays at frequencies in cycles/mm.
    pub fn contrasts_by_rays(&self, per_mm: &[f64]) -> Vec<Contrast> {
        let light: f64 = self.lit().map(|cell| cell.amplitude.powi(2)).sum();
        let at = |axis: usize, per_mm: f64| {
            let wave = |error_mm: f64| Complex::cis(std::f64::consts::TAU * per_mm * error_mm);
            let sum: Complex<f64> =
                self.lit().map(|cell| wave(cell.deviation.error_mm[axis]) * cell.amplitude.powi(2)).sum();
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
                let (cell, shifted) =
                    (cell.as_ref()?, between([whole, whole + 1].map(|k| self.shifted(n, axis, k)), part)?);
                let phase_rad = self.phase_rad(&shifted) - self.phase_rad(cell);
                Some(Complex::from_polar(cell.amplitude * shifted.amplitude, phase_rad))
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

/// What is between two places; nothing comes through a missing one.
fn between([one, other]: [Option<Cell>; 2], part: f64) -> Option<Cell> {
    let dimmed = |cell: Cell, share: f64| Cell { amplitude: share * cell.amplitude, ..cell };
    match (one, other) {
        (Some(one), Some(other)) => {
            let mut cell = dimmed(one, 1.0 - part);
            cell.amplitude += part * other.amplitude;
            cell.deviation.opd_mm += part * (other.deviation.opd_mm - one.deviation.opd_mm);
            Some(cell)
        }
        (Some(one), None) => Some(dimmed(one, 1.0 - part)),
        (None, Some(other)) => Some(dimmed(other, part)),
        (None, None) => None,
    }
}
