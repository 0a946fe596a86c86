//! All rays of one band from a small disc on the sensor, and what they can meet.

use twinpupil_instrument::ImagePoint;
use twinpupil_optics::{BandOptics, Footprint, Pencil};

use crate::dot::Dot;

/// All rays of one band from a disc on the sensor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bundle<'a> {
    pub(crate) optics: &'a BandOptics,
    pub(crate) centre: ImagePoint,
    pub(crate) radius_mm: f64,
    pub(crate) pencil: Pencil,
}

/// How a bundle of rays meets a dot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sight {
    /// No ray hits it.
    Beside,
    /// Every ray hits it.
    Within,
    /// Some rays may hit it and some may not.
    Across,
}

impl<'a> Bundle<'a> {
    pub(crate) fn new(optics: &'a BandOptics, centre: ImagePoint, radius_mm: f64) -> Self {
        Self { optics, centre, radius_mm, pencil: optics.pencil(centre, radius_mm) }
    }

    /// The rays from a smaller disc within the disc.
    pub(crate) fn part(&self, centre: ImagePoint, radius_mm: f64) -> Self {
        Self { centre, radius_mm, pencil: self.pencil.part(centre, radius_mm), ..*self }
    }

    /// Whether every ray arrives unattenuated, for certain.
    pub(crate) fn is_unclipped(&self) -> bool {
        self.optics.is_unclipped(self.centre, self.radius_mm)
    }

    /// How the bundle meets `dot`, whose edge is blurred over `blur_mm`; in doubt, [`Sight::Across`].
    pub(crate) fn sight(&self, dot: &Dot, blur_mm: f64) -> Sight {
        let [x_mm, y_mm, z_mm] = dot.centre_mm;
        let depth_mm = dot.depth_mm();
        let shadow = self.between(z_mm - depth_mm, z_mm + depth_mm);
        let distance_mm = ((shadow.x_mm - x_mm).powi(2) + (shadow.y_mm - y_mm).powi(2)).sqrt();
        let reach_mm = shadow.radius_mm + blur_mm;
        // Seen along the axis, a tilted disc is an ellipse between these two circles.
        let (outer_mm, inner_mm) = (dot.radius_mm(), dot.radius_mm() * dot.normal[2].abs());
        if distance_mm > outer_mm + reach_mm {
            Sight::Beside
        } else if distance_mm + reach_mm < inner_mm {
            Sight::Within
        } else {
            Sight::Across
        }
    }

    /// Corners of a rectangle through which every ray passes at every distance between two.
    pub(crate) fn rectangle_mm(&self, near_mm: f64, far_mm: f64) -> ([f64; 2], [f64; 2]) {
        let Footprint { x_mm, y_mm, radius_mm } = self.between(near_mm, far_mm);
        ([x_mm - radius_mm, y_mm - radius_mm], [x_mm + radius_mm, y_mm + radius_mm])
    }

    /// A circle through which every ray passes at every distance between two: rays are straight, so the smallest
    /// circle about both footprints will do.
    fn between(&self, near_mm: f64, far_mm: f64) -> Footprint {
        let near = self.pencil.footprint(near_mm);
        if far_mm == near_mm {
            return near;
        }
        let far = self.pencil.footprint(far_mm);
        let half_way_mm = 0.5 * (far.x_mm - near.x_mm).hypot(far.y_mm - near.y_mm);
        Footprint {
            x_mm: 0.5 * (near.x_mm + far.x_mm),
            y_mm: 0.5 * (near.y_mm + far.y_mm),
            radius_mm: half_way_mm + near.radius_mm.max(far.radius_mm),
        }
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;
    use twinpupil_optics::Camera;

    use super::*;

    #[test]
    fn a_pixel_sees_the_dot_before_it() {
        let instrument = paper::instrument();
        let camera = Camera::new(&instrument).unwrap();
        for (band, optics) in instrument.bands.iter().zip(camera.bands()) {
            let tilted = [0.5, 0.0, -0.75_f64.sqrt()];
            for normal in [[0.0, 0.0, -1.0], tilted] {
                let dot = Dot { centre_mm: [5.0, -2.0, 330.0], normal, diameter_mm: 1.0 };
                let pixel = |x_mm: f64| {
                    let centre = instrument.projection(band).image([5.0 + x_mm, -2.0, 330.0]);
                    Bundle::new(optics, centre, 0.004)
                };
                assert_eq!(pixel(0.0).sight(&dot, 0.01), Sight::Within);
                assert_eq!(pixel(0.5).sight(&dot, 0.01), Sight::Across);
                assert_eq!(pixel(-0.9).sight(&dot, 0.01), Sight::Beside);
            }
        }
    }
}
