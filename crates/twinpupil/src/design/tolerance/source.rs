//! What a camera may be off by, one independent number at a time.

use twinpupil_instrument::{Instrument, Lens, Role};

use super::element::Element;
use super::tolerances::Tolerances;

/// One number of a camera that is not as drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Source {
    /// Distance of the sensor, mm.
    SensorDistance,
    /// Place of the sensor across the axis, along u or v, mm.
    SensorCentre(usize),
    /// Tilt of the sensor along u or v, degrees.
    SensorTilt(usize),
    /// Place of a mask along the axis, mm.
    MaskPosition(usize),
    /// Centre of a mask along x or y, mm.
    MaskCentre(usize, usize),
    /// Radii of a mask, mm.
    MaskRadius(usize),
    /// Focal length of all bands, per cent.
    FocalLength,
    /// Focal length of a band, per cent.
    BandFocalLength(usize),
    /// Place of an element of the lens across the axis, along x or y, mm.
    ElementDecentre(usize, usize),
    /// Tilt of an element about x or y, degrees.
    ElementTilt(usize, usize),
    /// Thickness of the glass behind a surface, mm.
    Thickness(usize),
    /// Air behind a surface, mm.
    AirGap(usize),
    /// Radius of a surface, per cent.
    Radius(usize),
    /// Index of the glass behind a surface.
    Index(usize),
    /// Temperature in use, K.
    Temperature,
    /// Signal in the plane of the first band from unit light of the second one.
    Leak(usize, usize),
    /// Noise of the images that the camera is calibrated from: a deviation of 1 is that of the file.
    Noise,
}

/// A source and its tolerance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Toleranced {
    /// What is not as drawn.
    pub source: Source,
    /// How far it may be off each way, in the unit of the source.
    pub tolerance: f64,
}

/// Everything that a camera may be off by; what has no tolerance is left out.
pub(super) fn sources(instrument: &Instrument, elements: &[Element], tolerances: &Tolerances) -> Vec<Toleranced> {
    let Tolerances { sensor, mask, lens, element, temperature, filter, calibration, .. } = tolerances;
    let bands = 0..instrument.bands.len();
    let mut all = vec![(Source::SensorDistance, sensor.distance_mm)];
    all.extend([0, 1].map(|axis| (Source::SensorCentre(axis), sensor.centre_mm)));
    all.extend([0, 1].map(|axis| (Source::SensorTilt(axis), sensor.tilt_deg)));
    for index in 0..instrument.apertures.len() {
        all.push((Source::MaskPosition(index), mask.position_mm));
        all.extend([0, 1].map(|axis| (Source::MaskCentre(index, axis), mask.centre_mm)));
        all.push((Source::MaskRadius(index), mask.radius_mm));
    }
    match &instrument.lens {
        Lens::Prescription(own) => {
            let surfaces = own.prescription.as_ref().map_or(&[][..], |spec| &spec.surfaces);
            for index in 0..elements.len() {
                all.extend([0, 1].map(|axis| (Source::ElementDecentre(index, axis), element.decentre_mm)));
                all.extend([0, 1].map(|axis| (Source::ElementTilt(index, axis), element.tilt_deg)));
            }
            for (index, surface) in surfaces.iter().enumerate() {
                let is_glass = elements.iter().any(|own| own.surfaces.contains(&index) && own.last() != index);
                if surface.shape.clone().radius_mm_mut().is_some() {
                    all.push((Source::Radius(index), element.radius_percent));
                }
                if is_glass {
                    all.push((Source::Thickness(index), element.thickness_mm));
                    all.push((Source::Index(index), element.index));
                } else if index + 1 < surfaces.len() {
                    all.push((Source::AirGap(index), element.air_gap_mm));
                }
            }
        }
        Lens::Thin(_) | Lens::Fresnel(_) => {
            all.push((Source::FocalLength, lens.focal_length_percent));
            if matches!(instrument.lens, Lens::Thin(_)) {
                all.extend(bands.clone().map(|band| (Source::BandFocalLength(band), lens.band_focal_length_percent)));
            }
        }
    }
    all.push((Source::Temperature, temperature.change_k));
    let pairs = bands.clone().flat_map(|plane| bands.clone().map(move |band| (plane, band)));
    all.extend(
        pairs.filter(|(plane, band)| plane != band).map(|(plane, band)| (Source::Leak(plane, band), filter.leak)),
    );
    // Noise is drawn image by image: 1 switches it on.
    all.push((Source::Noise, if calibration.noise_px > 0.0 { 1.0 } else { 0.0 }));
    let toleranced = |(source, tolerance)| Toleranced { source, tolerance };
    all.into_iter().filter(|(_, tolerance)| *tolerance > 0.0).map(toleranced).collect()
}

