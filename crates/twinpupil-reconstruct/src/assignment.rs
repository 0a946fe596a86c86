//! The cheapest one-to-one assignment on a sparse graph.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// One possible pair and its cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Edge {
    pub(crate) right: u32,
    pub(crate) cost: f64,
}

/// The edges of all left nodes, one after another.
#[derive(Debug, Clone, Default)]
pub(crate) struct Edges {
    edges: Vec<Edge>,
    /// Where the edges of every left node end.
    ends: Vec<u32>,
}

impl Edges {
    pub(crate) fn clear(&mut self) {
        self.edges.clear();
        self.ends.clear();
    }

    /// Adds the edges of the next left node.
    pub(crate) fn push(&mut self, edges: impl Iterator<Item = Edge>) {
        self.edges.extend(edges);
        self.ends.push(self.edges.len() as u32);
    }

    /// Number of left nodes.
    pub(crate) fn count(&self) -> usize {
        self.ends.len()
    }

    /// The edges of a left node.
    pub(crate) fn of(&self, left: usize) -> &[Edge] {
        let start = left.checked_sub(1).map_or(0, |before| self.ends[before] as usize);
        &self.edges[start..self.ends[left] as usize]
    }
}

const NONE: u32 = u32::MAX;

/// Assigns left nodes to right nodes so that the sum of costs is least; its buffers are used again from frame to frame.
///
/// Successive shortest augmenting paths with node potentials: every search touches only the nodes that compete, so
/// thousands of features that are far apart cost next to nothing.
#[derive(Debug, Clone, Default)]
pub(crate) struct Assignment {
    /// Cost of leaving a left node alone.
    single_cost: f64,
    /// Dual prices: `reduced cost = cost − left_price − right_price ≥ 0`, and 0 on chosen edges.
    left_price: Vec<f64>,
    right_price: Vec<f64>,
    partner_of_left: Vec<u32>,
    partner_of_right: Vec<u32>,
    margins: Vec<f64>,
    heap: BinaryHeap<Reach>,
    reached: Vec<Reach>,
    /// For every right node that the search has settled, the left node that it was reached from.
    via: Vec<u32>,
}

/// A right node within reach of the search, or the choice of a left node to stay alone.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Reach {
    distance: f64,
    right: u32,
    left: u32,
}

impl Eq for Reach {}

impl Ord for Reach {
    /// Nearest first in a max-heap; ties by index, so that the result never depends on the order of insertion.
    fn cmp(&self, other: &Self) -> Ordering {
        let key = |reach: &Self| (reach.right, reach.left);
        other.distance.total_cmp(&self.distance).then_with(|| key(other).cmp(&key(self)))
    }
}

impl PartialOrd for Reach {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Assignment {
    /// Finds the cheapest assignment, where leaving a left node alone costs `single_cost`. Edges of at least that cost
    /// are never used.
    pub(crate) fn solve(&mut self, edges: &Edges, right_count: usize, single_cost: f64) {
        self.single_cost = single_cost;
        refill(&mut self.left_price, edges.count(), 0.0);
        refill(&mut self.right_price, right_count, 0.0);
        refill(&mut self.partner_of_left, edges.count(), NONE);
        refill(&mut self.partner_of_right, right_count, NONE);
        refill(&mut self.via, right_count, NONE);
        for left in 0..edges.count() {
            self.augment(edges, left as u32);
        }
        self.measure_margins(edges);
    }

    /// Partner of a left node.
    pub(crate) fn partner(&self, left: usize) -> Option<u32> {
        Some(self.partner_of_left[left]).filter(|right| *right != NONE)
    }

    /// The least that the total cost would grow if a left node or its partner had to choose otherwise among its other
    /// edges (a lower bound, from the reduced costs); infinite without another edge.
    pub(crate) fn margin(&self, left: usize) -> f64 {
        self.margins[left]
    }

    /// Brings one more left node in, along the cheapest alternating path to a free right node or to someone who had
    /// better stay alone.
    fn augment(&mut self, edges: &Edges, start: u32) {
        // Most nodes can have what they like best.
        let best = self.choices(edges, start, 0.0).max().filter(|best| self.is_free(best.right));
        if let Some(best) = best {
            self.left_price[start as usize] += best.distance;
            self.give(start, best.right);
            return;
        }
        self.reached.clear();
        self.heap.clear();
        // Distance of a left node is that of its right partner, since chosen edges cost nothing.
        self.expand(edges, start, 0.0);
        let end = loop {
            let Some(reach) = self.heap.pop() else { return };
            if reach.right == NONE {
                break reach;
            }
            if self.via[reach.right as usize] != NONE {
                continue;
            }
            self.via[reach.right as usize] = reach.left;
            if self.is_free(reach.right) {
                break reach;
            }
            self.reached.push(reach);
            self.expand(edges, self.partner_of_right[reach.right as usize], reach.distance);
        };
        self.reprice(start, end.distance);
        self.flip(start, end);
        self.reached.iter().for_each(|reach| self.via[reach.right as usize] = NONE);
        if end.right != NONE {
            self.via[end.right as usize] = NONE;
        }
    }

    fn is_free(&self, right: u32) -> bool {
        right == NONE || self.partner_of_right[right as usize] == NONE
    }

