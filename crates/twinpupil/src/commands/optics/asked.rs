//! What is asked about: a lens over the angles of its field, or a camera in its bands over places in front of it.

use anyhow::{Context, Result, bail};
use clap::Args;
use serde::Serialize;
use twinpupil_instrument::{Instrument, Lens};
use twinpupil_optics::{BandImager, Field, Imager, PupilFunction, Sight};

use super::used::{LensArgs, Used};
use crate::commands::options::{distance_mm, extent_mm};
use crate::console::Console;
use crate::io::table::{Cells, Table};
use crate::load::{LoadedInstrument, is_instrument};
use crate::plot;

/// A lens or a camera, and where objects are.
#[derive(Debug, Args)]
pub(super) struct AskedArgs {
    /// The lens; an instrument file with `lens.model = "prescription"` is asked in its bands, through its masks.
    #[command(flatten)]
    pub(super) lens: LensArgs,
    /// Of a camera: distance of objects from the front principal plane, mm; else where it is in focus
    #[arg(long, value_name = "MM", value_parser = distance_mm())]
    z_mm: Option<f64>,
    /// Of a camera: largest distance of objects from the axis, mm; else what all bands see on the sensor
    #[arg(long, value_name = "MM", value_parser = extent_mm())]
    r_mm: Option<f64>,
}

impl AskedArgs {
    /// A lens has no objects at a distance of their own.
    pub(super) fn refuse_for_lens(&self) -> Result<()> {
        if self.z_mm.is_some() || self.r_mm.is_some() {
            bail!("{}: --z-mm and --r-mm are for an instrument file; this is a lens", self.lens.lens.display());
        }
        Ok(())
    }
}

/// What is asked about.
pub(super) struct Asked {
    pub(super) colours: Vec<Colour>,
    pub(super) fields: Vec<FieldAsked>,
    /// Of a camera, the distance of objects, mm.
    z_mm: Option<f64>,
}

/// A wavelength of a lens or a band of a camera.
pub(super) struct Colour {
    pub(super) name: String,
    band: Option<String>,
    wavelength_nm: f64,
    pub(super) imager: Imager,
}

/// A point of the field.
pub(super) struct FieldAsked {
    /// Degrees from the axis of a lens, mm from that of a camera.
    pub(super) place: f64,
    /// For every colour: the point itself, and how far from the axis an ideal lens would image it, mm.
    points: Vec<(Field, f64)>,
}

/// One colour at one point of the field.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) asked: &'a Asked,
    pub(super) colour: usize,
    pub(super) field: usize,
}

/// What a row of an answer is about.
#[derive(Debug, Clone, Serialize)]
pub(super) struct About {
    #[serde(skip_serializing_if = "Option::is_none")]
    field_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    r_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    z_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    band: Option<String>,
    wavelength_nm: f64,
}

/// Parts of the field of a lens that tell of all of it.
pub(super) const LENS_FIELDS: [f64; 3] = [0.0, 0.7, 1.0];

/// The same of a camera, which is blind about its axis.
pub(super) const CAMERA_FIELDS: [f64; 3] = [0.4, 0.7, 1.0];

impl Asked {
    /// A lens or a camera at some points of its field.
    pub(super) fn at_some_points(args: &AskedArgs, console: &Console) -> Result<Self> {
        let fields = if is_instrument(&args.lens.lens)? { CAMERA_FIELDS } else { LENS_FIELDS };
        Self::load(args, &fields, console)
    }

    /// A lens, by the parts of its field, or a camera by those of its own.
    pub(super) fn load(args: &AskedArgs, parts: &[f64], console: &Console) -> Result<Self> {
        let path = args.lens.lens.as_path();
        if is_instrument(path)? {
            return Self::of_instrument(&LoadedInstrument::load(path, console)?.instrument, args, parts)
                .with_context(|| path.display().to_string());
        }
        args.refuse_for_lens()?;
        Self::of_lens(&Used::load(&args.lens, console)?, parts)
    }

    /// A lens as it is used.
    pub(super) fn of_lens(used: &Used, parts: &[f64]) -> Result<Self> {
        let colour = |(k, nm): (usize, &f64)| {
            Ok(Colour { name: format!("{nm} nm"), band: None, wavelength_nm: *nm, imager: used.imager(k)? })
        };
        let colours = used.file.wavelengths_nm.iter().enumerate().map(colour).collect::<Result<Vec<_>>>()?;
        let field = |part: &f64| {
            let slope = part * used.field_slope;
            let point = (used.field(slope), used.paraxial_image_mm(slope));
            FieldAsked { place: slope.atan().to_degrees(), points: vec![point; colours.len()] }
        };
        Ok(Self { fields: parts_of(used.field_slope, parts).iter().map(field).collect(), colours, z_mm: None })
    }

