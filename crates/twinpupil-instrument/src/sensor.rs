//! The sensor: where it stands, how it samples the image, what its codes mean.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::{ValueError, within};
use crate::{ImagePoint, PixelPoint};

/// `[sensor]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// Distance L from the rear principal plane, mm.
    pub distance_mm: f64,
    /// Columns and rows.
    pub size_px: [usize; 2],
    /// Pixel pitch, mm.
    pub pitch_mm: f64,
    /// Where the optical axis meets the sensor, px.
    pub axis_px: [f64; 2],
    /// How colour is sampled.
    pub mosaic: Mosaic,
    /// Bits of a code; the largest code is 2^bits − 1.
    pub bit_depth: u8,
    /// Electrons at the largest code.
    pub full_well_e: f64,
    /// Read noise, electrons rms.
    pub read_noise_e: f64,
    /// Code of a pixel without light.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub black_level: u16,
}

/// How the sensor samples colour: every pixel all bands, one band a page, or a 2×2 mosaic named row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
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

impl Mosaic {
    /// Every mosaic, for help texts and tests.
    pub const ALL: [Self; 6] = [Self::Rgb, Self::Mono, Self::Rggb, Self::Bggr, Self::Grbg, Self::Gbrg];

    /// The word used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgb => "rgb",
            Self::Mono => "mono",
            Self::Rggb => "rggb",
            Self::Bggr => "bggr",
            Self::Grbg => "grbg",
            Self::Gbrg => "gbrg",
        }
    }

    /// The mosaic of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|mosaic| mosaic.name() == name)
    }

    /// Number of pages of a frame; `mono` has as many as there are bands.
    pub fn pages(self, bands: usize) -> usize {
        match self {
            Self::Rgb => 3,
            Self::Mono => bands,
            _ => 1,
        }
    }

    /// Where `plane` lies, or `None` if this mosaic has no such plane.
    ///
    /// A Bayer mosaic has two green sub-lattices; `g` is the one in the first row.
    pub fn site(self, plane: &str) -> Option<Site> {
        match self {
            Self::Rgb => {
                let page = ["r", "g", "b"].iter().position(|name| *name == plane)?;
                Some(Site { page, origin_px: [0, 0], step_px: 1 })
            }
            Self::Mono => plane.parse().ok().map(|page| Site { page, origin_px: [0, 0], step_px: 1 }),
            bayer => {
                let cell = bayer.name();
                let index = (plane.len() == 1).then(|| cell.find(plane))??;
                Some(Site { page: 0, origin_px: [index % 2, index / 2], step_px: 2 })
            }
        }
    }

    /// The plane that pixel (column, row) of a page belongs to.
    pub fn plane_of(self, page: usize, column: usize, row: usize) -> String {
        match self {
            Self::Rgb => ["r", "g", "b"][page.min(2)].to_owned(),
            Self::Mono => page.to_string(),
            bayer => {
                let index = (row % 2) * 2 + column % 2;
                bayer.name()[index..=index].to_owned()
            }
        }
    }
}

impl Sensor {
    /// The largest code.
    pub fn code_max(&self) -> u16 {
        ((1_u32 << self.bit_depth) - 1) as u16
    }

    /// Electrons that one code stands for.
    pub fn electrons_per_code(&self) -> f64 {
        self.full_well_e / f64::from(self.code_max() - self.black_level)
    }

    /// Position in mm from the axis of a position in px.
    pub fn image_from_pixel(&self, pixel: PixelPoint) -> ImagePoint {
        ImagePoint {
            x_mm: (pixel.u - self.axis_px[0]) * self.pitch_mm,
            y_mm: (pixel.v - self.axis_px[1]) * self.pitch_mm,
        }
    }

    /// Position in px of a position in mm from the axis.
    pub fn pixel_from_image(&self, image: ImagePoint) -> PixelPoint {
        PixelPoint { u: self.axis_px[0] + image.x_mm / self.pitch_mm, v: self.axis_px[1] + image.y_mm / self.pitch_mm }
    }

    pub(crate) fn check(&self) -> Result<(), ValueError> {
        within("sensor.distance_mm", self.distance_mm, 0.1, 1e5)?;
        for (i, size) in self.size_px.into_iter().enumerate() {
            if !(2..=65_536).contains(&size) {
                return Err(ValueError::new(format!("sensor.size_px[{i}]"), size, "2 to 65536"));
            }
        }
        within("sensor.pitch_mm", self.pitch_mm, 1e-5, 1.0)?;
        within("sensor.axis_px[0]", self.axis_px[0], -1e6, 1e6)?;
        within("sensor.axis_px[1]", self.axis_px[1], -1e6, 1e6)?;
        if !(1..=16).contains(&self.bit_depth) {
            return Err(ValueError::new("sensor.bit_depth", self.bit_depth, "1 to 16"));
        }
        if self.black_level >= self.code_max() {
            let legal = format!("below the largest code {}", self.code_max());
            return Err(ValueError::new("sensor.black_level", self.black_level, legal));
        }
        within("sensor.full_well_e", self.full_well_e, 1.0, 1e9)?;
        within("sensor.read_noise_e", self.read_noise_e, 0.0, 1e6)
    }
}

fn is_zero(level: &u16) -> bool {
    *level == 0
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
        for mosaic in [Mosaic::Rggb, Mosaic::Bggr, Mosaic::Grbg, Mosaic::Gbrg] {
            for plane in ["r", "g", "b"] {
                let [column, row] = mosaic.site(plane).expect("every Bayer mosaic has r, g and b").origin_px;
                assert_eq!(mosaic.plane_of(0, column, row), plane);
            }
        }
    }
}
