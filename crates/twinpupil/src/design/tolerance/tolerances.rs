//! `tolerance.toml`: what the parts of a camera may be off by.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use twinpupil_instrument::InstrumentError;
use twinpupil_instrument::check::{self, ValueError, within};

/// What the parts of a camera may be off by, each way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tolerances {
    /// Version of this format: 1.
    pub schema: u32,
    /// What the user calls them.
    pub name: String,
    /// How parts lie within them.
    #[serde(default)]
    pub distribution: Distribution,
    /// The sensor in its housing.
    #[serde(default)]
    pub sensor: SensorTolerances,
    /// Every mask.
    #[serde(default)]
    pub mask: MaskTolerances,
    /// A lens that is not given surface by surface.
    #[serde(default)]
    pub lens: LensTolerances,
    /// The elements of a lens surface by surface.
    #[serde(default)]
    pub element: ElementTolerances,
    /// The temperature in use.
    #[serde(default)]
    pub temperature: Temperature,
    /// The bands' filters.
    #[serde(default)]
    pub filter: FilterTolerances,
    /// How the camera is calibrated.
    #[serde(default)]
    pub calibration: CalibrationSpec,
}

/// How parts lie within a tolerance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Distribution {
    /// Normal, with the tolerance as two standard deviations and nothing beyond it.
    #[default]
    Normal,
    /// All alike.
    Uniform,
}

/// Of the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorTolerances {
    /// Of its distance, mm.
    pub distance_mm: f64,
    /// Of where it stands across the axis, along u and v, mm.
    pub centre_mm: f64,
    /// Of its tilt along u and v, degrees.
    pub tilt_deg: f64,
}

/// Of a mask.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MaskTolerances {
    /// Of its place along the axis, mm.
    pub position_mm: f64,
    /// Of its centre, along x and y, mm.
    pub centre_mm: f64,
    /// Of its radii, all together, mm.
    pub radius_mm: f64,
}

/// Of a lens that is known by its focal length.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LensTolerances {
    /// Of the focal lengths of all bands together, per cent.
    pub focal_length_percent: f64,
    /// Of the focal length of each band, per cent.
    pub band_focal_length_percent: f64,
}

/// Of the elements of a lens: glass from air to air.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ElementTolerances {
    /// Of an element's place across the axis, along x and y, mm.
    pub decentre_mm: f64,
    /// Of its tilt about x and y, degrees.
    pub tilt_deg: f64,
    /// Of the thickness of a glass, mm.
    pub thickness_mm: f64,
    /// Of the radius of a surface, per cent.
    pub radius_percent: f64,
    /// Of the index of a glass.
    pub index: f64,
    /// Of the air between elements, mm.
    pub air_gap_mm: f64,
}

/// What temperature does.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Temperature {
    /// Of the temperature in use from that of building and calibration, K.
    pub change_k: f64,
    /// Linear expansion of housing and cells, 1/K.
    pub mount_expansion_per_k: f64,
    /// Relative change of the focal length of a lens that is known by it, 1/K.
    pub focal_length_per_k: f64,
    /// Of a glass that is not among `glasses`.
    pub glass: GlassTemperature,
    /// Of glasses by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub glasses: BTreeMap<String, GlassTemperature>,
}

/// What temperature does to a glass.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GlassTemperature {
    /// Linear expansion, 1/K.
    pub expansion_per_k: f64,
    /// Change of the index against air, 1/K.
    pub index_per_k: f64,
}

/// Of the bands' filters.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FilterTolerances {
    /// Of the signal in a plane from unit light of another band.
    pub leak: f64,
    /// Diameter of the dots whose images it moves, mm.
    pub dot_diameter_mm: f64,
}

/// How the camera is calibrated.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CalibrationSpec {
    /// Standard deviation of the place of a dot's image, px.
    pub noise_px: f64,
    /// What is known of numbers beforehand, by their keys in the instrument file; 0 holds one fast.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub prior_std: BTreeMap<String, f64>,
}

/// Tolerances that ship, by name.
pub const GRADES: [(&str, &str); 2] =
    [("commercial", include_str!("commercial.toml")), ("precision", include_str!("precision.toml"))];

/// The file of tolerances that ship under a name.
pub fn grade(name: &str) -> Option<&'static str> {
    GRADES.iter().find(|(own, _)| *own == name).map(|(_, text)| *text)
}

impl Tolerances {
    /// Reads and checks a file.
    pub fn from_toml(text: &str) -> Result<Self, InstrumentError> {
        let tolerances: Self = check::parse_toml(text)?;
        tolerances.check()?;
        Ok(tolerances)
    }

