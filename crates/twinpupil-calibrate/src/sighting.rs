//! Which features of a frame are which dots of the target, in every band.

use std::collections::HashMap;

use thiserror::Error;

use crate::lattice::{Lattice, Spot, median};
use crate::target::Target;

/// Why the target is not recognised on a frame.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SightingError {
    /// Dots too bright to be measured.
    #[error(
        "too bright: {saturated} dots in band `{band}` are saturated, and {features} are not; legal: dots below the largest code"
    )]
    Saturated {
        /// The band.
        band: String,
        /// Features that reach the largest code.
        saturated: usize,
        /// The others.
        features: usize,
    },
    /// Too few features in rows and columns.
    #[error("no target: of {features} features in band `{band}` {placed} lie in rows and columns; legal: at least 9")]
    NoTarget {
        /// The band.
        band: String,
        /// Features that were found in it.
        features: usize,
        /// Those of the largest grid among them.
        placed: usize,
    },
    /// More than one grid.
    #[error("two targets: beside a grid of {first} dots band `{band}` shows another of {second}; legal: one target")]
    TwoTargets {
        /// The band.
        band: String,
        /// Dots of the larger grid.
        first: usize,
        /// Dots of the other.
        second: usize,
    },
    /// A grid that does not fit into the target.
    #[error(
        "the grid in band `{band}` has {} × {} dots; legal: no more than the target's {} × {}",
        found[0], found[1], stated[0], stated[1]
    )]
    TooLarge {
        /// The band.
        band: String,
        /// Columns and rows, or the other way round.
        found: [i32; 2],
        /// Columns and rows of the target.
        stated: [usize; 2],
    },
    /// The fiducials lie as in a mirror.
    #[error("the image is mirrored: the target's fiducials lie the wrong way round in band `{band}`")]
    Mirrored {
        /// The band.
        band: String,
    },
    /// The fiducials are others.
    #[error("another target: {wrong} dots in band `{band}` are not as the target's fiducials say")]
    Unlike {
        /// The band.
        band: String,
        /// How many, at best.
        wrong: usize,
    },
    /// The bands show no grid that is the same.
    #[error("bands `{first}` and `{second}` do not show the same target: at best their dots disagree by {} px", away_px.round())]
    Apart {
        /// A band.
        first: String,
        /// Another.
        second: String,
        /// Root mean square distance of their dots when one is scaled about the axis to the other, px.
        away_px: f64,
    },
}

/// A dot of the target and the feature of a band that shows it.
pub(crate) type Labelled = (usize, usize);

/// The dots that each band shows.
pub(crate) type Sighting = Vec<Vec<Labelled>>;

/// Fewest dots that make a target.
const DOTS_MIN: usize = 9;

/// Recognises the target in every band, whose names and features are given; `axis_px` is about where the axis is.
///
/// Of all ways to lay the grids onto the target none of which goes against a fiducial, that in which the bands agree
/// best; then that which misses the fewest dots in all bands together; then the plainest for the first.
pub(crate) fn recognise(
    target: &Target,
    bands: &[(&str, Vec<Spot>)],
    axis_px: [f64; 2],
) -> Result<Sighting, SightingError> {
    let shown = bands.iter().map(|(name, spots)| Shown::new(target, name, spots)).collect::<Result<Vec<_>, _>>()?;
    let Some((first, others)) = shown.split_first() else { return Ok(Sighting::new()) };
    let begun = |own: &Candidate| Joint { placements: vec![own.placement], missed: own.missed, away_share: 0.0 };
    let mut joints: Vec<Joint> = first.candidates.iter().map(begun).collect();
    for other in others {
        joints = joined(joints, [first, other], axis_px)?;
    }
    let better = |a: &Joint, b: &Joint| a.away_share.total_cmp(&b.away_share).then(a.missed.cmp(&b.missed));
    let best = joints.into_iter().min_by(better).map_or(Vec::new(), |joint| joint.placements);
    Ok(best.iter().zip(&shown).map(|(placement, shown)| placement.labelled(target, &shown.lattice)).collect())
}

/// The grid that a band shows, and all ways to lay it onto the target.
struct Shown<'a> {
    band: &'a str,
    spots: &'a [Spot],
    lattice: Lattice,
    candidates: Vec<Candidate>,
}

