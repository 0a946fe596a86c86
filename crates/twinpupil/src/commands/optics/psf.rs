//! `twinpupil optics psf`: the image of a point, by diffraction and by rays.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args as ClapArgs;
use rayon::prelude::*;
use serde::Serialize;
use twinpupil_optics::{Encircled, EncircledWaves, Psf};

use super::answer::{Answer, Form};
use super::asked::{About, Asked, AskedArgs, Pupil, View};
use super::rows::cell;
use crate::commands::options::{file_of, size_mm};
use crate::console::Console;
use crate::drawing::Drawing;
use crate::io::encode_rgb8;
use crate::io::output::Outputs;
use crate::io::table::{Cells, Table};
use crate::plot::{Chart, Stroke};
use crate::plot_sheet::sheet;
use crate::text_table::render;

/// `twinpupil optics psf …`.
#[derive(Debug, ClapArgs)]
pub struct Args {
    /// What is asked about.
    #[command(flatten)]
    asked: AskedArgs,
    /// How far from the chief ray the image is told, mm; else as far as most light of any point reaches
    #[arg(long, value_name = "MM", value_parser = size_mm())]
    reach_mm: Option<f64>,
    /// Picture of the images by diffraction as PNG: fields under each other, colours beside each other, every one to its
    /// own brightest place, by the root of the light
    #[arg(long, value_name = "FILE", value_parser = file_of("png"))]
    picture: Option<PathBuf>,
    /// How it is given.
    #[command(flatten)]
    form: Form,
}

/// Places from the chief ray to either end of what is told.
const REACH: usize = 100;

/// Pixels of a picture from its middle to its rim.
const PIXELS: usize = 100;

/// Share of the pupil from which on it counts for how far images are told.
const FILLED: f64 = 0.1;

/// Share of the light whose radius is told.
const SHARE: f64 = 0.8;

/// The first dark ring of a lens without aberrations, in λ over the numerical aperture [Goodman, sec. 4.4.2].
pub(super) const DARK_RING: f64 = 0.609_834_9;

/// The image of one point in one colour. Without light there are no numbers; by diffraction there are none where the
/// wavefront is too steep to be told from the rays.
#[derive(Debug, Serialize)]
struct Row {
    #[serde(flatten)]
    about: About,
    /// The most light anywhere, relative to that without aberrations.
    strehl_ratio: Option<f64>,
    /// Root of the mean square of the wavefront, in wavelengths.
    rms_opd_waves: Option<f64>,
    /// Radius of the first dark ring of a lens as wide without aberrations, mm.
    airy_radius_mm: Option<f64>,
    /// Radius about the centroid within which 80 % of the light are, by diffraction and by rays, mm.
    radius_80_mm: Option<f64>,
    radius_80_by_rays_mm: Option<f64>,
    /// Root of the mean square of the distances of rays from their centroid, mm.
    rms_by_rays_mm: Option<f64>,
    /// Share of the pupil through which light comes.
    filled: f64,
}

/// One colour at one point of the field.
struct Seen<'a> {
    view: View<'a>,
    light: Option<Light>,
    row: Row,
}

struct Light {
    pupil: Pupil,
    waves: Option<(Psf, EncircledWaves)>,
    rays: Encircled,
}

struct Images<'a> {
    asked: &'a Asked,
    seen: Vec<Seen<'a>>,
    reach_mm: f64,
}

impl Serialize for Images<'_> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.seen.iter().map(|seen| &seen.row))
    }
}

/// Runs `twinpupil optics psf`.
pub(super) fn run(args: &Args, console: &Console) -> Result<()> {
    let asked = Asked::at_some_points(&args.asked, console)?;
    let seen = asked.views().into_par_iter().map(Seen::of).collect::<Result<Vec<_>>>()?;
    let reach_mm = args.reach_mm.unwrap_or_else(|| reach_of_all_mm(&seen));
    let images = Images { asked: &asked, seen, reach_mm };
    let mut outputs = Outputs::new();
    if let Some(path) = &args.picture {
        outputs.add(path, images.picture()?);
    }
    args.form.give_with(&images, || Ok(images.drawing()), outputs)
}

