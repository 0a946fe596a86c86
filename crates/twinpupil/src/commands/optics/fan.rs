//! `twinpupil optics fan`: rays and wavefront over two lines across the pupil.

use anyhow::Result;
use clap::Args as ClapArgs;
use serde::Serialize;
use twinpupil_optics::{Deviation, Sight};

use super::answer::{Answer, Form};
use super::asked::{Asked, AskedArgs, View};
use super::rows::{Rows, cell};
use crate::console::Console;
use crate::drawing::Drawing;
use crate::io::table::Table;
use crate::plot::{Chart, Stroke};
use crate::plot_sheet::sheet;
use crate::text_table::render;

/// `twinpupil optics fan …`.
#[derive(Debug, ClapArgs)]
pub struct Args {
    /// What is asked about.
    #[command(flatten)]
    asked: AskedArgs,
    /// Places across the pupil
    #[arg(long, value_name = "N", default_value_t = 11, value_parser = clap::value_parser!(u16).range(2..=10_001))]
    places: u16,
    /// How it is given.
    #[command(flatten)]
    form: Form,
}

/// Places across the pupil that are drawn.
const DRAWN: u16 = 101;

/// Rays at the very rim would be cut by rounding.
const WITHIN_RIM: f64 = 1.0 - 1e-9;

/// The rays of one place in both lines.
#[derive(Debug, Serialize)]
struct Row {
    /// In radii of the pupil: along y, in which the field lies, or along x.
    pupil: f64,
    /// Along y: how far a ray meets the image from the chief ray, of a lens that of the first wavelength, mm.
    tangential_mm: Option<f64>,
    /// Along x: the same along x and along y.
    sagittal_mm: Option<f64>,
    sagittal_aside_mm: Option<f64>,
    /// How far the wavefront is ahead of the sphere about the image of the colour's own chief ray, in wavelengths.
    tangential_opd_waves: Option<f64>,
    sagittal_opd_waves: Option<f64>,
}

/// Runs `twinpupil optics fan`.
pub(super) fn run(args: &Args, console: &Console) -> Result<()> {
    let asked = Asked::at_some_points(&args.asked, console)?;
    let rows = Rows::new(&asked, asked.views().iter().map(|view| rows(view, args.places)));
    args.form.give(&rows, || Ok(drawing(&asked)))
}

fn rows(view: &View<'_>, count: u16) -> Vec<Row> {
    let places: Vec<f64> = (0..count).map(|k| 2.0 * f64::from(k) / f64::from(count - 1) - 1.0).collect();
    let sight = view.sight();
    let aside_mm = sight.as_ref().map_or([0.0; 2], |sight| from_first_mm(view, sight));
    let fan = |place: fn(f64) -> [f64; 2]| -> Vec<Option<Deviation>> {
        let along: Vec<[f64; 2]> = places.iter().map(|at| place(WITHIN_RIM * at)).collect();
        sight.as_ref().map_or(vec![None; along.len()], |sight| sight.deviations(&along))
    };
    let (tangential, sagittal) = (fan(|at| [0.0, at]), fan(|at| [at, 0.0]));
    let opd = |ray: &Option<Deviation>| {
        let sight = sight.as_ref().filter(|sight| sight.has_wavefront())?;
        Some(ray.as_ref()?.opd_mm / sight.wavelength_mm())
    };
    let error = |ray: &Option<Deviation>, axis: usize| Some(ray.as_ref()?.error_mm[axis] + aside_mm[axis]);
    let row = |(pupil, (tangential, sagittal)): (&f64, (&Option<Deviation>, &Option<Deviation>))| Row {
        pupil: *pupil,
        tangential_mm: error(tangential, 1),
        sagittal_mm: error(sagittal, 0),
        sagittal_aside_mm: error(sagittal, 1),
        tangential_opd_waves: opd(tangential),
        sagittal_opd_waves: opd(sagittal),
    };
    places.iter().zip(tangential.iter().zip(&sagittal)).map(row).collect()
}

/// How far from the chief ray of a lens's first wavelength that of the view is; bands of a camera have pupils of their own.
fn from_first_mm(view: &View<'_>, sight: &Sight<'_>) -> [f64; 2] {
    if view.asked.is_camera() {
        return [0.0; 2];
    }
    let first = View { colour: 0, ..*view }.sight();
    first.map_or([0.0; 2], |first| [0, 1].map(|k| sight.chief_mm()[k] - first.chief_mm()[k]))
}

impl Answer for Rows<'_, Row> {
    fn text(&self) -> String {
        let header =
            ["field", self.asked.colours_are(), "pupil", "tang., µm", "sag., µm", "tang. OPD, λ", "sag. OPD, λ"];
        let row = |(view, row): (View<'_>, &Row)| {
            let [field, colour] = view.head();
            let [tangential, sagittal] = [row.tangential_mm, row.sagittal_mm].map(|mm| cell(mm, 1000.0, 4));
            let opd = [row.tangential_opd_waves, row.sagittal_opd_waves].map(|waves| cell(waves, 1.0, 4));
            let [tangential_opd, sagittal_opd] = opd;
            [field, colour, format!("{:.2}", row.pupil), tangential, sagittal, tangential_opd, sagittal_opd]
        };
        render(header, &self.iter().map(row).collect::<Vec<_>>())
    }

    fn table(&self) -> Table {
        let column = |of: fn(&Row) -> Option<f64>| self.column(of, 9);
        self.about_columns()
            .with("pupil", column(|row| Some(row.pupil)))
            .with("tangential_mm", column(|row| row.tangential_mm))
            .with("sagittal_mm", column(|row| row.sagittal_mm))
            .with("sagittal_aside_mm", column(|row| row.sagittal_aside_mm))
            .with("tangential_opd_waves", column(|row| row.tangential_opd_waves))
            .with("sagittal_opd_waves", column(|row| row.sagittal_opd_waves))
    }
}

fn drawing(asked: &Asked) -> Drawing {
    let row = |field: usize| {
        let mut errors = Chart::new("place in the pupil", "from the chief ray, µm").x_range(-1.0, 1.0);
        let mut paths = Chart::new("place in the pupil", "path difference, wavelengths").x_range(-1.0, 1.0);
        for (view, colour) in asked.views_at(field).zip(asked.inks()) {
            let rows = rows(&view, DRAWN);
            let line = |of: fn(&Row) -> Option<f64>, scale: f64| -> Vec<[f64; 2]> {
                rows.iter().filter_map(|row| Some([row.pupil, scale * of(row)?])).collect()
            };
            let name = &view.colour().name;
            errors = errors
                .line(&format!("{name}, tangential"), colour, Stroke::Solid, &line(|row| row.tangential_mm, 1000.0))
                .line(&format!("{name}, sagittal"), colour, Stroke::Dashed, &line(|row| row.sagittal_mm, 1000.0));
            paths = paths
                .line(&format!("{name}, tangential"), colour, Stroke::Solid, &line(|row| row.tangential_opd_waves, 1.0))
                .line(&format!("{name}, sagittal"), colour, Stroke::Dashed, &line(|row| row.sagittal_opd_waves, 1.0));
        }
        (asked.field_name(field), vec![errors.into_drawing(), paths.into_drawing()])
    };
    sheet((0..asked.fields.len()).map(row).collect())
}
