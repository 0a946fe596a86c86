//! Features of the bands beside the pair: they are matched to points by prediction.

use twinpupil_instrument::PixelPoint;

use crate::detect::Feature;
use crate::matching::Match;

/// The features that show one thing: a pair, and what further bands show of it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Group {
    pub(crate) pair: Match,
    /// Index of a feature in every band after the pair, where one was found.
    pub(crate) further: Vec<Option<usize>>,
    /// Whether it was found only by what the fit told of its features.
    pub(crate) is_late: bool,
}

impl Group {
    /// A pair alone.
    pub(crate) fn of(pair: Match) -> Self {
        Self { pair, further: Vec::new(), is_late: false }
    }

    /// A pair alone that the fit has shown.
    pub(crate) fn late(pair: Match) -> Self {
        Self { is_late: true, ..Self::of(pair) }
    }

    /// Index of the feature of a band, in the model's order of bands.
    pub(crate) fn feature(&self, band: usize) -> Option<usize> {
        match band {
            0 => Some(self.pair.telecentric),
            1 => Some(self.pair.entocentric),
            _ => self.further.get(band - 2).copied().flatten(),
        }
    }
}

/// The image of a point in a band beside the pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FurtherImage {
    /// Index of the point.
    pub point: usize,
    /// Index of the band among the instrument's.
    pub band: usize,
    /// The feature that shows it.
    pub feature: Feature,
}

/// For every prediction the index of the nearest feature within `tolerance_px`, each feature once: where several want
/// one, the nearest has it.
pub(crate) fn match_predicted(
    predicted: &[Option<PixelPoint>],
    features: &[Feature],
    tolerance_px: f64,
) -> Vec<Option<usize>> {
    let mut by_row: Vec<usize> = (0..features.len()).collect();
    by_row.sort_by(|a, b| features[*a].centre.v.total_cmp(&features[*b].centre.v));
    let mut candidates: Vec<(f64, usize, usize)> = Vec::new();
    for (point, place) in predicted.iter().enumerate().filter_map(|(point, place)| Some((point, (*place)?))) {
        let first = by_row.partition_point(|index| features[*index].centre.v < place.v - tolerance_px);
        let near = by_row[first..].iter().take_while(|index| features[**index].centre.v <= place.v + tolerance_px);
        candidates.extend(near.filter_map(|&index| {
            let centre = features[index].centre;
            let distance_px = (centre.u - place.u).hypot(centre.v - place.v);
            (distance_px <= tolerance_px).then_some((distance_px, point, index))
        }));
    }
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut partners, mut taken) = (vec![None; predicted.len()], vec![false; features.len()]);
    for (_, point, index) in candidates {
        if partners[point].is_none() && !taken[index] {
            partners[point] = Some(index);
            taken[index] = true;
        }
    }
    partners
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(u: f64, v: f64) -> Feature {
        Feature {
            centre: PixelPoint { u, v },
            centre_std_px: [0.01; 2],
            area_px: 100.0,
            height_codes: 1000.0,
            ground_codes: 0.0,
            edge_px: 4.0,
            overlapped: false,
            saturated: false,
        }
    }

    #[test]
    fn the_nearest_has_it_and_each_feature_is_used_once() {
        let features = [at(10.0, 10.0), at(30.0, 10.5), at(50.0, 90.0)];
        let predicted =
            [(11.5, 10.0), (10.5, 10.0), (30.0, 10.0), (50.0, 80.0)].map(|(u, v)| Some(PixelPoint { u, v }));
        assert_eq!(match_predicted(&predicted, &features, 4.0), [None, Some(0), Some(1), None]);
        assert_eq!(match_predicted(&[None], &features, 4.0), [None]);
        assert_eq!(match_predicted(&predicted, &[], 4.0), [None; 4]);
    }
}
