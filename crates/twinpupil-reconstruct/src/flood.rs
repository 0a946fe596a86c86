//! Flooding from the summits down: which pixels belong to which summit.

/// Basins of a surface: every pixel above the floor belongs to one summit.
#[derive(Debug, Clone)]
pub(crate) struct Basins {
    /// Basin of every pixel, or [`NONE`].
    pub(crate) labels: Vec<u32>,
    /// Number of basins.
    pub(crate) count: usize,
}

/// Label of a pixel below the floor.
pub(crate) const NONE: u32 = u32::MAX;

/// What makes a summit one of its own.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FloodRule {
    /// Pixels at or below this value belong to no basin.
    pub(crate) floor: f32,
    /// Two summits are one if the saddle between them is higher than this share of the lower one.
    pub(crate) saddle: f32,
    /// A summit with fewer pixels above the saddle is none.
    pub(crate) pixels_min: u32,
}

/// Levels into which values are sorted; finer steps do not change which summit a pixel flows to.
const LEVELS: usize = 4096;

/// Divides `surface` (row by row) into basins.
///
/// Pixels are taken from the highest down. One without labelled neighbours opens a basin, one with a single basin
/// beside it joins that, and where two meet they become one unless both stand out above the saddle (the *dynamics* of
/// the lower summit).
pub(crate) fn flood(surface: &[f32], columns: usize, rule: FloodRule) -> Basins {
    let mut labels = vec![NONE; surface.len()];
    let mut forest = Forest::default();
    for index in from_the_highest(surface, rule.floor) {
        let index = index as usize;
        let mut home = NONE;
        let mut home_height = f32::NEG_INFINITY;
        let mut last = NONE;
        for neighbour in Neighbours::of(index, columns, surface.len()) {
            let label = labels[neighbour];
            if label == NONE {
                continue;
            }
            let height = surface[neighbour];
            // Most neighbours carry the label of the one before.
            let basin = if label == last { home } else { forest.root(label) };
            last = label;
            if home == NONE || basin == home {
                (home, home_height) = (basin, home_height.max(height));
            } else if let Some(joined) = forest.meet(home, basin, surface[index], rule) {
                (home, home_height) = (joined, home_height.max(height));
            } else if height > home_height {
                (home, home_height) = (basin, height);
            } else {
                last = NONE;
            }
        }
        if home == NONE {
            home = forest.open(surface[index]);
        }
        forest.pixels[home as usize] += 1;
        labels[index] = home;
    }
    forest.number(labels)
}

/// Indices of the pixels above the floor, highest first.
fn from_the_highest(surface: &[f32], floor: f32) -> Vec<u32> {
    let highest = surface.iter().copied().fold(floor, f32::max);
    if highest <= floor {
        return Vec::new();
    }
    let scale = (LEVELS - 1) as f32 / (highest - floor);
    let level = |value: f32| LEVELS - 1 - (((value - floor) * scale) as usize).min(LEVELS - 1);
    let above: Vec<u32> = (0_u32..).zip(surface).filter(|(_, value)| **value > floor).map(|(i, _)| i).collect();
    let mut starts = vec![0_u32; LEVELS + 1];
    for &index in &above {
        starts[level(surface[index as usize]) + 1] += 1;
    }
    for k in 0..LEVELS {
        starts[k + 1] += starts[k];
    }
    let mut order = vec![0; above.len()];
    for &index in &above {
        let place = &mut starts[level(surface[index as usize])];
        order[*place as usize] = index;
        *place += 1;
    }
    order
}

/// The up to eight pixels around one.
struct Neighbours {
    index: usize,
    offsets: &'static [(isize, isize)],
    columns: isize,
    /// On which sides there are neighbours at all.
    left: bool,
    right: bool,
    above: bool,
    below: bool,
}

const AROUND: [(isize, isize); 8] = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];

