//! A camera off its data sheet, calibrated from a dot grid: what comes out, and what is said where nothing can.

use std::sync::OnceLock;

use twinpupil_calibrate::{
    CalibrateError, Calibration, Choices, Contradiction, CorrectionChoice, FrameFault, LeftOpen, Quantity,
    SightingError, StagePosition, Target, TargetSpec,
};
use twinpupil_instrument::{Frame, Instrument, Mosaic, Parameter};
use twinpupil_simulate::{Dot, DotSpec, Illumination, Scene, SceneSpec, TiltAxis};
use twinpupil_validation::calibration::{
    DepthError, Exposures, POSES, TargetPose, axis, calibrate, calibrate_on_stage, calibrated, coarse, data_sheet,
    off_data_sheet, target, target_scene, warped,
};
use twinpupil_validation::plates::Pose;

/// Rays a pixel: what this leaves is below the noise of calibration, but for the size of dots and the radii of masks, which
/// many edges tell.
const PUPIL_SAMPLES: usize = 256;
const SIZE_ERROR_OF_RAYS: f64 = 1e-5;
const RADIUS_ERROR_OF_RAYS: f64 = 2e-4;

fn truth() -> Instrument {
    off_data_sheet(&data_sheet(Mosaic::Rgb), true)
}

/// Frames of the target, seen by a camera with everything off: focal lengths, distance, axis, masks, tilt, distortion.
fn frames() -> &'static [Frame] {
    static FRAMES: OnceLock<Vec<Frame>> = OnceLock::new();
    FRAMES.get_or_init(|| Exposures::of_target(truth(), &target(), &POSES, PUPIL_SAMPLES).frames(1))
}

/// The same with half as many pixels a side and no tilt or distortion.
fn coarse_truth() -> Instrument {
    coarse(&off_data_sheet(&data_sheet(Mosaic::Rgb), false))
}

fn coarse_frames() -> &'static [Frame] {
    static FRAMES: OnceLock<Vec<Frame>> = OnceLock::new();
    FRAMES.get_or_init(|| Exposures::of_target(coarse_truth(), &target(), &POSES, PUPIL_SAMPLES).frames(1))
}

fn calibrate_coarse(frames: &[Frame]) -> Result<Calibration, CalibrateError> {
    calibrate(&coarse(&data_sheet(Mosaic::Rgb)), &target(), frames, &Choices::default())
}

fn calibration() -> &'static Calibration {
    static CALIBRATION: OnceLock<Calibration> = OnceLock::new();
    CALIBRATION.get_or_init(|| {
        let choices = Choices { correction: CorrectionChoice::Auto, ..Choices::default() };
        calibrate(&data_sheet(Mosaic::Rgb), &target(), frames(), &choices).expect("a sound calibration")
    })
}

#[test]
fn a_camera_off_its_data_sheet_is_calibrated() {
    let calibration = calibration();
    assert!(calibration.faults.is_empty(), "{:?}", calibration.faults);
    assert!(calibration.rms_px < 0.005, "{}", calibration.rms_px);
    for number in &calibration.numbers {
        let (expected, of_rays) = match number.quantity {
            Quantity::Instrument(parameter) => {
                let expected = parameter.value(&truth());
                let is_radius = matches!(parameter, Parameter::ZoneRadius(..));
                (expected, if is_radius { RADIUS_ERROR_OF_RAYS * expected } else { 0.0 })
            }
            Quantity::DotDiameter => (1.0, SIZE_ERROR_OF_RAYS),
        };
        let sigmas = (number.value - expected).abs() / number.std.hypot(of_rays);
        assert!(sigmas < 4.0, "{} is {} ± {}, not {expected}", number.key, number.value, number.std);
    }
    let held_out = calibration.held_out.expect("several frames");
    assert!(held_out.z_rms_mm < 0.01, "{held_out:?}");
}

