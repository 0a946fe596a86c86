//! Prints what calibration makes of cameras off their data sheet: `calibration [SEED]`.

use std::io::Write;

use twinpupil_calibrate::Choices;
use twinpupil_instrument::Mosaic;
use twinpupil_reconstruct::Mode;
use twinpupil_validation::calibration::{
    POSES, calibrate, data_sheet, depth_errors, off_data_sheet, target, target_frames,
};
use twinpupil_validation::plates::Pose;
use twinpupil_validation::rig::Rig;

fn main() -> std::io::Result<()> {
    let seed = std::env::args().nth(1).and_then(|seed| seed.parse().ok()).unwrap_or(1);
    let mut out = std::io::stdout().lock();
    for (mosaic, is_bent) in [(Mosaic::Rgb, false), (Mosaic::Rggb, false), (Mosaic::Rgb, true)] {
        let sheet = data_sheet(mosaic);
        let truth = off_data_sheet(&sheet, is_bent);
        let camera = Rig::new(truth.clone(), Mode::Model);
        let target = target();
        let frames = target_frames(&camera, &target, &POSES, 100 * seed);
        let start = std::time::Instant::now();
        let calibration = match calibrate(
            &sheet,
            &target,
            &frames,
            &Choices {
                prior_std: std::env::var("FIX")
                    .map(|f| f.split(',').map(|k| (k.to_owned(), 0.0)).collect())
                    .unwrap_or_default(),
            },
        ) {
            Ok(calibration) => calibration,
            Err(error) => {
                writeln!(out, "{mosaic:?} {is_bent}: {error}")?;
                continue;
            }
        };
        writeln!(
            out,
            "{mosaic:?}, bent: {is_bent}: {:.2} s, chi2 {:.3}, rms {:.4} px, held out {:?}",
            start.elapsed().as_secs_f64(),
            calibration.reduced_chi2,
            calibration.rms_px,
            calibration.held_out
        )?;
        for number in &calibration.numbers {
            let true_value = match number.quantity {
                twinpupil_calibrate::Quantity::Instrument(parameter) => parameter.value(&truth),
                twinpupil_calibrate::Quantity::DotDiameter => 1.0,
            };
            writeln!(
                out,
                "{:42} {:12.6} {:12.6} {:10.6} {:7.2}  {:?}",
                number.key,
                number.value,
                true_value,
                number.std,
                (number.value - true_value) / number.std,
                number.left_open
            )?;
        }
        if std::env::var("MORE").is_ok() {
            for f in &calibration.frames {
                writeln!(
                    out,
                    "{} z {:.2} tilt {:.3} rms {:.4} pix {:.3} pose {:?}",
                    f.frame,
                    f.pose.translation_mm.z,
                    f.pose.tilt_rad().to_degrees(),
                    f.rms_px,
                    f.pixel_chi2,
                    f.pose_std
                )?;
                for band in 0..2 {
                    let own: Vec<_> =
                        calibration.residuals.iter().filter(|r| r.frame == f.frame && r.band == band).collect();
                    let n = own.len() as f64;
                    for k in 0..4 {
                        let m: f64 = own.iter().map(|r| r.off_px[k]).sum::<f64>() / n;
                        let s: f64 = own.iter().map(|r| (r.off_px[k] / r.std_px[k]).powi(2)).sum::<f64>() / n;
                        let sd: f64 = own.iter().map(|r| r.std_px[k]).sum::<f64>() / n;
                        write!(out, "   {m:8.5} {:.2} ({sd:.5})", s.sqrt())?;
                    }
                    writeln!(out)?;
                }
            }
            break;
        }
        for fault in &calibration.faults {
            writeln!(out, "{fault:?}")?;
        }
        for advice in &calibration.advice {
            writeln!(out, "  {advice}")?;
        }
        let before = Rig::new(sheet, Mode::Model);
        let after = Rig::new(calibration.instrument.clone(), Mode::Model);
        for pose in
            [Pose::Facing(255.0), Pose::Facing(280.0), Pose::Facing(310.0), Pose::Facing(340.0), Pose::Tilted(30.0)]
        {
            let scene = pose.scene(seed);
            let rms =
                |errors: &[[f64; 2]]| (errors.iter().map(|[e, _]| e * e).sum::<f64>() / errors.len() as f64).sqrt();
            let max = |errors: &[[f64; 2]]| errors.iter().map(|[e, _]| e.abs()).fold(0.0, f64::max);
            let [b, a] = [&before, &after].map(|reader| depth_errors(&camera, reader, &scene, seed + 7));
            let t = depth_errors(&camera, &camera, &scene, seed + 7);
            writeln!(
                out,
                "{pose:?}: before {:.4} ({}), after rms {:.4} max {:.4} ({}), true {:.4}",
                rms(&b),
                b.len(),
                rms(&a),
                max(&a),
                a.len(),
                rms(&t)
            )?;
        }
    }
    Ok(())
}
