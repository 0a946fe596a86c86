//! Why a feature did not become a point.

use twinpupil_instrument::PixelPoint;

use crate::detect::Feature;

/// A feature of a plane that is not measured. What is known of it is rough, but its light falls on its neighbours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bystander {
    /// Where it is, how large and how high, about.
    pub feature: Feature,
    /// Why it was not used.
    pub reason: RejectionReason,
}

impl Bystander {
    /// The rejection of this feature of a band.
    pub fn rejection(&self, band: &str) -> Rejection {
        Rejection {
            band: band.to_owned(),
            position: self.feature.centre,
            area_px: self.feature.area_px,
            reason: self.reason,
        }
    }
}

/// A feature that was found but not used.
#[derive(Debug, Clone, PartialEq)]
pub struct Rejection {
    /// Name of the band.
    pub band: String,
    /// Where it lies on the frame.
    pub position: PixelPoint,
    /// Its area above half its height, px of the frame.
    pub area_px: f64,
    /// Why it was not used.
    pub reason: RejectionReason,
}

/// Why a feature was not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RejectionReason {
    /// Its outline leaves the frame.
    CutByBorder,
    /// Part of it reads the largest code (or, dark on bright, its surroundings do).
    Saturated,
    /// Fewer pixels than a feature needs.
    TooSmall,
    /// Much fainter than the other features of the plane.
    LowContrast,
    /// Its centre could not be measured.
    NoCentre,
    /// No feature of the other band lies on its azimuth within the depth range, a better pair took it, or its pair lay
    /// far beside the azimuth where the frame's other pairs did not; in a band beside the pair: no point is predicted
    /// there.
    NoPartner,
    /// Its pair lies on the axis, or its radii belong to no depth in the range.
    NoDepth,
}

impl RejectionReason {
    /// The word used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::CutByBorder => "cut_by_border",
            Self::Saturated => "saturated",
            Self::TooSmall => "too_small",
            Self::LowContrast => "low_contrast",
            Self::NoCentre => "no_centre",
            Self::NoPartner => "no_partner",
            Self::NoDepth => "no_depth",
        }
    }
}
