//! Light that falls unevenly on the scene.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use twinpupil_instrument::check::{ValueError, within};

/// The steepest growth, relative per mm.
const GROWTH_PER_MM_MAX: f64 = 1000.0;

/// `[illumination]`: light that grows evenly across the scene; a scene without one is lit evenly.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Illumination {
    /// Growth along x and y relative to the light on the axis, 1/mm.
    pub growth_per_mm: [f64; 2],
}

impl Illumination {
    /// Light on a surface at (x, y), relative to that on the axis; there is none where it has fallen to nothing.
    #[inline(always)]
    pub fn at(&self, [x_mm, y_mm]: [f64; 2]) -> f64 {
        let [gx, gy] = self.growth_per_mm;
        (1.0 + gx * x_mm + gy * y_mm).max(0.0)
    }

    pub(crate) fn check(&self) -> Result<(), ValueError> {
        for (axis, growth) in self.growth_per_mm.into_iter().enumerate() {
            let key = format!("illumination.growth_per_mm[{axis}]");
            within(&key, growth, -GROWTH_PER_MM_MAX, GROWTH_PER_MM_MAX)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_grows_along_its_slope_and_ends_at_none() {
        let light = Illumination { growth_per_mm: [0.1, -0.2] };
        assert_eq!(light.at([0.0, 0.0]), 1.0);
        assert!((light.at([2.0, 1.0]) - 1.0).abs() < 1e-12);
        assert_eq!(light.at([0.0, 6.0]), 0.0);
    }
}
