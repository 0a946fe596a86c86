//! Adding up the light of many rays.

use multiversion::multiversion;

/// Sums that run side by side, so that they vectorise; their number is fixed, and with it the result.
const LANES: usize = 8;

/// Sum of `values`.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn sum(values: &[f64]) -> f64 {
    let mut lanes = [0.0; LANES];
    let chunks = values.chunks_exact(LANES);
    let rest: f64 = chunks.remainder().iter().sum();
    for chunk in chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *lane += value;
        }
    }
    lanes.iter().sum::<f64>() + rest
}

/// Sum of `weight`, and of weight × coverage, where coverage counts up to 1.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn covered_light(weight: &[f64], coverage: &[f64]) -> (f64, f64) {
    // Dots that overlap in the image cover no more than all. `min` also turns the NaN of a lost ray into a number.
    let covered = |weight: f64, coverage: f64| weight * coverage.min(1.0);
    let mut lanes = [0.0; LANES];
    let (weights, coverages) = (weight.chunks_exact(LANES), coverage.chunks_exact(LANES));
    let rest = weights.remainder().iter().zip(coverages.remainder());
    let rest: f64 = rest.map(|(weight, coverage)| covered(*weight, *coverage)).sum();
    for (weights, coverages) in weights.zip(coverages) {
        for (lane, (weight, coverage)) in lanes.iter_mut().zip(weights.iter().zip(coverages)) {
            *lane += covered(*weight, *coverage);
        }
    }
    (sum(weight), lanes.iter().sum::<f64>() + rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_forget_no_ray_and_ignore_lost_ones() {
        let weight: Vec<f64> = (0..19).map(|k| if k == 3 { 0.0 } else { f64::from(k) }).collect();
        let coverage: Vec<f64> = (0..19).map(|k| if k == 3 { f64::NAN } else { 0.25 * f64::from(k) }).collect();
        // 0 + 1 + 2 + 4 + … + 18, and weights 1 and 2 at a quarter and a half.
        assert_eq!(covered_light(&weight, &coverage), (168.0, 168.0 - 3.0 + 0.25 + 1.0));
    }
}
