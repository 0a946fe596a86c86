//! Time to find, pair and place the dots of one frame, on one thread, without reading the file.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use twinpupil_instrument::{Role, paper};
use twinpupil_optics::response_table_for;
use twinpupil_reconstruct::{Mode, Options, Reconstructor};
use twinpupil_simulate::{DotSpec, Scene, SceneSpec};
use twinpupil_validation::plates::Pose;
use twinpupil_validation::rig::{Rig, dots};

fn reconstructor(mode: Mode) -> Reconstructor {
    let instrument = paper::instrument();
    let table = response_table_for(&instrument).expect("traceable");
    Reconstructor::new(instrument, Some(table), Options { mode, ..Options::default() })
}

/// 2000 dots of 12 px.
fn many_dots() -> Scene {
    let dot = |k: usize| DotSpec {
        x_mm: 0.36 * ((k % 54) as f64 - 26.5),
        y_mm: 0.36 * ((k / 54) as f64 - 18.0),
        z_mm: 298.0,
        diameter_mm: 0.138,
    };
    let spec = SceneSpec { dots: (0..2000).map(dot).collect(), ..dots(&[]).spec().clone() };
    Scene::new(spec).expect("legal dots")
}

fn frames(criterion: &mut Criterion) {
    let rig = Rig::new(paper::instrument(), Mode::Centroid);
    let mut group = criterion.benchmark_group("one frame of 1920 × 1200");
    group.throughput(Throughput::Elements(1)).sample_size(20);
    for (name, scene) in [
        ("60 dots at 250", Pose::Facing(250.0).scene(1)),
        ("60 dots at 300", Pose::Facing(300.0).scene(1)),
        ("60 dots at 350", Pose::Facing(350.0).scene(1)),
        ("60 dots tilted 45°", Pose::Tilted(45.0).scene(1)),
        ("2000 dots of 12 px", many_dots()),
    ] {
        let frame = rig.frame(&scene, Some(1));
        for mode in [Mode::Centroid, Mode::Paper] {
            let reconstructor = reconstructor(mode);
            group.bench_function(format!("{mode:?}, {name}"), |bencher| {
                bencher.iter(|| reconstructor.reconstruct(black_box(&frame)).expect("a frame of this camera"));
            });
        }
        for (estimator, mode) in [("rough", Mode::Model), ("Cartesian", Mode::Centroid), ("radial", Mode::Paper)] {
            let reconstructor = reconstructor(mode);
            group.bench_function(format!("detect one plane, {estimator}, {name}"), |bencher| {
                bencher.iter(|| {
                    reconstructor.detect(black_box(&frame), Role::Telecentric).expect("a frame of this camera")
                });
            });
        }
        let reconstructor = reconstructor(Mode::Centroid);
        let [telecentric, entocentric] = [Role::Telecentric, Role::Entocentric]
            .map(|role| reconstructor.detect(&frame, role).expect("a frame of this camera"));
        group.bench_function(format!("pair and place, {name}"), |bencher| {
            bencher.iter(|| reconstructor.points_from(&[telecentric.clone(), entocentric.clone()]));
        });
    }
    group.finish();
}

criterion_group!(benches, frames);
criterion_main!(benches);