impl<'a> Shown<'a> {
    fn new(target: &Target, band: &'a str, spots: &'a [Spot]) -> Result<Self, SightingError> {
        let lattice = lattice(target, band, spots)?;
        let candidates = candidates(target, band, &lattice, spots)?;
        Ok(Self { band, spots, lattice, candidates })
    }
}

/// A way to lay a grid onto the target that goes against no fiducial.
struct Candidate {
    placement: Placement,
    /// Dots of the target that the grid leaves out in its midst.
    missed: usize,
}

/// One way for each band.
struct Joint {
    placements: Vec<Placement>,
    missed: usize,
    /// By how much the bands disagree with the first, in steps, summed over them.
    away_share: f64,
}

/// Ways to lay further bands, each with that of one more which agrees best with the first.
fn joined(joints: Vec<Joint>, [first, other]: [&Shown<'_>; 2], axis_px: [f64; 2]) -> Result<Vec<Joint>, SightingError> {
    let mut known: HashMap<Relative, f64> = HashMap::new();
    let mut least_px = f64::INFINITY;
    let mut more = Vec::new();
    for mut joint in joints {
        let mut away_px = |own: &Candidate| {
            let relative = own.placement.relative_to(&joint.placements[0]);
            *known.entry(relative).or_insert_with(|| disagreement_px(&shared(relative, [first, other], axis_px)))
        };
        let nearest = other.candidates.iter().map(|own| (away_px(own), own)).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((away_px, own)) = nearest else { continue };
        least_px = least_px.min(away_px);
        let away_share = away_px / other.lattice.step_px();
        if away_share < SAME_SHARE {
            joint.placements.push(own.placement);
            joint.missed += own.missed;
            joint.away_share += away_share;
            more.push(joint);
        }
    }
    if more.is_empty() {
        let [first, second] = [first, other].map(|shown| shown.band.to_owned());
        return Err(SightingError::Apart { first, second, away_px: least_px });
    }
    Ok(more)
}

/// Two bands show the same dots if they agree to this share of a step.
const SAME_SHARE: f64 = 0.25;

/// The grid among the features of a band, which must be the only one.
fn lattice(target: &Target, band: &str, spots: &[Spot]) -> Result<Lattice, SightingError> {
    const SECOND_SHARE: f64 = 0.3;
    let all: Vec<usize> = (0..spots.len()).collect();
    let mut lattice = even(spots, &all).unwrap_or_default();
    leave_out_wide(target, &mut lattice, spots);
    let placed = lattice.at.len();
    if placed < DOTS_MIN {
        return Err(SightingError::NoTarget { band: band.to_owned(), features: spots.len(), placed });
    }
    let is_used = {
        let mut is_used = vec![false; spots.len()];
        lattice.at.values().for_each(|index| is_used[*index] = true);
        is_used
    };
    let others: Vec<usize> = all.into_iter().filter(|index| !is_used[*index]).collect();
    let second = even(spots, &others).map_or(0, |second| second.at.len());
    if second >= DOTS_MIN && second as f64 > SECOND_SHARE * placed as f64 {
        return Err(SightingError::TwoTargets { band: band.to_owned(), first: placed, second });
    }
    Ok(lattice)
}

/// The largest lattice among some features, if it is no mere chance.
fn even(spots: &[Spot], among: &[usize]) -> Option<Lattice> {
    /// Perspective and distortion bend rows by hundredths of a step; features at random places by about a tenth and more.
    const UNEVENNESS_MAX: f64 = 0.06;
    Lattice::largest(spots, among).filter(|lattice| lattice.unevenness(spots) < UNEVENNESS_MAX)
}

/// Leaves out what is too wide for a dot: among dark dots the dark spot that the masks leave, with the dots it touches.
fn leave_out_wide(target: &Target, lattice: &mut Lattice, spots: &[Spot]) {
    // Dots that are nearer look larger, but by less than this factor.
    const NEARER: f64 = 2.0;
    let spec = target.spec();
    let widest_mm =
        spec.fiducials.iter().filter_map(|fiducial| fiducial.diameter_mm).fold(spec.dot_diameter_mm, f64::max);
    let most_px = NEARER * widest_mm / spec.dot_diameter_mm * typical_side_px(lattice, spots);
    lattice.at.retain(|_, feature| spots[*feature].area_px.sqrt() <= most_px);
}

/// The root of the typical area of a lattice's dots.
fn typical_side_px(lattice: &Lattice, spots: &[Spot]) -> f64 {
    median(lattice.at.values().map(|index| spots[*index].area_px.sqrt()))
}

/// How a lattice lies on the target: turned by quarters, and shifted.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Placement {
    quarters: usize,
    is_mirrored: bool,
    shift: [i32; 2],
    /// How far the target's columns are from running along u, and its middle from that of the lattice.
    oddness: f64,
}