#[test]
fn a_camera_that_its_numbers_describe_is_given_no_correction() {
    let finding = calibration().correction.as_ref().expect("seven frames");
    assert!(finding.degree.is_none() && !finding.is_kept(), "{finding:?}");
    assert!(calibration().instrument.bands.iter().all(|band| band.correction.is_none()));
}

#[test]
fn a_field_that_no_number_stands_for_is_corrected_without_driving_numbers_off() {
    const FIELD_PX: f64 = 0.1;
    const RAYS: usize = 64;
    const TOLERANCES_MAX: f64 = 2.0;
    let sheet = coarse(&data_sheet(Mosaic::Rgb));
    let truth = warped(&coarse(&off_data_sheet(&data_sheet(Mosaic::Rgb), false)), FIELD_PX, 1);
    let frames = Exposures::of_target(truth.clone(), &target(), &POSES, RAYS).frames(1);
    let choices = Choices { correction: CorrectionChoice::Auto, ..Choices::default() };
    let calibration = calibrate(&sheet, &target(), &frames, &choices).expect("within the data sheet");
    for (_, number) in calibration.named() {
        let Quantity::Instrument(parameter) = number.quantity else { continue };
        let off = (number.value - parameter.value(&truth)).abs() / number.tolerance;
        assert!(off < TOLERANCES_MAX, "{}: {off} tolerances", number.key);
    }
    let finding = calibration.correction.as_ref().expect("seven frames");
    let [without, with] = finding.held_out.expect("one is chosen");
    assert!(finding.is_kept() && with.z_rms_mm < 0.2 * without.z_rms_mm, "{finding:?}");
}

#[test]
fn other_frames_then_give_the_depth_of_random_dots() {
    let plates =
        Exposures::new(truth(), vec![Pose::Facing(270.0).scene(3), Pose::Facing(330.0).scene(4)], PUPIL_SAMPLES);
    let (before, _) = plates.depth_errors(&data_sheet(Mosaic::Rgb), 5);
    let (after, dots) = plates.depth_errors(&calibrated(calibration()), 5);
    assert!(DepthError::rms_mm(&before) > 1.0, "{}", DepthError::rms_mm(&before));
    assert!(after.len() as f64 >= 0.98 * dots as f64, "{} of {dots}", after.len());
    assert!(DepthError::rms_mm(&after) < 0.02, "{}", DepthError::rms_mm(&after));
    assert!(DepthError::max_mm(&after) < 0.05, "{}", DepthError::max_mm(&after));
    // The calibration's part of the error bars is what the noise does not explain.
    let sigmas2 =
        after.iter().map(|error| error.z_mm.powi(2) / (error.noise_std_mm.powi(2) + error.calibration_std_mm.powi(2)));
    let rms_sigmas = (sigmas2.sum::<f64>() / after.len() as f64).sqrt();
    assert!(rms_sigmas < 2.5, "{rms_sigmas}");
}

#[test]
fn light_that_grows_across_the_target_leaves_depth_true() {
    const RAYS: usize = 64;
    let sheet = coarse(&data_sheet(Mosaic::Rgb));
    let truth = coarse_truth();
    let uneven = |pose: &TargetPose| {
        let mut spec = target_scene(&target(), pose).spec().clone();
        spec.illumination = Some(Illumination { growth_per_mm: [0.04, 0.02] });
        Scene::new(spec).expect("a legal scene")
    };
    let frames = Exposures::new(truth.clone(), POSES.iter().map(uneven).collect(), RAYS).frames(1);
    let calibration = calibrate(&sheet, &target(), &frames, &Choices::default()).expect("a sound calibration");
    assert!(calibration.faults.is_empty(), "{:?}", calibration.faults);
    let plates = Exposures::new(truth, vec![Pose::Facing(270.0).scene(3), Pose::Facing(330.0).scene(4)], RAYS);
    let (errors, _) = plates.depth_errors(&calibrated(&calibration), 5);
    assert!(DepthError::rms_mm(&errors) < 0.02, "{}", DepthError::rms_mm(&errors));
}

