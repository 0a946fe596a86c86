//! Simulated light against closed forms and against a renderer without any shortcut.

#![allow(clippy::unwrap_used, reason = "helpers of tests may panic like the tests")]

use std::f64::consts::PI;

use proptest::prelude::*;
use twinpupil_instrument::{
    Instrument, Mosaic, PixelPoint, ResponseMatrix, Role, SpectralTable, paper as paper_instrument,
};
use twinpupil_optics::{Camera, ObjectRays, RayLedger, RayStarts};
use twinpupil_simulate::{Dot, DotSpec, Expectation, Picture, Scene, SceneSpec, expected_electrons, paper};

const BRIGHTNESS_E: f64 = 20_000.0;

/// The paper's camera with a small monochrome sensor whose first pixel is `corner_px` of the paper's.
fn window(corner_px: [f64; 2], size_px: [usize; 2]) -> Instrument {
    let mut spec = paper_instrument::instrument().into_spec();
    spec.sensor.mosaic = Mosaic::Mono;
    spec.sensor.size_px = size_px;
    for (axis_px, corner_px) in spec.sensor.axis_px.iter_mut().zip(corner_px) {
        *axis_px -= corner_px;
    }
    for (page, band) in spec.bands.iter_mut().enumerate() {
        band.plane = page.to_string();
    }
    Instrument::new(spec).unwrap()
}

/// A window of the sensor in which the image of an object point in a band lies in the middle.
fn window_around(role: Role, object_mm: [f64; 3], size_px: [usize; 2]) -> Instrument {
    let whole = paper_instrument::instrument();
    let PixelPoint { u, v } = whole.sensor.pixel_from_image(whole.projection(whole.band(role)).image(object_mm));
    let [width_px, height_px] = size_px.map(|size| 0.5 * size as f64);
    window([(u - width_px).round(), (v - height_px).round()], size_px)
}

fn spec(dots: Vec<DotSpec>) -> SceneSpec {
    SceneSpec {
        schema: 1,
        name: "test".to_owned(),
        seed: 1,
        background_e: 0.0,
        brightness_e: BRIGHTNESS_E,
        illumination: None,
        dots,
        plate: None,
    }
}

fn one_dot(position_mm: [f64; 3], diameter_mm: f64) -> Scene {
    let [x_mm, y_mm, z_mm] = position_mm;
    Scene::new(spec(vec![DotSpec { x_mm, y_mm, z_mm, diameter_mm }])).unwrap()
}

fn expect(instrument: &Instrument, scene: &Scene, pupil_samples: usize) -> Expectation {
    let response = ResponseMatrix::ideal(&instrument.bands);
    expected_electrons(instrument, scene, &response, pupil_samples, &|_| {}).unwrap()
}

/// Sum and centroid of a page.
fn moments(electrons: &[f64], width_px: usize) -> (f64, PixelPoint) {
    let (mut sum, mut u, mut v) = (0.0, 0.0, 0.0);
    for (index, e) in electrons.iter().enumerate() {
        sum += e;
        u += e * (index % width_px) as f64;
        v += e * (index / width_px) as f64;
    }
    (sum, PixelPoint { u: u / sum, v: v / sum })
}

#[test]
fn an_unclipped_dot_is_centred_on_its_projection() {
    // Sampling leaves up to 0.0025 px at 256 samples and 0.0006 px at 1024, in focus much less.
    const TOLERANCE_PX: f64 = 0.001;
    for role in [Role::Telecentric, Role::Entocentric] {
        for z_mm in [250.0, 300.0, 350.0] {
            for azimuth_deg in [17.0_f64, 250.0] {
                let (sin, cos) = azimuth_deg.to_radians().sin_cos();
                let position_mm = [5.0 * cos, 5.0 * sin, z_mm];
                let instrument = window_around(role, position_mm, [160, 160]);
                let expectation = expect(&instrument, &one_dot(position_mm, 1.0), 1024);
                let (_, found) = moments(&expectation.pages[instrument.band_index(role)], 160);
                let image = instrument.projection(instrument.band(role)).image(position_mm);
                let expected = instrument.sensor.pixel_from_image(image);
                let error_px = (found.u - expected.u).abs().max((found.v - expected.v).abs());
                assert!(error_px < TOLERANCE_PX, "{role:?}, z = {z_mm}, azimuth {azimuth_deg}: {error_px}");
            }
        }
    }
}