impl Placement {
    /// Column and row of a place of the lattice.
    fn place(&self, [i, j]: [i32; 2]) -> [i32; 2] {
        let [i, j] = turned(if self.is_mirrored { [j, i] } else { [i, j] }, self.quarters);
        [i + self.shift[0], j + self.shift[1]]
    }

    /// How places of another's lattice lie in this one's, if neither is mirrored.
    fn relative_to(&self, other: &Self) -> Relative {
        let back = (4 - self.quarters) % 4;
        let [i, j] = [0, 1].map(|k| other.shift[k] - self.shift[k]);
        Relative { quarters: (other.quarters + back) % 4, shift: turned([i, j], back) }
    }

    fn labelled(&self, target: &Target, lattice: &Lattice) -> Vec<Labelled> {
        let dot = |(place, feature): (&[i32; 2], &usize)| {
            let [column, row] = self.place(*place).map(usize::try_from);
            Some((target.dot_at(row.ok()?, column.ok()?)?, *feature))
        };
        let mut labelled: Vec<Labelled> = lattice.at.iter().filter_map(dot).collect();
        labelled.sort_unstable();
        labelled
    }
}

/// How the places of one lattice lie in another: turned by quarters, and shifted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Relative {
    quarters: usize,
    shift: [i32; 2],
}

impl Relative {
    fn place(&self, place: [i32; 2]) -> [i32; 2] {
        let [i, j] = turned(place, self.quarters);
        [i + self.shift[0], j + self.shift[1]]
    }
}

/// A place turned by quarters about the origin.
fn turned([i, j]: [i32; 2], quarters: usize) -> [i32; 2] {
    match quarters {
        0 => [i, j],
        1 => [-j, i],
        2 => [-i, -j],
        _ => [j, -i],
    }
}

/// All ways to lay a lattice onto the target, the plainest first.
fn placements(target: &Target, lattice: &Lattice, is_mirrored: bool) -> Vec<Placement> {
    let sides = [target.spec().columns as i32, target.spec().rows as i32];
    let mut placements = Vec::new();
    for quarters in 0..4 {
        let turned = Placement { quarters, is_mirrored, shift: [0, 0], oddness: 0.0 };
        let places = || lattice.at.keys().map(|place| turned.place(*place));
        let extent = [0, 1].map(|k| {
            let along = || places().map(|place| place[k]);
            [along().min().unwrap_or(0), along().max().unwrap_or(0)]
        });
        let spare = [0, 1].map(|k| sides[k] - (extent[k][1] - extent[k][0] + 1));
        // Where the step along the columns goes: u turned back by the quarters.
        let [along, across] = lattice.steps_px;
        let columns_px = match quarters {
            0 => along,
            1 => across.map(|component| -component),
            2 => along.map(|component| -component),
            _ => across,
        };
        let turn = columns_px[1].atan2(columns_px[0]).abs();
        for column in 0..=spare[0] {
            for row in 0..=spare[1] {
                let off = [(column, spare[0]), (row, spare[1])];
                let off: f64 = off.iter().map(|(at, spare)| (f64::from(*at) - 0.5 * f64::from(*spare)).abs()).sum();
                let shift = [column - extent[0][0], row - extent[1][0]];
                placements.push(Placement { quarters, is_mirrored, shift, oddness: 10.0 * turn + off });
            }
        }
    }
    placements.sort_by(|a, b| a.oddness.total_cmp(&b.oddness));
    placements
}

