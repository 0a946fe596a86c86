//! The Cramér–Rao bound against closed forms and against differences of whole frames.

#![allow(clippy::unwrap_used, reason = "helpers of tests may panic like the tests")]

use std::f64::consts::PI;

use twinpupil_instrument::{Band, Instrument, Mosaic, ResponseMatrix, paper as paper_instrument};
use twinpupil_simulate::{Bound, DotInformation, DotSpec, Scene, SceneSpec, dot_bounds, expected_electrons};

const BRIGHTNESS_E: f64 = 20_000.0;
const SAMPLES: usize = 256;

/// The part of the paper's sensor around a place, in whole pixels from the axis.
fn sensor_part(mosaic: Mosaic, from_axis_px: [f64; 2], size_px: [usize; 2]) -> Instrument {
    let mut spec = paper_instrument::instrument().into_spec();
    spec.sensor.mosaic = mosaic;
    spec.sensor.size_px = size_px;
    spec.sensor.axis_px = from_axis_px.map(|distance_px| -distance_px);
    if mosaic == Mosaic::Mono {
        for (page, band) in spec.bands.iter_mut().enumerate() {
            band.plane = page.to_string();
        }
    }
    Instrument::new(spec).unwrap()
}

/// Both images of dots about (7, 0, 250), and of their neighbours towards −y.
fn far_right(mosaic: Mosaic) -> Instrument {
    sensor_part(mosaic, [540.0, -230.0], [260, 360])
}

fn scene(dots: &[[f64; 4]], background_e: f64, brightness_e: f64) -> Scene {
    let dot = |&[x_mm, y_mm, z_mm, diameter_mm]: &[f64; 4]| DotSpec { x_mm, y_mm, z_mm, diameter_mm };
    let dots = dots.iter().map(dot).collect();
    let name = "test".to_owned();
    let light =
        SceneSpec { schema: 1, name, seed: 1, background_e, brightness_e, illumination: None, dots, plate: None };
    Scene::new(light).unwrap()
}

fn information(instrument: &Instrument, scene: &Scene) -> DotInformation {
    DotInformation::new(instrument, scene, &ResponseMatrix::ideal(&instrument.bands), SAMPLES).unwrap()
}

fn lone_std_mm(instrument: &Instrument, dot: [f64; 4], brightness_e: f64) -> [f64; 3] {
    information(instrument, &scene(&[dot], 0.0, brightness_e)).lone_bound(0).unwrap().std_mm()
}

/// Smallest deviation of the position of a blurred disc along one axis, px.
///
/// A disc of radius R blurred by a pupil of radius ρ is the share of the pupil's circle, q from the centre, that lies in
/// the disc's, and falls with q by the length of the chord that the circles have in common:
///
/// ```text
/// E(q) = b A(q)/(π ρ²)     E'(q) = −b · 2 √(ρ² − h²)/(π ρ²)     h = (q² + ρ² − R²)/(2 q)
/// A(q) = ρ² acos(h/ρ) − h √(ρ² − h²) + R² acos(k/R) − k √(R² − k²)     k = q − h
/// 1/σ² = ∮ cos²θ dθ ∫ E'²/(E + σ_dark²) q dq = π ∫ E'²/(E + σ_dark²) q dq
/// ```
fn disc_std_px(instrument: &Instrument, band: &Band, dot: [f64; 4]) -> f64 {
    const STEPS: usize = 20_000;
    let [_, _, z_mm, diameter_mm] = dot;
    let (sensor, projection) = (&instrument.sensor, instrument.projection(band));
    let r = 0.5 * diameter_mm * projection.magnification(z_mm) / sensor.pitch_mm;
    let rho = projection.blur_radius_mm(z_mm) / sensor.pitch_mm;
    let dark_e2 = sensor.read_noise_e.powi(2) + sensor.electrons_per_code().powi(2) / 12.0;
    let per_step = |step: usize| {
        let q = r - rho + 2.0 * rho * (step as f64 + 0.5) / STEPS as f64;
        let h = (q * q + rho * rho - r * r) / (2.0 * q);
        let (k, half_chord) = (q - h, (rho * rho - h * h).sqrt());
        let area = rho * rho * (h / rho).acos() + r * r * (k / r).acos() - q * half_chord;
        let unit_e = BRIGHTNESS_E / (PI * rho * rho);
        (unit_e * 2.0 * half_chord).powi(2) / (unit_e * area + dark_e2) * q
    };
    (PI * (0..STEPS).map(per_step).sum::<f64>() * 2.0 * rho / STEPS as f64).powf(-0.5)
}

