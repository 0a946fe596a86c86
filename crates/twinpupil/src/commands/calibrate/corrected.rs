//! What was found of a smooth correction, in words.

use twinpupil_calibrate::{CorrectionFinding, significant};

/// What was decided, in one sentence.
pub(super) fn decision(finding: &CorrectionFinding) -> String {
    let errors = |held_out: Option<[twinpupil_calibrate::HeldOut; 2]>| {
        let [without, with] = held_out?.map(|held_out| significant(1e3 * held_out.z_rms_mm, 2));
        Some(format!("depth of dots in frames held out: {without} µm rms without it, {with} µm with it"))
    };
    match (finding.degree, errors(finding.held_out)) {
        (Some(degree), Some(errors)) if finding.is_kept() => {
            format!("a smooth correction up to order {degree} is kept; {errors}")
        }
        (Some(degree), Some(errors)) => format!("a smooth correction up to order {degree} is not kept; {errors}"),
        _ => "no smooth correction: none lowers the error of frames held out by more than chance".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_calibrate::HeldOut;

    use super::*;

    #[test]
    fn what_was_decided_is_told() {
        let held_out = |z_rms_mm: f64| HeldOut { z_rms_mm, z_rms_within_mm: 0.004, dots: 400 };
        let mut finding = CorrectionFinding { error_without: 40.0, trials: Vec::new(), degree: None, held_out: None };
        assert!(decision(&finding).starts_with("no smooth correction"));
        finding.degree = Some(4);
        finding.held_out = Some([held_out(0.05), held_out(0.005)]);
        let kept = "a smooth correction up to order 4 is kept; depth of dots in frames held out: 50 µm rms without it, 5.0 µm with it";
        assert_eq!(decision(&finding), kept);
        finding.held_out = Some([held_out(0.05), held_out(0.06)]);
        assert!(decision(&finding).contains("is not kept"));
    }
}
