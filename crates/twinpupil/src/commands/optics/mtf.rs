//! `twinpupil optics mtf`: contrast of gratings in the image.

use anyhow::Result;
use clap::Args as ClapArgs;
use rayon::prelude::*;
use serde::Serialize;
use twinpupil_optics::Contrast;

use super::answer::{Answer, Form};
use super::asked::{Asked, AskedArgs, Pupil, View};
use super::rows::{Rows, cell};
use crate::commands::options::number;
use crate::console::Console;
use crate::drawing::Drawing;
use crate::io::table::Table;
use crate::plot::{Chart, Stroke};
use crate::plot_sheet::sheet;
use crate::round::round_below;
use crate::text_table::render;

/// `twinpupil optics mtf …`.
#[derive(Debug, ClapArgs)]
pub struct Args {
    /// What is asked about.
    #[command(flatten)]
    asked: AskedArgs,
    /// Finest grating, cycles/mm in the image; else half of the finest that the aperture lets through, rounded down
    #[arg(long, value_name = "CYCLES", value_parser = number("above 0, up to 1e6", |per_mm| *per_mm > 0.0 && *per_mm <= 1e6))]
    to_per_mm: Option<f64>,
    /// How many gratings, evenly from 0 cycles/mm to the finest
    #[arg(long, value_name = "N", default_value_t = 11, value_parser = clap::value_parser!(u16).range(2..=1001))]
    gratings: u16,
    /// How it is given.
    #[command(flatten)]
    form: Form,
}

/// Gratings that are drawn.
const DRAWN: u16 = 101;

/// Contrast of one grating, by diffraction where the wavefront is not too steep for that, and by rays.
#[derive(Debug, Serialize)]
struct Row {
    per_mm: f64,
    tangential: Option<f64>,
    sagittal: Option<f64>,
    tangential_by_rays: Option<f64>,
    sagittal_by_rays: Option<f64>,
}

/// One colour at one point of the field.
struct Seen<'a> {
    view: View<'a>,
    pupil: Option<Pupil>,
}

/// Runs `twinpupil optics mtf`.
pub(super) fn run(args: &Args, console: &Console) -> Result<()> {
    let asked = Asked::at_some_points(&args.asked, console)?;
    let seen = asked.views().into_par_iter().map(Seen::of).collect::<Result<Vec<_>>>()?;
    let finest_per_mm = args.to_per_mm.unwrap_or_else(|| half_of_all(&seen));
    let of_views: Vec<Vec<Row>> = seen.par_iter().map(|seen| seen.rows(finest_per_mm, args.gratings)).collect();
    args.form.give(&Rows::new(&asked, of_views), || Ok(drawing(&asked, &seen, finest_per_mm)))
}

/// Half of the finest grating that any view lets through, rounded.
fn half_of_all(seen: &[Seen<'_>]) -> f64 {
    let cutoffs = seen.iter().filter_map(|seen| Some(seen.pupil.as_ref()?.function.cutoffs_per_mm()));
    let finest = cutoffs.map(|cutoff| cutoff.tangential.max(cutoff.sagittal)).fold(0.0, f64::max);
    if finest > 0.0 { round_below(0.5 * finest) } else { 1.0 }
}

impl<'a> Seen<'a> {
    fn of(view: View<'a>) -> Result<Self> {
        let pupil = view.sight_with_wavefront()?.and_then(|sight| Pupil::of(&sight));
        Ok(Self { view, pupil })
    }

    fn rows(&self, finest_per_mm: f64, count: u16) -> Vec<Row> {
        let per_mm: Vec<f64> = (0..count).map(|k| finest_per_mm * f64::from(k) / f64::from(count - 1)).collect();
        let pupil = self.pupil.as_ref();
        let waves = pupil.filter(|pupil| pupil.is_resolved).map(|pupil| pupil.function.contrasts(&per_mm));
        let rays = pupil.map(|pupil| pupil.function.contrasts_by_rays(&per_mm));
        let at = |contrasts: &Option<Vec<Contrast>>, k: usize| contrasts.as_ref().map(|contrasts| contrasts[k]);
        let row = |k: usize| Row {
            per_mm: per_mm[k],
            tangential: at(&waves, k).map(|contrast| contrast.tangential),
            sagittal: at(&waves, k).map(|contrast| contrast.sagittal),
            tangential_by_rays: at(&rays, k).map(|contrast| contrast.tangential),
            sagittal_by_rays: at(&rays, k).map(|contrast| contrast.sagittal),
        };
        (0..per_mm.len()).map(row).collect()
    }
}

impl Answer for Rows<'_, Row> {
    fn text(&self) -> String {
        let header =
            ["field", self.asked.colours_are(), "cycles/mm", "tangential", "sagittal", "tang. by rays", "sag. by rays"];
        let number = |value: Option<f64>| cell(value, 1.0, 4);
        let row = |(view, row): (View<'_>, &Row)| {
            let [field, colour] = view.head();
            let waves = [row.tangential, row.sagittal].map(number);
            let rays = [row.tangential_by_rays, row.sagittal_by_rays].map(number);
            let ([tangential, sagittal], [tangential_by_rays, sagittal_by_rays]) = (waves, rays);
            [field, colour, format!("{:.4}", row.per_mm), tangential, sagittal, tangential_by_rays, sagittal_by_rays]
        };
        render(header, &self.iter().map(row).collect::<Vec<_>>())
    }

    fn table(&self) -> Table {
        let column = |of: fn(&Row) -> Option<f64>| self.column(of, 6);
        self.about_columns()
            .with("cycles_per_mm", column(|row| Some(row.per_mm)))
            .with("tangential", column(|row| row.tangential))
            .with("sagittal", column(|row| row.sagittal))
            .with("tangential_by_rays", column(|row| row.tangential_by_rays))
            .with("sagittal_by_rays", column(|row| row.sagittal_by_rays))
    }
}

fn drawing(asked: &Asked, seen: &[Seen<'_>], finest_per_mm: f64) -> Drawing {
    let chart =
        |how: &str| Chart::new("cycles/mm", &format!("contrast {how}")).y_range(0.0, 1.0).x_range(0.0, finest_per_mm);
    let row = |field: usize| {
        let (mut waves, mut rays) = (chart("by diffraction"), chart("by rays"));
        let here = seen.iter().filter(|seen| seen.view.field == field);
        for (seen, colour) in here.zip(asked.inks()) {
            let rows = seen.rows(finest_per_mm, DRAWN);
            let line = |of: fn(&Row) -> Option<f64>| -> Vec<[f64; 2]> {
                rows.iter().filter_map(|row| Some([row.per_mm, of(row)?])).collect()
            };
            let [tangential, sagittal] =
                ["tangential", "sagittal"].map(|way| format!("{}, {way}", seen.view.colour().name));
            waves = waves.line(&tangential, colour, Stroke::Solid, &line(|row| row.tangential)).line(
                &sagittal,
                colour,
                Stroke::Dashed,
                &line(|row| row.sagittal),
            );
            rays = rays.line(&tangential, colour, Stroke::Solid, &line(|row| row.tangential_by_rays)).line(
                &sagittal,
                colour,
                Stroke::Dashed,
                &line(|row| row.sagittal_by_rays),
            );
        }
        (asked.field_name(field), vec![waves.into_drawing(), rays.into_drawing()])
    };
    sheet((0..asked.fields.len()).map(row).collect())
}