#[test]
fn a_defocused_dot_keeps_its_light() {
    for role in [Role::Telecentric, Role::Entocentric] {
        // From many pixels down to less than one, where ever fewer samples hit.
        for (diameter_mm, tolerance) in [(1.0, 1e-3), (0.1, 1e-3), (0.012, 3e-3), (0.004, 3e-2)] {
            let position_mm = [5.0, 2.0, 240.0];
            let instrument = window_around(role, position_mm, [180, 180]);
            let expectation = expect(&instrument, &one_dot(position_mm, diameter_mm), 2048);
            let (sum_e, _) = moments(&expectation.pages[instrument.band_index(role)], 180);
            let magnification = instrument.projection(instrument.band(role)).magnification(240.0);
            let image_radius_px = 0.5 * diameter_mm * magnification / instrument.sensor.pitch_mm;
            let expected_e = BRIGHTNESS_E * PI * image_radius_px.powi(2);
            let error = sum_e / expected_e - 1.0;
            assert!(error.abs() < tolerance, "{role:?}, {diameter_mm}: {error}");
        }
    }
}

#[test]
fn dark_on_bright_is_the_complement_of_bright_on_dark() {
    // This window holds clipped and unclipped places, dots and ground.
    let instrument = window([900.0, 560.0], [400, 120]);
    let bright = paper::random_plate(260.0, 5).unwrap();
    let with = |background_e, brightness_e| {
        let spec = SceneSpec { plate: bright.plate.clone(), background_e, brightness_e, ..spec(vec![]) };
        expect(&instrument, &Scene::new(spec).unwrap(), 64)
    };
    let (bright, dark, full) = (with(500.0, 9000.0), with(9000.0, 500.0), with(9500.0, 9500.0));
    for page in 0..2 {
        for ((bright, dark), full) in bright.pages[page].iter().zip(&dark.pages[page]).zip(&full.pages[page]) {
            assert!((bright + dark - full).abs() < 1e-8, "{bright} + {dark} is not {full}");
        }
    }
    let clipped = full.pages[0].iter().filter(|e| **e < 9499.0).count();
    assert!(clipped > 1000 && clipped < 47_000, "{clipped}");
}

#[test]
fn crosstalk_puts_its_share_into_the_other_plane() {
    let instrument = paper_instrument::instrument();
    let mut spec = instrument.into_spec();
    spec.sensor.mosaic = Mosaic::Rgb;
    spec.sensor.size_px = [900, 1200];
    spec.sensor.axis_px[0] = 0.0;
    let instrument = Instrument::new(spec).unwrap();
    let response = ResponseMatrix::from_curves(
        &instrument.bands,
        Mosaic::Rgb,
        &SpectralTable::nominal_quantum_efficiency(),
        &SpectralTable::nominal_filters(),
    )
    .unwrap();
    let position_mm = [7.0, 0.0, 250.0];
    let expectation = expected_electrons(&instrument, &one_dot(position_mm, 1.0), &response, 16, &|_| {}).unwrap();
    for (band, stated) in instrument.bands.iter().enumerate() {
        let centre = instrument.sensor.pixel_from_image(instrument.projection(stated).image(position_mm));
        let pixel = centre.v.round() as usize * 900 + centre.u.round() as usize;
        for (page, plane) in ["r", "g", "b"].into_iter().enumerate() {
            let expected_e = BRIGHTNESS_E * response.of_plane(plane)[band];
            assert_eq!(expectation.pages[page][pixel], expected_e, "band {band} in plane {plane}");
        }
    }
    assert!(response.of_plane("r")[1] > 0.0);
}

#[test]
fn only_the_sites_of_a_mosaic_that_respond_receive_light() {
    let mut spec = paper_instrument::instrument().into_spec();
    spec.sensor.size_px = [300, 300];
    spec.sensor.axis_px = [-300.0, 150.0];
    let instrument = Instrument::new(spec).unwrap();
    let scene = Scene::new(SceneSpec { background_e: 100.0, ..self::spec(vec![]) }).unwrap();
    let expectation = expect(&instrument, &scene, 16);
    for (index, electrons) in expectation.pages[0].iter().enumerate() {
        let plane = Mosaic::Rggb.plane_of(0, index % 300, index / 300);
        assert_eq!(*electrons, if plane == "g" { 0.0 } else { 100.0 });
    }
    assert_eq!(expectation.ledger, RayLedger::default(), "uniform and unclipped light needs no rays");
}

