//! Area and middle of a piece of which only some rows were looked at.

/// What a piece would sum up to, from its rows that are `step` apart: its area from their lengths.
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
    let inner = plain - c0 - d0 - 0.5 * (c1 + d1);
    let [first, last] = [End::of(*c0, *c1, *c2), End::of(*d0, *d1, *d2)];
    h * (inner + first.corrected() + last.corrected())
}

/// Where a piece has its middle, in steps below its first row, from what its rows sum up to.
///
/// The first moment is found as the area is, its ends with `∫₀ t √(A + B t + C t²) dt`.
pub(crate) fn middle(rows: &[f64], step: usize) -> f64 {
    let plain: f64 = rows.iter().sum();
    let moment: f64 = rows.iter().enumerate().map(|(row, sum)| row as f64 * sum).sum();
    let [c0, c1, c2, .., d2, d1, d0] = rows else { return moment / plain };
    if step == 1 {
        return moment / plain;
    }
    let bottom = (rows.len() - 2) as f64;
    let inner = moment - (bottom + 1.0) * d0 - 0.5 * (c1 + bottom * d1);
    let [first, last] = [End::of(*c0, *c1, *c2), End::of(*d0, *d1, *d2)];
    // The moment's own change at either end, beside that of the length times the place.
    let correction = (c1 - d1) / 12.0;
    let ends = first.corrected() - first.moment + bottom * last.corrected() + last.moment;
    (inner + ends + correction) / (area(rows, step) / step as f64)
}

/// What lies beyond the second row of a piece, outwards, in steps.
struct End {
    beyond: f64,
    moment: f64,
    /// Change of the length at the second row.
    slope: f64,
}

impl End {
    /// From the lengths of the first three rows; like an ellipse if it ends so before the next row.
    fn of(first: f64, second: f64, third: f64) -> Self {
        Self::round(first, second, third).unwrap_or(Self { beyond: first + 0.5 * second, moment: first, slope: 0.0 })
    }

    fn round(first: f64, second: f64, third: f64) -> Option<Self> {
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
        let beyond = b * second / (4.0 * bend) + discriminant / (8.0 * bend * bend.sqrt()) * angle;
        let moment = a * second / (3.0 * bend) + 0.5 * b / bend * beyond;
        Some(Self { beyond, moment, slope: 0.5 * b / second })
    }

    /// With the correction of the sum before it.
    fn corrected(&self) -> f64 {
        self.beyond - self.slope / 12.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HALF_WIDTH: f64 = 17.0;

    /// Lengths of the rows of ellipses that lie anywhere between them, and where their middles lie in steps below the
    /// first.
    fn ellipses(half_height: f64, step: usize) -> impl Iterator<Item = (Vec<f64>, f64)> {
        (0..20).map(move |k| {
            let centre = 60.0 + 0.05 * f64::from(k) * step as f64;
            let length = |row: usize| {
                let off = (row as f64 - centre) / half_height;
                2.0 * HALF_WIDTH * (1.0 - off * off).max(0.0).sqrt()
            };
            let rows = (0..120).step_by(step);
            let first = rows.clone().find(|row| length(*row) > 0.0).unwrap_or_default() as f64;
            let lengths = rows.map(length).filter(|length| *length > 0.0).collect();
            (lengths, (centre - first) / step as f64)
        })
    }

    #[test]
    fn few_rows_of_an_ellipse_tell_its_area_and_its_middle() {
        for (half_height, step) in [(21.0, 4), (15.0, 3), (12.0, 2), (40.0, 4)] {
            for (lengths, below) in ellipses(half_height, step) {
                let error = area(&lengths, step) / (std::f64::consts::PI * HALF_WIDTH * half_height) - 1.0;
                assert!(error.abs() < 1.5e-3, "{half_height} {step}: {error}");
                let off = middle(&lengths, step) - below;
                assert!(off.abs() < 0.01, "{half_height} {step}: {off}");
            }
        }
    }

    #[test]
    fn what_does_not_end_roundly_is_summed() {
        assert_eq!(area(&[10.0; 9], 3), 270.0);
        assert_eq!(area(&[3.0, 5.0, 4.0], 2), 24.0);
        assert_eq!(area(&[3.0, 5.0, 6.0, 6.0, 5.0, 3.0], 1), 28.0);
        assert_eq!(area(&[], 2), 0.0);
        assert_eq!(middle(&[10.0; 9], 3), 4.0);
        assert_eq!(middle(&[3.0, 5.0, 6.0, 6.0, 5.0, 3.0], 1), 2.5);
    }
}
