//! Where features lie whose windows overlap: what belongs to a neighbour is taken off, as its far side shows it.

use multiversion::multiversion;

use crate::lattice::Shape;
use crate::lone::{Content, Scatter, squares_of_places};
use crate::scout::light::Light;
use crate::scout::row::{Moments, Sums};
use crate::window::{Disc, Neighbours, Span, Window, round_up};

/// Centre of a feature in pixels of its plane, with standard deviations from the noise of its pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Centre {
    pub(crate) position: [f64; 2],
    pub(crate) std: [f64; 2],
}

/// Features of a plane, of which some share light.
///
/// Features are point symmetric about their centres, and neighbours only add their light. So of a pixel in the windows
/// of A and B, what is B's is what B shows at the mirrored place, less what B's other neighbours show there and on their
/// own far sides. That is linear in the light: noise adds to it but does not bend it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shared<'a> {
    pub(crate) light: Light<'a>,
    pub(crate) scatter: Scatter,
    /// Standard deviation of a pixel of the ground.
    pub(crate) noise: f32,
    pub(crate) discs: &'a [Disc],
    pub(crate) neighbours: &'a Neighbours,
}

/// Where features are taken to lie while they settle; its buffers are used again from plane to plane.
#[derive(Debug, Clone, Default)]
pub(crate) struct Bench {
    /// The features' windows, about their centres as they are known.
    windows: Vec<Disc>,
    steps: Vec<[f64; 2]>,
    contents: Vec<Option<Content>>,
    means: Vec<Option<(Centre, Option<Shape>)>>,
    restless: Vec<u32>,
    lines: Lines,
}

/// Rows of contrasts.
#[derive(Debug, Clone, Default)]
struct Lines {
    values: Vec<f32>,
    taken: Vec<f32>,
    far: Vec<f32>,
    third: Vec<f32>,
    rows: [Vec<f32>; 2],
}

/// What a feature's own light tells.
struct OwnMean {
    centre: Centre,
    shape: Shape,
    /// How far it moves when its neighbours do, over how far they move, about.
    coupling: f64,
}

/// What is taken off a window, summed about its centre.
#[derive(Debug, Clone, Copy, Default)]
struct Taken {
    sums: Sums,
    /// What the squares of the contrasts lose.
    squares: f64,
    /// First moments of the light whose owner is in doubt.
    doubt: [f64; 2],
    pixels: f64,
    places: [f64; 2],
}

/// Steps shrink by no more than this ratio, or are not trusted to.
const RATIO_MAX: f64 = 0.85;

