//! What of an axis depends on where the masks' centres are.

use nalgebra::{DMatrix, Matrix2, Matrix2xX, Vector2};
use twinpupil_instrument::{Instrument, Parameter};

use crate::forward::Slot;
use crate::unknown::{Feed, Part, Quantity, Unknown, tolerance};

/// A mask's centre, and how the axis that frames tell changes with it.
#[derive(Debug, Clone, PartialEq)]
pub struct MaskCentre {
    /// Index of the mask among the instrument's apertures.
    pub aperture: usize,
    /// Deviations along x and y, mm: those of the instrument's calibration, else what a data sheet is given.
    pub std_mm: [f64; 2],
    /// Change of the axis with the centre that the instrument states, px/mm: row by row u and v, with x and y.
    pub axis_px_per_mm: [[f64; 2]; 2],
}

impl MaskCentre {
    /// The key of the centre in the instrument file.
    pub fn key(&self) -> String {
        format!("aperture[{}].centre_mm", self.aperture)
    }

    /// The farthest that the axis moves for each mm of the centre, whichever way, px.
    pub fn px_per_mm_max(&self) -> f64 {
        let [[ux, uy], [vx, vy]] = self.axis_px_per_mm;
        Matrix2::new(ux, uy, vx, vy).singular_values().max()
    }
}

/// Change of the score of an axis with where the pupil of a band is: the axis along rows, x and y of the pupil along columns.
pub(crate) type AxisByPupil = Matrix2<f64>;

/// The centres of all masks that are pupils of a band, with what they leave uncertain of the axis, px².
///
/// With the covariance C of the axis by itself, the mixed information M of axis and centres, places and diameters of dots
/// left open, and the covariance S of the centres,
///
/// ```text
/// ∂a/∂c = −C M        cov = ∂a/∂c S (∂a/∂c)ᵀ
/// ```
pub(crate) fn mask_centres(
    instrument: &Instrument,
    covariance: &Matrix2<f64>,
    by_pupil: &[AxisByPupil],
) -> (Vec<MaskCentre>, Matrix2<f64>) {
    let is_centre = |quantity: &Quantity| matches!(quantity, Quantity::Instrument(Parameter::ApertureCentre(..)));
    let unknown = |quantity| Unknown::of(quantity, instrument, tolerance(quantity, instrument));
    let unknowns: Vec<Unknown> = Quantity::all(instrument).into_iter().filter(is_centre).map(unknown).collect();
    let columns: Vec<_> = unknowns.iter().map(|unknown| -covariance * score_change(unknown, by_pupil)).collect();
    let centres_mm2 = centres_mm2(instrument, &unknowns);
    let mut masks: Vec<MaskCentre> = Vec::new();
    for (place, unknown) in unknowns.iter().enumerate() {
        let Quantity::Instrument(Parameter::ApertureCentre(aperture, axis)) = unknown.quantity else { continue };
        if masks.last().is_none_or(|mask| mask.aperture != aperture) {
            masks.push(MaskCentre { aperture, std_mm: [0.0; 2], axis_px_per_mm: [[0.0; 2]; 2] });
        }
        if let Some(mask) = masks.last_mut() {
            mask.std_mm[axis] = centres_mm2[(place, place)].sqrt();
            (mask.axis_px_per_mm[0][axis], mask.axis_px_per_mm[1][axis]) = (columns[place].x, columns[place].y);
        }
    }
    if columns.is_empty() {
        return (masks, Matrix2::zeros());
    }
    let change = Matrix2xX::from_columns(&columns);
    (masks, &change * centres_mm2 * change.transpose())
}

/// How the score of the axis changes with a number.
fn score_change(unknown: &Unknown, by_pupil: &[AxisByPupil]) -> Vector2<f64> {
    let change = |feed: &Feed| match feed.part {
        Part::Slot(Slot::PupilX, factor) => factor * by_pupil[feed.band].column(0),
        Part::Slot(Slot::PupilY, factor) => factor * by_pupil[feed.band].column(1),
        Part::Slot(..) | Part::Coefficient(..) => Vector2::zeros(),
    };
    unknown.feeds.iter().map(change).sum()
}

/// Covariance of the masks' centres: that of the instrument's calibration for those that it determined, mm².
fn centres_mm2(instrument: &Instrument, unknowns: &[Unknown]) -> DMatrix<f64> {
    let calibration = instrument.calibration.as_ref();
    let covariance = calibration.map(|calibration| calibration.covariance());
    let place = |unknown: &Unknown| {
        let key = unknown.quantity.key(instrument);
        calibration.and_then(|calibration| calibration.parameters.iter().position(|own| *own == key))
    };
    let places: Vec<Option<usize>> = unknowns.iter().map(place).collect();
    DMatrix::from_fn(unknowns.len(), unknowns.len(), |i, k| match (&covariance, places[i], places[k]) {
        (Some(covariance), Some(own), Some(other)) => covariance[own][other],
        _ if i == k => unknowns[i].prior_std.powi(2),
        _ => 0.0,
    })
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{CalibrationSpec, paper};

    use super::*;

    #[test]
    fn a_calibration_says_how_well_centres_are_known_else_the_data_sheets_tolerance() {
        let mut spec = paper::instrument().into_spec();
        spec.calibration = Some(CalibrationSpec {
            date: "2026-11-26".to_owned(),
            target: "grid".to_owned(),
            rms_px: 0.002,
            reduced_chi2: 1.0,
            parameters: ["aperture[1].centre_mm[0]", "aperture[0].centre_mm[0]"].map(str::to_owned).to_vec(),
            std: vec![0.01, 0.03],
            correlation: vec![vec![1.0], vec![0.5, 1.0]],
            frames: Vec::new(),
        });
        let instrument = Instrument::new(spec).expect("legal");
        // Pupils of the telecentric and the entocentric band move the axis by 3 and 2 px/mm.
        let by_pupil = [-3.0, -2.0].map(Matrix2::from_diagonal_element);
        let (masks, px2) = mask_centres(&instrument, &Matrix2::identity(), &by_pupil);
        let std_mm: Vec<[f64; 2]> = masks.iter().map(|mask| mask.std_mm).collect();
        assert_eq!(std_mm, [[0.03, 0.2], [0.01, 0.2]]);
        assert_eq!(masks[1].axis_px_per_mm, [[3.0, 0.0], [0.0, 3.0]]);
        // σ² = (2 · 0.03)² + (3 · 0.01)² + 2 · 0.5 · 2 · 0.03 · 3 · 0.01, and (2² + 3²) 0.2² along v.
        assert!((px2.m11 - 0.0063).abs() < 1e-12 && (px2.m22 - 0.52).abs() < 1e-12 && px2.m12 == 0.0, "{px2}");
    }
}
