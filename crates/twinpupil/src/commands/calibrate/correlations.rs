//! How the numbers of a calibration hang together.

use twinpupil_calibrate::{Calibration, Number};

use crate::plot::Colour;
use crate::report::escaped;

/// Two numbers and their correlation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pair {
    pub(super) first: usize,
    pub(super) second: usize,
    pub(super) correlation: f64,
}

/// The pairs whose correlation is beyond a limit, the strongest first, so many at most.
pub(super) fn strongest(calibration: &Calibration, beyond: f64, count: usize) -> Vec<Pair> {
    let named: Vec<usize> = calibration.named().map(|(index, _)| index).collect();
    let pair =
        |first: usize, second: usize| Pair { first, second, correlation: correlation(calibration, first, second) };
    let mut pairs: Vec<Pair> = (0..named.len())
        .flat_map(|place| (0..place).map(move |before| (before, place)))
        .map(|(before, place)| pair(named[before], named[place]))
        .filter(|pair| pair.correlation.abs() > beyond)
        .collect();
    pairs.sort_by(|a, b| b.correlation.abs().total_cmp(&a.correlation.abs()));
    pairs.truncate(count);
    pairs
}

fn correlation(calibration: &Calibration, first: usize, second: usize) -> f64 {
    let covariance = &calibration.covariance;
    let share = covariance[(first, second)] / (covariance[(first, first)] * covariance[(second, second)]).sqrt();
    if share.is_finite() { share.clamp(-1.0, 1.0) } else { 0.0 }
}

/// Width of the drawing, of the keys beside it, and the largest side of a cell, in its own units; the page scales it.
const WIDTH: f64 = 860.0;
const KEYS: f64 = 270.0;
const CELL_MAX: f64 = 34.0;

/// Correlation from which a cell tells it in figures.
const TOLD: f64 = 0.8;

/// All correlations as a triangle of cells whose colour tells the sign and whose depth tells the size.
pub(super) fn triangle(calibration: &Calibration) -> String {
    let numbers: Vec<(usize, &Number)> = calibration.named().collect();
    let cell = ((WIDTH - KEYS) / numbers.len().max(1) as f64).min(CELL_MAX);
    let (width, height) = (KEYS + cell * numbers.len() as f64, cell * (numbers.len() as f64 + 1.0));
    let size = (0.42 * cell).clamp(5.0, 12.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.1} {height:.1}\" width=\"{width:.1}\" \
         height=\"{height:.1}\" role=\"img\" font-family=\"system-ui, sans-serif\" font-size=\"{size:.1}\">\n"
    );
    for (row, (index, number)) in numbers.iter().enumerate() {
        let baseline = (row as f64 + 0.5) * cell + 0.36 * size;
        svg += &label([KEYS - 8.0, baseline], "end", &format!("{}  {}", number.key, row + 1));
        for (column, (beside, other)) in numbers[..=row].iter().enumerate() {
            let names = [&other.key, &number.key];
            svg += &square(cell, [column, row], size, names, correlation(calibration, *beside, *index));
        }
    }
    for column in 0..numbers.len() {
        let at = [KEYS + (column as f64 + 0.5) * cell, (numbers.len() as f64 + 0.5) * cell + 0.36 * size];
        svg += &label(at, "middle", &(column + 1).to_string());
    }
    svg + "</svg>"
}

fn label([x, y]: [f64; 2], anchor: &str, content: &str) -> String {
    let content = escaped(content);
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"currentColor\">{content}</text>\n")
}

fn square(cell: f64, [column, row]: [usize; 2], size: f64, names: [&String; 2], correlation: f64) -> String {
    let [left, top] = [KEYS + column as f64 * cell, row as f64 * cell];
    let side = cell - 1.0;
    if column == row {
        return format!(
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{side:.1}\" height=\"{side:.1}\" fill=\"#88888840\"/>\n"
        );
    }
    let colour = if correlation < 0.0 { Colour::Blue } else { Colour::Vermilion }.css();
    let (depth, tip) = (correlation.abs(), escaped(&format!("{} and {}: {correlation:.3}", names[0], names[1])));
    let mut text = format!(
        "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{side:.1}\" height=\"{side:.1}\" fill=\"{colour}\" \
         fill-opacity=\"{depth:.2}\" stroke=\"#88888830\"><title>{tip}</title></rect>\n"
    );
    if depth >= TOLD {
        // Two digits, of which the last never makes a 1 of what is less.
        let percent = (100.0 * depth).floor();
        let (x, y) = (left + 0.5 * side, top + 0.5 * side + 0.36 * size);
        text += &format!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\" fill=\"#ffffff\" font-size=\"{:.1}\" \
             pointer-events=\"none\">.{:02.0}</text>\n",
            0.95 * size,
            percent.min(99.0)
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::page::tests::calibration;
    use super::*;

    #[test]
    fn the_strongest_come_first() {
        let pairs = strongest(&calibration(), 0.5, 10);
        assert_eq!(pairs.len(), 1);
        assert_eq!((pairs[0].first, pairs[0].second), (0, 1));
        assert!((pairs[0].correlation + 0.95).abs() < 1e-12);
        assert!(strongest(&calibration(), 0.5, 0).is_empty());
    }

    #[test]
    fn every_pair_has_a_cell() {
        let svg = triangle(&calibration());
        assert_eq!(svg.matches("<title>").count(), 3);
        assert!(svg.contains("sensor.distance_mm and sensor.axis_px[0]: -0.950") && svg.contains(">.95<"), "{svg}");
        assert!(!svg.contains("NaN"));
        let mut none = calibration();
        none.numbers.clear();
        assert!(triangle(&none).ends_with("</svg>"));
    }
}
