//! A frame on which the target is recognised.

use std::borrow::Cow;

use twinpupil_instrument::{Frame, Instrument, PixelPoint};
use twinpupil_reconstruct::{Detection, Feature, KnownLight, RejectionReason};

use crate::lattice::{Spot, median};
use crate::sighting::{Labelled, Sighting, SightingError, recognise};
use crate::target::Target;

/// A frame on which the target is recognised.
#[derive(Debug, Clone)]
pub(crate) struct Seen<'a> {
    pub(crate) frame: usize,
    /// The frame itself, if it is at hand.
    pub(crate) kept: Option<Cow<'a, Frame>>,
    pub(crate) sighting: Sighting,
    /// What every band shows.
    features: Vec<Vec<Feature>>,
    /// −1 for a band whose dots are darker than their ground, else 1.
    signs: Vec<f64>,
}

impl<'a> Seen<'a> {
    /// Recognises the target among the features of a frame.
    pub(crate) fn recognised(
        frame: usize,
        detections: Vec<Detection>,
        instrument: &Instrument,
        target: &Target,
    ) -> Result<Self, SightingError> {
        let signs = detections.iter().map(|detection| detection.polarity.sign()).collect();
        let names = instrument.bands.iter().map(|band| band.name.clone());
        let saturated: Vec<(String, usize)> = names.zip(detections.iter().map(saturated)).collect();
        let whole =
            |detection: Detection| detection.features.into_iter().filter(|feature| !feature.saturated).collect();
        let features: Vec<Vec<Feature>> = detections.into_iter().map(whole).collect();
        // Bands are told apart and laid over each other where both have their axis.
        let spot =
            |feature: &Feature| Spot { centre_px: [feature.centre.u, feature.centre.v], area_px: feature.area_px };
        let spots = features.iter().map(|features| features.iter().map(spot).collect());
        let bands: Vec<(&str, Vec<Spot>)> = instrument.bands.iter().map(|band| band.name.as_str()).zip(spots).collect();
        let sighting =
            recognise(target, &bands, instrument.sensor.axis_px).map_err(|error| too_bright(error, &saturated))?;
        Ok(Self { frame, kept: None, sighting, features, signs })
    }

    /// With the frame itself at hand, or not.
    pub(crate) fn keeping(self, kept: Option<Cow<'a, Frame>>) -> Self {
        Self { kept, ..self }
    }

    /// With two of its bands the other way round.
    pub(crate) fn exchanged(&self, [first, second]: [usize; 2]) -> Self {
        let Self { frame, sighting, features, signs, .. } = self;
        let (sighting, features, signs) = (sighting.clone(), features.clone(), signs.clone());
        let mut other = Self { frame: *frame, kept: None, sighting, features, signs };
        other.sighting.swap(first, second);
        other.features.swap(first, second);
        other.signs.swap(first, second);
        other
    }

    /// The dots that a band shows, with their features.
    pub(crate) fn dots(&self, band: usize) -> impl Iterator<Item = (usize, &Feature)> {
        self.sighting[band].iter().map(move |(dot, feature)| (*dot, &self.features[band][*feature]))
    }

    /// The feature of a dot in a band.
    pub(crate) fn feature(&self, band: usize, dot: usize) -> Option<&Feature> {
        let labelled: &[Labelled] = &self.sighting[band];
        let place = labelled.binary_search_by_key(&dot, |(dot, _)| *dot).ok()?;
        Some(&self.features[band][labelled[place].1])
    }

    /// The light of every dot of the target in a band: that of its feature, or that of the typical one.
    pub(crate) fn lights(&self, band: usize, dots: usize) -> Vec<KnownLight> {
        let light = |contrast_codes: f64, ground_codes: f64| KnownLight {
            contrast_codes: self.signs[band] * contrast_codes,
            ground_codes,
            illumination_per_px: [0.0; 2],
            is_fitted: false,
        };
        let typical = |value: fn(&Feature) -> f64| median(self.features[band].iter().map(value));
        let typical = light(typical(|feature| feature.height_codes), typical(|feature| feature.ground_codes));
        let own = |dot: usize| {
            let feature = self.feature(band, dot);
            feature.map_or(typical, |feature| light(feature.height_codes, feature.ground_codes))
        };
        (0..dots).map(own).collect()
    }
}

/// Features of a band that reach the largest code.
fn saturated(detection: &Detection) -> usize {
    let rejected = detection.rejected.iter().filter(|own| own.reason == RejectionReason::Saturated).count();
    rejected + detection.features.iter().filter(|feature| feature.saturated).count()
}

/// Why there is no target, if it is that most features of the band are saturated.
fn too_bright(error: SightingError, saturated: &[(String, usize)]) -> SightingError {
    let SightingError::NoTarget { band, features, .. } = &error else { return error };
    match saturated.iter().find(|(own, saturated)| own == band && saturated > features) {
        Some((band, saturated)) => {
            SightingError::Saturated { band: band.clone(), saturated: *saturated, features: *features }
        }
        None => error,
    }
}

/// Where a feature of a band, measured on the image plane of the reference frame, lies on the band's page.
pub(crate) fn on_page(instrument: &Instrument, band: usize, centre: PixelPoint) -> PixelPoint {
    instrument.page(&instrument.bands[band]).to_page(instrument.sensor.image_from_pixel(centre))
}
