//! Where the image of a band lies on its page: from the ideal image plane through the lens's distortion, onto a tilted
//! sensor and through the registration to pixels.

use crate::check::ValueError;
use crate::homography::Homography;
use crate::{Band, Distortion, ImagePoint, PixelPoint, Projection, Sensor, Warp};

/// One smooth map between the ideal image plane of a band, across the axis at `sensor.distance_mm`, and the pixels of
/// the band's page.
///
/// ```text
/// ideal image point ─ distortion, correction ─► plane at L ─ chief rays ─► tilted sensor ─ axis_px, pitch_mm ─► reference frame
///                                                                           ─ registration⁻¹ ─► page
/// ```
///
/// The sensor stands at the distance `L + τ·p` behind the rear principal plane, τ the tangents of its tilts and p the
/// upright position across the axis; its pixels are squares on its surface. A ray that crosses the plane at L in p₀
/// and the pupil, of which the centre is c, meets the sensor in p, with `δ = τ·p`:
///
/// ```text
/// p₀ = (p − A δ c)/(1 + B δ)        A = 1/α L,  B = (1 + d/α L)/L,  α = 1 − d/L, or 1 − d (1/L − 1/f) for d < 0
/// ```
///
/// which is a homography. Light out of focus is met by the sensor nearer or farther along its rays: [`Page::drift`].
#[derive(Debug, Clone, PartialEq)]
pub struct Page {
    /// Distortion and correction.
    warp: Warp,
    is_distorted: bool,
    /// Distance from the axis up to which the distortion is what its coefficients say, mm: that of the farthest pixel.
    /// Beyond it the map goes on in a straight line, since a polynomial may turn back.
    reach_mm: f64,
    tilt: Tilt,
    px_from_plane: Homography,
    plane_from_px: Homography,
    sensor_distance_mm: f64,
}

/// How the sensor stands to the plane across the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Tilt {
    /// τ.
    slope: [f64; 2],
    /// A, 1/mm, and A c.
    per_pupil: f64,
    sideways: [f64; 2],
    /// B, 1/mm.
    approach: f64,
}

/// Rows of a 2×2 matrix.
type Matrix2 = [[f64; 2]; 2];

impl Page {
    /// The page of `band` of a camera with this sensor, whose chief rays are those of `projection`.
    pub fn new(sensor: &Sensor, band: &Band, projection: &Projection) -> Self {
        let tilt = Tilt::of(sensor, projection);
        let plane_from_px = tilt.plane_from_sensor().after(&sensor_from_px(sensor, band));
        let warp = Warp::of(band);
        let mut page = Self {
            is_distorted: !warp.is_none(),
            warp,
            reach_mm: f64::INFINITY,
            tilt,
            px_from_plane: plane_from_px.inverse(),
            plane_from_px,
            sensor_distance_mm: projection.sensor_distance_mm,
        };
        if page.is_distorted {
            let radii_mm = rim(sensor).map(|pixel| page.to_image(pixel).radius_mm());
            page.reach_mm = radii_mm.fold(0.0, f64::max);
        }
        page
    }

    /// Where an ideal image point is on the page.
    #[inline]
    pub fn to_page(&self, image: ImagePoint) -> PixelPoint {
        let [u, v] = self.px_from_plane.map(self.distorted([image.x_mm, image.y_mm]));
        PixelPoint { u, v }
    }

    /// The ideal image point that is seen at a place of the page.
    #[inline]
    pub fn to_image(&self, pixel: PixelPoint) -> ImagePoint {
        let [x_mm, y_mm] = self.undistorted(self.plane_from_px.map([pixel.u, pixel.v]));
        ImagePoint { x_mm, y_mm }
    }

    /// How the place on the page changes with the ideal image point, row by row, px/mm.
    #[inline]
    pub fn px_per_mm(&self, image: ImagePoint) -> Matrix2 {
        let ideal = [image.x_mm, image.y_mm];
        if !self.is_distorted {
            return self.px_from_plane.jacobian(ideal);
        }
        product(self.px_from_plane.jacobian(self.distorted(ideal)), self.warp.jacobian(self.within_reach(ideal)))
    }

