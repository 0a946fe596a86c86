//! Prints how well cameras and scenes are read that nobody has chosen, beside the Cramér–Rao bound, one to a line, and those
//! dots that are off by more than chance: `strangers [--unusual] [COUNT [FIRST]]`.

use std::env;
use std::io::{self, Write};

use rayon::iter::{IntoParallelIterator, ParallelIterator};
use twinpupil_validation::limit::Score;
use twinpupil_validation::strangers::Stranger;

/// Of a thousand dots, none is off by so many of its deviations.
const OFF_SIGMAS: f64 = 4.5;

fn main() -> io::Result<()> {
    let is_unusual = env::args().any(|word| word == "--unusual");
    let mut numbers = env::args().skip(1).filter_map(|word| word.parse::<u64>().ok());
    let (count, first) = (numbers.next().unwrap_or(20), numbers.next().unwrap_or(0));
    let mut out = io::stdout();
    writeln!(
        out,
        "number  camera                                             found        false  rms z, µm  error/bound  error/σ"
    )?;
    let all = (first..first + count).into_par_iter().map(|seed| {
        let stranger = if is_unusual { Stranger::unusual(seed) } else { Stranger::of(seed) };
        let score = stranger.score();
        write!(io::stdout(), "{}", row(seed, &stranger, &score)).map(|()| score)
    });
    let mut total = Score::default();
    all.collect::<io::Result<Vec<Score>>>()?.into_iter().for_each(|score| total.merge(score));
    writeln!(
        out,
        "all: {} of {} dots found, {} false points, error/bound {:.3}, error/σ {:.3}",
        total.found.len(),
        total.whole,
        total.false_points,
        total.error_over_bound(),
        total.error_over_std(),
    )
}

/// What there is to say of one.
fn row(seed: u64, stranger: &Stranger, score: &Score) -> String {
    let sensor = &stranger.instrument.sensor;
    let plate = stranger.scene.spec().plate.as_ref();
    let camera = format!(
        "f {:.0}, L {:.0}, {:?} {:?}, {:.1} µm, z {:.0}, {:.0}°, {:.0} e⁻",
        stranger.instrument.lens.focal_length_mm(),
        sensor.distance_mm,
        sensor.mosaic,
        sensor.size_px,
        1e3 * sensor.pitch_mm,
        plate.map_or(0.0, |plate| plate.distance_mm),
        plate.map_or(0.0, |plate| plate.tilt_deg),
        stranger.scene.brightness_e,
    );
    let mut row = format!(
        "{seed:>6}  {camera:<70} {:>3} of {:<3} {:>3}  {:>9.2}  {:>9.2}  {:>9.2}\n",
        score.found.len(),
        score.whole,
        score.false_points,
        1e3 * score.rms_mm(),
        score.error_over_bound(),
        score.error_over_std(),
    );
    for off in score.found.iter().filter(|dot| dot.error_mm.abs() > OFF_SIGMAS * dot.std_mm) {
        let [x_mm, y_mm, z_mm] = off.centre_mm;
        row += &format!(
            "        ({x_mm:.2}, {y_mm:.2}, {z_mm:.2}) is off by {:.1} µm, σ {:.2}, bound {:.2}, χ² {:.3}\n",
            1e3 * off.error_mm,
            1e3 * off.std_mm,
            1e3 * off.bound_mm,
            off.pixel_chi2
        );
    }
    for [x_mm, y_mm, z_mm] in &score.missing_mm {
        row += &format!("        ({x_mm:.2}, {y_mm:.2}, {z_mm:.2}) was not found\n");
    }
    row
}
