//! How well what the bands measure by themselves fits one point, and what a contradiction adds to its deviations.

/// χ² that noise alone exceeds once in a hundred times.
///
/// ```text
/// χ² = ν (1 − 2/9ν + 2.326 √(2/9ν))³
/// ```
///
/// E. B. Wilson and M. M. Hilferty, "The Distribution of Chi-Square", Proc. Natl. Acad. Sci. 17, 684 (1931).
fn chance_chi2(dof: f64) -> f64 {
    const SIGMAS: f64 = 2.326;
    let variance = 2.0 / (9.0 * dof);
    dof * (1.0 - variance + SIGMAS * variance.sqrt()).powi(3)
}

/// How many times larger than noise makes them the variances of a point are, by what its bands contradict one another:
/// χ² over its degrees of freedom, Birge's ratio squared, where that is beyond chance.
///
/// R. T. Birge, "The Calculation of Errors by the Method of Least Squares", Phys. Rev. 40, 207 (1932).
pub(super) fn birge_ratio2(chi2: f64, dof: usize) -> f64 {
    let dof = dof.max(1) as f64;
    if chi2 > chance_chi2(dof) { chi2 / dof } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chance_is_that_of_tables() {
        // M. Abramowitz and I. A. Stegun, "Handbook of Mathematical Functions", Table 26.8, Q = 0.01.
        for (dof, chi2) in [(1.0, 6.634_90), (2.0, 9.210_34), (5.0, 15.0863), (8.0, 20.0902)] {
            assert!((chance_chi2(dof) / chi2 - 1.0).abs() < 0.01, "{dof}: {}", chance_chi2(dof));
        }
    }

    #[test]
    fn what_chance_explains_adds_nothing() {
        assert_eq!(birge_ratio2(9.0, 2), 1.0);
        assert_eq!(birge_ratio2(18.0, 2), 9.0);
    }
}
