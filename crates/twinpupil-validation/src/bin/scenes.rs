//! Prints how scenes as they come are read: `cargo run --release -p twinpupil-validation --bin scenes [-v] [PART OF A NAME]`.

use std::env;
use std::io::{self, Write};

use twinpupil_validation::limit::Camera;
use twinpupil_validation::scenes::all;

fn main() -> io::Result<()> {
    let verbose = env::args().any(|word| word == "-v");
    let part = env::args().skip(1).find(|word| word != "-v").unwrap_or_default();
    let mut out = io::stdout().lock();
    writeln!(
        out,
        "  {:<55}  found           false  rms z, µm  bound, µm  error/bound  error/σ      time  rejected",
        "camera and scene"
    )?;
    for case in all() {
        for camera in [Camera::Rggb, Camera::Rgb] {
            let name = format!("{camera:?} {}", case.name);
            if !name.contains(&part) {
                continue;
            }
            let score = case.score(camera, 7000);
            writeln!(
                out,
                "  {name:<55}  {:>3} of {:<3} {:>3.0} %  {:>3}    {:>7.2}    {:>7.2}         {:5.2}    {:5.2}  {:>6.1} ms  {:?}",
                score.found.len(),
                score.whole,
                100.0 * score.recall(),
                score.false_points,
                1000.0 * score.rms_mm(),
                1000.0 * score.bound_mm(),
                score.error_over_bound(),
                score.error_over_std(),
                1000.0 * score.time().as_secs_f64(),
                score.rejected,
            )?;
            for e in score.found.iter().filter(|_| verbose) {
                let [x_mm, y_mm, z_mm] = e.centre_mm;
                writeln!(
                    out,
                    "      at {x_mm:.2} {y_mm:.2} {z_mm:.2}: error {:.2} µm, σ {:.2}, bound {:.2}, χ² {:.3}",
                    1e3 * e.error_mm,
                    1e3 * e.std_mm,
                    1e3 * e.bound_mm,
                    e.pixel_chi2
                )?;
            }
        }
    }
    Ok(())
}
