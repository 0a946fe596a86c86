//! The pairs of radii of one design that are swept.

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use twinpupil_instrument::check::parse_toml;
use twinpupil_instrument::{DepthRange, Instrument, MaskPlace};

use super::{Choice, Design, Light, Wishes, choices, design, sweep};
use crate::exact::Exact;

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
    pub distance_mm: Exact,
    /// Nearest distance of objects, mm.
    pub near_mm: Exact,
    /// Farthest distance of objects, mm.
    pub far_mm: Exact,
    /// Diameter of the dots that depth is judged by, mm.
    pub diameter_mm: Exact,
    /// As [`Light::brightness_e`].
    pub brightness_e: Exact,
    /// Largest radius about the axis in which a band may see nothing, mm.
    pub blind_mm: Exact,
    /// Radius within which masks keep clear of glass, mm.
    pub mask_radius_mm: Exact,
    /// How far masks keep from glass, mm.
    pub clearance_mm: Exact,
    /// Surface behind which the entocentric mask goes, if that is not left open.
    pub surface: Option<usize>,
    /// How far behind it, mm.
    pub position_mm: Option<Exact>,
    /// The only pair, mm, if radii are not left open.
    pub radii_mm: Option<[Exact; 2]>,
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
            Some(pair) => vec![pair.map(|radius| radius.0)],
            None => choices(&design)?,
        };
        let light = Light { diameter_mm: self.diameter_mm.0, brightness_e: self.brightness_e.0 };
        Ok(Pairs { design, light, radii_mm, blind_mm: self.blind_mm.0 })
    }

    fn wishes(&self) -> Result<Wishes> {
        let place = self.surface.zip(self.position_mm);
        Ok(Wishes {
            lens: parse_toml(&self.lens).context("lens")?,
            like: Instrument::from_toml(&self.like)?,
            distance_mm: self.distance_mm.0,
            depth_range: DepthRange { near_mm: self.near_mm.0, far_mm: self.far_mm.0 },
            mask_radius_mm: self.mask_radius_mm.0,
            clearance_mm: self.clearance_mm.0,
            entocentric: place.map(|(surface, behind_mm)| MaskPlace { surface, behind_mm: behind_mm.0 }),
        })
    }
}

impl Pairs {
    /// What a pair, by its number from 0, makes of the camera.
    pub fn choice(&self, number: usize) -> Result<Choice> {
        sweep(&self.design, self.radii_mm[number], &self.light, self.blind_mm)
    }
}
