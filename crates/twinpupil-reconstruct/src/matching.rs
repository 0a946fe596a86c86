//! Which telecentric feature and which entocentric feature are images of the same thing.

use twinpupil_instrument::{DepthRange, ImagePoint, PixelPoint, Sensor};

use crate::assignment::{Edge, assign};
use crate::detect::Feature;
use crate::model::Model;

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

/// Pairs features one to one so that the sum of χ² is least.
///
/// For every telecentric feature the depth range draws a line on the sensor along its azimuth, on which its partner
/// must lie. χ² of a candidate is its distance from that line, and how far the two areas are from the ratio that the
/// candidate's depth gives them.
pub(crate) fn pair_up(
    model: &Model,
    sensor: &Sensor,
    range: DepthRange,
    telecentric: &[Feature],
    entocentric: &[Feature],
    options: &MatchOptions,
) -> Vec<Match> {
    let cells = Cells::new(entocentric);
    let candidates: Vec<Vec<Candidate>> = telecentric
        .iter()
        .map(|feature| {
            let line = SearchLine::new(model, sensor, range, feature.centre);
            let near = cells.along(&line, options.azimuth_tolerance_px);
            near.filter_map(|index| Candidate::judge(&line, feature, entocentric, index, options)).collect()
        })
        .collect();
    let edges: Vec<Vec<Edge>> = candidates
        .iter()
        .map(|list| list.iter().map(|c| Edge { right: c.entocentric as u32, cost: c.chi2 }).collect())
        .collect();
    let assignment = assign(&edges, entocentric.len(), options.single_chi2);
    let chosen = |(index, partner): (usize, &Option<u32>)| {
        let candidate = candidates[index].iter().find(|c| Some(c.entocentric as u32) == *partner)?;
        Some(Match {
            telecentric: index,
            entocentric: candidate.entocentric,
            azimuth_residual_px: candidate.azimuth_residual_px,
            ambiguous: assignment.margin[index] < options.ambiguous_chi2,
        })
    };
    let mut pairs: Vec<Match> = assignment.partner.iter().enumerate().filter_map(chosen).collect();
    drop_strays(&mut pairs);
    pairs
}

