//! Rays through a double Gauss lens of eleven surfaces and its image plane: time of one ray-surface is that of a batch
//! over 12 × 4096.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use twinpupil_instrument::Prescription;
use twinpupil_optics::{Ray, Rays, Train};

const RAYS: usize = 4096;

/// Rays that fill the entrance pupil, 10° off the axis.
fn field() -> Rays {
    let (sin, cos) = 10_f64.to_radians().sin_cos();
    let rays = (0..RAYS).map(|k| {
        let (radius_mm, turn_rad) = (10.0 * ((k as f64 + 0.5) / RAYS as f64).sqrt(), 2.399_963 * k as f64);
        let at_mm = [radius_mm * turn_rad.cos(), radius_mm * turn_rad.sin() - 10.2, 0.0];
        Ray::new(at_mm, [0.0, sin, cos])
    });
    rays.collect()
}

fn double_gauss(criterion: &mut Criterion) {
    let lens = Prescription::from_toml(include_str!("../tests/lenses/double-gauss.toml")).expect("a lens");
    let train = Train::new(&lens, &[], 587.6).expect("glasses that ship");
    let (starts, mut rays) = (field(), field());
    let mut group = criterion.benchmark_group("double-gauss");
    group.throughput(Throughput::Elements((RAYS * train.len()) as u64));
    group.bench_function("one-thread", |bencher| {
        bencher.iter(|| {
            rays.clone_from(&starts);
            train.trace(&mut rays).arrived
        });
    });
    group.finish();
}

criterion_group!(benches, double_gauss);
criterion_main!(benches);
