//! Quantiles: of many values by halving their range and counting, which moves none and takes many at a time; of few by
//! putting them in order.

use multiversion::multiversion;

/// The code at a rank when codes are sorted; the last one beyond their number.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn code_at_rank(codes: &[u16], rank: usize) -> u16 {
    let (mut low, mut high) = (0, u16::MAX);
    while low < high {
        let middle = low + (high - low) / 2;
        // Lanes of 16 bit cannot count farther.
        let up_to: usize = codes
            .chunks(usize::from(u16::MAX))
            .map(|part| usize::from(part.iter().fold(0_u16, |count, code| count + u16::from(*code <= middle))))
            .sum();
        if up_to > rank { high = middle } else { low = middle + 1 }
    }
    low
}

/// The code below which a share of the codes lies.
pub(crate) fn code_quantile(codes: &[u16], share: f64) -> u16 {
    code_at_rank(codes, (codes.len().saturating_sub(1) as f64 * share).round() as usize)
}

/// The value below which a share of those values lies that are at least `floor`, which is above 0, to 1/4000 of the
/// highest; `None` if there are none.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn upper_quantile(values: &[f32], floor: f32, share: f64) -> Option<f32> {
    const HALVINGS: usize = 12;
    let count_from = |limit: f32| values.iter().fold(0_u32, |count, value| count + u32::from(*value >= limit));
    let highest = values.iter().fold(floor, |high, value| if *value > high { *value } else { high });
    let count = count_from(floor);
    if count == 0 {
        return None;
    }
    let rank = (f64::from(count - 1) * share).round() as u32;
    let (mut low, mut high) = (floor, highest);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if count - count_from(middle) > rank { high = middle } else { low = middle }
    }
    Some(0.5 * (low + high))
}

/// The standard deviation of numbers over the median of their distances from their own median, if their law is normal.
pub(crate) const STD_PER_DISTANCE: f64 = 1.4826;

/// The value in the middle, the upper of two; `None` without any. Reorders `values`.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_at_a_rank_is_that_of_the_sorted_codes() {
        for count in [1_usize, 2, 63, 2560, 70_000] {
            let codes: Vec<u16> = (0..count).map(|k| (k * 40_503 % 4093) as u16).collect();
            let mut sorted = codes.clone();
            sorted.sort_unstable();
            for rank in [0, count / 3, count / 2, count - 1] {
                assert_eq!(code_at_rank(&codes, rank), sorted[rank], "{count} {rank}");
            }
            assert_eq!(code_quantile(&codes, 1.0), sorted[count - 1]);
        }
    }

    #[test]
    fn a_median_is_the_upper_middle() {
        assert_eq!(median(&mut [3.0, -1.0, 2.0, 9.0]), Some(3.0));
        assert_eq!(median(&mut [5.0, 1.0, 4.0]), Some(4.0));
        assert_eq!(median(&mut []), None);
    }

    #[test]
    fn an_upper_quantile_is_that_of_the_upper_values() {
        let values: Vec<f32> = (0..97_u16).map(|k| f32::from(k * 31 % 97)).collect();
        let found = upper_quantile(&values, 40.0, 0.7).expect("some are higher");
        assert!((found - (40.0 + 0.7 * 56.0)).abs() < 0.5, "{found}");
        assert_eq!(upper_quantile(&values, 200.0, 0.7), None);
        assert_eq!(upper_quantile(&[5.0; 3], 2.0, 0.7).map(f32::round), Some(5.0));
    }
}
