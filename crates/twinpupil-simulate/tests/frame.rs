//! Whole frames: pages, codes, seeds, threads and what is refused.

#![allow(clippy::unwrap_used, reason = "helpers of tests may panic like the tests")]

use std::sync::atomic::{AtomicUsize, Ordering};

use twinpupil_instrument::{Instrument, Mosaic, ResponseMatrix, paper as paper_instrument};
use twinpupil_simulate::{
    Defects, Scene, SimulateError, SimulateOptions, Simulation, expected_electrons, paper, simulate, standard_errors,
};

const FAST: SimulateOptions = SimulateOptions {
    pupil_samples: 16,
    noiseless: false,
    seed: None,
    defects: Defects { dead: 0.0, hot: 0.0, seed: 0 },
};

/// The middle of the paper's sensor.
fn small(mosaic: Mosaic) -> Instrument {
    let mut spec = paper_instrument::instrument().into_spec();
    spec.sensor.mosaic = mosaic;
    spec.sensor.size_px = [641, 403];
    spec.sensor.axis_px = [320.0, 201.0];
    if mosaic == Mosaic::Mono {
        for (page, band) in spec.bands.iter_mut().enumerate() {
            band.plane = page.to_string();
        }
    }
    Instrument::new(spec).unwrap()
}

fn run(instrument: &Instrument, scene: &Scene, options: &SimulateOptions) -> Simulation {
    simulate(instrument, scene, &ResponseMatrix::ideal(&instrument.bands), options, &|_| {}).unwrap()
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads() {
    let (instrument, scene) = (small(Mosaic::Rggb), paper::random_plate(270.0, 4).unwrap());
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&instrument, &scene, &FAST))
    };
    let (one, three) = (on(1), on(3));
    assert_eq!(one, three);
    let other = run(&instrument, &scene, &SimulateOptions { seed: Some(5), ..FAST });
    assert_ne!(one.frame, other.frame);
    assert_eq!(one.frame, run(&instrument, &scene, &SimulateOptions { seed: Some(4), ..FAST }).frame);
}

