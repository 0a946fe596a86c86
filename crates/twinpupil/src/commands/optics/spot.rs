//! `twinpupil optics spot`: points of the field in the image, by real rays.

use anyhow::Result;
use clap::Args as ClapArgs;
use serde::Serialize;

use super::asked::{About, Asked, AskedArgs, View};
use super::rows::cell;
use crate::commands::destination::{Destination, pretty};
use crate::console::Console;
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
    /// As JSON
    #[arg(long)]
    json: bool,
    /// Where it goes.
    #[command(flatten)]
    to: Destination,
}

/// Parts of the field.
const FIELDS: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// A point of the field in the image.
#[derive(Debug, Serialize)]
struct Spot {
    #[serde(flatten)]
    about: About,
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
    let spots: Vec<Spot> = asked.views().iter().map(|view| Spot::of(view, &places)).collect();
    args.to.write(if args.json { pretty(&spots)? } else { to_text(&asked, &spots) })
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
            about: view.about(),
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

fn to_text(asked: &Asked, spots: &[Spot]) -> String {
    let header =
        ["field", asked.colours_are(), "chief, mm", "distortion", "centre, mm", "rms, µm", "largest, µm", "arrived"];
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
    render(header, &asked.views().into_iter().zip(spots).map(row).collect::<Vec<_>>())
}
