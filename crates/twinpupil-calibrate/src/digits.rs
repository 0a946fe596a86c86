//! Numbers in sentences.

/// A number with so many digits, without zeros that follow from nothing.
pub fn significant(value: f64, digits: i32) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let decimals = (digits - 1 - value.abs().log10().floor() as i32).clamp(0, 12) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_do_not_depend_on_the_size() {
        assert_eq!([0.002_13, 1.234, 98.7, 1234.0].map(|value| significant(value, 2)), ["0.0021", "1.2", "99", "1234"]);
        assert_eq!(significant(0.0, 2), "0");
        for (value, text) in [(0.000_113_6, "0.00011"), (0.2, "0.20"), (2.0, "2.0"), (96.0, "96"), (150.0, "150")] {
            assert_eq!(significant(value, 2), text);
        }
    }
}
