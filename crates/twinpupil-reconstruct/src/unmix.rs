//! Crosstalk: a plane sees a little of the other band too. Where the response is known, it is taken off.

use twinpupil_instrument::{Frame, FrameError, Instrument, PlaneView, ResponseMatrix, Role};

/// How much of the other band each of the two planes sees; each sees its own with a response of 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Crosstalk {
    /// Entocentric light in the telecentric plane.
    in_telecentric: f64,
    /// Telecentric light in the entocentric plane.
    in_entocentric: f64,
}

/// Codes that are added to an unmixed plane, so that noise about zero is kept.
const PEDESTAL: u16 = 64;

impl Crosstalk {
    /// The crosstalk of an instrument's two planes; `None` where there is none.
    pub(crate) fn of(instrument: &Instrument, response: &ResponseMatrix) -> Option<Self> {
        let [telecentric, entocentric] = [Role::Telecentric, Role::Entocentric];
        let seen = |plane: Role, band: Role| {
            response.of_plane(&instrument.band(plane).plane).get(instrument.band_index(band)).copied().unwrap_or(0.0)
        };
        let crosstalk =
            Self { in_telecentric: seen(telecentric, entocentric), in_entocentric: seen(entocentric, telecentric) };
        let some = crosstalk.in_telecentric != 0.0 || crosstalk.in_entocentric != 0.0;
        (some && crosstalk.determinant() > 0.0).then_some(crosstalk)
    }

    fn determinant(&self) -> f64 {
        1.0 - self.in_telecentric * self.in_entocentric
    }

    /// The frame with each band's plane freed of the other band's light, and [`PEDESTAL`] codes brighter.
    ///
    /// ```text
    /// R = (r − m b) / (1 − m m′)        r: the plane, b: the other at the same place, m, m′: their crosstalk
    /// ```
    ///
    /// On a mosaic b lies between the other plane's pixels and is interpolated. It is only a correction of some
    /// percent: what is measured stays on its own lattice. Saturated pixels stay saturated.
    pub(crate) fn unmixed(&self, frame: &Frame, instrument: &Instrument) -> Result<Unmixed, FrameError> {
        let pedestal = PEDESTAL.min(u16::MAX - frame.code_max());
        let mut unmixed = Unmixed { pages: frame.pages().to_vec(), code_max: frame.code_max() + pedestal, pedestal };
        let [telecentric, entocentric] = [Role::Telecentric, Role::Entocentric];
        for (own, other, share) in
            [(telecentric, entocentric, self.in_telecentric), (entocentric, telecentric, self.in_entocentric)]
        {
            let site = |role: Role| instrument.sensor.mosaic.site(&instrument.band(role).plane);
            let plane = |role: Role| frame.plane(instrument.sensor.mosaic, &instrument.band(role).plane);
            let (plane, other) = (plane(own)?, plane(other)?);
            let page = site(own).map_or(0, |site| site.page);
            let mixing = Mixing { share, scale: 1.0 / self.determinant(), black: instrument.sensor.black_level.into() };
            unmixed.replace(page, frame.width_px(), &plane, &other, mixing);
        }
        Ok(unmixed)
    }
}

/// How one plane is unmixed.
#[derive(Debug, Clone, Copy)]
struct Mixing {
    /// The other band's light in the plane.
    share: f64,
    /// One over the determinant.
    scale: f64,
    /// Code of a pixel without light.
    black: f64,
}

/// Pages without crosstalk.
#[derive(Debug, Clone)]
pub(crate) struct Unmixed {
    pages: Vec<Vec<u16>>,
    code_max: u16,
    /// Codes added to every pixel.
    pub(crate) pedestal: u16,
}

impl Unmixed {
    /// The frame of the pages, of the size that the mixed frame had.
    pub(crate) fn into_frame(self, mixed: &Frame) -> Result<Frame, FrameError> {
        Frame::new(mixed.width_px(), mixed.height_px(), self.code_max, self.pages)
    }

    fn replace(&mut self, page: usize, width_px: usize, plane: &PlaneView<'_>, other: &PlaneView<'_>, mixing: Mixing) {
        for row in 0..plane.rows {
            let between = Between::rows(other, plane.frame_v_px(row as f64));
            let start = (plane.origin_px[1] + row * plane.step_px) * width_px + plane.origin_px[0];
            for (column, code) in plane.row(row).enumerate() {
                let beside = between.at(other, plane.frame_u_px(column as f64)) - mixing.black;
                let own = (f64::from(code) - mixing.black - mixing.share * beside) * mixing.scale;
                let shifted = (own + mixing.black + f64::from(self.pedestal)).round();
                let limit = f64::from(self.code_max - 1);
                self.pages[page][start + column * plane.step_px] =
                    if code == plane.code_max { self.code_max } else { shifted.clamp(0.0, limit) as u16 };
            }
        }
    }
}

/// Two rows of a plane and how far between them.
struct Between {
    rows: [usize; 2],
    fraction: f64,
}

impl Between {
    fn rows(plane: &PlaneView<'_>, v_px: f64) -> Self {
        let (rows, fraction) = neighbours(v_px, plane.origin_px[1], plane.step_px, plane.rows);
        Self { rows, fraction }
    }

    /// Code at a column of the frame, bilinear.
    fn at(&self, plane: &PlaneView<'_>, u_px: f64) -> f64 {
        let (columns, fraction) = neighbours(u_px, plane.origin_px[0], plane.step_px, plane.columns);
        let along = |row: usize| {
            let [a, b] = columns.map(|column| f64::from(plane.code(column, row)));
            a + fraction * (b - a)
        };
        let [upper, lower] = self.rows.map(along);
        upper + self.fraction * (lower - upper)
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
    use twinpupil_instrument::{Mosaic, paper};

    #[test]
    fn mixed_slopes_are_unmixed_to_a_code() {
        let (red, blue) =
            (|u: usize, v: usize| (1000 + 3 * u + v) as f64, |u: usize, v: usize| (2000 - 2 * u + v) as f64);
        let crosstalk = Crosstalk { in_telecentric: 0.06, in_entocentric: 0.11 };
        let code = |index: usize| {
            let (u, v) = (index % 80, index / 80);
            let mixed = match (u % 2, v % 2) {
                (0, 0) => red(u, v) + crosstalk.in_telecentric * blue(u, v),
                (1, 1) => blue(u, v) + crosstalk.in_entocentric * red(u, v),
                _ => 0.0,
            };
            mixed.round() as u16
        };
        let frame = Frame::new(80, 60, 4095, vec![(0..80 * 60).map(code).collect()]).expect("a frame");
        let unmixed = crosstalk.unmixed(&frame, &paper::instrument()).expect("a frame");
        let unmixed = unmixed.into_frame(&frame).expect("a frame");
        for (plane, true_code) in [("r", &red as &dyn Fn(usize, usize) -> f64), ("b", &blue)] {
            let view = unmixed.plane(Mosaic::Rggb, plane).expect("a Bayer frame");
            for (row, column) in (1..29).flat_map(|row| (1..39).map(move |column| (row, column))) {
                let found = f64::from(view.code(column, row)) - f64::from(PEDESTAL);
                let (u, v) = (view.frame_u_px(column as f64) as usize, view.frame_v_px(row as f64) as usize);
                assert!((found - true_code(u, v)).abs() <= 1.2, "{plane} {u} {v}: {found}");
            }
        }
    }

    #[test]
    fn an_ideal_response_has_no_crosstalk() {
        let instrument = paper::instrument();
        assert_eq!(Crosstalk::of(&instrument, &ResponseMatrix::ideal(&instrument.bands)), None);
    }
}
