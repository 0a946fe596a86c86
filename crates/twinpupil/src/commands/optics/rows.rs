//! An answer as rows of numbers, each with the point of the field and the colour that it is about.

use serde::Serialize;

use super::asked::{About, Asked, View};
use crate::io::table::{Cells, Table};

/// Rows of all views, view by view, as many of each.
#[derive(Serialize)]
#[serde(transparent)]
pub(super) struct Rows<'a, N> {
    #[serde(skip)]
    pub(super) asked: &'a Asked,
    rows: Vec<Row<N>>,
}

#[derive(Serialize)]
struct Row<N> {
    #[serde(flatten)]
    about: About,
    #[serde(flatten)]
    numbers: N,
}

impl<'a, N> Rows<'a, N> {
    /// Of the numbers of every view, in the order of the views.
    pub(super) fn new(asked: &'a Asked, of_views: impl IntoIterator<Item = Vec<N>>) -> Self {
        let of_view = |(view, numbers): (View<'a>, Vec<N>)| {
            numbers.into_iter().map(move |numbers| Row { about: view.about(), numbers })
        };
        Self { asked, rows: asked.views().into_iter().zip(of_views).flat_map(of_view).collect() }
    }

    /// The numbers of all rows, each with its view.
    pub(super) fn iter(&self) -> impl Iterator<Item = (View<'a>, &N)> {
        let views = self.asked.views();
        let per_view = self.rows.len() / views.len().max(1);
        let repeated = views.into_iter().flat_map(move |view| std::iter::repeat_n(view, per_view));
        repeated.zip(self.rows.iter().map(|row| &row.numbers))
    }

    /// The columns that say what the rows are about.
    pub(super) fn about_columns(&self) -> Table {
        self.asked.table(&self.rows.iter().map(|row| &row.about).collect::<Vec<_>>())
    }

    /// A further column, empty where there is no number.
    pub(super) fn column(&self, of: fn(&N) -> Option<f64>, decimals: usize) -> Cells {
        Cells::Real(self.rows.iter().map(|row| of(&row.numbers).unwrap_or(f64::NAN)).collect(), decimals)
    }
}

/// A cell of a row for the terminal.
pub(super) fn cell(value: Option<f64>, scale: f64, decimals: usize) -> String {
    value.map_or("-".to_owned(), |value| format!("{:.decimals$}", scale * value))
}
