//! A spot on a page that is turned, tilted or distorted.

use nalgebra::Matrix2 as Square;
use twinpupil_instrument::{ImagePoint, Page};

use crate::likelihood::light::Places;
use crate::likelihood::pencil::{Pencil, Vector2};
use crate::likelihood::spot::{Matrix2, Spot, SpotJacobian, inverse, product, times};

/// How places on a bent page differ from those on one that goes on as it is at a spot: second-order terms in the distance
/// from the spot's centre along u and v, 1/px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bend {
    /// Of u and of v: along u twice, along both, along v twice.
    terms: [[f32; 3]; 2],
    /// Growth of the blur along u and v, px per px: pixels of a tilted sensor stand nearer and farther.
    blur_slope: [f32; 2],
}

impl Bend {
    /// ½ ∂ⱼ∂ₖF, seen from the page through the inverse of the slope J; and the growth of a blur of `pupil_px` times the drift.
    fn of(page: &Page, image: ImagePoint, slope: Matrix2, pupil_px: f64) -> Option<Self> {
        if page.is_affine() {
            return None;
        }
        let [[a, b], [c, d]] = slope;
        let per_area = 1.0 / (a * d - b * c);
        let (along_u, along_v) = ([d * per_area, -c * per_area], [-b * per_area, a * per_area]);
        let [grown_x, grown_y] = page.drift_slope_per_mm(image).map(|per_mm| per_mm * pupil_px);
        let blur_slope = [along_u, along_v].map(|[x, y]| (grown_x * x + grown_y * y) as f32);
        let terms = page.second_derivatives(image).map(|[xx, xy, yy]| {
            let form = |[p, q]: Vector2, [r, s]: Vector2| xx * p * r + xy * (p * s + q * r) + yy * q * s;
            [0.5 * form(along_u, along_u), form(along_u, along_v), 0.5 * form(along_v, along_v)].map(|term| term as f32)
        });
        Some(Self { terms, blur_slope })
    }

    /// Places as far from the centre as they would be if the page went on as it is there.
    fn straighten(&self, places: &Places, straight: &mut Places) {
        straight.clear();
        let [[au, bu, cu], [av, bv, cv]] = self.terms;
        for (du, dv) in places.du.iter().zip(&places.dv) {
            let (uu, uv, vv) = (du * du, du * dv, dv * dv);
            straight.push(du - au * uu - bu * uv - cu * vv, dv - av * uu - bv * uv - cv * vv);
        }
        let Places { edge, lit, square_px, closely, .. } = *places;
        (straight.edge, straight.lit, straight.square_px, straight.closely) = (edge, lit, square_px, closely);
    }

    /// Moves places to where the light would be as strong if the blur were everywhere as it is at the centre: the light t
    /// before or behind an edge is that at `t w/w′`, w and w′ the widths that blur and pixel together have there and here.
    fn even_out(&self, spot: &Spot, places: &mut Places) {
        const NEAREST: f32 = 1e-3;
        let [grown_u, grown_v] = self.blur_slope;
        if [grown_u, grown_v] == [0.0; 2] {
            return;
        }
        let [[xx, xy], [yx, yy]] = spot.inverse.map(|row| row.map(|value| (value / spot.radius_px) as f32));
        let blur_px = spot.blur_px as f32;
        // Variances of a disc and of a square, times twelve.
        let square2 = places.square_px * places.square_px;
        let width2 = |blur_px: f32| 3.0 * blur_px * blur_px + square2;
        let even2 = width2(blur_px);
        let edge = places.edge;
        for (du, dv) in places.du[..edge].iter_mut().zip(&mut places.dv[..edge]) {
            let narrower = (even2 / width2(blur_px + grown_u * *du + grown_v * *dv)).sqrt();
            let radii = (xx * *du + xy * *dv).hypot(yx * *du + yy * *dv);
            let moved = narrower + (1.0 - narrower) / radii.max(NEAREST);
            (*du, *dv) = (moved * *du, moved * *dv);
        }
    }
}

