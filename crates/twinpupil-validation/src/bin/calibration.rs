//! Prints what calibration makes of cameras off their data sheet: `calibration [TIMES [SEED [RAYS [CAMERA]]]]`, TIMES
//! calibrations each, of frames simulated with RAYS rays a pixel; of one camera alone if its number is given.

use std::io::Write;
use std::time::Instant;

use rayon::prelude::*;
use twinpupil_calibrate::{CalibrateError, Calibration, Choices, Number, Quantity};
use twinpupil_instrument::{Instrument, Mosaic};
use twinpupil_simulate::Scene;
use twinpupil_validation::calibration::{
    DepthError, Exposures, POSES, axis, calibrate, calibrated, data_sheet, off_data_sheet, target,
};
use twinpupil_validation::plates::Pose;

/// Rays a pixel if nothing else is asked for.
const RAYS: usize = 1024;

/// What one calibration should keep to, mm.
const RMS_MM: f64 = 0.01;
const MAX_MM: f64 = 0.05;

/// Other frames: random dots.
const PLATES: [Pose; 4] = [Pose::Facing(262.0), Pose::Facing(290.0), Pose::Facing(338.0), Pose::Tilted(25.0)];

/// A camera, whether it is bent, and how often it is calibrated.
struct Run {
    mosaic: Mosaic,
    is_bent: bool,
    times: u64,
    seed: u64,
    rays: usize,
}

fn main() -> std::io::Result<()> {
    let argument = |place: usize| std::env::args().nth(place).and_then(|text| text.parse::<u64>().ok());
    let (times, seed) = (argument(1).unwrap_or(1).max(1), argument(2).unwrap_or(1));
    let rays = argument(3).map_or(RAYS, |rays| rays as usize);
    let mut out = std::io::stdout().lock();
    let cameras = [(Mosaic::Rgb, false), (Mosaic::Rgb, true), (Mosaic::Rggb, false)];
    for (number, (mosaic, is_bent)) in (1..).zip(cameras) {
        if argument(4).is_none_or(|only| only == number) {
            Run { mosaic, is_bent, times, seed, rays }.print(&mut out)?;
        }
    }
    Ok(())
}

/// What one of many calibrations came to.
struct Outcome {
    seconds: f64,
    calibration: Calibration,
    errors: Vec<DepthError>,
    dots: usize,
}

impl Run {
    fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        let Self { mosaic, is_bent, times, seed, rays } = *self;
        let bent = if is_bent { ", sensor tilted by 0.3°, distortion 0.1 %" } else { "" };
        writeln!(out, "{}{bent}", mosaic.name())?;
        let (sheet, target) = (data_sheet(mosaic), target());
        let truth = off_data_sheet(&sheet, is_bent);
        let targets = Exposures::of_target(truth.clone(), &target, &POSES, rays);
        let plates: Vec<Scene> = PLATES.iter().map(|pose| pose.scene(seed)).collect();
        let plates = Exposures::new(truth.clone(), plates, rays);
        let (before, _) = plates.depth_errors(&sheet, seed);
        let (known, _) = plates.depth_errors(&truth, seed);
        writeln!(
            out,
            "  rms of z: {:.3} mm off the data sheet, {:.4} mm if the camera is known",
            DepthError::rms_mm(&before),
            DepthError::rms_mm(&known)
        )?;
        // The first alone, so that its time is that of one.
        let one = |time: u64| -> Result<Outcome, CalibrateError> {
            let frames = targets.frames(seed + time);
            let start = Instant::now();
            let calibration = calibrate(&sheet, &target, &frames, &Choices::default())?;
            let seconds = start.elapsed().as_secs_f64();
            let (errors, dots) = plates.depth_errors(&calibrated(&calibration), seed + time);
            Ok(Outcome { seconds, calibration, errors, dots })
        };
        let first = one(0);
        if let Ok(first) = &first {
            print_numbers(out, &first.calibration, &truth)?;
        }
        let others: Vec<_> = (1..times).into_par_iter().map(one).collect();
        let mut tally = Tally::default();
        for (time, outcome) in std::iter::once(first).chain(others).enumerate() {
            match outcome {
                Ok(outcome) => {
                    outcome.print(out, time)?;
                    tally.add(&outcome.calibration, &truth, &outcome.errors);
                }
                Err(error) => writeln!(out, "  {time}: {error}")?,
            }
        }
        tally.print(out)?;
        self.print_axis(out, &sheet, &truth)
    }

    fn print_axis(&self, out: &mut impl Write, sheet: &Instrument, truth: &Instrument) -> std::io::Result<()> {
        let random = Exposures::new(truth.clone(), vec![Pose::Facing(262.0).scene(self.seed)], self.rays);
        let mut centred = truth.clone().into_spec();
        centred.sensor.axis_px = sheet.sensor.axis_px;
        let start = Instant::now();
        match axis(&Instrument::new(centred).expect("a legal instrument"), &random.frames(self.seed)) {
            Ok(found) => {
                let off = [0, 1].map(|k| found.axis_px[k] - truth.sensor.axis_px[k]);
                let std = [0, 1].map(|k| found.covariance_px2[k][k].sqrt());
                let seconds = start.elapsed().as_secs_f64();
                writeln!(
                    out,
                    "  axis from one frame: off by {off:.4?} px ± {std:.4?}, χ² {:.2}, {seconds:.2} s",
                    found.reduced_chi2
                )
            }
            Err(error) => writeln!(out, "  axis: {error}"),
        }
    }
}

