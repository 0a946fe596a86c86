//! Which images touch.

/// Circles about images, and for each those that it meets.
#[derive(Debug, Clone, Default)]
pub(crate) struct Neighbours {
    /// Where the list of every circle begins in `others`.
    starts: Vec<u32>,
    others: Vec<u32>,
    pairs: Vec<[u32; 2]>,
    by_u: Vec<Circle>,
    asked: Vec<Circle>,
    /// Those that the lists were made for.
    listed: Vec<Circle>,
}

/// The pixels that belong to an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Circle {
    pub(crate) index: u32,
    pub(crate) centre_px: [f64; 2],
    pub(crate) radius_px: f64,
}

/// Circles that are so near count as touching, px: lists then serve until one of them has moved or grown by half of that.
const SLACK_PX: f64 = 1.0;

impl Circle {
    /// Whether it lies in another that is wider by the half of the slack.
    fn is_still(&self, before: &Self) -> bool {
        let [du, dv] = [0, 1].map(|axis| self.centre_px[axis] - before.centre_px[axis]);
        let left_px = before.radius_px + 0.5 * SLACK_PX - self.radius_px;
        self.index == before.index && left_px >= 0.0 && du * du + dv * dv <= left_px * left_px
    }
}

impl Neighbours {
    /// Forgets all circles.
    pub(crate) fn clear(&mut self) {
        self.listed.clear();
    }

    /// Finds which of the circles meet, whose indices are below `count`.
    pub(crate) fn find(&mut self, circles: impl Iterator<Item = Circle>, count: usize) {
        self.asked.clear();
        self.asked.extend(circles);
        let is_known = self.asked.len() == self.listed.len()
            && self.starts.len() == count + 1
            && self.asked.iter().zip(&self.listed).all(|(asked, listed)| asked.is_still(listed));
        if !is_known {
            std::mem::swap(&mut self.asked, &mut self.listed);
            self.pair_up();
            self.list(count);
        }
    }

    fn pair_up(&mut self) {
        let Self { pairs, by_u, listed, .. } = self;
        by_u.clear();
        by_u.extend_from_slice(listed);
        by_u.sort_unstable_by(|a, b| a.centre_px[0].total_cmp(&b.centre_px[0]).then(a.index.cmp(&b.index)));
        let widest_px = by_u.iter().map(|circle| circle.radius_px).fold(0.0, f64::max);
        pairs.clear();
        for (place, circle) in by_u.iter().enumerate() {
            for other in &by_u[place + 1..] {
                let reach_px = circle.radius_px + other.radius_px + SLACK_PX;
                let [du, dv] = [0, 1].map(|axis| other.centre_px[axis] - circle.centre_px[axis]);
                if du > circle.radius_px + widest_px + SLACK_PX {
                    break;
                }
                if du * du + dv * dv < reach_px * reach_px {
                    pairs.push([circle.index, other.index]);
                }
            }
        }
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
            let circles = [circle(4, 20.0, 4.0), circle(0, 0.0, 6.0), circle(2, 10.0, 4.5), circle(1, 28.0, 5.0)];
            neighbours.find(circles.into_iter(), 5);
            let lists: Vec<&[u32]> = (0..5).map(|index| neighbours.of(index)).collect();
            assert_eq!(lists, [&[2][..], &[4], &[0], &[], &[1]]);
        }
    }
    #[test]
    fn circles_that_move_are_found_again() {
        let circle = |index, u_px| Circle { index, centre_px: [u_px, 1.0], radius_px: 5.0 };
        let mut neighbours = Neighbours::default();
        for (u_px, meets) in [(12.0, false), (11.8, false), (10.9, true), (11.3, true), (12.0, false)] {
            neighbours.find([circle(0, 0.0), circle(1, u_px)].into_iter(), 2);
            assert_eq!(!neighbours.of(1).is_empty(), meets, "{u_px}");
        }
    }
}