#[test]
fn one_frame_shows_the_axis() {
    let plate = Exposures::new(
        off_data_sheet(&data_sheet(Mosaic::Rgb), false),
        vec![Pose::Facing(262.0).scene(7)],
        PUPIL_SAMPLES,
    );
    // Masks off centre shift what is out of focus: the axis alone is sought, all else is known.
    let mut spec = off_data_sheet(&data_sheet(Mosaic::Rgb), false).into_spec();
    let true_px = std::mem::replace(&mut spec.sensor.axis_px, data_sheet(Mosaic::Rgb).sensor.axis_px);
    let found = axis(&Instrument::new(spec).expect("a legal instrument"), &plate.frames(2)).expect("an axis");
    let off_px = (found.axis_px[0] - true_px[0]).hypot(found.axis_px[1] - true_px[1]);
    assert!(off_px < 0.02, "{off_px}: {found:?}");
}

#[test]
fn a_stage_tells_the_scale_of_depth() {
    let alone = calibration();
    // The middle of the target goes along the axis, in whatever way it is tilted.
    let position = |pose: &TargetPose| StagePosition { travel_mm: pose.distance_mm - 250.0, std_mm: 1e-3 };
    let mut stage: Vec<Option<StagePosition>> = POSES.iter().map(|pose| Some(position(pose))).collect();
    stage[2] = None;
    let of = |stage: &[Option<StagePosition>]| {
        calibrate_on_stage(&data_sheet(Mosaic::Rgb), &target(), frames(), stage, &Choices::default()).expect("sound")
    };
    let carried = of(&stage);
    let distance = |calibration: &Calibration| calibration.number("sensor.distance_mm").expect("it is sought").clone();
    assert!(distance(&carried).std < 0.6 * distance(alone).std, "{:?} {:?}", distance(&carried), distance(alone));
    let off_mm = distance(&carried).value - truth().sensor.distance_mm;
    assert!(off_mm.abs() < 4.0 * distance(&carried).std, "{:?}", distance(&carried));
    assert!(carried.frames[2].off_stage.is_none() && carried.frames[3].off_stage.is_some_and(|off| off.sigmas < 4.0));
    assert!(!carried.advice.iter().any(|advice| advice.contains("the stage")), "{:?}", carried.advice);
    // One that does not go as far as it says.
    stage.iter_mut().flatten().for_each(|position| position.travel_mm *= 1.01);
    let contradicted = of(&stage);
    assert!(contradicted.advice.iter().any(|advice| advice.contains("check its scale")), "{:?}", contradicted.advice);
}

#[test]
fn what_frames_cannot_tell_is_named() {
    let calibration = calibrate_coarse(&coarse_frames()[..1]).expect("something");
    let why = |key: &str| calibration.number(key).expect("it is sought").left_open.clone();
    assert!(matches!(why("sensor.distance_mm"), Some(LeftOpen::Tied { .. })), "{:?}", calibration.numbers);
    assert!(calibration.advice.iter().any(|advice| advice.contains("sensor.distance_mm is not determined")));
    assert!(calibration.advice.iter().any(|advice| advice.contains("tilt the target")), "{:?}", calibration.advice);
    assert!(calibration.advice.iter().any(|advice| advice.contains("no dot farther than")));
}