    /// A camera in its bands, as the arguments say.
    pub(super) fn of_instrument(instrument: &Instrument, args: &AskedArgs, parts: &[f64]) -> Result<Self> {
        args.lens.refuse_for_camera()?;
        Self::of_camera(instrument, args.z_mm, args.r_mm, parts)
    }

    /// A camera in its bands: objects where it is in focus and as far out as all bands see, unless it is said otherwise.
    pub(super) fn of_camera(
        instrument: &Instrument,
        z_mm: Option<f64>,
        r_mm: Option<f64>,
        parts: &[f64],
    ) -> Result<Self> {
        let z_mm = z_mm.unwrap_or_else(|| instrument.focus_distance_mm());
        let largest_mm = r_mm.unwrap_or_else(|| seen_radius_mm(instrument, z_mm));
        let mut bands = Vec::new();
        for index in instrument.bands_by_role() {
            let band = &instrument.bands[index];
            let Some(imager) = BandImager::new(instrument, band)? else {
                let model = if matches!(instrument.lens, Lens::Thin(_)) { "thin" } else { "fresnel" };
                bail!("`lens.model` is {model}; legal: prescription, a lens surface by surface");
            };
            bands.push((band, imager));
        }
        let field = |part: &f64| {
            let object_mm = [0.0, part * largest_mm, z_mm];
            let point = |(band, imager): &(&twinpupil_instrument::Band, BandImager)| {
                (imager.field(object_mm), instrument.projection(band).image(object_mm).y_mm)
            };
            FieldAsked { place: part * largest_mm, points: bands.iter().map(point).collect() }
        };
        let fields = parts_of(largest_mm, parts).iter().map(field).collect();
        let colour = |(band, imager): (&twinpupil_instrument::Band, BandImager)| Colour {
            name: band.name.clone(),
            band: Some(band.name.clone()),
            wavelength_nm: band.wavelength_nm,
            imager: imager.imager,
        };
        Ok(Self { fields, colours: bands.into_iter().map(colour).collect(), z_mm: Some(z_mm) })
    }

    /// Every colour at every point of the field, which comes first.
    pub(super) fn views(&self) -> Vec<View<'_>> {
        let fields = 0..self.fields.len();
        let view = |field: usize, colour: usize| View { asked: self, colour, field };
        fields.flat_map(|field| (0..self.colours.len()).map(move |colour| view(field, colour))).collect()
    }

    /// Those at one point of the field.
    pub(super) fn views_at(&self, field: usize) -> impl Iterator<Item = View<'_>> {
        (0..self.colours.len()).map(move |colour| View { asked: self, colour, field })
    }

    /// Of a camera, the distance of objects, mm.
    pub(super) fn z_mm(&self) -> Option<f64> {
        self.z_mm
    }

    pub(super) fn is_camera(&self) -> bool {
        self.z_mm.is_some()
    }

    /// What a point of the field is called.
    pub(super) fn field_name(&self, field: usize) -> String {
        let place = self.fields[field].place;
        if self.is_camera() { format!("r = {place:.3} mm") } else { format!("{place:.3}°") }
    }

    /// What each colour is drawn in: blue for the shortest wavelength, red for the longest.
    pub(super) fn inks(&self) -> Vec<plot::Colour> {
        const BETWEEN: [plot::Colour; 3] = [plot::Colour::Green, plot::Colour::Orange, plot::Colour::Purple];
        let last = self.colours.len().saturating_sub(1);
        let ink = |own: &Colour| {
            let shorter = self.colours.iter().filter(|other| other.wavelength_nm < own.wavelength_nm).count();
            match shorter {
                0 => plot::Colour::Blue,
                _ if shorter == last => plot::Colour::Vermilion,
                _ => BETWEEN[(shorter - 1) % BETWEEN.len()],
            }
        };
        self.colours.iter().map(ink).collect()
    }

    /// What colours are called.
    pub(super) fn colours_are(&self) -> &'static str {
        if self.is_camera() { "band" } else { "wavelength" }
    }

    /// What the field is measured in.
    pub(super) fn field_is(&self) -> &'static str {
        if self.is_camera() { "distance from the axis, mm" } else { "field, degrees" }
    }

    /// The columns that say what rows are about.
    pub(super) fn table(&self, rows: &[&About]) -> Table {
        let reals = |of: fn(&About) -> Option<f64>, decimals: usize| {
            Cells::Real(rows.iter().map(|about| of(about).unwrap_or(f64::NAN)).collect(), decimals)
        };
        let table = if self.is_camera() {
            let bands = rows.iter().map(|about| about.band.clone().unwrap_or_default()).collect();
            Table::new()
                .with("r_mm", reals(|about| about.r_mm, 6))
                .with("z_mm", reals(|about| about.z_mm, 6))
                .with("band", Cells::Label(bands))
        } else {
            Table::new().with("field_deg", reals(|about| about.field_deg, 6))
        };
        table.with("wavelength_nm", reals(|about| Some(about.wavelength_nm), 4))
    }
}

