//! The result in words and tables.

use super::Toleranced;
use crate::design::tolerance::{Contributor, Errors, quantile};
use crate::text_table::render;

/// Heads of the columns that tell of errors over the cameras.
pub(super) const SPREAD: [&str; 5] = ["", "half of the cameras", "95 %", "99 %", "worst"];

/// Heads of the columns that tell of a contributor.
pub(super) const CONTRIBUTOR: [&str; 4] = ["", "tolerance", "alone, rms of z, mm", "share"];

/// Contributors that the terminal shows.
const SHOWN: usize = 8;

/// Before calibration and after it.
const SIDES: [&str; 2] = ["before calibration", "after calibration"];

/// The result as a tidy page for a terminal.
pub(super) fn tables(toleranced: &Toleranced) -> String {
    let outcome = &toleranced.outcome;
    let mut text = format!("{}\n\n{}", heading(toleranced), render(SPREAD, &spread(toleranced)));
    for side in [0, 1] {
        let ranked = ranked(&outcome.contributors, side);
        let rows: Vec<[String; 4]> = ranked.iter().take(SHOWN).map(|own| contributor(own, side)).collect();
        let errors = [&outcome.before, &outcome.after][side];
        text += &format!("\nworst {}, {}\n{}", SIDES[side], added(errors), render(CONTRIBUTOR, &rows));
    }
    for remark in remarks(toleranced) {
        text += &format!("\n{remark}\n");
    }
    text
}

/// What was run.
pub(super) fn heading(toleranced: &Toleranced) -> String {
    let Toleranced { name, spec, run, .. } = toleranced;
    format!(
        "{name}: {} cameras, {} tolerances, seed {}; z at {} places of the working volume",
        spec.cameras,
        run.tolerances.name,
        spec.seed,
        run.trial.volume.places_mm.len()
    )
}

/// Errors over the cameras, a row each.
pub(super) fn spread(toleranced: &Toleranced) -> Vec<[String; 5]> {
    let outcome = &toleranced.outcome;
    let row = |name: String, sorted: &[f64]| {
        let [half, most, nearly_all, all] = [0.5, 0.95, 0.99, 1.0].map(|share| digits(quantile(sorted, share)));
        [name, half, most, nearly_all, all]
    };
    let of = |side: usize, errors: &Errors| {
        [
            row(format!("rms of z {}, mm", SIDES[side]), &errors.rms_mm),
            row(format!("largest error of z {}, mm", SIDES[side]), &errors.largest_mm),
        ]
    };
    [of(0, &outcome.before), of(1, &outcome.after)].concat()
}

/// Contributors, the worst before calibration or after it first.
pub(super) fn ranked(contributors: &[Contributor], side: usize) -> Vec<&Contributor> {
    let mut ranked: Vec<&Contributor> = contributors.iter().collect();
    ranked.sort_by(|a, b| b.rms_mm[side].total_cmp(&a.rms_mm[side]));
    ranked
}

/// A contributor, cell by cell.
pub(super) fn contributor(own: &Contributor, side: usize) -> [String; 4] {
    [own.name.clone(), tolerance(own), digits(own.rms_mm[side]), percent(own.share[side])]
}

/// A tolerance with its unit.
pub(super) fn tolerance(own: &Contributor) -> String {
    let space = if own.unit.is_empty() { "" } else { " " };
    format!("±{}{space}{}", own.tolerance, own.unit)
}

pub(super) fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// How far contributors, each alone, add up to what all of them do together.
pub(super) fn added(errors: &Errors) -> String {
    format!("{} mm rms; each alone, added as squares, {} mm", digits(errors.all_mm), digits(errors.added_mm))
}

/// What the numbers leave out.
pub(super) fn remarks(toleranced: &Toleranced) -> Vec<String> {
    let outcome = &toleranced.outcome;
    let mut remarks = Vec::new();
    if let Some(fault) = &outcome.first_fault {
        remarks.push(format!(
            "{} of {} rows are no camera and left out; the first: {fault}",
            outcome.faults,
            toleranced.rows.len()
        ));
    }
    if outcome.blind > 0 {
        let all = toleranced.spec.cameras * toleranced.run.trial.volume.places_mm.len();
        remarks.push(format!(
            "{} of {all} places are not read: masks hide them, the sensor does not reach them, or no point shows there so",
            outcome.blind
        ));
    }
    remarks
}

/// A length in as many digits as it deserves.
pub(super) fn digits(mm: f64) -> String {
    if mm.is_nan() { "–".to_owned() } else { format!("{mm:.4}") }
}
