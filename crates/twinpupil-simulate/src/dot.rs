//! A dot: a flat round disc anywhere before the lens.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use twinpupil_instrument::check::{ValueError, positive, within};

use crate::scene::LENGTH_MM_MAX;

/// One `[[dot]]`: a disc that faces the camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DotSpec {
    /// Centre to the right of the axis, mm.
    pub x_mm: f64,
    /// Centre below the axis, mm.
    pub y_mm: f64,
    /// Centre before the front principal point, mm.
    pub z_mm: f64,
    /// Diameter, mm.
    #[serde(default = "DotSpec::default_diameter_mm")]
    pub diameter_mm: f64,
}

/// A flat disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dot {
    /// x, y, z of the centre, mm.
    pub centre_mm: [f64; 3],
    /// Unit normal towards the camera: its z is negative.
    pub normal: [f64; 3],
    /// Diameter, mm.
    pub diameter_mm: f64,
}

impl DotSpec {
    /// The paper's dots [Ohno2018, Section 4].
    fn default_diameter_mm() -> f64 {
        1.0
    }

    pub(crate) fn check(&self, index: usize) -> Result<(), ValueError> {
        let key = |name: &str| format!("dot[{index}].{name}");
        within(&key("x_mm"), self.x_mm, -LENGTH_MM_MAX, LENGTH_MM_MAX)?;
        within(&key("y_mm"), self.y_mm, -LENGTH_MM_MAX, LENGTH_MM_MAX)?;
        positive(&key("z_mm"), self.z_mm, LENGTH_MM_MAX)?;
        positive(&key("diameter_mm"), self.diameter_mm, LENGTH_MM_MAX)
    }

    pub(crate) fn facing_camera(&self) -> Dot {
        Dot { centre_mm: [self.x_mm, self.y_mm, self.z_mm], normal: [0.0, 0.0, -1.0], diameter_mm: self.diameter_mm }
    }
}

impl Dot {
    /// Half of the diameter, mm.
    pub fn radius_mm(&self) -> f64 {
        0.5 * self.diameter_mm
    }

    /// How far the disc reaches in z on either side of its centre, mm.
    pub fn depth_mm(&self) -> f64 {
        let [nx, ny, _] = self.normal;
        self.radius_mm() * nx.hypot(ny)
    }
}
