//! Where a dot of the target is imaged, how large and how blurred, as a function of everything that is sought.

use nalgebra::{Matrix3, SMatrix, SVector, Vector4};
use num_dual::{DualNum, jacobian};
use twinpupil_instrument::LensTerms;

/// What one dot's image in one band depends on.
pub(crate) const SLOTS: usize = 21;

/// The first of them are the band's own, then come the three turns and the three shifts of the target's pose.
pub(crate) const CAMERA_SLOTS: usize = 15;

/// A number of a band's camera, by its place among the slots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Slot {
    /// L, mm.
    SensorDistance,
    FocalLength,
    PupilPosition,
    PupilRadius,
    PupilX,
    PupilY,
    /// Where the axis meets the sensor, px.
    AxisU,
    AxisV,
    /// Growth of the sensor's distance along u and v.
    TiltU,
    TiltV,
    K1,
    K2,
    P1,
    P2,
    /// Diameter of the dots over what the target states.
    Diameter,
}

/// Values of the slots.
pub(crate) type Slots = SVector<f64, SLOTS>;

/// Change of a spot's u, v, radius and blur with the slots.
pub(crate) type Gradient = SMatrix<f64, 4, SLOTS>;

/// What is looked at: a dot of the target, in the pose that turns and shifts start from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    pub(crate) target_mm: [f64; 2],
    pub(crate) diameter_mm: f64,
    pub(crate) rotation: Matrix3<f64>,
    pub(crate) pitch_mm: f64,
    /// From pixels of the reference frame to those of the band's page, row by row.
    pub(crate) page_from_reference: [[f64; 3]; 3],
    /// What a real lens adds.
    pub(crate) lens: LensTerms,
}

/// u and v of a spot's centre on the page of its band, its radius and its blur, px, and their exact derivatives.
pub(crate) fn spot(slots: &Slots, view: &View) -> (Vector4<f64>, Gradient) {
    jacobian(|slots| image(&slots, view), slots)
}

/// The image of a dot.
///
/// With `b = 1 − d/f` (1 for a pupil in front of the lens), `a = 1 − L/f`, a pupil of radius R and centre c at d:
///
/// ```text
/// p = m X + s c,   m = (L b − d a)/(d + b z),   s = −(L + a z)/(d + b z),   blur = −R s
/// ```
///
/// The lens's distortion moves p on the plane at L; a leaning sensor is met by the chief ray, of slope
/// e = (p + lens height)/L, at p + e h with h = τ·p/(1 − τ·e), and there L counts as L + h. The image of a disc of
/// radius ϱ that leans by θ along the unit vector k is an ellipse, centred `m′ ϱ² (k sinθ cosθ + (p′/m) sin²θ)` beside the
/// image of its centre; dashes are changes with z.
pub(crate) fn image<D: DualNum<f64> + Copy>(slots: &SVector<D, SLOTS>, view: &View) -> SVector<D, 4> {
    let at = |slot: Slot| slots[slot as usize];
    let (l, f, d) = (at(Slot::SensorDistance), at(Slot::FocalLength), at(Slot::PupilPosition));
    let tau = [at(Slot::TiltU), at(Slot::TiltV)];
    let pupil = [at(Slot::PupilX), at(Slot::PupilY)];
    let placed = Placed::of(slots, view);
    let [x, y, z] = placed.centre;
    let z = z + view.lens.farther_mm;
    let behind = d.re() >= 0.0;
    let b = if behind { -(d / f) + 1.0 } else { D::one() };
    let cone = d + b * z;
    let magnification = |l: D| (l * b - d * (-(l / f) + 1.0)) / cone;
    let shift = |l: D| -(l + (-(l / f) + 1.0) * z) / cone;
    let (m, s) = (magnification(l), shift(l));
    let [px, py] = distorted([m * x + s * pupil[0], m * y + s * pupil[1]], slots, view.lens.cubic_per_mm2);
    // The chief ray from the lens to the plane at L.
    let share = if behind { -(d / l) + 1.0 } else { -(d * (l.recip() - f.recip())) + 1.0 };
    let slope = |p: D, c: D| (p + (c + d / l * p) / share) / l;
    let e = [slope(px, pupil[0]), slope(py, pupil[1])];
    let h = (tau[0] * px + tau[1] * py) / (-(tau[0] * e[0] + tau[1] * e[1]) + 1.0);
    let local_l = l + h;
    let radius = at(Slot::Diameter) * (0.5 * view.diameter_mm);
    let m_slope = -(b * m / cone);
    let s_slope = -((-(l / f) + 1.0 + b * s) / cone);
    let beside = m_slope * radius * radius;
    let across = [0, 1].map(|k| {
        let drift = m_slope * placed.centre[k] + s_slope * pupil[k];
        let off = beside * (placed.lean[k] + drift / m * placed.sin2);
        [px, py][k] + e[k] * h + off
    });
    // Pixels are counted along the sensor's surface, which is longer the way it leans.
    let longer = (tau[0] * across[0] + tau[1] * across[1]) / ((tau[0] * tau[0] + tau[1] * tau[1] + 1.0).sqrt() + 1.0);
    let centre = [0, 1].map(|k| (across[k] + tau[k] * longer) / view.pitch_mm);
    let [u, v] = on_page([centre[0] + at(Slot::AxisU), centre[1] + at(Slot::AxisV)], &view.page_from_reference);
    let radius_px = magnification(local_l) * radius / view.pitch_mm;
    let blur_px = -(at(Slot::PupilRadius) * shift(local_l)) / view.pitch_mm;
    SVector::from([u, v, radius_px, blur_px])
}

