//! Crosstalk from flat frames, each lit in one band alone.

use thiserror::Error;
use twinpupil_instrument::{Frame, FrameError, Instrument, PlaneView};

use crate::noise::Noise;

/// How much of every band each band's plane sees, with deviations from pixel noise.
#[derive(Debug, Clone, PartialEq)]
pub struct CrosstalkEstimate {
    /// Row i: signal in the plane of band i from unit light of every band; 1 from its own.
    pub matrix: Vec<Vec<f64>>,
    /// Standard deviations; 0 for a band in its own plane.
    pub std: Vec<Vec<f64>>,
}

/// Flat frames that tell no crosstalk.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum FlatError {
    /// A plane is missing.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// Not one frame for each band.
    #[error("there are {found} flat frames; legal: {bands}, one for each band, in the order of the instrument")]
    Count {
        /// Frames that were given.
        found: usize,
        /// Bands of the instrument.
        bands: usize,
    },
    /// Another size or another largest code than the first frame's, or another size than the sensor's.
    #[error("the flat of band `{band}` or the dark frame is not of the size and depth of the others")]
    Mixed {
        /// The band.
        band: String,
    },
    /// Too many pixels at the largest code.
    #[error("the flat of band `{band}` is saturated; legal: at most one pixel in a thousand at the largest code")]
    Saturated {
        /// The band.
        band: String,
    },
    /// A flat that hardly differs from darkness.
    #[error("the flat of band `{band}` is dark in its own plane")]
    Dark {
        /// The band.
        band: String,
    },
    /// A flat that is brightest in the plane of another band.
    #[error("the flat of band `{band}` is brighter in the plane of `{other}`; legal: flats in the order of the bands")]
    Swapped {
        /// The band whose flat it should be.
        band: String,
        /// Where it is brighter.
        other: String,
    },
}

/// Estimates crosstalk from one flat frame for each band, in the order of the instrument, each lit in that band alone.
///
/// ```text
/// M_ij = S_i/S_j        S_i: mean of plane i in the flat of band j, less black or the dark frame's mean
/// var M_ij = (var S_i + M_ij² var S_j)/S_j²
/// ```
///
/// Light falls on all planes alike, so it need not be even. No plane sees less than nothing: what noise takes below
/// zero is zero. Without a dark frame the sensor's black level is believed; it should be above the noise, or dark pixels,
/// whose noise is cut off at code 0, seem to see light.
pub fn estimate_crosstalk(
    instrument: &Instrument,
    flats: &[Frame],
    dark: Option<&Frame>,
) -> Result<CrosstalkEstimate, FlatError> {
    let bands = &instrument.bands;
    if flats.len() != bands.len() {
        return Err(FlatError::Count { found: flats.len(), bands: bands.len() });
    }
    let mut estimate = CrosstalkEstimate {
        matrix: vec![vec![1.0; bands.len()]; bands.len()],
        std: vec![vec![0.0; bands.len()]; bands.len()],
    };
    for (lit, flat) in flats.iter().enumerate() {
        let band = || bands[lit].name.clone();
        let shape = |frame: &Frame| ([frame.width_px(), frame.height_px()], frame.code_max());
        let is_odd = |frame: &&Frame| shape(frame) != shape(&flats[0]) || shape(frame).0 != instrument.sensor.size_px;
        if std::iter::once(flat).chain(dark).any(|frame| is_odd(&frame)) {
            return Err(FlatError::Mixed { band: band() });
        }
        let levels = bands
            .iter()
            .map(|plane| {
                let dark = dark.map(|dark| instrument.plane(dark, plane)).transpose()?;
                Level::of(
                    &instrument.plane(flat, plane)?,
                    dark.as_ref(),
                    &Noise::of_sensor(&instrument.sensor, flat.code_max()),
                )
                .ok_or_else(|| FlatError::Saturated { band: band() })
            })
            .collect::<Result<Vec<Level>, FlatError>>()?;
        let own = levels[lit];
        if own.signal < SIGNIFICANT * own.variance.sqrt() {
            return Err(FlatError::Dark { band: band() });
        }
        for (plane, level) in levels.iter().enumerate().filter(|(plane, _)| *plane != lit) {
            let ratio = level.signal / own.signal;
            if ratio > 1.0 {
                return Err(FlatError::Swapped { band: band(), other: bands[plane].name.clone() });
            }
            estimate.matrix[plane][lit] = ratio.max(0.0);
            estimate.std[plane][lit] = (level.variance + ratio * ratio * own.variance).sqrt() / own.signal;
        }
    }
    Ok(estimate)
}

