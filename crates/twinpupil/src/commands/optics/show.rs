//! `twinpupil optics show`: a lens to first and third order, and its section with rays; a camera is in `show_camera`.

use anyhow::{Context, Result};
use clap::Args as ClapArgs;
use serde::Serialize;
use twinpupil_instrument::{Shape, paraxial_rays};
use twinpupil_optics::{ChromaticSums, FirstOrder, SeidelSums};

use super::answer::{Answer, Form};
use super::asked::{Asked, AskedArgs, LENS_FIELDS};
use super::layout::{Drawn, section};
use super::show_camera;
use super::used::Used;
use crate::console::Console;
use crate::drawing::Drawing;
use crate::io::table::{Cells, Table};
use crate::load::is_instrument;
use crate::text_table::render;

/// `twinpupil optics show …`.
#[derive(Debug, ClapArgs)]
pub struct Args {
    /// What is asked about.
    #[command(flatten)]
    asked: AskedArgs,
    /// How it is given.
    #[command(flatten)]
    form: Form,
}

/// What is printed.
#[derive(Debug, Serialize)]
struct Shown {
    name: String,
    surfaces: usize,
    stop: Option<usize>,
    colours: Vec<Colour>,
    beam: Option<BeamShown>,
    /// What these numbers do not tell of the lens.
    notes: Vec<String>,
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

/// Sums of one surface, mm; the last are those of the lens. There are none of third order of a Fresnel lens.
#[derive(Debug, Serialize)]
struct Aberrations {
    surface: Option<usize>,
    spherical_mm: Option<f64>,
    coma_mm: Option<f64>,
    astigmatism_mm: Option<f64>,
    field_curvature_mm: Option<f64>,
    distortion_mm: Option<f64>,
    axial_colour_mm: f64,
    lateral_colour_mm: f64,
}

/// Runs `twinpupil optics show`.
pub(super) fn run(args: &Args, console: &Console) -> Result<()> {
    let path = args.asked.lens.lens.as_path();
    if is_instrument(path)? {
        return show_camera::run(&args.asked, &args.form, console).with_context(|| path.display().to_string());
    }
    args.asked.refuse_for_lens()?;
    let used = Used::load(&args.asked.lens, console)?;
    args.form.give(&Shown::of(&used), || drawing(&used))
}

/// The lens in section, with rays of the shortest and the longest wavelength.
fn drawing(used: &Used) -> Result<Drawing> {
    let asked = Asked::of_lens(used, &LENS_FIELDS)?;
    let mut colours = used.shortest_and_longest().to_vec();
    colours.dedup();
    let surfaces = &used.file.prescription.surfaces;
    section(&Drawn { asked: &asked, colours, surfaces, masks: &[], half_sensor_mm: None })
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
            notes: notes(used),
        }
    }
}

/// Surfaces to which the numbers do justice only in part.
fn notes(used: &Used) -> Vec<String> {
    let named = |surfaces: &[usize]| {
        let numbers: Vec<String> = surfaces.iter().map(ToString::to_string).collect();
        format!("surface{} {}", if surfaces.len() > 1 { "s" } else { "" }, numbers.join(", "))
    };
    let flat = used.trains[0].flat_lenses();
    let cylinders: Vec<usize> = (used.file.prescription.surfaces.iter().enumerate())
        .filter(|(_, surface)| matches!(surface.shape, Shape::Cylinder { .. }))
        .map(|(index, _)| index)
        .collect();
    let mut notes = Vec::new();
    if !flat.is_empty() {
        notes.push(format!(
            "{}: facets of a Fresnel lens bend light as a plane with slopes does, of which there are no sums of third \
             order, S_I to S_V; nor are there of the lens",
            named(&flat)
        ));
    }
    if !cylinders.is_empty() {
        notes.push(format!(
            "{}: a cylinder bends light one way alone; lengths and sums are those of the section x = 0",
            named(&cylinders)
        ));
    }
    notes
}

impl Answer for Shown {
    fn text(&self) -> String {
        let stop = self.stop.map_or("no stop".to_owned(), |stop| format!("stop at surface {stop}"));
        let name = if self.name.is_empty() { "a lens" } else { &self.name };
        let header = ["", "f", "F from first", "F' from last", "H from first", "H' from last", "entrance", "exit"];
        let rows: Vec<_> = self.colours.iter().map(Colour::row).collect();
        let mut text = format!("{name}: {} surfaces, {stop}; lengths in mm\n\n", self.surfaces);
        text += &render(header, &rows);
        if let Some(beam) = &self.beam {
            text += &beam.to_text();
        }
        for note in &self.notes {
            text += &format!("\n{note}\n");
        }
        text
    }