    /// What a left node at a distance may choose.
    fn choices<'a>(&'a self, edges: &'a Edges, left: u32, distance: f64) -> impl Iterator<Item = Reach> + 'a {
        let price = self.left_price[left as usize];
        let alone = Reach { distance: distance + self.single_cost - price, right: NONE, left };
        let usable = edges.of(left as usize).iter().filter(|edge| edge.cost < self.single_cost);
        usable
            .map(move |edge| {
                let reduced = edge.cost - price - self.right_price[edge.right as usize];
                Reach { distance: distance + reduced, right: edge.right, left }
            })
            .chain(std::iter::once(alone))
    }

    fn expand(&mut self, edges: &Edges, left: u32, distance: f64) {
        let mut heap = std::mem::take(&mut self.heap);
        heap.extend(self.choices(edges, left, distance));
        self.heap = heap;
    }

    fn reprice(&mut self, start: u32, end_distance: f64) {
        self.left_price[start as usize] += end_distance;
        for reach in &self.reached {
            let holder = self.partner_of_right[reach.right as usize];
            self.left_price[holder as usize] += end_distance - reach.distance;
            self.right_price[reach.right as usize] -= end_distance - reach.distance;
        }
    }

    fn flip(&mut self, start: u32, end: Reach) {
        let (mut left, mut right) = (end.left, end.right);
        loop {
            let before = self.partner_of_left[left as usize];
            self.give(left, right);
            if left == start {
                return;
            }
            right = before;
            left = self.via[right as usize];
        }
    }

    fn give(&mut self, left: u32, right: u32) {
        self.partner_of_left[left as usize] = right;
        if right != NONE {
            self.partner_of_right[right as usize] = left;
        }
    }

    fn measure_margins(&mut self, edges: &Edges) {
        refill(&mut self.margins, edges.count(), f64::INFINITY);
        for left in 0..edges.count() {
            for edge in edges.of(left).iter().filter(|edge| edge.right != self.partner_of_left[left]) {
                let slack = edge.cost - self.left_price[left] - self.right_price[edge.right as usize];
                self.margins[left] = self.margins[left].min(slack);
                let holder = self.partner_of_right[edge.right as usize];
                if holder != NONE {
                    self.margins[holder as usize] = self.margins[holder as usize].min(slack);
                }
            }
        }
    }
}

fn refill<T: Clone>(values: &mut Vec<T>, count: usize, value: T) {
    values.clear();
    values.resize(count, value);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SINGLE: f64 = 10.0;

    /// Partners and margins.
    fn assign(edges: &[Vec<Edge>], right_count: usize) -> (Vec<Option<u32>>, Vec<f64>) {
        let (mut list, mut assignment) = (Edges::default(), Assignment::default());
        edges.iter().for_each(|edges| list.push(edges.iter().copied()));
        // What was solved before leaves no trace.
        assignment.solve(&list, right_count + 3, 0.5 * SINGLE);
        assignment.solve(&list, right_count, SINGLE);
        (0..edges.len()).map(|left| (assignment.partner(left), assignment.margin(left))).unzip()
    }

    fn cost(edges: &[Vec<Edge>], partner: &[Option<u32>]) -> f64 {
        partner
            .iter()
            .enumerate()
            .map(|(left, right)| match right {
                Some(right) => edges[left].iter().find(|edge| edge.right == *right).expect("an edge").cost,
                None => SINGLE,
            })
            .sum()
    }

    /// The least cost by trying everything.
    fn exhaustive(edges: &[Vec<Edge>], left: usize, taken: &mut Vec<u32>) -> f64 {
        if left == edges.len() {
            return 0.0;
        }
        let mut best = SINGLE + exhaustive(edges, left + 1, taken);
        for edge in &edges[left] {
            if !taken.contains(&edge.right) {
                taken.push(edge.right);
                best = best.min(edge.cost + exhaustive(edges, left + 1, taken));
                taken.pop();
            }
        }
        best
    }

    #[test]
    fn greedy_would_be_wrong() {
        // Left 0 prefers right 0 a little, left 1 can only have right 0.
        let edges =
            [vec![Edge { right: 0, cost: 1.0 }, Edge { right: 1, cost: 2.0 }], vec![Edge { right: 0, cost: 1.5 }]];
        assert_eq!(assign(&edges, 2).0, [Some(1), Some(0)]);
    }

    #[test]
    fn a_pair_without_rivals_is_sure() {
        let (partners, margins) = assign(&[vec![Edge { right: 0, cost: 1.0 }], vec![]], 1);
        assert_eq!(partners, [Some(0), None]);
        assert_eq!(margins[0], f64::INFINITY);
    }

    #[test]
    fn equal_rivals_have_no_margin() {
        let both = vec![Edge { right: 0, cost: 1.0 }, Edge { right: 1, cost: 1.0 }];
        assert_eq!(assign(&[both.clone(), both], 2).1, [0.0, 0.0]);
    }

    proptest! {
        #[test]
        fn no_assignment_is_cheaper(costs in prop::collection::vec(prop::collection::vec(0.0..14.0_f64, 5), 1..6)) {
            let edges: Vec<Vec<Edge>> = costs
                .iter()
                .map(|row| (0..).zip(row).filter(|(_, c)| **c < 12.0).map(|(right, &cost)| Edge { right, cost }).collect())
                .collect();
            let (partners, _) = assign(&edges, 5);
            let mut rights: Vec<u32> = partners.iter().flatten().copied().collect();
            rights.sort_unstable();
            rights.dedup();
            prop_assert_eq!(rights.len(), partners.iter().flatten().count());
            let best = exhaustive(&edges, 0, &mut Vec::new());
            prop_assert!((cost(&edges, &partners) - best).abs() < 1e-9);
        }
    }
}
