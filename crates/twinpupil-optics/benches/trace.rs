//! Time a ray takes through the camera, and time the response of the optics takes.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use twinpupil_instrument::{Instrument, paper};
use twinpupil_optics::{Camera, ObjectRays, RayLedger, RayStarts, response_table_for};

/// Rays of one call: 16 pixels with 256 pupil points each.
const RAYS: usize = 4096;

fn trace(criterion: &mut Criterion) {
    // A spiral over the pupil that is uniform in area: the golden angle, and the root of the index.
    let pupil = |k: usize| (((k % 256) as f64 + 0.5) / 256.0).sqrt();
    let pupil_x: Vec<f64> = (0..RAYS).map(|k| pupil(k) * (2.399_963 * k as f64).cos()).collect();
    let pupil_y: Vec<f64> = (0..RAYS).map(|k| pupil(k) * (2.399_963 * k as f64).sin()).collect();
    let image_x_mm: Vec<f64> = (0..RAYS).map(|k| (k / 256) as f64 * 0.25 - 2.0).collect();
    let image_y_mm = vec![0.3; RAYS];
    let starts = RayStarts { image_x_mm: &image_x_mm, image_y_mm: &image_y_mm, pupil_x: &pupil_x, pupil_y: &pupil_y };
    let mut group = criterion.benchmark_group("trace");
    group.throughput(Throughput::Elements(RAYS as u64));
    let fresnel = paper::INSTRUMENT_TOML.replacen("model = \"thin\"", "model = \"fresnel\"", 1);
    let fresnel = Instrument::from_toml(&fresnel).expect("the paper's camera with its real lens");
    for (model, instrument) in [("thin", paper::instrument()), ("fresnel", fresnel)] {
        let camera = Camera::new(&instrument).expect("the paper's camera");
        for band in camera.bands() {
            let (mut rays, mut ledger) = (ObjectRays::default(), RayLedger::default());
            group.bench_function(format!("{model} {}", band.name()), |bencher| {
                bencher.iter(|| {
                    band.trace(black_box(starts), &mut rays, &mut ledger);
                    black_box(&rays);
                });
            });
        }
    }
    group.finish();
}

fn response(criterion: &mut Criterion) {
    let instrument = paper::instrument();
    let optics = Camera::new(&instrument).expect("the paper's camera");
    let band = &optics.bands()[0];
    criterion
        .bench_function("point image thin", |bencher| bencher.iter(|| band.point_image(black_box([2.0, 0.0, 320.0]))));
    criterion
        .bench_function("response table thin", |bencher| bencher.iter(|| response_table_for(black_box(&instrument))));
}

criterion_group!(benches, trace, response);
criterion_main!(benches);