#[test]
fn a_wide_edge_far_from_the_axis_has_the_closed_form() {
    // The sizes of both images tell the depth, too, which makes up 1 % of all.
    const TOLERANCE: f64 = 0.02;
    let (instrument, dot) = (far_right(Mosaic::Rgb), [7.0, 0.0, 250.0, 1.0]);
    let [x_mm, _, z_mm, _] = dot;
    let [telecentric, entocentric] = [0, 1].map(|index| {
        let band = &instrument.bands[index];
        let image_px = instrument.projection(band).magnification(z_mm) / instrument.sensor.pitch_mm;
        (disc_std_px(&instrument, band, dot), image_px)
    });
    // x = u_R/m_R; y is the mean of both; ln z = ln u_R − ln u_B.
    let in_object = |(std_px, per_mm): (f64, f64)| std_px / per_mm;
    let relative = |band| in_object(band) / x_mm;
    let [weight, other] = [telecentric, entocentric].map(|band| in_object(band).powi(-2));
    let expected = [
        in_object(telecentric),
        (weight + other).powf(-0.5),
        z_mm * relative(telecentric).hypot(relative(entocentric)),
    ];
    let found = lone_std_mm(&instrument, dot, BRIGHTNESS_E);
    for (found, expected) in found.into_iter().zip(expected) {
        assert!((found / expected - 1.0).abs() < TOLERANCE, "{found} is not {expected}");
    }
}

#[test]
fn the_bound_is_that_of_differences_of_whole_frames() {
    // Unclipped; clipped so near the axis that the middle of the dot is darker in one band. Bright ground keeps the
    // faint ends of the edges from weighing much.
    for dot in [[7.0, 0.1, 255.0, 0.8], [2.2, 0.3, 340.0, 1.0]] {
        let (instrument, [x_mm, y_mm, z_mm, d_mm]) = match dot[0] > 5.0 {
            true => (far_right(Mosaic::Mono), dot),
            false => (sensor_part(Mosaic::Mono, [80.0, -80.0], [210, 200]), dot),
        };
        let (ground_e, steps_mm) = (1000.0, [1e-4, 1e-4, 1e-2, 2e-4]);
        let render = |dot: [f64; 4], ground_e, dot_e| {
            let response = ResponseMatrix::ideal(&instrument.bands);
            expected_electrons(&instrument, &scene(&[dot], ground_e, dot_e), &response, SAMPLES, &|_| {}).unwrap().pages
        };
        let mut columns: Vec<Vec<f64>> = Vec::new();
        for unknown in 0..4 {
            let moved = |sign: f64| {
                let mut dot = [x_mm, y_mm, z_mm, d_mm];
                dot[unknown] += sign * steps_mm[unknown];
                render(dot, ground_e, BRIGHTNESS_E).concat()
            };
            let slope = |(plus, minus): (&f64, &f64)| (plus - minus) / (2.0 * steps_mm[unknown]);
            columns.push(moved(1.0).iter().zip(&moved(-1.0)).map(slope).collect());
        }
        for pages in [render(dot, 0.0, 1.0), render(dot, 1.0, 1.0)] {
            let dark = vec![0.0; pages[0].len()];
            columns.push([pages[0].clone(), dark.clone()].concat());
            columns.push([dark, pages[1].clone()].concat());
        }
        let electrons = render(dot, ground_e, BRIGHTNESS_E).concat();
        let sensor = &instrument.sensor;
        let dark_e2 = sensor.read_noise_e.powi(2) + sensor.electrons_per_code().powi(2) / 12.0;
        let product = |a: &[f64], b: &[f64]| -> f64 {
            let pixels = a.iter().zip(b).zip(&electrons);
            pixels.map(|((a, b), e)| a * b / (e + dark_e2)).sum()
        };
        let fisher = columns.iter().map(|a| columns.iter().map(|b| product(a, b)).collect()).collect();
        let expected = inverse(fisher);
        let found = information(&instrument, &scene(&[dot], ground_e, BRIGHTNESS_E)).lone_bound(0).unwrap();
        for i in 0..3 {
            for j in 0..3 {
                let scale = (expected[i][i] * expected[j][j]).sqrt();
                let error = (found.covariance_mm2[i][j] - expected[i][j]).abs() / scale;
                // The frames have more ground around the dot, and a width of the blurred edge that changes with z and
                // the direction of the edge.
                assert!(error < 0.012, "{dot:?}, {i}, {j}: {error}");
            }
        }
    }
}

/// Gauss and Jordan's inverse of a positive definite matrix.
fn inverse(mut matrix: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let n = matrix.len();
    let mut right: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|j| f64::from(u8::from(i == j))).collect()).collect();
    for k in 0..n {
        let pivot = matrix[k][k];
        matrix[k].iter_mut().chain(&mut right[k]).for_each(|value| *value /= pivot);
        let (matrix_row, right_row) = (matrix[k].clone(), right[k].clone());
        for i in (0..n).filter(|i| *i != k) {
            let factor = matrix[i][k];
            matrix[i].iter_mut().zip(&matrix_row).for_each(|(value, pivot)| *value -= factor * pivot);
            right[i].iter_mut().zip(&right_row).for_each(|(value, pivot)| *value -= factor * pivot);
        }
    }
    right
}