/// A dot in space and the way its surface leans.
struct Placed<D> {
    centre: [D; 3],
    /// Its steepest way, times sinθ cosθ.
    lean: [D; 2],
    /// sin²θ.
    sin2: D,
}

impl<D: DualNum<f64> + Copy> Placed<D> {
    fn of(slots: &SVector<D, SLOTS>, view: &View) -> Self {
        let turn = [0, 1, 2].map(|k| slots[CAMERA_SLOTS + k]);
        let shift = [0, 1, 2].map(|k| slots[CAMERA_SLOTS + 3 + k]);
        let [tx, ty] = view.target_mm;
        let start = view.rotation * nalgebra::Vector3::new(tx, ty, 0.0);
        let arm = turned(turn, start.into());
        let normal = turned(turn, view.rotation.column(2).into_owned().into());
        let slopes = [-(normal[0] / normal[2]), -(normal[1] / normal[2])];
        let square = slopes[0] * slopes[0] + slopes[1] * slopes[1];
        let cos2 = (square + 1.0).recip();
        Self {
            centre: [0, 1, 2].map(|k| arm[k] + shift[k]),
            lean: slopes.map(|slope| slope * cos2),
            sin2: square * cos2,
        }
    }
}

/// A vector turned by a small rotation.
fn turned<D: DualNum<f64> + Copy>(turn: [D; 3], vector: [f64; 3]) -> [D; 3] {
    let [x, y, z] = vector;
    [
        turn[1] * z - turn[2] * y + x, //
        turn[2] * x - turn[0] * z + y,
        turn[0] * y - turn[1] * x + z,
    ]
}

/// Brown's radial and tangential distortion; `of_lens` adds to k₁.
fn distorted<D: DualNum<f64> + Copy>([x, y]: [D; 2], slots: &SVector<D, SLOTS>, of_lens: f64) -> [D; 2] {
    let [k1, k2, p1, p2] = [Slot::K1, Slot::K2, Slot::P1, Slot::P2].map(|slot| slots[slot as usize]);
    let r2 = x * x + y * y;
    let radial = r2 * (k1 + of_lens + k2 * r2) + 1.0;
    [
        x * radial + p1 * x * y * 2.0 + p2 * (r2 + x * x * 2.0), //
        y * radial + p1 * (r2 + y * y * 2.0) + p2 * x * y * 2.0,
    ]
}

/// A position on the reference frame, on the page of a band.
fn on_page<D: DualNum<f64> + Copy>([u, v]: [D; 2], rows: &[[f64; 3]; 3]) -> [D; 2] {
    let [x, y, w] = rows.map(|[a, b, c]| u * a + v * b + c);
    [x / w, y / w]
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) const UNTURNED: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    fn slots() -> Slots {
        let mut slots = Slots::zeros();
        let values = [
            151.0, 98.0, 99.0, 0.5, 0.03, -0.02, 955.0, 602.0, 0.004, -0.006, 2e-5, 1e-7, 1e-5, -2e-5, 1.01, 0.0, 0.0,
            0.0, 1.5, -0.8, 281.0,
        ];
        slots.as_mut_slice().copy_from_slice(&values);
        slots
    }

    fn view() -> View {
        View {
            target_mm: [3.0, -4.5],
            diameter_mm: 0.9,
            rotation: nalgebra::Rotation3::new(nalgebra::Vector3::new(0.3, -0.2, 0.1)).into_inner(),
            pitch_mm: 0.00586,
            page_from_reference: [[1.01, 0.02, 3.0], [-0.02, 1.01, -4.0], [1e-6, -2e-6, 1.0]],
            lens: LensTerms::default(),
        }
    }

    #[test]
    fn derivatives_are_those_of_small_steps() {
        let (slots, view) = (slots(), view());
        let (_, gradient) = spot(&slots, &view);
        for slot in 0..SLOTS {
            let step = 1e-5 * slots[slot].abs().max(1e-3);
            let at = |sign: f64| {
                let mut moved = slots;
                moved[slot] += sign * step;
                image(&moved, &view)
            };
            let slope: Vector4<f64> = (at(1.0) - at(-1.0)) / (2.0 * step);
            let error = (slope - gradient.column(slot)).norm();
            assert!(error < 1e-5 * slope.norm().max(1.0), "{slot}: {slope:?} {:?}", gradient.column(slot));
        }
    }

    #[test]
    fn a_plain_camera_is_the_papers() {
        // [Ohno2018, Eqs. 1, 2].
        let mut slots = Slots::zeros();
        for (slot, value) in [(Slot::SensorDistance, 151.0), (Slot::FocalLength, 100.0), (Slot::Diameter, 1.0)] {
            slots[slot as usize] = value;
        }
        slots[SLOTS - 1] = 280.0;
        let view = View {
            target_mm: [2.0, 1.0],
            diameter_mm: 1.0,
            rotation: Matrix3::identity(),
            pitch_mm: 0.01,
            page_from_reference: UNTURNED,
            lens: LensTerms::default(),
        };
        let (entocentric, _) = spot(&slots, &view);
        slots[Slot::PupilPosition as usize] = 100.0;
        let (telecentric, _) = spot(&slots, &view);
        assert!((entocentric.xyz() - nalgebra::Vector3::new(2.0, 1.0, 0.5) * 151.0 / 280.0 / 0.01).norm() < 1e-9);
        assert!((telecentric.xyz() - nalgebra::Vector3::new(2.0, 1.0, 0.5) * 0.51 / 0.01).norm() < 1e-9);
    }
}