#[test]
fn standard_errors_tell_how_far_pixels_are_off() {
    let mut spec = small(Mosaic::Rgb).into_spec();
    (spec.sensor.size_px, spec.sensor.axis_px) = ([240, 160], [-80.0, 80.0]);
    let (instrument, scene) = (Instrument::new(spec).unwrap(), paper::random_plate(270.0, 4).unwrap());
    let response = ResponseMatrix::ideal(&instrument.bands);
    let electrons = |samples| expected_electrons(&instrument, &scene, &response, samples, &|_| {}).unwrap().pages;
    let errors = |samples| standard_errors(&instrument, &scene, &response, samples, &|_| {}).unwrap();
    let (few, many, of_few) = (electrons(64), electrons(1024), errors(64));
    let pixels = || {
        few.iter().zip(&many).zip(&of_few).flat_map(|((few, many), errors)| {
            few.iter().zip(many).zip(errors).map(|((few, many), error)| (few - many, *error))
        })
    };
    let rms = |of: &dyn Fn(f64, f64) -> Option<f64>| {
        let values: Vec<f64> = pixels().filter_map(|(off_e, error_e)| of(off_e, error_e)).collect();
        (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
    };
    // Where all rays agree, hardly any others would not.
    let unseen_e = rms(&|off_e, error_e| (error_e == 0.0).then_some(off_e));
    let [off_e, error_e] = [0, 1].map(|k| rms(&|off_e, error_e| (error_e > 0.0).then_some([off_e, error_e][k])));
    assert!(unseen_e < 1.0 && (0.8..1.25).contains(&(off_e / error_e)), "{unseen_e} {off_e} {error_e}");
    let of_more: f64 = errors(256).iter().flatten().sum();
    assert!(of_more < 0.5 * of_few.iter().flatten().sum::<f64>());
}

#[test]
fn a_fresnel_lens_accounts_for_every_ray() {
    let text = paper_instrument::INSTRUMENT_TOML.replacen("model = \"thin\"", "model = \"fresnel\"", 1);
    let mut spec = Instrument::from_toml(&text).unwrap().into_spec();
    (spec.sensor.size_px, spec.sensor.axis_px) = ([240, 160], [-240.0, 80.0]);
    let instrument = Instrument::new(spec).unwrap();
    let scene = paper::random_plate(270.0, 4).unwrap();
    let Simulation { frame, ledger } = run(&instrument, &scene, &FAST);
    assert!(ledger.launched > 0 && ledger.total() == ledger.launched, "{ledger:?}");
    assert!(ledger.arrived < ledger.launched, "some rays meet a groove's wall");
    let brightest = frame.pages()[0].iter().max();
    assert!(brightest > Some(&1500), "{brightest:?}");
}

#[test]
fn every_mosaic_has_its_pages() {
    let scene = paper::twenty_two_dots(260.0).unwrap();
    for (mosaic, pages) in [(Mosaic::Rggb, 1), (Mosaic::Gbrg, 1), (Mosaic::Rgb, 3), (Mosaic::Mono, 2)] {
        let instrument = small(mosaic);
        let frame = run(&instrument, &scene, &FAST).frame;
        assert_eq!((frame.pages().len(), frame.width_px(), frame.height_px()), (pages, 641, 403));
        for band in &instrument.bands {
            let plane = frame.plane(mosaic, &band.plane).unwrap();
            let brightest = (0..plane.rows).flat_map(|row| plane.row(row)).max();
            assert!(brightest > Some(2000), "{mosaic:?}, {}: {brightest:?}", band.name);
        }
    }
}

#[test]
fn mosaic_pixels_are_those_of_the_full_planes() {
    let scene = paper::twenty_two_dots(260.0).unwrap();
    let noiseless = SimulateOptions { noiseless: true, ..FAST };
    let full = run(&small(Mosaic::Rgb), &scene, &noiseless).frame;
    let mosaic = run(&small(Mosaic::Rggb), &scene, &noiseless).frame;
    for plane in ["r", "b"] {
        let (full, view) = (full.plane(Mosaic::Rgb, plane).unwrap(), mosaic.plane(Mosaic::Rggb, plane).unwrap());
        for row in 0..view.rows {
            let expected = full.row(view.origin_px[1] + 2 * row).skip(view.origin_px[0]).step_by(2);
            assert!(view.row(row).eq(expected), "plane {plane}, row {row}");
        }
    }
}

#[test]
fn a_bright_scene_saturates() {
    let text = "schema = 1\nname = \"sun\"\nbackground_e = 1e6\nbrightness_e = 0.0\n";
    let instrument = small(Mosaic::Mono);
    let frame = run(&instrument, &Scene::from_toml(text).unwrap(), &FAST).frame;
    assert_eq!(frame.pages()[0][0], frame.code_max());
}

#[test]
fn an_empty_scene_is_read_noise() {
    let text = "schema = 1\nname = \"night\"\n";
    let simulation = run(&small(Mosaic::Rggb), &Scene::from_toml(text).unwrap(), &FAST);
    assert_eq!(simulation.ledger.launched, 0);
    assert!(simulation.frame.pages()[0].iter().any(|code| *code > 0));
    assert!(simulation.frame.pages()[0].iter().all(|code| *code < 10));
}

#[test]
fn progress_ends_at_one() {
    let (instrument, scene) = (small(Mosaic::Rggb), paper::random_plate(300.0, 4).unwrap());
    let (calls, complete) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let progress = |share: f64| {
        assert!((0.0..=1.0).contains(&share));
        calls.fetch_add(1, Ordering::Relaxed);
        complete.fetch_add(usize::from(share == 1.0), Ordering::Relaxed);
    };
    simulate(&instrument, &scene, &ResponseMatrix::ideal(&instrument.bands), &FAST, &progress).unwrap();
    assert!(calls.into_inner() > 10);
    assert_eq!(complete.into_inner(), 1);
}

#[test]
fn what_cannot_be_simulated_is_refused_in_one_sentence() {
    let (instrument, scene) = (small(Mosaic::Rggb), paper::random_plate(300.0, 4).unwrap());
    let ideal = ResponseMatrix::ideal(&instrument.bands);
    let refuse = |scene: &Scene, response: &ResponseMatrix, pupil_samples| {
        let options = SimulateOptions { pupil_samples, ..FAST };
        simulate(&instrument, scene, response, &options, &|_| {}).expect_err("must be refused")
    };
    for samples in [0, 65_537] {
        let message = refuse(&scene, &ideal, samples).to_string();
        assert_eq!(message, format!("`pupil samples` is {samples}; legal: 1 to 65536"));
    }
    let one_band = ResponseMatrix::ideal(&instrument.bands[..1]);
    assert!(refuse(&scene, &one_band, 16).to_string().contains("bands of the response matrix"));
    let text = "schema = 1\nname = \"i\"\n[plate]\ndistance_mm = 250.0\npattern = \"image\"\nimage = \"leaf.png\"\n\
                width_mm = 12.0\n";
    let error = refuse(&Scene::from_toml(text).unwrap(), &ideal, 16);
    assert_eq!(error, SimulateError::NoPicture { path: "leaf.png".to_owned() });
}
