//! The sensor: where it stands, how it samples the image, what its codes mean.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::{ValueError, within};
use crate::{ImagePoint, Mosaic, PixelPoint, Polarizers};

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
    /// How far the sensor is tilted about the point where the axis meets it, −10 to 10 deg: its distance from the rear
    /// principal plane grows by their tangents per mm across the axis, along +u and along +v.
    #[serde(default, skip_serializing_if = "is_upright")]
    pub tilt_deg: [f64; 2],
    /// How colour is sampled.
    pub mosaic: Mosaic,
    /// Angles of the polarizers before a cell of 2×2 pixels, row by row, if they are not those of Sony's sensors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub polarizer_deg: Option<Polarizers>,
    /// How much more light a polarizer passes along than across itself; without end if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub extinction_ratio: Option<f64>,
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

impl Sensor {
    /// The largest code.
    pub fn code_max(&self) -> u16 {
        ((1_u32 << self.bit_depth) - 1) as u16
    }

    /// Electrons that one code stands for.
    pub fn electrons_per_code(&self) -> f64 {
        self.full_well_e / f64::from(self.code_max() - self.black_level)
    }

    /// Position in mm from the axis of a position in px, on a sensor across the axis.
    pub fn image_from_pixel(&self, pixel: PixelPoint) -> ImagePoint {
        ImagePoint {
            x_mm: (pixel.u - self.axis_px[0]) * self.pitch_mm,
            y_mm: (pixel.v - self.axis_px[1]) * self.pitch_mm,
        }
    }

    /// Position in px of a position in mm from the axis, on a sensor across the axis.
    pub fn pixel_from_image(&self, image: ImagePoint) -> PixelPoint {
        PixelPoint { u: self.axis_px[0] + image.x_mm / self.pitch_mm, v: self.axis_px[1] + image.y_mm / self.pitch_mm }
    }

    /// Tangents of the tilts: how the distance from the rear principal plane grows along +u and +v.
    pub fn slope(&self) -> [f64; 2] {
        self.tilt_deg.map(|tilt_deg| tilt_deg.to_radians().tan())
    }

    /// Makes the mosaic and the angles that are stated beside it one.
    pub(crate) fn settle_polarizers(&mut self) -> Result<(), ValueError> {
        match (self.mosaic, self.polarizer_deg) {
            (Mosaic::Polarizer(_), Some(stated)) => {
                stated.check("sensor.polarizer_deg")?;
                self.mosaic = Mosaic::Polarizer(stated);
            }
            (Mosaic::Polarizer(own), None) if own != Polarizers::SONY => self.polarizer_deg = Some(own),
            (Mosaic::Polarizer(_), None) => {}
            (_, Some(stated)) => {
                let legal = "left out unless sensor.mosaic is polarizer";
                return Err(ValueError::new("sensor.polarizer_deg", format!("{:?}", stated.degrees), legal));
            }
            (_, None) => {}
        }
        match self.extinction_ratio {
            Some(ratio) if !matches!(self.mosaic, Mosaic::Polarizer(_)) => {
                let legal = "left out unless sensor.mosaic is polarizer";
                Err(ValueError::new("sensor.extinction_ratio", ratio, legal))
            }
            _ => Ok(()),
        }
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
        within("sensor.tilt_deg[0]", self.tilt_deg[0], -TILT_DEG_MAX, TILT_DEG_MAX)?;
        within("sensor.tilt_deg[1]", self.tilt_deg[1], -TILT_DEG_MAX, TILT_DEG_MAX)?;
        if !(1..=16).contains(&self.bit_depth) {
            return Err(ValueError::new("sensor.bit_depth", self.bit_depth, "1 to 16"));
        }
        if self.black_level >= self.code_max() {
            let legal = format!("below the largest code {}", self.code_max());
            return Err(ValueError::new("sensor.black_level", self.black_level, legal));
        }
        if let Some(ratio) = self.extinction_ratio {
            within("sensor.extinction_ratio", ratio, 1.5, 1e9)?;
        }
        within("sensor.full_well_e", self.full_well_e, 1.0, 1e9)?;
        within("sensor.read_noise_e", self.read_noise_e, 0.0, 1e6)
    }
}

/// Far more than any camera's sensor is mounted askew, or tilted on purpose.
const TILT_DEG_MAX: f64 = 10.0;

fn is_upright(tilt_deg: &[f64; 2]) -> bool {
    *tilt_deg == [0.0; 2]
}

fn is_zero(level: &u16) -> bool {
    *level == 0
}
