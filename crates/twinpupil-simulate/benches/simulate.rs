//! How long a frame of the paper's camera takes: 1920 × 1200 pixels, 60 dots.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use twinpupil_instrument::{ResponseMatrix, paper as paper_instrument};
use twinpupil_simulate::{Scene, SimulateOptions, paper, simulate};

/// 20 000 dots of 0.08 mm, as a bound on what many features cost.
const CROWD_TOML: &str = "schema = 1\nname = \"crowd\"\n[plate]\ndistance_mm = 300.0\npattern = \"grid\"\n\
    rows = 125\ncolumns = 160\npitch_mm = 0.12\ndiameter_mm = 0.08\n";

fn frames(criterion: &mut Criterion) {
    let instrument = paper_instrument::instrument();
    let response = ResponseMatrix::ideal(&instrument.bands);
    let mut group = criterion.benchmark_group("simulate");
    group.sample_size(10);
    let mut frame = |name: &str, scene: Scene, pupil_samples| {
        let options = SimulateOptions { pupil_samples, ..SimulateOptions::default() };
        group.bench_function(name, |bencher| {
            bencher.iter(|| simulate(&instrument, black_box(&scene), &response, &options, &|_| {}).expect("legal"));
        });
    };
    for z_mm in [250.0, 300.0] {
        for pupil_samples in [64, 256] {
            let scene = paper::random_plate(z_mm, 1).expect("60 dots fit");
            frame(&format!("plate at {z_mm}, {pupil_samples} samples"), scene, pupil_samples);
        }
    }
    frame("plate tilted by 45°, 256 samples", paper::tilted_plate(45.0, 1).expect("60 dots fit"), 256);
    frame("20 000 dots, 64 samples", Scene::from_toml(CROWD_TOML).expect("legal"), 64);
    group.finish();
}

criterion_group!(benches, frames);
criterion_main!(benches);
