//! Several plots on one sheet, as SVG for a file of its own.

use crate::report::escaped;

/// Room that a plot has, with a space around it, and that of the title of a row.
const CELL: [f64; 2] = [560.0, 400.0];
const TITLE: f64 = 34.0;

/// Rows of plots, each under a title, on a white ground.
pub fn sheet(rows: &[(String, Vec<String>)]) -> String {
    let columns = rows.iter().map(|(_, plots)| plots.len()).max().unwrap_or(0);
    let title = |(row, (title, _)): (usize, &(String, Vec<String>))| (row, 0, title.clone());
    let titles: Vec<_> = rows.iter().enumerate().map(title).collect();
    let plots = rows
        .iter()
        .enumerate()
        .flat_map(|(row, (_, plots))| plots.iter().enumerate().map(move |(column, plot)| (row, column, plot.as_str())));
    laid_out([rows.len(), columns], CELL, &titles, plots)
}

/// Square plots, each under its own title, so many in a row, on a white ground.
pub fn tiles(plots: &[(String, String)], columns: usize) -> String {
    let columns = columns.min(plots.len()).max(1);
    let place = |n: usize| (n / columns, n % columns);
    let title = |(n, (title, _)): (usize, &(String, String))| (place(n).0, place(n).1, title.clone());
    let titles: Vec<_> = plots.iter().enumerate().map(title).collect();
    let drawn = plots.iter().enumerate().map(|(n, (_, plot))| (place(n).0, place(n).1, plot.as_str()));
    laid_out([plots.len().div_ceil(columns), columns], [CELL[0], CELL[0]], &titles, drawn)
}

/// Titles and plots, each in its row and column.
fn laid_out<'a>(
    [rows, columns]: [usize; 2],
    cell: [f64; 2],
    titles: &[(usize, usize, String)],
    plots: impl Iterator<Item = (usize, usize, &'a str)>,
) -> String {
    let (width, height) = (cell[0] * columns as f64, (cell[1] + TITLE) * rows as f64);
    let top = |row: usize| (cell[1] + TITLE) * row as f64;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
         style=\"background: white; color: #1c2126\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    for (row, column, title) in titles {
        svg += &format!(
            "<text x=\"{:.0}\" y=\"{:.0}\" fill=\"currentColor\" font-family=\"system-ui, sans-serif\" \
             font-size=\"18\">{}</text>\n",
            cell[0] * *column as f64 + 20.0,
            top(*row) + 24.0,
            escaped(title)
        );
    }
    for (row, column, plot) in plots {
        let place = format!("<svg x=\"{:.0}\" y=\"{:.0}\"", cell[0] * column as f64 + 10.0, top(row) + TITLE);
        svg += &plot.replacen("<svg", &place, 1);
    }
    svg + "</svg>\n"
}