    /// How the ideal image point changes with the place on the page, row by row, mm/px.
    #[inline]
    pub fn mm_per_px(&self, pixel: PixelPoint) -> Matrix2 {
        inverse(self.px_per_mm(self.to_image(pixel)))
    }

    /// Distance of the sensor from the rear principal plane where the chief ray of an image point meets it, mm.
    #[inline]
    pub fn distance_mm(&self, image: ImagePoint) -> f64 {
        self.sensor_distance_mm + self.tilt.growth_mm(self.distorted([image.x_mm, image.y_mm]))
    }

    /// How far a ray from where an image point is seen crosses the plane at L beside the chief ray, over how far it
    /// crosses the pupil beside the centre: light out of focus is met by a tilted sensor nearer or farther along its rays.
    ///
    /// ```text
    /// ∂p₀/∂c = −A δ/(1 + B δ)/c
    /// ```
    #[inline]
    pub fn drift(&self, image: ImagePoint) -> f64 {
        let growth_mm = self.tilt.growth_mm(self.distorted([image.x_mm, image.y_mm]));
        -self.tilt.per_pupil * growth_mm / (1.0 + self.tilt.approach * growth_mm)
    }

    /// Change of [`Self::drift`] with x and y of the image point, 1/mm.
    ///
    /// ```text
    /// −A/(1 + B δ)² ∇δ/c
    /// ```
    pub fn drift_slope_per_mm(&self, image: ImagePoint) -> [f64; 2] {
        let ideal = [image.x_mm, image.y_mm];
        let plane = self.distorted(ideal);
        let slope = -self.tilt.per_pupil / (1.0 + self.tilt.approach * self.tilt.growth_mm(plane)).powi(2);
        let [x, y] = self.tilt.growth_slope(plane).map(|growth| slope * growth);
        if !self.is_distorted {
            return [x, y];
        }
        let [[a, b], [c, d]] = self.warp.jacobian(self.within_reach(ideal));
        [x * a + y * c, x * b + y * d]
    }

    /// How far the middle of an area's image lies beside the image of its middle, px, since the map bends: for an area
    /// of even light or its outline alike.
    ///
    /// `spread_mm2` is Q = 4 S, S the area's second moments (xx, xy, yy) over its content; of a disc, the square of its
    /// radius. To second order, with the map F and its Jacobian J,
    ///
    /// ```text
    /// ⅛ (Σⱼₖ Qⱼₖ ∂ⱼ∂ₖ F + 2 J Q ∇ ln |det J|)
    /// ```
    ///
    /// half of the second derivatives times S, and as much more of it where the map magnifies more.
    #[inline]
    pub fn bend_px(&self, image: ImagePoint, spread_mm2: [f64; 3]) -> [f64; 2] {
        if self.is_affine() {
            return [0.0; 2];
        }
        let [xx, xy, yy] = spread_mm2;
        let slope = self.px_per_mm(image);
        let growth = self.growth_per_mm(image);
        let along = [xx * growth[0] + xy * growth[1], xy * growth[0] + yy * growth[1]];
        let second = self.second_derivatives(image);
        [0, 1].map(|k| {
            let [a, b, c] = second[k];
            0.125 * (xx * a + 2.0 * xy * b + yy * c + 2.0 * (slope[k][0] * along[0] + slope[k][1] * along[1]))
        })
    }

    /// Where the axis is on the page, and its mean width of a pixel, mm, if the map is an upright raster across the axis
    /// and nothing else.
    pub fn raster(&self) -> Option<(PixelPoint, f64)> {
        let [[a, b, u], [c, d, v], last] = self.px_from_plane.rows;
        let upright = a == d && a > 0.0 && [b, c] == [0.0; 2] && last == [0.0, 0.0, 1.0];
        let plain = upright && !self.is_distorted && self.tilt.slope == [0.0; 2];
        plain.then_some((PixelPoint { u, v }, 1.0 / a))
    }

    /// Whether equal steps on the image plane are equal steps on the page.
    pub fn is_affine(&self) -> bool {
        let [g, h, _] = self.px_from_plane.rows[2];
        !self.is_distorted && [g, h] == [0.0; 2]
    }

