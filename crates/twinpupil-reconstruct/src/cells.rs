//! Points by square cells, so that those about a place are found without looking at all.

/// Cells along one side, at most: points that are strewn farther share the last ones.
const SIDE_MAX: usize = 1024;

/// Points in the cells of a grid over all of them; its buffers are used again from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Cells {
    low: [f64; 2],
    side: f64,
    counts: [usize; 2],
    /// Indices of the points, cell by cell; those of cell `k` stand from `starts[k]` to `starts[k + 1]`.
    members: Vec<u32>,
    starts: Vec<u32>,
    /// Cell of every point.
    homes: Vec<u32>,
}

impl Cells {
    /// Sorts points into cells that hold about so many of them each, where they are spread evenly.
    pub(crate) fn fill(&mut self, points: impl Iterator<Item = [f64; 2]> + Clone, crowd: f64) {
        let (mut low, mut high, mut count) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2], 0_usize);
        for point in points.clone() {
            for axis in 0..2 {
                (low[axis], high[axis]) = (low[axis].min(point[axis]), high[axis].max(point[axis]));
            }
            count += 1;
        }
        let size = [0, 1].map(|axis| (high[axis] - low[axis]).max(0.0));
        let share = crowd / (count.max(1)) as f64;
        // Points in a line have cells along it.
        let side = (size[0] * size[1] * share).sqrt().max(size[0].max(size[1]) * share);
        (self.low, self.side) = (low, if side > 0.0 { side } else { 1.0 });
        self.counts = size.map(|size| ((size / self.side) as usize + 1).min(SIDE_MAX));
        self.sort(points);
    }

    fn sort(&mut self, points: impl Iterator<Item = [f64; 2]>) {
        let mut homes = std::mem::take(&mut self.homes);
        homes.clear();
        homes.extend(points.map(|point| (self.cell(1, point[1]) * self.counts[0] + self.cell(0, point[0])) as u32));
        self.starts.clear();
        self.starts.resize(self.counts[0] * self.counts[1] + 1, 0);
        for &home in &homes {
            self.starts[home as usize] += 1;
        }
        let mut end = 0;
        for start in &mut self.starts {
            end += *start;
            *start = end;
        }
        self.members.clear();
        self.members.resize(homes.len(), 0);
        // From the last point to the first, so that those of a cell stand in their order.
        for (index, &home) in homes.iter().enumerate().rev() {
            let place = &mut self.starts[home as usize];
            *place -= 1;
            self.members[*place as usize] = index as u32;
        }
        self.homes = homes;
    }

    /// Number of cells along an axis.
    pub(crate) fn count(&self, axis: usize) -> usize {
        self.counts[axis]
    }

    /// Where the cell of an index begins along an axis.
    pub(crate) fn start(&self, axis: usize, cell: usize) -> f64 {
        self.low[axis] + cell as f64 * self.side
    }

    /// Index along an axis of the cell that holds a position, or of the nearest one.
    #[inline]
    pub(crate) fn cell(&self, axis: usize, position: f64) -> usize {
        (((position - self.low[axis]) / self.side) as usize).min(self.counts[axis].saturating_sub(1))
    }

    /// Points of neighbouring cells of a row, from column `first` to column `last`.
    #[inline]
    pub(crate) fn row(&self, row: usize, first: usize, last: usize) -> &[u32] {
        let start = row * self.counts[0];
        &self.members[self.starts[start + first] as usize..self.starts[start + last + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points() -> Vec<[f64; 2]> {
        (0..500_u32).map(|k| [f64::from(k * 37 % 101), 0.3 * f64::from(k * 53 % 97)]).collect()
    }

    #[test]
    fn every_point_is_in_its_cell_and_nowhere_else() {
        let points = points();
        let mut cells = Cells::default();
        for crowd in [0.5, 3.0, 1000.0] {
            cells.fill(points.iter().copied(), crowd);
            let mut seen = vec![0; points.len()];
            for (row, column) in
                (0..cells.count(1)).flat_map(|row| (0..cells.count(0)).map(move |column| (row, column)))
            {
                for &index in cells.row(row, column, column) {
                    let [x, y] = points[index as usize];
                    assert_eq!((cells.cell(0, x), cells.cell(1, y)), (column, row));
                    seen[index as usize] += 1;
                }
            }
            assert!(seen.iter().all(|times| *times == 1));
        }
    }

    #[test]
    fn points_in_one_place_or_in_a_line_or_none_have_cells() {
        let mut cells = Cells::default();
        cells.fill([[2.0, 3.0]; 4].into_iter(), 2.0);
        assert_eq!(cells.row(0, 0, 0), [0, 1, 2, 3]);
        cells.fill((0..100).map(|k| [f64::from(k), 7.0]), 2.0);
        assert!(cells.count(0) > 40 && cells.count(1) == 1);
        cells.fill(std::iter::empty(), 2.0);
        assert!(cells.row(0, 0, 0).is_empty());
        assert_eq!(cells.cell(0, 5.0), 0);
    }
}
