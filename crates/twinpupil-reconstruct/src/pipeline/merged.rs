//! Dots whose images one band shows as one and the other apart.

use smallvec::SmallVec;

use super::{Fitting, Placed, Placing, Reconstructor};
use crate::detect::{Detection, Feature};
use crate::further::Group;
use crate::matching::Match;
use crate::slope::Slopes;

/// Dots in one feature, at most.
const PARTS_MAX: usize = 4;

/// Areas of the parts of a feature add up to its own within this factor: their skirts lie over one another.
const AREA_FACTOR: f64 = 2.0;

/// A part lies no farther from the middle of the whole than this share of the radius of a disc of its area.
const SPREAD: f64 = 1.2;

impl Reconstructor {
    /// Divides features that found no partner between the dots that the other band shows apart: those whose partners, on the
    /// surface that the points about them show, lie within such a feature and fill it. Whether there were any.
    pub(super) fn divide_merged(
        &self,
        detections: &mut [Detection],
        placing: &mut Placing,
        fitting: &mut Fitting,
    ) -> bool {
        let Fitting { lone, .. } = fitting;
        lone.retain(|lone| !placing.groups.iter().any(|group| group.feature(lone.band) == Some(lone.feature)));
        let of_band = |band: usize| lone.iter().filter(move |lone| lone.band == band).map(|lone| lone.feature);
        if [0, 1].into_iter().any(|band| of_band(band).next().is_none()) {
            return false;
        }
        placing.slopes.lay_through(placing.points.iter().flatten().map(|placed| placed.point.position_mm));
        let before = placing.groups.len();
        for (merged, apart) in [(0, 1), (1, 0)] {
            let predicted: SmallVec<[Part; PARTS_MAX]> = of_band(apart)
                .filter_map(|partner| {
                    let feature = &detections[apart].features[partner];
                    let image = self.partner(apart, merged, feature, &mut placing.slopes, &placing.points)?;
                    Some(Part { partner, image })
                })
                .collect();
            for whole in of_band(merged) {
                let features = &mut detections[merged].features;
                let parts: SmallVec<[Part; PARTS_MAX]> =
                    predicted.iter().filter(|part| part.lies_within(&features[whole])).copied().collect();
                if fill(&parts, &features[whole]) {
                    divide(features, whole, &parts);
                    let added = features.len() + 1 - parts.len()..features.len();
                    let indices = std::iter::once(whole).chain(added);
                    let pairs = parts.iter().zip(indices).map(|(part, index)| part.pair(merged, index));
                    placing.groups.extend(pairs.map(Group::late));
                }
            }
        }
        let any = placing.groups.len() > before;
        if any {
            self.place_late(detections, placing);
        }
        any
    }

    /// What another band shows of a feature's dot if it stands on the surface about it.
    fn partner(
        &self,
        band: usize,
        other: usize,
        feature: &Feature,
        slopes: &mut Slopes,
        points: &[Option<Placed>],
    ) -> Option<Feature> {
        const ROUNDS: usize = 6;
        let sensor = &self.instrument.sensor;
        let image = sensor.image_from_pixel(feature.centre);
        let mut place_mm = [0.0, 0.0, self.instrument.focus_distance_mm()];
        for _ in 0..ROUNDS {
            let magnification = self.model.magnification(band, place_mm[2]);
            let [x_mm, y_mm] = [image.x_mm / magnification, image.y_mm / magnification];
            let away_mm2 = |point_mm: &[f64; 3]| (point_mm[0] - x_mm).powi(2) + (point_mm[1] - y_mm).powi(2);
            let all_mm = points.iter().flatten().map(|placed| placed.point.position_mm);
            let near_mm = all_mm.min_by(|a, b| away_mm2(a).total_cmp(&away_mm2(b)))?;
            let [sx, sy] = slopes.at([x_mm, y_mm, place_mm[2]])?;
            place_mm = [x_mm, y_mm, near_mm[2] + sx * (x_mm - near_mm[0]) + sy * (y_mm - near_mm[1])];
        }
        let [own, there] = [band, other].map(|band| self.model.magnification(band, place_mm[2]));
        let centre = sensor.pixel_from_image(self.model.chief_image(other, place_mm));
        Some(Feature { centre, area_px: feature.area_px * (there / own).powi(2), ..*feature })
    }
}

/// A dot that one band shows apart, and its image in the other where that shows it together with others.
#[derive(Debug, Clone, Copy)]
struct Part {
    /// Index of its feature in the band that shows it apart.
    partner: usize,
    image: Feature,
}

impl Part {
    /// Whether its middle lies in the whole.
    fn lies_within(&self, whole: &Feature) -> bool {
        let away_px = (self.image.centre.u - whole.centre.u).hypot(self.image.centre.v - whole.centre.v);
        away_px < SPREAD * (whole.area_px / std::f64::consts::PI).sqrt()
    }

    /// With its feature at `index` of the band that merged it.
    fn pair(&self, merged: usize, index: usize) -> Match {
        let [telecentric, entocentric] = if merged == 0 { [index, self.partner] } else { [self.partner, index] };
        Match { telecentric, entocentric, azimuth_residual_px: 0.0, ambiguous: false }
    }
}

/// Whether there are several parts, and they fill the whole.
fn fill(parts: &[Part], whole: &Feature) -> bool {
    let area_px: f64 = parts.iter().map(|part| part.image.area_px).sum();
    (2..=PARTS_MAX).contains(&parts.len()) && (whole.area_px / area_px).max(area_px / whole.area_px) < AREA_FACTOR
}

/// Puts the first part in place of the whole, and the others behind all features.
fn divide(features: &mut Vec<Feature>, whole: usize, parts: &[Part]) {
    let height_codes = features[whole].height_codes;
    let mut own = parts.iter().map(|part| Feature { height_codes, overlapped: true, ..part.image });
    if let Some(first) = own.next() {
        features[whole] = first;
    }
    features.extend(own);
}