    /// Change of ln |det J| with x and y, 1/mm.
    fn growth_per_mm(&self, image: ImagePoint) -> [f64; 2] {
        let ideal = [image.x_mm, image.y_mm];
        let plane = self.distorted(ideal);
        let ([g, h, _], weight) = (self.px_from_plane.rows[2], self.px_from_plane.weight(plane));
        let projected = [-3.0 * g / weight, -3.0 * h / weight];
        if !self.is_distorted {
            return projected;
        }
        let slope = self.warp.jacobian(self.within_reach(ideal));
        let ([[a, b], [c, d]], [[xxx, xxy, xyy], [yxx, yxy, yyy]]) = (slope, self.distortion_bend(ideal));
        let per_area = 1.0 / determinant(slope);
        let lens =
            [(xxx * d + a * yxy - xxy * c - b * yxx) * per_area, (xxy * d + a * yyy - xyy * c - b * yxy) * per_area];
        [0, 1].map(|j| lens[j] + projected[0] * slope[0][j] + projected[1] * slope[1][j])
    }

    /// Second derivatives of the place on the page by the ideal image point: by x twice, by x and y, by y twice, px/mm².
    pub fn second_derivatives(&self, image: ImagePoint) -> [[f64; 3]; 2] {
        let ideal = [image.x_mm, image.y_mm];
        let plane = self.distorted(ideal);
        let projected = self.px_from_plane.second_derivatives(plane);
        if !self.is_distorted {
            return projected;
        }
        let [[a, b], [c, d]] = self.warp.jacobian(self.within_reach(ideal));
        let (outer, lens) = (self.px_from_plane.jacobian(plane), self.distortion_bend(ideal));
        [0, 1].map(|k| {
            let [xx, xy, yy] = projected[k];
            let through = |[p, q]: [f64; 2], [r, s]: [f64; 2]| xx * p * r + xy * (p * s + q * r) + yy * q * s;
            let bent = |j: usize| outer[k][0] * lens[0][j] + outer[k][1] * lens[1][j];
            let (x, y) = ([a, c], [b, d]);
            [through(x, x) + bent(0), through(x, y) + bent(1), through(y, y) + bent(2)]
        })
    }

    /// Second derivatives of the distortion; none beyond its reach.
    fn distortion_bend(&self, ideal: [f64; 2]) -> [[f64; 3]; 2] {
        if self.within_reach(ideal) == ideal { self.warp.second_derivatives(ideal) } else { [[0.0; 3]; 2] }
    }

    /// The nearest point towards the axis up to which the distortion is known.
    #[inline]
    fn within_reach(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let square = x * x + y * y;
        if square <= self.reach_mm * self.reach_mm {
            return [x, y];
        }
        let share = self.reach_mm / square.sqrt();
        [share * x, share * y]
    }

    /// On the plane at L.
    #[inline]
    fn distorted(&self, ideal: [f64; 2]) -> [f64; 2] {
        if !self.is_distorted {
            return ideal;
        }
        let known = self.within_reach(ideal);
        let [x, y] = self.warp.map(known);
        if known == ideal {
            return [x, y];
        }
        let [[a, b], [c, d]] = self.warp.jacobian(known);
        let beyond = [ideal[0] - known[0], ideal[1] - known[1]];
        [x + a * beyond[0] + b * beyond[1], y + c * beyond[0] + d * beyond[1]]
    }

    /// The ideal image point of one on the plane at L, by Newton's method.
    #[inline]
    fn undistorted(&self, plane: [f64; 2]) -> [f64; 2] {
        const ROUNDS: usize = 30;
        // Far below the noise of any measurement, far above rounding.
        const RESTING_MM: f64 = 1e-12;
        if !self.is_distorted {
            return plane;
        }
        let mut ideal = plane;
        for _ in 0..ROUNDS {
            let image = self.distorted(ideal);
            let [[a, b], [c, d]] = inverse(self.warp.jacobian(self.within_reach(ideal)));
            let off = [plane[0] - image[0], plane[1] - image[1]];
            let step = [a * off[0] + b * off[1], c * off[0] + d * off[1]];
            ideal = [ideal[0] + step[0], ideal[1] + step[1]];
            if step[0].abs() + step[1].abs() < RESTING_MM {
                break;
            }
        }
        ideal
    }

