//! Central projections of one plane onto another.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A map of planes that keeps straight lines straight:  (x′, y′, 1) ∝ H (x, y, 1).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub(crate) struct Homography {
    /// The rows of H.
    pub(crate) rows: [[f64; 3]; 3],
}

impl Homography {
    pub(crate) const IDENTITY: Self = Self { rows: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] };

    /// Where a point goes.
    #[inline]
    pub(crate) fn map(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [u, v, w] = self.rows.map(|[a, b, c]| a * x + b * y + c);
        [u / w, v / w]
    }

    /// What the third coordinate is at a point: it vanishes where points go to infinity.
    #[inline]
    pub(crate) fn weight(&self, [x, y]: [f64; 2]) -> f64 {
        let [a, b, c] = self.rows[2];
        a * x + b * y + c
    }

    /// How the image of a point changes with it, row by row.
    #[inline]
    pub(crate) fn jacobian(&self, at: [f64; 2]) -> [[f64; 2]; 2] {
        let [g, h, _] = self.rows[2];
        let (image, inverse) = (self.map(at), 1.0 / self.weight(at));
        [0, 1].map(|k| {
            let [a, b, _] = self.rows[k];
            [(a - g * image[k]) * inverse, (b - h * image[k]) * inverse]
        })
    }

    /// Second derivatives of both coordinates at a point: by x twice, by x and y, by y twice.
    ///
    /// ```text
    /// ∂ⱼ∂ₖ x′ = −(wⱼ ∂ₖ x′ + wₖ ∂ⱼ x′)/w        w = (g, h)·(x, y) + i
    /// ```
    #[inline]
    pub(crate) fn second_derivatives(&self, at: [f64; 2]) -> [[f64; 3]; 2] {
        let ([g, h, _], inverse) = (self.rows[2], -1.0 / self.weight(at));
        self.jacobian(at).map(|[x, y]| [2.0 * g * x * inverse, (g * y + h * x) * inverse, 2.0 * h * y * inverse])
    }

    /// The way back; a map with a determinant of zero has none.
    pub(crate) fn inverse(&self) -> Self {
        let m = &self.rows;
        let cofactor = |i: usize, j: usize| {
            let ([a, b], [c, d]) = ([(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]);
            m[a][c] * m[b][d] - m[a][d] * m[b][c]
        };
        let determinant: f64 = (0..3).map(|j| m[0][j] * cofactor(0, j)).sum();
        Self { rows: std::array::from_fn(|i| std::array::from_fn(|j| cofactor(j, i) / determinant)) }
    }

    /// First `first`, then this.
    pub(crate) fn after(&self, first: &Self) -> Self {
        let entry = |i: usize, j: usize| (0..3).map(|k| self.rows[i][k] * first.rows[k][j]).sum();
        Self { rows: std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j))) }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SOME: Homography = Homography { rows: [[1.1, -0.2, 3.0], [0.3, 0.9, -2.0], [0.02, -0.01, 1.0]] };
    const OTHER: Homography = Homography { rows: [[0.0, -1.0, 0.5], [1.0, 0.1, 0.0], [0.0, 0.01, 1.2]] };

    proptest! {
        #[test]
        fn one_after_another_is_both(x in -5.0..5.0_f64, y in -5.0..5.0_f64) {
            let (both, one_by_one) = (OTHER.after(&SOME).map([x, y]), OTHER.map(SOME.map([x, y])));
            prop_assert!((0..2).all(|k| (both[k] - one_by_one[k]).abs() < 1e-12));
        }

        #[test]
        fn derivatives_are_differences(x in -5.0..5.0_f64, y in -5.0..5.0_f64) {
            const STEP: f64 = 1e-4;
            let second = SOME.second_derivatives([x, y]);
            let difference = |dx: f64, dy: f64, of: &dyn Fn([f64; 2]) -> f64| {
                (of([x + dx, y + dy]) - of([x - dx, y - dy])) / (2.0 * STEP)
            };
            for (k, second) in second.iter().enumerate() {
                for (j, [dx, dy]) in [[STEP, 0.0], [0.0, STEP]].into_iter().enumerate() {
                    let slope = difference(dx, dy, &|at| SOME.map(at)[k]);
                    prop_assert!((slope - SOME.jacobian([x, y])[k][j]).abs() < 1e-7);
                    for i in 0..2 {
                        let slope = difference(dx, dy, &|at| SOME.jacobian(at)[k][i]);
                        prop_assert!((slope - second[i + j]).abs() < 1e-7);
                    }
                }
            }
        }
    }
}
