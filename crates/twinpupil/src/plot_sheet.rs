//! Several plots on one sheet, for a file of its own.

use crate::drawing::{Anchor, Drawing};

/// Room that a plot has, with a space around it, and that of the title of a row.
const CELL: [f64; 2] = [560.0, 400.0];
const TITLE: f64 = 34.0;

/// Size of the letters of titles.
const LETTERS: u32 = 18;

/// Rows of plots, each under a title, on a white ground.
pub fn sheet(rows: Vec<(String, Vec<Drawing>)>) -> Drawing {
    let columns = rows.iter().map(|(_, plots)| plots.len()).max().unwrap_or(0);
    let mut sheet = Sheet::new([rows.len(), columns], CELL);
    for (row, (title, plots)) in rows.into_iter().enumerate() {
        sheet.title([row, 0], &title);
        plots.into_iter().enumerate().for_each(|(column, plot)| sheet.plot([row, column], plot));
    }
    sheet.drawing
}

/// Square plots, each under its own title, so many in a row, on a white ground.
pub fn tiles(plots: Vec<(String, Drawing)>, columns: usize) -> Drawing {
    let columns = columns.min(plots.len()).max(1);
    let mut sheet = Sheet::new([plots.len().div_ceil(columns), columns], [CELL[0], CELL[0]]);
    for (n, (title, plot)) in plots.into_iter().enumerate() {
        let place = [n / columns, n % columns];
        sheet.title(place, &title);
        sheet.plot(place, plot);
    }
    sheet.drawing
}

/// A drawing in rows and columns.
struct Sheet {
    cell: [f64; 2],
    drawing: Drawing,
}

impl Sheet {
    fn new([rows, columns]: [usize; 2], cell: [f64; 2]) -> Self {
        Self { cell, drawing: Drawing::new([cell[0] * columns as f64, (cell[1] + TITLE) * rows as f64]) }
    }

    fn corner(&self, [row, column]: [usize; 2]) -> [f64; 2] {
        [self.cell[0] * column as f64, (self.cell[1] + TITLE) * row as f64]
    }

    fn title(&mut self, place: [usize; 2], title: &str) {
        let [x, y] = self.corner(place);
        self.drawing.text([x + 20.0, y + 24.0], Anchor::Start, LETTERS, title);
    }

    fn plot(&mut self, place: [usize; 2], plot: Drawing) {
        let [x, y] = self.corner(place);
        self.drawing.place(plot, [x + 10.0, y + TITLE]);
    }
}
