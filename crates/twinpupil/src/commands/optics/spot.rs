//! `twinpupil optics spot`: points of the field in the image, by real rays.

use anyhow::Result;
use clap::Args as ClapArgs;
use rayon::prelude::*;
use serde::Serialize;

use super::answer::{Answer, Form};
use super::asked::{Asked, AskedArgs, View};
use super::psf::DARK_RING;
use super::rows::{Rows, cell};
use crate::console::Console;
use crate::drawing::Drawing;
use crate::io::table::{Cells, Table};
use crate::plot::{Chart, Colour, Stroke};
use crate::plot_sheet::tiles;
use crate::text_table::render;

/// `twinpupil optics spot …`.
#[derive(Debug, ClapArgs)]
pub struct Args {
    /// What is asked about.
    #[command(flatten)]
    asked: AskedArgs,
    /// Rays through the pupil, spread evenly
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    rays: u32,
    /// How it is given.
    #[command(flatten)]
    form: Form,
}

/// Rays of a spot that are drawn.
const DRAWN: u32 = 300;

/// Places a side of the pupil from which its aperture is told.
const PUPIL: usize = 16;

/// Spots beside each other on a drawing.
const COLUMNS: usize = 3;

/// Parts of the field.
const FIELDS: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// A point of the field in the image.
#[derive(Debug, Serialize)]
struct Spot {
    /// Where the chief ray of this wavelength meets the image, mm; none if it does not.
    chief_mm: Option<f64>,
    /// How far beyond the place of an ideal lens's image that is, in parts of it; none on the axis.
    distortion: Option<f64>,
    /// Centre of the rays, mm; none if none arrive.
    centre_mm: Option<f64>,
    /// Root of the mean square of their distances from there, mm.
    rms_mm: Option<f64>,
    /// The largest of them, mm.
    largest_mm: Option<f64>,
    /// Rays that arrived, of those that were sent.
    arrived: usize,
    launched: usize,
}

/// Runs `twinpupil optics spot`.
pub(super) fn run(args: &Args, console: &Console) -> Result<()> {
    let asked = Asked::load(&args.asked, &FIELDS, console)?;
    let places = places(args.rays);
    let rows = Rows::new(&asked, asked.views().iter().map(|view| vec![Spot::of(view, &places)]));
    args.form.give(&rows, || Ok(drawing(&rows)))
}

/// Places that fill the pupil evenly: by the golden angle.
fn places(count: u32) -> Vec<[f64; 2]> {
    let place = |k: u32| {
        let radius = ((f64::from(k) + 0.5) / f64::from(count)).sqrt();
        let (sin, cos) = (2.399_963_229_728_653 * f64::from(k)).sin_cos();
        [radius * cos, radius * sin]
    };
    (0..count).map(place).collect()
}

impl Spot {
    fn of(view: &View<'_>, places: &[[f64; 2]]) -> Self {
        let sight = view.sight();
        let rays = sight.as_ref().map_or(Vec::new(), |sight| sight.image_rays(places));
        let image_mm: Vec<[f64; 2]> =
            rays.iter().flatten().map(|ray| [ray.position_mm[0], ray.position_mm[1]]).collect();
        let count = image_mm.len() as f64;
        let centre_mm = [0, 1].map(|k| image_mm.iter().map(|at| at[k]).sum::<f64>() / count);
        let squares = image_mm.iter().map(|at| (at[0] - centre_mm[0]).powi(2) + (at[1] - centre_mm[1]).powi(2));
        let any = |mm: f64| (count > 0.0).then_some(mm);
        let chief_mm = sight.map(|sight| sight.chief_mm()[1]);
        Self {
            chief_mm,
            distortion: view.distortion(chief_mm),
            centre_mm: any(centre_mm[1]),
            rms_mm: any((squares.clone().sum::<f64>() / count).sqrt()),
            largest_mm: any(squares.fold(0.0, f64::max).sqrt()),
            arrived: image_mm.len(),
            launched: places.len(),
        }
    }
}

