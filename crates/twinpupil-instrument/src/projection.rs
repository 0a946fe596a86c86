//! First-order projection through a small pupil anywhere behind the lens.

use crate::ImagePoint;

/// Projection of one band through its chief rays: a lens of focal length f, a pupil at distance d behind it, a sensor
/// at distance L.
///
/// A ray from the object point (x, z) that crosses the axis at d reaches the upright image position
///
/// ```text
/// p = x (L − d) / (d + z (1 − d/f))
/// ```
///
/// which is `(L/f − 1) x` for d = f  [Ohno2018, Eq. 1]  and `(L/z) x` for d = 0  [Ohno2018, Eq. 2]. A pupil in front
/// of the lens (d < 0) follows from the same two ratios, the cone at the pupil and the spread at the sensor.
/// Both coordinates share the factor, so the azimuth of the image is that of the object  [Ohno2018, Eqs. 3, 4].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// Focal length f of the band, mm.
    pub focal_length_mm: f64,
    /// Rear principal plane to sensor, L, mm.
    pub sensor_distance_mm: f64,
    /// Rear principal plane to the aperture that is the band's pupil, d, mm; negative in front of the lens.
    pub pupil_position_mm: f64,
    /// Centre of that aperture, mm, in the object's x and y.
    pub pupil_centre_mm: [f64; 2],
    /// Radius of that aperture, mm.
    pub pupil_radius_mm: f64,
}

/// What the chief rays do at one distance, and how it changes there with the distance z: the object point X is imaged at
/// `m X + s c` by a pupil whose centre lies at c.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chief {
    /// Magnification m.
    pub magnification: f64,
    /// dm/dz, 1/mm.
    pub magnification_slope: f64,
    /// How far a pupil off the axis shifts all images, over how far it lies off, s.
    pub shift: f64,
    /// ds/dz, 1/mm.
    pub shift_slope: f64,
}

impl Projection {
    /// Image size over object size at distance z: `r_R / r` or `r_B / r`  [Ohno2018, Eqs. 5, 6].
    #[inline]
    pub fn magnification(&self, z_mm: f64) -> f64 {
        let (l, d) = (self.sensor_distance_mm, self.pupil_position_mm);
        (l - d * self.spread(z_mm) / self.cone(z_mm)) / z_mm
    }

    /// Upright image position of the object point (x, y, z), in mm from the axis.
    #[inline]
    pub fn image(&self, object_mm: [f64; 3]) -> ImagePoint {
        self.image_and_magnification(object_mm).0
    }

    /// [`Self::image`] and the [`Self::magnification`] that goes with it.
    #[inline]
    pub fn image_and_magnification(&self, object_mm: [f64; 3]) -> (ImagePoint, f64) {
        let [x_mm, y_mm, z_mm] = object_mm;
        // A pupil that is off the axis moves the chief ray, and with it every image that is out of focus.
        let shift = -self.spread(z_mm) / self.cone(z_mm);
        let magnification = (self.sensor_distance_mm + self.pupil_position_mm * shift) / z_mm;
        let image = ImagePoint {
            x_mm: magnification * x_mm + shift * self.pupil_centre_mm[0],
            y_mm: magnification * y_mm + shift * self.pupil_centre_mm[1],
        };
        (image, magnification)
    }

    /// Magnification and shift at a distance, and their slopes.
    ///
    /// ```text
    /// m = (L b − d (1 − L/f)) / (d + b z)        b = 1 − d/f, or 1 for a pupil in front of the lens
    /// s = −(L + (1 − L/f) z) / (d + b z)
    /// ```
    #[inline]
    pub fn chief(&self, z_mm: f64) -> Chief {
        let (l, d) = (self.sensor_distance_mm, self.pupil_position_mm);
        let b = if d >= 0.0 { 1.0 - d / self.focal_length_mm } else { 1.0 };
        let a = 1.0 - l / self.focal_length_mm;
        let inverse = 1.0 / (d + b * z_mm);
        let magnification = (l * b - d * a) * inverse;
        let shift = -(l + a * z_mm) * inverse;
        Chief {
            magnification,
            magnification_slope: -b * magnification * inverse,
            shift,
            shift_slope: -(a + b * shift) * inverse,
        }
    }