impl Shared<'_> {
    /// Moves the centre of every feature that shares light to the centroid of its own until all rest. Calls `found` with
    /// each that has light, its centre, and its shape where that is known.
    ///
    /// A neighbour's far side moves along with the neighbour's centre, and that moves the centroid by a share ρ of it, so
    /// steps shrink like 1, ρ, ρ², …; from the second on they are lengthened by 1/(1 − ρ) to where they lead (Aitken).
    pub(crate) fn means(&self, bench: &mut Bench, mut found: impl FnMut(usize, Centre, Option<Shape>)) {
        const ROUNDS: f64 = 14.0;
        const SHARED_PIXELS_MAX: f64 = 3e7;
        const RESTING: f64 = 3e-3;
        const SETTLING: usize = 2;
        let is_shared = |feature: &u32| !self.neighbours.is_alone(*feature as usize);
        let mut restless = bench.restart(self.discs);
        restless.extend((0..self.discs.len() as u32).filter(is_shared));
        // A frame crowded with features gets fewer rounds rather than take forever.
        let rounds = (SHARED_PIXELS_MAX / self.shared_pixels()).clamp(2.0, ROUNDS) as usize;
        for round in 0..rounds {
            restless.retain(|&feature| {
                let next = self.settle(feature as usize, round < SETTLING, bench);
                // What rests among neighbours that have hardly begun to move may be moved by them yet.
                next.is_some_and(|next| round == 0 || next > RESTING)
            });
            if restless.is_empty() {
                break;
            }
        }
        bench.restless = restless;
        for (feature, mean) in bench.means.iter().enumerate() {
            if let Some((centre, shape)) = mean {
                found(feature, *centre, *shape);
            }
        }
    }

    /// Moves one feature and says how far it may move yet; `None` if it can move no more. While all is settling the
    /// window follows it.
    fn settle(&self, feature: usize, settling: bool, bench: &mut Bench) -> Option<f64> {
        const MOVED: f64 = 0.5;
        let size = [self.light.columns(), self.light.rows()];
        let Bench { windows, contents, means, lines, .. } = bench;
        let Disc { centre: [c, r], radius, .. } = windows[feature];
        let holds = |content: &Content| {
            let [c0, r0] = content.window.centre;
            !settling || (c - c0).abs().max((r - r0).abs()) < MOVED
        };
        if !contents[feature].as_ref().is_some_and(holds) {
            let window = Window::about(size, [c, r], radius);
            contents[feature] = window.map(|window| Content::of(&self.light, window, &mut lines.values));
        }
        let own = contents[feature].and_then(|content| self.own_mean(feature, &content, windows, lines));
        means[feature] = None;
        let OwnMean { mut centre, shape, coupling } = own?;
        let step = bench.lengthen(feature, &mut centre.position);
        if self.has_strayed(feature, centre.position) {
            bench.windows[feature].centre = self.discs[feature].centre;
            bench.means[feature] = Some((self.outline_centre(feature), None));
            return None;
        }
        bench.windows[feature].centre = centre.position;
        bench.means[feature] = Some((centre, Some(shape)));
        // Steps that shrink by a ratio add up to 1/(1 − ratio) of the next one.
        let ratio = coupling.min(RATIO_MAX);
        Some(step * ratio / (1.0 - ratio))
    }

    /// Centroid and shape of a feature's own light.
    fn own_mean(&self, feature: usize, content: &Content, windows: &[Disc], lines: &mut Lines) -> Option<OwnMean> {
        // A neighbour's light is cut off where the window ends, so it moves the centroid by some times its share.
        const COUPLING: f64 = 3.5;
        /// How far the share of light that two features claim may be wrong; it counts towards their deviations.
        const SHARE_ERROR: f64 = 0.1;
        let taken = self.taken(feature, &content.window, windows, lines);
        let (all, off) = (&content.sums, &taken.sums);
        let light = all.light - off.light;
        let first = [0, 1].map(|axis| all.first[axis] - off.first[axis]);
        let inside = |axis: usize, half: f64| (first[axis] / light).abs() <= half;
        if !(light > 0.0 && inside(0, content.window.half_width) && inside(1, content.window.half_height)) {
            return None;
        }
        let std = |axis: usize| {
            // What is taken off scatters as well.
            let (places, second) =
                (content.places[axis] + taken.places[axis], all.second[2 * axis] + off.second[2 * axis]);
            let doubt = SHARE_ERROR * taken.doubt[axis];
            (self.scatter.of_moment(places, second) + doubt * doubt).sqrt() / light
        };
        let position = [0, 1].map(|axis| content.window.centre[axis] + first[axis] / light);
        let shape = Shape {
            light,
            squares: all.squares - taken.squares,
            scatter: self.scatter.of_light(content.pixels + taken.pixels, all.light + off.light),
            second: [0, 1, 2].map(|k| all.second[k] - off.second[k]),
        };
        let coupling = COUPLING * (off.light / light).abs();
        Some(OwnMean { centre: Centre { position, std: [std(0), std(1)] }, shape, coupling })
    }

    /// What belongs to the neighbours in a feature's window.
    fn taken(&self, feature: usize, window: &Window, windows: &[Disc], lines: &mut Lines) -> Taken {
        let [c0, r0] = window.centre;
        let (mut taken, mut moments) = (Taken::default(), Moments::default());
        for span in window.spans() {
            let Some(span) = self.shared_part(feature, span, windows) else { continue };
            self.read_taken(feature, span, windows, lines);
            let (along, across) = (span.first as f64 - c0, span.row as f64 - r0);
            moments.add(&lines.taken, [along, across]);
            let [squares, doubt, doubt_along] = doubts(&lines.values, &lines.taken, along as f32);
            let places = squares_of_places(along, across, lines.taken.len());
            taken.squares += squares;
            taken.doubt = [taken.doubt[0] + doubt_along, taken.doubt[1] + across * doubt];
            taken.pixels += lines.taken.len() as f64;
            taken.places = [taken.places[0] + places[0], taken.places[1] + places[1]];
        }
        taken.sums = moments.sums();
        taken
    }

    /// Calls `visit` with every row of a feature's window about its centre, its first column, and the feature's own light
    /// there; neighbours are where [`Self::means`] found them.
    pub(crate) fn for_each_row(
        &self,
        feature: usize,
        centre: [f64; 2],
        bench: &mut Bench,
        mut visit: impl FnMut(usize, usize, &[f32]),
    ) {
        let Bench { windows, lines, .. } = bench;
        let size = [self.light.columns(), self.light.rows()];
        let Some(window) = Window::about(size, centre, self.discs[feature].radius) else { return };
        let mut own = Vec::new();
        for span in window.spans() {
            own.resize(span.end - span.first, 0.0);
            self.light.read(span.row, span.first, &mut own);
            if let Some(shared) = self.shared_part(feature, span, windows) {
                self.read_taken(feature, shared, windows, lines);
                let part = &mut own[shared.first - span.first..];
                part.iter_mut().zip(&lines.taken).for_each(|(value, taken)| *value -= taken);
            }
            visit(span.row, span.first, &own);
        }
    }

    /// The part of a span that neighbours' windows may reach.
    fn shared_part(&self, feature: usize, span: Span, windows: &[Disc]) -> Option<Span> {
        let (mut first, mut end) = (span.end, span.first);
        for &other in self.neighbours.of(feature) {
            if let Some(reached) = span_within(span, &windows[other as usize]) {
                (first, end) = (first.min(reached.first), end.max(reached.end));
            }
        }
        (first < end).then_some(Span { first, end, ..span })
    }

    /// Reads the contrasts of a span, and how much of each belongs to the neighbours of a feature.
    fn read_taken(&self, feature: usize, span: Span, windows: &[Disc], lines: &mut Lines) {
        let count = span.end - span.first;
        lines.values.resize(count, 0.0);
        self.light.read(span.row, span.first, &mut lines.values);
        lines.taken.clear();
        lines.taken.resize(count, 0.0);
        for &other in self.neighbours.of(feature) {
            let Some(part) = span_within(span, &windows[other as usize]) else { continue };
            self.read_far_side(other as usize, part, windows, lines);
            let range = part.first - span.first..part.end - span.first;
            take(&mut lines.taken[range.clone()], &lines.far, &lines.values[range], self.noise);
        }
    }

    /// What a feature shows at the mirrored places of a span, in the order of the span, less what its neighbours do.
    fn read_far_side(&self, feature: usize, span: Span, windows: &[Disc], lines: &mut Lines) {
        let [c, r] = windows[feature].centre;
        let row = 2.0 * r - span.row as f64;
        let count = span.end - span.first;
        let Lines { far, third, rows, .. } = lines;
        far.resize(count, 0.0);
        let first = 2.0 * c - (span.end - 1) as f64;
        if !self.holds(row, first, count) {
            // There is no far side; a pixel beside the plane tells nothing.
            far.fill(0.0);
            return;
        }
        self.light.sample(first, row, far, rows);
        for &other in self.neighbours.of(feature) {
            let disc = &windows[other as usize];
            // In the order of the mirrored places, from `first` on.
            let Some([a, b]) = disc.chord(row) else { continue };
            let (start, end) = (round_up(a - first), ((b - first + 1.0) as usize).min(count));
            if start >= end {
                continue;
            }
            third.resize(end - start, 0.0);
            let (own_row, own_first) = (2.0 * disc.centre[1] - row, 2.0 * disc.centre[0] - first - (end - 1) as f64);
            if self.holds(own_row, own_first, third.len()) {
                self.light.sample(own_first, own_row, third, rows);
                let part = far[start..end].iter_mut().zip(third.iter().rev());
                // No more than both sides show.
                part.for_each(|(value, other)| *value -= value.min(*other).max(0.0));
            }
        }
        far.reverse();
    }

    /// Whether so many places of a row from a column on lie on the plane.
    fn holds(&self, row: f64, first: f64, count: usize) -> bool {
        let last = [self.light.columns() - 1, self.light.rows() - 1].map(|last| last as f64);
        row >= 0.0 && row <= last[1] && first >= 0.0 && first + (count - 1) as f64 <= last[0]
    }

    /// Pixels of all windows that are shared, each as often as it has claimants, about.
    fn shared_pixels(&self) -> f64 {
        let area = |(feature, disc): (usize, &Disc)| {
            self.neighbours.of(feature).len() as f64 * std::f64::consts::PI * disc.radius * disc.radius
        };
        self.discs.iter().enumerate().map(area).sum()
    }

    /// Whether a centre has left its outline: among many neighbours that touch, sharing may run away.
    fn has_strayed(&self, feature: usize, [c, r]: [f64; 2]) -> bool {
        const LEASH: f64 = 0.6;
        let Disc { centre: [c0, r0], extent, .. } = self.discs[feature];
        (c - c0).powi(2) + (r - r0).powi(2) > (LEASH * extent).powi(2)
    }

    /// The centre of an outline, where the light itself gives none.
    fn outline_centre(&self, feature: usize) -> Centre {
        const SHARE_OF_EXTENT: f64 = 0.05;
        let Disc { centre, extent, .. } = self.discs[feature];
        Centre { position: centre, std: [SHARE_OF_EXTENT * extent; 2] }
    }
}

