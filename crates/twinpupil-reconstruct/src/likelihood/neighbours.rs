//! Which images touch.

/// Circles about images, and for each those that it meets.
#[derive(Debug, Clone, Default)]
pub(crate) struct Neighbours {
    /// Where the list of every circle begins in `others`.
    starts: Vec<u32>,
    others: Vec<u32>,
    pairs: Vec<[u32; 2]>,
    by_u: Vec<Circle>,
}

/// The pixels that belong to an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Circle {
    pub(crate) index: u32,
    pub(crate) centre_px: [f64; 2],
    pub(crate) radius_px: f64,
}

impl Neighbours {
    /// Finds anew which of the circles meet, whose indices are below `count`.
    pub(crate) fn find(&mut self, circles: impl Iterator<Item = Circle>, count: usize) {
        let Self { pairs, by_u, .. } = self;
        by_u.clear();
        by_u.extend(circles);
        by_u.sort_unstable_by(|a, b| a.centre_px[0].total_cmp(&b.centre_px[0]).then(a.index.cmp(&b.index)));
        let widest_px = by_u.iter().map(|circle| circle.radius_px).fold(0.0, f64::max);
        pairs.clear();
        for (place, circle) in by_u.iter().enumerate() {
            for other in &by_u[place + 1..] {
                let reach_px = circle.radius_px + other.radius_px;
                let [du, dv] = [0, 1].map(|axis| other.centre_px[axis] - circle.centre_px[axis]);
                if du > circle.radius_px + widest_px {
                    break;
                }
                if du * du + dv * dv < reach_px * reach_px {
                    pairs.push([circle.index, other.index]);
                }
            }
        }
        self.list(count);
    }

    /// Sorts the pairs into a list for every circle.
    fn list(&mut self, count: usize) {
        let Self { starts, others, pairs, .. } = self;
        starts.clear();
        starts.resize(count + 1, 0);
        for index in pairs.iter().flatten() {
            starts[*index as usize + 1] += 1;
        }
        for index in 0..count {
            starts[index + 1] += starts[index];
        }
        others.clear();
        others.resize(2 * pairs.len(), 0);
        for [a, b] in pairs.iter() {
            for (own, other) in [(*a, *b), (*b, *a)] {
                // Lists are filled from their starts, which are put back below.
                others[starts[own as usize] as usize] = other;
                starts[own as usize] += 1;
            }
        }
        starts.copy_within(..count, 1);
        starts[0] = 0;
        for index in 0..count {
            others[starts[index] as usize..starts[index + 1] as usize].sort_unstable();
        }
    }

    /// The circles that a circle meets, in the order of their indices.
    pub(crate) fn of(&self, index: usize) -> &[u32] {
        &self.others[self.starts[index] as usize..self.starts[index + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn circles_meet_that_overlap() {
        let circle = |index, u_px, radius_px| Circle { index, centre_px: [u_px, 1.0], radius_px };
        let mut neighbours = Neighbours::default();
        for _ in 0..2 {
            let circles = [circle(4, 10.0, 2.0), circle(0, 0.0, 3.0), circle(2, 5.0, 2.5), circle(1, 14.5, 3.0)];
            neighbours.find(circles.into_iter(), 5);
            let lists: Vec<&[u32]> = (0..5).map(|index| neighbours.of(index)).collect();
            assert_eq!(lists, [&[2][..], &[4], &[0], &[], &[1]]);
        }
    }
}
