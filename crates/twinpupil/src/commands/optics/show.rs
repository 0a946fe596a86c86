//! `twinpupil optics show`: a lens to first and third order, and its section with rays.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args as ClapArgs;
use serde::Serialize;
use twinpupil_instrument::paraxial_rays;
use twinpupil_optics::{ChromaticSums, FirstOrder, SeidelSums};

use super::layout;
use super::used::{LensArgs, Used};
use crate::commands::destination::{Destination, pretty};
use crate::console::Console;
use crate::io::output;
use crate::text_table::render;

/// `twinpupil optics show …`.
#[derive(Debug, ClapArgs)]
pub struct Args {
    /// The lens.
    #[command(flatten)]
    lens: LensArgs,
    /// As JSON
    #[arg(long)]
    json: bool,
    /// Draw the lens and rays through it as SVG
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Where it goes.
    #[command(flatten)]
    to: Destination,
}

/// What is printed.
#[derive(Debug, Serialize)]
struct Shown {
    name: String,
    surfaces: usize,
    stop: Option<usize>,
    colours: Vec<Colour>,
    beam: Option<BeamShown>,
}

/// To first order, at one wavelength. Places as in CONVENTIONS.md.
#[derive(Debug, Serialize)]
struct Colour {
    wavelength_nm: f64,
    focal_length_mm: f64,
    front_focus_mm: f64,
    rear_focus_mm: f64,
    front_principal_mm: f64,
    rear_principal_mm: f64,
    entrance_pupil_mm: Option<f64>,
    exit_pupil_mm: Option<f64>,
}

/// With a beam, at the primary wavelength.
#[derive(Debug, Serialize)]
struct BeamShown {
    entrance_pupil_diameter_mm: f64,
    exit_pupil_diameter_mm: Option<f64>,
    f_number: f64,
    field_deg: f64,
    /// Slope of the chief ray behind the lens at the edge of the field: 0 where it is telecentric.
    image_chief_slope: f64,
    aberrations: Vec<Aberrations>,
}

/// Sums of one surface, mm; the last are those of the lens.
#[derive(Debug, Serialize)]
struct Aberrations {
    surface: Option<usize>,
    spherical_mm: f64,
    coma_mm: f64,
    astigmatism_mm: f64,
    field_curvature_mm: f64,
    distortion_mm: f64,
    axial_colour_mm: f64,
    lateral_colour_mm: f64,
}

/// Runs `twinpupil optics show`.
pub(super) fn run(args: &Args, console: &Console) -> Result<()> {
    let used = Used::load(&args.lens, console)?;
    let shown = Shown::of(&used);
    if let Some(path) = &args.svg {
        output::write(Some(path), layout::svg(&used)?.into_bytes())?;
    }
    args.to.write(if args.json { pretty(&shown)? } else { shown.to_text() })
}

impl Shown {
    fn of(used: &Used) -> Self {
        let prescription = &used.file.prescription;
        let stop = prescription.stop();
        let colours = used.trains.iter().zip(&used.file.wavelengths_nm);
        Self {
            name: prescription.name.clone(),
            surfaces: prescription.surfaces.len(),
            stop,
            colours: colours.map(|(train, nm)| Colour::of(&train.first_order(stop), *nm)).collect(),
            beam: used.pupil_mm.map(|pupil_mm| BeamShown::of(used, pupil_mm)),
        }
    }

    fn to_text(&self) -> String {
        let stop = self.stop.map_or("no stop".to_owned(), |stop| format!("stop at surface {stop}"));
        let name = if self.name.is_empty() { "a lens" } else { &self.name };
        let header = ["", "f", "F from first", "F' from last", "H from first", "H' from last", "entrance", "exit"];
        let rows: Vec<_> = self.colours.iter().map(Colour::row).collect();
        let mut text = format!("{name}: {} surfaces, {stop}; lengths in mm\n\n", self.surfaces);
        text += &render(header, &rows);
        if let Some(beam) = &self.beam {
            text += &beam.to_text();
        }
        text
    }
}

impl Colour {
    fn of(lens: &FirstOrder, wavelength_nm: f64) -> Self {
        Self {
            wavelength_nm,
            focal_length_mm: lens.focal_length_mm,
            front_focus_mm: lens.front_focus_mm,
            rear_focus_mm: lens.rear_focus_mm,
            front_principal_mm: lens.front_principal_mm,
            rear_principal_mm: lens.rear_principal_mm,
            entrance_pupil_mm: lens.entrance_pupil.map(|pupil| pupil.position_mm),
            exit_pupil_mm: lens.exit_pupil.map(|pupil| pupil.position_mm),
        }
    }