    fn check(&self) -> Result<(), ValueError> {
        check::schema(self.schema)?;
        let Self { sensor, mask, lens, element, temperature, filter, calibration, .. } = self;
        for (key, value, most) in [
            ("sensor.distance_mm", sensor.distance_mm, 100.0),
            ("sensor.centre_mm", sensor.centre_mm, 10.0),
            ("sensor.tilt_deg", sensor.tilt_deg, 5.0),
            ("mask.position_mm", mask.position_mm, 100.0),
            ("mask.centre_mm", mask.centre_mm, 10.0),
            ("mask.radius_mm", mask.radius_mm, 10.0),
            ("lens.focal_length_percent", lens.focal_length_percent, 20.0),
            ("lens.band_focal_length_percent", lens.band_focal_length_percent, 20.0),
            ("element.decentre_mm", element.decentre_mm, 10.0),
            ("element.tilt_deg", element.tilt_deg, 5.0),
            ("element.thickness_mm", element.thickness_mm, 10.0),
            ("element.radius_percent", element.radius_percent, 20.0),
            ("element.index", element.index, 0.1),
            ("element.air_gap_mm", element.air_gap_mm, 10.0),
            ("temperature.change_k", temperature.change_k, 500.0),
            ("filter.leak", filter.leak, 0.5),
            ("filter.dot_diameter_mm", filter.dot_diameter_mm, 1000.0),
            ("calibration.noise_px", calibration.noise_px, 10.0),
        ] {
            within(key, value, 0.0, most)?;
        }
        for (key, std) in &calibration.prior_std {
            within(&format!("calibration.prior_std.{key}"), *std, 0.0, 1e6)?;
        }
        temperature.check()
    }
}

impl Temperature {
    fn check(&self) -> Result<(), ValueError> {
        const MOST_PER_K: f64 = 0.01;
        let rate = |key: &str, value: f64| within(key, value, -MOST_PER_K, MOST_PER_K);
        rate("temperature.mount_expansion_per_k", self.mount_expansion_per_k)?;
        rate("temperature.focal_length_per_k", self.focal_length_per_k)?;
        let named = self.glasses.iter().map(|(name, glass)| (format!("temperature.glasses.{name}"), glass));
        for (key, glass) in std::iter::once(("temperature.glass".to_owned(), &self.glass)).chain(named) {
            rate(&format!("{key}.expansion_per_k"), glass.expansion_per_k)?;
            rate(&format!("{key}.index_per_k"), glass.index_per_k)?;
        }
        Ok(())
    }

    /// What temperature does to the glass of that name, in upper or lower case.
    pub(super) fn of_glass(&self, name: &str) -> GlassTemperature {
        let named = self.glasses.iter().find(|(own, _)| own.eq_ignore_ascii_case(name));
        named.map_or(self.glass, |(_, glass)| *glass)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grades_that_ship_are_legal_and_one_is_finer() {
        let [commercial, precision] = ["commercial", "precision"].map(|name| {
            let tolerances = Tolerances::from_toml(grade(name).unwrap()).unwrap();
            assert_eq!(tolerances.name, name);
            tolerances
        });
        let all = |own: &Tolerances| {
            let (sensor, mask, element) = (own.sensor, own.mask, own.element);
            [
                sensor.distance_mm,
                sensor.centre_mm,
                sensor.tilt_deg,
                mask.position_mm,
                mask.centre_mm,
                mask.radius_mm,
                own.lens.focal_length_percent,
                own.lens.band_focal_length_percent,
                element.decentre_mm,
                element.tilt_deg,
                element.thickness_mm,
                element.radius_percent,
                element.index,
                element.air_gap_mm,
                own.temperature.change_k,
                own.filter.leak,
            ]
        };
        assert!(all(&commercial).into_iter().zip(all(&precision)).all(|(coarse, fine)| fine < coarse && fine > 0.0));
        assert_eq!(commercial.temperature.of_glass("PMMA").index_per_k, -1.05e-4);
    }

    #[test]
    fn what_is_not_legal_is_named() {
        let said = |text: &str| Tolerances::from_toml(text).unwrap_err().to_string();
        let head = "schema = 1\nname = \"t\"\n";
        assert_eq!(said(&format!("{head}[mask]\ncentre_mm = -1.0\n")), "`mask.centre_mm` is -1; legal: 0 to 10");
        assert!(said(&format!("{head}[mask]\ncentre = 1.0\n")).contains("unknown field `centre`"));
        assert!(said("schema = 2\nname = \"t\"\n").starts_with("`schema` is 2"));
        let named = format!("{head}[temperature.glasses.f2]\nindex_per_k = 1.0\n");
        assert!(said(&named).starts_with("`temperature.glasses.f2.index_per_k` is 1"));
        assert!(Tolerances::from_toml(head).is_ok());
    }
}
