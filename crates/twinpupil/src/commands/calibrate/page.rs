//! The report as one page.

use twinpupil_calibrate::{
    Calibration, CorrectionFinding, CorrectionTrial, Fault, FrameResult, LeftOpen, Number, Target, significant,
};
use twinpupil_instrument::Instrument;

use super::corrected::decision;
use super::correlations::{self, Pair};
use super::measured::{measured, stated};
use super::plots;
use super::residuals::{PixelUnit, spots};
use crate::report::{Column, Figure, Headline, Report};

/// What is reported.
#[derive(Debug, Clone, Copy)]
pub(super) struct Findings<'a> {
    /// What came out.
    pub(super) calibration: &'a Calibration,
    /// The instrument as it is written, with its `[calibration]`.
    pub(super) instrument: &'a Instrument,
    /// What it was calibrated with.
    pub(super) target: &'a Target,
    /// Names of all frames, by index.
    pub(super) frames: &'a [String],
}

/// The page.
pub(super) fn page(findings: &Findings<'_>) -> Report {
    let mut report = Report::new(&format!("Calibration of {}", findings.instrument.name));
    report.lead(&lead(findings));
    report.headlines(&headlines(findings));
    advice(&mut report, findings);
    numbers(&mut report, findings.calibration);
    correlated(&mut report, findings.calibration);
    residuals(&mut report, findings);
    correction(&mut report, findings.calibration);
    depth(&mut report, findings);
    frames(&mut report, findings);
    report
}

fn lead(Findings { calibration, instrument, target, frames }: &Findings<'_>) -> String {
    let spec = target.spec();
    let date = instrument.calibration.as_ref().map(|own| format!(" on {}", own.date)).unwrap_or_default();
    format!(
        "Computed{date} from {} of {} frames of “{}”: {} columns × {} rows of dots of {} mm, {} mm apart. The pitch is taken \
         as exact: an error of it would scale everything.",
        calibration.frames.len(),
        frames.len(),
        spec.name,
        spec.columns,
        spec.rows,
        spec.dot_diameter_mm,
        spec.pitch_mm
    )
}

fn headlines(Findings { calibration, frames, .. }: &Findings<'_>) -> Vec<Headline> {
    let mut headlines = vec![
        Headline::new(
            format!("{} px", significant(calibration.rms_px, 2)),
            "root mean square distance of the spots from where the calibrated camera sees them",
        ),
        Headline::new(
            format!("{:.2}", calibration.reduced_chi2),
            "χ² for each degree of freedom: 1 if noise is all that is left",
        ),
    ];
    headlines.extend(calibration.held_out.map(|held_out| {
        let [out, within] = [held_out.z_rms_mm, held_out.z_rms_within_mm].map(|mm| significant(1e3 * mm, 2));
        let label = format!(
            "root mean square depth error of {} dots in frames that took no part; {within} µm in those that did",
            held_out.dots
        );
        Headline::new(format!("{out} µm"), label)
    }));
    let spots = calibration.residuals.len();
    let doubted = match calibration.doubted().count() {
        0 => String::new(),
        some => format!(", of which {some} lie so far from where they should that they hardly count"),
    };
    headlines.push(Headline::new(
        format!("{} of {}", calibration.frames.len(), frames.len()),
        format!("frames used, with {spots} spots in {} bands{doubted}", calibration.instrument.bands.len()),
    ));
    headlines
}

fn advice(report: &mut Report, Findings { calibration, frames, .. }: &Findings<'_>) {
    report.heading("What would make it better");
    let advice: Vec<String> = calibration.advice.iter().map(|advice| sentence(advice)).collect();
    if advice.is_empty() {
        report.paragraph(
            "Nothing stands out: the poses cover the depth range and the sensor, and determine every number.",
        );
    } else {
        report.list(&advice);
    }
    if !calibration.faults.is_empty() {
        report.subheading("Frames left out");
        let line = |(frame, fault): &Fault| format!("{}: {fault}.", name(frames, *frame));
        report.list(&calibration.faults.iter().map(line).collect::<Vec<_>>());
    }
}

