//! Pairs that show only when the fit has told where their light ends and that of their neighbours begins.

use std::f64::consts::PI;

use super::{Fitting, Placed, Placing, Reconstructor};
use crate::detect::{Detection, Feature};
use crate::further::Group;
use crate::matching::{Epipole, Match, MatchOptions};

/// Where a feature lies that became no point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lone {
    pub(super) band: usize,
    /// Of the detection's features.
    pub(super) feature: usize,
    /// The seed that was made of it.
    pub(super) seed: usize,
}

/// Fitted centres lie beside their partner's azimuth by no more than this, px.
const AZIMUTH_STD_PX: f64 = 0.3;
const AZIMUTH_TOLERANCE_PX: f64 = 2.0;

impl Reconstructor {
    /// Pairs features once more that found no partner, at the places where the fit has found their light; whether any
    /// found one.
    pub(super) fn pair_late(&self, detections: &mut [Detection], placing: &mut Placing, fitting: &Fitting) -> bool {
        let lone = |band: usize| fitting.lone.iter().filter(move |lone| lone.band == band);
        if [0, 1].into_iter().any(|band| lone(band).next().is_none()) {
            return false;
        }
        for lone in &fitting.lone {
            self.renew(&mut detections[lone.band].features[lone.feature], lone, fitting);
        }
        let [telecentric, entocentric] =
            [0, 1].map(|band| lone(band).map(|lone| detections[band].features[lone.feature]).collect::<Vec<_>>());
        let options = MatchOptions {
            azimuth_std_px: AZIMUTH_STD_PX.min(self.options.matching.azimuth_std_px),
            azimuth_tolerance_px: AZIMUTH_TOLERANCE_PX.min(self.options.matching.azimuth_tolerance_px),
            ..self.options.matching
        };
        let epipole = Epipole::new(&self.model, &self.instrument.sensor, self.instrument.depth_range());
        placing.matcher.pair_up(&epipole, &telecentric, &entocentric, &options, &mut placing.pairs);
        if placing.pairs.is_empty() {
            return false;
        }
        let index = |band: usize, place: usize| lone(band).nth(place).map_or(0, |lone| lone.feature);
        let late = placing.pairs.drain(..).map(|pair| Match {
            telecentric: index(0, pair.telecentric),
            entocentric: index(1, pair.entocentric),
            ..pair
        });
        placing.groups.extend(late.map(Group::late));
        self.place_late(detections, placing);
        true
    }

    /// Gives a feature the place and size that its band's pixels tell of it.
    fn renew(&self, feature: &mut Feature, lone: &Lone, fitting: &Fitting) {
        let refined = fitting.refined.get(lone.seed).and_then(Option::as_ref);
        let Some(own) = refined.and_then(|refined| refined.centres[lone.band]) else { return };
        let register = &self.registers[lone.band];
        (feature.centre, feature.centre_std_px) = register.mapped_centre(own.centre, own.std_px);
        feature.area_px = PI * own.radius_px * own.radius_px * register.area_px2(own.centre);
    }

    /// Places the pairs that came last, and puts all in the order of their telecentric features.
    pub(super) fn place_late(&self, detections: &[Detection], placing: &mut Placing) {
        let Placing { groups, points, .. } = placing;
        let placed = groups[points.len()..].iter().map(|group| self.point(detections, group));
        points.extend(placed.collect::<Vec<_>>());
        let mut all: Vec<(Group, Option<Placed>)> = groups.drain(..).zip(points.drain(..)).collect();
        all.sort_by_key(|(group, _)| group.pair.telecentric);
        (*groups, *points) = all.into_iter().unzip();
        self.find_further(detections, groups, points);
    }
}
