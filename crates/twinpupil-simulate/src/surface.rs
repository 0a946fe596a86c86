//! The sensor's surface in space, and where the rays of its pixels cross the ideal image plane.

use twinpupil_instrument::{Band, ImagePoint, PixelPoint, Projection, Registration, Sensor, Warp};

/// The surface of a sensor as one band's rays leave it: tilted, and behind a lens with distortion.
///
/// A ray starts at its pixel's point in space, upright, and runs through its point of the pupil, straight as light is
/// behind the lens. Where it crosses the plane at L, the distortion is taken off: from there an ideal lens traces it.
#[derive(Debug, Clone)]
pub(crate) struct Surface {
    /// Where the axis meets the sensor, px, and its distance L, mm.
    axis_px: [f64; 2],
    distance_mm: f64,
    /// From a page to the reference frame.
    registration: Registration,
    /// A step of one pixel along rows and along columns, mm.
    along_u_mm: [f64; 3],
    along_v_mm: [f64; 3],
    pupil: Pupil,
    warp: Warp,
    /// Whether every ray starts where it crosses the ideal plane.
    is_ideal: bool,
}

/// The pupil in image space, upright.
#[derive(Debug, Clone)]
enum Pupil {
    /// Behind the lens.
    Behind { distance_mm: f64, centre_mm: [f64; 2], radius_mm: f64 },
    /// In front of the lens, whose image of it lies at 1/`vergence`; lengths there are those over its distance.
    InFront { vergence_per_mm: f64, centre: [f64; 2], radius: f64 },
}

/// Where the rays of a pixel start on the ideal image plane: `centre + per_pupil w` for the pupil point w.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Start {
    pub(crate) centre: ImagePoint,
    /// Rows: x and y, mm.
    pub(crate) per_pupil: [[f64; 2]; 2],
}

impl Surface {
    /// `focal_length_mm` is that of the lens at the band's wavelength.
    pub(crate) fn new(
        sensor: &Sensor,
        band: &Band,
        registration: Registration,
        projection: &Projection,
        focal_length_mm: f64,
    ) -> Self {
        let [along_u_mm, along_v_mm] =
            unit_vectors(sensor.slope()).map(|unit| unit.map(|component| sensor.pitch_mm * component));
        let warp = Warp::of(band);
        Self {
            axis_px: sensor.axis_px,
            distance_mm: sensor.distance_mm,
            registration,
            along_u_mm,
            along_v_mm,
            pupil: Pupil::of(projection, focal_length_mm),
            is_ideal: sensor.tilt_deg == [0.0; 2] && warp.is_none(),
            warp,
        }
    }

    /// Whether every ray starts where it crosses the ideal plane.
    pub(crate) fn is_ideal(&self) -> bool {
        self.is_ideal
    }

    /// Where the rays from a place of the page start on the ideal image plane.
    pub(crate) fn start(&self, pixel: PixelPoint) -> Start {
        let from_mm = self.point_mm(pixel);
        let plane = self.crossing(from_mm, [0.0, 0.0]);
        let (centre, inverse) = self.undistorted(plane);
        if from_mm[2] == self.distance_mm {
            return Start { centre, per_pupil: [[0.0; 2]; 2] };
        }
        // Linear in the pupil point but for the distortion, which hardly bends over so short a way.
        let through = |pupil: [f64; 2]| {
            let crossing = self.crossing(from_mm, pupil);
            let [x, y] = turned(inverse, [crossing[0] - plane[0], crossing[1] - plane[1]]);
            ImagePoint { x_mm: centre.x_mm + x, y_mm: centre.y_mm + y }
        };
        let [left, right, up, down] = [[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]].map(through);
        let half = |a: f64, b: f64| 0.5 * (b - a);
        Start {
            centre,
            per_pupil: [
                [half(left.x_mm, right.x_mm), half(up.x_mm, down.x_mm)],
                [half(left.y_mm, right.y_mm), half(up.y_mm, down.y_mm)],
            ],
        }
    }

    /// A place of the page in space: upright across the axis, and the distance behind the rear principal plane.
    fn point_mm(&self, pixel: PixelPoint) -> [f64; 3] {
        let PixelPoint { u, v } = self.registration.map(pixel);
        let (u, v) = (u - self.axis_px[0], v - self.axis_px[1]);
        let [x, y, z] = [0, 1, 2].map(|k| u * self.along_u_mm[k] + v * self.along_v_mm[k]);
        [x, y, self.distance_mm + z]
    }