/// With a capital and a full stop, but for a key, which keeps its letters.
fn sentence(text: &str) -> String {
    let is_key = text.split(' ').next().is_some_and(|word| word.contains(['.', '_', '[']));
    let mut letters = text.chars();
    let first =
        letters.next().map(|letter| if is_key { letter.to_string() } else { letter.to_uppercase().to_string() });
    format!("{}{}.", first.unwrap_or_default(), letters.as_str())
}

fn numbers(report: &mut Report, calibration: &Calibration) {
    report.heading("The numbers");
    let enlarged = match calibration.reduced_chi2.sqrt() {
        factor if factor > 1.0 => {
            format!(" Deviations are {factor:.2} times those of noise alone, as the residuals ask for.")
        }
        _ => String::new(),
    };
    report.paragraph(&format!(
        "Each begins from the data sheet with a tolerance, and is held there where the frames do not tell.{enlarged}"
    ));
    let columns = [
        Column::text("number"),
        Column::number("data sheet"),
        Column::number("found"),
        Column::number("tolerances off"),
        Column::text(""),
    ];
    let row = |number: &Number| {
        let off = (number.value - number.expected) / number.tolerance;
        // Without the sign of a rounded zero.
        let rounded = (100.0 * off).round() / 100.0 + 0.0;
        [
            number.key.clone(),
            stated(number.expected, number.tolerance),
            measured(number.value, number.std),
            format!("{rounded:+.2}"),
            remark(number, off),
        ]
    };
    report.table(&columns, &calibration.named().map(|(_, number)| row(number)).collect::<Vec<_>>());
}

fn remark(number: &Number, off: f64) -> String {
    const FAR: f64 = 3.0;
    match &number.left_open {
        None if off.abs() > FAR => "far from the data sheet".to_owned(),
        None => String::new(),
        Some(LeftOpen::Unseen) => "not determined: the frames hardly depend on it".to_owned(),
        Some(LeftOpen::Tied { with, correlation }) => {
            format!("not determined: a change of {with} does about the same (correlation {correlation:.3})")
        }
    }
}

fn correlated(report: &mut Report, calibration: &Calibration) {
    const STRONG: f64 = 0.9;
    const PAIRS_MAX: usize = 10;
    report.heading("How they hang together");
    report.paragraph(
        "Numbers that are strongly correlated are known better together than each by itself; the instrument file keeps \
         all correlations, and deviations of points take them into account.",
    );
    let pairs = correlations::strongest(calibration, STRONG, PAIRS_MAX);
    if pairs.is_empty() {
        report.paragraph(&format!("No two are correlated by more than {STRONG}."));
    } else {
        let columns = [Column::text("number"), Column::text("with"), Column::number("correlation")];
        let key = |index: usize| calibration.numbers[index].key.clone();
        let row = |pair: &Pair| [key(pair.first), key(pair.second), format!("{:+.4}", pair.correlation)];
        report.table(&columns, &pairs.iter().map(row).collect::<Vec<_>>());
    }
    report.figures(&[Figure::new(
        correlations::triangle(calibration),
        "All correlations: blue below 0, vermilion above it, the deeper the stronger; in figures from 0.8 on.",
    )]);
}

fn residuals(report: &mut Report, Findings { calibration, target, .. }: &Findings<'_>) {
    let unit = PixelUnit::of(calibration.rms_px);
    report.heading("What the frames say against it");
    report.paragraph(
        "How far the pixels of every dot would have its image moved. If the model of the camera holds, arrows point \
         anywhere and means lie on the line.",
    );
    report.figures(&plots::residual_maps(calibration, unit));
    report.figures(&plots::trends(&calibration.instrument, &spots(calibration), unit));
    if let Some(offsets_mm) = &calibration.offsets_mm {
        report.figures(&[plots::target_map(target, offsets_mm)]);
    }
}

