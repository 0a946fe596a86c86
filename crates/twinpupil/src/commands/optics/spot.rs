//! `twinpupil optics spot`: points of the field in the image, by real rays.

use anyhow::Result;
use clap::Args as ClapArgs;
use serde::Serialize;
use twinpupil_optics::{Fate, Rays, Train};

use super::used::{LensArgs, Used};
use crate::commands::destination::{Destination, pretty};
use crate::text_table::render;

/// `twinpupil optics spot …`.
#[derive(Debug, ClapArgs)]
pub struct Args {
    /// The lens.
    #[command(flatten)]
    lens: LensArgs,
    /// Rays through the stop, spread evenly
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
    field_deg: f64,
    wavelength_nm: f64,
    /// Where the chief ray of this wavelength meets the image, mm; none if it does not.
    chief_mm: Option<f64>,
    /// How far beyond the paraxial chief ray of the primary wavelength that is, in parts of its height; none on the axis.
    distortion: Option<f64>,
    /// Centre of the rays, mm.
    centre_mm: f64,
    /// Root of the mean square of their distances from there, mm.
    rms_mm: f64,
    /// The largest of them, mm.
    largest_mm: f64,
    /// Rays that arrived, of those that were sent.
    arrived: u64,
    launched: u64,
}

/// Runs `twinpupil optics spot`.
pub(super) fn run(args: &Args) -> Result<()> {
    let used = Used::load(&args.lens)?;
    let places = places(args.rays);
    let mut spots = Vec::new();
    for part in FIELDS {
        for (train, wavelength_nm) in used.trains.iter().zip(&used.file.wavelengths_nm) {
            spots.push(Spot::of(&used, train, *wavelength_nm, part * used.field_slope, &places)?);
        }
    }
    args.to.write(if args.json { pretty(&spots)? } else { to_text(&spots) })
}

/// Places that fill the stop evenly: by the golden angle.
fn places(count: u32) -> Vec<[f64; 2]> {
    let place = |k: u32| {
        let radius = ((f64::from(k) + 0.5) / f64::from(count)).sqrt();
        let (sin, cos) = (2.399_963_229_728_653 * f64::from(k)).sin_cos();
        [radius * cos, radius * sin]
    };
    (0..count).map(place).collect()
}

impl Spot {
    fn of(used: &Used, train: &Train, wavelength_nm: f64, slope: f64, places: &[[f64; 2]]) -> Result<Self> {
        let chief = used.rays(train, slope, &[[0.0; 2]])?.first().map(|ray| train.path(ray));
        let chief_mm = chief.and_then(|(met, fate)| Some((fate == Fate::Arrived).then(|| met.last())??.position_mm[1]));
        let ideal_mm = used.paraxial_image_mm(slope);
        let mut rays: Rays = used.rays(train, slope, places)?.into_iter().collect();
        let ledger = train.trace_parallel(&mut rays);
        let arrived = rays.iter().filter(|(_, fate)| *fate == Fate::Arrived);
        let image_mm: Vec<[f64; 2]> = arrived.map(|(ray, _)| [ray.position_mm[0], ray.position_mm[1]]).collect();
        let count = image_mm.len() as f64;
        let centre_mm = [0, 1].map(|k| image_mm.iter().map(|at| at[k]).sum::<f64>() / count);
        let squares = image_mm.iter().map(|at| (at[0] - centre_mm[0]).powi(2) + (at[1] - centre_mm[1]).powi(2));
        Ok(Self {
            field_deg: slope.atan().to_degrees(),
            wavelength_nm,
            chief_mm,
            distortion: chief_mm.filter(|_| slope != 0.0).map(|mm| mm / ideal_mm - 1.0),
            centre_mm: centre_mm[1],
            rms_mm: (squares.clone().sum::<f64>() / count).sqrt(),
            largest_mm: squares.fold(0.0, f64::max).sqrt(),
            arrived: ledger.arrived,
            launched: places.len() as u64,
        })
    }
}

fn to_text(spots: &[Spot]) -> String {
    let header = ["field", "wavelength", "chief, mm", "distortion", "centre, mm", "rms, µm", "largest, µm", "arrived"];
    let or_none = |number: Option<String>| number.unwrap_or("-".to_owned());
    let rows: Vec<[String; 8]> = spots
        .iter()
        .map(|spot| {
            [
                format!("{:.3}°", spot.field_deg),
                format!("{} nm", spot.wavelength_nm),
                or_none(spot.chief_mm.map(|mm| format!("{mm:.5}"))),
                or_none(spot.distortion.map(|part| format!("{:.4} %", 100.0 * part))),
                format!("{:.5}", spot.centre_mm),
                format!("{:.3}", 1000.0 * spot.rms_mm),
                format!("{:.3}", 1000.0 * spot.largest_mm),
                format!("{} of {}", spot.arrived, spot.launched),
            ]
        })
        .collect();
    render(header, &rows)
}
