//! What would make a calibration better.

use twinpupil_instrument::DepthRange;

use crate::blur::{Edge, added_px};
use crate::digits::significant;
use crate::known::Contradiction;
use crate::result::{Calibration, LeftOpen, Residual};
use crate::target::{Target, TargetDot};
use crate::unknown::Quantity;

/// Share of the depth range beyond the nearest and farthest pose that a calibration may be trusted in.
const BEYOND_SHARE: f64 = 0.15;

/// Tilts below which perspective tells little, degrees.
const TILT_DEG_MIN: f64 = 10.0;

/// Frames below which held-out errors mean little.
const FRAMES_MIN: usize = 4;

/// Share of the sensor's width or height that the dots should reach across.
const COVER_MIN: f64 = 0.7;

/// Correlation below which two numbers are no pair.
const TIED: f64 = 0.5;

/// Deviations beside the stage's way that are no chance.
const OFF_STAGE_SIGMAS: f64 = 3.0;

pub(crate) fn advice(calibration: &Calibration, target: &Target) -> Vec<String> {
    let mut advice: Vec<String> = [
        restless(calibration),
        unexplained(calibration),
        other_size(calibration, target),
        wrong_dots(calibration, target),
    ]
    .into_iter()
    .flatten()
    .chain(calibration.contradictions.iter().map(Contradiction::to_string))
    .collect();
    let frames = &calibration.frames;
    if frames.len() < FRAMES_MIN {
        advice.push(format!("{} of the frames could be used: take at least {FRAMES_MIN}", frames.len()));
    }
    let DepthRange { near_mm, far_mm } = calibration.instrument.depth_range();
    let distances = || calibration.residuals.iter().map(|residual| residual.position_mm[2]);
    let (nearest, farthest) = (distances().fold(f64::INFINITY, f64::min), distances().fold(0.0, f64::max));
    let spare_mm = BEYOND_SHARE * (far_mm - near_mm);
    if nearest > near_mm + spare_mm {
        advice.push(format!(
            "no dot nearer than {nearest:.0} mm, where the depth range begins at {near_mm:.0}: add a pose there"
        ));
    }
    if farthest < far_mm - spare_mm {
        advice.push(format!(
            "no dot farther than {farthest:.0} mm, where the depth range ends at {far_mm:.0}: add a pose there"
        ));
    }
    advice.extend(untold_blur(calibration));
    let tilt_deg = frames.iter().map(|frame| frame.pose.tilt_rad().to_degrees()).fold(0.0, f64::max);
    if tilt_deg < TILT_DEG_MIN {
        advice.push(format!("no pose is tilted by more than {tilt_deg:.0}°: tilt the target by 20° to 40° in some"));
    }
    advice.extend(cover(calibration));
    advice.extend(off_stage(calibration));
    for number in &calibration.numbers {
        let Some(why) = &number.left_open else { continue };
        let reason = match why {
            LeftOpen::Unseen => "the frames hardly depend on it".to_owned(),
            LeftOpen::Tied { with, correlation } => {
                if correlation.abs() < TIED {
                    "several others together do about the same to them".to_owned()
                } else {
                    format!("a change of {with} does about the same to them (correlation {correlation:.3})")
                }
            }
        };
        let stays = if number.std <= number.tolerance { "it stays within" } else { "it may be beyond" };
        advice.push(format!(
            "{} is not determined: {reason}; {stays} its tolerance of {}",
            number.key,
            significant(number.tolerance, 2)
        ));
    }
    let seen = calibration.residuals.iter().map(|residual| residual.dot);
    let mut dots: Vec<usize> = seen.collect();
    dots.sort_unstable();
    dots.dedup();
    if target.is_mirror_symmetric() {
        advice.push(
            "the target looks the same in a mirror, so that a mirrored image would not show: give it a dot that is missing or \
             larger, beside its middle row and column"
                .to_owned(),
        );
    }
    if 2 * dots.len() < target.dots().len() {
        advice.push(format!("only {} of the target's {} dots were ever seen", dots.len(), target.dots().len()));
    }
    advice
}

/// Whether the numbers still moved when they were taken.
fn restless(calibration: &Calibration) -> Option<String> {
    let sigmas = calibration.unrest_sigmas;
    (sigmas > 0.0).then(|| {
        format!(
            "the numbers did not come to rest: the last step still moved them by {sigmas:.1} deviations, so that they are not \
             to be trusted; add frames in other poses"
        )
    })
}

/// Whether noise is far from all that is left.
fn unexplained(calibration: &Calibration) -> Option<String> {
    const TIMES: f64 = 1.5;
    const DOUBTED_SHARE: f64 = 0.03;
    let times = calibration.reduced_chi2.sqrt();
    let (doubted, spots) = (calibration.doubted().count(), calibration.residuals.len());
    let what = if times > TIMES {
        format!("residuals are {times:.1} times what noise explains")
    } else if doubted as f64 > DOUBTED_SHARE * spots as f64 {
        format!("{doubted} of {spots} spots lie so far from where they should that they hardly count")
    } else {
        return None;
    };
    let worst = calibration.frames.iter().max_by(|a, b| a.pixel_chi2.total_cmp(&b.pixel_chi2))?;
    Some(format!(
        "{what}: a frame is not sharp, or the target or the model of the camera is not as stated, and the numbers deserve less trust than \
         their deviations say; the frame given as number {} fits worst, with a χ² of {:.1} for each pixel",
        worst.frame + 1,
        worst.pixel_chi2
    ))
}

