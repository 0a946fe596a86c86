//! A flat plate across the axis, possibly tilted, with a pattern on it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use twinpupil_instrument::check::{ValueError, positive, within};

use crate::dot::Dot;
use crate::packing::{PackingError, RandomDots};
use crate::scene::LENGTH_MM_MAX;

/// `[plate]`.
// Unknown keys are refused by the pattern, which is handed every key that is not listed here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Plate {
    /// Where the plate meets the axis, mm before the front principal point.
    pub distance_mm: f64,
    /// Tilt about the tilt axis, degrees.
    #[serde(default)]
    pub tilt_deg: f64,
    /// The axis about which the plate is tilted.
    #[serde(default)]
    pub tilt_axis: TiltAxis,
    /// What is on the plate.
    #[serde(flatten)]
    pub pattern: Pattern,
}

/// The line through (0, 0, distance) about which a plate is tilted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum TiltAxis {
    /// Along y: z grows with x by the tangent of the tilt  [Ohno2018, Eq. 14].
    #[default]
    Y,
    /// Along x: z grows with y by the tangent of the tilt.
    X,
}

/// What is on the plate, told apart by `pattern`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "pattern", rename_all = "kebab-case")]
pub enum Pattern {
    /// Dots at random places.
    RandomDots(RandomDots),
    /// Dots in rows and columns.
    Grid(DotGrid),
    /// A picture.
    Image(ImagePattern),
}

/// Dots in rows and columns, centred on the axis unless they are shifted.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DotGrid {
    /// Number of rows.
    pub rows: u32,
    /// Number of columns.
    pub columns: u32,
    /// Distance between neighbouring centres on the plate, mm.
    pub pitch_mm: f64,
    /// Diameter of each dot, mm.
    pub diameter_mm: f64,
    /// Middle of the grid beside the axis, along the plate, mm.
    #[serde(default, skip_serializing_if = "is_zero_pair")]
    pub centre_mm: [f64; 2],
    /// Turn of the grid in the plate about its middle, from x to y, degrees.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub turn_deg: f64,
    /// Places that are not like the others, as on a calibration target.
    #[serde(default, rename = "fiducial", skip_serializing_if = "Vec::is_empty")]
    pub fiducials: Vec<GridFiducial>,
}

/// A place of a grid that is not like the others.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GridFiducial {
    /// Row, from the top and from 0.
    pub row: u32,
    /// Column, from the left and from 0.
    pub column: u32,
    /// Diameter of the dot there, mm; left out where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub diameter_mm: Option<f64>,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn is_zero_pair(value: &[f64; 2]) -> bool {
    *value == [0.0; 2]
}

/// A picture centred on the axis: black is the scene's background, white its brightness.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImagePattern {
    /// Path of the picture.
    pub image: String,
    /// Width on the plate, mm; the height follows from the picture.
    pub width_mm: f64,
}

/// Where a plate stands and which way it leans.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose {
    /// Where the plate meets the axis, mm.
    pub distance_mm: f64,
    /// Slope dz/dx and dz/dy of the plate; at least one is 0.
    pub slope: [f64; 2],
}

impl Pose {
    /// The point of the plate at (x, y).
    pub fn at(&self, x_mm: f64, y_mm: f64) -> [f64; 3] {
        [x_mm, y_mm, self.distance_mm + self.slope[0] * x_mm + self.slope[1] * y_mm]
    }

    /// Length on the plate of a unit step in x and in y.
    pub fn stretch(&self) -> [f64; 2] {
        self.slope.map(|slope| slope.hypot(1.0))
    }

    /// Unit normal towards the camera.
    pub fn normal(&self) -> [f64; 3] {
        let [a, b] = self.slope;
        let length = (a * a + b * b + 1.0).sqrt();
        [a / length, b / length, -1.0 / length]
    }
}

impl Plate {
    /// Where the plate stands and which way it leans.
    pub fn pose(&self) -> Pose {
        let slope = self.tilt_deg.to_radians().tan();
        Pose {
            distance_mm: self.distance_mm,
            slope: match self.tilt_axis {
                TiltAxis::Y => [slope, 0.0],
                TiltAxis::X => [0.0, slope],
            },
        }
    }