fn correction(report: &mut Report, calibration: &Calibration) {
    let Some(finding) = &calibration.correction else { return };
    report.heading("A smooth correction of what is left");
    report.paragraph(&sentence(&decision(finding)));
    report.paragraph(
        "A field of displacements in every band, up to several orders, is sought together with the numbers without one part \
         of the frames after the other; then those say how well they fit. What numbers of the camera or poses do as well is \
         left to them: shift, scale, tilt and the first term of distortion. A correction is worth it if χ² of the frames held \
         out falls by more than two of its standard errors, and depth in them gets better.",
    );
    let columns = [
        Column::text("terms"),
        Column::number("coefficients"),
        Column::number("error over deviation, held out"),
        Column::number("gain in standard errors"),
    ];
    let none = ["none".to_owned(), "0".to_owned(), format!("{:.3}", finding.error_without), String::new()];
    let row = |trial: &CorrectionTrial| {
        [
            format!("up to order {}{}", trial.degree, if is_chosen(finding, trial) { ", chosen" } else { "" }),
            trial.coefficients.to_string(),
            format!("{:.3}", trial.error),
            format!("{:+.1}", trial.gain_sigmas),
        ]
    };
    report.table(&columns, &std::iter::once(none).chain(finding.trials.iter().map(row)).collect::<Vec<_>>());
    if finding.is_kept() {
        report.figures(&plots::correction_maps(&calibration.instrument));
    }
}

fn is_chosen(finding: &CorrectionFinding, trial: &CorrectionTrial) -> bool {
    finding.degree == Some(trial.degree)
}

fn depth(report: &mut Report, Findings { calibration, instrument, .. }: &Findings<'_>) {
    report.heading("What it leaves uncertain of depth");
    let coverage = plots::coverage(&spots(calibration), instrument);
    report.figures(&plots::depth_map(instrument).into_iter().chain([coverage]).collect::<Vec<_>>());
}

fn frames(report: &mut Report, Findings { calibration, frames, .. }: &Findings<'_>) {
    report.heading("The frames");
    let columns = [
        Column::text("frame"),
        Column::number("distance, mm"),
        Column::number("tilt, °"),
        Column::number("spots"),
        Column::number("rms, 10⁻³ px"),
        Column::number("χ² of the pixels"),
    ];
    let row = |frame: &FrameResult| {
        [
            name(frames, frame.frame),
            measured(frame.pose.translation_mm.z, frame.pose_std[5]),
            format!("{:.2}", frame.pose.tilt_rad().to_degrees()),
            frame.spots.to_string(),
            significant(1e3 * frame.rms_px, 2),
            format!("{:.2}", frame.pixel_chi2),
        ]
    };
    report.table(&columns, &calibration.frames.iter().map(row).collect::<Vec<_>>());
    report.paragraph(
        "χ² of the pixels is that about the forward model over their number: 1 if noise is all that is left.",
    );
}

fn name(frames: &[String], index: usize) -> String {
    frames.get(index).cloned().unwrap_or_else(|| format!("frame {index}"))
}

#[cfg(test)]
pub(super) mod tests {
    use nalgebra::{DMatrix, Rotation3, Vector3};
    use twinpupil_calibrate::{FrameFault, HeldOut, Pose, Quantity, Residual, TargetKind, TargetSpec};
    use twinpupil_instrument::{CalibrationSpec, Parameter, paper};

    use super::*;

