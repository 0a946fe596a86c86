//! Where the light of a feature lies: a round window, and the features whose windows it overlaps.

use std::ops::Range;

use crate::cells::Cells;

/// Where the light of a feature lies, pixels of the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Disc {
    pub(crate) centre: [f64; 2],
    /// Distance from the centre to the farthest pixel of the outline.
    pub(crate) extent: f64,
    /// Radius of the window that holds all its light.
    pub(crate) radius: f64,
}

impl Disc {
    /// Columns of a row between which its window lies, if it reaches there.
    #[inline]
    pub(crate) fn chord(&self, row: f64) -> Option<[f64; 2]> {
        let half2 = self.radius * self.radius - (row - self.centre[1]).powi(2);
        (half2 > 0.0).then(|| {
            let half = half2.sqrt();
            [self.centre[0] - half, self.centre[0] + half]
        })
    }
}

/// A round window, cut off alike on both sides where it leaves the plane, so that it stays symmetric.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Window {
    pub(crate) centre: [f64; 2],
    radius: f64,
    pub(crate) half_width: f64,
    pub(crate) half_height: f64,
}

/// Pixels of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Span {
    pub(crate) row: usize,
    /// First column, and the one behind the last.
    pub(crate) first: usize,
    pub(crate) end: usize,
}

impl Window {
    /// Of a radius about a centre on a plane of so many columns and rows; `None` if the centre lies outside.
    pub(crate) fn about(size: [usize; 2], centre: [f64; 2], radius: f64) -> Option<Self> {
        let last = size.map(|count| (count - 1) as f64);
        // Half sides that keep both a pixel and its mirror image inside.
        let half = |axis: usize| radius.min(centre[axis]).min(last[axis] - centre[axis]);
        let (half_width, half_height) = (half(0), half(1));
        (half_width >= 0.0 && half_height >= 0.0).then_some(Self { centre, radius, half_width, half_height })
    }

    /// Whether it leaves the plane.
    pub(crate) fn trimmed(&self) -> bool {
        self.half_width < self.radius || self.half_height < self.radius
    }

    /// All rows that it meets.
    pub(crate) fn rows(&self) -> Range<usize> {
        round_up(self.centre[1] - self.half_height)..(self.centre[1] + self.half_height) as usize + 1
    }

    /// All columns that it meets.
    pub(crate) fn columns(&self) -> Range<usize> {
        round_up(self.centre[0] - self.half_width)..(self.centre[0] + self.half_width) as usize + 1
    }

    /// Its rows, from top to bottom.
    pub(crate) fn spans(self) -> impl Iterator<Item = Span> {
        let [c, r] = self.centre;
        self.rows().filter_map(move |row| {
            let dr = row as f64 - r;
            let chord = (self.radius * self.radius - dr * dr).max(0.0).sqrt().min(self.half_width);
            let (first, end) = (round_up(c - chord), (c + chord) as usize + 1);
            (end > first).then_some(Span { row, first, end })
        })
    }
}

/// The first pixel at a position or behind it.
#[inline]
pub(crate) fn round_up(position: f64) -> usize {
    let whole = position as usize;
    whole + usize::from((whole as f64) < position)
}

/// Neighbours that share light with a feature, at most: the nearest.
const NEIGHBOURS_MAX: usize = 6;

/// For every disc, the discs whose windows overlap its own; its buffers are used again from plane to plane.
#[derive(Debug, Clone, Default)]
pub(crate) struct Neighbours {
    cells: Cells,
    /// The neighbours of all discs, nearest first.
    members: Vec<u32>,
    /// Where those of every disc end.
    ends: Vec<u32>,
    /// Square of the distance, and index, of all that overlap one disc.
    near: Vec<(f64, u32)>,
}

impl Neighbours {
    /// Finds the neighbours of all discs.
    pub(crate) fn find(&mut self, discs: &[Disc]) {
        const CROWD: f64 = 1.5;
        let Self { cells, members, ends, near } = self;
        members.clear();
        ends.clear();
        cells.fill(discs.iter().map(|disc| disc.centre), CROWD);
        let largest = discs.iter().map(|disc| disc.radius).fold(0.0, f64::max);
        for (index, disc) in (0..).zip(discs) {
            let reach = disc.radius + largest;
            let [columns, rows] =
                [0, 1].map(|axis| [-reach, reach].map(|reach| cells.cell(axis, disc.centre[axis] + reach)));
            near.clear();
            for &other in (rows[0]..=rows[1]).flat_map(|row| cells.row(row, columns[0], columns[1])) {
                let Disc { centre, radius, .. } = discs[other as usize];
                let distance2 = (centre[0] - disc.centre[0]).powi(2) + (centre[1] - disc.centre[1]).powi(2);
                if distance2 < (disc.radius + radius).powi(2) && other != index {
                    near.push((distance2, other));
                }
            }
            near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            members.extend(near.iter().take(NEIGHBOURS_MAX).map(|(_, other)| other));
            ends.push(members.len() as u32);
        }
    }

    /// The neighbours of a disc, nearest first.
    pub(crate) fn of(&self, disc: usize) -> &[u32] {
        let start = disc.checked_sub(1).map_or(0, |before| self.ends[before] as usize);
        &self.members[start..self.ends[disc] as usize]
    }

    /// Whether a disc has none.
    pub(crate) fn is_alone(&self, disc: usize) -> bool {
        self.of(disc).is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_those_that_overlap_nearest_first() {
        let disc = |k: u32| Disc {
            centre: [f64::from(k * 37 % 101), f64::from(k * 53 % 97)],
            extent: 2.0,
            radius: 3.0 + f64::from(k % 5),
        };
        let discs: Vec<Disc> = (0..80).map(disc).collect();
        let mut neighbours = Neighbours::default();
        neighbours.find(&discs);
        for (index, disc) in discs.iter().enumerate() {
            let distance =
                |other: usize| (discs[other].centre[0] - disc.centre[0]).hypot(discs[other].centre[1] - disc.centre[1]);
            let overlaps = |other: &usize| *other != index && distance(*other) < disc.radius + discs[*other].radius;
            let mut expected: Vec<usize> = (0..discs.len()).filter(overlaps).collect();
            expected.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)).then(a.cmp(b)));
            expected.truncate(NEIGHBOURS_MAX);
            assert_eq!(neighbours.of(index).iter().map(|other| *other as usize).collect::<Vec<_>>(), expected);
        }
        neighbours.find(&[]);
    }

    #[test]
    fn a_window_is_trimmed_on_both_sides() {
        let window = Window::about([50, 40], [3.2, 20.0], 9.0).expect("inside");
        assert!(window.trimmed());
        let columns: Vec<usize> = window.spans().map(|span| span.end - span.first).collect();
        assert_eq!((columns.len(), columns[8]), (17, 7));
        assert!(window.spans().all(|span| span.end <= 7));
        assert_eq!(Window::about([50, 40], [-1.0, 20.0], 9.0), None);
    }
}
