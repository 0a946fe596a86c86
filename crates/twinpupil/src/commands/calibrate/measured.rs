//! Numbers with their deviations, in as many digits as they have.

use twinpupil_calibrate::significant;

/// A value and its deviation, with two digits of the deviation.
pub(super) fn measured(value: f64, std: f64) -> String {
    const PLAIN_FROM: f64 = 1e-4;
    const PLAIN_POWER_MIN: i32 = -2;
    let is_known = std > 0.0;
    if !is_known {
        return format!("{} ± {std}", significant(value, 6));
    }
    let power = value.abs().max(std).log10().floor() as i32;
    if std >= PLAIN_FROM || power >= PLAIN_POWER_MIN {
        let decimals = decimals(std);
        return format!("{value:.decimals$} ± {std:.decimals$}");
    }
    let scale = 10_f64.powi(-power);
    let decimals = decimals(std * scale);
    format!("({:.decimals$} ± {:.decimals$}) × 10{}", value * scale, std * scale, raised(power))
}

/// A value as it was stated and its tolerance.
pub(super) fn stated(value: f64, tolerance: f64) -> String {
    // Without the dust of binary fractions.
    let clean = (1e9 * value).round() / 1e9 + 0.0;
    format!("{clean} ± {}", significant(tolerance, 2))
}

/// As many decimals as show two digits of a deviation.
fn decimals(std: f64) -> usize {
    (1.0 - std.log10().floor()).clamp(0.0, 12.0) as usize
}

/// A whole number as an exponent.
fn raised(power: i32) -> String {
    let digit = |letter: char| match letter {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        '4' => '⁴',
        '5' => '⁵',
        '6' => '⁶',
        '7' => '⁷',
        '8' => '⁸',
        '9' => '⁹',
        _ => '⁰',
    };
    power.to_string().chars().map(digit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviations_have_two_digits() {
        assert_eq!(measured(151.734_56, 0.0123), "151.735 ± 0.012");
        assert_eq!(measured(959.5, 48.0), "960 ± 48");
        assert_eq!(measured(100.0, 0.000_012), "100.000000 ± 0.000012");
        assert_eq!(measured(-3.21e-5, 4.4e-7), "(-3.210 ± 0.044) × 10⁻⁵");
        assert_eq!(measured(0.0, 2.5e-5), "(0.0 ± 2.5) × 10⁻⁵");
        assert_eq!(measured(2.5, 0.0), "2.50000 ± 0");
        assert_eq!(measured(f64::NAN, f64::NAN), "NaN ± NaN");
    }

    #[test]
    fn what_was_stated_stays_exact() {
        assert_eq!(stated(959.5, 96.0), "959.5 ± 96");
        assert_eq!(stated(0.1 + 0.2, 0.005), "0.3 ± 0.0050");
        assert_eq!(stated(0.0, 1.139e-4), "0 ± 0.00011");
    }
}
