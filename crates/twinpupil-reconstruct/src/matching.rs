//! Which telecentric feature and which entocentric feature are images of the same thing.

use twinpupil_instrument::{DepthRange, ImagePoint, PixelPoint, Sensor};

use crate::assignment::{Assignment, Edge, Edges};
use crate::cells::Cells;
use crate::detect::Feature;
use crate::model::Model;
use crate::quantile::STD_PER_DISTANCE;

/// How features are paired.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchOptions {
    /// How far from its partner's azimuth a feature may lie, px.
    pub azimuth_tolerance_px: f64,
    /// Scatter of features about their partner's azimuth, px: the axis is never known perfectly.
    pub azimuth_std_px: f64,
    /// Scatter of the logarithm of the two areas' ratio about what the depth demands.
    pub area_log_std: f64,
    /// χ² at which a feature had better stay alone.
    pub single_chi2: f64,
    /// How far from where a point is predicted in a further band its feature there may lie, px.
    pub prediction_tolerance_px: f64,
    /// A pair is ambiguous if another choice costs less than this much more, in χ².
    pub ambiguous_chi2: f64,
}

impl Default for MatchOptions {
    fn default() -> Self {
        Self {
            azimuth_tolerance_px: 4.0,
            azimuth_std_px: 1.0,
            area_log_std: 0.15,
            single_chi2: 40.0,
            prediction_tolerance_px: 4.0,
            ambiguous_chi2: 4.0,
        }
    }
}

/// A telecentric and an entocentric feature that belong together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Match {
    pub(crate) telecentric: usize,
    pub(crate) entocentric: usize,
    /// How far the entocentric feature lies beside the telecentric one's azimuth, px.
    pub(crate) azimuth_residual_px: f64,
    /// Whether another choice would have been nearly as good.
    pub(crate) ambiguous: bool,
}

/// Pairs features; its buffers are used again from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Matcher {
    cells: Cells,
    candidates: Vec<Candidate>,
    edges: Edges,
    assignment: Assignment,
    sizes_px: Vec<f64>,
}

impl Matcher {
    /// Pairs features one to one so that the sum of χ² is least; `pairs` is overwritten.
    ///
    /// For every telecentric feature the depth range draws a line on the sensor along its azimuth, on which its partner
    /// must lie. χ² of a candidate is its distance from that line, and how far the two areas are from the ratio that
    /// the candidate's depth gives them.
    pub(crate) fn pair_up(
        &mut self,
        epipole: &Epipole<'_>,
        telecentric: &[Feature],
        entocentric: &[Feature],
        options: &MatchOptions,
        pairs: &mut Vec<Match>,
    ) {
        // Lines are long and cells few where features are large.
        const CROWD: f64 = 0.6;
        let Self { cells, candidates, edges, assignment, sizes_px } = self;
        cells.fill(entocentric.iter().map(|feature| [feature.centre.u, feature.centre.v]), CROWD);
        candidates.clear();
        edges.clear();
        for feature in telecentric {
            let line = SearchLine::new(epipole, feature.centre);
            let first = candidates.len();
            along(cells, &line, options.azimuth_tolerance_px, |index| {
                candidates.extend(Candidate::judge(&line, feature, entocentric, index, options));
            });
            edges.push(candidates[first..].iter().map(|c| Edge { right: c.entocentric, cost: c.chi2 }));
        }
        assignment.solve(edges, entocentric.len(), options.single_chi2);
        pairs.clear();
        // Candidates stand in the order of their telecentric features, as their edges do.
        let mut list = &candidates[..];
        for index in 0..telecentric.len() {
            let (own, rest) = list.split_at(edges.of(index).len());
            list = rest;
            let chosen = assignment.partner(index).and_then(|partner| own.iter().find(|c| c.entocentric == partner));
            pairs.extend(chosen.map(|candidate| Match {
                telecentric: index,
                entocentric: candidate.entocentric as usize,
                azimuth_residual_px: candidate.azimuth_residual_px,
                ambiguous: assignment.margin(index) < options.ambiguous_chi2,
            }));
        }
        drop_strays(pairs, sizes_px);
    }
}

/// Drops pairs that lie far beside their azimuth when most of the frame's pairs do not: they belong to no one thing.
fn drop_strays(pairs: &mut Vec<Match>, sizes_px: &mut Vec<f64>) {
    const FEWEST: usize = 6;
    const SIGMAS: f64 = 6.0;
    const STD_MIN_PX: f64 = 0.15;
    if pairs.len() < FEWEST {
        return;
    }
    sizes_px.clear();
    sizes_px.extend(pairs.iter().map(|pair| pair.azimuth_residual_px.abs()));
    let middle = sizes_px.len() / 2;
    let median_px = *sizes_px.select_nth_unstable_by(middle, f64::total_cmp).1;
    let limit_px = SIGMAS * (STD_PER_DISTANCE * median_px).max(STD_MIN_PX);
    pairs.retain(|pair| pair.azimuth_residual_px.abs() <= limit_px);
}