/// Drops pairs that lie far beside their azimuth when most of the frame's pairs do not: they belong to no one thing.
fn drop_strays(pairs: &mut Vec<Match>) {
    const FEWEST: usize = 6;
    const SIGMAS: f64 = 6.0;
    const STD_MIN_PX: f64 = 0.15;
    if pairs.len() < FEWEST {
        return;
    }
    let mut sizes: Vec<f64> = pairs.iter().map(|pair| pair.azimuth_residual_px.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let limit_px = SIGMAS * (1.4826 * sizes[sizes.len() / 2]).max(STD_MIN_PX);
    pairs.retain(|pair| pair.azimuth_residual_px.abs() <= limit_px);
}

/// Where on the sensor the partner of a telecentric feature may lie, from the near end of the depth range to the far.
struct SearchLine {
    near: PixelPoint,
    far: PixelPoint,
    /// Entocentric over telecentric magnification at both ends, linear between them.
    size_ratio: [f64; 2],
}

impl SearchLine {
    fn new(model: &Model, sensor: &Sensor, range: DepthRange, telecentric: PixelPoint) -> Self {
        let image = sensor.image_from_pixel(telecentric);
        let end = |z_mm: f64| {
            let [r, b] = model.magnifications(z_mm);
            // An off-axis pupil shifts the images of all points at a distance alike.
            let [r0, b0] = model.chief_images([0.0, 0.0, z_mm]);
            let along = |image: f64, r0: f64, b0: f64| b0 + (image - r0) * b / r;
            let partner =
                ImagePoint { x_mm: along(image.x_mm, r0.x_mm, b0.x_mm), y_mm: along(image.y_mm, r0.y_mm, b0.y_mm) };
            (sensor.pixel_from_image(partner), b / r)
        };
        let ((near, near_ratio), (far, far_ratio)) = (end(range.near_mm), end(range.far_mm));
        Self { near, far, size_ratio: [near_ratio, far_ratio] }
    }

    /// Position of a pixel along the line (0 near, 1 far) and beside it in px.
    fn locate(&self, point: PixelPoint) -> (f64, f64) {
        let (du, dv) = (self.far.u - self.near.u, self.far.v - self.near.v);
        let length = du.hypot(dv).max(1e-9);
        let (pu, pv) = (point.u - self.near.u, point.v - self.near.v);
        ((pu * du + pv * dv) / (length * length), (du * pv - dv * pu) / length)
    }
}

struct Candidate {
    entocentric: usize,
    chi2: f64,
    azimuth_residual_px: f64,
}

impl Candidate {
    fn judge(
        line: &SearchLine,
        telecentric: &Feature,
        entocentric: &[Feature],
        index: usize,
        options: &MatchOptions,
    ) -> Option<Self> {
        let feature = &entocentric[index];
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

/// Features by square cells of the frame, so that those about a line are found without looking at all.
struct Cells {
    /// Cell of the first feature along u and v, and numbers of cells.
    origin: [i64; 2],
    counts: [usize; 2],
    /// Features cell by cell; cell `k` has those from `starts[k]` to `starts[k + 1]`.
    features: Vec<u32>,
    starts: Vec<u32>,
}

const CELL_PX: f64 = 48.0;

/// Cells along one side, at most: features that are strewn farther share the last one.
const SIDE_MAX: usize = 2048;

impl Cells {
    fn new(features: &[Feature]) -> Self {
        let cell = |feature: &Feature| [Self::of(feature.centre.u), Self::of(feature.centre.v)];
        let (mut low, mut high) = ([i64::MAX; 2], [i64::MIN; 2]);
        for [i, j] in features.iter().map(cell) {
            (low, high) = ([low[0].min(i), low[1].min(j)], [high[0].max(i), high[1].max(j)]);
        }
        let count =
            |axis: usize| (high[axis].saturating_sub(low[axis]).saturating_add(1)).clamp(0, SIDE_MAX as i64) as usize;
        let mut cells =
            Self { origin: low, counts: [count(0), count(1)], features: vec![0; features.len()], starts: Vec::new() };
        cells.starts.resize(cells.counts[0] * cells.counts[1] + 1, 0);
        let places: Vec<usize> = features.iter().map(|feature| cells.place(cell(feature))).collect();
        for &place in &places {
            cells.starts[place + 1] += 1;
        }
        for place in 1..cells.starts.len() {
            cells.starts[place] += cells.starts[place - 1];
        }
        let mut next = cells.starts.clone();
        for (index, place) in (0..).zip(places) {
            cells.features[next[place] as usize] = index;
            next[place] += 1;
        }
        cells
    }

    fn of(position_px: f64) -> i64 {
        (position_px / CELL_PX).floor() as i64
    }

    /// Index of a cell, or of the nearest one.
    fn place(&self, cell: [i64; 2]) -> usize {
        let [i, j] = [0, 1].map(|axis| self.inside(axis, cell[axis]));
        j * self.counts[0] + i
    }

    fn inside(&self, axis: usize, cell: i64) -> usize {
        cell.saturating_sub(self.origin[axis]).clamp(0, self.counts[axis] as i64 - 1) as usize
    }

    /// Features in the cells within a margin of a line, each once: row by row of cells, those between the columns where
    /// the line enters and leaves the row.
    fn along(&self, line: &SearchLine, margin_px: f64) -> impl Iterator<Item = usize> {
        let (near, far) = (line.near, line.far);
        let (top, bottom) = if near.v <= far.v { (near, far) } else { (far, near) };
        let rows = match self.features.is_empty() {
            true => 0..0,
            false => self.inside(1, Self::of(top.v - margin_px))..self.inside(1, Self::of(bottom.v + margin_px)) + 1,
        };
        let u_at = move |v_px: f64| {
            let share = (v_px - top.v) / (bottom.v - top.v).max(1e-9);
            top.u + share.clamp(0.0, 1.0) * (bottom.u - top.u)
        };
        rows.flat_map(move |row| {
            let v_px = (self.origin[1] + row as i64) as f64 * CELL_PX;
            // The outer rows also hold what lies beyond them.
            let from_px = if row == 0 { f64::NEG_INFINITY } else { v_px - margin_px };
            let to_px = if row + 1 == self.counts[1] { f64::INFINITY } else { v_px + CELL_PX + margin_px };
            let (a, b) = (u_at(from_px), u_at(to_px));
            let first = self.inside(0, Self::of(a.min(b) - margin_px));
            let last = self.inside(0, Self::of(a.max(b) + margin_px));
            let start = row * self.counts[0];
            let found = self.starts[start + first] as usize..self.starts[start + last + 1] as usize;
            self.features[found].iter().map(|&index| index as usize)
        })
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
        let options = MatchOptions::default();
        pair_up(&model, &instrument.sensor, instrument.depth_range(), &telecentric, &entocentric, &options)
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
        let (sensor, range) = (&instrument.sensor, instrument.depth_range());
        let pairs = pair_up(&model, sensor, range, &telecentric, &entocentric, &MatchOptions::default());
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
        let cells = Cells::new(&entocentric);
        for (index, feature) in telecentric.iter().enumerate() {
            let line = SearchLine::new(&model, &instrument.sensor, instrument.depth_range(), feature.centre);
            assert!(cells.along(&line, 4.0).any(|other| other == index), "{:?}", objects_mm[index]);
        }
    }
}