    /// Radius of the image of a point at distance z, mm: the pupil's shadow on the sensor.
    pub fn blur_radius_mm(&self, z_mm: f64) -> f64 {
        (self.pupil_radius_mm * self.spread(z_mm) / self.cone(z_mm)).abs()
    }

    /// Radius of the pupil on the lens for light from distance z, mm.
    pub fn lens_radius_mm(&self, z_mm: f64) -> f64 {
        (self.pupil_radius_mm / self.cone(z_mm)).abs()
    }

    /// Distance whose points are imaged sharply, `L f/(L − f)`, mm; infinite where L = f.
    pub fn focus_distance_mm(&self) -> f64 {
        let (l, f) = (self.sensor_distance_mm, self.focal_length_mm);
        l * f / (l - f)
    }

    /// Width at the pupil's plane of the light from a point at z, relative to its width at the lens.
    #[inline]
    fn cone(&self, z_mm: f64) -> f64 {
        let d = self.pupil_position_mm;
        if d >= 0.0 { d / z_mm + 1.0 - d / self.focal_length_mm } else { 1.0 + d / z_mm }
    }

    /// Width at the sensor of the light from a point at z, relative to its width at the lens, `1 − L/z'`.
    #[inline]
    fn spread(&self, z_mm: f64) -> f64 {
        1.0 - self.sensor_distance_mm * (1.0 / self.focal_length_mm - 1.0 / z_mm)
    }
}