#[test]
fn four_times_the_light_halves_the_bound_where_photons_are_all_noise() {
    let mut spec = far_right(Mosaic::Rgb).into_spec();
    (spec.sensor.read_noise_e, spec.sensor.bit_depth, spec.sensor.full_well_e) = (0.0, 16, 1e6);
    let mut photons = |bits: u8, brightness_e: f64| {
        // The share of rounding in the noise stays what it is.
        spec.sensor.bit_depth = bits;
        lone_std_mm(&Instrument::new(spec.clone()).unwrap(), [7.0, 0.0, 250.0, 1.0], brightness_e)
    };
    let (faint, bright) = (photons(16, 5e4), photons(15, 2e5));
    for (faint, bright) in faint.into_iter().zip(bright) {
        assert!((faint / bright - 2.0).abs() < 1e-3, "{faint} {bright}");
    }
}

#[test]
fn a_quarter_of_the_pixels_doubles_the_bound() {
    let dot = [7.0, 0.0, 250.0, 1.0];
    let all = lone_std_mm(&far_right(Mosaic::Rgb), dot, BRIGHTNESS_E);
    for mosaic in [Mosaic::Rggb, Mosaic::Gbrg] {
        let quarter = lone_std_mm(&far_right(mosaic), dot, BRIGHTNESS_E);
        for (all, quarter) in all.into_iter().zip(quarter) {
            assert!((quarter / all - 2.0).abs() < 0.03, "{quarter} {all}");
        }
    }
}

#[test]
fn unknown_neighbours_cost_something_and_far_ones_nothing() {
    // The skirts of the first two overlap, the third stands alone.
    let dots = [[7.0, 0.34, 250.0, 1.0], [7.0, -0.68, 250.0, 1.0], [6.9, -1.8, 250.0, 0.2]];
    let information = information(&far_right(Mosaic::Rgb), &scene(&dots, 0.0, BRIGHTNESS_E));
    assert_eq!([0, 1, 2].map(|dot| information.neighbours(dot).to_vec()), [vec![1], vec![0], vec![]]);
    assert_eq!(information.joint_bound(2), information.lone_bound(2));
    let std = |bound: Option<Bound>| bound.unwrap().std_mm();
    let (joint, lone) = (std(information.joint_bound(0)), std(information.lone_bound(0)));
    for (joint, lone) in joint.into_iter().zip(lone) {
        assert!(joint > 1.0001 * lone && joint < 1.5 * lone, "{joint} {lone}");
    }
    assert_eq!((information.joint_bound(3), information.neighbours(3).len()), (None, 0));
}

#[test]
fn saturation_costs_information_until_nothing_is_left() {
    let dot = [7.0, 0.0, 250.0, 1.0];
    let with_full_well = |full_well_e| {
        let mut spec = far_right(Mosaic::Rgb).into_spec();
        (spec.sensor.full_well_e, spec.sensor.bit_depth) = (full_well_e, 16);
        Instrument::new(spec).unwrap()
    };
    let [deep, shallow] = [40_000.0, 10_000.0].map(|full_well_e| lone_std_mm(&with_full_well(full_well_e), dot, 2e4));
    for (deep, shallow) in deep.into_iter().zip(shallow) {
        assert!(shallow > 1.05 * deep && shallow < 2.0 * deep, "{shallow} {deep}");
    }
    let blind = information(&with_full_well(10_000.0), &scene(&[dot], 1e4, 2e4));
    assert_eq!(blind.lone_bound(0), None);
}

#[test]
fn dots_that_are_not_wholly_on_the_sensor_have_no_bound() {
    // The entocentric image of the first is cut by the border, that of the second beside it; the third is invisible.
    let instrument = far_right(Mosaic::Rggb);
    let response = ResponseMatrix::ideal(&instrument.bands);
    let bounds = |dots: &[[f64; 4]], dot_e| dot_bounds(&instrument, &scene(dots, 50.0, dot_e), &response, 64).unwrap();
    assert_eq!(bounds(&[[7.9, 0.0, 260.0, 0.5], [7.9, 0.0, 230.0, 0.5]], 1000.0), [None, None]);
    assert!(bounds(&[[7.0, 0.0, 250.0, 0.5]], 1000.0)[0].is_some());
    assert_eq!(bounds(&[[7.0, 0.0, 250.0, 0.5]], 50.0), [None]);
    assert!(bounds(&[], 1000.0).is_empty());
}
