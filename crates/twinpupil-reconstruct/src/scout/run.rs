//! Runs of pixels above a limit, and how they hang together.

use crate::scout::light::{BLOCK, RowAgainst};

/// Neighbouring pixels of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Run {
    pub(crate) row: u32,
    /// First column, and the one behind the last.
    pub(crate) first: u32,
    pub(crate) end: u32,
    /// Where the contrast of its first pixel stands among those that were kept.
    pub(crate) at: u32,
    /// The highest contrast that two neighbouring pixels both reach: a single hot pixel has none.
    pub(crate) peak: f32,
}

impl Run {
    pub(crate) fn pixels(&self) -> u32 {
        self.end - self.first
    }

    /// The part of it between two columns.
    pub(crate) fn part(&self, first: u32, end: u32) -> Self {
        Self { first, end, at: self.at + first - self.first, ..*self }
    }
}

/// Calls `found` with the first column of every run of a row above its limit and the column behind it.
pub(crate) fn runs_of_row(row: RowAgainst<'_>, masks: &mut Vec<u16>, mut found: impl FnMut(usize, usize)) {
    row.masks(masks);
    let mut open = None;
    let mut block = 0;
    while let Some(&mask) = masks.get(block) {
        let first = block * BLOCK;
        match (mask, open) {
            // Most blocks are ground.
            (0, None) => {
                block += masks[block..].iter().position(|mask| *mask != 0).unwrap_or(masks.len());
                continue;
            }
            (u16::MAX, Some(_)) => {}
            _ => follow(u32::from(mask), first, &mut open, &mut found),
        }
        block += 1;
    }
    if let Some(start) = open {
        found(start, masks.len() * BLOCK);
    }
}

/// Follows the runs through a block from column `first` on.
fn follow(mask: u32, first: usize, open: &mut Option<usize>, found: &mut impl FnMut(usize, usize)) {
    let mut at = 0;
    while at < BLOCK {
        let rest = mask >> at;
        match *open {
            Some(start) => {
                at += rest.trailing_ones() as usize;
                if at < BLOCK {
                    found(start, first + at);
                    *open = None;
                }
            }
            None => {
                at += rest.trailing_zeros() as usize;
                if at < BLOCK {
                    *open = Some(first + at);
                }
            }
        }
    }
}

/// Which runs touch each other: a union–find forest over runs.
#[derive(Debug, Clone, Default)]
pub(crate) struct Forest {
    parent: Vec<u32>,
    /// Number of the tree that a root stands for.
    number: Vec<u32>,
    trees: usize,
}

impl Forest {
    /// Joins runs, in the order of rows and columns, that touch at a side or a corner.
    pub(crate) fn grow(&mut self, runs: &[Run]) {
        self.parent.clear();
        self.parent.extend(0..runs.len() as u32);
        // Runs of the row above that may touch the next run.
        let (mut above, mut above_end, mut row_start) = (0, 0, 0);
        for (index, run) in runs.iter().enumerate() {
            if run.row != runs[row_start].row {
                let adjacent = run.row == runs[row_start].row + 1;
                (above, above_end, row_start) = (if adjacent { row_start } else { index }, index, index);
            }
            while above < above_end && runs[above].end < run.first {
                above += 1;
            }
            let mut touching = above;
            while touching < above_end && runs[touching].first <= run.end {
                self.join(touching as u32, index as u32);
                touching += 1;
            }
        }
        self.number.clear();
        self.number.resize(runs.len(), 0);
        self.trees = 0;
        for index in 0..runs.len() {
            // Roots come before the runs that hang on them.
            let root = self.root(index as u32) as usize;
            if root == index {
                self.number[index] = self.trees as u32;
                self.trees += 1;
            } else {
                self.number[index] = self.number[root];
            }
        }
    }

    /// Number of trees.
    pub(crate) fn trees(&self) -> usize {
        self.trees
    }

    /// The tree of every run, numbered by their first runs.
    pub(crate) fn numbers(&self) -> &[u32] {
        &self.number
    }

    fn root(&mut self, mut index: u32) -> u32 {
        while self.parent[index as usize] != index {
            let above = self.parent[self.parent[index as usize] as usize];
            self.parent[index as usize] = above;
            index = above;
        }
        index
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs of a picture in which `#` is above the limit.
    fn runs(picture: &[&str]) -> Vec<Run> {
        let mut runs = Vec::new();
        let mut masks = Vec::new();
        for (row, text) in (0..).zip(picture) {
            let line: Vec<f32> = text.chars().map(|c| if c == '#' { 2.0 } else { 0.0 }).collect();
            runs_of_row(RowAgainst::Field { line: &line, limit: 1.0 }, &mut masks, |first, end| {
                runs.push(Run { row, first: first as u32, end: end as u32, at: 0, peak: 2.0 });
            });
        }
        runs
    }

    fn numbers(picture: &[&str]) -> Vec<u32> {
        let mut forest = Forest::default();
        forest.grow(&runs(picture));
        forest.numbers().to_vec()
    }

    #[test]
    fn runs_go_on_from_block_to_block() {
        let text = "..####################################.#..............................####";
        let found: Vec<_> = runs(&[text]).iter().map(|run| (run.first as usize, run.end as usize)).collect();
        assert_eq!(found, [(2, 38), (39, 40), (70, 74)]);
        assert_eq!(runs(&[&"#".repeat(48)]).len(), 1);
        assert!(runs(&[&".".repeat(50)]).is_empty());
    }

    #[test]
    fn corners_touch() {
        assert_eq!(numbers(&["#..", ".#.", "..#"]), [0, 0, 0]);
        assert_eq!(numbers(&["#..#", "....", "#..#"]), [0, 1, 2, 3]);
    }

    #[test]
    fn arms_that_meet_are_one() {
        assert_eq!(numbers(&["#.#.#", "#.#.#", "#####"]), [0; 7]);
        assert_eq!(numbers(&["#####", "#...#", "#.#.#", "#...#", "#####"]), [0, 0, 0, 0, 1, 0, 0, 0, 0]);
    }
}
