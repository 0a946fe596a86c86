//! Area and centroid of what several concentric-ring masks leave open together, exactly.
//!
//! The open region is bounded by arcs of the masks' circles. It is the polygon over the arcs' chords, a sum of signed
//! triangles to the origin, and the circular segments between chords and arcs; all have closed forms.

use std::f64::consts::{PI, TAU};

use twinpupil_instrument::Annulus;

/// Arcs are judged this far inside their own ring, relative to their radius, so that a circle which coincides with
/// another one is judged by the open side of it.
const INWARD: f64 = 1e-10;

/// Circles closer than this, relative to their radius, are one circle.
const COINCIDENT: f64 = 2.0 * INWARD;

/// Rings that pass, about a common centre.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RingSet {
    pub(crate) centre: [f64; 2],
    pub(crate) rings: Vec<Annulus>,
}

/// Area and first moments of a region.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Moments {
    pub(crate) area: f64,
    pub(crate) x: f64,
    pub(crate) y: f64,
}

/// Whether a ring lies inside or outside its circle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Edge {
    Inner,
    Outer,
}

impl RingSet {
    pub(crate) fn shifted(self, by: [f64; 2]) -> Self {
        Self { centre: [self.centre[0] + by[0], self.centre[1] + by[1]], ..self }
    }

    /// Radii of the circles that bound the rings.
    pub(crate) fn circles(&self) -> impl Iterator<Item = (f64, Edge)> + '_ {
        self.rings
            .iter()
            .flat_map(|ring| [(ring.inner_mm, Edge::Inner), (ring.outer_mm, Edge::Outer)])
            .filter(|(radius, _)| *radius > 0.0 && radius.is_finite())
    }

    fn holds(&self, point: [f64; 2]) -> bool {
        let distance = (point[0] - self.centre[0]).hypot(point[1] - self.centre[1]);
        self.rings.iter().any(|ring| ring.inner_mm <= distance && distance < ring.outer_mm)
    }

    fn has_circle_near(&self, centre: [f64; 2], radius: f64, edge: Edge) -> bool {
        let apart = (centre[0] - self.centre[0]).hypot(centre[1] - self.centre[1]);
        self.circles().any(|(own, kind)| kind == edge && apart + (own - radius).abs() < COINCIDENT * radius)
    }
}

impl Moments {
    /// Centre of gravity, or `None` without area.
    pub(crate) fn centroid(&self) -> Option<[f64; 2]> {
        (self.area > 0.0).then(|| [self.x / self.area, self.y / self.area])
    }

    fn add(&mut self, other: Self, sign: f64) {
        self.area += sign * other.area;
        self.x += sign * other.x;
        self.y += sign * other.y;
    }
}

/// Area and first moments of the region that lies in every one of `sets`, which must be bounded.
pub(crate) fn moments(sets: &[RingSet]) -> Moments {
    let mut sum = Moments::default();
    for (i, set) in sets.iter().enumerate() {
        for (radius, edge) in set.circles() {
            // A circle that several masks share bounds the region once.
            if sets[..i].iter().any(|earlier| earlier.has_circle_near(set.centre, radius, edge)) {
                continue;
            }
            let (sign, judged_radius) = match edge {
                Edge::Outer => (1.0, radius * (1.0 - INWARD)),
                Edge::Inner => (-1.0, radius * (1.0 + INWARD)),
            };
            for [from, to] in arcs(sets, i, radius) {
                let middle = 0.5 * (from + to);
                let point = on_circle(set.centre, judged_radius, middle);
                if sets.iter().enumerate().all(|(j, other)| j == i || other.holds(point)) {
                    sum.add(arc_moments(set.centre, radius, from, to), sign);
                }
            }
        }
    }
    sum
}

/// Splits a circle of set `i` where it crosses circles of the others; angles rise by at most 2π in all.
fn arcs(sets: &[RingSet], i: usize, radius: f64) -> Vec<[f64; 2]> {
    let mut angles: Vec<f64> = Vec::new();
    for other in sets.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, other)| other) {
        let (dx, dy) = (other.centre[0] - sets[i].centre[0], other.centre[1] - sets[i].centre[1]);
        let (apart, towards) = (dx.hypot(dy), dy.atan2(dx));
        for (other_radius, _) in other.circles() {
            // The law of cosines for the half angle: `acos` would lose the crossings of very large circles.
            let near = (other_radius - apart + radius) * (other_radius + apart - radius);
            let far = (apart + radius - other_radius) * (apart + radius + other_radius);
            if near > 0.0 && far > 0.0 {
                let half = 2.0 * (near / far).sqrt().atan();
                angles.extend([(towards - half).rem_euclid(TAU), (towards + half).rem_euclid(TAU)]);
            }
        }
    }
    angles.sort_by(f64::total_cmp);
    match angles.first() {
        None => vec![[0.0, TAU]],
        Some(&first) => {
            angles.push(first + TAU);
            angles.windows(2).map(|pair| [pair[0], pair[1]]).collect()
        }
    }
}

fn on_circle(centre: [f64; 2], radius: f64, angle: f64) -> [f64; 2] {
    let (sin, cos) = angle.sin_cos();
    [centre[0] + radius * cos, centre[1] + radius * sin]
}

