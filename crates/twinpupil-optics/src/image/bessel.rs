//! The Bessel function of first order.

/// J₁(x)/x for x from 0 on, to 3·10⁻⁸ [Abramowitz and Stegun, 9.4.4 and 9.4.6].
pub(super) fn j1_over_x(x: f64) -> f64 {
    if x < 3.0 {
        let t = (x / 3.0) * (x / 3.0);
        return horner(
            &[0.5, -0.562_499_85, 0.210_935_73, -0.039_542_89, 0.004_433_19, -0.000_317_61, 0.000_011_09],
            t,
        );
    }
    let t = 3.0 / x;
    let f = [0.797_884_56, 0.000_001_56, 0.016_596_67, 0.000_171_05, -0.002_495_11, 0.001_136_53, -0.000_200_33];
    let phase = [-2.356_194_49, 0.124_996_12, 0.000_056_50, -0.006_378_79, 0.000_743_48, 0.000_798_24, -0.000_291_66];
    horner(&f, t) * (x + horner(&phase, t)).cos() / (x * x.sqrt())
}

fn horner(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, factor| sum * x + factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_has_the_values_of_the_tables() {
        // [Abramowitz and Stegun, table 9.1]; the first zero is 3.8317059702.
        for (x, j1) in [(1.0, 0.440_050_585_7), (2.9, 0.375_427_481_8), (3.0, 0.339_058_958_5), (10.0, 0.043_472_746_2)]
        {
            assert!((x * j1_over_x(x) - j1).abs() < 5e-8, "{x}");
        }
        assert!(j1_over_x(3.831_705_970_2).abs() < 2e-8 && (j1_over_x(0.0) - 0.5).abs() < 1e-15);
    }
}