    /// Refuses maps that are not one-to-one all over the sensor, of the band at `index` of the file.
    ///
    /// The chief rays must meet the sensor from its front, and along straight lines from the axis to its rim no
    /// distorted image may turn back: there the Jacobian of the distortion stays positive.
    pub(crate) fn check(&self, sensor: &Sensor, band: &Band, index: usize) -> Result<(), ValueError> {
        const STEPS: usize = 16;
        const DETERMINANT_MIN: f64 = 0.05;
        const TOLERANCE_MM: f64 = 1e-9;
        let meets = |pixel: PixelPoint| {
            let plane = self.plane_from_px.map([pixel.u, pixel.v]);
            1.0 + self.tilt.approach * self.tilt.growth_mm(plane) > 0.0
        };
        if !rim(sensor).all(meets) {
            let legal = "tilts at which all of the sensor lies behind the pupils";
            return Err(ValueError::new("sensor.tilt_deg", format!("{:?}", sensor.tilt_deg), legal));
        }
        let folds = |pixel: PixelPoint| {
            let [x, y] = self.plane_from_px.map([pixel.u, pixel.v]);
            (1..=STEPS).any(|step| {
                let share = step as f64 / STEPS as f64;
                let plane = [share * x, share * y];
                let ideal = self.undistorted(plane);
                let image = self.warp.map(ideal);
                let off_mm = (image[0] - plane[0]).hypot(image[1] - plane[1]);
                // Also true for NaN.
                !(determinant(self.warp.jacobian(ideal)) > DETERMINANT_MIN && off_mm < TOLERANCE_MM)
            })
        };
        if self.is_distorted && rim(sensor).any(folds) {
            return Err(folding(band, index));
        }
        Ok(())
    }
}

impl Tilt {
    fn of(sensor: &Sensor, projection: &Projection) -> Self {
        let Projection { focal_length_mm: f, sensor_distance_mm: l, pupil_position_mm: d, pupil_centre_mm, .. } =
            *projection;
        let slope = sensor.slope();
        if slope == [0.0; 2] {
            return Self { slope, per_pupil: 0.0, sideways: [0.0; 2], approach: 0.0 };
        }
        let alpha = if d >= 0.0 { 1.0 - d / l } else { 1.0 - d * (1.0 / l - 1.0 / f) };
        Self {
            slope,
            per_pupil: 1.0 / (alpha * l),
            sideways: pupil_centre_mm.map(|centre| centre / (alpha * l)),
            approach: (1.0 + d / (alpha * l)) / l,
        }
    }

    /// From the sensor, across the axis, to the plane at L.
    fn plane_from_sensor(&self) -> Homography {
        let ([x, y], [sx, sy]) = (self.sideways, self.slope);
        let rows =
            [[1.0 - x * sx, -x * sy, 0.0], [-y * sx, 1.0 - y * sy, 0.0], [self.approach * sx, self.approach * sy, 1.0]];
        Homography { rows }
    }

    /// How much farther the sensor is than L where a chief ray meets it that crosses the plane at L in a point.
    #[inline]
    fn growth_mm(&self, plane: [f64; 2]) -> f64 {
        self.rise_mm(plane) / self.share(plane)
    }

    /// Change of that with the point.
    fn growth_slope(&self, plane: [f64; 2]) -> [f64; 2] {
        let (rise_mm, share) = (self.rise_mm(plane), self.share(plane));
        self.slope.map(|slope| slope * (share + rise_mm * self.approach) / (share * share))
    }

    /// τ·p₀, and 1 − τ·e with the slope e of the chief ray.
    #[inline]
    fn rise_mm(&self, [x, y]: [f64; 2]) -> f64 {
        self.slope[0] * x + self.slope[1] * y
    }

    #[inline]
    fn share(&self, plane: [f64; 2]) -> f64 {
        let along = |k: usize| self.sideways[k] + self.approach * plane[k];
        1.0 - self.slope[0] * along(0) - self.slope[1] * along(1)
    }
}