#[test]
fn what_is_wrong_with_target_or_bands_is_told() {
    let of = |instrument: &Instrument, target: &Target, frames: &[Frame]| {
        calibrate(instrument, target, frames, &Choices::default()).map(|_| ()).expect_err("it is wrong")
    };
    let sheet = data_sheet(Mosaic::Rgb);
    let spec = TargetSpec { pitch_mm: 1.8, ..target().spec().clone() };
    let wrong_pitch = of(&sheet, &Target::new(spec).expect("legal"), frames());
    assert!(
        matches!(wrong_pitch, CalibrateError::OffDataSheet { likely_pitch_mm, .. } if (1.4..1.6).contains(&likely_pitch_mm)),
        "{wrong_pitch}"
    );

    let mut swapped = sheet.clone().into_spec();
    let (first, second) = swapped.bands.split_at_mut(1);
    std::mem::swap(&mut first[0].plane, &mut second[0].plane);
    let swapped = of(&Instrument::new(swapped).expect("legal"), &target(), frames());
    assert!(matches!(swapped, CalibrateError::Swapped { .. }), "{swapped}");

    let smaller = TargetSpec { columns: 8, ..target().spec().clone() };
    let smaller = of(&sheet, &Target::new(smaller).expect("legal"), &frames()[3..4]);
    assert!(matches!(smaller, CalibrateError::NoFrames(FrameFault::Sighting(_))), "{smaller}");

    let empty = Frame::new(1920, 1200, 4095, vec![vec![0; 1920 * 1200]; 3]).expect("a frame");
    let empty = of(&sheet, &target(), &[empty]);
    assert!(empty.to_string().contains("no target"), "{empty}");
}

#[test]
fn a_frame_unlike_the_others_is_left_out_and_why() {
    const AT: usize = 2;
    let some = &coarse_frames()[1..6];
    let why = |bad: Frame| {
        let mut all = some.to_vec();
        all[AT] = bad;
        let calibration = calibrate_coarse(&all).expect("four frames");
        let off =
            calibration.number("sensor.distance_mm").expect("it is sought").value - coarse_truth().sensor.distance_mm;
        assert!(off.abs() < 0.05 && calibration.reduced_chi2 < 2.0, "{off} {}", calibration.reduced_chi2);
        match &calibration.faults[..] {
            [(AT, fault)] => fault.clone(),
            faults => panic!("{faults:?}"),
        }
    };
    let good = &some[AT];
    let fault = why(blurred(good, 2));
    assert!(matches!(fault, FrameFault::Blurred { .. }), "{fault:?}");
    let exchanged = of_pages(good, good.pages().iter().rev().cloned().collect());
    assert_eq!(why(exchanged), FrameFault::Exchanged);
    let mirrored = |page: &Vec<u16>| page.chunks(good.width_px()).flat_map(|row| row.iter().rev().copied()).collect();
    let mirrored = of_pages(good, good.pages().iter().map(mirrored).collect());
    let fault = why(mirrored);
    assert!(matches!(fault, FrameFault::Stranger { .. }), "{fault:?}");
}

#[test]
fn frames_that_are_all_blurred_are_refused_for_that() {
    let all: Vec<Frame> = coarse_frames().iter().map(|frame| blurred(frame, 2)).collect();
    let error = calibrate_coarse(&all).map(|_| ()).expect_err("they are blurred");
    assert!(matches!(error, CalibrateError::AllBlurred { .. }), "{error}");
    let error = calibrate_coarse(&[blurred(&coarse_frames()[3], 2)]).map(|_| ()).expect_err("it is blurred");
    assert!(matches!(error, CalibrateError::NoFrames(FrameFault::Blurred { .. })), "{error}");
    let three = [&all[1], &all[3], &all[5]].map(|frame| blurred(frame, 1));
    let error = calibrate_coarse(&three).map(|_| ()).expect_err("they are blurred");
    assert!(matches!(error, CalibrateError::AllBlurred { .. }), "{error}");
    // One that faces the camera looks as if it were farther from the focus.
    let facing = calibrate_coarse(&all[..1]).expect("a frame");
    assert!(facing.advice.iter().any(|advice| advice.contains("blurred by motion or dirt cannot be told")));
}

#[test]
fn what_is_wrong_in_a_target_file_is_said_though_a_camera_fits() {
    let frames = &coarse_frames()[1..4];
    let of = |spec: TargetSpec| {
        let target = Target::new(spec).expect("a legal target");
        calibrate(&coarse(&data_sheet(Mosaic::Rgb)), &target, frames, &Choices::default())
            .expect("within the data sheet")
    };
    let says = |calibration: &Calibration, what: &str| calibration.advice.iter().any(|advice| advice.contains(what));
    let right = of(target().spec().clone());
    assert!(!says(&right, "the target file says"), "{:?}", right.advice);
    let more = of(TargetSpec { columns: 11, pitch_mm: 1.545, ..target().spec().clone() });
    assert!(says(&more, "the target file says columns = 11, but no frame shows more than 9"), "{:?}", more.advice);
    assert!(!says(&more, "the target file says rows"), "{:?}", more.advice);
    assert!(says(&more, "the pitch is 1.500"), "{:?}", more.advice);
}

