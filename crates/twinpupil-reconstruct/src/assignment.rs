//! The cheapest one-to-one assignment on a sparse graph.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// One possible pair and its cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Edge {
    pub(crate) right: u32,
    pub(crate) cost: f64,
}

/// The assignment and how sure it is.
#[derive(Debug, Clone)]
pub(crate) struct Assignment {
    /// Partner of every left node.
    pub(crate) partner: Vec<Option<u32>>,
    /// For every left node, the least that the total cost would grow if it or its partner had to choose otherwise
    /// among its other edges (a lower bound, from the reduced costs); infinite without another edge.
    pub(crate) margin: Vec<f64>,
}

/// Assigns left nodes to right nodes so that the sum of costs is least, where leaving a left node alone costs
/// `single_cost`. Edges of at least that cost are never used.
///
/// Successive shortest augmenting paths with node potentials: every search touches only the nodes that compete, so
/// thousands of features that are far apart cost next to nothing.
pub(crate) fn assign(edges: &[Vec<Edge>], right_count: usize, single_cost: f64) -> Assignment {
    let mut search = Search::new(edges, right_count, single_cost);
    for left in 0..edges.len() {
        search.augment(left as u32);
    }
    search.finish()
}

const NONE: u32 = u32::MAX;

struct Search<'a> {
    edges: &'a [Vec<Edge>],
    single_cost: f64,
    /// Dual prices: `reduced cost = cost − left_price − right_price ≥ 0`, and 0 on chosen edges.
    left_price: Vec<f64>,
    right_price: Vec<f64>,
    partner_of_left: Vec<u32>,
    partner_of_right: Vec<u32>,
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

impl<'a> Search<'a> {
    fn new(edges: &'a [Vec<Edge>], right_count: usize, single_cost: f64) -> Self {
        Self {
            edges,
            single_cost,
            left_price: vec![0.0; edges.len()],
            right_price: vec![0.0; right_count],
            partner_of_left: vec![NONE; edges.len()],
            partner_of_right: vec![NONE; right_count],
        }
    }

    /// Brings one more left node in, along the cheapest alternating path to a free right node or to someone who had
    /// better stay alone.
    fn augment(&mut self, start: u32) {
        let mut reached: Vec<Reach> = Vec::new();
        let mut heap = BinaryHeap::new();
        let mut settled = std::collections::BTreeMap::new();
        // Distance of a left node is that of its right partner, since chosen edges cost nothing.
        self.expand(start, 0.0, &mut heap);
        let end = loop {
            let Some(reach) = heap.pop() else { return };
            if reach.right == NONE {
                break reach;
            }
            if settled.contains_key(&reach.right) {
                continue;
            }
            settled.insert(reach.right, reach.left);
            let holder = self.partner_of_right[reach.right as usize];
            if holder == NONE {
                break reach;
            }
            reached.push(reach);
            self.expand(holder, reach.distance, &mut heap);
        };
        self.reprice(start, &reached, end.distance);
        self.flip(start, end, &settled);
    }

    fn expand(&self, left: u32, distance: f64, heap: &mut BinaryHeap<Reach>) {
        let price = self.left_price[left as usize];
        heap.push(Reach { distance: distance + self.single_cost - price, right: NONE, left });
        for edge in self.edges[left as usize].iter().filter(|edge| edge.cost < self.single_cost) {
            let reduced = edge.cost - price - self.right_price[edge.right as usize];
            heap.push(Reach { distance: distance + reduced, right: edge.right, left });
        }
    }

    fn reprice(&mut self, start: u32, reached: &[Reach], end_distance: f64) {
        self.left_price[start as usize] += end_distance;
        for reach in reached {
            let holder = self.partner_of_right[reach.right as usize];
            self.left_price[holder as usize] += end_distance - reach.distance;
            self.right_price[reach.right as usize] -= end_distance - reach.distance;
        }
    }

    fn flip(&mut self, start: u32, end: Reach, via: &std::collections::BTreeMap<u32, u32>) {
        let (mut left, mut right) = (end.left, end.right);
        loop {
            let before = std::mem::replace(&mut self.partner_of_left[left as usize], right);
            if right != NONE {
                self.partner_of_right[right as usize] = left;
            }
            if left == start {
                return;
            }
            right = before;
            left = via[&right];
        }
    }

    fn finish(self) -> Assignment {
        let mut margin = vec![f64::INFINITY; self.edges.len()];
        for (left, edges) in self.edges.iter().enumerate() {
            for edge in edges.iter().filter(|edge| edge.right != self.partner_of_left[left]) {
                let slack = edge.cost - self.left_price[left] - self.right_price[edge.right as usize];
                margin[left] = margin[left].min(slack);
                let holder = self.partner_of_right[edge.right as usize];
                if holder != NONE {
                    margin[holder as usize] = margin[holder as usize].min(slack);
                }
            }
        }
        let partner = self.partner_of_left.into_iter().map(|right| (right != NONE).then_some(right)).collect();
        Assignment { partner, margin }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SINGLE: f64 = 10.0;

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
        let assignment = assign(&edges, 2, SINGLE);
        assert_eq!(assignment.partner, [Some(1), Some(0)]);
    }

    #[test]
    fn a_pair_without_rivals_is_sure() {
        let assignment = assign(&[vec![Edge { right: 0, cost: 1.0 }], vec![]], 1, SINGLE);
        assert_eq!(assignment.partner, [Some(0), None]);
        assert_eq!(assignment.margin[0], f64::INFINITY);
    }

    #[test]
    fn equal_rivals_have_no_margin() {
        let both = vec![Edge { right: 0, cost: 1.0 }, Edge { right: 1, cost: 1.0 }];
        let assignment = assign(&[both.clone(), both], 2, SINGLE);
        assert_eq!(assignment.margin, [0.0, 0.0]);
    }

    proptest! {
        #[test]
        fn no_assignment_is_cheaper(costs in prop::collection::vec(prop::collection::vec(0.0..14.0_f64, 5), 1..6)) {
            let edges: Vec<Vec<Edge>> = costs
                .iter()
                .map(|row| (0..).zip(row).filter(|(_, c)| **c < 12.0).map(|(right, &cost)| Edge { right, cost }).collect())
                .collect();
            let assignment = assign(&edges, 5, SINGLE);
            let mut rights: Vec<u32> = assignment.partner.iter().flatten().copied().collect();
            rights.sort_unstable();
            rights.dedup();
            prop_assert_eq!(rights.len(), assignment.partner.iter().flatten().count());
            let best = exhaustive(&edges, 0, &mut Vec::new());
            prop_assert!((cost(&edges, &assignment.partner) - best).abs() < 1e-9);
        }
    }
}
