//! Crosstalk: a plane sees a little of the other bands too. Where the response is known, it is taken off.

use nalgebra::DMatrix;
use twinpupil_instrument::{
    Frame, FrameError, FrameView, Instrument, PixelPoint, PlaneView, Registration, ResponseMatrix,
};

use crate::noise::Noise;

/// How the light of every band follows from the codes of all planes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Crosstalk {
    /// Row i: signal in the plane of band i from unit light of every band.
    response: DMatrix<f64>,
    /// Its inverse.
    unmixing: DMatrix<f64>,
}

/// Codes that are added to an unmixed plane, so that noise about zero is kept.
const PEDESTAL: u16 = 64;

/// How much larger unmixing makes the noise of the noisiest plane, `max √Σ W²`; `None` where the bands cannot be told
/// apart.
pub fn noise_gain(instrument: &Instrument, response: &ResponseMatrix) -> Option<f64> {
    let unmixing = seen_by_planes(instrument, response).try_inverse()?;
    let gain = unmixing.row_iter().map(|row| row.norm()).fold(0.0, f64::max);
    gain.is_finite().then_some(gain)
}

/// Row i: signal in the plane of band i from unit light of every band.
fn seen_by_planes(instrument: &Instrument, response: &ResponseMatrix) -> DMatrix<f64> {
    let rows: Vec<Vec<f64>> = instrument.bands.iter().map(|band| response.of_plane(&band.plane)).collect();
    let seen = |plane: usize, band: usize| rows[plane].get(band).copied().unwrap_or(0.0);
    DMatrix::from_fn(rows.len(), rows.len(), seen)
}

impl Crosstalk {
    /// The crosstalk of an instrument's planes; `None` where there is none, or where the bands cannot be told apart.
    pub(crate) fn of(instrument: &Instrument, response: &ResponseMatrix) -> Option<Self> {
        let response = seen_by_planes(instrument, response);
        if response == DMatrix::identity(response.nrows(), response.ncols()) {
            return None;
        }
        let unmixing =
            response.clone().try_inverse().filter(|inverse| inverse.iter().all(|value| value.is_finite()))?;
        Some(Self { response, unmixing })
    }

    /// Noise of the unmixed codes of a band where the planes' own have `noise`.
    ///
    /// ```text
    /// S_i = Σ_j W_ij r_j,  r_j = Σ_k M_jk S_k        W = M⁻¹, r: codes above black, S: light of the bands
    /// var S_i = Σ_j W_ij² (floor + slope r_j)
    /// ```
    ///
    /// What light the other bands have at the same place is not known beforehand: they are taken to be as bright as the
    /// band itself, which is right where their images overlap and a little too much where they do not. Codes between
    /// the pixels of a lattice are means of several, but neighbours share them: over the pixels of a feature they
    /// scatter as one code each does.
    pub(crate) fn noise(&self, band: usize, noise: Noise) -> Noise {
        const ROUNDING_CODES2: f64 = 1.0 / 12.0;
        let squares = self.unmixing.row(band).map(|weight| weight * weight);
        let light: f64 = (squares.clone() * &self.response).sum();
        Noise {
            floor_codes2: noise.floor_codes2 * squares.sum() + ROUNDING_CODES2,
            slope_codes: noise.slope_codes * light,
            black_level: noise.black_level + f64::from(PEDESTAL),
        }
    }

    /// The frame with each band's plane freed of the other bands' light, and [`PEDESTAL`] codes brighter.
    ///
    /// ```text
    /// S_i = Σ_j W_ij r_j
    /// ```
    ///
    /// On a mosaic the other r_j lie between their planes' pixels and are interpolated; so they are between the pixels
    /// of another sensor. It is only a correction: what is measured stays on its own lattice. Saturated pixels stay
    /// saturated.
    pub(crate) fn unmixed(&self, frame: FrameView<'_>, instrument: &Instrument) -> Result<Frame, FrameError> {
        let bands = &instrument.bands;
        let planes = bands.iter().map(|band| instrument.plane(frame, band)).collect::<Result<Vec<_>, _>>()?;
        let code_max = frame.code_max().saturating_add(PEDESTAL);
        let mut pages: Vec<Vec<u16>> = frame.pages().map(<[u16]>::to_vec).collect();
        for (band, stated) in bands.iter().enumerate() {
            let own = Own { plane: &planes[band], weight: self.unmixing[(band, band)] };
            let others: Vec<Other<'_>> = (0..bands.len())
                .filter(|other| *other != band && self.unmixing[(band, *other)] != 0.0)
                .map(|other| Other {
                    plane: &planes[other],
                    weight: self.unmixing[(band, other)],
                    there: Way::between(stated.registration, bands[other].registration),
                })
                .collect();
            let black = Noise::of_sensor(&instrument.sensor, frame.code_max()).black_level;
            own.replace(&others, black, code_max, frame.width_px(), &mut pages[instrument.site(stated).page]);
        }
        Frame::new(frame.width_px(), frame.height_px(), code_max, pages)
    }
}