/// From a page to upright positions across the axis on the sensor, mm: the sensor's surface is foreshortened along its
/// steepest slope.
fn sensor_from_px(sensor: &Sensor, band: &Band) -> Homography {
    let ([u, v], [sx, sy]) = (sensor.axis_px, sensor.slope());
    let square = sx * sx + sy * sy;
    let cos = 1.0 / (1.0 + square).sqrt();
    // (1 − cos)/τ², without cancellation.
    let shrinking = cos * cos / (1.0 + cos);
    let pitch_mm = sensor.pitch_mm;
    let (a, b, c) = (1.0 - shrinking * sx * sx, -shrinking * sx * sy, 1.0 - shrinking * sy * sy);
    let (a, b, c) = (pitch_mm * a, pitch_mm * b, pitch_mm * c);
    let reference = Homography { rows: [[a, b, -a * u - b * v], [b, c, -b * u - c * v], [0.0, 0.0, 1.0]] };
    reference.after(&band.registration.homography)
}

/// What is wrong with a band whose image folds.
fn folding(band: &Band, index: usize) -> ValueError {
    let legal = "coefficients at which no two points of the image fall together on the sensor";
    if let Some(correction) = &band.correction {
        let coefficients = || correction.x_mm.iter().chain(&correction.y_mm);
        let largest_mm = coefficients().fold(0.0, |largest: f64, coefficient| largest.max(coefficient.abs()));
        return ValueError::new(format!("band[{index}].correction"), format!("up to {largest_mm} mm a term"), legal);
    }
    let Distortion { k1_per_mm2, k2_per_mm4, p1_per_mm, p2_per_mm } = band.distortion;
    let value = format!("{k1_per_mm2}, {k2_per_mm4}, {p1_per_mm}, {p2_per_mm}");
    ValueError::new(format!("band[{index}].distortion"), value, legal)
}

/// Points all along the outer edge of a page.
fn rim(sensor: &Sensor) -> impl Iterator<Item = PixelPoint> {
    const STEPS: usize = 16;
    let [width, height] = sensor.size_px.map(|size| size as f64);
    (0..STEPS).flat_map(move |step| {
        let share = step as f64 / STEPS as f64;
        [[share, 0.0], [1.0, share], [1.0 - share, 1.0], [0.0, 1.0 - share]]
            .map(|[x, y]| PixelPoint { u: x * width - 0.5, v: y * height - 0.5 })
    })
}

fn product([[a, b], [c, d]]: Matrix2, [[p, q], [r, s]]: Matrix2) -> Matrix2 {
    [[a * p + b * r, a * q + b * s], [c * p + d * r, c * q + d * s]]
}

fn determinant([[a, b], [c, d]]: Matrix2) -> f64 {
    a * d - b * c
}