/// Whether frames that are all blurred alike would look as if they were farther from the focus.
fn untold_blur(calibration: &Calibration) -> Option<String> {
    let is_untold = |band: usize| {
        let own = calibration.residuals.iter().filter(|residual| residual.band == band);
        let edges: Vec<Edge> =
            own.map(|Residual { foreseen_px, off_px, .. }| [foreseen_px[3], foreseen_px[3] + off_px[3]]).collect();
        added_px(&edges).is_none()
    };
    (0..calibration.instrument.bands.len()).all(is_untold).then(|| {
        format!(
            "whether the frames are blurred by motion or dirt cannot be told: that looks like another distance or another focus \
             as long as no band shows dots on both sides of its focus; add a tilted pose at about {:.0} mm",
            calibration.instrument.focus_distance_mm()
        )
    })
}

/// Whether dots seem larger beside their pitch than is stated, or smaller.
fn other_size(calibration: &Calibration, target: &Target) -> Option<String> {
    const PERCENT: f64 = 0.5;
    const SIGMAS: f64 = 4.0;
    let number = calibration.numbers.iter().find(|number| number.quantity == Quantity::DotDiameter)?;
    let (off, percent) = (number.value - number.expected, 100.0 * (number.value / number.expected - 1.0));
    (percent.abs() > PERCENT && off.abs() > SIGMAS * number.std).then(|| {
        let way = if off > 0.0 { "larger" } else { "smaller" };
        let (pitch_mm, diameter_mm) = (target.spec().pitch_mm, target.spec().dot_diameter_mm);
        format!(
            "dots are {:.1} % {way} beside their pitch than the target file says: measure pitch_mm = {pitch_mm}, of which all that \
             is found is made, and dot_diameter_mm; if dots of {diameter_mm} mm are right, the pitch is {:.4} mm",
            percent.abs(),
            pitch_mm / number.value
        )
    })
}

/// Which dots are not where the target file says, or not what it says.
fn wrong_dots(calibration: &Calibration, target: &Target) -> Option<String> {
    /// Sightings of a dot that are doubted if it is wrong, of all; and dots that are named.
    const SHARE: f64 = 0.5;
    const NAMED: usize = 5;
    // Where masks cut light, they may be what is not known.
    let of_dot =
        |dot: usize| calibration.residuals.iter().filter(move |residual| residual.dot == dot && !residual.is_cut);
    let is_wrong = |dot: &usize| {
        let doubted = of_dot(*dot).filter(|residual| residual.is_doubted).count();
        doubted > 1 && doubted as f64 > SHARE * of_dot(*dot).count() as f64
    };
    let wrong: Vec<usize> = (0..target.dots().len()).filter(is_wrong).collect();
    let place = |dot: &TargetDot| format!("row {}, column {}", dot.row, dot.column);
    let named: Vec<String> = wrong.iter().take(NAMED).map(|dot| place(&target.dots()[*dot])).collect();
    let others = match wrong.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!("; and {more} more"),
    };
    (!wrong.is_empty()).then(|| {
        format!(
            "dots of the target are not where or as large as its file says, and hardly count ({}{others}, counted from 0): \
             clean it, or seek their places with --refine-target-mm",
            named.join("; ")
        )
    })
}

/// Whether the stage and the frames contradict each other.
fn off_stage(calibration: &Calibration) -> Option<String> {
    let off = || calibration.frames.iter().filter_map(|frame| frame.off_stage);
    let count = off().count();
    let sigmas = (off().map(|off| off.sigmas.powi(2)).sum::<f64>() / count.max(1) as f64).sqrt();
    (sigmas > OFF_STAGE_SIGMAS).then(|| {
        format!(
            "the target stands {sigmas:.0} deviations of the stage beside where that says: check its scale and that nothing \
             but the stage moved the target's middle, or state a larger std_mm"
        )
    })
}

/// Whether the dots lie all over the sensor.
fn cover(calibration: &Calibration) -> Option<String> {
    let size_px = calibration.instrument.sensor.size_px;
    for (axis, name) in ["width", "height"].into_iter().enumerate() {
        let places = || calibration.residuals.iter().map(|residual| residual.foreseen_px[axis]);
        let reach_px = places().fold(0.0, f64::max) - places().fold(f64::INFINITY, f64::min);
        let share = reach_px / size_px[axis] as f64;
        if share < COVER_MIN {
            let percent = (100.0 * share).max(0.0);
            return Some(format!("the dots reach over {percent:.0} % of the sensor's {name}: use more of it"));
        }
    }
    None
}
