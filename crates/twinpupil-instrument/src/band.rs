//! A spectral band: what it is called, what it is for, and where the frame carries it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Correction, Distortion, Registration};

/// What a band's pupil makes of depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// The pupil lies in the back focal plane: image size does not depend on depth.
    Telecentric,
    /// The pupil lies at the lens: image size falls with depth.
    Entocentric,
    /// The pupil lies anywhere else, as between the two: image size depends on depth in a way of its own.
    Intermediate,
}

impl Role {
    /// The word used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Telecentric => "telecentric",
            Self::Entocentric => "entocentric",
            Self::Intermediate => "intermediate",
        }
    }
}

/// One `[[band]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Band {
    /// The name by which apertures and filters refer to this band.
    pub name: String,
    /// Telecentric, entocentric or intermediate.
    pub role: Role,
    /// Centre wavelength, 200 to 20000 nm.
    pub wavelength_nm: f64,
    /// The plane of the frame that carries this band: `r`, `g` or `b`; a page number on a `mono` sensor or one of
    /// several `sensors`; an angle behind polarizers; in a `cube` a number or a wavelength such as `680 nm`.
    pub plane: String,
    /// Where its page lies on the reference frame, if it was taken by a sensor of its own.
    #[serde(default, skip_serializing_if = "Registration::is_identity")]
    pub registration: Registration,
    /// How the lens departs from an ideal one's perspective in this band; not at all if left out.
    #[serde(default, skip_serializing_if = "Distortion::is_none")]
    pub distortion: Distortion,
    /// What else displaces its images, smooth over the sensor; nothing if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correction: Option<Correction>,
}
