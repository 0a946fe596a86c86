//! The thin lens against formulas that share nothing with the tracer.

use proptest::prelude::*;
use twinpupil_instrument::{ImagePoint, Instrument, Lens, Role, paper};
use twinpupil_optics::{BandOptics, Camera, ObjectRays, RayLedger, RayStarts, response_table_for};

/// One ray followed from plane to plane by heights and slopes alone: object-space line and whether all masks pass it.
fn followed(instrument: &Instrument, band: usize, image_mm: [f64; 2], pupil: [f64; 2]) -> ([f64; 4], bool) {
    let name = &instrument.bands[band].name;
    let projection = instrument.projection(&instrument.bands[band]);
    let (f, l) = (projection.focal_length_mm, instrument.sensor.distance_mm);
    // The lens point that sends the ray through the pupil point, by trial of two lens points.
    let axis = |k: usize| {
        let s = -image_mm[k];
        let slope = |a: f64| (a - s) / l - a / f;
        let height = |a: f64, t: f64| if t >= 0.0 { a + (s - a) * t / l } else { a + slope(a) * -t };
        let d = projection.pupil_position_mm;
        let (h0, h1) = (height(0.0, d), height(1.0, d));
        let aim = projection.pupil_centre_mm[k] + projection.pupil_radius_mm * pupil[k];
        let a = (aim - h0) / (h1 - h0);
        let heights: Vec<f64> = instrument.apertures.iter().map(|mask| height(a, mask.position_mm)).collect();
        ((a, slope(a)), heights)
    };
    let ((x, hx), (y, hy)) = (axis(0), axis(1));
    let passes = instrument.apertures.iter().enumerate().all(|(i, mask)| {
        let r = (hx[i] - mask.centre_mm[0]).hypot(hy[i] - mask.centre_mm[1]);
        mask.annuli(name).iter().any(|ring| ring.inner_mm <= r && r < ring.outer_mm)
    });
    ([x.0, y.0, x.1, y.1], passes)
}

fn trace_one(optics: &BandOptics, image_mm: [f64; 2], pupil: [f64; 2]) -> (ObjectRays, RayLedger) {
    let (mut rays, mut ledger) = (ObjectRays::default(), RayLedger::default());
    let starts = RayStarts {
        image_x_mm: &[image_mm[0]],
        image_y_mm: &[image_mm[1]],
        pupil_x: &[pupil[0]],
        pupil_y: &[pupil[1]],
    };
    optics.trace(starts, &mut rays, &mut ledger);
    (rays, ledger)
}

/// The paper's camera with masks off the axis and one more stop in front of the lens.
fn crooked() -> Instrument {
    let mut spec = paper::instrument().into_spec();
    spec.apertures[0].centre_mm = [0.12, -0.05];
    spec.apertures[1].centre_mm = [-0.03, 0.08];
    let mut front = spec.apertures[2].clone();
    front.position_mm = -25.0;
    spec.apertures.push(front);
    let Lens::Thin(lens) = &mut spec.lens else { panic!("the paper's lens is thin") };
    lens.focal_length_mm_by_band.insert("blue".to_owned(), 98.19);
    Instrument::new(spec).expect("masks may lie off the axis")
}

/// Uniform points of the unit disc: equal areas by the root, spread by the golden angle.
fn spiral(count: usize) -> (Vec<f64>, Vec<f64>) {
    (0..count)
        .map(|k| {
            let radius = ((k as f64 + 0.5) / count as f64).sqrt();
            let azimuth = 2.399_963_229_728_653 * k as f64;
            (radius * azimuth.cos(), radius * azimuth.sin())
        })
        .unzip()
}

fn mean_weight(optics: &BandOptics, image_mm: [f64; 2], count: usize) -> f64 {
    let (pupil_x, pupil_y) = spiral(count);
    let (image_x_mm, image_y_mm) = (vec![image_mm[0]; count], vec![image_mm[1]; count]);
    let starts = RayStarts { image_x_mm: &image_x_mm, image_y_mm: &image_y_mm, pupil_x: &pupil_x, pupil_y: &pupil_y };
    let (mut rays, mut ledger) = (ObjectRays::default(), RayLedger::default());
    optics.trace(starts, &mut rays, &mut ledger);
    assert_eq!((ledger.launched, ledger.total()), (count as u64, count as u64));
    rays.weight.iter().sum::<f64>() / count as f64
}