/// Object position of a matched pair of radii, mm.
///
/// ```text
/// r = f/(L−f) · r_R            x = r cos φ,  y = r sin φ
/// z = L f/(L−f) · r_R / r_B                                [Ohno2018, Eqs. 7, 8, 12, 13]
/// ```
///
/// `L f/(L−f)` is the in-focus distance, so Γ = r_R / r_B is 1 exactly at focus. Returns `None` on the axis, where
/// there is no depth.
pub fn position_from_radii_mm(
    focal_length_mm: f64,
    sensor_distance_mm: f64,
    telecentric_radius_mm: f64,
    entocentric_radius_mm: f64,
    azimuth_rad: f64,
) -> Option<[f64; 3]> {
    let (f, l) = (focal_length_mm, sensor_distance_mm);
    let gamma = telecentric_radius_mm / entocentric_radius_mm;
    let r_mm = f / (l - f) * telecentric_radius_mm;
    let position_mm = [r_mm * azimuth_rad.cos(), r_mm * azimuth_rad.sin(), l * f / (l - f) * gamma];
    (entocentric_radius_mm > 0.0 && position_mm.iter().all(|c| c.is_finite())).then_some(position_mm)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const F: f64 = 100.0;
    const L: f64 = 151.0;

    fn through(pupil_position_mm: f64) -> Projection {
        Projection {
            focal_length_mm: F,
            sensor_distance_mm: L,
            pupil_position_mm,
            pupil_centre_mm: [0.0, 0.0],
            pupil_radius_mm: 1.0,
        }
    }

    #[test]
    fn a_pupil_in_the_focal_plane_is_equation_1() {
        for z_mm in [250.0, 300.0, 350.0] {
            assert!((through(F).magnification(z_mm) - (L / F - 1.0)).abs() < 1e-15);
        }
    }

    #[test]
    fn chief_rays_and_their_slopes_are_those_of_the_image() {
        const STEP_MM: f64 = 1e-3;
        for d_mm in [-40.0, 0.0, 40.0, F, 130.0] {
            let projection = Projection { pupil_centre_mm: [1.0, 0.0], ..through(d_mm) };
            let at = |z_mm: f64| [projection.magnification(z_mm), projection.image([0.0, 0.0, z_mm]).x_mm];
            let chief = projection.chief(280.0);
            let [m, s] = at(280.0);
            assert!((chief.magnification - m).abs() < 1e-14 && (chief.shift - s).abs() < 1e-14, "{d_mm}");
            let [m_slope, s_slope] =
                [0, 1].map(|k| (at(280.0 + STEP_MM)[k] - at(280.0 - STEP_MM)[k]) / (2.0 * STEP_MM));
            assert!((chief.magnification_slope - m_slope).abs() < 1e-9, "{d_mm}");
            assert!((chief.shift_slope - s_slope).abs() < 1e-9, "{d_mm}");
        }
    }

    #[test]
    fn a_pupil_at_the_lens_is_equation_2() {
        for z_mm in [250.0, 300.0, 350.0] {
            assert!((through(0.0).magnification(z_mm) - L / z_mm).abs() < 1e-15);
        }
    }

    #[test]
    fn the_two_sides_of_the_lens_agree_at_the_lens() {
        let (before, behind) = (through(-1e-9), through(0.0));
        assert!((before.magnification(300.0) - behind.magnification(300.0)).abs() < 1e-9);
    }

    #[test]
    fn on_axis_has_no_depth() {
        assert_eq!(position_from_radii_mm(F, L, 0.0, 0.0, 0.0), None);
    }

    /// Follows one ray in slopes and heights, which shares no formula with `image`.
    fn traced_image_mm(pupil: &Projection, x_mm: f64, z_mm: f64) -> f64 {
        let (f, l, d) = (pupil.focal_length_mm, pupil.sensor_distance_mm, pupil.pupil_position_mm);
        // The height at the pupil is linear in the height at the lens: two rays give the one through the centre.
        let height_at = |lens_mm: f64, plane_mm: f64| {
            let slope = (lens_mm - x_mm) / z_mm;
            if plane_mm < 0.0 { lens_mm + slope * plane_mm } else { lens_mm + (slope - lens_mm / f) * plane_mm }
        };
        let (h0, h1) = (height_at(0.0, d), height_at(1.0, d));
        let chief_mm = (pupil.pupil_centre_mm[0] - h0) / (h1 - h0);
        -height_at(chief_mm, l)
    }

    proptest! {
        #[test]
        fn the_formula_follows_a_traced_chief_ray(
            x_mm in -10.0..10.0_f64, z_mm in 200.0..400.0_f64, d in -60.0..140.0_f64, centre_mm in -0.5..0.5_f64,
        ) {
            let pupil = Projection { pupil_centre_mm: [centre_mm, 0.0], ..through(d) };
            // At the image of the object every ray meets: there is no single chief ray.
            prop_assume!((d - 1.0 / (1.0 / F - 1.0 / z_mm)).abs() > 1.0);
            let image = pupil.image([x_mm, 0.0, z_mm]);
            prop_assert!((image.x_mm - traced_image_mm(&pupil, x_mm, z_mm)).abs() < 1e-9);
            prop_assert_eq!(image.y_mm, 0.0);
        }

        #[test]
        fn projecting_and_reconstructing_is_the_identity(
            r_mm in 0.1..10.0_f64, azimuth_rad in -3.0..3.0_f64, z_mm in 200.0..400.0_f64,
        ) {
            let object_mm = [r_mm * azimuth_rad.cos(), r_mm * azimuth_rad.sin(), z_mm];
            let (telecentric, entocentric) = (through(F).image(object_mm), through(0.0).image(object_mm));
            let back_mm = position_from_radii_mm(
                F, L, telecentric.radius_mm(), entocentric.radius_mm(), telecentric.azimuth_rad(),
            ).expect("off the axis");
            for (found, expected) in back_mm.into_iter().zip(object_mm) {
                prop_assert!((found - expected).abs() < 1e-10);
            }
        }
    }
}
