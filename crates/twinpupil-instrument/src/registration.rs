//! Where the pixels of a band's own sensor lie on the reference frame.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::PixelPoint;
use crate::check::{ValueError, within};
use crate::homography::Homography;

/// A homography from the pixels of a band's page to those of the reference frame, whose axis and pitch the sensor
/// states.
///
/// ```text
/// (u′, v′, 1) ∝ H (u, v, 1)
/// ```
///
/// Measured positions go through it; pixels are never resampled.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Registration {
    pub(crate) homography: Homography,
}

impl Default for Registration {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Registration {
    /// The page is the reference frame.
    pub const IDENTITY: Self = Self { homography: Homography::IDENTITY };

    /// The homography with these rows.
    pub fn from_rows(rows: [[f64; 3]; 3]) -> Self {
        Self { homography: Homography { rows } }
    }

    /// The rows of H.
    pub fn rows(&self) -> [[f64; 3]; 3] {
        self.homography.rows
    }

    /// Whether the page is the reference frame.
    pub fn is_identity(&self) -> bool {
        *self == Self::IDENTITY
    }

    /// Where a pixel of the page lies on the reference frame.
    pub fn map(&self, PixelPoint { u, v }: PixelPoint) -> PixelPoint {
        let [u, v] = self.homography.map([u, v]);
        PixelPoint { u, v }
    }

    /// How the position on the reference frame changes with u and v of the page, row by row.
    pub fn jacobian(&self, at: PixelPoint) -> [[f64; 2]; 2] {
        self.homography.jacobian([at.u, at.v])
    }

    /// Area on the reference frame of a pixel of the page, px².
    pub fn area_px2(&self, at: PixelPoint) -> f64 {
        let [[a, b], [c, d]] = self.jacobian(at);
        (a * d - b * c).abs()
    }

    /// The way back, from the reference frame to the page.
    ///
    /// A homography that the checks have passed has one.
    #[must_use]
    pub fn inverse(&self) -> Self {
        Self { homography: self.homography.inverse() }
    }

    /// Refuses what is no picture of the page on a reference frame of about its size.
    pub(crate) fn check(&self, key: &str, size_px: [usize; 2]) -> Result<(), ValueError> {
        const SHRINKING_MAX: f64 = 10.0;
        for (i, row) in self.homography.rows.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                within(&format!("{key}[{i}][{j}]"), *value, -1e9, 1e9)?;
            }
        }
        let [width, height] = size_px.map(|size| (size - 1) as f64);
        let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
        let turns = corners.map(|[u, v]| {
            let [[a, b], [c, d]] = self.jacobian(PixelPoint { u, v });
            a * d - b * c
        });
        let before = corners.iter().all(|corner| self.homography.weight(*corner) > 0.0);
        let legal = SHRINKING_MAX.powi(-2)..=SHRINKING_MAX.powi(2);
        // A mirror image turns the corners the other way round; a beam splitter makes one.
        let same_way = turns.iter().all(|turn| legal.contains(turn)) || turns.iter().all(|turn| legal.contains(&-turn));
        if before && same_way {
            return Ok(());
        }
        let legal = "a homography that maps the page to a tenth to ten times its size, with a positive last row";
        Err(ValueError::new(key, format!("{:?}", self.homography.rows), legal))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn turned() -> Registration {
        let (sin, cos) = 1.2_f64.to_radians().sin_cos();
        Registration::from_rows([[1.01 * cos, -sin, 14.0], [sin, 1.01 * cos, -9.0], [2e-6, -1e-6, 1.0]])
    }

    proptest! {
        #[test]
        fn the_inverse_leads_back(u in -100.0..2100.0_f64, v in -100.0..1300.0_f64) {
            let back = turned().inverse().map(turned().map(PixelPoint { u, v }));
            prop_assert!((back.u - u).abs() < 1e-9 && (back.v - v).abs() < 1e-9);
        }

        #[test]
        fn the_jacobian_is_the_slope(u in 0.0..2000.0_f64, v in 0.0..1200.0_f64) {
            let jacobian = turned().jacobian(PixelPoint { u, v });
            let along = |du: f64, dv: f64| {
                let (a, b) = (PixelPoint { u: u - du, v: v - dv }, PixelPoint { u: u + du, v: v + dv });
                let (a, b) = (turned().map(a), turned().map(b));
                [(b.u - a.u) / 0.02, (b.v - a.v) / 0.02]
            };
            let (with_u, with_v) = (along(0.01, 0.0), along(0.0, 0.01));
            for axis in 0..2 {
                prop_assert!((jacobian[axis][0] - with_u[axis]).abs() < 1e-6);
                prop_assert!((jacobian[axis][1] - with_v[axis]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn what_is_no_picture_is_refused() {
        let check = |rows| Registration::from_rows(rows).check("band[1].registration", [1920, 1200]);
        assert!(turned().check("r", [1920, 1200]).is_ok());
        // A mirror image, as one side of a beam splitter sees it.
        assert!(check([[-1.0, 0.0, 1919.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]).is_ok());
        for rows in [
            [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1e-3, 0.0, 1.0]],
            [[0.0; 3]; 3],
            [[f64::NAN, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        ] {
            let message = check(rows).expect_err("must be refused").to_string();
            assert!(message.starts_with("`band[1].registration"), "{message}");
        }
    }
}