impl Source {
    /// The contributor that it belongs to: both directions of one thing are one.
    pub fn contributor(self, instrument: &Instrument, elements: &[Element]) -> String {
        let mask = |index: usize| {
            let of = |role: Role| instrument.pupil_index(instrument.band(role)) == index;
            match (of(Role::Telecentric), of(Role::Entocentric)) {
                (true, false) => "telecentric mask".to_owned(),
                (false, true) => "entocentric mask".to_owned(),
                _ => format!("aperture[{index}]"),
            }
        };
        match self {
            Self::SensorDistance => "sensor distance".to_owned(),
            Self::SensorCentre(_) => "sensor centre".to_owned(),
            Self::SensorTilt(_) => "sensor tilt".to_owned(),
            Self::MaskPosition(index) => format!("{} position", mask(index)),
            Self::MaskCentre(index, _) => format!("{} centre", mask(index)),
            Self::MaskRadius(index) => format!("{} radius", mask(index)),
            Self::FocalLength => "focal length".to_owned(),
            Self::BandFocalLength(band) => format!("focal length {}", instrument.bands[band].name),
            Self::ElementDecentre(index, _) => format!("{} decentre", elements[index].name()),
            Self::ElementTilt(index, _) => format!("{} tilt", elements[index].name()),
            Self::Thickness(surface) => format!("thickness behind surface {surface}"),
            Self::AirGap(surface) => format!("air behind surface {surface}"),
            Self::Radius(surface) => format!("radius of surface {surface}"),
            Self::Index(surface) => format!("index behind surface {surface}"),
            Self::Temperature => "temperature".to_owned(),
            Self::Leak(plane, band) => {
                format!("leak of {} into {}", instrument.bands[band].name, instrument.bands[plane].name)
            }
            Self::Noise => "calibration noise".to_owned(),
        }
    }

    /// The column of a table that holds it, with its unit.
    pub fn column(self) -> String {
        let along = |axis: usize, names: [&str; 2]| names[axis].to_owned();
        match self {
            Self::SensorDistance => "sensor_distance_mm".to_owned(),
            Self::SensorCentre(axis) => format!("sensor_centre_{}_mm", along(axis, ["u", "v"])),
            Self::SensorTilt(axis) => format!("sensor_tilt_{}_deg", along(axis, ["u", "v"])),
            Self::MaskPosition(index) => format!("aperture_{index}_position_mm"),
            Self::MaskCentre(index, axis) => format!("aperture_{index}_centre_{}_mm", along(axis, ["x", "y"])),
            Self::MaskRadius(index) => format!("aperture_{index}_radius_mm"),
            Self::FocalLength => "focal_length_percent".to_owned(),
            Self::BandFocalLength(band) => format!("band_{band}_focal_length_percent"),
            Self::ElementDecentre(index, axis) => format!("element_{index}_decentre_{}_mm", along(axis, ["x", "y"])),
            Self::ElementTilt(index, axis) => format!("element_{index}_tilt_{}_deg", along(axis, ["x", "y"])),
            Self::Thickness(surface) => format!("surface_{surface}_thickness_mm"),
            Self::AirGap(surface) => format!("surface_{surface}_air_gap_mm"),
            Self::Radius(surface) => format!("surface_{surface}_radius_percent"),
            Self::Index(surface) => format!("surface_{surface}_index"),
            Self::Temperature => "temperature_k".to_owned(),
            Self::Leak(plane, band) => format!("leak_into_{plane}_from_{band}"),
            Self::Noise => "calibration_noise".to_owned(),
        }
    }

    /// The unit of its tolerance.
    pub fn unit(self) -> &'static str {
        match self {
            Self::SensorDistance
            | Self::SensorCentre(_)
            | Self::MaskPosition(_)
            | Self::MaskCentre(..)
            | Self::MaskRadius(_)
            | Self::ElementDecentre(..)
            | Self::Thickness(_)
            | Self::AirGap(_) => "mm",
            Self::SensorTilt(_) | Self::ElementTilt(..) => "°",
            Self::FocalLength | Self::BandFocalLength(_) | Self::Radius(_) => "%",
            Self::Temperature => "K",
            Self::Index(_) | Self::Leak(..) | Self::Noise => "",
        }
    }
}
