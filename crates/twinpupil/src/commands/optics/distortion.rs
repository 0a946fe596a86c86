//! `twinpupil optics distortion`: where chief rays meet the image, and where light about them comes together.

use anyhow::Result;
use clap::Args as ClapArgs;
use serde::Serialize;

use super::answer::{Answer, Form};
use super::asked::{Asked, AskedArgs, View};
use super::rows::{Rows, cell};
use crate::console::Console;
use crate::drawing::Drawing;
use crate::io::table::Table;
use crate::plot::{Chart, Stroke};
use crate::plot_sheet::sheet;
use crate::text_table::render;

/// `twinpupil optics distortion …`.
#[derive(Debug, ClapArgs)]
pub struct Args {
    /// What is asked about.
    #[command(flatten)]
    asked: AskedArgs,
    /// Points of the field
    #[arg(long, value_name = "N", default_value_t = 11, value_parser = clap::value_parser!(u16).range(2..=10_001))]
    points: u16,
    /// How it is given.
    #[command(flatten)]
    form: Form,
}

/// One colour at one point of the field.
#[derive(Debug, Serialize)]
struct Row {
    /// Where an ideal lens images the point, mm: f·tan θ for an infinite object, of a lens at its first wavelength.
    ideal_mm: f64,
    /// Where the chief ray meets the image, mm.
    chief_mm: Option<f64>,
    /// How far beyond the ideal place that is, in parts of it; none on the axis.
    distortion: Option<f64>,
    /// Where light about the chief ray comes together behind the image, spread along the field and across it, mm.
    tangential_focus_mm: Option<f64>,
    sagittal_focus_mm: Option<f64>,
}

/// Runs `twinpupil optics distortion`.
pub(super) fn run(args: &Args, console: &Console) -> Result<()> {
    let parts: Vec<f64> = (0..args.points).map(|k| f64::from(k) / f64::from(args.points - 1)).collect();
    let asked = Asked::load(&args.asked, &parts, console)?;
    let rows = Rows::new(&asked, asked.views().iter().map(|view| vec![Row::of(view)]));
    args.form.give(&rows, || Ok(drawing(&rows)))
}

impl Row {
    fn of(view: &View<'_>) -> Self {
        let sight = view.sight();
        let foci = sight.as_ref().and_then(|sight| sight.foci());
        let chief_mm = sight.map(|sight| sight.chief_mm()[1]);
        Self {
            ideal_mm: view.ideal_mm(),
            chief_mm,
            distortion: view.distortion(chief_mm),
            tangential_focus_mm: foci.map(|foci| foci.tangential_mm),
            sagittal_focus_mm: foci.map(|foci| foci.sagittal_mm),
        }
    }
}

impl Answer for Rows<'_, Row> {
    fn text(&self) -> String {
        let header = [
            "field",
            self.asked.colours_are(),
            "ideal, mm",
            "chief, mm",
            "distortion",
            "tang. focus, mm",
            "sag. focus, mm",
        ];
        let number = |value: Option<f64>| cell(value, 1.0, 5);
        let row = |(view, row): (View<'_>, &Row)| {
            let [field, colour] = view.head();
            let part = row.distortion.map_or("-".to_owned(), |part| format!("{:.4} %", 100.0 * part));
            let [ideal, chief] = [Some(row.ideal_mm), row.chief_mm].map(number);
            [field, colour, ideal, chief, part, number(row.tangential_focus_mm), number(row.sagittal_focus_mm)]
        };
        render(header, &self.iter().map(row).collect::<Vec<_>>())
    }

    fn table(&self) -> Table {
        let column = |of: fn(&Row) -> Option<f64>| self.column(of, 9);
        self.about_columns()
            .with("ideal_mm", column(|row| Some(row.ideal_mm)))
            .with("chief_mm", column(|row| row.chief_mm))
            .with("distortion", column(|row| row.distortion))
            .with("tangential_focus_mm", column(|row| row.tangential_focus_mm))
            .with("sagittal_focus_mm", column(|row| row.sagittal_focus_mm))
    }
}

fn drawing(rows: &Rows<'_, Row>) -> Drawing {
    let asked = rows.asked;
    let mut distortion = Chart::new(asked.field_is(), "distortion, %");
    let mut foci = Chart::new(asked.field_is(), "focus behind the image, mm");
    for (k, colour) in (0..asked.colours.len()).zip(asked.inks()) {
        let own = || rows.iter().filter(move |(view, _)| view.colour == k);
        let line = |of: fn(&Row) -> Option<f64>| -> Vec<[f64; 2]> {
            own().filter_map(|(view, row)| Some([asked.fields[view.field].place, of(row)?])).collect()
        };
        let name = &asked.colours[k].name;
        distortion = distortion.line(name, colour, Stroke::Solid, &line(|row| Some(100.0 * row.distortion?)));
        foci = foci
            .line(&format!("{name}, tangential"), colour, Stroke::Solid, &line(|row| row.tangential_focus_mm))
            .line(&format!("{name}, sagittal"), colour, Stroke::Dashed, &line(|row| row.sagittal_focus_mm));
    }
    sheet(vec![("Distortion and field curvature".to_owned(), vec![distortion.into_drawing(), foci.into_drawing()])])
}