fn inverse(matrix: Matrix2) -> Matrix2 {
    let ([[a, b], [c, d]], per_area) = (matrix, 1.0 / determinant(matrix));
    [[d * per_area, -b * per_area], [-c * per_area, a * per_area]]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{Correction, Instrument, Registration, paper};

    const DISTORTION: Distortion =
        Distortion { k1_per_mm2: -8e-4, k2_per_mm4: 4e-6, p1_per_mm: 2e-4, p2_per_mm: -3e-4 };

    /// Some tenths of a pixel, in all terms.
    fn correction() -> Correction {
        let mut correction = Correction::none(7.0, 5);
        for (term, (x_mm, y_mm)) in correction.x_mm.iter_mut().zip(&mut correction.y_mm).enumerate() {
            (*x_mm, *y_mm) = (4e-4 * (term as f64 + 1.0).sin(), 4e-4 * (term as f64 + 1.0).cos());
        }
        correction
    }

    /// A camera with everything that can be askew; the pupil of the telecentric band lies off the axis.
    fn askew() -> Instrument {
        let mut spec = paper::instrument().into_spec();
        spec.sensor.mosaic = crate::Mosaic::Sensors;
        spec.sensor.tilt_deg = [0.9, -2.0];
        for (band, plane) in spec.bands.iter_mut().zip(["0", "1"]) {
            (band.plane, band.distortion) = (plane.to_owned(), DISTORTION);
            band.correction = Some(correction());
        }
        // A mirror image, turned and 2 % larger.
        let (sin, cos) = 3.0_f64.to_radians().sin_cos();
        spec.bands[1].registration =
            Registration::from_rows([[-1.02 * cos, sin, 1950.0], [1.02 * sin, cos, -40.0], [1e-6, -2e-6, 1.0]]);
        spec.apertures[1].centre_mm = [0.4, -0.3];
        Instrument::new(spec).expect("legal")
    }

    fn pages(instrument: &Instrument) -> Vec<Page> {
        instrument.bands.iter().map(|band| instrument.page(band)).collect()
    }

    proptest! {
        #[test]
        fn there_and_back_is_the_identity(u in -0.5..1919.5_f64, v in -0.5..1199.5_f64) {
            for page in pages(&askew()) {
                let back = page.to_page(page.to_image(PixelPoint { u, v }));
                prop_assert!((back.u - u).abs() < 1e-9 && (back.v - v).abs() < 1e-9, "{u} {v} {back:?}");
            }
        }

        #[test]
        fn derivatives_are_differences(x_mm in -4.0..4.0_f64, y_mm in -3.0..3.0_f64) {
            const STEP_MM: f64 = 1e-4;
            for page in pages(&askew()) {
                let at = |dx: f64, dy: f64| ImagePoint { x_mm: x_mm + dx, y_mm: y_mm + dy };
                let (slope, second, growth) =
                    (page.px_per_mm(at(0.0, 0.0)), page.second_derivatives(at(0.0, 0.0)), page.growth_per_mm(at(0.0, 0.0)));
                for (j, [dx, dy]) in [[STEP_MM, 0.0], [0.0, STEP_MM]].into_iter().enumerate() {
                    let (a, b) = (page.to_page(at(-dx, -dy)), page.to_page(at(dx, dy)));
                    let moved = [b.u - a.u, b.v - a.v];
                    let [before, after] = [at(-dx, -dy), at(dx, dy)].map(|at| page.px_per_mm(at));
                    let ratio = determinant(after) / determinant(before);
                    prop_assert!((ratio.ln() / (2.0 * STEP_MM) - growth[j]).abs() < 1e-7);
                    let drift = (page.drift(at(dx, dy)) - page.drift(at(-dx, -dy))) / (2.0 * STEP_MM);
                    prop_assert!((drift - page.drift_slope_per_mm(at(0.0, 0.0))[j]).abs() < 1e-8);
                    for k in 0..2 {
                        prop_assert!((moved[k] / (2.0 * STEP_MM) - slope[k][j]).abs() < 1e-5);
                        for i in 0..2 {
                            let bend = (after[k][i] - before[k][i]) / (2.0 * STEP_MM);
                            prop_assert!((bend - second[k][i + j]).abs() < 1e-5);
                        }
                    }
                }
            }
        }

        /// A line through the pupil's centre and a point of the plane at L, followed to the sensor in space.
        #[test]
        fn a_tilted_sensor_is_met_where_the_chief_ray_meets_it(
            x_mm in -4.0..4.0_f64, y_mm in -3.0..3.0_f64, a_deg in -8.0..8.0_f64, b_deg in -8.0..8.0_f64,
        ) {
            let mut spec = paper::instrument().into_spec();
            spec.sensor.tilt_deg = [a_deg, b_deg];
            spec.apertures[1].centre_mm = [0.4, -0.3];
            let instrument = Instrument::new(spec).expect("legal");
            let page = instrument.page(&instrument.bands[0]);
            // Upright: the pupil's centre is turned over with the image.
            let (pupil, plane) = ([-0.4, 0.3, 100.0], [x_mm, y_mm, 151.0]);
            // Unit vectors along the pixels' rows and columns: the axes, turned about the line that the sensor and the
            // plane at L share.
            let slope = [a_deg, b_deg].map(|tilt_deg| tilt_deg.to_radians().tan());
            let steepest = slope[0].hypot(slope[1]).max(1e-12);
            let (sin, cos) = steepest.atan().sin_cos();
            let m = slope.map(|component| component / steepest);
            let along = |e: [f64; 2]| {
                let share = m[0] * e[0] + m[1] * e[1];
                [e[0] - share * (1.0 - cos) * m[0], e[1] - share * (1.0 - cos) * m[1], share * sin]
            };
            let (e_u, e_v) = (along([1.0, 0.0]), along([0.0, 1.0]));
            // The point of the line where its distance from the axis point, less its components along the pixels, is 0.
            let normal = [e_u[1] * e_v[2] - e_u[2] * e_v[1], e_u[2] * e_v[0] - e_u[0] * e_v[2], e_u[0] * e_v[1] - e_u[1] * e_v[0]];
            let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
            let from_axis = |p: [f64; 3]| [p[0], p[1], p[2] - 151.0];
            let direction = [0, 1, 2].map(|k| plane[k] - pupil[k]);
            let share = -dot(from_axis(pupil), normal) / dot(direction, normal);
            let met = [0, 1, 2].map(|k| pupil[k] + share * direction[k]);
            let found = page.to_page(ImagePoint { x_mm, y_mm });
            let expected = [dot(from_axis(met), e_u), dot(from_axis(met), e_v)].map(|along_mm| along_mm / 0.00586);
            prop_assert!((found.u - 959.5 - expected[0]).abs() < 1e-7, "{found:?} {expected:?}");
            prop_assert!((found.v - 599.5 - expected[1]).abs() < 1e-7, "{found:?} {expected:?}");
            let image = ImagePoint { x_mm, y_mm };
            prop_assert!((page.distance_mm(image) - met[2]).abs() < 1e-9);
            // The ray to the same place of the sensor from 0.1 mm beside the pupil's centre.
            let beside = [pupil[0] - 0.1, pupil[1], pupil[2]];
            let crossed_mm = beside[0] + (met[0] - beside[0]) * (151.0 - 100.0) / (met[2] - 100.0);
            prop_assert!((page.drift(image) - (crossed_mm - x_mm) / 0.1).abs() < 1e-9);
        }
    }

    #[test]
    fn a_plain_page_is_the_sensors_own() {
        let instrument = paper::instrument();
        let page = instrument.page(&instrument.bands[0]);
        let image = ImagePoint { x_mm: 2.3, y_mm: -1.1 };
        let (found, expected) = (page.to_page(image), instrument.sensor.pixel_from_image(image));
        assert!((found.u - expected.u).abs() < 1e-10 && (found.v - expected.v).abs() < 1e-10);
        let (axis, pitch_mm) = page.raster().expect("plain");
        assert!((axis.u - 959.5).abs() + (axis.v - 599.5).abs() < 1e-9 && (pitch_mm - 0.00586).abs() < 1e-15);
        assert!(page.bend_px(image, [1.0, 0.0, 1.0]) == [0.0; 2] && page.drift(image) == 0.0);
        assert!(pages(&askew()).iter().all(|page| page.raster().is_none()));
    }

    /// The middle of the image of a disc of even light, by many of its points.
    #[test]
    fn a_discs_image_lies_where_its_area_does() {
        const RADIUS_MM: f64 = 0.3;
        const STEPS: usize = 400;
        for page in pages(&askew()) {
            let centre = ImagePoint { x_mm: 3.1, y_mm: -2.2 };
            let (mut area, mut moment) = (0.0, [0.0; 2]);
            for i in 0..STEPS * STEPS {
                let [x, y] = [i % STEPS, i / STEPS].map(|k| (2.0 * (k as f64 + 0.5) / STEPS as f64 - 1.0) * RADIUS_MM);
                if x.hypot(y) < RADIUS_MM {
                    let image = ImagePoint { x_mm: centre.x_mm + x, y_mm: centre.y_mm + y };
                    let (share, place) = (determinant(page.px_per_mm(image)), page.to_page(image));
                    area += share;
                    moment = [moment[0] + share * place.u, moment[1] + share * place.v];
                }
            }
            let middle = page.to_page(centre);
            let square = RADIUS_MM * RADIUS_MM;
            let [du, dv] = page.bend_px(centre, [square, 0.0, square]);
            let expected = [moment[0] / area - middle.u, moment[1] / area - middle.v];
            assert!((du - expected[0]).hypot(dv - expected[1]) < 2e-3, "{du} {dv} {expected:?}");
            assert!(du.hypot(dv) > 0.02, "{du} {dv}");
        }
    }

    #[test]
    fn a_correction_adds_to_the_distortion() {
        let mut spec = paper::instrument().into_spec();
        spec.bands[0].correction = Some(Correction { radius_mm: 5.0, x_mm: vec![0.0; 6], y_mm: vec![0.0; 6] });
        let before = Instrument::new(spec.clone()).expect("legal");
        assert!(before.page(&before.bands[0]).raster().is_some());
        // (n, m) = (2, 0) is 2 ρ² − 1, ρ² = 0.5.
        spec.bands[0].correction.as_mut().expect("stated").y_mm[4] = 0.01;
        spec.bands[0].correction.as_mut().expect("stated").x_mm[0] = 0.00293;
        let after = Instrument::new(spec).expect("legal");
        let image = ImagePoint { x_mm: 2.5, y_mm: -2.5 };
        let [a, b] = [&before, &after].map(|own| own.page(&own.bands[0]).to_page(image));
        assert!((b.u - a.u - 0.5).abs() < 1e-9 && (b.v - a.v).abs() < 1e-9, "{a:?} {b:?}");
        let [a, b] = [&before, &after].map(|own| own.page(&own.bands[0]).to_page(ImagePoint::default()));
        assert!((b.v - a.v + 0.01 / 0.00586).abs() < 1e-9, "{a:?} {b:?}");
        assert_eq!(Instrument::from_toml(&after.to_toml()).expect("legal"), after);
    }

    #[test]
    fn beyond_the_sensor_the_map_does_not_turn_back() {
        let mut spec = paper::instrument().into_spec();
        spec.bands[0].distortion = Distortion { k1_per_mm2: -2.5e-3, ..Distortion::default() };
        spec.bands[0].correction = Some(correction());
        let instrument = Instrument::new(spec).expect("legal");
        let page = instrument.page(&instrument.bands[0]);
        let mut before_px = 0.0;
        for step in 0..400 {
            let image = ImagePoint { x_mm: 0.08 * f64::from(step), y_mm: 0.01 * f64::from(step) };
            let there = page.to_page(image);
            let radius_px = (there.u - 959.5).hypot(there.v - 599.5);
            assert!(radius_px >= before_px, "{image:?}");
            let back = page.to_image(there);
            assert!((back.x_mm - image.x_mm).hypot(back.y_mm - image.y_mm) < 1e-9, "{image:?} {back:?}");
            before_px = radius_px;
        }
    }

    #[test]
    fn maps_that_fold_are_refused() {
        let refused = |change: &dyn Fn(&mut crate::InstrumentSpec)| {
            let mut spec = paper::instrument().into_spec();
            change(&mut spec);
            Instrument::new(spec).expect_err("must be refused").to_string()
        };
        // r (1 − k r²) is largest at r = 1/√(3 k) = 5.8 mm, and 3.8 mm there; the corner lies 6.6 mm off the axis.
        let message = refused(&|spec| spec.bands[1].distortion.k1_per_mm2 = -1e-2);
        assert!(message.starts_with("`band[1].distortion` is -0.01, 0, 0, 0; legal: coefficients at"), "{message}");
        let message = refused(&|spec| {
            let mut correction = Correction::none(5.0, 4);
            correction.x_mm[10] = 2.0;
            spec.bands[1].correction = Some(correction);
        });
        assert!(message.starts_with("`band[1].correction` is up to 2 mm a term; legal: coefficients at"), "{message}");
        let message = refused(&|spec| spec.bands[0].distortion.p1_per_mm = f64::NAN);
        assert!(message.starts_with("`band[0].distortion.p1_per_mm` is NaN"), "{message}");
        let message = refused(&|spec| spec.sensor.tilt_deg = [0.0, 10.1]);
        assert_eq!(message, "`sensor.tilt_deg[1]` is 10.1; legal: -10 to 10");
        let message = refused(&|spec| {
            spec.sensor.tilt_deg = [10.0, 0.0];
            spec.sensor.pitch_mm = 0.5;
        });
        assert!(message.starts_with("`sensor.tilt_deg` is [10.0, 0.0]; legal: tilts at which"), "{message}");
    }
}
