//! The Cramér–Rao bound of every place.

use std::collections::BTreeMap;

use anyhow::Result;
use twinpupil_instrument::{Instrument, ResponseMatrix};
use twinpupil_simulate::{Bound, dot_bounds};

use super::{Place, Sheet, turned_covariance_mm2};

/// The bounds of all dots of all sheets.
#[derive(Debug, Clone)]
pub struct BoundStudy {
    /// For every sheet the bounds of its dots; none for dots without light.
    pub dots: Vec<Vec<Option<Bound>>>,
    /// For every place with dots their bound on the whole; none where one of them has no light.
    pub places: BTreeMap<Place, Option<PlaceBound>>,
}

/// The bound of a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaceBound {
    /// Dots that it is the mean of.
    pub dots: usize,
    /// Mean covariance of x, y and z, mm², for a dot on the x axis: x outwards, y sideways.
    pub covariance_mm2: [[f64; 3]; 3],
}

impl PlaceBound {
    /// Smallest standard deviations of x, y and z, mm, of a dot on the x axis.
    pub fn std_mm(&self) -> [f64; 3] {
        Bound { covariance_mm2: self.covariance_mm2 }.std_mm()
    }
}

impl BoundStudy {
    /// Bounds of the dots of `sheets` with `pupil_samples` rays for every pixel; `done` is called after every sheet.
    pub fn new(
        instrument: &Instrument,
        response: &ResponseMatrix,
        sheets: &[Sheet],
        pupil_samples: usize,
        done: impl Fn(),
    ) -> Result<Self> {
        let bounds = |sheet: &Sheet| {
            let bounds = dot_bounds(instrument, &sheet.scene, response, pupil_samples);
            done();
            Ok(bounds?)
        };
        // The bounds of one sheet are computed on all threads.
        let dots = sheets.iter().map(bounds).collect::<Result<Vec<_>>>()?;
        let places = places(sheets, &dots);
        Ok(Self { dots, places })
    }

    /// The bound of a place; `None` where it is out of sight or without light.
    pub fn at(&self, place: Place) -> Option<&PlaceBound> {
        self.places.get(&place)?.as_ref()
    }
}

fn places(sheets: &[Sheet], bounds: &[Vec<Option<Bound>>]) -> BTreeMap<Place, Option<PlaceBound>> {
    let mut turned: BTreeMap<Place, Vec<Option<[[f64; 3]; 3]>>> = BTreeMap::new();
    for (sheet, bounds) in sheets.iter().zip(bounds) {
        for (dot, bound) in sheet.dots.iter().zip(bounds) {
            let covariance = bound.map(|bound| turned_covariance_mm2(bound.covariance_mm2, dot.azimuth_rad()));
            turned.entry(dot.place).or_default().push(covariance);
        }
    }
    turned.into_iter().map(|(place, covariances)| (place, mean(covariances))).collect()
}

fn mean(covariances: Vec<Option<[[f64; 3]; 3]>>) -> Option<PlaceBound> {
    let covariances = covariances.into_iter().collect::<Option<Vec<_>>>()?;
    let dots = covariances.len();
    let mean = |i: usize, k: usize| covariances.iter().map(|covariance| covariance[i][k]).sum::<f64>() / dots as f64;
    Some(PlaceBound { dots, covariance_mm2: std::array::from_fn(|i| std::array::from_fn(|k| mean(i, k))) })
}
