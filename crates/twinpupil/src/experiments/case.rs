//! Through which lens a frame is taken, and how it is read.

use serde::Serialize;
use twinpupil_reconstruct::Mode;

/// The lens that a frame is simulated through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LensModel {
    /// The ideal lens of the paper's equations.
    Thin,
    /// The paper's Fresnel lens, traced facet by facet.
    Fresnel,
}

/// A lens and a way of reading its frames: a column of every comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Case {
    /// The thin lens, read by the paper's equations: what the paper simulates.
    ThinPaper,
    /// The thin lens, read by inverting the forward model.
    ThinModel,
    /// The Fresnel lens, read by the paper's equations: what the paper measures.
    FresnelPaper,
    /// The Fresnel lens, read by inverting the forward model.
    FresnelModel,
}

impl Case {
    /// The columns of `reproduce`.
    pub const REPRODUCED: [Self; 3] = [Self::ThinPaper, Self::FresnelPaper, Self::FresnelModel];

    /// The lens.
    pub fn lens(self) -> LensModel {
        match self {
            Self::ThinPaper | Self::ThinModel => LensModel::Thin,
            Self::FresnelPaper | Self::FresnelModel => LensModel::Fresnel,
        }
    }

    /// How its frames are read.
    pub fn mode(self) -> Mode {
        match self {
            Self::ThinPaper | Self::FresnelPaper => Mode::Paper,
            Self::ThinModel | Self::FresnelModel => Mode::Centroid,
        }
    }

    /// The word used in files.
    pub fn id(self) -> &'static str {
        match self {
            Self::ThinPaper => "thin_paper",
            Self::ThinModel => "thin_twinpupil",
            Self::FresnelPaper => "fresnel_paper",
            Self::FresnelModel => "fresnel_twinpupil",
        }
    }

    /// The lens and the way of reading, to stand above each other in a heading.
    pub fn heading(self) -> [&'static str; 2] {
        let lens = match self.lens() {
            LensModel::Thin => "thin lens",
            LensModel::Fresnel => "Fresnel lens",
        };
        let reading = match self.mode() {
            Mode::Paper => "paper's equations",
            Mode::Centroid | Mode::Model => "twinpupil",
        };
        [lens, reading]
    }

    /// The heading on one line.
    pub fn label(self) -> String {
        self.heading().join(", ")
    }
}