#[test]
fn a_target_that_leaves_the_sensor_is_as_good() {
    const RAYS: usize = 256;
    let target = Target::new(TargetSpec { rows: 13, columns: 17, ..target().spec().clone() }).expect("a legal target");
    let poses = [POSES[1], POSES[3], POSES[6]];
    let frames = Exposures::of_target(coarse_truth(), &target, &poses, RAYS).frames(1);
    let sheet = coarse(&data_sheet(Mosaic::Rgb));
    let calibration = calibrate(&sheet, &target, &frames, &Choices::default()).expect("a sound calibration");
    assert!(
        calibration.faults.is_empty() && calibration.reduced_chi2 < 2.0,
        "{:?} {}",
        calibration.faults,
        calibration.reduced_chi2
    );
    let spots = 2 * frames.len() * target.dots().len();
    assert!(calibration.residuals.len() < spots * 2 / 3, "{} of {spots}", calibration.residuals.len());
    assert!(!calibration.advice.iter().any(|advice| advice.contains("no frame shows")), "{:?}", calibration.advice);
    for (_, number) in calibration.named() {
        let Quantity::Instrument(parameter) = number.quantity else { continue };
        let expected = parameter.value(&coarse_truth());
        let is_radius = matches!(parameter, Parameter::ZoneRadius(..));
        let std = number.std.hypot(if is_radius { RADIUS_ERROR_OF_RAYS * expected } else { 0.0 });
        let off = number.value - expected;
        assert!(off.abs() < 5.0 * std, "{} off by {off} ± {std}", number.key);
    }
}

#[test]
fn a_single_frame_is_seen_from_the_right_side_of_the_focus() {
    for frame in &coarse_frames()[2..6] {
        let calibration = calibrate_coarse(std::slice::from_ref(frame)).expect("a frame");
        assert!(calibration.reduced_chi2 < 2.0, "{}", calibration.reduced_chi2);
    }
}

#[test]
fn what_was_known_beforehand_and_contradicts_the_frames_is_named() {
    const KEY: &str = "sensor.distance_mm";
    let frames = &coarse_frames()[1..5];
    let of = |std_mm: f64| {
        let choices = Choices { prior_std: [(KEY.to_owned(), std_mm)].into(), ..Choices::default() };
        calibrate(&coarse(&data_sheet(Mosaic::Rgb)), &target(), frames, &choices)
    };
    let is_named = |found: &Contradiction| {
        found.key == KEY && (found.found - coarse_truth().sensor.distance_mm).abs() < 0.1 && found.sigmas() > 10.0
    };
    let refused = of(0.01).map(|_| ()).expect_err("it contradicts");
    assert!(matches!(&refused, CalibrateError::Contradicted(found) if is_named(found)), "{refused}");
    let held = of(0.0).expect("the focal lengths give way");
    assert!(held.contradictions.iter().any(is_named), "{:?}", held.contradictions);
    assert!(held.advice.iter().any(|advice| advice.contains("is held at 151, but the frames say 151.")));
    assert_eq!(of(1.0).expect("it is within").contradictions, []);
}