impl Neighbours {
    fn of(index: usize, columns: usize, pixels: usize) -> Self {
        let column = index % columns;
        Self {
            index,
            offsets: &AROUND,
            columns: columns as isize,
            left: column > 0,
            right: column + 1 < columns,
            above: index >= columns,
            below: index + columns < pixels,
        }
    }
}

impl Iterator for Neighbours {
    type Item = usize;

    fn next(&mut self) -> Option<usize> {
        while let Some((&(right, down), rest)) = self.offsets.split_first() {
            self.offsets = rest;
            let exists = (right >= 0 || self.left)
                && (right <= 0 || self.right)
                && (down >= 0 || self.above)
                && (down <= 0 || self.below);
            if exists {
                return Some(self.index.wrapping_add_signed(down * self.columns + right));
            }
        }
        None
    }
}

/// Basins while they grow, as a union–find forest.
#[derive(Debug, Default)]
struct Forest {
    parent: Vec<u32>,
    summit: Vec<f32>,
    pixels: Vec<u32>,
}

impl Forest {
    fn open(&mut self, summit: f32) -> u32 {
        let basin = self.parent.len() as u32;
        self.parent.push(basin);
        self.summit.push(summit);
        self.pixels.push(0);
        basin
    }

    fn root(&mut self, mut basin: u32) -> u32 {
        while self.parent[basin as usize] != basin {
            let above = self.parent[self.parent[basin as usize] as usize];
            self.parent[basin as usize] = above;
            basin = above;
        }
        basin
    }

    /// Joins two basins that meet at `level`, or keeps them apart if the lower one stands out.
    fn meet(&mut self, a: u32, b: u32, level: f32, rule: FloodRule) -> Option<u32> {
        let (high, low) = if self.summit[a as usize] >= self.summit[b as usize] { (a, b) } else { (b, a) };
        let stands_out = level < rule.saddle * self.summit[low as usize];
        let pixels = self.pixels[low as usize].min(self.pixels[high as usize]);
        if stands_out && pixels >= rule.pixels_min {
            return None;
        }
        self.parent[low as usize] = high;
        self.pixels[high as usize] += self.pixels[low as usize];
        Some(high)
    }

    /// Final labels 0, 1, … in the order in which pixels name them.
    fn number(mut self, mut labels: Vec<u32>) -> Basins {
        let mut numbers = vec![NONE; self.parent.len()];
        let mut count = 0;
        for label in labels.iter_mut().filter(|label| **label != NONE) {
            let root = self.root(*label) as usize;
            if numbers[root] == NONE {
                numbers[root] = count;
                count += 1;
            }
            *label = numbers[root];
        }
        Basins { labels, count: count as usize }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULE: FloodRule = FloodRule { floor: 0.5, saddle: 0.7, pixels_min: 1 };

    #[test]
    fn two_peaks_with_a_deep_saddle_stay_apart() {
        let surface = [0.0, 4.0, 9.0, 4.0, 8.0, 3.0, 0.0];
        let basins = flood(&surface, 7, RULE);
        assert_eq!(basins.labels, [NONE, 0, 0, 0, 1, 1, NONE]);
        assert_eq!(basins.count, 2);
    }

    #[test]
    fn two_peaks_with_a_high_saddle_are_one() {
        let basins = flood(&[1.0, 9.0, 7.0, 8.0, 1.0], 5, RULE);
        assert_eq!((basins.count, basins.labels), (1, vec![0; 5]));
    }

    #[test]
    fn a_speck_is_no_summit() {
        let basins = flood(&[9.0, 9.0, 9.0, 2.0, 5.0, 2.0], 6, FloodRule { pixels_min: 2, ..RULE });
        assert_eq!(basins.count, 1);
    }

    #[test]
    fn diagonal_pixels_touch() {
        assert_eq!(flood(&[5.0, 0.0, 0.0, 5.0], 2, RULE).count, 1);
    }

    #[test]
    fn nothing_above_the_floor_is_no_basin() {
        assert_eq!(flood(&[0.1; 9], 3, RULE).count, 0);
    }
}
