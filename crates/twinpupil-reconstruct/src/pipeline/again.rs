//! A second try for points that the fit has not explained, from where the moments of their light lead.

use twinpupil_instrument::PlaneView;

use super::agreement::birge_ratio2;
use super::{Fitting, Placed, Placing, Reconstructor};
use crate::detect::Detection;
use crate::noise::Noise;
use crate::quantile::median;

/// Bands that contradict one another by so many times the variance that noise gives them may show a place that the fit has not
/// come away from.
const CONTRADICTED: f64 = 25.0;

/// Where its pixels are explained by so much worse than those of others besides, moments that are surer tell the place.
const WORSE: f64 = 1.15;

/// Whether another start may lead a point to a better place.
pub(super) fn is_in_doubt(place: Option<&Placed>, is_other: bool) -> bool {
    let is_contradicted =
        |placed: &Placed| birge_ratio2(placed.point.match_chi2, placed.point.match_dof) > CONTRADICTED;
    is_other || place.is_some_and(|placed| !placed.is_saturated() && is_contradicted(placed))
}

impl Reconstructor {
    /// Fits all dots once more, those in doubt from where their moments lead on the surface that the others show. What explains the
    /// pixels better is taken; those that are none of a disc stay where their moments are.
    pub(super) fn try_again(
        &self,
        planes: &[(PlaneView<'_>, Noise)],
        detections: &[Detection],
        background: &[f64],
        placing: &mut Placing,
        fitting: &mut Fitting,
    ) {
        let first = placing.points.clone();
        let doubts = first.iter().zip(&fitting.is_other);
        let in_doubt: Vec<bool> = doubts.map(|(place, is_other)| is_in_doubt(place.as_ref(), *is_other)).collect();
        let measured: Vec<Detection> =
            (0..planes.len()).map(|band| self.with_moments(band, &planes[band], &detections[band])).collect();
        self.place_by_moments(&measured, &placing.groups, &mut placing.points, &in_doubt);
        self.fit(planes, detections, background, placing, fitting);
        let typical = typical_chi2(&first, &mut fitting.values);
        let mut refined = fitting.refined.iter_mut();
        for ((place, first), is_other) in placing.points.iter_mut().zip(first).zip(&fitting.is_other) {
            let Some(placed) = place else { continue };
            let again = refined.next().and_then(Option::take);
            if placed.is_saturated() {
                continue;
            }
            let first = first.filter(|_| !*is_other);
            let first_chi2 = first.as_ref().map_or(f64::INFINITY, chi2);
            let again = again.filter(|again| again.is_disc(false) && again.reduced_chi2 < first_chi2).map(|again| {
                let mut placed = placed.clone();
                self.place(&mut placed, &again);
                placed
            });
            let by_moments_mm = placed.point.std_mm[2];
            let is_right = |found: &Placed| {
                let is_explained = !is_in_doubt(Some(found), false) || chi2(found) < WORSE * typical;
                is_explained || found.point.std_mm[2] < by_moments_mm
            };
            again.or(first).filter(is_right).into_iter().for_each(|found| *placed = found);
        }
    }
}

/// χ² of a point's pixels over their number.
fn chi2(placed: &Placed) -> f64 {
    placed.point.pixel_chi2.unwrap_or(f64::INFINITY)
}

/// That of the point in the middle.
fn typical_chi2(points: &[Option<Placed>], values: &mut Vec<f64>) -> f64 {
    values.clear();
    values.extend(points.iter().flatten().filter_map(|placed| placed.point.pixel_chi2));
    median(values).unwrap_or(f64::INFINITY)
}
