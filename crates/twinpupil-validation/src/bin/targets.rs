//! Prints what the README and the changelog claim of accuracy: `cargo run --release -p twinpupil-validation`.

use std::io::{self, Write};

use twinpupil_instrument::paper;
use twinpupil_reconstruct::Mode;
use twinpupil_validation::plates::{POSES, Score};
use twinpupil_validation::rig::Rig;
use twinpupil_validation::rings::{OUTER_PLACES, PAPER_PLACES, depths};

/// Plates for every pose.
const SEEDS: u64 = 5;

fn main() -> io::Result<()> {
    let mut out = io::stdout().lock();
    let paper_rig = Rig::new(paper::instrument(), Mode::Paper);
    writeln!(out, "The paper's equations, isolated dots, thin lens, no noise: recovered z in mm")?;
    for z_mm in [250.0, 300.0, 350.0] {
        write!(out, "  z = {z_mm}:")?;
        for depth in depths(&paper_rig, &PAPER_PLACES, z_mm) {
            write!(out, "  r {} → {:.2}", depth.r_mm, depth.found_mm.unwrap_or(f64::NAN))?;
        }
        writeln!(out)?;
    }
    let rig = Rig::new(paper::instrument(), Mode::Centroid);
    writeln!(out, "\nDefault mode, isolated dots, r = 3 to 7.5, no noise: largest error of z in mm")?;
    for z_mm in (250..=350).step_by(10).map(f64::from) {
        let errors = depths(&rig, &OUTER_PLACES, z_mm);
        let largest = errors.iter().map(|d| d.found_mm.map_or(f64::NAN, |z| (z - z_mm).abs())).fold(0.0, f64::max);
        writeln!(out, "  z = {z_mm}: {largest:.4}")?;
    }
    writeln!(out, "\nDefault mode, the paper's plate of 60 dots, 20 ke-, 6.8 e- read noise, {SEEDS} plates a pose")?;
    writeln!(
        out,
        "  pose             found          false  rms z isolated  error/σ  rms z all   worst tilt  least R²"
    )?;
    for pose in POSES {
        let mut score = Score::default();
        for seed in 0..SEEDS {
            score.merge(Score::of(&rig, pose, seed));
        }
        write!(
            out,
            "  {:<15}  {:>3} of {:<3} {:>3.0} %  {:>3}    {:.4} mm       {:.2}     {:.4} mm",
            format!("{pose:?}"),
            score.found,
            score.whole,
            100.0 * score.recall(),
            score.false_points,
            score.isolated_rms_mm(),
            score.isolated_error_over_std(),
            score.outer_rms_mm(),
        )?;
        if score.tilts.is_empty() {
            writeln!(out)?;
        } else {
            writeln!(out, "   {:.4}°     {:.6}", score.tilt_error_deg_max(), score.r_squared_min())?;
        }
    }
    Ok(())
}