    /// Number of dots that the plate asks for.
    pub(crate) fn dot_count(&self) -> usize {
        match &self.pattern {
            Pattern::RandomDots(random) => random.count as usize,
            Pattern::Grid(grid) => (grid.rows as usize).saturating_mul(grid.columns as usize),
            Pattern::Image(_) => 0,
        }
    }

    pub(crate) fn check(&self) -> Result<(), ValueError> {
        positive("plate.distance_mm", self.distance_mm, LENGTH_MM_MAX)?;
        within("plate.tilt_deg", self.tilt_deg, -85.0, 85.0)?;
        match &self.pattern {
            Pattern::RandomDots(random) => random.check()?,
            Pattern::Grid(grid) => grid.check()?,
            Pattern::Image(image) => image.check()?,
        }
        let [x_mm, y_mm] = self.half_extent_mm();
        let [a, b] = self.pose().slope;
        let nearest_mm = self.distance_mm - a.abs() * x_mm - b.abs() * y_mm;
        if nearest_mm <= 0.0 {
            let value = format!("{}, which puts an edge at z = {nearest_mm} mm", self.tilt_deg);
            return Err(ValueError::new(
                "plate.tilt_deg",
                value,
                "such that all of the plate must lie before the lens",
            ));
        }
        Ok(())
    }

    /// How far from the axis in x and y the centres of dots may lie.
    fn half_extent_mm(&self) -> [f64; 2] {
        match &self.pattern {
            Pattern::RandomDots(random) => [random.r_max_mm; 2],
            Pattern::Grid(grid) => {
                let [x_mm, y_mm] = grid.half_extent_mm();
                let [sx, sy] = self.pose().stretch();
                [x_mm / sx, y_mm / sy]
            }
            Pattern::Image(_) => [0.0; 2],
        }
    }

    /// The plate's dots in the order of their ids.
    pub(crate) fn dots(&self, seed: u64) -> Result<Vec<Dot>, PackingError> {
        let pose = self.pose();
        let dot = |([x_mm, y_mm], diameter_mm): ([f64; 2], f64)| Dot {
            centre_mm: pose.at(x_mm, y_mm),
            normal: pose.normal(),
            diameter_mm,
        };
        Ok(match &self.pattern {
            Pattern::RandomDots(random) => {
                let centres_mm = random.centres_mm(pose.stretch(), seed)?;
                centres_mm.into_iter().map(|centre_mm| dot((centre_mm, random.diameter_mm))).collect()
            }
            Pattern::Grid(grid) => grid.places_mm(pose.stretch()).into_iter().map(dot).collect(),
            Pattern::Image(_) => Vec::new(),
        })
    }
}

impl DotGrid {
    fn check(&self) -> Result<(), ValueError> {
        for (key, count) in [("plate.rows", self.rows), ("plate.columns", self.columns)] {
            if count == 0 {
                return Err(ValueError::new(key, count, "at least 1"));
            }
        }
        positive("plate.diameter_mm", self.diameter_mm, LENGTH_MM_MAX)?;
        within("plate.pitch_mm", self.pitch_mm, self.diameter_mm, LENGTH_MM_MAX)?;
        for (axis, centre_mm) in self.centre_mm.into_iter().enumerate() {
            within(&format!("plate.centre_mm[{axis}]"), centre_mm, -LENGTH_MM_MAX, LENGTH_MM_MAX)?;
        }
        within("plate.turn_deg", self.turn_deg, -360.0, 360.0)?;
        for (index, fiducial) in self.fiducials.iter().enumerate() {
            let sides = [("row", fiducial.row, self.rows), ("column", fiducial.column, self.columns)];
            for (name, place, count) in sides {
                if place >= count {
                    let key = format!("plate.fiducial[{index}].{name}");
                    return Err(ValueError::new(key, place, format!("0 to {}", count - 1)));
                }
            }
            if let Some(diameter_mm) = fiducial.diameter_mm {
                positive(&format!("plate.fiducial[{index}].diameter_mm"), diameter_mm, self.pitch_mm)?;
            }
        }
        Ok(())
    }

