//! What is sought: numbers of the instrument and of the target, with what is known of them beforehand.

use std::collections::BTreeMap;

use thiserror::Error;
use twinpupil_instrument::{DistortionTerm, Instrument, InstrumentSpec, Lens, Parameter};

use crate::correction::CorrectionChoice;
use crate::forward::Slot;

/// A number that calibration determines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Quantity {
    /// Of the instrument.
    Instrument(Parameter),
    /// Diameter of the target's dots over what its file states: printers widen dots.
    DotDiameter,
}

/// Which numbers are sought and what is known of them beforehand; the rest stays as the instrument file has it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Choices {
    /// Standard deviations that replace those of [`tolerance`], by key; 0 holds a number fast.
    pub prior_std: BTreeMap<String, f64>,
    /// Whether what they leave may be corrected.
    pub correction: CorrectionChoice,
}

/// A key that is none.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("`{key}` is no number that calibration knows; legal: {legal}")]
pub struct UnknownKey {
    /// What was asked for.
    pub key: String,
    /// What there is.
    pub legal: String,
}

/// The key of the target's own unknown.
pub const DOT_DIAMETER_KEY: &str = "target.dot_diameter_scale";

impl Quantity {
    /// The key under which it is known.
    pub fn key(self, instrument: &InstrumentSpec) -> String {
        match self {
            Self::Instrument(parameter) => parameter.key(instrument),
            Self::DotDiameter => DOT_DIAMETER_KEY.to_owned(),
        }
    }

    /// Whether it is a coefficient of a smooth correction, which means nothing by itself.
    pub fn is_coefficient(self) -> bool {
        matches!(self, Self::Instrument(Parameter::Correction(..)))
    }

    /// Everything that could be sought for an instrument.
    pub fn all(instrument: &Instrument) -> Vec<Self> {
        let parameters = Parameter::all(instrument).into_iter().map(Self::Instrument);
        parameters.chain([Self::DotDiameter]).filter(|quantity| !feeds(*quantity, instrument).is_empty()).collect()
    }
}

/// One unknown of the adjustment.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Unknown {
    pub(crate) quantity: Quantity,
    /// What it is expected to be, and how well that is known.
    pub(crate) expected: f64,
    pub(crate) prior_std: f64,
    pub(crate) feeds: Vec<Feed>,
}

impl Unknown {
    /// A number of an instrument, known to be what its file says within a deviation.
    pub(crate) fn of(quantity: Quantity, instrument: &Instrument, prior_std: f64) -> Self {
        let expected = match quantity {
            Quantity::Instrument(parameter) => parameter.value(instrument),
            Quantity::DotDiameter => 1.0,
        };
        Self { quantity, expected, prior_std, feeds: feeds(quantity, instrument) }
    }
}

/// What of a band's camera an unknown moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Feed {
    pub(crate) band: usize,
    pub(crate) part: Part,
}

/// A part of a band's camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Part {
    /// A slot, by so much of the unknown.
    Slot(Slot, f64),
    /// A coefficient of the correction: its term, along x or y.
    Coefficient(usize, usize),
}

impl Choices {
    /// The unknowns for an instrument, whose file states what is expected.
    pub(crate) fn unknowns(&self, instrument: &Instrument) -> Result<Vec<Unknown>, UnknownKey> {
        let all = Quantity::all(instrument);
        let keys: Vec<String> = all.iter().map(|quantity| quantity.key(instrument)).collect();
        if let Some(key) = self.prior_std.keys().find(|key| !keys.contains(key)) {
            return Err(UnknownKey { key: key.clone(), legal: keys.join(", ") });
        }
        let unknown = |(quantity, key): (Quantity, String)| {
            let prior_std = self.prior_std.get(&key).copied().unwrap_or_else(|| tolerance(quantity, instrument));
            (prior_std > 0.0).then(|| Unknown::of(quantity, instrument, prior_std))
        };
        Ok(all.into_iter().zip(keys).filter_map(unknown).collect())
    }
}

/// How far a camera off its data sheet may be from it: the standard deviation that a number is given beforehand, 0 for
/// one that is held fast.
///
/// What is held fast: the position of the entocentric pupil, from which z counts, distortion beyond its first term, and corrections.
pub fn tolerance(quantity: Quantity, instrument: &Instrument) -> f64 {
    const FOCAL_LENGTH: f64 = 0.02;
    const SENSOR_DISTANCE: f64 = 0.02;
    const AXIS: f64 = 0.05;
    const POSITION_MM: f64 = 1.0;
    const CENTRE_MM: f64 = 0.2;
    const RADIUS: f64 = 0.01;
    const TILT_DEG: f64 = 1.0;
    const DISTORTION: f64 = 0.005;
    const DIAMETER: f64 = 0.03;
    let Quantity::Instrument(parameter) = quantity else { return DIAMETER };
    let value = parameter.value(instrument);
    match parameter {
        Parameter::SensorDistance => SENSOR_DISTANCE * value,
        Parameter::FocalLength | Parameter::BandFocalLength(_) => FOCAL_LENGTH * value,
        Parameter::Axis(axis) => AXIS * instrument.sensor.size_px[axis] as f64,
        Parameter::AperturePosition(index) => {
            let entocentric = instrument.band(twinpupil_instrument::Role::Entocentric);
            if instrument.pupil_index(entocentric) == index { 0.0 } else { POSITION_MM }
        }
        Parameter::ApertureCentre(..) => CENTRE_MM,
        Parameter::ZoneRadius(..) => RADIUS * value,
        Parameter::Tilt(_) => TILT_DEG,
        Parameter::Distortion(_, DistortionTerm::K1) => {
            let [width, height] = instrument.sensor.size_px.map(|size| 0.5 * size as f64 * instrument.sensor.pitch_mm);
            DISTORTION / (width * width + height * height)
        }
        Parameter::Distortion(..) | Parameter::Correction(..) => 0.0,
    }
}

