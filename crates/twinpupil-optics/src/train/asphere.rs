//! Where rays meet an asphere, by Newton's method on all rays of a block at once.

use super::face::Polynomial;
use super::kernel::{across, moved};
use super::rays::{Block, LANES};
use crate::refraction::Vector;

/// Where the rays of a block meet a surface.
pub(crate) struct Met {
    /// Along the ray.
    pub(crate) distance_mm: [f64; LANES],
    /// Slope of the surface there over the radius, 1/mm.
    pub(crate) slope_per_radius: [f64; LANES],
    pub(crate) is_met: [bool; LANES],
}

/// Steps after which a ray that is still not there meets nothing.
const STEPS_MAX: usize = 30;

/// A step after which Newton's method, which squares its errors, is at the end of its digits, mm.
const LAST_STEP_MM: f64 = 1e-8;

/// The asphere itself.
#[inline(always)]
pub(crate) fn meet(polynomial: &Polynomial, ahead_z_mm: f64, block: &Block) -> Met {
    let mut met = Met { distance_mm: [0.0; LANES], slope_per_radius: [0.0; LANES], is_met: [false; LANES] };
    for lane in 0..LANES {
        let (p, d) = ray(block, ahead_z_mm, lane);
        // From the tangent plane at the vertex.
        met.distance_mm[lane] = -p[2] / d[2];
    }
    for _ in 0..STEPS_MAX {
        if improve(polynomial, ahead_z_mm, block, &mut met) {
            break;
        }
    }
    sag_and_slope(polynomial, ahead_z_mm, block, &met.distance_mm.clone(), &mut met.slope_per_radius);
    met
}

/// A plane that only bends light as the asphere does.
#[inline(always)]
pub(crate) fn meet_flat(polynomial: &Polynomial, ahead_z_mm: f64, block: &Block) -> Met {
    let mut met = Met { distance_mm: [0.0; LANES], slope_per_radius: [0.0; LANES], is_met: [false; LANES] };
    for lane in 0..LANES {
        let (p, d) = ray(block, ahead_z_mm, lane);
        met.distance_mm[lane] = -p[2] / d[2];
    }
    let sag_mm = sag_and_slope(polynomial, ahead_z_mm, block, &met.distance_mm, &mut met.slope_per_radius);
    for (is_met, sag_mm) in met.is_met.iter_mut().zip(sag_mm) {
        *is_met = !sag_mm.is_nan();
    }
    met
}

/// One step of Newton's method for the rays that are not there yet; whether that was all of them.
#[inline(always)]
fn improve(polynomial: &Polynomial, ahead_z_mm: f64, block: &Block, met: &mut Met) -> bool {
    let mut slope_per_radius = [0.0; LANES];
    let sag_mm = sag_and_slope(polynomial, ahead_z_mm, block, &met.distance_mm, &mut slope_per_radius);
    let mut open = 0_u64;
    for lane in 0..LANES {
        let (p, d) = ray(block, ahead_z_mm, lane);
        let [x, y, z] = moved(p, met.distance_mm[lane], d);
        let towards = slope_per_radius[lane] * (x * d[0] + y * d[1]) - d[2];
        let step_mm = (sag_mm[lane] - z) / towards;
        let was_met = met.is_met[lane];
        met.distance_mm[lane] -= if was_met { 0.0 } else { step_mm };
        met.is_met[lane] = was_met | (step_mm.abs() < LAST_STEP_MM);
        open |= u64::from(!met.is_met[lane] & (block.fate[lane] == 0) & !step_mm.is_nan());
    }
    open == 0
}

/// Position from the vertex, and direction.
#[inline(always)]
fn ray(block: &Block, ahead_z_mm: f64, lane: usize) -> (Vector, Vector) {
    let [x, y, z] = block.position(lane);
    ([x, y, z + ahead_z_mm], block.going(lane))
}

/// Depth of the surface below the rays at a distance along them, and its slope over the radius.
///
/// ```text
/// s = c r²/(1 + w) + Σ aᵢ r²ⁱ + r Σ bᵢ r²ⁱ,    w = √(1 − (1 + k) c² r²),    s'/r = c/w + Σ 2i aᵢ r²ⁱ⁻² + Σ (2i + 1) bᵢ r²ⁱ⁻¹
/// ```
#[inline(always)]
fn sag_and_slope(
    polynomial: &Polynomial,
    ahead_z_mm: f64,
    block: &Block,
    distance_mm: &[f64; LANES],
    slope_per_radius: &mut [f64; LANES],
) -> [f64; LANES] {
    let Polynomial { c, k, even, odd } = polynomial;
    let (mut square, mut sag_mm) = ([0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        let (p, d) = ray(block, ahead_z_mm, lane);
        square[lane] = across(moved(p, distance_mm[lane], d));
    }
    let ([mut value, mut slope], [mut odd_value, mut odd_slope]) = ([[0.0; LANES]; 2], [[0.0; LANES]; 2]);
    horner(even, 2.0, &square, &mut value, &mut slope);
    horner(odd, 1.0, &square, &mut odd_value, &mut odd_slope);
    for lane in 0..LANES {
        let (radius, w) = (square[lane].sqrt(), (1.0 - (1.0 + k) * c * c * square[lane]).sqrt());
        sag_mm[lane] = square[lane] * (c / (1.0 + w) + value[lane]) + radius * odd_value[lane];
        // On the axis a term of r has no slope of its own.
        let odd_slope = if radius > 0.0 { odd_slope[lane] / radius } else { 0.0 };
        slope_per_radius[lane] = c / w + slope[lane] + odd_slope;
    }
    sag_mm
}

/// `Σ aᵢ qⁱ` and `Σ (2i + power) aᵢ qⁱ`, i from 0, for q = r²; `power` is that of r in the first term.
#[inline(always)]
fn horner(coefficients: &[f64], power: f64, square: &[f64; LANES], value: &mut [f64; LANES], slope: &mut [f64; LANES]) {
    for (i, coefficient) in coefficients.iter().enumerate().rev() {
        let steeper = (2.0 * i as f64 + power) * coefficient;
        for lane in 0..LANES {
            value[lane] = value[lane] * square[lane] + coefficient;
            slope[lane] = slope[lane] * square[lane] + steeper;
        }
    }
}
