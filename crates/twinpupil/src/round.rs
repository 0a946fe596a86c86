//! Round numbers.

/// The largest of 1, 2 or 5 times a power of ten that is not above a number.
pub fn round_below(value: f64) -> f64 {
    let power = value.log10().floor() as i32;
    // A negative power as a quotient, so that 0.1 is 0.1.
    let decade = |power: i32| if power < 0 { 1.0 / 10_f64.powi(-power) } else { 10_f64.powi(power) };
    let candidates = [5.0, 2.0, 1.0].map(|share| share * decade(power));
    candidates.into_iter().find(|round| *round <= value).unwrap_or_else(|| decade(power))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_numbers() {
        let found = [0.1, 0.19, 1.0, 4.9, 5.0, 27.5, 1000.0].map(round_below);
        assert_eq!(found, [0.1, 0.1, 1.0, 2.0, 5.0, 20.0, 1000.0]);
    }
}
