//! Prints errors beside the Cramér–Rao bound: `cargo run --release -p twinpupil-validation --bin limit [SEEDS [FIRST]]`.

use std::env;
use std::io::{self, Write};

use twinpupil_validation::limit::{Camera, Score, model_rig, plate};
use twinpupil_validation::plates::{POSES, Pose};

/// Electrons of the dots.
const BRIGHTNESSES_E: [f64; 2] = [20_000.0, 200.0];

fn main() -> io::Result<()> {
    let mut numbers = env::args().skip(1).filter_map(|word| word.parse::<u64>().ok());
    let (seeds, first) = (numbers.next().unwrap_or(3), numbers.next().unwrap_or(0));
    let only = env::args().skip(1).find(|word| word.parse::<u64>().is_err() && word != "-v");
    let verbose = env::args().any(|word| word == "-v");
    let mut out = io::stdout().lock();
    for brightness_e in BRIGHTNESSES_E {
        for camera in Camera::ALL {
            let is_asked = |pose: &Pose| {
                only.as_ref().is_none_or(|only| format!("{brightness_e} {camera:?} {pose:?}").contains(only))
            };
            let poses: Vec<Pose> = POSES.into_iter().filter(is_asked).collect();
            if poses.is_empty() {
                continue;
            }
            let rig = model_rig(camera);
            writeln!(
                out,
                "\n{camera:?}, the paper's plate of 60 dots at {brightness_e} e-, {seeds} plates a pose, all dots with r ≥ 2"
            )?;
            writeln!(
                out,
                "  pose             found          false  rms z, µm  bound, µm  error/bound  error/σ by frame  worst tilt  least R²      time"
            )?;
            for pose in poses {
                let mut score = Score::default();
                for seed in first..first + seeds {
                    score.merge(Score::of(&rig, &plate(pose, brightness_e, seed), seed + 1000));
                }
                let pulls =
                    score.pulls.iter().fold([f64::INFINITY, 0.0], |[a, b], p| [f64::min(a, *p), f64::max(b, *p)]);
                write!(
                    out,
                    "  {:<15}  {:>3} of {:<3} {:>3.0} %  {:>3}    {:>7.2}    {:>7.2}         {:5.2}    {:5.2} … {:5.2}  ",
                    format!("{pose:?}"),
                    score.found.len(),
                    score.whole,
                    100.0 * score.recall(),
                    score.false_points,
                    1000.0 * score.rms_mm(),
                    1000.0 * score.bound_mm(),
                    score.error_over_bound(),
                    pulls[0],
                    pulls[1],
                )?;
                let worst = score.tilts.iter().fold([0.0, 1.0], |[t, r], [tilt, r2]| [tilt.abs().max(t), r2.min(r)]);
                if score.tilts.is_empty() {
                    write!(out, "                    ")?;
                } else {
                    write!(out, "  {:.4}°     {:.6}", worst[0], worst[1])?;
                }
                writeln!(out, "  {:.1} ms", 1000.0 * score.time().as_secs_f64())?;
                if verbose {
                    for e in score.found.iter() {
                        writeln!(
                            out,
                            "      at {:.2?}: error {:.2} µm, σ {:.2}, bound {:.2}, χ² {:.4}",
                            e.centre_mm,
                            1e3 * e.error_mm,
                            1e3 * e.std_mm,
                            1e3 * e.bound_mm,
                            e.pixel_chi2
                        )?;
                    }
                }
            }
        }
    }
    Ok(())
}