/// Share of a counter-clockwise arc: the triangle from the origin to its chord, and the segment beyond the chord.
///
/// ```text
/// segment of opening Δ    area ½ r² (Δ − sin Δ)    first moment about the circle's centre ⅔ r³ sin³(Δ/2)
/// ```
fn arc_moments(centre: [f64; 2], r: f64, from: f64, to: f64) -> Moments {
    let turn = to - from;
    if turn == TAU {
        let area = PI * r * r;
        return Moments { area, x: centre[0] * area, y: centre[1] * area };
    }
    let ([x0, y0], [x1, y1]) = (on_circle(centre, r, from), on_circle(centre, r, to));
    let triangle = 0.5 * (x0 * y1 - x1 * y0);
    let segment = 0.5 * r * r * minus_sine(turn);
    let reach = 2.0 / 3.0 * (r * (0.5 * turn).sin()).powi(3);
    let (sin, cos) = (0.5 * (from + to)).sin_cos();
    Moments {
        area: triangle + segment,
        x: triangle * (x0 + x1) / 3.0 + segment * centre[0] + reach * cos,
        y: triangle * (y0 + y1) / 3.0 + segment * centre[1] + reach * sin,
    }
}

/// `Δ − sin Δ`, without cancellation for the flat arcs of large circles.
fn minus_sine(turn: f64) -> f64 {
    if turn > 0.1 {
        return turn - turn.sin();
    }
    let square = turn * turn;
    turn * square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn disc(centre: [f64; 2], radius: f64) -> RingSet {
        RingSet { centre, rings: vec![Annulus { inner_mm: 0.0, outer_mm: radius }] }
    }

    fn outside(centre: [f64; 2], radius: f64) -> RingSet {
        RingSet { centre, rings: vec![Annulus { inner_mm: radius, outer_mm: f64::INFINITY }] }
    }

    /// Common area of two overlapping circles, the textbook formula.
    fn lens_area(a: f64, b: f64, d: f64) -> f64 {
        let (u, v) = ((d * d + a * a - b * b) / (2.0 * d * a), (d * d + b * b - a * a) / (2.0 * d * b));
        let kite = ((-d + a + b) * (d + a - b) * (d - a + b) * (d + a + b)).sqrt();
        a * a * u.acos() + b * b * v.acos() - 0.5 * kite
    }

    #[test]
    fn nested_disjoint_and_coincident_discs_have_known_areas() {
        let close = |sets: &[RingSet], expected: f64| (moments(sets).area - expected).abs() < 1e-9;
        assert!(close(&[disc([0.0, 0.0], 1.0), disc([0.1, 0.0], 2.0)], PI));
        assert!(close(&[disc([0.0, 0.0], 1.0), disc([4.0, 0.0], 2.0)], 0.0));
        assert!(close(&[disc([0.3, 0.0], 1.0), disc([0.3, 0.0], 1.0), disc([0.3, 0.0], 1.0)], PI));
        assert!(close(&[disc([0.0, 0.0], 1.0), outside([0.0, 0.0], 1.0)], 0.0));
        assert!(close(&[disc([0.0, 0.0], 2.0), outside([0.0, 0.0], 1.0)], 3.0 * PI));
        assert!(close(&[disc([0.0, 0.0], 1.0), outside([0.2, 0.0], 3.0)], 0.0));
    }

    #[test]
    fn a_half_covered_disc_has_the_centroid_of_a_half_disc() {
        // A very large circle is a straight edge through the centre.
        let half = moments(&[disc([0.0, 0.0], 1.0), disc([1e8, 0.0], 1e8)]);
        assert!((half.area - 0.5 * PI).abs() < 1e-7);
        assert!((half.x / half.area - 4.0 / (3.0 * PI)).abs() < 1e-7);
        assert!(half.y.abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn two_discs_overlap_in_a_lens(a in 0.2..3.0_f64, b in 0.2..3.0_f64, fraction in 0.01..0.99_f64, azimuth in 0.0..TAU) {
            let d = (a - b).abs() + fraction * (a + b - (a - b).abs());
            let centre = on_circle([0.3, -0.2], d, azimuth);
            let both = moments(&[disc([0.3, -0.2], a), disc(centre, b)]);
            prop_assert!((both.area - lens_area(a, b, d)).abs() < 1e-9);
            // What one disc covers of the other and what it leaves make up the whole.
            let left = moments(&[disc([0.3, -0.2], a), outside(centre, b)]);
            prop_assert!((both.area + left.area - PI * a * a).abs() < 1e-9);
            prop_assert!((both.x + left.x - 0.3 * PI * a * a).abs() < 1e-9);
            prop_assert!((both.y + left.y + 0.2 * PI * a * a).abs() < 1e-9);
        }

        #[test]
        fn three_masks_agree_with_counting_cells(
            x in -1.5..1.5_f64, y in -1.5..1.5_f64, inner in 0.1..0.8_f64, width in 0.1..1.5_f64, u in -1.0..1.0_f64,
        ) {
            let ring = RingSet { centre: [x, y], rings: vec![
                Annulus { inner_mm: 0.0, outer_mm: 0.5 * inner },
                Annulus { inner_mm: inner, outer_mm: inner + width },
            ] };
            let sets = [disc([0.0, 0.0], 1.0), ring, outside([u, 0.3], 0.6)];
            const CELLS: i32 = 200;
            let mut counted = Moments::default();
            let cell = 2.0 / f64::from(CELLS);
            for (i, j) in (0..CELLS * CELLS).map(|k| (k % CELLS, k / CELLS)) {
                let point = [-1.0 + cell * (f64::from(i) + 0.5), -1.0 + cell * (f64::from(j) + 0.5)];
                if sets.iter().all(|set| set.holds(point)) {
                    counted.add(Moments { area: 1.0, x: point[0], y: point[1] }, cell * cell);
                }
            }
            let exact = moments(&sets);
            prop_assert!((exact.area - counted.area).abs() < 1e-2, "{exact:?} {counted:?}");
            prop_assert!((exact.x - counted.x).abs() < 1e-2 && (exact.y - counted.y).abs() < 1e-2);
        }
    }
}
