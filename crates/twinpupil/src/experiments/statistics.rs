//! Means and spreads; NaN of nothing.

/// Arithmetic mean.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Root of the mean square.
pub fn rms(values: &[f64]) -> f64 {
    mean(&values.iter().map(|value| value * value).collect::<Vec<_>>()).sqrt()
}

/// Standard deviation about the mean, of the values themselves (divided by their number).
pub fn spread(values: &[f64]) -> f64 {
    let mean = mean(values);
    rms(&values.iter().map(|value| value - mean).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_few_values() {
        assert_eq!((mean(&[1.0, 3.0]), spread(&[1.0, 3.0]), rms(&[3.0, 3.0])), (2.0, 1.0, 3.0));
        assert!(mean(&[]).is_nan() && rms(&[]).is_nan() && spread(&[]).is_nan());
    }
}
