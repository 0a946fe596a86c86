//! Options that several commands share.

use clap::ValueEnum;
use twinpupil_reconstruct::Polarity;

/// Whether features are brighter or darker than their surroundings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PolarityOption {
    /// As the frame shows
    Auto,
    /// Bright features on dark ground
    Bright,
    /// Dark features on bright ground
    Dark,
}

impl PolarityOption {
    /// `None` where the frame decides.
    pub fn polarity(self) -> Option<Polarity> {
        match self {
            Self::Auto => None,
            Self::Bright => Some(Polarity::Bright),
            Self::Dark => Some(Polarity::Dark),
        }
    }
}