impl Bench {
    /// Puts all features where their outlines are; returns the buffer of those that do not rest, empty.
    fn restart(&mut self, discs: &[Disc]) -> Vec<u32> {
        self.windows.clear();
        self.windows.extend_from_slice(discs);
        self.steps.clear();
        self.steps.resize(discs.len(), [0.0; 2]);
        self.contents.clear();
        self.contents.resize(discs.len(), None);
        self.means.clear();
        self.means.resize(discs.len(), None);
        let mut restless = std::mem::take(&mut self.restless);
        restless.clear();
        restless
    }

    /// Lengthens a step to where steps like it and the one before lead, and says how long it was.
    fn lengthen(&mut self, feature: usize, position: &mut [f64; 2]) -> f64 {
        let before = self.windows[feature].centre;
        let steps = &mut self.steps[feature];
        for axis in 0..2 {
            let step = position[axis] - before[axis];
            let ratio = step / steps[axis];
            let gain = if ratio > 0.0 && ratio < 1.0 { 1.0 / (1.0 - ratio.min(RATIO_MAX)) } else { 1.0 };
            position[axis] = before[axis] + gain * step;
            steps[axis] = step;
        }
        (steps[0] * steps[0] + steps[1] * steps[1]).sqrt()
    }
}

/// The part of a span within a window.
fn span_within(span: Span, window: &Disc) -> Option<Span> {
    let [a, b] = window.chord(span.row as f64)?;
    let (first, end) = (span.first.max(round_up(a)), span.end.min((b + 1.0) as usize));
    (first < end).then_some(Span { first, end, ..span })
}