impl Answer for Rows<'_, Spot> {
    fn text(&self) -> String {
        let header = [
            "field",
            self.asked.colours_are(),
            "chief, mm",
            "distortion",
            "centre, mm",
            "rms, µm",
            "largest, µm",
            "arrived",
        ];
        let row = |(view, spot): (View<'_>, &Spot)| {
            let [field, colour] = view.head();
            [
                field,
                colour,
                cell(spot.chief_mm, 1.0, 5),
                spot.distortion.map_or("-".to_owned(), |part| format!("{:.4} %", 100.0 * part)),
                cell(spot.centre_mm, 1.0, 5),
                cell(spot.rms_mm, 1000.0, 3),
                cell(spot.largest_mm, 1000.0, 3),
                format!("{} of {}", spot.arrived, spot.launched),
            ]
        };
        render(header, &self.iter().map(row).collect::<Vec<_>>())
    }

    fn table(&self) -> Table {
        let column = |of: fn(&Spot) -> Option<f64>| self.column(of, 9);
        let count = |of: fn(&Spot) -> usize| Cells::Whole(self.iter().map(|(_, spot)| of(spot) as i64).collect());
        self.about_columns()
            .with("chief_mm", column(|spot| spot.chief_mm))
            .with("distortion", column(|spot| spot.distortion))
            .with("centre_mm", column(|spot| spot.centre_mm))
            .with("rms_mm", column(|spot| spot.rms_mm))
            .with("largest_mm", column(|spot| spot.largest_mm))
            .with("arrived", count(|spot| spot.arrived))
            .with("launched", count(|spot| spot.launched))
    }
}

/// The rays of one colour at one point of the field, about where the chief ray meets the image, µm.
struct Rays {
    places_um: Vec<[f64; 2]>,
    /// Radius of the first dark ring by diffraction, without aberrations, along x and y.
    airy_um: Option<[f64; 2]>,
}

impl Rays {
    /// Of a lens about the chief ray of its first wavelength, of a camera about that of the band.
    fn of(view: &View<'_>) -> Self {
        let sight = view.sight();
        let about = if view.asked.is_camera() { view.sight() } else { View { colour: 0, ..*view }.sight() };
        let Some((sight, about)) = sight.zip(about) else { return Self { places_um: Vec::new(), airy_um: None } };
        let chief_mm = about.chief_mm();
        let rays = sight.image_rays(&places(DRAWN));
        let place = |ray: &twinpupil_optics::Ray| [0, 1].map(|k| 1000.0 * (ray.position_mm[k] - chief_mm[k]));
        let pupil = sight.pupil_function(PUPIL).filter(|_| sight.has_wavefront());
        Self {
            places_um: rays.iter().flatten().map(place).collect(),
            airy_um: pupil
                .map(|pupil| pupil.apertures().map(|aperture| 1000.0 * DARK_RING * sight.wavelength_mm() / aperture)),
        }
    }

    fn reach_um(&self) -> f64 {
        let rays = self.places_um.iter().flatten().map(|um| um.abs());
        rays.chain(self.airy_um.into_iter().flatten()).fold(0.0, f64::max)
    }
}

/// An ellipse of these half axes.
fn ellipse([a, b]: [f64; 2]) -> Vec<[f64; 2]> {
    const POINTS: u32 = 96;
    let at = |k: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(POINTS)).sin_cos();
        [a * cos, b * sin]
    };
    (0..=POINTS).map(at).collect()
}

/// Every spot to one scale, with the ring that diffraction makes of it, and how large they are over the field.
fn drawing(rows: &Rows<'_, Spot>) -> Drawing {
    let asked = rows.asked;
    let views = asked.views();
    let all: Vec<(View<'_>, Rays)> = views.into_par_iter().map(|view| (view, Rays::of(&view))).collect();
    let reach_um = 1.1 * all.iter().map(|(_, rays)| rays.reach_um()).fold(1e-3, f64::max);
    let spot = |field: usize| {
        let from = if asked.is_camera() { "its chief ray" } else { "the chief ray" };
        let mut chart = Chart::new(&format!("x from {from}, µm"), &format!("y from {from}, µm"))
            .equal_scales()
            .x_range(-reach_um, reach_um)
            .y_range(-reach_um, reach_um);
        for ((_, rays), colour) in all.iter().filter(|(view, _)| view.field == field).zip(asked.inks()) {
            if let Some(airy_um) = rays.airy_um {
                chart = chart.line("", colour, Stroke::Dashed, &ellipse(airy_um));
            }
            chart = chart.cloud(colour, &rays.places_um);
        }
        for (own, colour) in asked.colours.iter().zip(asked.inks()) {
            chart = chart.points(&own.name, colour, &[]);
        }
        (asked.field_name(field), chart.line("first dark ring", Colour::Grey, Stroke::Dashed, &[]).into_drawing())
    };
    let mut sizes = Chart::new(asked.field_is(), "root mean square radius, µm");
    for (k, colour) in (0..asked.colours.len()).zip(asked.inks()) {
        let own = rows.iter().filter(|(view, _)| view.colour == k);
        let line: Vec<[f64; 2]> =
            own.filter_map(|(view, spot)| Some([asked.fields[view.field].place, 1000.0 * spot.rms_mm?])).collect();
        sizes = sizes.line(&asked.colours[k].name, colour, Stroke::Solid, &line);
    }
    let spots = (0..asked.fields.len()).map(spot);
    tiles(spots.chain([("Over the field".to_owned(), sizes.into_drawing())]).collect(), COLUMNS)
}