impl Spot {
    /// Lays a spot on `page` that was made for pixels across the axis; `jacobian` are its changes.
    ///
    /// The page is taken as linear about the spot, by its slope J, once places have been straightened. The outline goes
    /// through J; the blur, and with it the coordinates of the pupil, through the similarity that is nearest
    /// to J, so blur stays round where the page is stretched one way: what that does is even about the centre and moves
    /// nothing.
    ///
    /// A tilted sensor meets the ray through the pupil point w at `p + κ w` on the plane at L, which adds κ to the blur
    /// and shifts the masks' edges: a circle about `s + m (p + κ w)` is one about `(s + m p)/(1 − m κ)`.
    pub(crate) fn lay_on(&mut self, page: &Page, pencil: &Pencil, jacobian: &mut SpotJacobian) {
        let pitch_mm = self.pitch_mm;
        let [x_mm, y_mm] = self.image_mm(self.centre_px);
        let image = ImagePoint { x_mm, y_mm };
        let slope = page.px_per_mm(image);
        let (px_per_mm, turn) = similarity(slope);
        // From pixels across the axis to those of the page.
        let scale = px_per_mm * pitch_mm;
        let drift_mm = page.drift(image) * pencil.projection.pupil_radius_mm;
        let centre = page.to_page(image);
        self.centre_px = [centre.u, centre.v];
        self.bend = Bend::of(page, image, slope, pencil.projection.pupil_radius_mm * px_per_mm);
        self.radius_px *= scale;
        self.blur_px = (self.blur_px + drift_mm / pitch_mm) * scale;
        self.blur_growth_px *= scale;
        if let Some(smear) = &mut self.smear {
            smear.outwards = times(turn, smear.outwards);
            smear.stretch_px = smear.stretch_px.map(|px| px * scale);
            smear.blur_px = smear.blur_px.map(|px| px * scale);
            smear.coma_px = smear.coma_px.map(|coma_px| coma_px.map(|px| px * scale));
            smear.spherical_px *= scale;
            smear.light_px *= scale;
            smear.left_px *= scale;
        }
        self.shape = product(slope.map(|row| row.map(|entry| entry / px_per_mm)), self.shape);
        self.inverse = inverse(self.shape);
        self.pitch_mm = 1.0 / px_per_mm;
        let seen_mm = times(turn, [x_mm, y_mm]);
        self.axis_px = [0, 1].map(|axis| self.centre_px[axis] - seen_mm[axis] * px_per_mm);
        let reach_mm = self.reach_px() * self.pitch_mm + drift_mm.abs();
        self.ways = pencil.ways_at([x_mm, y_mm], reach_mm);
        for edge in self.ways.iter_mut().flatten() {
            let stretch = 1.0 / (1.0 - edge.per_image * drift_mm);
            edge.start = times(turn, edge.start).map(|coordinate| coordinate * stretch);
            edge.per_image *= stretch;
            edge.radius *= stretch.abs();
        }
        let turned = Square::new(slope[0][0], slope[0][1], slope[1][0], slope[1][1]) * pitch_mm;
        let moved = turned * jacobian.fixed_rows::<2>(0);
        jacobian.fixed_rows_mut::<2>(0).copy_from(&moved);
        jacobian.fixed_rows_mut::<2>(2).scale_mut(scale);
    }

    /// Places about the spot as the kernels want them: on a page that does not bend, seen by an even blur.
    pub(crate) fn straightened<'p>(&self, places: &'p Places, straight: &'p mut Places) -> &'p Places {
        match &self.bend {
            Some(bend) => {
                bend.straighten(places, straight);
                bend.even_out(self, straight);
            }
            None if self.smear.is_none() => return places,
            None => straight.clone_from(places),
        }
        if let Some(smear) = &self.smear {
            smear.even_out(self, straight);
        }
        straight
    }
}

