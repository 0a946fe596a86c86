//! The result as one page.

use super::Toleranced;
use super::text::{SPREAD, added, digits, heading, percent, ranked, remarks, spread, tolerance};
use crate::design::tolerance::{Errors, quantile};
use crate::plot::{Chart, Colour, Stroke};
use crate::report::{Column, Figure, Headline, Report};

/// Bins of the histogram, in each factor of ten.
const BINS: f64 = 6.0;

/// The page.
pub(super) fn page(toleranced: &Toleranced) -> Report {
    let outcome = &toleranced.outcome;
    let mut report = Report::new(&format!("Tolerances of {}", toleranced.name));
    report.lead(&format!(
        "{}. Before calibration, images are read with the numbers of the drawing and depth counts from where its front \
         principal plane is in the housing; after it, with the numbers that a calibration finds from seven poses of a dot \
         grid, and depth counts from a datum on that grid. A camera is calibrated at the temperature at which it was built \
         and used at another.",
        heading(toleranced)
    ));
    let at = |errors: &Errors| format!("{} mm", digits(quantile(&errors.rms_mm, 0.95)));
    let worst = ranked(&outcome.contributors, 1).first().map_or("–".to_owned(), |own| own.name.clone());
    report.headlines(&[
        Headline::new(at(&outcome.before), "rms of z of 95 % of the cameras before calibration, at most"),
        Headline::new(at(&outcome.after), "the same after calibration"),
        Headline::new(worst, "does most of what is left"),
    ]);
    report.heading("How far depths are off");
    report.table(&columns(&SPREAD), &spread(toleranced));
    report.figures(&[
        Figure::new(share_plot(toleranced), "Share of the cameras whose rms of z is smaller."),
        Figure::new(histogram(toleranced), "Cameras by their rms of z, six bins to a factor of ten."),
    ]);
    report.heading("What does it");
    report.paragraph(&format!(
        "Each contributor alone, off by its standard deviation one way and the other; shares are of the sum of all squares. \
         They tell all of it as far as they add up: before calibration {}; after it {}.",
        added(&outcome.before),
        added(&outcome.after)
    ));
    report.table(&contributor_columns(), &contributors(toleranced));
    if !remarks(toleranced).is_empty() {
        report.list(&remarks(toleranced));
    }
    report
}

fn columns<const N: usize>(heads: &[&str; N]) -> [Column; N] {
    std::array::from_fn(|k| if k == 0 { Column::text(heads[k]) } else { Column::number(heads[k]) })
}

fn contributor_columns() -> [Column; 7] {
    columns(&["", "tolerance", "before, rms of z, mm", "share", "rank", "after, rms of z, mm", "share"])
}

/// Contributors, the worst after calibration first, with their rank before it.
fn contributors(toleranced: &Toleranced) -> Vec<[String; 7]> {
    let all = &toleranced.outcome.contributors;
    let before = ranked(all, 0);
    let row = |own: &crate::design::tolerance::Contributor| {
        let rank = before.iter().position(|other| other.name == own.name).map_or(0, |place| place + 1);
        [
            own.name.clone(),
            tolerance(own),
            digits(own.rms_mm[0]),
            percent(own.share[0]),
            rank.to_string(),
            digits(own.rms_mm[1]),
            percent(own.share[1]),
        ]
    };
    ranked(all, 1).into_iter().map(row).collect()
}

/// Rms of every camera on a logarithmic axis, and the share of cameras that are better.
fn share_plot(toleranced: &Toleranced) -> String {
    let line = |errors: &Errors| -> Vec<[f64; 2]> {
        let count = errors.rms_mm.len() as f64;
        let point = |(n, mm): (usize, &f64)| [*mm, 100.0 * (n + 1) as f64 / count];
        errors.rms_mm.iter().enumerate().filter(|(_, mm)| **mm > 0.0).map(point).collect()
    };
    let outcome = &toleranced.outcome;
    Chart::new("rms of z, mm", "share of the cameras, %")
        .line("before calibration", Colour::Vermilion, Stroke::Solid, &line(&outcome.before))
        .line("after calibration", Colour::Blue, Stroke::Solid, &line(&outcome.after))
        .log_x()
        .y_range(0.0, 100.0)
        .into_svg()
}

/// Number of cameras in bins of a logarithmic axis.
fn histogram(toleranced: &Toleranced) -> String {
    let outcome = &toleranced.outcome;
    Chart::new("rms of z, mm", "cameras")
        .line("before calibration", Colour::Vermilion, Stroke::Solid, &steps(&outcome.before.rms_mm))
        .line("after calibration", Colour::Blue, Stroke::Solid, &steps(&outcome.after.rms_mm))
        .log_x()
        .into_svg()
}

/// The outline of a histogram of rising values.
fn steps(sorted: &[f64]) -> Vec<[f64; 2]> {
    let bin = |mm: &f64| (BINS * mm.log10()).floor() as i64;
    let above: Vec<i64> = sorted.iter().filter(|mm| **mm > 0.0).map(bin).collect();
    let (Some(first), Some(last)) = (above.first(), above.last()) else { return Vec::new() };
    let edge = |bin: i64| 10_f64.powf(bin as f64 / BINS);
    let mut outline = vec![[edge(*first), 0.0]];
    for bin in *first..=*last {
        let count = above.iter().filter(|own| **own == bin).count() as f64;
        outline.extend([[edge(bin), count], [edge(bin + 1), count]]);
    }
    outline.push([edge(last + 1), 0.0]);
    outline
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_histogram_counts_every_camera_once() {
        let outline = steps(&[0.011, 0.012, 0.5, 1.1]);
        let areas = outline.windows(2).filter(|pair| pair[0][1] == pair[1][1]).map(|pair| pair[0][1]);
        assert_eq!(areas.sum::<f64>(), 4.0);
        assert!(outline.windows(2).all(|pair| pair[0][0] <= pair[1][0]));
        assert!(steps(&[0.0]).is_empty() && steps(&[]).is_empty());
    }
}
