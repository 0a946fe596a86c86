//! A lens as it is used: wavelengths, beam and field.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::Args;
use twinpupil_instrument::{Catalogue, paraxial_rays};
use twinpupil_optics::{Beam, Field, FieldPoint, FirstOrder, Imager, Train};

use crate::commands::options::{number, size_mm};
use crate::console::Console;
use crate::io::lens::{LensFile, read_with_catalogues};

/// A lens, and how it is used where that is not what its file says.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
pub(super) struct LensArgs {
    /// Lens: a `.zmx` file, a prescription in TOML, or an instrument file whose lens is one of them
    pub(super) lens: PathBuf,
    /// AGF catalogue with glasses of the lens; may be given several times
    #[arg(long, value_name = "FILE")]
    agf: Vec<PathBuf>,
    /// Wavelength, nm, the primary one first; may be given several times, else those of the file
    #[arg(long, value_name = "NM", value_parser = number("1 to 1e6", |nm| (1.0..=1e6).contains(nm)))]
    wavelength_nm: Vec<f64>,
    /// Diameter of the entrance pupil, mm; else that of the file
    #[arg(long, value_name = "MM", value_parser = size_mm())]
    pupil_mm: Option<f64>,
    /// Largest angle of the field, degrees; else that of the file
    #[arg(long, value_name = "DEG", value_parser = number("0 or more, below 90", |deg| (0.0..90.0).contains(deg)))]
    field_deg: Option<f64>,
}

impl LensArgs {
    /// A camera states what would be said of a lens here.
    pub(super) fn refuse_for_camera(&self) -> Result<()> {
        let stated = [
            ("--agf", !self.agf.is_empty()),
            ("--wavelength-nm", !self.wavelength_nm.is_empty()),
            ("--pupil-mm", self.pupil_mm.is_some()),
            ("--field-deg", self.field_deg.is_some()),
        ];
        match stated.iter().find(|(_, is_stated)| *is_stated) {
            Some((option, _)) => {
                bail!("{option} is for a lens; an instrument file states its own, and has --z-mm, --r-mm")
            }
            None => Ok(()),
        }
    }
}

/// A lens as it is used, at every wavelength.
pub(super) struct Used {
    pub(super) file: LensFile,
    /// The primary wavelength first.
    pub(super) trains: Vec<Train>,
    /// At the primary wavelength.
    pub(super) first_order: FirstOrder,
    /// Diameter of the entrance pupil, mm, if anything limits the beam.
    pub(super) pupil_mm: Option<f64>,
    /// Whether that is how close rays see the stop.
    has_paraxial_stop: bool,
    /// Slope of the chief ray before the lens at the edge of the field.
    pub(super) field_slope: f64,
}

impl Used {
    pub(super) fn load(args: &LensArgs, console: &Console) -> Result<Self> {
        let (mut file, catalogues) = read_with_catalogues(&args.lens, &args.agf)?;
        file.warnings().for_each(|warning| console.note(warning));
        if !args.wavelength_nm.is_empty() {
            file.wavelengths_nm.clone_from(&args.wavelength_nm);
        }
        let catalogues: Vec<&Catalogue> = catalogues.iter().collect();
        let train = |nm: &f64| Train::new(&file.prescription, &catalogues, *nm);
        let trains = file.wavelengths_nm.iter().map(train).collect::<Result<Vec<_>, _>>();
        let trains = trains.with_context(|| args.lens.display().to_string())?;
        let first_order = trains[0].first_order(file.prescription.stop());
        let pupil_mm = args.pupil_mm.or_else(|| pupil_mm(&file, &trains[0], &first_order));
        // The stop itself, if nothing else is stated, is as wide as it is.
        let is_stop = args.pupil_mm.is_none() && matches!(file.beam, Some(Beam::Stop) | None);
        let has_paraxial_stop = is_stop || file.has_paraxial_stop;
        let field_slope = match args.field_deg {
            Some(deg) => deg.to_radians().tan(),
            None => file.fields.iter().map(|field| slope(*field, &file, &first_order)).fold(0.0, f64::max),
        };
        Ok(Self { file, trains, first_order, pupil_mm, has_paraxial_stop, field_slope })
    }

    /// The trains of the shortest and the longest wavelength.
    pub(super) fn shortest_and_longest(&self) -> [usize; 2] {
        let nm = &self.file.wavelengths_nm;
        let by_wavelength = |a: &usize, b: &usize| nm[*a].total_cmp(&nm[*b]);
        let all = 0..self.trains.len();
        [all.clone().min_by(by_wavelength), all.max_by(by_wavelength)].map(|k| k.unwrap_or(0))
    }