proptest! {
    #[test]
    fn the_trace_follows_the_slow_formula(
        band in 0..2_usize, x in -6.0..6.0_f64, y in -4.0..4.0_f64, rho in 0.0..0.999_f64, azimuth in 0.0..6.3_f64,
    ) {
        let instrument = crooked();
        let camera = Camera::new(&instrument).unwrap();
        let pupil = [rho * azimuth.cos(), rho * azimuth.sin()];
        let (rays, ledger) = trace_one(&camera.bands()[band], [x, y], pupil);
        let (expected, passes) = followed(&instrument, band, [x, y], pupil);
        let found = [rays.x_mm[0], rays.y_mm[0], rays.slope_x[0], rays.slope_y[0]];
        for (found, expected) in found.into_iter().zip(expected) {
            prop_assert!((found - expected).abs() < 1e-11, "{found} {expected}");
        }
        prop_assert_eq!(rays.weight[0] > 0.0, passes);
        prop_assert_eq!((ledger.launched, ledger.total(), ledger.arrived), (1, 1, u64::from(passes)));
    }

    #[test]
    fn turning_everything_about_the_axis_turns_the_ray(
        band in 0..2_usize, x in -6.0..6.0_f64, y in -4.0..4.0_f64, u in -0.6..0.6_f64, v in -0.6..0.6_f64,
        angle in 0.0..6.3_f64,
    ) {
        let camera = Camera::new(&paper::instrument()).unwrap();
        let (sin, cos) = angle.sin_cos();
        let turn = |[x, y]: [f64; 2]| [cos * x - sin * y, sin * x + cos * y];
        let optics = &camera.bands()[band];
        let (straight, _) = trace_one(optics, [x, y], [u, v]);
        let (turned, _) = trace_one(optics, turn([x, y]), turn([u, v]));
        let expected = turn([straight.x_mm[0], straight.y_mm[0]]);
        prop_assert!((turned.x_mm[0] - expected[0]).abs() < 1e-11 && (turned.y_mm[0] - expected[1]).abs() < 1e-11);
        let expected = turn([straight.slope_x[0], straight.slope_y[0]]);
        prop_assert!((turned.slope_x[0] - expected[0]).abs() < 1e-12);
    }

    #[test]
    fn rays_stay_in_their_footprint_and_unclipped_means_unclipped(
        band in 0..2_usize, x in -6.0..6.0_f64, y in -4.0..4.0_f64, radius in 0.0..0.5_f64,
        rho in 0.0..1.0_f64, pupil_azimuth in 0.0..6.3_f64, sigma in 0.0..1.0_f64, azimuth in 0.0..6.3_f64,
    ) {
        let camera = Camera::new(&crooked()).unwrap();
        let optics = &camera.bands()[band];
        let centre = ImagePoint { x_mm: x, y_mm: y };
        let image = [x + radius * sigma * azimuth.cos(), y + radius * sigma * azimuth.sin()];
        let (rays, _) = trace_one(optics, image, [rho * pupil_azimuth.cos(), rho * pupil_azimuth.sin()]);
        let footprint = optics.pencil(centre, radius).footprint(320.0);
        let (dx, dy) = (
            rays.x_mm[0] + 320.0 * rays.slope_x[0] - footprint.x_mm,
            rays.y_mm[0] + 320.0 * rays.slope_y[0] - footprint.y_mm,
        );
        prop_assert!(dx.hypot(dy) <= footprint.radius_mm);
        if optics.is_unclipped(centre, radius) {
            prop_assert_eq!(rays.weight[0], 1.0);
        }
    }

    #[test]
    fn a_sharp_point_has_the_throughput_of_its_image(band in 0..2_usize, r_mm in 0.0..4.0_f64) {
        // In focus all light of an object point meets in one image point: the backward and the forward integral are
        // over the same rays.
        let instrument = paper::instrument();
        let camera = Camera::new(&instrument).unwrap();
        let object_mm = [0.6 * r_mm, -0.8 * r_mm, instrument.focus_distance_mm()];
        let image = instrument.projection(&instrument.bands[band]).image(object_mm);
        let optics = &camera.bands()[band];
        let counted = mean_weight(optics, [image.x_mm, image.y_mm], 40_000);
        prop_assert!((counted - optics.point_image(object_mm).throughput).abs() < 2e-3);
    }
}