/// Adds a neighbour's light to what is taken, but no more than what is there.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn take(taken: &mut [f32], far: &[f32], values: &[f32], noise: f32) {
    const SIGMAS: f32 = 4.0;
    // Where there is light, it scatters by more than the ground does.
    const SHARE: f32 = 0.05;
    for ((taken, far), value) in taken.iter_mut().zip(far).zip(values) {
        let most = *value + SHARE * value.abs() + SIGMAS * noise - *taken;
        *taken += if *far < most { *far } else { most };
    }
}

/// What is lost of the squares of contrasts by what is taken off them; and the light whose owner is in doubt, with its
/// first moment along the row.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn doubts(values: &[f32], taken: &[f32], along: f32) -> [f64; 3] {
    const LANES: usize = 8;
    let mut sums = [[0.0_f32; LANES]; 3];
    let ((blocks, rest), (off_blocks, off_rest)) = (values.as_chunks::<LANES>(), taken.as_chunks::<LANES>());
    let (mut last, mut last_off) = ([0.0; LANES], [0.0; LANES]);
    last[..rest.len()].copy_from_slice(rest);
    last_off[..off_rest.len()].copy_from_slice(off_rest);
    for block in 0..=blocks.len() {
        let values = blocks.get(block).unwrap_or(&last);
        let taken = off_blocks.get(block).unwrap_or(&last_off);
        let start = along + (block * LANES) as f32;
        for lane in 0..LANES {
            let (value, off) = (values[lane], taken[lane]);
            // Of the light of both the smaller part, about: own · taken / all.
            let share = off / (value.abs() + 1.0);
            let doubt = (value - off) * (if share > 1.0 { 1.0 } else { share });
            sums[0][lane] += off * (2.0 * value - off);
            sums[1][lane] += doubt;
            sums[2][lane] += doubt * (start + lane as f32);
        }
    }
    sums.map(|lanes| f64::from(lanes.iter().sum::<f32>()))
}