/// How the entocentric image of anything follows from its telecentric one at both ends of the depth range.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Epipole<'a> {
    sensor: &'a Sensor,
    /// At the near end and at the far one.
    ends: [End; 2],
}

/// At one distance.
#[derive(Debug, Clone, Copy)]
struct End {
    /// Entocentric over telecentric magnification.
    size_ratio: f64,
    /// Images of a point on the axis: a pupil that is off the axis shifts all images alike.
    telecentric: ImagePoint,
    entocentric: ImagePoint,
}

impl<'a> Epipole<'a> {
    pub(crate) fn new(model: &Model, sensor: &'a Sensor, range: DepthRange) -> Self {
        let end = |z_mm: f64| {
            let [r, b] = model.magnifications(z_mm);
            let [telecentric, entocentric] = model.chief_images([0.0, 0.0, z_mm]);
            End { size_ratio: b / r, telecentric, entocentric }
        };
        Self { sensor, ends: [end(range.near_mm), end(range.far_mm)] }
    }

    /// Where the partner of a telecentric image lies at one end.
    fn partner(&self, end: &End, image: ImagePoint) -> PixelPoint {
        self.sensor.pixel_from_image(ImagePoint {
            x_mm: end.entocentric.x_mm + (image.x_mm - end.telecentric.x_mm) * end.size_ratio,
            y_mm: end.entocentric.y_mm + (image.y_mm - end.telecentric.y_mm) * end.size_ratio,
        })
    }
}

/// Where on the sensor the partner of a telecentric feature may lie, from the near end of the depth range to the far.
struct SearchLine {
    near: PixelPoint,
    far: PixelPoint,
    /// From the near end to the far one: of length 1, and its length in px.
    direction: [f64; 2],
    length_px: f64,
    /// Entocentric over telecentric magnification at both ends, linear between them.
    size_ratio: [f64; 2],
}

impl SearchLine {
    fn new(epipole: &Epipole<'_>, telecentric: PixelPoint) -> Self {
        let image = epipole.sensor.image_from_pixel(telecentric);
        let [near, far] = epipole.ends.map(|end| epipole.partner(&end, image));
        let (du, dv) = (far.u - near.u, far.v - near.v);
        let length_px = (du * du + dv * dv).sqrt().max(1e-9);
        Self {
            near,
            far,
            direction: [du / length_px, dv / length_px],
            length_px,
            size_ratio: epipole.ends.map(|end| end.size_ratio),
        }
    }

    /// Position of a pixel along the line (0 near, 1 far) and beside it in px.
    #[inline]
    fn locate(&self, point: PixelPoint) -> (f64, f64) {
        let [du, dv] = self.direction;
        let (pu, pv) = (point.u - self.near.u, point.v - self.near.v);
        ((pu * du + pv * dv) / self.length_px, du * pv - dv * pu)
    }
}

#[derive(Debug, Clone, Copy)]
struct Candidate {
    entocentric: u32,
    chi2: f64,
    azimuth_residual_px: f64,
}

impl Candidate {
    #[inline]
    fn judge(
        line: &SearchLine,
        telecentric: &Feature,
        entocentric: &[Feature],
        index: u32,
        options: &MatchOptions,
    ) -> Option<Self> {
        let feature = &entocentric[index as usize];
        let (along, beside_px) = line.locate(feature.centre);
        if !(0.0..=1.0).contains(&along) || beside_px.abs() > options.azimuth_tolerance_px {
            return None;
        }
        let [near, far] = line.size_ratio;
        let size_ratio = near + along * (far - near);
        let area_log = (feature.area_px / telecentric.area_px / size_ratio.powi(2)).ln();
        let noise_px2: f64 =
            [telecentric, feature].iter().map(|f| f.centre_std_px[0].max(f.centre_std_px[1]).powi(2)).sum();
        let chi2 = beside_px.powi(2) / (options.azimuth_std_px.powi(2) + noise_px2)
            + (area_log / options.area_log_std).powi(2);
        (chi2 < options.single_chi2).then_some(Self { entocentric: index, chi2, azimuth_residual_px: beside_px })
    }
}

