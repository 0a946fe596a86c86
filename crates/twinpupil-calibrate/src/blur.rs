//! Blur that no distance makes.

use nalgebra::{Matrix3, Vector3};

/// How wide the edges of a dot are by its distance, negative behind the focus, and how wide they are seen, px.
pub(crate) type Edge = [f64; 2];

/// Radius of the blur that is left where edges are sharpest, px; `None` if they do not show that.
///
/// Motion and dirt add their square to that of the blur by distance, which is a parabola in what is foreseen, even by a
/// camera whose focus is elsewhere and whose masks are wider: its least value is what they add.
pub(crate) fn added_px(edges: &[Edge]) -> Option<f64> {
    const EDGES_MIN: usize = 20;
    const ROUNDS: usize = 5;
    /// Relative deviation of what is seen, and px more.
    const ROUGH: [f64; 2] = [0.1, 0.7];
    /// Share of the edges on either side of the sharpest.
    const BESIDE_SHARE: f64 = 0.1;
    /// Masks are about as wide as foreseen: a parabola that is much steeper or flatter is no blur by distance.
    const STEEPNESS_MAX: f64 = 2.0;
    let size_px = edges.iter().map(|[foreseen, _]| foreseen.abs()).fold(1.0, f64::max);
    let row = |foreseen_px: f64| {
        let x = foreseen_px / size_px;
        Vector3::new(1.0, x, x * x)
    };
    let mut parabola = Vector3::zeros();
    for round in 0..ROUNDS {
        let (mut information, mut score) = (Matrix3::zeros(), Vector3::zeros());
        for [foreseen_px, seen_px] in edges {
            let row = row(*foreseen_px);
            let square_px2 = seen_px * seen_px;
            let std_px2 = 2.0 * (seen_px.abs() + ROUGH[1]) * (ROUGH[0] * seen_px.abs() + ROUGH[1]);
            let off = if round == 0 { 0.0 } else { (square_px2 - row.dot(&parabola)) / std_px2 };
            // Some edges are those of dots that masks cut.
            let weight = (std_px2 * std_px2 * (1.0 + off * off)).recip();
            information += weight * row * row.transpose();
            score += weight * square_px2 * row;
        }
        parabola = information.cholesky()?.solve(&score);
    }
    let [level, slope, bend] = parabola.into();
    let sharpest_px = -0.5 * slope / bend * size_px;
    let beyond = edges.iter().filter(|[foreseen_px, _]| *foreseen_px > sharpest_px).count() as f64;
    let share = beyond / edges.len() as f64;
    let is_of_distance = (STEEPNESS_MAX.recip()..STEEPNESS_MAX).contains(&(bend / size_px.powi(2)));
    let is_shown = is_of_distance && edges.len() >= EDGES_MIN && (BESIDE_SHARE..=1.0 - BESIDE_SHARE).contains(&share);
    is_shown.then(|| (level - 0.25 * slope * slope / bend).max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dots from one side of the focus to the other, which is elsewhere than foreseen, with so much blur added.
    fn edges(added_px: f64, from_px: f64) -> Vec<Edge> {
        let foreseen = |k: u32| from_px + 0.25 * f64::from(k);
        (0..60).map(foreseen).map(|foreseen_px| [foreseen_px, (1.1 * foreseen_px + 2.0).hypot(added_px)]).collect()
    }

    #[test]
    fn what_is_added_is_left_where_edges_are_sharpest() {
        for expected_px in [0.0, 3.0] {
            let mut edges = edges(expected_px, -8.0);
            edges.iter_mut().step_by(9).for_each(|[_, seen_px]| *seen_px *= 0.4);
            let found_px = added_px(&edges).unwrap();
            assert!((found_px - expected_px).abs() < 0.7, "{found_px}");
        }
    }

    #[test]
    fn dots_on_one_side_of_the_focus_do_not_show_it() {
        assert_eq!(added_px(&edges(3.0, 5.0)), None);
        // All at one distance, but for rounding.
        let facing: Vec<Edge> =
            edges(3.0, -8.0).iter().map(|[foreseen_px, seen_px]| [6.0 + 0.01 * foreseen_px, *seen_px]).collect();
        assert_eq!(added_px(&facing), None);
        assert_eq!(added_px(&[]), None);
    }
}
