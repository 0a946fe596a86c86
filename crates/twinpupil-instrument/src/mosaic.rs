//! How the sensor samples colour or polarization, and which pixels carry which plane.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::check::ValueError;

/// How the sensor samples colour: every pixel all bands, one band a page, or a 2×2 mosaic named row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Mosaic {
    /// Red, green and blue in every pixel.
    Rgb,
    /// One page of grey values for each band.
    Mono,
    /// Bayer: R G / G B.
    Rggb,
    /// Bayer: B G / G R.
    Bggr,
    /// Bayer: G R / B G.
    Grbg,
    /// Bayer: G B / R G.
    Gbrg,
    /// A polarizer before every pixel of a 2×2 cell.
    Polarizer(Polarizers),
    /// A sensor of its own for each band, behind a beam splitter: one page each, in files of their own.
    Sensors,
    /// A hyperspectral cube: one page for each band, picked from the cube's many.
    Cube,
}

/// Angles of the polarizers before a cell of 2×2 pixels, row by row, degrees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Polarizers {
    /// Row by row.
    pub degrees: [[u16; 2]; 2],
}

impl Polarizers {
    /// The cell of Sony's polarization sensors (IMX250MZR and its kin), by their data sheet.
    pub const SONY: Self = Self { degrees: [[90, 45], [135, 0]] };

    /// Every angle once, none twice.
    pub(crate) fn check(&self, key: &str) -> Result<(), ValueError> {
        let mut degrees = self.degrees.as_flattened().to_vec();
        degrees.sort_unstable();
        if degrees == [0, 45, 90, 135] {
            return Ok(());
        }
        Err(ValueError::new(key, format!("{:?}", self.degrees), "the angles 0, 45, 90 and 135, each once"))
    }
}

/// The pixels that carry one plane: a page of the frame and a sub-lattice of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Site {
    /// Index of the page.
    pub page: usize,
    /// First column and row.
    pub origin_px: [usize; 2],
    /// Columns and rows from one pixel of the plane to the next.
    pub step_px: usize,
}

impl Site {
    /// Every pixel of a page.
    pub fn of_page(page: usize) -> Self {
        Self { page, origin_px: [0, 0], step_px: 1 }
    }

    /// One pixel of every 2×2 cell, by its place in the cell, row by row.
    fn of_cell(index: usize) -> Self {
        Self { page: 0, origin_px: [index % 2, index / 2], step_px: 2 }
    }
}

impl Mosaic {
    /// Every mosaic, for help texts and tests.
    pub const ALL: [Self; 9] = [
        Self::Rgb,
        Self::Mono,
        Self::Rggb,
        Self::Bggr,
        Self::Grbg,
        Self::Gbrg,
        Self::Polarizer(Polarizers::SONY),
        Self::Sensors,
        Self::Cube,
    ];

