//! The numbers of an instrument that calibration can determine, named by their keys in the file.

use crate::{Instrument, InstrumentSpec, Lens};

/// One number of an instrument file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Parameter {
    /// `sensor.distance_mm`, L.
    SensorDistance,
    /// `lens.focal_length_mm` of a lens that has one for all bands.
    FocalLength,
    /// `lens.focal_length_mm_by_band` of the band with this index.
    BandFocalLength(usize),
    /// `sensor.axis_px`, along u or v.
    Axis(usize),
    /// `position_mm` of the aperture with this index.
    AperturePosition(usize),
    /// `centre_mm` of an aperture, along x or y.
    ApertureCentre(usize, usize),
    /// `radius_mm` of a zone of an aperture.
    ZoneRadius(usize, usize),
    /// `sensor.tilt_deg`, along u or v.
    Tilt(usize),
    /// A term of the `distortion` of the band with this index.
    Distortion(usize, DistortionTerm),
    /// A coefficient of the `correction` of the band with this index: its term, along x or y.
    Correction(usize, usize, usize),
}

/// A coefficient of a band's distortion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum DistortionTerm {
    /// Radial, with r².
    K1,
    /// Radial, with r⁴.
    K2,
    /// Tangential, along v.
    P1,
    /// Tangential, along u.
    P2,
}

impl DistortionTerm {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::K1, Self::K2, Self::P1, Self::P2];

    fn key(self) -> &'static str {
        match self {
            Self::K1 => "k1_per_mm2",
            Self::K2 => "k2_per_mm4",
            Self::P1 => "p1_per_mm",
            Self::P2 => "p2_per_mm",
        }
    }
}

impl Parameter {
    /// Every parameter of an instrument, in the order of its file.
    pub fn all(instrument: &Instrument) -> Vec<Self> {
        let bands = 0..instrument.bands.len();
        let mut all = match instrument.lens {
            Lens::Thin(_) => bands.clone().map(Self::BandFocalLength).collect(),
            Lens::Fresnel(_) | Lens::Prescription(_) => vec![Self::FocalLength],
        };
        all.push(Self::SensorDistance);
        all.extend([0, 1].map(Self::Axis));
        all.extend([0, 1].map(Self::Tilt));
        all.extend(bands.clone().flat_map(|band| DistortionTerm::ALL.map(|term| Self::Distortion(band, term))));
        for band in bands {
            let terms = instrument.bands[band].correction.as_ref().map_or(0, |correction| correction.x_mm.len());
            all.extend((0..terms).flat_map(|term| [0, 1].map(|axis| Self::Correction(band, term, axis))));
        }
        for (index, aperture) in instrument.apertures.iter().enumerate() {
            all.push(Self::AperturePosition(index));
            all.extend([0, 1].map(|axis| Self::ApertureCentre(index, axis)));
            let bounded = aperture.zones.iter().enumerate().filter(|(_, zone)| zone.radius_mm.is_some());
            all.extend(bounded.map(|(zone, _)| Self::ZoneRadius(index, zone)));
        }
        all
    }

    /// The key of the instrument file under which it stands.
    pub fn key(self, instrument: &InstrumentSpec) -> String {
        match self {
            Self::SensorDistance => "sensor.distance_mm".to_owned(),
            Self::FocalLength => "lens.focal_length_mm".to_owned(),
            Self::BandFocalLength(band) => format!("lens.focal_length_mm_by_band.{}", instrument.bands[band].name),
            Self::Axis(axis) => format!("sensor.axis_px[{axis}]"),
            Self::AperturePosition(index) => format!("aperture[{index}].position_mm"),
            Self::ApertureCentre(index, axis) => format!("aperture[{index}].centre_mm[{axis}]"),
            Self::ZoneRadius(index, zone) => format!("aperture[{index}].zones[{zone}].radius_mm"),
            Self::Tilt(axis) => format!("sensor.tilt_deg[{axis}]"),
            Self::Distortion(band, term) => format!("band[{band}].distortion.{}", term.key()),
            Self::Correction(band, term, axis) => {
                format!("band[{band}].correction.{}[{term}]", ["x_mm", "y_mm"][axis])
            }
        }
    }

    /// The parameter that stands under a key.
    pub fn of_key(instrument: &Instrument, key: &str) -> Option<Self> {
        Self::all(instrument).into_iter().find(|parameter| parameter.key(instrument) == key)
    }

