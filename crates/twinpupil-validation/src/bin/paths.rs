//! Simulates plates through real lenses on one thread and prints how many paths from the sensor through the lens to the scene
//! a second of processor time holds, everything included: launch, surfaces, masks, dots and sums. `paths [--repeats N]`.

use std::error::Error;
use std::io::{self, Write};
use std::{env, iter};

use cpu_time::ThreadTime;
use rayon::ThreadPoolBuilder;
use twinpupil_instrument::Instrument;
use twinpupil_simulate::{expected_electrons, paper};

/// Four surfaces, masks before and behind them.
const ACHROMAT: &str = include_str!("../../../../bench/achromat-camera.toml");

/// Distance of the plate, mm: its dots are out of focus, so that many pixels need all their rays.
const DISTANCE_MM: f64 = 265.0;

/// Rays for every pixel that needs them.
const SAMPLES: [usize; 2] = [64, 256];

fn main() -> Result<(), Box<dyn Error>> {
    let repeats = match &env::args().skip(1).collect::<Vec<_>>()[..] {
        [] => 5,
        [option, count] if option == "--repeats" => count.parse()?,
        _ => return Err("usage: paths [--repeats N]".into()),
    };
    let camera = Instrument::from_toml(ACHROMAT)?;
    let scene = paper::random_plate(DISTANCE_MM, 1)?;
    let response = camera.response_matrix();
    let pool = ThreadPoolBuilder::new().num_threads(1).build()?;
    let mut out = io::stdout().lock();
    writeln!(out, "a plate through four surfaces, one thread     paths      s   M paths/s")?;
    for pupil_samples in SAMPLES {
        let one = || {
            pool.install(|| {
                let start = ThreadTime::now();
                let expectation = expected_electrons(&camera, &scene, &response, pupil_samples, &|_| {})?;
                Ok::<_, Box<dyn Error + Send + Sync>>((expectation.ledger, start.elapsed().as_secs_f64()))
            })
        };
        let all = iter::repeat_with(one)
            .take(repeats)
            .collect::<Result<Vec<_>, _>>()
            .map_err(|error| error as Box<dyn Error>)?;
        let Some((ledger, seconds)) = all.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
        let rate = ledger.launched as f64 / seconds / 1e6;
        writeln!(out, "  {pupil_samples:3} rays a pixel {:33} {seconds:6.2} {rate:11.1}", ledger.launched)?;
    }
    Ok(())
}
