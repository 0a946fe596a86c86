//! The pairs of radii of one design that are swept.

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use twinpupil_instrument::check::parse_toml;
use twinpupil_instrument::{DepthRange, Instrument, MaskPlace};

use super::{Choice, Design, Light, Wishes, choices, design, sweep};

/// What makes a sweep the same sweep, in plain text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PairsSpec {
    /// What the camera is called.
    pub name: String,
    /// The lens as an instrument file has it, surface by surface.
    pub lens: String,
    /// The camera whose sensor and bands are kept, as its file has it.
    pub like: String,
    /// Distance that is to be in focus, mm.
    pub distance_mm: f64,
    /// Nearest distance of objects, mm.
    pub near_mm: f64,
    /// Farthest distance of objects, mm.
    pub far_mm: f64,
    /// Diameter of the dots that depth is judged by, mm.
    pub diameter_mm: f64,
    /// As [`Light::brightness_e`].
    pub brightness_e: f64,
    /// Largest radius about the axis in which a band may see nothing, mm.
    pub blind_mm: f64,
    /// Radius within which masks keep clear of glass, mm.
    pub mask_radius_mm: f64,
    /// How far masks keep from glass, mm.
    pub clearance_mm: f64,
    /// Surface behind which the entocentric mask goes, if that is not left open.
    pub surface: Option<usize>,
    /// How far behind it, mm.
    pub position_mm: Option<f64>,
    /// The only pair, mm, if radii are not left open.
    pub radii_mm: Option<[f64; 2]>,
    /// The program that computes it: another one may come to other last digits.
    pub version: String,
}

/// A design and the pairs of radii of its masks to be tried.
#[derive(Debug, Clone)]
pub struct Pairs {
    /// Lens, masks and sensor in place.
    pub design: Design,
    /// The dots that depth is judged by.
    pub light: Light,
    /// Radii of the telecentric and the entocentric mask, mm.
    pub radii_mm: Vec<[f64; 2]>,
    /// Largest radius about the axis in which a band may see nothing, mm.
    blind_mm: f64,
}

impl PairsSpec {
    /// Puts masks and sensor in place.
    pub fn pairs(&self) -> Result<Pairs> {
        let design = design(self.wishes()?)?;
        let radii_mm = match self.radii_mm {
            Some(pair) => vec![pair],
            None => choices(&design)?,
        };
        let light = Light { diameter_mm: self.diameter_mm, brightness_e: self.brightness_e };
        Ok(Pairs { design, light, radii_mm, blind_mm: self.blind_mm })
    }

    fn wishes(&self) -> Result<Wishes> {
        let place = self.surface.zip(self.position_mm);
        Ok(Wishes {
            lens: parse_toml(&self.lens).context("lens")?,
            like: Instrument::from_toml(&self.like)?,
            distance_mm: self.distance_mm,
            depth_range: DepthRange { near_mm: self.near_mm, far_mm: self.far_mm },
            mask_radius_mm: self.mask_radius_mm,
            clearance_mm: self.clearance_mm,
            entocentric: place.map(|(surface, behind_mm)| MaskPlace { surface, behind_mm }),
        })
    }
}

impl Pairs {
    /// What a pair, by its number from 0, makes of the camera.
    pub fn choice(&self, number: usize) -> Result<Choice> {
        sweep(&self.design, self.radii_mm[number], &self.light, self.blind_mm)
    }
}
