//! Flooding from the summits down: which pixels belong to which summit.

/// Floods surfaces; its buffers are used again from one to the next.
///
/// Every pixel above the floor belongs to the basin of one summit.
#[derive(Debug, Clone, Default)]
pub(crate) struct Flood {
    /// Basin of every pixel, or [`NONE`].
    labels: Vec<u32>,
    forest: Forest,
    above: Vec<(u32, u8)>,
    order: Vec<u32>,
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
const LEVELS: usize = 256;

impl Flood {
    /// Divides `surface` (row by row) into basins and returns their number. Pixels on its rim follow the pixel beside
    /// them.
    ///
    /// Pixels are taken from the highest down. One without labelled neighbours opens a basin, one with a single basin
    /// beside it joins that, and where two meet they become one unless both stand out above the saddle (the *dynamics*
    /// of the lower summit).
    pub(crate) fn divide(&mut self, surface: &[f32], columns: usize, rule: FloodRule) -> usize {
        let Self { labels, forest, above, order } = self;
        labels.clear();
        labels.resize(surface.len(), NONE);
        forest.clear();
        sort_from_the_highest(surface, columns, rule.floor, above, order);
        for index in order.iter().map(|index| *index as usize) {
            let mut home = NONE;
            let mut last = NONE;
            let mut highest = (f32::NEG_INFINITY, NONE);
            for line in [index - columns - 1, index - 1, index + columns - 1] {
                let three: [u32; 3] = [labels[line], labels[line + 1], labels[line + 2]];
                for (place, label) in (line..).zip(three) {
                    if label == NONE {
                        continue;
                    }
                    if surface[place] > highest.0 {
                        highest = (surface[place], label);
                    }
                    // Most neighbours carry the label of the one before.
                    if label == last {
                        continue;
                    }
                    let basin = forest.root(label);
                    labels[place] = basin;
                    last = basin;
                    if home == NONE {
                        home = basin;
                    } else if basin != home {
                        home = forest.meet(home, basin, surface[index], rule);
                    }
                }
            }
            // On a border the pixel belongs to where its highest neighbour does, or one basin would creep round the
            // other.
            let own = if home == NONE { forest.open(surface[index]) } else { forest.root(highest.1) };
            forest.pixels[own as usize] += 1;
            labels[index] = own;
        }
        label_rim(labels, surface, columns, rule.floor);
        forest.number(labels)
    }

    /// Basin of every pixel of the surface that was divided last, counted from 0, or [`NONE`].
    pub(crate) fn labels(&self) -> &[u32] {
        &self.labels
    }
}

/// Gives the pixels on the rim the labels of their neighbours inside.
fn label_rim(labels: &mut [u32], surface: &[f32], columns: usize, floor: f32) {
    let rows = surface.len() / columns;
    if columns < 3 || rows < 3 {
        return;
    }
    let sides = (0..rows).flat_map(|row| [row * columns, row * columns + columns - 1]);
    let ends = (0..columns).flat_map(|column| [column, (rows - 1) * columns + column]);
    for index in sides.chain(ends).filter(|&index| surface[index] > floor) {
        let (column, row) = ((index % columns).clamp(1, columns - 2), (index / columns).clamp(1, rows - 2));
        labels[index] = labels[row * columns + column];
    }
}

/// Indices of the pixels above the floor and off the rim, highest first.
fn sort_from_the_highest(
    surface: &[f32],
    columns: usize,
    floor: f32,
    above: &mut Vec<(u32, u8)>,
    order: &mut Vec<u32>,
) {
    let highest = surface.iter().copied().fold(floor, f32::max);
    let scale = (LEVELS - 1) as f32 / (highest - floor);
    above.clear();
    let mut starts = [0_u32; LEVELS + 1];
    for row in 1..(surface.len() / columns).saturating_sub(1) {
        let first = row * columns + 1;
        let line = &surface[first..first + columns.saturating_sub(2)];
        for (index, &value) in (first as u32..).zip(line) {
            if value > floor {
                let depth = ((highest - value) * scale) as u8;
                starts[usize::from(depth) + 1] += 1;
                above.push((index, depth));
            }
        }
    }
    for k in 0..LEVELS {
        starts[k + 1] += starts[k];
    }
    order.clear();
    order.resize(above.len(), 0);
    for (index, depth) in above {
        let place = &mut starts[usize::from(*depth)];
        order[*place as usize] = *index;
        *place += 1;
    }
}

/// Basins while they grow, as a union–find forest.
#[derive(Debug, Clone, Default)]
struct Forest {
    parent: Vec<u32>,
    summit: Vec<f32>,
    pixels: Vec<u32>,
    /// Final number of every basin.
    numbers: Vec<u32>,
}

impl Forest {
    fn clear(&mut self) {
        self.parent.clear();
        self.summit.clear();
        self.pixels.clear();
        self.numbers.clear();
    }

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

