//! A grid of numbers as SVG: each in a cell whose colour tells it at a glance and whose text tells it exactly.

use crate::report::escaped;

/// Height of a cell, and the widths of a cell and of the row labels, in the drawing's own units; the page scales it.
const CELL_HEIGHT: f64 = 44.0;
const LABEL_WIDTH: f64 = 56.0;
const WIDTH: f64 = 540.0;
/// Room above and below the cells: for the title, and for the column labels and what they are.
const TOP: f64 = 26.0;
const BOTTOM: f64 = 46.0;

/// Colours from the least to the largest value: dark to bright in equal steps of lightness, cividis, which reads the same
/// under the common colour blindnesses  [Nuñez, Anderton and Renslow 2018].
const SCALE: [[f64; 3]; 6] = [
    [0.0, 34.0, 78.0],
    [53.0, 69.0, 108.0],
    [102.0, 105.0, 112.0],
    [148.0, 142.0, 119.0],
    [200.0, 184.0, 102.0],
    [254.0, 232.0, 56.0],
];

/// Lightness above which text on a colour is dark.
const DARK_TEXT_FROM: f64 = 128.0;

/// A heat map in the making. Rows run from the bottom to the top, as an axis does.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatMap {
    title: String,
    x_label: String,
    y_label: String,
    x: Vec<String>,
    y: Vec<String>,
    /// Rows of values; NaN for an empty cell.
    values: Vec<Vec<f64>>,
}

impl HeatMap {
    /// A map of `values`, one row for each of `y` with a value for each of `x`; what is not finite and above zero is an
    /// empty cell.
    pub fn new(
        title: &str,
        [x_label, y_label]: [&str; 2],
        x: Vec<String>,
        y: Vec<String>,
        values: Vec<Vec<f64>>,
    ) -> Self {
        let [title, x_label, y_label] = [title, x_label, y_label].map(str::to_owned);
        Self { title, x_label, y_label, x, y, values }
    }

    /// The drawing. Colours are even on a logarithmic scale, so that a factor looks the same everywhere.
    pub fn into_svg(self) -> String {
        let (columns, rows) = (self.x.len().max(1), self.y.len().max(1));
        let cell_width = (WIDTH - LABEL_WIDTH - 8.0) / columns as f64;
        let height = TOP + rows as f64 * CELL_HEIGHT + BOTTOM;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" \
             height=\"{height}\" role=\"img\" font-family=\"system-ui, sans-serif\" font-size=\"12\" \
             text-anchor=\"middle\">\n"
        );
        svg += &text(LABEL_WIDTH + 0.5 * cell_width * columns as f64, 15.0, "currentColor", 13.0, &self.title);
        let middle = |row: usize| TOP + (rows - row) as f64 * CELL_HEIGHT - 0.5 * CELL_HEIGHT;
        let centre = |column: usize| LABEL_WIDTH + (column as f64 + 0.5) * cell_width;
        let size = (0.36 * cell_width).clamp(7.0, 12.0);
        for (row, values) in self.values.iter().enumerate() {
            for (column, value) in values.iter().enumerate() {
                svg += &self.cell([centre(column), middle(row)], cell_width, size, *value);
            }
        }
        for (row, label) in self.y.iter().enumerate() {
            svg += &text(LABEL_WIDTH - 18.0, middle(row) + 4.0, "currentColor", 12.0, label);
        }
        let below = TOP + rows as f64 * CELL_HEIGHT;
        for (column, label) in self.x.iter().enumerate() {
            svg += &text(centre(column), below + 16.0, "currentColor", size.max(9.0), label);
        }
        svg +=
            &text(LABEL_WIDTH + 0.5 * cell_width * columns as f64, below + 38.0, "currentColor", 13.0, &self.x_label);
        let (x, y) = (12.0, TOP + 0.5 * rows as f64 * CELL_HEIGHT);
        let label = escaped(&self.y_label);
        svg += &format!(
            "<text x=\"{x}\" y=\"{y}\" fill=\"currentColor\" font-size=\"13\" transform=\"rotate(-90 {x} {y})\">{label}</text>\n"
        );
        svg + "</svg>"
    }

    fn cell(&self, [x, y]: [f64; 2], width: f64, size: f64, value: f64) -> String {
        let (left, top) = (x - 0.5 * width, y - 0.5 * CELL_HEIGHT);
        let (width, height) = (width - 1.0, CELL_HEIGHT - 1.0);
        let Some(share) = self.share(value) else {
            let empty = "fill=\"none\" stroke=\"#88888840\"";
            return format!(
                "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height}\" {empty}/>\n"
            );
        };
        let [r, g, b] = colour(share);
        let rect = format!(
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height}\" fill=\"rgb({r:.0},{g:.0},{b:.0})\"/>\n"
        );
        let lightness = 0.3 * r + 0.59 * g + 0.11 * b;
        let ink = if lightness > DARK_TEXT_FROM { "#111111" } else { "#ffffff" };
        rect + &text(x, y + 0.35 * size, ink, size, &three_digits(value))
    }

    /// Where a value lies between the least and the largest, 0 to 1.
    fn share(&self, value: f64) -> Option<f64> {
        let shown = |value: &f64| value.is_finite() && *value > 0.0;
        if !shown(&value) {
            return None;
        }
        let logs = self.values.iter().flatten().copied().filter(shown).map(f64::ln);
        let [low, high] =
            logs.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], log| [low.min(log), high.max(log)]);
        Some(if high > low { (value.ln() - low) / (high - low) } else { 0.5 })
    }
}

fn text(x: f64, y: f64, ink: &str, size: f64, content: &str) -> String {
    let content = escaped(content);
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" fill=\"{ink}\" font-size=\"{size:.1}\">{content}</text>\n")
}

fn colour(share: f64) -> [f64; 3] {
    let at = share.clamp(0.0, 1.0) * (SCALE.len() - 1) as f64;
    let below = (at as usize).min(SCALE.len() - 2);
    let (a, b, part) = (SCALE[below], SCALE[below + 1], at - below as f64);
    std::array::from_fn(|k| a[k] + part * (b[k] - a[k]))
}

/// A number above zero with at most three digits and two decimals.
fn three_digits(value: f64) -> String {
    let decimals = (2.0 - value.log10().floor()).clamp(0.0, 2.0) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(values: Vec<Vec<f64>>) -> String {
        let names = |count: usize| (0..count).map(|k| k.to_string()).collect();
        HeatMap::new("a < b", ["x", "y"], names(values.first().map_or(0, Vec::len)), names(values.len()), values)
            .into_svg()
    }

    #[test]
    fn cells_tell_their_value_and_unknown_ones_are_empty() {
        let svg = map(vec![vec![1.0, 12.34], vec![f64::NAN, 0.0]]);
        assert!(svg.contains(">1.00<") && svg.contains(">12.3<") && svg.contains("a &lt; b"), "{svg}");
        assert_eq!((svg.matches("fill=\"rgb(").count(), svg.matches("fill=\"none\"").count()), (2, 2));
        assert!(svg.contains("rgb(0,34,78)") && svg.contains("rgb(254,232,56)") && !svg.contains("NaN"));
    }

    #[test]
    fn degenerate_maps_are_drawings_too() {
        for values in [vec![], vec![vec![]], vec![vec![f64::NAN]], vec![vec![2.0]]] {
            let svg = map(values);
            assert!(svg.starts_with("<svg") && svg.ends_with("</svg>") && !svg.contains("NaN"), "{svg}");
        }
    }
}
