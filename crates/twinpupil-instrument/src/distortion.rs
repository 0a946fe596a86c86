//! How a lens departs from the perspective of an ideal one.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::{ValueError, within};

/// `distortion` of a band: where its light lands on the plane across the axis at `sensor.distance_mm`.
///
/// A point that an ideal lens images at (x, y) from the axis, r² = x² + y², is imaged at
///
/// ```text
/// x (1 + k₁ r² + k₂ r⁴) + 2 p₁ x y + p₂ (r² + 2 x²)
/// y (1 + k₁ r² + k₂ r⁴) + p₁ (r² + 2 y²) + 2 p₂ x y
/// ```
///
/// D. C. Brown, "Decentering distortion of lenses", Photogrammetric Engineering 32(3), 444 (1966), in the order of
/// OpenCV's coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Distortion {
    /// k₁, growth of the image with the square of the radius, 1/mm².
    #[serde(default, skip_serializing_if = "is_zero")]
    pub k1_per_mm2: f64,
    /// k₂, growth with the fourth power, 1/mm⁴.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub k2_per_mm4: f64,
    /// p₁, of elements off the axis, 1/mm.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub p1_per_mm: f64,
    /// p₂, of elements off the axis, 1/mm.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub p2_per_mm: f64,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl Distortion {
    /// Whether the lens departs from nothing.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Where an ideal image point (x, y) is imaged, mm.
    #[inline]
    pub fn map(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let Self { k1_per_mm2: k1, k2_per_mm4: k2, p1_per_mm: p1, p2_per_mm: p2 } = *self;
        let square = x * x + y * y;
        let scale = 1.0 + square * (k1 + k2 * square);
        [
            x * scale + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
            y * scale + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    }

    /// How that changes with x and y, row by row.
    #[inline]
    pub(crate) fn jacobian(&self, [x, y]: [f64; 2]) -> [[f64; 2]; 2] {
        let Self { k1_per_mm2: k1, k2_per_mm4: k2, p1_per_mm: p1, p2_per_mm: p2 } = *self;
        let square = x * x + y * y;
        let (scale, growth) = (1.0 + square * (k1 + k2 * square), 2.0 * (k1 + 2.0 * k2 * square));
        let across = growth * x * y + 2.0 * (p1 * x + p2 * y);
        [
            [scale + growth * x * x + 2.0 * p1 * y + 6.0 * p2 * x, across],
            [across, scale + growth * y * y + 6.0 * p1 * y + 2.0 * p2 * x],
        ]
    }

    /// Second derivatives of both coordinates: by x twice, by x and y, by y twice.
    #[inline]
    pub(crate) fn second_derivatives(&self, [x, y]: [f64; 2]) -> [[f64; 3]; 2] {
        let Self { k1_per_mm2: k1, k2_per_mm4: k2, p1_per_mm: p1, p2_per_mm: p2 } = *self;
        let (growth, bend) = (2.0 * (k1 + 2.0 * k2 * (x * x + y * y)), 8.0 * k2);
        let (xx, yy) = (bend * x * x, bend * y * y);
        [
            [x * (3.0 * growth + xx) + 6.0 * p2, y * (growth + xx) + 2.0 * p1, x * (growth + yy) + 2.0 * p2],
            [y * (growth + xx) + 2.0 * p1, x * (growth + yy) + 2.0 * p2, y * (3.0 * growth + yy) + 6.0 * p1],
        ]
    }

    pub(crate) fn check(&self, key: &str) -> Result<(), ValueError> {
        // Beyond this a millimetre from the axis is a metre off; whether the map folds depends on the sensor.
        const LARGEST: f64 = 1e3;
        let values = [
            ("k1_per_mm2", self.k1_per_mm2),
            ("k2_per_mm4", self.k2_per_mm4),
            ("p1_per_mm", self.p1_per_mm),
            ("p2_per_mm", self.p2_per_mm),
        ];
        values.iter().try_for_each(|(name, value)| within(&format!("{key}.{name}"), *value, -LARGEST, LARGEST))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SOME: Distortion = Distortion { k1_per_mm2: 2e-3, k2_per_mm4: -3e-5, p1_per_mm: 4e-4, p2_per_mm: -7e-4 };

    #[test]
    fn a_point_by_hand() {
        // r² = 25: 1 + 0.05 − 0.01875; x y = 12.
        let [x, y] = SOME.map([3.0, 4.0]);
        assert!((x - (3.0 * 1.03125 + 2.0 * 4e-4 * 12.0 - 7e-4 * 43.0)).abs() < 1e-14);
        assert!((y - (4.0 * 1.03125 + 4e-4 * 57.0 - 2.0 * 7e-4 * 12.0)).abs() < 1e-14);
    }

    proptest! {
        #[test]
        fn derivatives_are_differences(x in -6.0..6.0_f64, y in -6.0..6.0_f64) {
            const STEP: f64 = 1e-4;
            let (slopes, second) = (SOME.jacobian([x, y]), SOME.second_derivatives([x, y]));
            for (j, [dx, dy]) in [[STEP, 0.0], [0.0, STEP]].into_iter().enumerate() {
                let [a, b] = [-1.0, 1.0].map(|sign| [x + sign * dx, y + sign * dy]);
                for k in 0..2 {
                    let slope = (SOME.map(b)[k] - SOME.map(a)[k]) / (2.0 * STEP);
                    prop_assert!((slope - slopes[k][j]).abs() < 1e-7);
                    for i in 0..2 {
                        let bend = (SOME.jacobian(b)[k][i] - SOME.jacobian(a)[k][i]) / (2.0 * STEP);
                        prop_assert!((bend - second[k][i + j]).abs() < 1e-7, "{bend} {second:?}");
                    }
                }
            }
        }
    }
}