/// As far as light reaches, where the pupil is not all but shut: a slit of it spreads light without end.
fn reach_of_all_mm(seen: &[Seen<'_>]) -> f64 {
    let reach_mm = |least: f64| seen.iter().filter(|seen| seen.row.filled > least).map(Seen::reach_mm).reduce(f64::max);
    reach_mm(FILLED).or(reach_mm(0.0)).unwrap_or(1.0)
}

impl Light {
    fn of(pupil: Pupil) -> Self {
        let waves = pupil.is_resolved.then(|| {
            let psf = pupil.function.psf();
            let encircled = psf.encircled(pupil.function.centroid_mm());
            (psf, encircled)
        });
        Self { waves, rays: pupil.function.encircled_by_rays(), pupil }
    }

    fn airy_radius_mm(&self, wavelength_mm: f64) -> f64 {
        let [x, y] = self.pupil.function.apertures();
        DARK_RING * wavelength_mm / x.min(y)
    }
}

impl<'a> Seen<'a> {
    fn of(view: View<'a>) -> Result<Self> {
        let sight = view.sight_with_wavefront()?;
        let wavelength_mm = sight.as_ref().map_or(0.0, |sight| sight.wavelength_mm());
        let light = sight.and_then(|sight| Pupil::of(&sight)).map(Light::of);
        let pupil = light.as_ref().map(|light| &light.pupil.function);
        let waves = light.as_ref().and_then(|light| light.waves.as_ref());
        let rays = light.as_ref().map(|light| &light.rays);
        let row = Row {
            about: view.about(),
            strehl_ratio: pupil.zip(waves).map(|(pupil, (psf, _))| pupil.strehl_ratio(psf)),
            rms_opd_waves: pupil.map(|pupil| pupil.rms_opd_mm() / wavelength_mm),
            airy_radius_mm: light.as_ref().map(|light| light.airy_radius_mm(wavelength_mm)),
            radius_80_mm: waves.map(|(_, encircled)| encircled.radius_mm(SHARE)),
            radius_80_by_rays_mm: rays.map(|rays| rays.radius_mm(SHARE)),
            rms_by_rays_mm: rays.map(Encircled::rms_mm),
            filled: pupil.map_or(0.0, |pupil| pupil.filled_share()),
        };
        Ok(Self { view, light, row })
    }

    /// How far from the chief ray most light is, with some room.
    fn reach_mm(&self) -> f64 {
        let Some(light) = &self.light else { return 0.0 };
        let [x, y] = light.pupil.function.centroid_mm();
        let row = &self.row;
        let radii = [row.airy_radius_mm.map(|mm| 2.0 * mm), row.radius_80_mm, row.radius_80_by_rays_mm];
        x.hypot(y) + 1.6 * radii.into_iter().flatten().fold(0.0, f64::max)
    }

    /// Light along y or x through the image of the chief ray.
    fn section(&self, axis: usize, offsets_mm: &[f64]) -> Vec<f64> {
        let resolved = self.light.as_ref().filter(|light| light.waves.is_some());
        resolved.map_or(vec![f64::NAN; offsets_mm.len()], |light| light.pupil.function.section(axis, offsets_mm))
    }

    /// Share of the light within a radius, by diffraction and by rays.
    fn encircled(&self, radius_mm: f64) -> [f64; 2] {
        let Some(light) = self.light.as_ref().filter(|_| radius_mm >= 0.0) else { return [f64::NAN; 2] };
        [light.waves.as_ref().map_or(f64::NAN, |(_, waves)| waves.share(radius_mm)), light.rays.share(radius_mm)]
    }
}

impl Images<'_> {
    fn offsets_mm(&self) -> Vec<f64> {
        (0..=2 * REACH).map(|k| self.reach_mm * (k as f64 / REACH as f64 - 1.0)).collect()
    }

    fn drawing(&self) -> Drawing {
        let offsets_mm = self.offsets_mm();
        let drawn = |y: &[f64]| -> Vec<[f64; 2]> { offsets_mm.iter().zip(y).map(|(x, y)| [1000.0 * x, *y]).collect() };
        let row = |field: usize| {
            let mut sections = Chart::new("from the chief ray, µm", "light, without aberrations 1");
            let mut encircled = Chart::new("radius about the centroid, µm", "share of the light").y_range(0.0, 1.0);
            let here = self.seen.iter().filter(|seen| seen.view.field == field);
            for (seen, colour) in here.zip(self.asked.inks()) {
                let name = &seen.view.colour().name;
                let shares: Vec<[f64; 2]> = offsets_mm.par_iter().map(|mm| seen.encircled(*mm)).collect();
                let [waves, rays] = [0, 1].map(|k| drawn(&shares.iter().map(|share| share[k]).collect::<Vec<_>>()));
                sections = sections
                    .line(&format!("{name}, along y"), colour, Stroke::Solid, &drawn(&seen.section(1, &offsets_mm)))
                    .line(&format!("{name}, along x"), colour, Stroke::Dashed, &drawn(&seen.section(0, &offsets_mm)));
                encircled = encircled.line(&format!("{name}, by diffraction"), colour, Stroke::Solid, &waves).line(
                    &format!("{name}, by rays"),
                    colour,
                    Stroke::Dashed,
                    &rays,
                );
            }
            (self.asked.field_name(field), vec![sections.into_drawing(), encircled.into_drawing()])
        };
        sheet((0..self.asked.fields.len()).map(row).collect())
    }

    /// All images on one picture, y up.
    fn picture(&self) -> Result<Vec<u8>> {
        let (columns, side) = (self.asked.colours.len(), 2 * PIXELS + 1);
        let size_px = [columns * (side + 1), self.asked.fields.len() * (side + 1)];
        let mut rgb = vec![90; 3 * size_px[0] * size_px[1]];
        for seen in &self.seen {
            let psf = seen.light.as_ref().and_then(|light| light.waves.as_ref()).map(|(psf, _)| psf);
            let offset_mm = |k: usize| self.reach_mm * (k as f64 / PIXELS as f64 - 1.0);
            let light: Vec<f64> = (0..side * side)
                .map(|n| psf.map_or(0.0, |psf| psf.light([offset_mm(n % side), -offset_mm(n / side)])))
                .collect();
            let most = light.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
            for (n, light) in light.into_iter().enumerate() {
                let column = seen.view.colour * (side + 1) + n % side;
                let row = seen.view.field * (side + 1) + n / side;
                let at = 3 * (row * size_px[0] + column);
                rgb[at..at + 3].fill((255.0 * (light / most).sqrt()).round() as u8);
            }
        }
        encode_rgb8(size_px, &rgb)
    }
}