/// The ways that go against no fiducial, the plainest first.
fn candidates(target: &Target, band: &str, lattice: &Lattice, spots: &[Spot]) -> Result<Vec<Candidate>, SightingError> {
    // Dots may be lost, as on the axis, where the masks shut both bands: only what is shown and should not be counts.
    let scored = |placement: Placement| (wrong(target, lattice, spots, &placement), placement);
    let upright: Vec<_> = placements(target, lattice, false).into_iter().map(scored).collect();
    let Some(wrong) = upright.iter().map(|(wrong, _)| *wrong).min() else {
        let found = lattice.extent().map(|[low, high]| high - low + 1);
        let stated = [target.spec().columns, target.spec().rows];
        return Err(SightingError::TooLarge { band: band.to_owned(), found, stated });
    };
    if wrong == 0 {
        let right = upright.into_iter().filter(|(wrong, _)| *wrong == 0);
        let candidate = |(_, placement)| Candidate { placement, missed: missed(target, lattice, &placement) };
        return Ok(right.map(candidate).collect());
    }
    let band = band.to_owned();
    let is_mirrored = placements(target, lattice, true).into_iter().map(scored).any(|(wrong, _)| wrong == 0);
    Err(if is_mirrored { SightingError::Mirrored { band } } else { SightingError::Unlike { band, wrong } })
}

/// Places that are not as the target says: dots where there are none, or of another size.
fn wrong(target: &Target, lattice: &Lattice, spots: &[Spot], placement: &Placement) -> usize {
    let spec = target.spec();
    if spec.fiducials.is_empty() {
        return 0;
    }
    let typical_px = typical_side_px(lattice, spots);
    let is_wrong = |(place, feature): &(&[i32; 2], &usize)| {
        let [column, row] = placement.place(**place).map(|side| side as usize);
        let seen = spots[**feature].area_px.sqrt() / typical_px;
        match target.fiducial(row, column).map(|fiducial| fiducial.diameter_mm) {
            Some(None) => true,
            Some(Some(diameter_mm)) => seen < 0.5 * (1.0 + diameter_mm / spec.dot_diameter_mm),
            None => is_larger(target, seen),
        }
    };
    lattice.at.iter().filter(is_wrong).count()
}

/// Whether a dot is as large, relative to the typical one, as the target's larger dots.
fn is_larger(target: &Target, seen: f64) -> bool {
    let larger_mm =
        target.spec().fiducials.iter().filter_map(|fiducial| fiducial.diameter_mm).fold(f64::INFINITY, f64::min);
    seen > 0.5 * (1.0 + larger_mm / target.spec().dot_diameter_mm)
}

/// Holes in the midst of the lattice where the target has a dot.
fn missed(target: &Target, lattice: &Lattice, placement: &Placement) -> usize {
    let neighbours = |[i, j]: [i32; 2]| [[i + 1, j], [i - 1, j], [i, j + 1], [i, j - 1]];
    let is_shown = |place: &[i32; 2]| lattice.at.contains_key(place);
    let beside = lattice.at.keys().flat_map(|place| neighbours(*place)).filter(|place| !is_shown(place));
    let mut holes: Vec<[i32; 2]> =
        beside.filter(|place| neighbours(*place).iter().filter(|beside| is_shown(beside)).count() >= 3).collect();
    holes.sort_unstable();
    holes.dedup();
    let is_dot = |place: &[i32; 2]| {
        let [column, row] = placement.place(*place).map(usize::try_from);
        matches!((column, row), (Ok(column), Ok(row)) if target.dot_at(row, column).is_some())
    };
    holes.iter().filter(|place| is_dot(place)).count()
}

/// Where two bands show the same dot, from the axis, px.
type Both = [nalgebra::Vector2<f64>; 2];

/// The dots that two bands share if places of the first lie so in the second.
fn shared(relative: Relative, shown: [&Shown<'_>; 2], axis_px: [f64; 2]) -> Vec<Both> {
    let from_axis = |shown: &Shown<'_>, feature: usize| {
        let [u, v] = shown.spots[feature].centre_px;
        nalgebra::Vector2::new(u - axis_px[0], v - axis_px[1])
    };
    let [first, second] = shown;
    let both = |(place, feature): (&[i32; 2], &usize)| {
        let other = second.lattice.at.get(&relative.place(*place))?;
        Some((*feature, [from_axis(first, *feature), from_axis(second, *other)]))
    };
    let mut shared: Vec<(usize, Both)> = first.lattice.at.iter().filter_map(both).collect();
    // In an order of their own, so that sums are the same on every run.
    shared.sort_unstable_by_key(|(feature, _)| *feature);
    shared.into_iter().map(|(_, both)| both).collect()
}