#[test]
fn an_unclipped_pupil_has_mean_weight_one_and_its_image_at_the_chief_ray() {
    let instrument = paper::instrument();
    let camera = Camera::new(&instrument).unwrap();
    for (band, optics) in instrument.bands.iter().zip(camera.bands()) {
        let centre = ImagePoint { x_mm: 3.0, y_mm: -2.0 };
        assert!(optics.is_unclipped(centre, 0.1));
        assert_eq!(mean_weight(optics, [3.0, -2.0], 1000), 1.0);
        let image = optics.point_image([6.0, -3.0, 320.0]);
        let expected = instrument.projection(band).image([6.0, -3.0, 320.0]);
        assert_eq!(image.throughput, 1.0);
        assert!((image.centroid.x_mm - expected.x_mm).abs() < 1e-13);
        assert!((image.centroid.y_mm - expected.y_mm).abs() < 1e-13);
    }
}

#[test]
fn a_pupil_in_focus_is_refused() {
    let mut spec = paper::instrument().into_spec();
    spec.apertures.drain(1..);
    spec.apertures[0].position_mm = -151.0 * 100.0 / 51.0;
    spec.apertures[0].zones.truncate(1);
    spec.apertures[0].zones[0].pass = vec!["red".to_owned(), "blue".to_owned()];
    let message = Camera::new(&Instrument::new(spec).unwrap()).expect_err("in focus").to_string();
    assert!(message.starts_with("`aperture[0].position_mm` is -296.07") && !message.contains('\n'), "{message}");
}

#[test]
fn a_pupil_of_rings_has_mean_weight_one() {
    let mut spec = paper::instrument().into_spec();
    // Blue passes a ring of the lens mask, half the area of the disc.
    spec.apertures[0].zones[0].radius_mm = Some(0.5_f64.sqrt());
    spec.apertures[0].zones[0].pass = vec!["red".to_owned()];
    spec.apertures[0].zones[1] = twinpupil_instrument::Zone { radius_mm: Some(1.0), pass: vec!["blue".to_owned()] };
    spec.apertures[0].zones.push(twinpupil_instrument::Zone { radius_mm: None, pass: vec!["red".to_owned()] });
    let instrument = Instrument::new(spec).unwrap();
    let camera = Camera::new(&instrument).unwrap();
    let blue = &camera.bands()[instrument.band_index(Role::Entocentric)];
    assert!((mean_weight(blue, [3.0, -2.0], 20_000) - 1.0).abs() < 1e-3);
    assert!(!blue.is_unclipped(ImagePoint { x_mm: 3.0, y_mm: -2.0 }, 0.0));
    assert_eq!(blue.point_image([6.0, -3.0, 320.0]).throughput, 1.0);
}

#[test]
fn the_papers_masks_clip_within_1_plus_half_z_over_f_and_blind_blue_within_half_z_over_f_minus_1() {
    let instrument = paper::instrument();
    let camera = Camera::new(&instrument).unwrap();
    for z_mm in [250.0, 300.0, 350.0] {
        for optics in camera.bands() {
            assert!((optics.clip_radius_mm(z_mm) - (1.0 + 0.5 * z_mm / 100.0)).abs() < 1e-9);
        }
        assert_eq!(camera.bands()[instrument.band_index(Role::Telecentric)].blind_radius_mm(z_mm), 0.0);
        let blue = camera.bands()[instrument.band_index(Role::Entocentric)].blind_radius_mm(z_mm);
        assert!((blue - (0.5 * z_mm / 100.0 - 1.0)).abs() < 1e-9);
    }
}

/// Mean image radius of a 1 mm dot at (r, 0, z)  [Ohno2018, Eqs. 9, 10], by rays from a grid of image points.
fn dot_radius_mm(instrument: &Instrument, band: usize, r_mm: f64, z_mm: f64) -> f64 {
    const GRID: usize = 90;
    const SAMPLES: usize = 300;
    let camera = Camera::new(instrument).expect("a thin lens");
    let projection = instrument.projection(&instrument.bands[band]);
    let centre = projection.image([r_mm, 0.0, z_mm]);
    let reach_mm = 0.5 * projection.magnification(z_mm) + projection.blur_radius_mm(z_mm);
    let (pupil_x, pupil_y) = spiral(SAMPLES);
    let (mut rays, mut ledger) = (ObjectRays::default(), RayLedger::default());
    let (mut light, mut moment) = (0.0, 0.0);
    for (i, j) in (0..GRID * GRID).map(|k| (k % GRID, k / GRID)) {
        let at = |k: usize| reach_mm * (2.0 * (k as f64 + 0.5) / GRID as f64 - 1.0);
        let (x_mm, y_mm) = (centre.x_mm + at(i), at(j));
        let starts = RayStarts {
            image_x_mm: &[x_mm; SAMPLES],
            image_y_mm: &[y_mm; SAMPLES],
            pupil_x: &pupil_x,
            pupil_y: &pupil_y,
        };
        camera.bands()[band].trace(starts, &mut rays, &mut ledger);
        let on_dot = |k: usize| {
            let x = rays.x_mm[k] + z_mm * rays.slope_x[k] - r_mm;
            x.hypot(rays.y_mm[k] + z_mm * rays.slope_y[k]) < 0.5
        };
        let irradiance: f64 = (0..SAMPLES).filter(|k| on_dot(*k)).map(|k| rays.weight[k]).sum();
        light += irradiance;
        moment += irradiance * x_mm.hypot(y_mm);
    }
    assert_eq!(ledger.total(), ledger.launched);
    moment / light
}