    /// Its value, in the unit of its key; a zone without end has an infinite radius, a correction that is not stated 0.
    pub fn value(self, instrument: &InstrumentSpec) -> f64 {
        match self {
            Self::SensorDistance => instrument.sensor.distance_mm,
            Self::FocalLength => instrument.lens.focal_length_mm(),
            Self::BandFocalLength(band) => match &instrument.lens {
                Lens::Thin(lens) => lens.focal_length_mm(&instrument.bands[band].name),
                Lens::Fresnel(_) | Lens::Prescription(_) => instrument.lens.focal_length_mm(),
            },
            Self::Axis(axis) => instrument.sensor.axis_px[axis],
            Self::AperturePosition(index) => instrument.apertures[index].position_mm,
            Self::ApertureCentre(index, axis) => instrument.apertures[index].centre_mm[axis],
            Self::ZoneRadius(index, zone) => instrument.apertures[index].zones[zone].radius_mm.unwrap_or(f64::INFINITY),
            Self::Tilt(axis) => instrument.sensor.tilt_deg[axis],
            Self::Distortion(band, term) => {
                let distortion = &instrument.bands[band].distortion;
                match term {
                    DistortionTerm::K1 => distortion.k1_per_mm2,
                    DistortionTerm::K2 => distortion.k2_per_mm4,
                    DistortionTerm::P1 => distortion.p1_per_mm,
                    DistortionTerm::P2 => distortion.p2_per_mm,
                }
            }
            Self::Correction(band, term, axis) => {
                let correction = instrument.bands[band].correction.as_ref();
                let of_axis = correction.map(|own| [&own.x_mm, &own.y_mm][axis]);
                of_axis.and_then(|coefficients| coefficients.get(term)).copied().unwrap_or(0.0)
            }
        }
    }

    /// Gives it another value.
    pub fn set(self, instrument: &mut InstrumentSpec, value: f64) {
        match self {
            Self::SensorDistance => instrument.sensor.distance_mm = value,
            Self::FocalLength => match &mut instrument.lens {
                Lens::Thin(lens) => lens.focal_length_mm = value,
                Lens::Fresnel(lens) => lens.focal_length_mm = value,
                Lens::Prescription(lens) => lens.focal_length_mm = Some(value),
            },
            Self::BandFocalLength(band) => {
                if let Lens::Thin(lens) = &mut instrument.lens {
                    lens.focal_length_mm_by_band.insert(instrument.bands[band].name.clone(), value);
                }
            }
            Self::Axis(axis) => instrument.sensor.axis_px[axis] = value,
            Self::AperturePosition(index) => instrument.apertures[index].position_mm = value,
            Self::ApertureCentre(index, axis) => instrument.apertures[index].centre_mm[axis] = value,
            Self::ZoneRadius(index, zone) => instrument.apertures[index].zones[zone].radius_mm = Some(value),
            Self::Tilt(axis) => instrument.sensor.tilt_deg[axis] = value,
            Self::Distortion(band, term) => {
                let distortion = &mut instrument.bands[band].distortion;
                match term {
                    DistortionTerm::K1 => distortion.k1_per_mm2 = value,
                    DistortionTerm::K2 => distortion.k2_per_mm4 = value,
                    DistortionTerm::P1 => distortion.p1_per_mm = value,
                    DistortionTerm::P2 => distortion.p2_per_mm = value,
                }
            }
            Self::Correction(band, term, axis) => {
                if let Some(correction) = &mut instrument.bands[band].correction {
                    let [x_mm, y_mm] = [&mut correction.x_mm, &mut correction.y_mm];
                    if let Some(own) = [x_mm, y_mm][axis].get_mut(term) {
                        *own = value;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper;

    #[test]
    fn every_parameter_has_a_key_of_its_own_and_keeps_what_it_is_given() {
        let mut spec = paper::instrument().into_spec();
        spec.bands[1].correction = Some(crate::Correction::none(6.0, 2));
        let instrument = Instrument::new(spec).expect("legal");
        for (place, parameter) in Parameter::all(&instrument).into_iter().enumerate() {
            assert_eq!(Parameter::of_key(&instrument, &parameter.key(&instrument)), Some(parameter));
            let mut spec = instrument.clone().into_spec();
            let value = parameter.value(&spec) + 1e-3 * (place + 1) as f64;
            parameter.set(&mut spec, value);
            assert_eq!(parameter.value(&spec), value);
            let others = Parameter::all(&instrument).into_iter().filter(|other| *other != parameter);
            assert!(others.into_iter().all(|other| other.value(&spec) == other.value(&instrument)), "{parameter:?}");
        }
    }
}