    /// Distance on the plate from the middle of the grid to the last column and the last row.
    fn half_side_mm(&self) -> [f64; 2] {
        [self.columns, self.rows].map(|count| 0.5 * f64::from(count - 1) * self.pitch_mm)
    }

    /// Distance on the plate from the axis within which all centres lie.
    fn half_extent_mm(&self) -> [f64; 2] {
        let [x_mm, y_mm] = self.half_side_mm();
        let (sin, cos) = self.turn_deg.to_radians().sin_cos();
        [
            self.centre_mm[0].abs() + x_mm * cos.abs() + y_mm * sin.abs(),
            self.centre_mm[1].abs() + x_mm * sin.abs() + y_mm * cos.abs(),
        ]
    }

    /// x and y of the centres and the diameters, row by row.
    fn places_mm(&self, stretch: [f64; 2]) -> Vec<([f64; 2], f64)> {
        let [last_x_mm, last_y_mm] = self.half_side_mm();
        let (sin, cos) = self.turn_deg.to_radians().sin_cos();
        let place = |row: u32, column: u32| {
            let fiducial = self.fiducials.iter().find(|fiducial| (fiducial.row, fiducial.column) == (row, column));
            let diameter_mm = fiducial.map_or(Some(self.diameter_mm), |fiducial| fiducial.diameter_mm)?;
            let [x, y] = [f64::from(column) * self.pitch_mm - last_x_mm, f64::from(row) * self.pitch_mm - last_y_mm];
            let on_plate_mm = [self.centre_mm[0] + cos * x - sin * y, self.centre_mm[1] + sin * x + cos * y];
            Some(([on_plate_mm[0] / stretch[0], on_plate_mm[1] / stretch[1]], diameter_mm))
        };
        (0..self.rows).flat_map(|row| (0..self.columns).filter_map(move |column| place(row, column))).collect()
    }
}

impl ImagePattern {
    fn check(&self) -> Result<(), ValueError> {
        if self.image.is_empty() {
            return Err(ValueError::new("plate.image", "empty", "the path of a picture"));
        }
        positive("plate.width_mm", self.width_mm, LENGTH_MM_MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(tilt_deg: f64, tilt_axis: TiltAxis) -> Plate {
        let pattern =
            Pattern::Grid(DotGrid { rows: 2, columns: 3, pitch_mm: 2.0, diameter_mm: 1.0, ..DotGrid::default() });
        Plate { distance_mm: 300.0, tilt_deg, tilt_axis, pattern }
    }

    fn assert_close(found: [f64; 3], expected: [f64; 3]) {
        for (a, b) in found.into_iter().zip(expected) {
            assert!((a - b).abs() < 1e-12, "{found:?} is not {expected:?}");
        }
    }

    #[test]
    fn a_grid_runs_row_by_row_about_the_axis() {
        let dots = grid(0.0, TiltAxis::Y).dots(0).unwrap();
        assert_eq!(dots.len(), 6);
        assert_close(dots[0].centre_mm, [-2.0, -1.0, 300.0]);
        assert_close(dots[1].centre_mm, [0.0, -1.0, 300.0]);
        assert_close(dots[5].centre_mm, [2.0, 1.0, 300.0]);
        assert_close(dots[5].normal, [0.0, 0.0, -1.0]);
    }

    #[test]
    fn tilting_about_y_makes_z_grow_with_x() {
        let (sin, cos) = 60.0_f64.to_radians().sin_cos();
        let last = grid(60.0, TiltAxis::Y).dots(0).unwrap()[5];
        assert_close(last.centre_mm, [2.0 * cos, 1.0, 300.0 + 2.0 * sin]);
        assert_close(last.normal, [sin, 0.0, -cos]);
    }

    #[test]
    fn tilting_about_x_makes_z_grow_with_y() {
        let (sin, cos) = 30.0_f64.to_radians().sin_cos();
        let last = grid(30.0, TiltAxis::X).dots(0).unwrap()[5];
        assert_close(last.centre_mm, [2.0, cos, 300.0 + sin]);
        assert_close(last.normal, [0.0, sin, -cos]);
    }
}