impl Answer for Images<'_> {
    fn text(&self) -> String {
        let header = [
            "field",
            self.asked.colours_are(),
            "Strehl",
            "rms OPD, λ",
            "Airy, µm",
            "80 %, µm",
            "80 % by rays, µm",
            "rms by rays, µm",
            "pupil",
        ];
        let rows: Vec<[String; 9]> = (self.seen.iter())
            .map(|Seen { view, row, .. }| {
                let [field, colour] = view.head();
                [
                    field,
                    colour,
                    cell(row.strehl_ratio, 1.0, 4),
                    cell(row.rms_opd_waves, 1.0, 4),
                    cell(row.airy_radius_mm, 1000.0, 3),
                    cell(row.radius_80_mm, 1000.0, 3),
                    cell(row.radius_80_by_rays_mm, 1000.0, 3),
                    cell(row.rms_by_rays_mm, 1000.0, 3),
                    format!("{:.1} %", 100.0 * row.filled.min(1.0)),
                ]
            })
            .collect();
        render(header, &rows)
    }

    /// Sections, and the light within circles.
    fn table(&self) -> Table {
        let offsets_mm = self.offsets_mm();
        let per_image = |of: &dyn Fn(&Seen<'_>) -> Vec<f64>, decimals: usize| {
            Cells::Real(self.seen.iter().flat_map(of).collect(), decimals)
        };
        let shares: Vec<Vec<[f64; 2]>> =
            self.seen.par_iter().map(|seen| offsets_mm.iter().map(|mm| seen.encircled(*mm)).collect()).collect();
        let share = |k: usize| Cells::Real(shares.iter().flatten().map(|share| share[k]).collect(), 6);
        let abouts: Vec<&About> =
            self.seen.iter().flat_map(|seen| std::iter::repeat_n(&seen.row.about, offsets_mm.len())).collect();
        self.asked
            .table(&abouts)
            .with("offset_mm", per_image(&|_| offsets_mm.clone(), 7))
            .with("tangential", per_image(&|seen| seen.section(1, &offsets_mm), 7))
            .with("sagittal", per_image(&|seen| seen.section(0, &offsets_mm), 7))
            .with("encircled", share(0))
            .with("encircled_by_rays", share(1))
    }
}
