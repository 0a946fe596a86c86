//! What the paper prints, once, and never computed again: H. Ohno, Optics Express 26(20), 25880 (2018).

use serde::Serialize;

/// How the paper is cited wherever its numbers stand.
pub const CITATION: &str = "H. Ohno, Optics Express 26(20), 25880 (2018)";

/// A printed number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Published {
    /// The number, in the unit of its row.
    pub value: f64,
    /// How many decimals are printed.
    pub decimals: usize,
    /// Distance at which it occurs, mm, where the paper says so.
    pub at_z_mm: Option<f64>,
    /// Where it is printed.
    pub source: &'static str,
}

impl Published {
    const fn new(value: f64, decimals: usize, source: &'static str) -> Self {
        Self { value, decimals, at_z_mm: None, source }
    }

    const fn at(value: f64, decimals: usize, z_mm: f64, source: &'static str) -> Self {
        Self { value, decimals, at_z_mm: Some(z_mm), source }
    }

    /// The number as it is printed.
    pub fn text(&self) -> String {
        format!("{:.*}", self.decimals, self.value)
    }
}

const FIG_10: &str = "[Ohno2018, Fig. 10]";
const FIG_11: &str = "[Ohno2018, Fig. 11]";

/// Largest distance of the line fitted to the measured depths from the truth, mm.
pub const LINE_OFF_TRUTH_MM: Published = Published::at(3.6, 1, 350.0, FIG_10);

/// Largest distance of that line from the simulation, mm.
pub const LINE_OFF_SIMULATION_MM: Published = Published::at(2.9, 1, 340.0, FIG_10);

/// Standard deviation of the measured depths against the ideal, mm.
pub const STD_AGAINST_IDEAL_MM: Published = Published::new(2.2, 1, FIG_10);

/// Standard deviation of the measured depths against the simulation, mm.
pub const STD_AGAINST_SIMULATION_MM: Published = Published::new(1.2, 1, FIG_10);

/// A tilted plate as the paper measured it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PublishedTilt {
    /// True tilt, degrees.
    pub tilt_deg: f64,
    /// Tilt of the fitted line, degrees.
    pub fitted_deg: Published,
    /// R² of the fit.
    pub r_squared: Published,
}

/// The tilted plates.
pub const TILTS: [PublishedTilt; 3] = [tilt(30.0, 28.1, 0.62), tilt(45.0, 44.0, 0.87), tilt(60.0, 55.1, 0.89)];

const fn tilt(tilt_deg: f64, fitted_deg: f64, r_squared: f64) -> PublishedTilt {
    PublishedTilt {
        tilt_deg,
        fitted_deg: Published::new(fitted_deg, 1, FIG_11),
        r_squared: Published::new(r_squared, 2, FIG_11),
    }
}