/// The plainest renderer: rays from random places in the pixel through random places in the pupil hit a disc or not.
fn plainly_rendered(instrument: &Instrument, dot: &Dot, band: usize, rays_per_pixel: usize) -> Vec<f64> {
    let camera = Camera::new(instrument).unwrap();
    let [width_px, height_px] = instrument.sensor.size_px;
    let (mut rays, mut ledger) = (ObjectRays::default(), RayLedger::default());
    let mut state = 1_u64;
    let mut random = || {
        // Knuth's MMIX generator: shares nothing with the samples under test.
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut electrons = Vec::new();
    for pixel in 0..width_px * height_px {
        let [mut image_x_mm, mut image_y_mm, mut pupil_x, mut pupil_y] = [const { Vec::new() }; 4];
        for _ in 0..rays_per_pixel {
            let (u, v) = ((pixel % width_px) as f64 + random() - 0.5, (pixel / width_px) as f64 + random() - 0.5);
            let image = instrument.sensor.image_from_pixel(PixelPoint { u, v });
            let (radius, (sin, cos)) = (random().sqrt(), (2.0 * PI * random()).sin_cos());
            image_x_mm.push(image.x_mm);
            image_y_mm.push(image.y_mm);
            pupil_x.push(radius * cos);
            pupil_y.push(radius * sin);
        }
        let starts =
            RayStarts { image_x_mm: &image_x_mm, image_y_mm: &image_y_mm, pupil_x: &pupil_x, pupil_y: &pupil_y };
        camera.bands()[band].trace(starts, &mut rays, &mut ledger);
        let hits = (0..rays_per_pixel).filter(|&ray| {
            let from = [rays.x_mm[ray], rays.y_mm[ray], 0.0];
            rays.weight[ray] > 0.0 && hits(dot, from, [rays.slope_x[ray], rays.slope_y[ray], 1.0])
        });
        electrons.push(BRIGHTNESS_E * hits.count() as f64 / rays_per_pixel as f64);
    }
    electrons
}

/// Whether the line from `from` along `along` meets the disc.
fn hits(dot: &Dot, from: [f64; 3], along: [f64; 3]) -> bool {
    let dot_product = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let to_centre = [0, 1, 2].map(|axis| dot.centre_mm[axis] - from[axis]);
    let t = dot_product(dot.normal, to_centre) / dot_product(dot.normal, along);
    let off_centre = [0, 1, 2].map(|axis| from[axis] + t * along[axis] - dot.centre_mm[axis]);
    dot_product(off_centre, off_centre) < dot.radius_mm().powi(2)
}

#[test]
fn the_image_agrees_with_a_renderer_without_shortcuts() {
    // Clipped near the axis, tilted and defocused; and nearly in focus.
    let cases = [("y", 60.0, [1.6, 0.4], 330.0), ("x", 45.0, [-5.0, 3.0], 298.0), ("y", 0.0, [3.0, 0.0], 260.0)];
    for (axis, tilt_deg, [x_mm, y_mm], distance_mm) in cases {
        let text = format!(
            "schema = 1\nname = \"tilted\"\n[plate]\ndistance_mm = {distance_mm}\ntilt_deg = {tilt_deg}\n\
             tilt_axis = \"{axis}\"\npattern = \"grid\"\nrows = 21\ncolumns = 21\npitch_mm = 1.0\ndiameter_mm = 0.3\n"
        );
        let plate = Scene::from_toml(&text).unwrap();
        let distance = |dot: &&Dot| (dot.centre_mm[0] - x_mm).hypot(dot.centre_mm[1] - y_mm);
        let dot = plate.dots().iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
        for role in [Role::Telecentric, Role::Entocentric] {
            let instrument = window_around(role, dot.centre_mm, [64, 64]);
            let band = instrument.band_index(role);
            let plain = plainly_rendered(&instrument, dot, band, 1000);
            let fast = &expect(&instrument, &plate, 1024).pages[band];
            // Only pixels that the neighbours cannot reach.
            let near = |index: usize| (index % 64).abs_diff(32) < 15 && (index / 64).abs_diff(32) < 25;
            let pixels: Vec<usize> = (0..64 * 64).filter(|index| near(*index)).collect();
            let mean = |value: &dyn Fn(usize) -> f64| {
                pixels.iter().map(|index| value(*index)).sum::<f64>() / pixels.len() as f64
            };
            let bias = mean(&|index| fast[index] - plain[index]) / BRIGHTNESS_E;
            let rms = mean(&|index| (fast[index] - plain[index]).powi(2)).sqrt() / BRIGHTNESS_E;
            // 1000 random rays scatter by at most 0.016, and only where the edge runs.
            assert!(bias.abs() < 6e-4 && rms < 0.016, "{role:?}, tilt {tilt_deg} about {axis}: {bias} {rms}");
        }
    }
}

fn picture_scene(value: f32, dots: Vec<DotSpec>) -> Scene {
    let text = "schema = 1\nname = \"p\"\nbackground_e = 100.0\nbrightness_e = 1100.0\n[plate]\ndistance_mm = 300.0\n\
                tilt_deg = 20.0\npattern = \"image\"\nimage = \"grey.png\"\nwidth_mm = 16.0\n";
    let mut spec = Scene::from_toml(text).unwrap().spec().clone();
    spec.dots = dots;
    Scene::new(spec).unwrap().with_picture(Picture::new(3, 2, vec![value; 6]).unwrap()).unwrap()
}

#[test]
fn a_picture_shines_hides_and_is_hidden() {
    let at = |x_mm: f64, z_mm: f64| DotSpec { x_mm, y_mm: 0.0, z_mm, diameter_mm: 0.5 };
    let scene = picture_scene(0.25, vec![at(4.5, 320.0), at(6.0, 290.0)]);
    let instrument = window([1200.0, 560.0], [700, 80]);
    let page = &expect(&instrument, &scene, 64).pages[instrument.band_index(Role::Entocentric)];
    let seen = |x_mm: f64, z_mm: f64| {
        let image = instrument.projection(instrument.band(Role::Entocentric)).image([x_mm, 0.0, z_mm]);
        let pixel = instrument.sensor.pixel_from_image(image);
        page[pixel.v.round() as usize * 700 + pixel.u.round() as usize]
    };
    assert!((seen(3.8, 301.4) - 350.0).abs() < 1e-6, "a quarter grey");
    assert!((seen(4.5, 320.0) - 350.0).abs() < 1e-6, "the dot behind the picture is hidden");
    assert!((seen(6.0, 290.0) - 1100.0).abs() < 1e-6, "the dot before it is not");
    assert!((seen(7.8, 302.8) - 100.0).abs() < 1e-6, "ground beside the picture");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn light_is_finite_and_within_the_scene(
        places in prop::collection::vec((-3.0..3.0_f64, -3.0..3.0_f64, 1.0..2000.0_f64, 0.001..3.0_f64), 0..12),
        background_e in 0.0..3e4_f64, brightness_e in 0.0..3e4_f64, samples in 1..40_usize,
    ) {
        let dot = |&(x_mm, y_mm, z_mm, diameter_mm): &(f64, f64, f64, f64)| DotSpec { x_mm, y_mm, z_mm, diameter_mm };
        let dots = places.iter().map(dot).collect();
        let scene = Scene::new(SceneSpec { background_e, brightness_e, ..spec(dots) }).unwrap();
        let expectation = expect(&window([900.0, 500.0], [70, 50]), &scene, samples);
        let limit_e = background_e.max(brightness_e) * (1.0 + 1e-12);
        for electrons in expectation.pages.iter().flatten() {
            prop_assert!((0.0..=limit_e).contains(electrons), "{}", electrons);
        }
        prop_assert_eq!(expectation.ledger.total(), expectation.ledger.launched);
    }

    #[test]
    fn turning_the_scene_about_the_axis_turns_the_image(
        x_mm in 0.5..2.0_f64, y_mm in -1.0..1.0_f64, z_mm in 240.0..360.0_f64,
    ) {
        // Half a turn maps the pixels of a window centred on the axis onto each other; only the samples differ.
        let instrument = window([759.5, 499.5], [401, 201]);
        let (one, turned) = (one_dot([x_mm, y_mm, z_mm], 0.5), one_dot([-x_mm, -y_mm, z_mm], 0.5));
        let (one, turned) = (expect(&instrument, &one, 256), expect(&instrument, &turned, 256));
        for (one, turned) in one.pages.iter().zip(&turned.pages) {
            for (a, b) in one.iter().zip(turned.iter().rev()) {
                prop_assert!((a - b).abs() < 0.05 * BRIGHTNESS_E, "{} {}", a, b);
            }
            // Relative to an unclipped dot of 0.5 mm, whose image has a radius of 22 pixels.
            let (a, b): (f64, f64) = (one.iter().sum(), turned.iter().sum());
            prop_assert!((a - b).abs() <= 2e-3 * BRIGHTNESS_E * PI * 22.0 * 22.0, "{} {}", a, b);
        }
    }
}