/// Calls `found` with what lies in the cells within a margin of a line: row by row of cells, between the columns where
/// the line enters and leaves the row.
fn along(cells: &Cells, line: &SearchLine, margin_px: f64, mut found: impl FnMut(u32)) {
    let (top, bottom) = if line.near.v <= line.far.v { (line.near, line.far) } else { (line.far, line.near) };
    let inverse = 1.0 / (bottom.v - top.v).max(1e-9);
    let u_at = |v_px: f64| top.u + ((v_px - top.v) * inverse).clamp(0.0, 1.0) * (bottom.u - top.u);
    let last_row = cells.count(1) - 1;
    for row in cells.cell(1, top.v - margin_px)..=cells.cell(1, bottom.v + margin_px) {
        // The outer rows also hold what lies beyond them.
        let from_px = if row == 0 { f64::NEG_INFINITY } else { cells.start(1, row) - margin_px };
        let to_px = if row == last_row { f64::INFINITY } else { cells.start(1, row + 1) + margin_px };
        let (a, b) = (u_at(from_px), u_at(to_px));
        let (first, last) = (cells.cell(0, a.min(b) - margin_px), cells.cell(0, a.max(b) + margin_px));
        cells.row(row, first, last).iter().for_each(|index| found(*index));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use twinpupil_instrument::{Instrument, paper};

    fn feature(centre: PixelPoint, area_px: f64) -> Feature {
        Feature {
            centre,
            centre_std_px: [0.01; 2],
            area_px,
            height_codes: 1000.0,
            ground_codes: 0.0,
            edge_px: 4.0,
            overlapped: false,
            saturated: false,
        }
    }

    /// Both images of discs of 1 mm.
    fn features(instrument: &Instrument, model: &Model, objects_mm: &[[f64; 3]]) -> [Vec<Feature>; 2] {
        [0, 1].map(|role| {
            let image = |object_mm: &[f64; 3]| {
                let centre = instrument.sensor.pixel_from_image(model.chief_images(*object_mm)[role]);
                let diameter_px = model.magnifications(object_mm[2])[role] / instrument.sensor.pitch_mm;
                feature(centre, 0.25 * std::f64::consts::PI * diameter_px.powi(2))
            };
            objects_mm.iter().map(image).collect()
        })
    }

    fn matches(objects_mm: &[[f64; 3]]) -> Vec<Match> {
        let instrument = paper::instrument();
        let model = Model::new(&instrument, None);
        let [telecentric, entocentric] = features(&instrument, &model, objects_mm);
        pair_up(&instrument, &model, &telecentric, &entocentric)
    }

    fn pair_up(instrument: &Instrument, model: &Model, telecentric: &[Feature], entocentric: &[Feature]) -> Vec<Match> {
        let epipole = Epipole::new(model, &instrument.sensor, instrument.depth_range());
        let mut pairs = Vec::new();
        Matcher::default().pair_up(&epipole, telecentric, entocentric, &MatchOptions::default(), &mut pairs);
        pairs
    }

    #[test]
    fn dots_on_one_azimuth_are_told_apart_by_their_areas() {
        let pairs = matches(&[[5.0, 0.0, 300.0], [6.2, 0.0, 300.0], [7.4, 0.0, 300.0]]);
        assert_eq!(pairs.len(), 3);
        assert!(pairs.iter().all(|pair| pair.telecentric == pair.entocentric && !pair.ambiguous), "{pairs:?}");
    }

    #[test]
    fn a_dot_outside_the_depth_range_has_no_partner() {
        assert!(matches(&[[5.0, 1.0, 200.0]]).is_empty());
    }

    #[test]
    fn two_entocentric_features_in_the_same_place_are_ambiguous() {
        let instrument = paper::instrument();
        let model = Model::new(&instrument, None);
        let [telecentric, mut entocentric] = features(&instrument, &model, &[[5.0, 0.0, 300.0]]);
        let twin = PixelPoint { u: entocentric[0].centre.u + 3.0, ..entocentric[0].centre };
        entocentric.push(Feature { centre: twin, ..entocentric[0] });
        let pairs = pair_up(&instrument, &model, &telecentric, &entocentric);
        assert_eq!(pairs.len(), 1);
        assert!(pairs[0].ambiguous);
    }

    #[test]
    fn no_partner_near_the_line_is_overlooked() {
        let instrument = paper::instrument();
        let model = Model::new(&instrument, None);
        let objects_mm: Vec<[f64; 3]> = (0..2000)
            .map(|k| f64::from(k) * 0.617)
            .map(|turn| [7.0 * turn.cos(), 7.0 * turn.sin(), 300.0 + 60.0 * (3.7 * turn).sin()])
            .collect();
        let [telecentric, entocentric] = features(&instrument, &model, &objects_mm);
        let epipole = Epipole::new(&model, &instrument.sensor, instrument.depth_range());
        let mut cells = Cells::default();
        for crowd in [0.3, 5.0, 100.0] {
            cells.fill(entocentric.iter().map(|feature| [feature.centre.u, feature.centre.v]), crowd);
            for (index, feature) in (0..).zip(&telecentric) {
                let (line, mut times) = (SearchLine::new(&epipole, feature.centre), 0);
                along(&cells, &line, 4.0, |other| times += usize::from(other == index));
                assert_eq!(times, 1, "{:?}", objects_mm[index as usize]);
            }
        }
    }
}