    /// One number a row.
    fn table(&self) -> Table {
        let mut rows: Vec<(&str, f64, String, Option<f64>)> = Vec::new();
        for colour in &self.colours {
            let numbers = colour.numbers();
            rows.extend(numbers.map(|(name, value)| (name, colour.wavelength_nm, String::new(), value)));
        }
        let primary_nm = self.colours.first().map_or(f64::NAN, |colour| colour.wavelength_nm);
        if let Some(beam) = &self.beam {
            let numbers = beam.numbers();
            rows.extend(numbers.map(|(name, value)| (name, primary_nm, String::new(), value)));
            for own in &beam.aberrations {
                rows.extend(own.numbers().map(|(name, value)| (name, primary_nm, own.name(), value)));
            }
        }
        rows.retain(|(.., value)| value.is_some());
        let value = |value: Option<f64>| value.unwrap_or(f64::NAN);
        Table::new()
            .with("quantity", Cells::Label(rows.iter().map(|row| row.0.to_owned()).collect()))
            .with("wavelength_nm", Cells::Real(rows.iter().map(|row| row.1).collect(), 4))
            .with("surface", Cells::Label(rows.iter().map(|row| row.2.clone()).collect()))
            .with("value", Cells::Real(rows.iter().map(|row| value(row.3)).collect(), 9))
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

    /// Every number by its name.
    fn numbers(&self) -> [(&'static str, Option<f64>); 7] {
        [
            ("focal_length_mm", Some(self.focal_length_mm)),
            ("front_focus_mm", Some(self.front_focus_mm)),
            ("rear_focus_mm", Some(self.rear_focus_mm)),
            ("front_principal_mm", Some(self.front_principal_mm)),
            ("rear_principal_mm", Some(self.rear_principal_mm)),
            ("entrance_pupil_mm", self.entrance_pupil_mm),
            ("exit_pupil_mm", self.exit_pupil_mm),
        ]
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
        let flat = train.flat_lenses();
        let known = |(surface, sums): (usize, SeidelSums)| (!flat.contains(&surface)).then_some(sums);
        let seidel: Vec<Option<SeidelSums>> =
            train.seidel(marginal, chief).into_iter().enumerate().map(known).collect();
        let colours = train.chromatic(&used.trains[shortest], &used.trains[longest], marginal, chief);
        let sum = Aberrations::of(
            None,
            seidel.iter().copied().try_fold(SeidelSums::default(), |sum, one| Some(sum + one?)),
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

    /// Every number but the sums, by its name.
    fn numbers(&self) -> [(&'static str, Option<f64>); 5] {
        [
            ("entrance_pupil_diameter_mm", Some(self.entrance_pupil_diameter_mm)),
            ("exit_pupil_diameter_mm", self.exit_pupil_diameter_mm),
            ("f_number", Some(self.f_number)),
            ("field_deg", Some(self.field_deg)),
            ("image_chief_slope", Some(self.image_chief_slope)),
        ]
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
    fn of(surface: Option<usize>, seidel: Option<SeidelSums>, colour: ChromaticSums) -> Self {
        Self {
            surface,
            spherical_mm: seidel.map(|sums| sums.spherical_mm),
            coma_mm: seidel.map(|sums| sums.coma_mm),
            astigmatism_mm: seidel.map(|sums| sums.astigmatism_mm),
            field_curvature_mm: seidel.map(|sums| sums.field_curvature_mm),
            distortion_mm: seidel.map(|sums| sums.distortion_mm),
            axial_colour_mm: colour.axial_mm,
            lateral_colour_mm: colour.lateral_mm,
        }
    }

    /// The surface, or that it is the sum.
    fn name(&self) -> String {
        self.surface.map_or("sum".to_owned(), |surface| surface.to_string())
    }

    /// Every number by its name.
    fn numbers(&self) -> [(&'static str, Option<f64>); 7] {
        [
            ("spherical_mm", self.spherical_mm),
            ("coma_mm", self.coma_mm),
            ("astigmatism_mm", self.astigmatism_mm),
            ("field_curvature_mm", self.field_curvature_mm),
            ("distortion_mm", self.distortion_mm),
            ("axial_colour_mm", Some(self.axial_colour_mm)),
            ("lateral_colour_mm", Some(self.lateral_colour_mm)),
        ]
    }

    fn row(&self) -> [String; 8] {
        // No −0.
        let number = |mm: f64| format!("{:.6}", if mm.abs() < 5e-7 { 0.0 } else { mm });
        let known = |mm: Option<f64>| mm.map_or("–".to_owned(), number);
        [
            self.name(),
            known(self.spherical_mm),
            known(self.coma_mm),
            known(self.astigmatism_mm),
            known(self.field_curvature_mm),
            known(self.distortion_mm),
            number(self.axial_colour_mm),
            number(self.lateral_colour_mm),
        ]
    }
}