impl Outcome {
    fn print(&self, out: &mut impl Write, time: usize) -> std::io::Result<()> {
        let Self { seconds, calibration, errors, dots } = self;
        writeln!(
            out,
            "  {time}: {seconds:.2} s, χ² {:.2}, {:.4} px rms; rms of z {:.4} mm, at most {:.4}, {} of {dots} dots",
            calibration.reduced_chi2,
            calibration.rms_px,
            DepthError::rms_mm(errors),
            DepthError::max_mm(errors),
            errors.len()
        )
    }
}

/// The first of many, number by number.
fn print_numbers(out: &mut impl Write, calibration: &Calibration, truth: &Instrument) -> std::io::Result<()> {
    writeln!(out, "  held out {:?}", calibration.held_out)?;
    for number in &calibration.numbers {
        let expected = true_value(number, truth);
        let sigmas = (number.value - expected) / number.std;
        writeln!(
            out,
            "  {:40} {:13.7} ± {:.7}, true {expected:13.7}, off by {sigmas:5.2} σ  {:?}",
            number.key, number.value, number.std, number.left_open
        )?;
    }
    calibration.faults.iter().try_for_each(|(frame, fault)| writeln!(out, "  frame {frame}: {fault}"))?;
    calibration.advice.iter().try_for_each(|advice| writeln!(out, "  advice: {advice}"))
}

fn true_value(number: &Number, truth: &Instrument) -> f64 {
    match number.quantity {
        Quantity::Instrument(parameter) => parameter.value(truth),
        Quantity::DotDiameter => 1.0,
    }
}

/// Errors over deviations of many calibrations.
#[derive(Default)]
struct Tally {
    keys: Vec<String>,
    sums: Vec<f64>,
    squares: Vec<f64>,
    calibrations: usize,
    depth_squares: f64,
    depths: usize,
    /// Sum of the squared errors of depth, mm², and how many calibrations keep to the targets.
    squares_mm2: f64,
    kept: usize,
}

impl Tally {
    fn add(&mut self, calibration: &Calibration, truth: &Instrument, errors: &[DepthError]) {
        self.keys = calibration.numbers.iter().map(|number| number.key.clone()).collect();
        self.sums.resize(self.keys.len(), 0.0);
        self.squares.resize(self.keys.len(), 0.0);
        for ((sum, square), number) in self.sums.iter_mut().zip(&mut self.squares).zip(&calibration.numbers) {
            let sigmas = (number.value - true_value(number, truth)) / number.std;
            (*sum, *square) = (*sum + sigmas, *square + sigmas * sigmas);
        }
        self.calibrations += 1;
        let sigmas2 =
            |error: &DepthError| error.z_mm.powi(2) / (error.noise_std_mm.powi(2) + error.calibration_std_mm.powi(2));
        self.squares_mm2 += errors.iter().map(|error| error.z_mm.powi(2)).sum::<f64>();
        self.kept += usize::from(DepthError::rms_mm(errors) <= RMS_MM && DepthError::max_mm(errors) <= MAX_MM);
        self.depth_squares += errors.iter().map(sigmas2).sum::<f64>();
        self.depths += errors.len();
    }

    fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        if self.calibrations < 2 {
            return Ok(());
        }
        let count = self.calibrations as f64;
        writeln!(out, "  error over deviation, rms and mean of {} calibrations:", self.calibrations)?;
        for ((key, sum), square) in self.keys.iter().zip(&self.sums).zip(&self.squares) {
            writeln!(out, "  {key:40} {:.2} {:5.2}", (square / count).sqrt(), sum / count)?;
        }
        let of_dots = |squares: f64| (squares / self.depths.max(1) as f64).sqrt();
        writeln!(out, "  depth of dots {:.2}", of_dots(self.depth_squares))?;
        writeln!(
            out,
            "  rms of z over all {:.4} mm; rms <= {RMS_MM} mm and none off by more than {MAX_MM} mm in {} of {}",
            of_dots(self.squares_mm2),
            self.kept,
            self.calibrations
        )
    }
}