#[test]
fn roles_that_the_masks_or_a_single_frame_contradict_are_told() {
    let sheet = coarse(&data_sheet(Mosaic::Rgb));
    let of = |spec: twinpupil_instrument::InstrumentSpec| {
        let instrument = Instrument::new(spec).expect("legal");
        calibrate(&instrument, &target(), &coarse_frames()[3..4], &Choices::default()).map(|_| ()).expect_err("wrong")
    };
    let mut roles = sheet.clone().into_spec();
    let (first, second) = roles.bands.split_at_mut(1);
    std::mem::swap(&mut first[0].role, &mut second[0].role);
    let roles = of(roles);
    assert!(matches!(roles, CalibrateError::RolesAgainstMasks { .. }), "{roles}");
    let mut planes = sheet.into_spec();
    let (first, second) = planes.bands.split_at_mut(1);
    std::mem::swap(&mut first[0].plane, &mut second[0].plane);
    let planes = of(planes);
    assert!(matches!(planes, CalibrateError::Swapped { .. }), "{planes}");
}

#[test]
fn a_mosaic_whose_bands_are_swapped_is_told_from_any_of_its_frames() {
    const RAYS: usize = 64;
    let sheet = coarse(&data_sheet(Mosaic::Rggb));
    let truth = coarse(&off_data_sheet(&data_sheet(Mosaic::Rggb), false));
    let poses = [POSES[0], POSES[1], POSES[3], POSES[5]];
    let frames = Exposures::of_target(truth, &target(), &poses, RAYS).frames(1);
    let swapped: Vec<Frame> = frames.iter().map(with_red_and_blue_exchanged).collect();
    let refused = |frames: &[Frame]| {
        let error =
            calibrate(&sheet, &target(), frames, &Choices::default()).map(|_| ()).expect_err("they are swapped");
        assert!(matches!(error, CalibrateError::Swapped { .. }), "{error}");
    };
    refused(&swapped);
    swapped.iter().for_each(|frame| refused(std::slice::from_ref(frame)));
}

#[test]
fn random_dots_are_no_target_and_what_is_too_bright_is_told() {
    let random = Exposures::new(coarse_truth(), vec![Pose::Facing(300.0).scene(3)], 16).frames(1);
    let error = calibrate_coarse(&random).map(|_| ()).expect_err("no grid");
    assert!(matches!(error, CalibrateError::NoFrames(FrameFault::Sighting(SightingError::NoTarget { .. }))), "{error}");
    let good = &coarse_frames()[3];
    let bright = |page: &Vec<u16>| page.iter().map(|code| (4 * code).min(good.code_max())).collect();
    let error = calibrate_coarse(&[of_pages(good, good.pages().iter().map(bright).collect())]).map(|_| ());
    let error = error.expect_err("saturated");
    assert!(
        matches!(error, CalibrateError::NoFrames(FrameFault::Sighting(SightingError::Saturated { .. }))),
        "{error}"
    );
}

#[test]
fn frames_near_the_focus_are_seen_from_the_right_side_of_it() {
    const RAYS: usize = 256;
    let sheet = coarse(&data_sheet(Mosaic::Rgb));
    let truth = coarse(&off_data_sheet(&data_sheet(Mosaic::Rgb), false));
    // By the data sheet the focus is 8 mm nearer for one band and 15 mm farther for the other.
    let poses = [
        (290.0, 20.0, TiltAxis::X),
        (297.0, -25.0, TiltAxis::Y),
        (300.0, 30.0, TiltAxis::Y),
        (308.0, -20.0, TiltAxis::X),
    ];
    let poses =
        poses.map(|(distance_mm, tilt_deg, tilt_axis)| TargetPose { distance_mm, tilt_deg, tilt_axis, turn_deg: 3.0 });
    let mut frames = Exposures::of_target(truth.clone(), &target(), &poses, RAYS).frames(1);
    // A blurred one must not lead the others to the wrong side.
    frames[1] = blurred(&frames[1], 5);
    let calibration = calibrate(&sheet, &target(), &frames, &Choices::default()).expect("three frames");
    assert!(matches!(calibration.faults[..], [(1, FrameFault::Blurred { .. })]), "{:?}", calibration.faults);
    assert!(calibration.reduced_chi2 < 2.0 && calibration.unrest_sigmas == 0.0, "{}", calibration.reduced_chi2);
    for (_, number) in calibration.named() {
        let Quantity::Instrument(parameter) = number.quantity else { continue };
        let expected = parameter.value(&truth);
        let is_radius = matches!(parameter, Parameter::ZoneRadius(..));
        let std = number.std.hypot(if is_radius { RADIUS_ERROR_OF_RAYS * expected } else { 0.0 });
        let off = number.value - expected;
        assert!(off.abs() < 5.0 * std, "{} off by {off} ± {std}", number.key);
    }
}