    /// Where the paraxial chief ray of the primary wavelength meets the image, mm.
    pub(super) fn paraxial_image_mm(&self, slope: f64) -> f64 {
        let chief = paraxial_rays(&self.trains[0].paraxial_surfaces(), 1.0, self.first_order.chief_ray(slope));
        let gap_mm = self.file.prescription.surfaces.last().map_or(0.0, |last| last.gap_mm);
        chief.last().map_or(0.0, |ray| ray.height_mm + ray.slope * gap_mm)
    }

    /// What limits the beam, or what to do about it.
    pub(super) fn pupil_mm(&self) -> Result<f64> {
        self.pupil_mm.context("nothing limits the beam; state --pupil-mm")
    }

    /// The lens at one of its wavelengths, through its stop.
    pub(super) fn imager(&self, colour: usize) -> Result<Imager> {
        let (stop, stop_radius_mm) = (self.file.prescription.stop(), self.stop_radius_mm()?);
        let (train, wavelength_nm) = (self.trains[colour].clone(), self.file.wavelengths_nm[colour]);
        Ok(Imager::through_stop(train, wavelength_nm, stop, stop_radius_mm))
    }

    /// Radius of the stop, mm: where what limits the beam is stated in front of the lens, as wide as the marginal ray of the
    /// primary wavelength has it, a real one unless the file asks for a paraxial one.
    fn stop_radius_mm(&self) -> Result<f64> {
        let pupil_mm = self.pupil_mm()?;
        let Some((stop, pupil)) = self.file.prescription.stop().zip(self.first_order.entrance_pupil) else {
            return Ok(0.5 * pupil_mm);
        };
        let marginal = self.first_order.marginal_ray(pupil_mm, self.file.prescription.object_distance_mm);
        let real_mm = || self.trains[0].height_at_stop_mm(stop, self.field(0.0), marginal.height_mm);
        let paraxial_mm = 0.5 * pupil_mm / pupil.magnification.abs();
        Ok(if self.has_paraxial_stop { None } else { real_mm() }.unwrap_or(paraxial_mm))
    }

    /// The point of the field along y whose chief ray has that slope.
    pub(super) fn field(&self, slope: f64) -> Field {
        match self.file.prescription.object_distance_mm {
            Some(distance_mm) => {
                let pupil_depth_mm = self.first_order.entrance_pupil.map_or(0.0, |pupil| pupil.position_mm);
                Field::Point { position_mm: [0.0, -slope * (distance_mm + pupil_depth_mm), -distance_mm] }
            }
            None => Field::Infinite { slope: [0.0, slope] },
        }
    }
}

/// Diameter of the entrance pupil by what the file says, mm.
fn pupil_mm(file: &LensFile, train: &Train, lens: &FirstOrder) -> Option<f64> {
    let stop = file.prescription.stop().map(|stop| &file.prescription.surfaces[stop]);
    let of_stop = || Some(2.0 * stop?.semi_diameter_mm? * lens.entrance_pupil?.magnification.abs());
    match file.beam {
        Some(Beam::EntrancePupil { diameter_mm }) => Some(diameter_mm),
        Some(Beam::FNumber { f_number }) => Some((lens.focal_length_mm / f_number).abs()),
        Some(Beam::WorkingFNumber { f_number }) => Some(pupil_of_working_f_number_mm(f_number, file, train, lens)),
        Some(Beam::ObjectAperture { sine }) => {
            let pupil_mm = lens.entrance_pupil.map_or(0.0, |pupil| pupil.position_mm);
            let distance_mm = file.prescription.object_distance_mm? + pupil_mm;
            Some(2.0 * distance_mm.abs() * sine / (1.0 - sine * sine).sqrt())
        }
        Some(Beam::Stop) | None => of_stop(),
    }
}

/// Diameter of the entrance pupil whose paraxial marginal ray meets the image at a slope of one over twice the ratio, mm.
fn pupil_of_working_f_number_mm(f_number: f64, file: &LensFile, train: &Train, lens: &FirstOrder) -> f64 {
    let marginal = lens.marginal_ray(1.0, file.prescription.object_distance_mm);
    let image = paraxial_rays(&train.paraxial_surfaces(), 1.0, marginal);
    (0.5 / f_number / image.last().map_or(marginal.slope, |ray| ray.slope)).abs()
}

/// Slope of the chief ray of a point of the field, whichever way it lies.
fn slope(field: FieldPoint, file: &LensFile, lens: &FirstOrder) -> f64 {
    let pupil_mm = lens.entrance_pupil.map_or(0.0, |pupil| pupil.position_mm);
    match field {
        FieldPoint::Angle(deg) => deg[0].to_radians().tan().hypot(deg[1].to_radians().tan()),
        FieldPoint::Object([x, y]) => {
            file.prescription.object_distance_mm.map_or(0.0, |mm| (x.hypot(y) / (mm + pupil_mm)).abs())
        }
        FieldPoint::Image([x, y]) => (x.hypot(y) / lens.focal_length_mm).abs(),
    }
}
