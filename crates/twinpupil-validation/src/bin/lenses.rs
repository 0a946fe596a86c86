//! Traces a double Gauss again and again and prints ray-surfaces per second as JSON, with what other programs need to do the
//! same, for `bench/lenses`: `lenses [--repeats N]`.

use std::error::Error;
use std::io::{self, Write};
use std::{env, thread};

use cpu_time::ThreadTime;
use serde::Serialize;
use twinpupil_instrument::{Glass, Prescription, Shape};
use twinpupil_optics::{Ray, Rays, Train};

const LENS: &str = include_str!("../../../twinpupil-optics/tests/lenses/double-gauss.toml");
const WAVELENGTH_NM: f64 = 587.6;

/// Rays of a batch: what a few pixels with their pupil samples make.
const RAYS: usize = 4096;

/// The beam: radius and centre before the first surface, and its slope along y.
const RADIUS_MM: f64 = 10.0;
const CENTRE_MM: [f64; 2] = [0.0, -10.2];
const FIELD_DEG: f64 = 10.0;

#[derive(Debug, Serialize)]
struct Bench {
    surfaces: Vec<Surface>,
    starts: Vec<[f64; 6]>,
    image_mm: Vec<[f64; 2]>,
    /// Surfaces that a ray meets, the image included.
    met: usize,
    /// Ray-surfaces per second of processor time.
    one_thread_per_s: f64,
    two_threads_over_one: f64,
}

/// Curvature, distance to the next surface and index behind.
#[derive(Debug, Serialize)]
struct Surface {
    curvature_per_mm: f64,
    gap_mm: f64,
    index_behind: f64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let repeats = match &env::args().skip(1).collect::<Vec<_>>()[..] {
        [] => 300,
        [option, count] if option == "--repeats" => count.parse()?,
        _ => return Err("usage: lenses [--repeats N]".into()),
    };
    let lens = Prescription::from_toml(LENS)?;
    let train = Train::new(&lens, &[], WAVELENGTH_NM)?;
    let starts = starts();
    let mut rays = starts.clone();
    train.trace(&mut rays);
    let bench = Bench {
        surfaces: surfaces(&lens)?,
        starts: starts.iter().map(|(ray, _)| six(&ray)).collect(),
        image_mm: rays.iter().map(|(ray, _)| [ray.position_mm[0], ray.position_mm[1]]).collect(),
        met: train.len(),
        one_thread_per_s: (RAYS * train.len()) as f64 / least_thread_time_s(&train, &starts, repeats),
        two_threads_over_one: two_threads_over_one(&train, &starts, repeats),
    };
    serde_json::to_writer(io::stdout().lock(), &bench)?;
    Ok(writeln!(io::stdout())?)
}

fn starts() -> Rays {
    let (sin, cos) = FIELD_DEG.to_radians().sin_cos();
    let rays = (0..RAYS).map(|k| {
        let radius_mm = RADIUS_MM * ((k as f64 + 0.5) / RAYS as f64).sqrt();
        // The golden angle fills the disc evenly.
        let (turn_sin, turn_cos) = (2.399963 * k as f64).sin_cos();
        Ray::new([CENTRE_MM[0] + radius_mm * turn_cos, CENTRE_MM[1] + radius_mm * turn_sin, 0.0], [0.0, sin, cos])
    });
    rays.collect()
}

fn six(ray: &Ray) -> [f64; 6] {
    let ([x, y, z], [dx, dy, dz]) = (ray.position_mm, ray.direction);
    [x, y, z, dx, dy, dz]
}

fn surfaces(lens: &Prescription) -> Result<Vec<Surface>, Box<dyn Error>> {
    let surface = |surface: &twinpupil_instrument::SurfaceSpec| {
        let curvature_per_mm = match surface.shape {
            Shape::Sphere { radius_mm } => 1.0 / radius_mm,
            _ => 0.0,
        };
        let glass =
            if surface.medium == "air" { Glass::air() } else { Glass::built_in(&surface.medium, "medium")?.clone() };
        Ok(Surface { curvature_per_mm, gap_mm: surface.gap_mm, index_behind: glass.index(WAVELENGTH_NM)? })
    };
    lens.surfaces.iter().map(surface).collect()
}

/// Least processor time of a batch, s: other programs may run beside. Rays are put in their places beforehand, as those of the
/// other programs are.
fn least_thread_time_s(train: &Train, starts: &Rays, repeats: usize) -> f64 {
    let mut rays = starts.clone();
    let mut once = || {
        rays.clone_from(starts);
        let start = ThreadTime::now();
        train.trace(&mut rays);
        start.elapsed().as_secs_f64()
    };
    (0..repeats * BATCHES).map(|_| once()).fold(f64::INFINITY, f64::min)
}

/// Batches for each repetition.
const BATCHES: usize = 10;

/// How much more two threads trace than one, side by side and each by its own processor time: what they take from each other
/// in caches and memory counts, what other programs take from them does not.
fn two_threads_over_one(train: &Train, starts: &Rays, repeats: usize) -> f64 {
    let busy_s = || {
        let mut rays = starts.clone();
        let start = ThreadTime::now();
        for _ in 0..20 * BATCHES {
            rays.clone_from(starts);
            train.trace(&mut rays);
        }
        start.elapsed().as_secs_f64()
    };
    let rate = |threads: usize| {
        thread::scope(|scope| {
            let running: Vec<_> = (0..threads).map(|_| scope.spawn(busy_s)).collect();
            running.into_iter().filter_map(|thread| thread.join().ok()).map(f64::recip).sum::<f64>()
        })
    };
    let best = |threads: usize| (0..repeats.div_ceil(10)).map(|_| rate(threads)).fold(0.0, f64::max);
    best(2) / best(1)
}