/// Parts of a field, of which there is only the middle if it has no extent.
fn parts_of(extent: f64, parts: &[f64]) -> Vec<f64> {
    if extent == 0.0 { vec![0.0] } else { parts.to_vec() }
}

/// How far from the axis a point may be that all bands image within the shorter side of the sensor, mm.
fn seen_radius_mm(instrument: &Instrument, z_mm: f64) -> f64 {
    let [width_px, height_px] = instrument.sensor.size_px;
    let half_mm = 0.5 * width_px.min(height_px) as f64 * instrument.sensor.pitch_mm;
    let largest = instrument.bands.iter().map(|band| instrument.projection(band).magnification(z_mm).abs());
    half_mm / largest.fold(f64::MIN_POSITIVE, f64::max)
}

impl<'a> View<'a> {
    /// The point of the field.
    pub(super) fn point_of_field(&self) -> Field {
        self.point().0
    }

    fn point(&self) -> (Field, f64) {
        self.asked.fields[self.field].points[self.colour]
    }

    /// How far from the axis an ideal lens would image the point, mm.
    pub(super) fn ideal_mm(&self) -> f64 {
        self.point().1
    }

    /// How far beyond that a chief ray meets the image, in parts of it; none on the axis.
    pub(super) fn distortion(&self, chief_mm: Option<f64>) -> Option<f64> {
        let ideal_mm = self.ideal_mm();
        chief_mm.filter(|_| ideal_mm != 0.0).map(|mm| mm / ideal_mm - 1.0)
    }

    pub(super) fn colour(&self) -> &'a Colour {
        &self.asked.colours[self.colour]
    }

    /// What the lens makes of the point; `None` if no chief ray gets to the image.
    pub(super) fn sight(&self) -> Option<Sight<'a>> {
        self.colour().imager.sight(self.point().0)
    }

    /// The same, with a wavefront.
    pub(super) fn sight_with_wavefront(&self) -> Result<Option<Sight<'a>>> {
        let sight = self.sight();
        if sight.as_ref().is_some_and(|sight| !sight.has_wavefront()) {
            bail!(
                "the lens has a surface of kind thin-lens, whose path lengths are those of light along its axis; legal \
                 for diffraction: an infinite object on the axis (--field-deg 0), or real surfaces"
            );
        }
        Ok(sight)
    }

    pub(super) fn about(&self) -> About {
        let (colour, place) = (self.colour(), self.asked.fields[self.field].place);
        let is_camera = self.asked.is_camera();
        About {
            field_deg: (!is_camera).then_some(place),
            r_mm: is_camera.then_some(place),
            z_mm: self.asked.z_mm,
            band: colour.band.clone(),
            wavelength_nm: colour.wavelength_nm,
        }
    }

    /// The first cells of a row for the terminal.
    pub(super) fn head(&self) -> [String; 2] {
        [self.asked.field_name(self.field), self.colour().name.clone()]
    }
}

/// Fewest and most places across the pupil.
const GRIDS: [usize; 2] = [128, 512];

/// Steps of the wavefront, in wavelengths, from which on a grid is too coarse.
const STEEP: f64 = 0.5;

/// Light and wavefront over the pupil, on a grid as fine as the wavefront needs.
pub(super) struct Pupil {
    pub(super) function: PupilFunction,
    /// Whether the finest grid tells diffraction.
    pub(super) is_resolved: bool,
}

impl Pupil {
    /// `None` where no light comes through.
    pub(super) fn of(sight: &Sight<'_>) -> Option<Self> {
        let mut size = GRIDS[0];
        loop {
            let function = sight.pupil_function(size).filter(|function| function.filled_share() > 0.0)?;
            let is_resolved = function.steepest_step() < STEEP;
            if is_resolved || size >= GRIDS[1] {
                return Some(Self { function, is_resolved });
            }
            size *= 2;
        }
    }
}