/// Deviations of its mean by which a flat must differ from darkness in its own plane.
const SIGNIFICANT: f64 = 100.0;

/// Mean light of a plane.
#[derive(Debug, Clone, Copy)]
struct Level {
    /// Codes above darkness.
    signal: f64,
    /// Of the mean, codes².
    variance: f64,
}

impl Level {
    /// The light of a plane; `None` where it is saturated.
    fn of(plane: &PlaneView<'_>, dark: Option<&PlaneView<'_>>, noise: &Noise) -> Option<Self> {
        const SATURATED_MAX: f64 = 1e-3;
        let (mean, saturated) = mean(plane);
        let pixels = (plane.columns * plane.rows) as f64;
        if saturated as f64 > SATURATED_MAX * pixels {
            return None;
        }
        let (black, black_variance) = match dark {
            Some(dark) => {
                let (black, _) = self::mean(dark);
                (black, noise.variance(black) / pixels)
            }
            None => (noise.black_level, 0.0),
        };
        Some(Self { signal: mean - black, variance: noise.variance(mean) / pixels + black_variance })
    }
}

/// Mean code of a plane, and its number of saturated pixels.
fn mean(plane: &PlaneView<'_>) -> (f64, usize) {
    let (mut sum, mut saturated) = (0_u64, 0);
    for code in (0..plane.rows).flat_map(|row| plane.row(row)) {
        sum += u64::from(code);
        saturated += usize::from(code == plane.code_max);
    }
    (sum as f64 / (plane.columns * plane.rows) as f64, saturated)
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{InstrumentSpec, Sensor, paper};

    use super::*;

    /// The paper's mosaic of 8 × 6 pixels.
    fn small() -> Instrument {
        let spec = paper::instrument().into_spec();
        let sensor = Sensor { size_px: [8, 6], ..spec.sensor };
        Instrument::new(InstrumentSpec { sensor, ..spec }).expect("legal")
    }

    /// A frame with these codes in its red and blue pixels.
    fn flat(red: u16, blue: u16) -> Frame {
        let code = |index: usize| match (index % 2, index / 8 % 2) {
            (0, 0) => red,
            (1, 1) => blue,
            _ => 7,
        };
        Frame::new(8, 6, 4095, vec![(0..48).map(code).collect()]).expect("a frame")
    }

    #[test]
    fn ratios_of_means_are_found_with_their_deviations() {
        let (dark, flats) = (flat(10, 20), [flat(2010, 120), flat(60, 1020)]);
        let CrosstalkEstimate { matrix, std } = estimate_crosstalk(&small(), &flats, Some(&dark)).expect("flats");
        assert_eq!(matrix, [[1.0, 0.05], [0.05, 1.0]]);
        // Twelve pixels a plane; e = 32 700/4095 electrons a code, read noise 6.8 electrons and rounding.
        let e = 32_700.0 / 4095.0;
        let variance = |code: f64| ((6.8 / e) * (6.8 / e) + 1.0 / 12.0 + code / e) / 12.0;
        let mean = |code: f64, black: f64| variance(code) + variance(black);
        let by_hand = ((mean(120.0, 20.0) + 0.05_f64.powi(2) * mean(2010.0, 10.0)).sqrt()) / 2000.0;
        assert!((std[1][0] / by_hand - 1.0).abs() < 1e-12, "{} {by_hand}", std[1][0]);
        assert_eq!((std[0][0], std[1][1]), (0.0, 0.0));
    }

    #[test]
    fn nothing_is_seen_less_than_not_at_all() {
        let flats = [flat(2010, 15), flat(10, 1020)];
        let estimate = estimate_crosstalk(&small(), &flats, Some(&flat(10, 20))).expect("flats");
        assert_eq!(estimate.matrix[1][0], 0.0);
    }

    #[test]
    fn flats_that_tell_nothing_are_refused() {
        let refusal = |flats: &[Frame]| estimate_crosstalk(&small(), flats, None).expect_err("must be refused");
        let good = flat(2000, 400);
        assert_eq!(refusal(std::slice::from_ref(&good)), FlatError::Count { found: 1, bands: 2 });
        assert!(matches!(refusal(&[good.clone(), good.clone()]), FlatError::Swapped { .. }));
        assert!(matches!(refusal(&[flat(4095, 100), good.clone()]), FlatError::Saturated { .. }));
        assert!(matches!(refusal(&[flat(1, 0), good.clone()]), FlatError::Dark { .. }));
        let other = Frame::new(4, 4, 4095, vec![vec![0; 16]]).expect("a frame");
        assert!(matches!(refusal(&[other, good]), FlatError::Mixed { .. }));
    }
}
