//! A double Gauss F/2 with both masks: what its aberrations leave of depth.
//!
//! Target: 0.02 mm rms of z over the dots of a plate, near, in focus and far. At 64 rays a pixel the frame itself is good to a
//! few µm.

use twinpupil_instrument::{Aperture, Instrument, Lens, PrescriptionLens, PrescriptionSpec, Zone, paper};
use twinpupil_optics::{ZmxLens, response_table_for};
use twinpupil_reconstruct::{Options, Reconstructor};
use twinpupil_simulate::{SimulateOptions, simulate};

/// Most that z of the dots of a plate may be off, rms.
const Z_RMS_MM: f64 = 0.02;

/// Least and most that errors of z over their deviations may be, rms over all plates.
const SIGMAS: [f64; 2] = [0.6, 1.5];

/// The paper's sensor and bands behind the lens of the walk-through, its masks as `twinpupil design` puts them.
fn instrument() -> Instrument {
    let lens = ZmxLens::read(include_bytes!("../../../../docs/lenses/double-gauss.zmx")).expect("a lens");
    let mask = |surface: usize, position_mm: f64, radius_mm: f64, inner: &str, outer: &str| Aperture {
        position_mm,
        surface: Some(surface),
        zones: vec![
            Zone { radius_mm: Some(radius_mm), pass: vec![inner.to_owned()] },
            Zone { radius_mm: None, pass: vec![outer.to_owned()] },
        ],
        centre_mm: [0.0; 2],
    };
    let mut spec = paper::instrument().into_spec();
    spec.lens = Lens::Prescription(Box::new(PrescriptionLens {
        prescription: Some(PrescriptionSpec::clone(&lens.prescription)),
        ..PrescriptionLens::default()
    }));
    spec.sensor.distance_mm = 150.0951;
    spec.apertures = vec![mask(5, 5.0, 0.61, "blue", "red"), mask(10, 61.6065, 0.33, "red", "blue")];
    Instrument::new(spec).expect("a legal camera")
}

#[test]
fn plates_through_a_double_gauss_are_read_as_well_as_asked_for() {
    let instrument = instrument();
    let table = response_table_for(&instrument).expect("a table");
    let reconstructor = Reconstructor::new(instrument.clone(), Some(table), Options::default());
    let mut sigmas = Vec::new();
    for (z_mm, seed) in [(265.0, 1), (300.0, 2), (335.0, 3)] {
        let scene = twinpupil_simulate::paper::random_plate(z_mm, seed).expect("a plate");
        let options = SimulateOptions { pupil_samples: 64, ..SimulateOptions::default() };
        let frame =
            simulate(&instrument, &scene, &instrument.response_matrix(), &options, &|_| {}).expect("a frame").frame;
        let found = reconstructor.reconstruct(&frame).expect("points");
        let errors_mm: Vec<f64> = (found.points.iter())
            .filter_map(|point| {
                let [x, y, z] = point.position_mm;
                let beside = |dot: &&twinpupil_simulate::Dot| (dot.centre_mm[0] - x).hypot(dot.centre_mm[1] - y);
                let dot = scene.dots().iter().min_by(|a, b| beside(a).total_cmp(&beside(b)))?;
                let error_mm = (beside(&dot) < 0.3).then_some(z - dot.centre_mm[2])?;
                sigmas.push(error_mm / point.std_mm[2]);
                Some(error_mm)
            })
            .collect();
        let rms_mm = (errors_mm.iter().map(|mm| mm * mm).sum::<f64>() / errors_mm.len() as f64).sqrt();
        assert!(errors_mm.len() >= 40, "{z_mm}: {} dots", errors_mm.len());
        assert!(rms_mm <= Z_RMS_MM, "{z_mm}: {rms_mm} mm");
    }
    let rms = (sigmas.iter().map(|sigmas| sigmas * sigmas).sum::<f64>() / sigmas.len() as f64).sqrt();
    assert!((SIGMAS[0]..SIGMAS[1]).contains(&rms), "{rms} deviations");
}