/// The paper's centre of a feature, in polar coordinates about the axis, both in units of the plane's pixels.
///
/// ```text
/// r̄ = ∫∫ r I r dr dφ / ∫∫ I r dr dφ                     [Ohno2018, Eqs. 9, 10]
/// φ̄ = ∫∫ r φ I r dr dφ / (r̄ ∫∫ I r dr dφ)               [Ohno2018, Eq. 11, one band's half of it]
/// ```
///
/// r̄ is the mean of the radii, not the radius of the mean: for a disc of radius a it is larger by about a²/8r̄. φ runs
/// from −π to π, so a feature across the negative x axis has no meaningful φ̄. Both are the paper's; use
/// [`Shared::means`] and [`lone_mean`](crate::lone::lone_mean) for measuring.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct RadialMean {
    light: f64,
    radius: f64,
    azimuth: f64,
}

impl RadialMean {
    /// Adds the light of a row whose first pixel lies at `[x, y]` from the axis.
    pub(crate) fn add(&mut self, [x, y]: [f64; 2], light: &[f32]) {
        for (k, light) in light.iter().map(|light| f64::from(*light)).enumerate() {
            let x = x + k as f64;
            let radius = x.hypot(y);
            self.light += light;
            self.radius += radius * light;
            self.azimuth += radius * y.atan2(x) * light;
        }
    }