    /// Where the line from a point through a point of the pupil crosses the plane at L, upright.
    fn crossing(&self, [x, y, t_mm]: [f64; 3], [a, b]: [f64; 2]) -> [f64; 2] {
        // Upright, the pupil is turned over.
        let (along_x, along_y, along_t) = match self.pupil {
            Pupil::Behind { distance_mm, centre_mm: [cx, cy], radius_mm } => {
                (-(cx + radius_mm * a) - x, -(cy + radius_mm * b) - y, distance_mm - t_mm)
            }
            // The image of (h, z) lies at −h t/z, which turned over is h t/z.
            Pupil::InFront { vergence_per_mm, centre: [cx, cy], radius } => (
                cx + radius * a - x * vergence_per_mm,
                cy + radius * b - y * vergence_per_mm,
                1.0 - t_mm * vergence_per_mm,
            ),
        };
        let share = (self.distance_mm - t_mm) / along_t;
        [x + share * along_x, y + share * along_y]
    }

    /// The point that the lens images at `plane`, and how it changes with that: every round closes nearly all of the gap that
    /// is left, by a difference of the distortion.
    fn undistorted(&self, plane: [f64; 2]) -> (ImagePoint, [[f64; 2]; 2]) {
        const ROUNDS: usize = 50;
        const RESTING_MM: f64 = 1e-12;
        const STEP_MM: f64 = 1e-4;
        let [mut x, mut y] = plane;
        let mut inverse = [[1.0, 0.0], [0.0, 1.0]];
        if self.warp.is_none() {
            return (ImagePoint { x_mm: x, y_mm: y }, inverse);
        }
        let mut last_mm = f64::INFINITY;
        for _ in 0..ROUNDS {
            let image = self.warp.map([x, y]);
            let gap = [plane[0] - image[0], plane[1] - image[1]];
            let gap_mm = gap[0].abs() + gap[1].abs();
            if gap_mm < RESTING_MM {
                break;
            }
            // As long as they close a gap well the differences stay.
            if gap_mm > 1e-2 * last_mm || last_mm == f64::INFINITY {
                let (by_x, by_y) = (self.warp.map([x + STEP_MM, y]), self.warp.map([x, y + STEP_MM]));
                let [a, c] = [0, 1].map(|k| (by_x[k] - image[k]) / STEP_MM);
                let [b, d] = [0, 1].map(|k| (by_y[k] - image[k]) / STEP_MM);
                let per_area = 1.0 / (a * d - b * c);
                inverse = [[d * per_area, -b * per_area], [-c * per_area, a * per_area]];
            }
            let step = turned(inverse, gap);
            (x, y, last_mm) = (x + step[0], y + step[1], gap_mm);
        }
        (ImagePoint { x_mm: x, y_mm: y }, inverse)
    }
}

/// A vector through a matrix.
fn turned([[a, b], [c, d]]: [[f64; 2]; 2], [x, y]: [f64; 2]) -> [f64; 2] {
    [a * x + b * y, c * x + d * y]
}

impl Start {
    /// How far rays start from the centre at most, mm.
    pub(crate) fn reach_mm(&self) -> f64 {
        // No smaller than the largest singular value.
        self.per_pupil.iter().flatten().map(|entry| entry * entry).sum::<f64>().sqrt()
    }

    /// Where the ray through a pupil point starts, mm.
    #[inline(always)]
    pub(crate) fn at(&self, pupil_x: f64, pupil_y: f64) -> [f64; 2] {
        let [[a, b], [c, d]] = self.per_pupil;
        [self.centre.x_mm + a * pupil_x + b * pupil_y, self.centre.y_mm + c * pupil_x + d * pupil_y]
    }
}

impl Pupil {
    fn of(projection: &Projection, focal_length_mm: f64) -> Self {
        let Projection { pupil_position_mm, pupil_centre_mm, pupil_radius_mm, .. } = *projection;
        if pupil_position_mm >= 0.0 {
            return Self::Behind {
                distance_mm: pupil_position_mm,
                centre_mm: pupil_centre_mm,
                radius_mm: pupil_radius_mm,
            };
        }
        let z_mm = -pupil_position_mm;
        Self::InFront {
            vergence_per_mm: 1.0 / focal_length_mm - 1.0 / z_mm,
            centre: pupil_centre_mm.map(|centre_mm| centre_mm / z_mm),
            radius: pupil_radius_mm / z_mm,
        }
    }
}