/// The plane that is unmixed.
struct Own<'a> {
    plane: &'a PlaneView<'a>,
    weight: f64,
}

impl Own<'_> {
    fn replace(&self, others: &[Other<'_>], black: f64, code_max: u16, width_px: usize, page: &mut [u16]) {
        let plane = self.plane;
        for row in 0..plane.rows {
            let start = (plane.origin_px[1] + row * plane.step_px) * width_px + plane.origin_px[0];
            let v = plane.frame_v_px(row as f64);
            for (column, code) in plane.row(row).enumerate() {
                let here = PixelPoint { u: plane.frame_u_px(column as f64), v };
                let beside: f64 = others.iter().map(|other| other.weight * (other.code_at(here) - black)).sum();
                let light = self.weight * (f64::from(code) - black) + beside;
                let shifted = (light + black + f64::from(PEDESTAL)).round();
                page[start + column * plane.step_px] =
                    if code == plane.code_max { code_max } else { shifted.clamp(0.0, f64::from(code_max)) as u16 };
            }
        }
    }
}

/// A plane whose light is taken off.
struct Other<'a> {
    plane: &'a PlaneView<'a>,
    weight: f64,
    there: Way,
}

/// From the pixels of one band's page to those of another's.
enum Way {
    Same,
    Through { reference_from_own: Registration, other_from_reference: Registration },
}

impl Way {
    fn between(own: Registration, other: Registration) -> Self {
        match own == other {
            true => Self::Same,
            false => Self::Through { reference_from_own: own, other_from_reference: other.inverse() },
        }
    }

    fn map(&self, here: PixelPoint) -> PixelPoint {
        match self {
            Self::Same => here,
            Self::Through { reference_from_own, other_from_reference } => {
                other_from_reference.map(reference_from_own.map(here))
            }
        }
    }
}

impl Other<'_> {
    /// Code at a place of the own page, bilinear; the last pixel's beyond the ends.
    fn code_at(&self, here: PixelPoint) -> f64 {
        let plane = self.plane;
        let there = self.there.map(here);
        let (columns, across) = neighbours(there.u, plane.origin_px[0], plane.step_px, plane.columns);
        let (rows, down) = neighbours(there.v, plane.origin_px[1], plane.step_px, plane.rows);
        let along = |row: usize| {
            let [a, b] = columns.map(|column| f64::from(plane.code(column, row)));
            a + across * (b - a)
        };
        let [upper, lower] = rows.map(along);
        upper + down * (lower - upper)
    }
}