/// Root mean square distance of the dots that two bands share when the first is scaled about the axis to the second, by
/// a scale that may grow across it.
fn disagreement_px(shared: &[Both]) -> f64 {
    if shared.len() < DOTS_MIN {
        return f64::INFINITY;
    }
    let (mut information, mut score) = (nalgebra::Matrix3::zeros(), nalgebra::Vector3::zeros());
    // Lengths of about one keep the equations sound.
    let size_px = shared.iter().map(|[p, _]| p.norm()).fold(1.0, f64::max);
    let rows = |p: &nalgebra::Vector2<f64>| {
        let scales = nalgebra::Vector3::new(1.0, p.x / size_px, p.y / size_px);
        [scales * p.x, scales * p.y]
    };
    for [p, q] in shared {
        for (row, seen) in rows(p).into_iter().zip(q.iter()) {
            information += row * row.transpose();
            score += row * *seen;
        }
    }
    let scales = information.cholesky().map(|factor| factor.solve(&score));
    // A grid upside down about its middle, on the axis, is one scaled by −1.
    let Some(scales) = scales.filter(|scales| scales.x > 0.0) else { return f64::INFINITY };
    let squares = shared.iter().flat_map(|[p, q]| {
        let [u, v] = rows(p).map(|row| row.dot(&scales));
        [(u - q.x).powi(2), (v - q.y).powi(2)]
    });
    (squares.sum::<f64>() / shared.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::target::{Fiducial, TargetKind, TargetSpec};

    const AXIS_PX: [f64; 2] = [960.0, 600.0];

    fn target(fiducials: Vec<Fiducial>) -> Target {
        Target::new(TargetSpec {
            schema: 1,
            name: "t".to_owned(),
            kind: TargetKind::DotGrid,
            rows: 5,
            columns: 7,
            pitch_mm: 2.0,
            dot_diameter_mm: 1.0,
            fiducials,
        })
        .unwrap()
    }

    fn missing(row: usize, column: usize) -> Fiducial {
        Fiducial { row, column, diameter_mm: None }
    }

    /// The target's dots turned, scaled about the axis and cut off beyond a height.
    fn seen(target: &Target, turn_rad: f64, scale: f64, mirror: f64) -> Vec<Spot> {
        let (sin, cos) = turn_rad.sin_cos();
        let spot = |dot: &crate::target::TargetDot| {
            let [x, y] = [mirror * dot.position_mm[0] + 1.0, dot.position_mm[1] - 2.0];
            let [x, y] = [cos * x - sin * y, sin * x + cos * y];
            let centre_px = [AXIS_PX[0] + scale * x, AXIS_PX[1] + scale * y];
            Spot { centre_px, area_px: (0.5 * dot.diameter_mm * scale).powi(2) * std::f64::consts::PI }
        };
        target.dots().iter().map(spot).collect()
    }

    #[test]
    fn a_whole_target_is_labelled_in_both_bands() {
        let target = target(vec![missing(0, 1)]);
        let middle = target.dot_at(2, 3).unwrap();
        for turn_rad in [0.1, 1.4, 3.0, -2.0] {
            let bands = [("a", seen(&target, turn_rad, 90.0, 1.0)), ("b", seen(&target, turn_rad, 75.0, 1.0))];
            let sighting = recognise(&target, &bands, AXIS_PX).unwrap();
            for labelled in sighting {
                assert_eq!(labelled, (0..34).map(|dot| (dot, dot)).collect::<Vec<_>>());
            }
            // The masks shut both bands on the axis.
            let mut holed = seen(&target, turn_rad, 90.0, 1.0);
            holed.remove(middle);
            let labelled = recognise(&target, &[("a", holed)], AXIS_PX).unwrap().remove(0);
            let expected = (0..34).filter(|dot| *dot != middle).map(|dot| (dot, dot - usize::from(dot > middle)));
            assert_eq!(labelled, expected.collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_part_is_labelled_alike_in_both_bands() {
        let target = target(Vec::new());
        let whole = seen(&target, 0.05, 90.0, 1.0);
        let part: Vec<Spot> = seen(&target, 0.05, 75.0, 1.0)[7..].to_vec();
        let sighting = recognise(&target, &[("a", whole), ("b", part)], AXIS_PX).unwrap();
        assert!(sighting[1].iter().all(|(dot, feature)| *dot == feature + 7), "{:?}", sighting[1]);
    }

    #[test]
    fn upside_down_is_not_the_same() {
        let target = target(Vec::new());
        let places: Vec<_> = target.dots().iter().map(|dot| nalgebra::Vector2::from(dot.position_mm)).collect();
        // About the target's own middle.
        let away = |sign: f64| disagreement_px(&places.iter().map(|p| [90.0 * p, sign * 75.0 * p]).collect::<Vec<_>>());
        assert!(away(1.0) < 1e-9);
        assert_eq!(away(-1.0), f64::INFINITY);
    }

    #[test]
    fn a_fiducial_that_one_band_shows_tells_of_all() {
        let target = target(vec![missing(0, 0)]);
        // Upside down; the first or the second band is cut off before the row of the fiducial.
        for turn_rad in [0.05, 3.1] {
            let [whole, part] = [seen(&target, turn_rad, 90.0, 1.0), seen(&target, turn_rad, 75.0, 1.0)[6..].to_vec()];
            let all: Vec<Labelled> = (0..34).map(|dot| (dot, dot)).collect();
            let rest: Vec<Labelled> = (6..34).map(|dot| (dot, dot - 6)).collect();
            let sighted = |bands: [(&str, Vec<Spot>); 2]| recognise(&target, &bands, AXIS_PX).unwrap();
            assert_eq!(sighted([("a", part.clone()), ("b", whole.clone())]), [rest.clone(), all.clone()]);
            assert_eq!(sighted([("a", whole), ("b", part)]), [all, rest]);
        }
    }

    #[test]
    fn a_dark_spot_with_the_dots_it_touches_is_no_dot() {
        let target = target(Vec::new());
        let whole = seen(&target, 0.1, 90.0, 1.0);
        let (row, column) = (2, 3);
        let swallowed = |dot: &usize| dot / 7 == row && (dot % 7).abs_diff(column) <= 1;
        let mut spots: Vec<Spot> = (0..whole.len()).filter(|dot| !swallowed(dot)).map(|dot| whole[dot]).collect();
        let [u, v] = whole[target.dot_at(row, column).unwrap()].centre_px;
        spots.push(Spot { centre_px: [u + 14.0, v], area_px: 13.0 * whole[0].area_px });
        let labelled = recognise(&target, &[("a", spots)], AXIS_PX).unwrap().remove(0);
        let left: Vec<usize> = (0..whole.len()).filter(|dot| !swallowed(dot)).collect();
        assert_eq!(labelled, left.into_iter().enumerate().map(|(feature, dot)| (dot, feature)).collect::<Vec<_>>());
    }

    #[test]
    fn what_is_wrong_is_told() {
        let plain = target(Vec::new());
        let marked = target(vec![missing(0, 1)]);
        let of = |target: &Target, spots: Vec<Spot>| recognise(target, &[("a", spots)], AXIS_PX).unwrap_err();
        assert!(matches!(of(&marked, seen(&marked, 0.1, 90.0, -1.0)), SightingError::Mirrored { .. }));
        assert!(matches!(of(&marked, seen(&plain, 0.1, 90.0, 1.0)), SightingError::Unlike { wrong: 1, .. }));
        assert!(matches!(of(&plain, Vec::new()), SightingError::NoTarget { features: 0, .. }));
        let mut two = seen(&plain, 0.1, 40.0, 1.0);
        two.extend(
            seen(&plain, 0.3, 40.0, 1.0)
                .into_iter()
                .map(|spot| Spot { centre_px: [spot.centre_px[0] + 700.0, spot.centre_px[1]], ..spot }),
        );
        assert!(matches!(of(&plain, two), SightingError::TwoTargets { .. }));
        let spec = TargetSpec { rows: 4, ..plain.spec().clone() };
        let smaller = Target::new(spec).unwrap();
        assert!(matches!(of(&smaller, seen(&plain, 0.1, 90.0, 1.0)), SightingError::TooLarge { .. }));
    }
}