/// Unit vectors along the rows and the columns of a sensor whose distance grows with slopes along both, turned about
/// the line of the sensor that stays across the axis: Rodrigues' formula,
///
/// ```text
/// e′ = e cosθ + (k × e) sinθ + k (k·e)(1 − cosθ)        k = (b, −a, 0)/tanθ,  tan²θ = a² + b²
/// ```
fn unit_vectors([a, b]: [f64; 2]) -> [[f64; 3]; 2] {
    let steepest = a.hypot(b);
    if steepest == 0.0 {
        return [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    }
    let (sin, cos) = steepest.atan().sin_cos();
    let [kx, ky] = [b / steepest, -a / steepest];
    let turned = |[x, y]: [f64; 2]| {
        let along = (kx * x + ky * y) * (1.0 - cos);
        [x * cos + kx * along, y * cos + ky * along, (kx * y - ky * x) * sin]
    };
    [turned([1.0, 0.0]), turned([0.0, 1.0])]
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{Correction, Instrument, paper};

    use super::*;

    fn surface(instrument: &Instrument, band: usize) -> Surface {
        let stated = &instrument.bands[band];
        Surface::new(&instrument.sensor, stated, stated.registration, &instrument.projection(stated), 100.0)
    }

    #[test]
    fn the_axes_of_a_tilted_sensor_are_square_and_rise_with_its_slopes() {
        let [u, v] = unit_vectors([0.1, -0.07]);
        let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
        assert!((dot(u, u) - 1.0).abs() < 1e-15 && (dot(v, v) - 1.0).abs() < 1e-15 && dot(u, v).abs() < 1e-15);
        for unit in [u, v] {
            assert!((unit[2] - 0.1 * unit[0] + 0.07 * unit[1]).abs() < 1e-15);
        }
    }

    /// The page's homography and Newton's method against lines in space.
    #[test]
    fn rays_through_the_middle_of_the_pupil_start_where_the_page_says() {
        let mut spec = paper::instrument().into_spec();
        let mut correction = Correction::none(6.0, 4);
        (correction.x_mm[9], correction.y_mm[12]) = (2e-3, -1e-3);
        spec.bands[1].correction = Some(correction);
        spec.sensor.tilt_deg = [1.5, -3.0];
        spec.bands[0].distortion.k1_per_mm2 = 3e-4;
        spec.bands[1].distortion.p1_per_mm = 2e-4;
        spec.apertures[1].centre_mm = [0.3, 0.2];
        for position_mm in [0.0, -30.0, -100.0, -250.0] {
            // The entocentric pupil at the lens, in front of it, and in its front focal plane.
            spec.apertures[0].position_mm = position_mm;
            spec.apertures[0].centre_mm = [-0.2, 0.1];
            let instrument = Instrument::new(spec.clone()).unwrap();
            for band in [0, 1] {
                let (surface, page) = (surface(&instrument, band), instrument.page(&instrument.bands[band]));
                for (u, v) in [(0.0, 0.0), (1900.0, 700.0), (300.0, 1199.0)] {
                    let pixel = PixelPoint { u, v };
                    let (found, expected) = (surface.start(pixel).centre, page.to_image(pixel));
                    let off_mm = (found.x_mm - expected.x_mm).hypot(found.y_mm - expected.y_mm);
                    assert!(off_mm < 1e-10, "{position_mm} {band} {u} {v}: {found:?} {expected:?}");
                }
            }
        }
    }

    #[test]
    fn rays_spread_on_the_plane_as_the_sensor_leaves_it() {
        let mut spec = paper::instrument().into_spec();
        spec.sensor.tilt_deg = [2.0, 0.0];
        let instrument = Instrument::new(spec).unwrap();
        let start = surface(&instrument, 0).start(PixelPoint { u: 959.5 + 500.0, v: 599.5 });
        // 500 px along the slope lie δ = 2.93 sin 2° behind L; a pupil of 0.5 lies 51 + δ before them.
        let behind_mm = 2.93 * 2.0_f64.to_radians().sin();
        let expected_mm = -0.5 * behind_mm / (51.0 + behind_mm);
        assert!((start.per_pupil[0][0] - expected_mm).abs() < 1e-12, "{start:?}");
        assert!((start.per_pupil[1][1] - expected_mm).abs() < 1e-12 && start.per_pupil[0][1].abs() < 1e-15);
        assert!(start.reach_mm() >= expected_mm.abs());
    }
}
