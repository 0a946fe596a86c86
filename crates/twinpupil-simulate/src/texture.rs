//! A picture on a plate.

use thiserror::Error;

use crate::plate::Pose;

/// Grey values of a picture, 0 black to 1 white, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    width_px: usize,
    height_px: usize,
    values: Vec<f32>,
}

/// Why values are not a picture.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PictureError {
    /// No pixels, or not as many values as pixels.
    #[error("the picture has {values} values where {width_px} × {height_px} pixels were expected")]
    WrongLength {
        /// Columns.
        width_px: usize,
        /// Rows.
        height_px: usize,
        /// Number of values.
        values: usize,
    },
    /// A value that is not a grey value.
    #[error("pixel {index} of the picture is {value}; legal: 0 to 1")]
    Value {
        /// Index of the pixel.
        index: usize,
        /// Its value.
        value: f32,
    },
}

impl Picture {
    /// A picture of `values` between 0 and 1, row by row.
    pub fn new(width_px: usize, height_px: usize, values: Vec<f32>) -> Result<Self, PictureError> {
        if values.is_empty() || width_px.checked_mul(height_px) != Some(values.len()) {
            return Err(PictureError::WrongLength { width_px, height_px, values: values.len() });
        }
        match values.iter().position(|value| !(0.0..=1.0).contains(value)) {
            Some(index) => Err(PictureError::Value { index, value: values[index] }),
            None => Ok(Self { width_px, height_px, values }),
        }
    }

    /// Columns.
    pub fn width_px(&self) -> usize {
        self.width_px
    }

    /// Rows.
    pub fn height_px(&self) -> usize {
        self.height_px
    }

    /// Value at a place, bilinear between the centres of pixels and constant beyond the outermost ones.
    ///
    /// `column` and `row` count from the outer corner of the first pixel.
    fn at(&self, column: f64, row: f64) -> f64 {
        let (left, fraction_x) = cell(column, self.width_px);
        let (top, fraction_y) = cell(row, self.height_px);
        let right = (left + 1).min(self.width_px - 1);
        let bottom = (top + 1).min(self.height_px - 1);
        let value = |column: usize, row: usize| f64::from(self.values[row * self.width_px + column]);
        let mix = |a: f64, b: f64, fraction: f64| a + fraction * (b - a);
        let upper = mix(value(left, top), value(right, top), fraction_x);
        let lower = mix(value(left, bottom), value(right, bottom), fraction_x);
        mix(upper, lower, fraction_y)
    }
}

/// The pixel whose centre lies before `position`, and how far beyond it that is, in pixels.
fn cell(position: f64, count: usize) -> (usize, f64) {
    let from_centre = (position - 0.5).clamp(0.0, (count - 1) as f64);
    let index = from_centre as usize;
    (index, from_centre - index as f64)
}

/// A picture that lies on a plate, centred on the axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    picture: Picture,
    pose: Pose,
    size_mm: [f64; 2],
}

impl Texture {
    /// `picture` on a plate at `pose`, `size_mm` wide and high on the plate.
    pub fn new(picture: Picture, pose: Pose, size_mm: [f64; 2]) -> Self {
        Self { picture, pose, size_mm }
    }

    /// Width and height on the plate, mm.
    pub fn size_mm(&self) -> [f64; 2] {
        self.size_mm
    }

    /// Where the plate stands and which way it leans.
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Distance of the picture's nearest corner, mm.
    pub fn nearest_mm(&self) -> f64 {
        self.pose.distance_mm - self.depth_mm()
    }

    /// Distance of the picture's farthest corner, mm.
    pub fn farthest_mm(&self) -> f64 {
        self.pose.distance_mm + self.depth_mm()
    }

    /// How far the picture reaches from the axis in x and y, mm.
    pub fn half_extent_mm(&self) -> [f64; 2] {
        let [sx, sy] = self.pose.stretch();
        [0.5 * self.size_mm[0] / sx, 0.5 * self.size_mm[1] / sy]
    }

    /// Grey value at the point of the plate over (x, y), or `None` beside the picture.
    pub fn at(&self, x_mm: f64, y_mm: f64) -> Option<f64> {
        let [half_x_mm, half_y_mm] = self.half_extent_mm();
        let (across, down) = (0.5 + 0.5 * x_mm / half_x_mm, 0.5 + 0.5 * y_mm / half_y_mm);
        let on_picture = (0.0..=1.0).contains(&across) && (0.0..=1.0).contains(&down);
        on_picture.then(|| self.picture.at(across * self.picture.width_px as f64, down * self.picture.height_px as f64))
    }

    fn depth_mm(&self) -> f64 {
        let [half_x_mm, half_y_mm] = self.half_extent_mm();
        (self.pose.slope[0] * half_x_mm).abs() + (self.pose.slope[1] * half_y_mm).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Picture {
        Picture::new(4, 2, vec![0.0, 0.25, 0.5, 0.75, 0.1, 0.35, 0.6, 0.85]).unwrap()
    }

    #[test]
    fn the_centres_of_pixels_keep_their_values() {
        let texture = Texture::new(ramp(), Pose { distance_mm: 300.0, slope: [0.0, 0.0] }, [8.0, 4.0]);
        assert_eq!(texture.at(-3.0, -1.0), Some(0.0));
        assert!((texture.at(1.0, 1.0).unwrap() - 0.6).abs() < 1e-7);
        assert!((texture.at(0.0, 0.0).unwrap() - 0.425).abs() < 1e-7);
        assert_eq!(texture.at(-4.0, -2.0), Some(0.0));
        assert_eq!(texture.at(4.1, 0.0), None);
        assert_eq!(texture.at(f64::NAN, 0.0), None);
    }

    #[test]
    fn a_tilted_picture_is_foreshortened() {
        let texture = Texture::new(ramp(), Pose { distance_mm: 300.0, slope: [3.0_f64.sqrt(), 0.0] }, [8.0, 4.0]);
        let [x_mm, y_mm] = texture.half_extent_mm();
        assert!((x_mm - 2.0).abs() < 1e-12 && (y_mm - 2.0).abs() < 1e-12);
        assert!((texture.nearest_mm() - (300.0 - 12.0_f64.sqrt())).abs() < 1e-12);
    }

    #[test]
    fn impossible_pictures_are_errors() {
        assert!(matches!(Picture::new(0, 0, vec![]), Err(PictureError::WrongLength { .. })));
        assert!(matches!(Picture::new(2, 2, vec![0.0; 3]), Err(PictureError::WrongLength { values: 3, .. })));
        assert!(matches!(Picture::new(1, 1, vec![f32::NAN]), Err(PictureError::Value { index: 0, .. })));
        assert!(matches!(Picture::new(1, 1, vec![1.5]), Err(PictureError::Value { .. })));
    }
}