    /// Three numbers from two frames with four spots in each band.
    pub(in super::super) fn calibration() -> Calibration {
        let parameters = [Parameter::SensorDistance, Parameter::Axis(0), Parameter::Tilt(0)];
        let instrument = paper::instrument();
        let number = |(k, parameter): (usize, Parameter)| Number {
            quantity: Quantity::Instrument(parameter),
            key: parameter.key(&instrument),
            expected: parameter.value(&instrument),
            tolerance: 1.0,
            value: parameter.value(&instrument) + [0.5, 3.5, 0.0][k],
            std: 0.1,
            left_open: (k == 2).then_some(LeftOpen::Unseen),
        };
        let numbers = parameters.into_iter().enumerate().map(number).collect();
        let covariance = DMatrix::from_row_slice(3, 3, &[0.01, -0.0095, 0.0, -0.0095, 0.01, 0.004, 0.0, 0.004, 0.01]);
        let frame = |frame: usize| FrameResult {
            frame,
            pose: Pose { rotation: Rotation3::identity(), translation_mm: Vector3::new(0.0, 0.0, 280.0) },
            pose_std: [1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 2e-3],
            spots: 8,
            rms_px: 0.002,
            pixel_chi2: 1.01,
            off_stage: None,
        };
        let residual = |k: usize| Residual {
            frame: 2 * (k / 8),
            band: k % 2,
            dot: k / 2 % 4,
            foreseen_px: [300.0 + 90.0 * k as f64, 200.0 + 50.0 * k as f64, 40.0, 3.0],
            off_px: [0.001, -0.002, 0.0, 0.0],
            std_px: [0.002; 4],
            chi2: 4.0,
            is_doubted: false,
            is_cut: false,
            position_mm: [k as f64 - 8.0, 2.0, 280.0],
        };
        Calibration {
            numbers,
            covariance,
            frames: vec![frame(0), frame(2)],
            faults: vec![(1, FrameFault::NoPose)],
            residuals: (0..16).map(residual).collect(),
            offsets_mm: None,
            reduced_chi2: 1.44,
            rms_px: 0.002,
            held_out: Some(HeldOut { z_rms_mm: 0.0042, z_rms_within_mm: 0.0034, dots: 8 }),
            correction: Some(CorrectionFinding {
                error_without: 1.04,
                trials: vec![CorrectionTrial { degree: 2, coefficients: 14, error: 1.07, gain_sigmas: -2.2 }],
                degree: None,
                held_out: None,
            }),
            unrest_sigmas: 0.0,
            contradictions: Vec::new(),
            advice: vec!["no pose is tilted".to_owned(), "sensor.tilt_deg[0] is not determined".to_owned()],
            instrument,
        }
    }

    fn target() -> Target {
        Target::new(TargetSpec {
            schema: 1,
            name: "a <grid>".to_owned(),
            kind: TargetKind::DotGrid,
            rows: 3,
            columns: 3,
            pitch_mm: 2.0,
            dot_diameter_mm: 1.0,
            fiducials: Vec::new(),
        })
        .unwrap()
    }

    fn finished(calibration: &Calibration) -> Instrument {
        let mut spec = calibration.instrument.clone().into_spec();
        spec.calibration = Some(CalibrationSpec {
            date: "2026-11-25".to_owned(),
            target: "a <grid>".to_owned(),
            rms_px: 0.002,
            reduced_chi2: 1.44,
            parameters: calibration.numbers.iter().map(|number| number.key.clone()).collect(),
            std: vec![0.1; 3],
            correlation: vec![vec![1.0], vec![-0.95, 1.0], vec![0.0, 0.4, 1.0]],
            frames: Vec::new(),
        });
        Instrument::new(spec).unwrap()
    }

    fn html(calibration: &Calibration) -> String {
        let (instrument, target) = (finished(calibration), target());
        let frames = ["a.png", "b.png", "c.png"].map(str::to_owned);
        page(&Findings { calibration, instrument: &instrument, target: &target, frames: &frames }).into_html()
    }

    #[test]
    fn everything_that_was_found_is_told() {
        let html = html(&calibration());
        for text in [
            "Computed on 2026-11-25 from 2 of 3 frames of “a &lt;grid&gt;”",
            "<dd>0.0020 px</dd>",
            "<dd>4.2 µm</dd>",
            "<li>No pose is tilted.</li>",
            "<li>sensor.tilt_deg[0] is not determined.</li>",
            "<li>b.png: the dots that both bands show",
            "151.50 ± 0.10",
            "+0.50",
            "not determined: the frames hardly depend on it",
            "far from the data sheet",
            "1.20 times those of noise alone",
            "-0.9500",
            "σ_z, µm",
            "280.0000 ± 0.0020",
            "No smooth correction: none lowers",
            "<td>up to order 2</td>",
        ] {
            assert!(html.contains(text), "{text} is missing in {html}");
        }
        assert!(!html.contains("NaN") && !html.contains("inf "), "{html}");
    }

    #[test]
    fn little_makes_a_page_too() {
        let mut little = calibration();
        little.residuals.clear();
        little.frames.clear();
        little.held_out = None;
        little.advice.clear();
        little.rms_px = 0.0;
        little.offsets_mm = Some(Vec::new());
        let page = html(&little);
        assert!(page.contains("Nothing stands out") && !page.contains("NaN"), "{page}");
        little.advice.push("residuals are 2.0 times what noise explains".to_owned());
        assert!(html(&little).contains("<li>Residuals are 2.0 times what noise explains"));
    }
}
