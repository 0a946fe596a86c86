//! Rays as structures of arrays, the layout that vectorises.

/// Where rays start: image positions and the points of the pupil they are aimed at, slices of equal length.
#[derive(Debug, Clone, Copy)]
pub struct RayStarts<'a> {
    /// Upright image positions from the axis, mm.
    pub image_x_mm: &'a [f64],
    /// Upright image positions from the axis, mm.
    pub image_y_mm: &'a [f64],
    /// Pupil points in the unit disc: 1 is the pupil's outer radius.
    pub pupil_x: &'a [f64],
    /// Pupil points in the unit disc.
    pub pupil_y: &'a [f64],
}

impl RayStarts<'_> {
    /// Number of rays.
    ///
    /// # Panics
    ///
    /// If the slices differ in length.
    pub fn len(&self) -> usize {
        let count = self.image_x_mm.len();
        let others = [self.image_y_mm.len(), self.pupil_x.len(), self.pupil_y.len()];
        assert!(others == [count; 3], "the slices of RayStarts have equal lengths");
        count
    }

    /// Whether there are no rays.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The rays of an index range.
    pub(crate) fn slice(&self, range: std::ops::Range<usize>) -> Self {
        Self {
            image_x_mm: &self.image_x_mm[range.clone()],
            image_y_mm: &self.image_y_mm[range.clone()],
            pupil_x: &self.pupil_x[range.clone()],
            pupil_y: &self.pupil_y[range],
        }
    }
}

/// Rays in object space, as straight lines `x(z) = x_mm + slope_x · z`; buffers to be used again and again.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ObjectRays {
    /// Position in the front principal plane z = 0, mm.
    pub x_mm: Vec<f64>,
    /// Position in the front principal plane z = 0, mm.
    pub y_mm: Vec<f64>,
    /// dx/dz.
    pub slope_x: Vec<f64>,
    /// dy/dz.
    pub slope_y: Vec<f64>,
    /// Share in the irradiance of the image point: 0 for a lost ray, mean 1 over an unclipped pupil on the axis.
    pub weight: Vec<f64>,
}

impl ObjectRays {
    /// Number of rays.
    pub fn len(&self) -> usize {
        self.weight.len()
    }

    /// Whether there are no rays.
    pub fn is_empty(&self) -> bool {
        self.weight.is_empty()
    }

    /// Makes room for `count` rays; allocates only beyond the largest count so far.
    pub(crate) fn resize(&mut self, count: usize) {
        for values in [&mut self.x_mm, &mut self.y_mm, &mut self.slope_x, &mut self.slope_y, &mut self.weight] {
            values.resize(count, 0.0);
        }
    }
}

/// A circle across the axis in object space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// Centre, mm.
    pub x_mm: f64,
    /// Centre, mm.
    pub y_mm: f64,
    /// Radius, mm.
    pub radius_mm: f64,
}
