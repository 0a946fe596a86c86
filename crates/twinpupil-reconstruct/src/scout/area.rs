//! The area of a piece of which only some rows were looked at.

/// Area from the lengths of rows that are `step` apart.
///
/// Between the second row and the last but one lengths change smoothly, and the trapezoid's sum is right to its first
/// correction (Euler and Maclaurin). What lies beyond is rounded off like an ellipse, whose squared length is quadratic:
///
/// ```text
/// A = h (½ c₁ + c₂ + … + ½ cₙ₋₁) + Σ_ends h (∫₀ √(A + B t + C t²) dt − B/(24 √A))        c² = A + B t + C t²
/// ```
///
/// with t outwards, in steps from the second row.
pub(crate) fn area(lengths: &[f64], step: usize) -> f64 {
    let h = step as f64;
    let plain: f64 = lengths.iter().sum();
    let [c0, c1, c2, .., d2, d1, d0] = lengths else { return h * plain };
    if step == 1 {
        return plain;
    }
    let beyond = |first: f64, second: f64, third: f64| end(first, second, third).unwrap_or(first + 0.5 * second);
    let inner = plain - c0 - d0 - 0.5 * (c1 + d1);
    h * (inner + beyond(*c0, *c1, *c2) + beyond(*d0, *d1, *d2))
}

/// What lies beyond the second row, over the step, with the correction of the sum before it; `None` where the piece does
/// not end like an ellipse before the next row.
fn end(first: f64, second: f64, third: f64) -> Option<f64> {
    let (a, b) = (second * second, 0.5 * (first * first - third * third));
    let bend = second * second - 0.5 * (first * first + third * third);
    let discriminant = b * b + 4.0 * a * bend;
    if !(bend > 0.0 && second > 0.0) {
        return None;
    }
    let tip = (b + discriminant.sqrt()) / (2.0 * bend);
    if !(0.9..=2.5).contains(&tip) {
        return None;
    }
    let angle = std::f64::consts::FRAC_PI_2 + (b / discriminant.sqrt()).asin();
    let rounded = b * second / (4.0 * bend) + discriminant / (8.0 * bend * bend.sqrt()) * angle;
    Some(rounded - b / (24.0 * second))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative errors of ellipses that lie anywhere between the rows.
    fn errors(half_height: f64, step: usize) -> impl Iterator<Item = f64> {
        let half_width = 17.0;
        (0..20).map(move |k| {
            let middle = 60.0 + 0.05 * f64::from(k) * step as f64;
            let length = |row: usize| {
                let off = (row as f64 - middle) / half_height;
                2.0 * half_width * (1.0 - off * off).max(0.0).sqrt()
            };
            let lengths: Vec<f64> = (0..120).step_by(step).map(length).filter(|length| *length > 0.0).collect();
            area(&lengths, step) / (std::f64::consts::PI * half_width * half_height) - 1.0
        })
    }

    #[test]
    fn few_rows_of_an_ellipse_tell_its_area() {
        for (half_height, step) in [(21.0, 4), (15.0, 3), (12.0, 2), (40.0, 4)] {
            assert!(errors(half_height, step).all(|error| error.abs() < 1.5e-3), "{half_height} {step}");
        }
    }

    #[test]
    fn what_does_not_end_roundly_is_summed() {
        assert_eq!(area(&[10.0; 9], 3), 270.0);
        assert_eq!(area(&[3.0, 5.0, 4.0], 2), 24.0);
        assert_eq!(area(&[3.0, 5.0, 6.0, 6.0, 5.0, 3.0], 1), 28.0);
        assert_eq!(area(&[], 2), 0.0);
    }
}
