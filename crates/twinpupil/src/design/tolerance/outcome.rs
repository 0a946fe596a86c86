//! What a tolerance run tells: how far depths are off, and by what.

use super::run::{Kind, Row, Run};
use super::source::Source;

/// What a run tells.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// As the drawing reads its cameras.
    pub before: Errors,
    /// As calibrated cameras read.
    pub after: Errors,
    /// What they are off by, the worst after calibration first.
    pub contributors: Vec<Contributor>,
    /// Cameras that cannot be built or calibrated, and why the first of them cannot.
    pub faults: usize,
    /// Why the first of them cannot.
    pub first_fault: Option<String>,
    /// Places of cameras where no depth is read.
    pub blind: usize,
}

/// Errors of depth over all cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct Errors {
    /// Root mean square over the places of every camera, mm, rising.
    pub rms_mm: Vec<f64>,
    /// The largest of all places of every camera, mm, rising.
    pub largest_mm: Vec<f64>,
    /// Root mean square over all places of all cameras, mm.
    pub all_mm: f64,
    /// The same if the contributors, each alone, simply add up, mm.
    pub added_mm: f64,
}

/// One thing that is off.
#[derive(Debug, Clone, PartialEq)]
pub struct Contributor {
    /// What it is.
    pub name: String,
    /// Its tolerance.
    pub tolerance: f64,
    /// The unit of that.
    pub unit: &'static str,
    /// Root mean square error of z that it makes alone, before calibration and after, mm.
    pub rms_mm: [f64; 2],
    /// Its share of the sum of all squares, before and after.
    pub share: [f64; 2],
}

impl Outcome {
    /// Of all rows of a run.
    pub fn of(run: &Run, rows: &[Row]) -> Self {
        let cameras = || rows.iter().enumerate().filter(|(n, _)| matches!(run.kind(*n), Kind::Camera(_)));
        let faults: Vec<&String> = rows.iter().filter_map(|row| row.reading.as_ref().err()).collect();
        let contributors = contributors(run, rows);
        let added_mm = |side: usize| contributors.iter().map(|own| own.rms_mm[side].powi(2)).sum::<f64>().sqrt();
        let readings = || cameras().filter_map(|(_, row)| row.reading.as_ref().ok());
        let errors = |side: usize, of: fn(&super::trial::Reading) -> &Vec<f64>| {
            Errors::of(readings().map(|reading| of(reading).as_slice()), added_mm(side))
        };
        let unread = |reading: &super::trial::Reading| reading.after_mm.iter().filter(|mm| mm.is_nan()).count();
        Self {
            before: errors(0, |reading| &reading.before_mm),
            after: errors(1, |reading| &reading.after_mm),
            faults: faults.len(),
            first_fault: faults.first().map(|fault| (*fault).clone()),
            blind: readings().map(unread).sum(),
            contributors,
        }
    }
}

impl Errors {
    fn of<'a>(cameras: impl Iterator<Item = &'a [f64]> + Clone, added_mm: f64) -> Self {
        let sorted = |of: fn(&[f64]) -> f64| {
            let mut values: Vec<f64> = cameras.clone().map(of).filter(|mm| mm.is_finite()).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let all: Vec<f64> = cameras.clone().flatten().copied().collect();
        Self {
            rms_mm: sorted(rms_mm),
            largest_mm: sorted(|errors| finite(errors).map(f64::abs).fold(f64::NAN, f64::max)),
            all_mm: rms_mm(&all),
            added_mm,
        }
    }
}

fn finite(errors_mm: &[f64]) -> impl Iterator<Item = f64> {
    errors_mm.iter().copied().filter(|mm| mm.is_finite())
}

/// Root mean square of the errors that are known, mm; NaN if none is.
fn rms_mm(errors_mm: &[f64]) -> f64 {
    let count = finite(errors_mm).count();
    (finite(errors_mm).map(|mm| mm * mm).sum::<f64>() / count as f64).sqrt()
}

/// The value below which a share of sorted values lies; NaN of none.
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let place = share * last as f64;
    let (below, rest) = (place.floor() as usize, place.fract());
    sorted[below] + rest * (sorted[(below + 1).min(last)] - sorted[below])
}

/// Every contributor: the mean square over its sources, each off by its standard deviation one way and the other, added up.
fn contributors(run: &Run, rows: &[Row]) -> Vec<Contributor> {
    let drawing = &run.trial.drawing;
    let mut contributors: Vec<Contributor> = Vec::new();
    for (index, own) in drawing.sources.iter().enumerate() {
        let name = own.source.contributor(&drawing.instrument, &drawing.elements);
        let square_mm2 = [0, 1].map(|side| single_square_mm2(&rows[2 * index..2 * index + 2], side));
        if !contributors.iter().any(|known| known.name == name) {
            let tolerance =
                if own.source == Source::Noise { run.tolerances.calibration.noise_px } else { own.tolerance };
            let unit = if own.source == Source::Noise { "px" } else { own.source.unit() };
            contributors.push(Contributor { name: name.clone(), tolerance, unit, rms_mm: [0.0; 2], share: [0.0; 2] });
        }
        if let Some(known) = contributors.iter_mut().find(|known| known.name == name) {
            known.rms_mm = [0, 1].map(|side| (known.rms_mm[side].powi(2) + square_mm2[side]).sqrt());
        }
    }
    for side in [0, 1] {
        let sum_mm2: f64 = contributors.iter().map(|own| own.rms_mm[side].powi(2)).sum();
        let share = |own: &Contributor| if sum_mm2 > 0.0 { own.rms_mm[side].powi(2) / sum_mm2 } else { 0.0 };
        contributors.iter_mut().for_each(|own| own.share[side] = share(own));
    }
    contributors.sort_by(|a, b| b.rms_mm[1].total_cmp(&a.rms_mm[1]).then(b.rms_mm[0].total_cmp(&a.rms_mm[0])));
    contributors
}

/// Mean square error of rows that are off by one number; 0 where nothing is read.
fn single_square_mm2(rows: &[Row], side: usize) -> f64 {
    let readings = rows.iter().filter_map(|row| row.reading.as_ref().ok());
    let errors_mm: Vec<f64> =
        readings.flat_map(|reading| [&reading.before_mm, &reading.after_mm][side].iter().copied()).collect();
    let rms_mm = rms_mm(&errors_mm);
    if rms_mm.is_finite() { rms_mm * rms_mm } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_values() {
        let sorted = [1.0, 2.0, 4.0];
        assert_eq!([0.0, 0.25, 0.5, 0.75, 1.0].map(|share| quantile(&sorted, share)), [1.0, 1.5, 2.0, 3.0, 4.0]);
        assert!(quantile(&[], 0.5).is_nan());
    }

    #[test]
    fn what_is_not_read_does_not_count() {
        assert!((rms_mm(&[3.0, f64::NAN, -4.0]) - 12.5_f64.sqrt()).abs() < 1e-12);
        assert!(rms_mm(&[f64::NAN]).is_nan());
        let cameras = [vec![3.0, f64::NAN, -4.0], vec![1.0]];
        let errors = Errors::of(cameras.iter().map(Vec::as_slice), 0.0);
        assert_eq!(errors.largest_mm, [1.0, 4.0]);
    }
}