    /// The word used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgb => "rgb",
            Self::Mono => "mono",
            Self::Rggb => "rggb",
            Self::Bggr => "bggr",
            Self::Grbg => "grbg",
            Self::Gbrg => "gbrg",
            Self::Polarizer(_) => "polarizer",
            Self::Sensors => "sensors",
            Self::Cube => "cube",
        }
    }

    /// The mosaic of that name; polarizers stand as on Sony's sensors.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|mosaic| mosaic.name() == name)
    }

    /// Number of pages of a frame; those with one page a band have as many as there are bands.
    pub fn pages(self, bands: usize) -> usize {
        match self {
            Self::Rgb => 3,
            _ if self.has_page_for_each_band() => bands,
            _ => 1,
        }
    }

    /// Whether every band has a page of its own.
    pub fn has_page_for_each_band(self) -> bool {
        matches!(self, Self::Mono | Self::Sensors | Self::Cube)
    }

    /// The planes that it has whatever the bands are; none where every band has a page of its own.
    pub fn planes(self) -> Vec<String> {
        match self {
            Self::Mono | Self::Sensors | Self::Cube => Vec::new(),
            Self::Polarizer(_) => ["0", "45", "90", "135"].map(str::to_owned).to_vec(),
            _ => ["r", "g", "b"].map(str::to_owned).to_vec(),
        }
    }

    /// Where `plane` lies, or `None` if this mosaic has no such plane.
    ///
    /// A Bayer mosaic has two green sub-lattices; `g` is the one in the first row. Which page of a frame carries a plane
    /// of a cube depends on the other bands: ask [`Instrument::site`](crate::Instrument::site).
    pub fn site(self, plane: &str) -> Option<Site> {
        match self {
            Self::Rgb => Some(Site::of_page(["r", "g", "b"].iter().position(|name| *name == plane)?)),
            Self::Mono | Self::Sensors => plane.parse().ok().map(Site::of_page),
            Self::Cube => None,
            Self::Polarizer(Polarizers { degrees }) => {
                let index = degrees.as_flattened().iter().position(|angle| angle.to_string() == plane)?;
                Some(Site::of_cell(index))
            }
            bayer => {
                let cell = bayer.name();
                let index = (plane.len() == 1).then(|| cell.find(plane))??;
                Some(Site::of_cell(index))
            }
        }
    }

    /// The plane that pixel (column, row) of a page belongs to.
    pub fn plane_of(self, page: usize, column: usize, row: usize) -> String {
        match self {
            Self::Rgb => ["r", "g", "b"][page.min(2)].to_owned(),
            Self::Mono | Self::Sensors | Self::Cube => page.to_string(),
            Self::Polarizer(Polarizers { degrees }) => degrees[row % 2][column % 2].to_string(),
            bayer => {
                let index = (row % 2) * 2 + column % 2;
                bayer.name()[index..=index].to_owned()
            }
        }
    }
}

// In files a mosaic is a word; the angles of polarizers are a key of their own.

impl Serialize for Mosaic {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for Mosaic {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        Self::from_name(&name).ok_or_else(|| {
            const NAMES: &[&str] = &["rgb", "mono", "rggb", "bggr", "grbg", "gbrg", "polarizer", "sensors", "cube"];
            serde::de::Error::unknown_variant(&name, NAMES)
        })
    }
}

impl JsonSchema for Mosaic {
    fn schema_name() -> Cow<'static, str> {
        "Mosaic".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "How the sensor samples colour: every pixel all bands, one band a page, or a 2×2 mosaic.",
            "type": "string",
            "enum": Self::ALL.map(Self::name),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bayer_sites_follow_the_name() {
        let site = |mosaic: Mosaic, plane| mosaic.site(plane).map(|site| site.origin_px);
        assert_eq!(site(Mosaic::Rggb, "r"), Some([0, 0]));
        assert_eq!(site(Mosaic::Rggb, "b"), Some([1, 1]));
        assert_eq!(site(Mosaic::Gbrg, "b"), Some([1, 0]));
        assert_eq!(site(Mosaic::Gbrg, "r"), Some([0, 1]));
        assert_eq!(site(Mosaic::Rggb, "x"), None);
        assert_eq!(site(Mosaic::Rggb, "rg"), None);
        assert_eq!(site(Mosaic::Rggb, ""), None);
    }

    #[test]
    fn plane_of_inverts_site() {
        let polarizers = Mosaic::Polarizer(Polarizers { degrees: [[0, 135], [45, 90]] });
        let sony = Mosaic::Polarizer(Polarizers::SONY);
        for mosaic in [Mosaic::Rggb, Mosaic::Bggr, Mosaic::Grbg, Mosaic::Gbrg, polarizers, sony] {
            for plane in mosaic.planes() {
                let [column, row] = mosaic.site(&plane).expect("every mosaic has its planes").origin_px;
                assert_eq!(mosaic.plane_of(0, column, row), plane);
            }
        }
    }

    #[test]
    fn sonys_cell_has_its_upright_polarizer_first() {
        let site = |plane| Mosaic::Polarizer(Polarizers::SONY).site(plane).map(|site| site.origin_px);
        assert_eq!(
            [site("90"), site("45"), site("135"), site("0")].map(Option::unwrap),
            [[0, 0], [1, 0], [0, 1], [1, 1]]
        );
        assert_eq!(site("30"), None);
    }

    #[test]
    fn the_names_are_those_of_the_schema() {
        for mosaic in Mosaic::ALL {
            assert_eq!(Mosaic::from_name(mosaic.name()), Some(mosaic));
        }
    }
}