/// What a quantity moves; nothing if no band's image depends on it.
fn feeds(quantity: Quantity, instrument: &Instrument) -> Vec<Feed> {
    let bands = 0..instrument.bands.len();
    let of_all = |slot: Slot| bands.clone().map(|band| Feed { band, part: Part::Slot(slot, 1.0) }).collect();
    let Quantity::Instrument(parameter) = quantity else { return of_all(Slot::Diameter) };
    let through = |index: usize, slot: Slot| {
        let through = |band: &usize| instrument.pupil_index(&instrument.bands[*band]) == index;
        let factor = |band: usize| imaged(parameter, instrument, band, slot);
        bands.clone().filter(through).map(|band| Feed { band, part: Part::Slot(slot, factor(band)) }).collect()
    };
    match parameter {
        Parameter::SensorDistance => of_all(Slot::SensorDistance),
        Parameter::FocalLength => of_all(Slot::FocalLength),
        Parameter::BandFocalLength(band) => vec![Feed { band, part: Part::Slot(Slot::FocalLength, 1.0) }],
        Parameter::Axis(0) => of_all(Slot::AxisU),
        Parameter::Axis(_) => of_all(Slot::AxisV),
        Parameter::AperturePosition(index) => through(index, Slot::PupilPosition),
        Parameter::ApertureCentre(index, 0) => through(index, Slot::PupilX),
        Parameter::ApertureCentre(index, _) => through(index, Slot::PupilY),
        Parameter::ZoneRadius(index, zone) => {
            let radius_mm = instrument.apertures[index].zones[zone].radius_mm;
            let is_rim = |feed: &Feed| {
                let rim = instrument.ideal_apertures(&instrument.bands[feed.band])[index].zones[zone].radius_mm;
                radius_mm.is_some() && Some(instrument.projection(&instrument.bands[feed.band]).pupil_radius_mm) == rim
            };
            through(index, Slot::PupilRadius).into_iter().filter(is_rim).collect()
        }
        Parameter::Tilt(axis) => {
            // The slot is the tangent of the tilt.
            let tilt_rad = instrument.sensor.tilt_deg[axis].to_radians();
            let factor = 1.0_f64.to_radians() / tilt_rad.cos().powi(2);
            let slot = if axis == 0 { Slot::TiltU } else { Slot::TiltV };
            bands.map(|band| Feed { band, part: Part::Slot(slot, factor) }).collect()
        }
        Parameter::Distortion(band, term) => {
            let slot = match term {
                DistortionTerm::K1 => Slot::K1,
                DistortionTerm::K2 => Slot::K2,
                DistortionTerm::P1 => Slot::P1,
                DistortionTerm::P2 => Slot::P2,
            };
            vec![Feed { band, part: Part::Slot(slot, 1.0) }]
        }
        Parameter::Correction(band, term, axis) => vec![Feed { band, part: Part::Coefficient(term, axis) }],
    }
}

/// How a slot that tells of a band's pupil changes with a number of its mask: as much, unless a lens images the mask.
fn imaged(parameter: Parameter, instrument: &Instrument, band: usize, slot: Slot) -> f64 {
    const STEP: f64 = 1e-4;
    let Lens::Prescription(_) = instrument.lens else { return 1.0 };
    let of = |instrument: &Instrument| {
        let projection = instrument.projection(&instrument.bands[band]);
        match slot {
            Slot::PupilPosition => projection.pupil_position_mm,
            Slot::PupilX => projection.pupil_centre_mm[0],
            Slot::PupilY => projection.pupil_centre_mm[1],
            _ => projection.pupil_radius_mm,
        }
    };
    let moved = |step: f64| {
        let mut spec = instrument.clone().into_spec();
        parameter.set(&mut spec, parameter.value(instrument) + step);
        Instrument::new(spec).ok()
    };
    let change = |step: f64| moved(step).map(|moved| (of(&moved) - of(instrument)) / step);
    change(STEP).or_else(|| change(-STEP)).unwrap_or(1.0)
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;

    #[test]
    fn what_no_band_shows_is_not_sought() {
        let instrument = paper::instrument();
        let keys: Vec<String> = Quantity::all(&instrument).iter().map(|quantity| quantity.key(&instrument)).collect();
        // The stop at 40 mm is wider than any pencil.
        assert!(keys.iter().all(|key| !key.starts_with("aperture[2]")), "{keys:?}");
        assert!(keys.contains(&"aperture[1].zones[0].radius_mm".to_owned()));
        assert!(keys.contains(&DOT_DIAMETER_KEY.to_owned()));
    }

    #[test]
    fn a_deviation_of_0_holds_fast_and_a_wrong_key_is_named() {
        let instrument = paper::instrument();
        let seeks = |key: &str, std: f64| {
            let choices = Choices { prior_std: BTreeMap::from([(key.to_owned(), std)]), ..Choices::default() };
            choices.unknowns(&instrument)
        };
        let has =
            |unknowns: &[Unknown], key: &str| unknowns.iter().any(|unknown| unknown.quantity.key(&instrument) == key);
        assert!(!has(&seeks("sensor.distance_mm", 0.0).unwrap(), "sensor.distance_mm"));
        assert!(has(&seeks("aperture[0].position_mm", 0.1).unwrap(), "aperture[0].position_mm"));
        assert!(!has(&Choices::default().unknowns(&instrument).unwrap(), "aperture[0].position_mm"));
        assert!(seeks("sensor.distance", 1.0).unwrap_err().to_string().contains("`sensor.distance` is no number"));
    }
}
