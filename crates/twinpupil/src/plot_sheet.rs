//! Several plots on one sheet, as SVG for a file of its own.

use crate::report::escaped;

/// Room that a plot has, with a space around it, and that of the title of a row.
const CELL: [f64; 2] = [560.0, 400.0];
const TITLE: f64 = 34.0;

/// Rows of plots, each under a title, on a white ground.
pub fn sheet(rows: &[(String, Vec<String>)]) -> String {
    let columns = rows.iter().map(|(_, plots)| plots.len()).max().unwrap_or(0);
    let (width, height) = (CELL[0] * columns as f64, (CELL[1] + TITLE) * rows.len() as f64);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
         style=\"background: white; color: #1c2126\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    for (row, (title, plots)) in rows.iter().enumerate() {
        let top = (CELL[1] + TITLE) * row as f64;
        svg += &format!(
            "<text x=\"20\" y=\"{:.0}\" fill=\"currentColor\" font-family=\"system-ui, sans-serif\" font-size=\"18\">{}</text>\n",
            top + 24.0,
            escaped(title)
        );
        for (column, plot) in plots.iter().enumerate() {
            let place = format!("<svg x=\"{:.0}\" y=\"{:.0}\"", CELL[0] * column as f64 + 10.0, top + TITLE);
            svg += &plot.replacen("<svg", &place, 1);
        }
    }
    svg + "</svg>\n"
}