#[test]
fn clipping_moves_the_depths_of_the_paper_as_two_independent_programs_found() {
    let instrument = paper::instrument();
    let [red, blue] = [Role::Telecentric, Role::Entocentric].map(|role| instrument.band_index(role));
    // DESIGN, "What really limits it": at r = 2 the masks clip each other, at r = 7.5 they do not.
    for (r_mm, z_mm, expected_mm, tolerance_mm) in [
        (2.0, 250.0, 247.1, 0.15),
        (2.0, 300.0, 297.5, 0.15),
        (2.0, 350.0, 355.25, 0.15),
        (7.5, 250.0, 250.0, 0.06),
        (7.5, 350.0, 350.0, 0.06),
    ] {
        let gamma = dot_radius_mm(&instrument, red, r_mm, z_mm) / dot_radius_mm(&instrument, blue, r_mm, z_mm);
        let found_mm = instrument.focus_distance_mm() * gamma;
        assert!((found_mm - expected_mm).abs() < tolerance_mm, "r = {r_mm}, z = {z_mm}: {found_mm}");
    }
}

#[test]
fn the_table_of_the_paper_is_first_order_outside_the_clip_radius() {
    let instrument = paper::instrument();
    let table = response_table_for(&instrument).unwrap();
    for (index, band) in table.bands.iter().enumerate() {
        assert_eq!(band.band, instrument.bands[index].name);
        for z_mm in [250.0, 300.0, 350.0] {
            for r_mm in [3.0, 5.0, 7.5] {
                let response = table.at(index, r_mm, z_mm);
                assert!((response.throughput - 1.0).abs() < 1e-12 && response.radial_deviation_mm.abs() < 1e-12);
            }
            assert!(table.at(index, 1.5, z_mm).throughput < 0.9);
        }
    }
}

/// Masks off the axis shade the ground about a point off the axis, and evenly all round it.
#[test]
fn the_ground_is_shaded_about_where_the_masks_meet() {
    const RAYS: usize = 4096;
    let mut spec = paper::instrument().into_spec();
    spec.apertures[0].centre_mm = [0.4, -0.2];
    spec.apertures[1].centre_mm = [-0.1, 0.3];
    let instrument = Instrument::new(spec).unwrap();
    let table = twinpupil_optics::response_table_for(&instrument).unwrap();
    let camera = Camera::new(&instrument).unwrap();
    let turn = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let place = |k: usize| ((k as f64 + 0.5) / RAYS as f64).sqrt();
    let pupil_x: Vec<f64> = (0..RAYS).map(|k| place(k) * (turn * k as f64).cos()).collect();
    let pupil_y: Vec<f64> = (0..RAYS).map(|k| place(k) * (turn * k as f64).sin()).collect();
    for (band, optics) in camera.bands().iter().enumerate() {
        let [x_mm, y_mm] = table.bands[band].ground_centre_mm;
        assert!(x_mm.hypot(y_mm) > 0.1, "{x_mm} {y_mm}");
        for (azimuth_rad, radius_mm) in [(0.3_f64, 0.4), (2.0, 0.4), (4.4, 0.9), (5.5, 0.9)] {
            let (sin, cos) = azimuth_rad.sin_cos();
            let (image_x_mm, image_y_mm) = (vec![x_mm + radius_mm * cos; RAYS], vec![y_mm + radius_mm * sin; RAYS]);
            let starts =
                RayStarts { image_x_mm: &image_x_mm, image_y_mm: &image_y_mm, pupil_x: &pupil_x, pupil_y: &pupil_y };
            let mut rays = ObjectRays::default();
            optics.trace(starts, &mut rays, &mut RayLedger::default());
            let light = rays.weight.iter().sum::<f64>() / RAYS as f64;
            let expected = table.ground(band, radius_mm);
            assert!((light - expected).abs() < 0.01 && expected < 0.95, "{band} {radius_mm}: {light} {expected}");
        }
    }
}