/// The scale and the turn, mirrored if need be, that are nearest to a matrix.
fn similarity([[a, b], [c, d]]: Matrix2) -> (f64, Matrix2) {
    let determinant = a * d - b * c;
    let sign = determinant.signum();
    let (cos, sin) = (a + sign * d, c - sign * b);
    let length = cos.hypot(sin);
    let (cos, sin) = (cos / length, sin / length);
    (determinant.abs().sqrt(), [[cos, -sign * sin], [sin, sign * cos]])
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{Instrument, Mosaic, Registration, paper};

    use super::*;
    use crate::likelihood::spot::{Dot, Raster};

    #[test]
    fn a_similarity_is_its_own_nearest() {
        let (sin, cos) = 0.7_f64.sin_cos();
        for sign in [1.0, -1.0] {
            let turn = [[cos, -sign * sin], [sin, sign * cos]];
            let (scale, found) = similarity(turn.map(|row| row.map(|entry| 3.0 * entry)));
            assert!((scale - 3.0).abs() < 1e-12);
            assert!(found.iter().flatten().zip(turn.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-12));
        }
    }

    /// A camera whose first band's page is mirrored, turned and tilted behind a lens with distortion.
    fn askew() -> Instrument {
        let mut spec = paper::instrument().into_spec();
        spec.sensor.mosaic = Mosaic::Sensors;
        spec.sensor.tilt_deg = [0.6, -0.4];
        for (band, plane) in spec.bands.iter_mut().zip(["0", "1"]) {
            band.plane = plane.to_owned();
        }
        let (sin, cos) = 20.0_f64.to_radians().sin_cos();
        spec.bands[0].registration =
            Registration::from_rows([[-1.02 * cos, sin, 1700.0], [1.02 * sin, cos, -300.0], [0.0, 0.0, 1.0]]);
        spec.bands[0].distortion.k1_per_mm2 = 1e-4;
        Instrument::new(spec).unwrap()
    }

    #[test]
    fn the_jacobian_is_the_change_of_the_spot() {
        const STEP_MM: f64 = 1e-3;
        let instrument = askew();
        let pencil = Pencil::of_band(&instrument, &instrument.bands[0], 100.0);
        let page = instrument.page(&instrument.bands[0]);
        let raster = Raster { axis_px: instrument.sensor.axis_px, pitch_mm: instrument.sensor.pitch_mm };
        let laid = |unknowns: [f64; 4]| {
            let [x_mm, y_mm, z_mm, diameter_mm] = unknowns;
            let dot = Dot { centre_mm: [x_mm, y_mm, z_mm], diameter_mm, slopes: [0.3, -0.2] };
            let (mut spot, mut jacobian) = Spot::with_jacobian(&dot, &pencil, raster, None);
            spot.lay_on(&page, &pencil, &mut jacobian);
            (spot, jacobian)
        };
        let at = [4.0, -2.0, 270.0, 1.0];
        let (_, jacobian) = laid(at);
        for column in 0..4 {
            let [a, b] = [-1.0, 1.0].map(|sign| {
                let mut beside = at;
                beside[column] += sign * STEP_MM;
                let spot = laid(beside).0;
                [spot.centre_px[0], spot.centre_px[1], spot.radius_px, spot.blur_px]
            });
            for row in 0..4 {
                let slope = (b[row] - a[row]) / (2.0 * STEP_MM);
                // What grows with the place on the page counts as fixed: hundredths of a pixel per mm.
                assert!((slope - jacobian[(row, column)]).abs() < 0.3, "{row} {column}: {slope} {jacobian}");
            }
        }
    }

    /// A ray from a place of the page through a mask's edge in space, against the edges in the coordinates of the pupil.
    #[test]
    fn masks_are_turned_with_the_page() {
        let instrument = askew();
        let pencil = Pencil::of_band(&instrument, &instrument.bands[0], 100.0);
        let page = instrument.page(&instrument.bands[0]);
        let raster = Raster { axis_px: instrument.sensor.axis_px, pitch_mm: instrument.sensor.pitch_mm };
        // Red: the blue disc of radius 1 on the lens cuts its pupil of 0.5 at 100 behind it.
        let dot = Dot { centre_mm: [2.0, 1.2, 260.0], diameter_mm: 0.5, slopes: [0.0; 2] };
        let (mut spot, mut jacobian) = Spot::with_jacobian(&dot, &pencil, raster, None);
        spot.lay_on(&page, &pencil, &mut jacobian);
        let edge = spot.ways[0][0];
        let seen_mm = spot.image_mm(spot.centre_px);
        let circle = [0, 1].map(|axis| edge.start[axis] + edge.per_image * seen_mm[axis]);
        let [u, v] = spot.centre_px;
        let image = page.to_image(twinpupil_instrument::PixelPoint { u, v });
        let turn = similarity(page.px_per_mm(image)).1;
        for angle in [0.0, 1.0, 2.5, 4.0_f64] {
            // A pupil point on the circle, back in the axes of space.
            let (sin, cos) = angle.sin_cos();
            let w = [circle[0] + edge.radius * cos, circle[1] + edge.radius * sin];
            let w = [turn[0][0] * w[0] + turn[1][0] * w[1], turn[0][1] * w[0] + turn[1][1] * w[1]];
            // Where its ray crosses the plane at L, physical and so turned over, and then the lens.
            let drift_mm = 0.5 * page.drift(image);
            let sensor = [-(image.x_mm + drift_mm * w[0]), -(image.y_mm + drift_mm * w[1])];
            let lens = [0, 1].map(|k| sensor[k] + (0.5 * w[k] - sensor[k]) * 151.0 / 51.0);
            assert!((lens[0].hypot(lens[1]) - 1.0).abs() < 1e-4, "{lens:?}");
        }
    }
}
