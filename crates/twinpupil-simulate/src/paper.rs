//! The paper's scenes [Ohno2018, Sections 4 and 5], once, for tests, benchmarks, docs and the demo.

use crate::dot::DotSpec;
use crate::packing::RandomDots;
use crate::plate::{Pattern, Plate, TiltAxis};
use crate::scene::{Scene, SceneSpec};

/// Radius of the inner ring of the simulated dots, mm  [Ohno2018, Section 4].
pub const INNER_RADIUS_MM: f64 = 2.0;

/// Radius of the outer ring of the simulated dots, mm  [Ohno2018, Section 4].
pub const OUTER_RADIUS_MM: f64 = 7.5;

/// Distance at which the plate of the experiment is tilted, mm  [Ohno2018, Section 5].
pub const TILT_DISTANCE_MM: f64 = 300.0;

/// Azimuth of the outermost dots of the outer ring from the x axis, degrees.
const OUTER_AZIMUTH_DEG_MAX: f64 = 40.0;

/// The simulated dots: 11 of 1 mm at r = 2.0 and 11 at r = 7.5, all at distance z  [Ohno2018, Fig. 3].
///
/// The paper's text does not give the azimuths. Ours: the inner ring is spread evenly from +x, which leaves 0.13 mm
/// between neighbours. The outer ring has six dots about +x and five about −x, spread evenly over ±40°, because
/// beyond that the sensor of 1200 rows no longer holds a whole dot at z = 250 in the entocentric band.
///
/// `z_mm` is the distance, legal from above 0 to 100000; anything else is an error.
pub fn twenty_two_dots(z_mm: f64) -> Result<Scene, crate::SceneError> {
    let inner = (0..11).map(|k| (INNER_RADIUS_MM, 360.0 * f64::from(k) / 11.0));
    let right = (0..6).map(|k| (OUTER_RADIUS_MM, OUTER_AZIMUTH_DEG_MAX * (f64::from(k) / 2.5 - 1.0)));
    let left = (0..5).map(|k| (OUTER_RADIUS_MM, 180.0 + OUTER_AZIMUTH_DEG_MAX * (f64::from(k) / 2.0 - 1.0)));
    let dot = |(r_mm, azimuth_deg): (f64, f64)| {
        let (sin, cos) = azimuth_deg.to_radians().sin_cos();
        DotSpec { x_mm: r_mm * cos, y_mm: r_mm * sin, z_mm, diameter_mm: 1.0 }
    };
    let dots = inner.chain(right).chain(left).map(dot).collect();
    Scene::new(SceneSpec { dots, ..empty("twenty-two-dots", 0) })
}

/// The plate of the experiment, facing the camera: 60 random dots of 1 mm, r = 2.0 to 7.5  [Ohno2018, Section 5].
///
/// The paper does not say how far apart the dots are; ours keep 0.3 mm from edge to edge.
pub fn random_plate(z_mm: f64, seed: u64) -> Result<Scene, crate::SceneError> {
    Scene::new(SceneSpec { plate: Some(plate(z_mm, 0.0)), ..empty("random-plate", seed) })
}

/// The plate of the experiment at z = 300, tilted so that z grows with x  [Ohno2018, Section 5, Fig. 11, Eq. 14].
pub fn tilted_plate(tilt_deg: f64, seed: u64) -> Result<Scene, crate::SceneError> {
    Scene::new(SceneSpec { plate: Some(plate(TILT_DISTANCE_MM, tilt_deg)), ..empty("tilted-plate", seed) })
}

fn plate(distance_mm: f64, tilt_deg: f64) -> Plate {
    Plate {
        distance_mm,
        tilt_deg,
        tilt_axis: TiltAxis::Y,
        pattern: Pattern::RandomDots(RandomDots {
            count: 60,
            diameter_mm: 1.0,
            r_min_mm: INNER_RADIUS_MM,
            r_max_mm: OUTER_RADIUS_MM,
            gap_mm: 0.3,
        }),
    }
}

/// Bright features of 20 000 electrons on a dark ground, none yet.
fn empty(name: &str, seed: u64) -> SceneSpec {
    SceneSpec {
        schema: 1,
        name: name.to_owned(),
        seed,
        background_e: 0.0,
        brightness_e: 20_000.0,
        illumination: None,
        dots: Vec::new(),
        plate: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_twenty_two_dots_lie_wholly_on_the_sensor() {
        let instrument = twinpupil_instrument::paper::instrument();
        for z_mm in (250..=350).step_by(10).map(f64::from) {
            let scene = twenty_two_dots(z_mm).unwrap();
            assert_eq!(scene.dots().len(), 22);
            for projection in instrument.projections() {
                let reach_px = (0.5 * projection.magnification(z_mm) + projection.blur_radius_mm(z_mm))
                    / instrument.sensor.pitch_mm;
                for dot in scene.dots() {
                    let image = instrument.sensor.pixel_from_image(projection.image(dot.centre_mm));
                    assert!(image.u - reach_px > 0.0 && image.u + reach_px < 1919.0, "z = {z_mm}: {image:?}");
                    assert!(image.v - reach_px > 0.0 && image.v + reach_px < 1199.0, "z = {z_mm}: {image:?}");
                }
            }
        }
    }

    #[test]
    fn no_two_of_them_touch() {
        let scene = twenty_two_dots(300.0).unwrap();
        for (i, a) in scene.dots().iter().enumerate() {
            for b in &scene.dots()[..i] {
                let gap_mm = (a.centre_mm[0] - b.centre_mm[0]).hypot(a.centre_mm[1] - b.centre_mm[1]) - 1.0;
                assert!(gap_mm > 0.12, "{gap_mm}");
            }
        }
    }

    #[test]
    fn the_plates_have_sixty_dots_for_many_seeds() {
        for seed in 0..20 {
            for scene in [random_plate(250.0, seed), tilted_plate(60.0, seed)] {
                assert_eq!(scene.unwrap().dots().len(), 60);
            }
        }
    }
}