#[test]
fn a_dot_that_is_not_where_the_target_file_says_is_named_and_hardly_counts() {
    const RAYS: usize = 256;
    const OFF_MM: f64 = 0.03;
    let sheet = coarse(&data_sheet(Mosaic::Rgb));
    let truth = coarse(&off_data_sheet(&data_sheet(Mosaic::Rgb), false));
    let wrong = target().dot_at(1, 6).expect("a dot");
    let scene = |distance_mm: f64| {
        let facing = TargetPose { distance_mm, tilt_deg: 0.0, tilt_axis: TiltAxis::Y, turn_deg: 2.0 };
        let grid = target_scene(&target(), &facing);
        let dot = |dot: &Dot| {
            let [x_mm, y_mm, z_mm] = dot.centre_mm;
            DotSpec { x_mm, y_mm, z_mm, diameter_mm: dot.diameter_mm }
        };
        let mut dots: Vec<DotSpec> = grid.dots().iter().map(dot).collect();
        dots[wrong].x_mm += OFF_MM;
        Scene::new(SceneSpec { plate: None, dots, ..grid.spec().clone() }).expect("a legal scene")
    };
    let scenes = [262.0, 284.0, 312.0, 338.0].map(scene).to_vec();
    let frames = Exposures::new(truth, scenes, RAYS).frames(1);
    let calibration = calibrate(&sheet, &target(), &frames, &Choices::default()).expect("a sound calibration");
    let is_named = |advice: &String| advice.contains("(row 1, column 6, counted from 0)");
    assert!(calibration.advice.iter().any(is_named), "{:?}", calibration.advice);
    let own = calibration.doubted().filter(|residual| residual.dot == wrong).count();
    let others = calibration.doubted().count() - own;
    assert!(own >= 6 && others <= 5, "{own} {others}");
    assert!(calibration.rms_px < 0.01 && calibration.reduced_chi2 < 2.0, "{}", calibration.rms_px);
}

/// A frame moved along its rows while it was exposed.
fn blurred(frame: &Frame, reach: usize) -> Frame {
    let (width, height) = (frame.width_px(), frame.height_px());
    let page = |codes: &Vec<u16>| {
        let at = |row: usize, column: usize| {
            let span = column.saturating_sub(reach)..(column + reach + 1).min(width);
            let count = span.len() as u32;
            let sum: u32 = codes[row * width..][span].iter().map(|code| u32::from(*code)).sum();
            (sum / count) as u16
        };
        (0..height)
            .flat_map(|row| (0..width).map(move |column| (row, column)))
            .map(|(row, column)| at(row, column))
            .collect()
    };
    of_pages(frame, frame.pages().iter().map(page).collect())
}

/// A frame of a mosaic with what its red and blue pixels read exchanged in every 2 × 2 cell.
fn with_red_and_blue_exchanged(frame: &Frame) -> Frame {
    let width = frame.width_px();
    let page = |codes: &Vec<u16>| {
        let mut codes = codes.clone();
        for red in (0..codes.len()).filter(|at| (at / width).is_multiple_of(2) && (at % width).is_multiple_of(2)) {
            codes.swap(red, red + width + 1);
        }
        codes
    };
    of_pages(frame, frame.pages().iter().map(page).collect())
}

/// A frame like another one.
fn of_pages(frame: &Frame, pages: Vec<Vec<u16>>) -> Frame {
    Frame::new(frame.width_px(), frame.height_px(), frame.code_max(), pages).expect("a frame")
}
