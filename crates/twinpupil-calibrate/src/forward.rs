//! Where a dot of the target is imaged, how large and how blurred, as a function of everything that is sought.

use nalgebra::{Matrix3, SMatrix, SVector, Vector4};
use num_dual::{DualNum, jacobian};
use twinpupil_instrument::{Displacement, LensTerms};

/// What one dot's image in one band depends on.
pub(crate) const SLOTS: usize = 23;

/// The first of them are the band's own, then come the three turns and the three shifts of the target's pose.
pub(crate) const CAMERA_SLOTS: usize = 17;

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
    /// How far the light of this spot lands beside where all else says, on the plane at L, mm.
    ShiftX,
    ShiftY,
}

/// Values of the slots.
pub(crate) type Slots = SVector<f64, SLOTS>;

/// Change of a spot's u, v, radius and blur with the slots.
pub(crate) type Gradient = SMatrix<f64, 4, SLOTS>;

/// What is looked at: a dot of the target, in the pose that turns and shifts start from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View<'a> {
    pub(crate) target_mm: [f64; 2],
    pub(crate) diameter_mm: f64,
    pub(crate) rotation: Matrix3<f64>,
    pub(crate) pitch_mm: f64,
    /// From pixels of the reference frame to those of the band's page, row by row.
    pub(crate) page_from_reference: [[f64; 3]; 3],
    /// What a real lens adds.
    pub(crate) lens: LensTerms,
    /// The correction of the band, if it has one.
    pub(crate) displacement: Option<&'a Displacement>,
}