    /// Mean radius and mean azimuth.
    pub(crate) fn mean(&self) -> Option<[f64; 2]> {
        let radius = self.radius / self.light;
        let azimuth = self.azimuth / (radius * self.light);
        (self.light > 0.0 && radius > 0.0 && azimuth.is_finite()).then_some([radius, azimuth])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::background::Polarity;
    use crate::noise::Noise;
    use crate::scout::ground::Ground;

    const COLUMNS: usize = 160;
    const ROWS: usize = 100;

    /// Column, row, radius and height of a disc whose edge is blurred by 8 pixels to either side.
    type Dot = [f64; 4];

    const BLUR: f64 = 8.0;

    fn field(dots: &[Dot]) -> Vec<f32> {
        let light = |column: f64, row: f64| {
            let of = |[c, r, radius, height]: &Dot| {
                let t = (((column - c).hypot(row - r) - radius) / BLUR).clamp(-1.0, 1.0);
                height * (0.5 - (t * (1.0 - t * t).sqrt() + t.asin()) / std::f64::consts::PI)
            };
            dots.iter().map(of).sum::<f64>() as f32
        };
        (0..COLUMNS * ROWS).map(|index| light((index % COLUMNS) as f64, (index / COLUMNS) as f64)).collect()
    }

    /// Centres of dots whose outlines were found about a pixel beside them.
    fn centres(contrasts: &[f32], dots: &[Dot]) -> Vec<Option<Centre>> {
        let outline = |(k, [c, r, radius, _]): (usize, &Dot)| {
            let off = [0.9, -0.7, 0.4][k % 3];
            Disc { centre: [c + off, r - off], extent: *radius, radius: radius + 1.1 * BLUR + 1.5 }
        };
        let discs: Vec<Disc> = dots.iter().enumerate().map(outline).collect();
        let mut neighbours = Neighbours::default();
        neighbours.find(&discs);
        let ground = Ground { polarity: Polarity::Bright, level: 0.0, pixel_noise: 1.0, surface: None };
        let noise = Noise { floor_codes2: 1.0, slope_codes: 0.0, black_level: 0.0 };
        let light = Light::Field { columns: COLUMNS, contrasts };
        let scatter = Scatter::on(&ground, &noise);
        let shared = Shared { light, scatter, noise: 1.0, discs: &discs, neighbours: &neighbours };
        let mut found = vec![None; dots.len()];
        let mut bench = Bench::default();
        // What was measured before leaves no trace.
        shared.means(&mut bench, |_, _, _| {});
        shared.means(&mut bench, |feature, centre, _| found[feature] = Some(centre));
        found
    }

    fn errors(dots: &[Dot]) -> Vec<f64> {
        let off = |(centre, dot): (Option<Centre>, &Dot)| {
            let [c, r] = centre.expect("light").position;
            (c - dot[0]).hypot(r - dot[1])
        };
        centres(&field(dots), dots).into_iter().zip(dots).map(off).collect()
    }

    #[test]
    fn dots_whose_skirts_meet_are_told_apart() {
        for (gap, most) in [(-3.0, 0.1), (0.0, 0.1), (4.0, 0.03), (12.0, 0.003)] {
            let errors = errors(&[[50.2, 50.7, 18.0, 1000.0], [86.1 + gap, 54.0, 18.0, 1000.0]]);
            assert!(errors.iter().all(|error| *error < most), "{gap}: {errors:?}");
        }
        let errors = errors(&[[50.2, 50.7, 18.0, 1000.0], [88.3, 51.0, 18.0, 300.0]]);
        assert!(errors.iter().all(|error| *error < 0.1), "{errors:?}");
    }

    #[test]
    fn a_dot_between_two_others_is_told_from_both() {
        let errors = errors(&[[40.3, 50.0, 14.0, 1000.0], [74.0, 52.2, 14.0, 900.0], [107.1, 49.4, 14.0, 1100.0]]);
        assert!(errors.iter().all(|error| *error < 0.05), "{errors:?}");
    }

    #[test]
    fn what_scatters_in_shared_pixels_counts_twice() {
        let alone = centres(&field(&[[50.0, 50.0, 18.0, 1000.0]]), &[[50.0, 50.0, 18.0, 1000.0]]);
        assert_eq!(alone, [None], "no neighbour");
        let near = [[50.0, 50.0, 18.0, 1000.0], [93.0, 50.0, 18.0, 1000.0]];
        let far = [[50.0, 50.0, 18.0, 1000.0], [103.0, 50.0, 18.0, 1000.0]];
        let std = |dots: &[Dot]| centres(&field(dots), dots)[0].expect("light").std;
        // A lone disc's σ² = σ₀² π R⁴/4 over its light squared.
        let light = std::f64::consts::PI * (18.0_f64.powi(2) + BLUR * BLUR / 4.0) * 1000.0;
        let expected = (std::f64::consts::PI / 4.0 * 28.3_f64.powi(4)).sqrt() / light;
        let [along, across] = std(&far);
        assert!((across / expected - 1.0).abs() < 0.1 && along > across && std(&near)[0] > along, "{along} {expected}");
    }

    #[test]
    fn a_row_of_a_neighbour_alone_is_nothing() {
        let dots = [[50.0, 50.0, 18.0, 0.0], [88.0, 50.0, 18.0, 1000.0]];
        let found = centres(&field(&dots), &dots);
        // No light of its own, or all of it in doubt: never a centre that seems sure.
        assert!(found[0].is_none_or(|centre| centre.std[0] > 0.5), "{found:?}");
    }
}
