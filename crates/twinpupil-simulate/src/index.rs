//! Finding the few dots near a place among very many.

use crate::dot::Dot;

/// Dots by square cell of the x-y plane.
#[derive(Debug, Clone)]
pub(crate) struct DotIndex {
    origin_mm: [f64; 2],
    cell_mm: f64,
    columns: usize,
    rows: usize,
    cells: Vec<Vec<usize>>,
    /// Largest reach of a dot around its centre.
    reach_mm: f64,
    /// Between which distances all dots lie.
    pub(crate) z_mm: [f64; 2],
}

/// Cells along the longer side of the index.
const CELLS_MAX: f64 = 256.0;

impl DotIndex {
    pub(crate) fn new(dots: &[Dot]) -> Self {
        let range = |value: &dyn Fn(&Dot) -> f64| {
            let values = dots.iter().map(value);
            values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
        };
        let [x_min, x_max] = range(&|dot| dot.centre_mm[0]);
        let [y_min, y_max] = range(&|dot| dot.centre_mm[1]);
        let reach_mm = dots.iter().map(Dot::radius_mm).fold(0.0, f64::max);
        let near_mm = range(&|dot| dot.centre_mm[2] - dot.depth_mm())[0];
        let far_mm = range(&|dot| dot.centre_mm[2] + dot.depth_mm())[1];
        // One dot alone spans nothing; its cell still needs a width.
        let cell_mm = ((x_max - x_min).max(y_max - y_min) / CELLS_MAX).max(reach_mm).max(f64::MIN_POSITIVE);
        let count = |low: f64, high: f64| ((high - low) / cell_mm).max(0.0) as usize + 1;
        let (columns, rows) = (count(x_min, x_max), count(y_min, y_max));
        let mut index = Self {
            origin_mm: [x_min, y_min],
            cell_mm,
            columns,
            rows,
            cells: vec![Vec::new(); columns * rows],
            reach_mm,
            z_mm: [near_mm, far_mm],
        };
        for (id, dot) in dots.iter().enumerate() {
            let [x_mm, y_mm, _] = dot.centre_mm;
            let cell = index.row(y_mm) * columns + index.column(x_mm);
            index.cells[cell].push(id);
        }
        index
    }

    /// Replaces `found` by the dots that may reach into the rectangle from `low_mm` to `high_mm`, in no special order.
    pub(crate) fn find(&self, low_mm: [f64; 2], high_mm: [f64; 2], found: &mut Vec<usize>) {
        found.clear();
        let beside = |axis: usize, count: usize| {
            let end_mm = self.origin_mm[axis] + count as f64 * self.cell_mm;
            high_mm[axis] + self.reach_mm < self.origin_mm[axis] || low_mm[axis] - self.reach_mm > end_mm
        };
        if beside(0, self.columns) || beside(1, self.rows) {
            return;
        }
        let columns = self.column(low_mm[0] - self.reach_mm)..=self.column(high_mm[0] + self.reach_mm);
        for row in self.row(low_mm[1] - self.reach_mm)..=self.row(high_mm[1] + self.reach_mm) {
            for column in columns.clone() {
                found.extend(&self.cells[row * self.columns + column]);
            }
        }
    }

    /// Places outside belong to the nearest column.
    fn column(&self, x_mm: f64) -> usize {
        (((x_mm - self.origin_mm[0]) / self.cell_mm) as usize).min(self.columns - 1)
    }

    /// Places outside belong to the nearest row.
    fn row(&self, y_mm: f64) -> usize {
        (((y_mm - self.origin_mm[1]) / self.cell_mm) as usize).min(self.rows - 1)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn dot(x_mm: f64, y_mm: f64, diameter_mm: f64) -> Dot {
        Dot { centre_mm: [x_mm, y_mm, 300.0], normal: [0.0, 0.0, -1.0], diameter_mm }
    }

    #[test]
    fn nothing_and_one_dot_have_an_index_too() {
        let mut found = vec![7];
        DotIndex::new(&[]).find([-1.0; 2], [1.0; 2], &mut found);
        assert!(found.is_empty());
        let one = DotIndex::new(&[dot(1.0, 2.0, 0.5)]);
        one.find([0.0; 2], [3.0; 2], &mut found);
        assert_eq!((found.as_slice(), one.z_mm), (&[0][..], [300.0, 300.0]));
        one.find([5.0; 2], [6.0; 2], &mut found);
        assert!(found.is_empty());
    }

    proptest! {
        #[test]
        fn no_dot_that_reaches_in_is_missed(
            places in prop::collection::vec((-9.0..9.0_f64, -9.0..9.0_f64, 0.01..2.0_f64), 0..80),
            low in (-12.0..12.0_f64, -12.0..12.0_f64), size in 0.0..5.0_f64,
        ) {
            let dots: Vec<Dot> = places.iter().map(|&(x, y, d)| dot(x, y, d)).collect();
            let (low_mm, high_mm) = ([low.0, low.1], [low.0 + size, low.1 + size]);
            let mut found = Vec::new();
            DotIndex::new(&dots).find(low_mm, high_mm, &mut found);
            for (id, dot) in dots.iter().enumerate() {
                let reaches = |axis: usize| {
                    let (centre, radius) = (dot.centre_mm[axis], dot.radius_mm());
                    centre + radius >= low_mm[axis] && centre - radius <= high_mm[axis]
                };
                prop_assert!(!(reaches(0) && reaches(1)) || found.contains(&id));
            }
        }
    }
}