    /// Joins two basins that meet at `level`, or keeps them apart if the lower one stands out. Returns the joined one,
    /// or the higher.
    fn meet(&mut self, a: u32, b: u32, level: f32, rule: FloodRule) -> u32 {
        let (high, low) = if self.summit[a as usize] >= self.summit[b as usize] { (a, b) } else { (b, a) };
        let stands_out = level < rule.saddle * self.summit[low as usize];
        let pixels = self.pixels[low as usize].min(self.pixels[high as usize]);
        if !(stands_out && pixels >= rule.pixels_min) {
            self.parent[low as usize] = high;
            self.pixels[high as usize] += self.pixels[low as usize];
        }
        high
    }

    /// Makes labels final, 0, 1, … in the order in which pixels name them, and returns their number.
    fn number(&mut self, labels: &mut [u32]) -> usize {
        self.numbers.resize(self.parent.len(), NONE);
        let mut count = 0;
        for label in labels.iter_mut().filter(|label| **label != NONE) {
            let root = self.root(*label) as usize;
            if self.numbers[root] == NONE {
                self.numbers[root] = count;
                count += 1;
            }
            *label = self.numbers[root];
        }
        count as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULE: FloodRule = FloodRule { floor: 0.5, saddle: 0.7, pixels_min: 1 };

    /// Number of basins, and their labels, of a surface.
    fn flood(surface: &[f32], columns: usize, rule: FloodRule) -> (usize, Vec<u32>) {
        let mut flood = Flood::default();
        // What was flooded before leaves no trace.
        flood.divide(&[1.0; 64], 8, rule);
        let count = flood.divide(surface, columns, rule);
        (count, flood.labels().to_vec())
    }

    /// Floods a line of values in a surface whose rim is empty.
    fn flood_line(line: &[f32], rule: FloodRule) -> (usize, Vec<u32>) {
        let columns = line.len() + 2;
        let mut surface = vec![0.0; 3 * columns];
        surface[columns + 1..2 * columns - 1].copy_from_slice(line);
        let (count, labels) = flood(&surface, columns, rule);
        (count, labels[columns + 1..2 * columns - 1].to_vec())
    }

    #[test]
    fn two_peaks_with_a_deep_saddle_stay_apart() {
        assert_eq!(flood_line(&[4.0, 9.0, 4.0, 8.0, 3.0], RULE), (2, vec![0, 0, 0, 1, 1]));
    }

    #[test]
    fn two_peaks_with_a_high_saddle_are_one() {
        assert_eq!(flood_line(&[1.0, 9.0, 7.0, 8.0, 1.0], RULE), (1, vec![0; 5]));
    }

    #[test]
    fn basins_do_not_creep_round_each_other() {
        // Two cones, the higher one above, with a common foot.
        let cone = |u: f64, v: f64, r: f64, top: f64| (top - (u - 30.0).hypot(v - r)).max(0.0);
        let surface: Vec<f32> = (0..60 * 60)
            .map(|index| {
                let (u, v) = (f64::from(index % 60), f64::from(index / 60));
                cone(u, v, 20.0, 12.0).max(cone(u, v, 38.0, 11.0)) as f32
            })
            .collect();
        let (count, labels) = flood(&surface, 60, RULE);
        assert_eq!(count, 2);
        let lower = labels[38 * 60 + 30];
        let crept = (32..60).flat_map(|row| (0..60).map(move |column| row * 60 + column));
        assert!(crept.map(|index| labels[index]).all(|label| label == NONE || label == lower));
    }

    #[test]
    fn a_speck_is_no_summit() {
        assert_eq!(flood_line(&[9.0, 9.0, 9.0, 2.0, 5.0, 2.0], FloodRule { pixels_min: 2, ..RULE }).0, 1);
    }

    #[test]
    fn diagonal_pixels_touch() {
        let surface = [0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(flood(&surface, 4, RULE).0, 1);
    }

    #[test]
    fn nothing_above_the_floor_is_no_basin() {
        assert_eq!(flood(&[0.1; 9], 3, RULE).0, 0);
        assert_eq!(flood(&[5.0; 4], 2, RULE).0, 0);
    }
}