/// u and v of a spot's centre on the page of its band, its radius and its blur, px, and their exact derivatives.
pub(crate) fn spot(slots: &Slots, view: &View<'_>) -> (Vector4<f64>, Gradient) {
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
pub(crate) fn image<D: DualNum<f64> + Copy>(slots: &SVector<D, SLOTS>, view: &View<'_>) -> SVector<D, 4> {
    let at = |slot: Slot| slots[slot as usize];
    let (l, f, d) = (at(Slot::SensorDistance), at(Slot::FocalLength), at(Slot::PupilPosition));
    let tau = [at(Slot::TiltU), at(Slot::TiltV)];
    let pupil = [at(Slot::PupilX), at(Slot::PupilY)];
    let placed = Placed::of(slots, view);
    let cone = Cone::of(slots, view, &placed);
    let (m, s) = (cone.magnification(l), cone.shift(l));
    let ideal = cone.ideal(slots, &placed);
    let (lens, own) = (distorted(ideal, slots, view.lens.cubic_per_mm2), displaced(ideal, slots, view));
    let [px, py] = [lens[0] + own[0], lens[1] + own[1]];
    // The chief ray from the lens to the plane at L.
    let share = if d.re() >= 0.0 { -(d / l) + 1.0 } else { -(d * (l.recip() - f.recip())) + 1.0 };
    let slope = |p: D, c: D| (p + (c + d / l * p) / share) / l;
    let e = [slope(px, pupil[0]), slope(py, pupil[1])];
    let h = (tau[0] * px + tau[1] * py) / (-(tau[0] * e[0] + tau[1] * e[1]) + 1.0);
    let local_l = l + h;
    let radius = at(Slot::Diameter) * (0.5 * view.diameter_mm);
    let m_slope = -(cone.b * m / cone.width);
    let s_slope = -((-(l / f) + 1.0 + cone.b * s) / cone.width);
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
    let radius_px = cone.magnification(local_l) * radius / view.pitch_mm;
    let blur_px = -(at(Slot::PupilRadius) * cone.shift(local_l)) / view.pitch_mm;
    SVector::from([u, v, radius_px, blur_px])
}

/// Where an ideal lens would image a dot, mm.
pub(crate) fn ideal_mm(slots: &Slots, view: &View<'_>) -> [f64; 2] {
    let placed = Placed::of(slots, view);
    Cone::of(slots, view, &placed).ideal(slots, &placed)
}

/// The light of a dot through a pupil.
struct Cone<D> {
    /// f, d, z and b.
    f: D,
    d: D,
    z: D,
    b: D,
    /// d + b z.
    width: D,
}

impl<D: DualNum<f64> + Copy> Cone<D> {
    fn of(slots: &SVector<D, SLOTS>, view: &View<'_>, placed: &Placed<D>) -> Self {
        let at = |slot: Slot| slots[slot as usize];
        let (f, d, z) = (at(Slot::FocalLength), at(Slot::PupilPosition), placed.centre[2] + view.lens.farther_mm);
        let b = if d.re() >= 0.0 { -(d / f) + 1.0 } else { D::one() };
        Self { f, d, z, b, width: d + b * z }
    }

    /// m at L.
    fn magnification(&self, l: D) -> D {
        (l * self.b - self.d * (-(l / self.f) + 1.0)) / self.width
    }

    /// s at L.
    fn shift(&self, l: D) -> D {
        -(l + (-(l / self.f) + 1.0) * self.z) / self.width
    }

    /// p, before anything displaces it.
    fn ideal(&self, slots: &SVector<D, SLOTS>, placed: &Placed<D>) -> [D; 2] {
        let l = slots[Slot::SensorDistance as usize];
        let (m, s) = (self.magnification(l), self.shift(l));
        let pupil = [Slot::PupilX, Slot::PupilY].map(|slot| slots[slot as usize]);
        [0, 1].map(|k| m * placed.centre[k] + s * pupil[k])
    }
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
    fn of(slots: &SVector<D, SLOTS>, view: &View<'_>) -> Self {
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

/// How much farther the correction has it, and the slots that stand for one.
fn displaced<D: DualNum<f64> + Copy>(ideal: [D; 2], slots: &SVector<D, SLOTS>, view: &View<'_>) -> [D; 2] {
    let shift = [Slot::ShiftX, Slot::ShiftY].map(|slot| slots[slot as usize]);
    let Some(displacement) = view.displacement else { return shift };
    let at_mm = ideal.map(|coordinate| coordinate.re());
    let (offset, slopes) = (displacement.at(at_mm), displacement.jacobian(at_mm));
    // Its value is none: first derivatives are all that is asked for.
    let beside = [0, 1].map(|k| ideal[k] - at_mm[k]);
    [0, 1].map(|k| shift[k] + beside[0] * slopes[k][0] + beside[1] * slopes[k][1] + offset[k])
}

/// A position on the reference frame, on the page of a band.
fn on_page<D: DualNum<f64> + Copy>([u, v]: [D; 2], rows: &[[f64; 3]; 3]) -> [D; 2] {
    let [x, y, w] = rows.map(|[a, b, c]| u * a + v * b + c);
    [x / w, y / w]
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::Correction;

    use super::*;

    pub(crate) const UNTURNED: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    fn slots() -> Slots {
        let mut slots = Slots::zeros();
        let values = [
            151.0, 98.0, 99.0, 0.5, 0.03, -0.02, 955.0, 602.0, 0.004, -0.006, 2e-5, 1e-7, 1e-5, -2e-5, 1.01, 1e-3,
            -2e-3, 0.0, 0.0, 0.0, 1.5, -0.8, 281.0,
        ];
        slots.as_mut_slice().copy_from_slice(&values);
        slots
    }

    fn view(displacement: &Displacement) -> View<'_> {
        View {
            target_mm: [3.0, -4.5],
            diameter_mm: 0.9,
            rotation: nalgebra::Rotation3::new(nalgebra::Vector3::new(0.3, -0.2, 0.1)).into_inner(),
            pitch_mm: 0.00586,
            page_from_reference: [[1.01, 0.02, 3.0], [-0.02, 1.01, -4.0], [1e-6, -2e-6, 1.0]],
            lens: LensTerms::default(),
            displacement: Some(displacement),
        }
    }

    #[test]
    fn derivatives_are_those_of_small_steps() {
        let mut correction = Correction::none(6.0, 3);
        (correction.x_mm[7], correction.y_mm[4]) = (0.02, -0.03);
        let displacement = correction.displacement();
        let (slots, view) = (slots(), view(&displacement));
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
            displacement: None,
        };
        let (entocentric, _) = spot(&slots, &view);
        slots[Slot::PupilPosition as usize] = 100.0;
        let (telecentric, _) = spot(&slots, &view);
        assert!((entocentric.xyz() - nalgebra::Vector3::new(2.0, 1.0, 0.5) * 151.0 / 280.0 / 0.01).norm() < 1e-9);
        assert!((telecentric.xyz() - nalgebra::Vector3::new(2.0, 1.0, 0.5) * 0.51 / 0.01).norm() < 1e-9);
    }
}