/// The two pixels of a lattice about a position of the frame, and how far between them; the last one beyond the ends.
fn neighbours(position_px: f64, origin_px: usize, step_px: usize, count: usize) -> ([usize; 2], f64) {
    let position = ((position_px - origin_px as f64) / step_px as f64).clamp(0.0, (count - 1) as f64);
    let first = position as usize;
    ([first, (first + 1).min(count - 1)], position - first as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use twinpupil_instrument::{Mosaic, builtin, paper};

    fn crosstalk(instrument: &Instrument, rows: &[Vec<f64>]) -> Crosstalk {
        Crosstalk::of(instrument, &ResponseMatrix::from_rows(&instrument.bands, rows)).expect("some crosstalk")
    }

    #[test]
    fn mixed_slopes_are_unmixed_to_a_code() {
        let light = [
            |u: f64, v: f64| 1000.0 + 3.0 * u + v,
            |u: f64, v: f64| 2000.0 - 2.0 * u + v,
            |u: f64, v: f64| 500.0 + u - 2.0 * v,
        ];
        let instrument = Instrument::from_toml(builtin::toml("three-bands").unwrap()).unwrap();
        let rows = [vec![1.0, 0.06, 0.1], vec![0.11, 1.0, 0.08], vec![0.04, 0.09, 1.0]];
        let code = |index: usize| {
            let (u, v) = (index % 80, index / 80);
            let plane = Mosaic::Rggb.plane_of(0, u, v);
            let band = instrument.bands.iter().position(|band| band.plane == plane).unwrap();
            (0..3).map(|k| rows[band][k] * light[k](u as f64, v as f64)).sum::<f64>().round() as u16
        };
        let frame = Frame::new(80, 60, 4095, vec![(0..80 * 60).map(code).collect()]).expect("a frame");
        let unmixed = crosstalk(&instrument, &rows).unmixed((&frame).into(), &instrument).expect("a frame");
        for (band, true_code) in instrument.bands.iter().zip(light) {
            let view = instrument.plane(&unmixed, band).expect("a Bayer frame");
            for (row, column) in (1..29).flat_map(|row| (1..39).map(move |column| (row, column))) {
                let found = f64::from(view.code(column, row)) - f64::from(PEDESTAL);
                let (u, v) = (view.frame_u_px(column as f64), view.frame_v_px(row as f64));
                assert!((found - true_code(u, v)).abs() <= 1.3, "{} {u} {v}: {found}", band.name);
            }
        }
    }

    #[test]
    fn an_ideal_response_has_no_crosstalk() {
        let instrument = paper::instrument();
        assert_eq!(Crosstalk::of(&instrument, &ResponseMatrix::ideal(&instrument.bands)), None);
    }

    #[test]
    fn bands_that_look_alike_are_not_unmixed() {
        let instrument = paper::instrument();
        let alike = ResponseMatrix::from_rows(&instrument.bands, &[vec![1.0, 1.0], vec![1.0, 1.0]]);
        assert_eq!(Crosstalk::of(&instrument, &alike), None);
    }

    #[test]
    fn the_noise_of_a_difference_is_that_of_both_codes() {
        // S = (r − m r′)/(1 − m m′) with r = r′ where both bands are alike and m = m′.
        let instrument = paper::instrument();
        let m = 0.25;
        let crosstalk = crosstalk(&instrument, &[vec![1.0, m], vec![m, 1.0]]);
        let noise = Noise { floor_codes2: 2.0, slope_codes: 0.125, black_level: 10.0 };
        let unmixed = crosstalk.noise(0, noise);
        let (light, gain) = (1000.0, (1.0 + m * m) / (1.0 - m * m).powi(2));
        let by_hand = gain * (2.0 + 0.125 * light * (1.0 + m)) + 1.0 / 12.0;
        let code = light + 10.0 + f64::from(PEDESTAL);
        assert!((unmixed.variance(code) / by_hand - 1.0).abs() < 1e-12);
    }

    #[test]
    fn unmixed_pixels_scatter_as_their_noise_says() {
        let mut spec = paper::instrument().into_spec();
        spec.sensor.mosaic = Mosaic::Rgb;
        let instrument = Instrument::new(spec).expect("legal");
        let rows = [vec![1.0, 0.4], vec![0.3, 1.0]];
        // A cheap scatter of uniform numbers, of variance 64²/12, on both planes.
        let mut state = 1_u64;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            1000 + (state >> 58) as u16
        };
        let mut page = || (0..200 * 200).map(|_| draw()).collect::<Vec<u16>>();
        let frame = Frame::new(200, 200, 4095, vec![page(), page(), page()]).expect("a frame");
        let crosstalk = crosstalk(&instrument, &rows);
        let unmixed = crosstalk.unmixed((&frame).into(), &instrument).expect("a frame");
        let view = instrument.plane(&unmixed, &instrument.bands[0]).expect("a page");
        let codes: Vec<f64> = (0..200).flat_map(|row| view.row(row).map(f64::from).collect::<Vec<_>>()).collect();
        let mean = codes.iter().sum::<f64>() / codes.len() as f64;
        let variance = codes.iter().map(|code| (code - mean).powi(2)).sum::<f64>() / codes.len() as f64;
        let floor_codes2 = (64.0 * 64.0 - 1.0) / 12.0;
        let noise = crosstalk.noise(0, Noise { floor_codes2, slope_codes: 0.0, black_level: 0.0 });
        assert!((variance / noise.floor_codes2 - 1.0).abs() < 0.03, "{variance} {}", noise.floor_codes2);
    }
}