    fn row(&self) -> [String; 8] {
        let pupil = |pupil_mm: Option<f64>| pupil_mm.map_or("-".to_owned(), |mm| format!("{mm:.4}"));
        [
            format!("{} nm", self.wavelength_nm),
            format!("{:.4}", self.focal_length_mm),
            format!("{:.4}", self.front_focus_mm),
            format!("{:.4}", self.rear_focus_mm),
            format!("{:.4}", self.front_principal_mm),
            format!("{:.4}", self.rear_principal_mm),
            pupil(self.entrance_pupil_mm),
            pupil(self.exit_pupil_mm),
        ]
    }
}

impl BeamShown {
    fn of(used: &Used, pupil_mm: f64) -> Self {
        let (train, lens) = (&used.trains[0], &used.first_order);
        let marginal = lens.marginal_ray(pupil_mm, used.file.prescription.object_distance_mm);
        let chief = lens.chief_ray(used.field_slope);
        let surfaces = train.paraxial_surfaces();
        let magnification = lens
            .exit_pupil
            .zip(lens.entrance_pupil)
            .map(|(exit, entrance)| (exit.magnification / entrance.magnification).abs());
        let [shortest, longest] = used.shortest_and_longest();
        let seidel = train.seidel(marginal, chief);
        let colours = train.chromatic(&used.trains[shortest], &used.trains[longest], marginal, chief);
        let sum = Aberrations::of(
            None,
            seidel.iter().copied().fold(SeidelSums::default(), |sum, one| sum + one),
            colours.iter().copied().fold(ChromaticSums::default(), |sum, one| sum + one),
        );
        let optical = (0..).zip(seidel.into_iter().zip(colours));
        let each = optical.map(|(surface, (seidel, colour))| Aberrations::of(Some(surface), seidel, colour));
        Self {
            entrance_pupil_diameter_mm: pupil_mm,
            exit_pupil_diameter_mm: magnification.map(|magnification| magnification * pupil_mm),
            f_number: (lens.focal_length_mm / pupil_mm).abs(),
            field_deg: used.field_slope.atan().to_degrees(),
            image_chief_slope: paraxial_rays(&surfaces, 1.0, chief).last().map_or(0.0, |ray| ray.slope),
            aberrations: each.chain([sum]).collect(),
        }
    }

    fn to_text(&self) -> String {
        let exit = self.exit_pupil_diameter_mm.map_or(String::new(), |mm| format!(", exit pupil {mm:.4} wide"));
        let mut text = format!(
            "\nentrance pupil {:.4} wide{exit}, f/{:.4}\n{:.4}° off the axis the chief ray leaves with slope {:.6}\n\n",
            self.entrance_pupil_diameter_mm, self.f_number, self.field_deg, self.image_chief_slope
        );
        let header = ["surface", "S_I", "S_II", "S_III", "S_IV", "S_V", "C_I", "C_II"];
        let rows: Vec<_> = self.aberrations.iter().map(Aberrations::row).collect();
        text += &render(header, &rows);
        text
    }
}

impl Aberrations {
    fn of(surface: Option<usize>, seidel: SeidelSums, colour: ChromaticSums) -> Self {
        Self {
            surface,
            spherical_mm: seidel.spherical_mm,
            coma_mm: seidel.coma_mm,
            astigmatism_mm: seidel.astigmatism_mm,
            field_curvature_mm: seidel.field_curvature_mm,
            distortion_mm: seidel.distortion_mm,
            axial_colour_mm: colour.axial_mm,
            lateral_colour_mm: colour.lateral_mm,
        }
    }

    fn row(&self) -> [String; 8] {
        // No −0.
        let number = |mm: f64| format!("{:.6}", if mm.abs() < 5e-7 { 0.0 } else { mm });
        [
            self.surface.map_or("sum".to_owned(), |surface| surface.to_string()),
            number(self.spherical_mm),
            number(self.coma_mm),
            number(self.astigmatism_mm),
            number(self.field_curvature_mm),
            number(self.distortion_mm),
            number(self.axial_colour_mm),
            number(self.lateral_colour_mm),
        ]
    }
}
