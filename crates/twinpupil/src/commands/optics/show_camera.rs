//! `twinpupil optics show` of a camera: its bands, its masks, and its section with rays of all bands through them.

use anyhow::{Result, bail};
use serde::Serialize;
use twinpupil_instrument::{Instrument, Lens, LensStand, MaskPlace, Zone};

use super::answer::{Answer, Form};
use super::asked::{Asked, AskedArgs, CAMERA_FIELDS};
use super::layout::{Drawn, section};
use crate::console::Console;
use crate::drawing::Drawing;
use crate::io::table::{Cells, Table};
use crate::load::LoadedInstrument;
use crate::text_table::render;

/// What is printed.
#[derive(Debug, Serialize)]
struct Camera {
    name: String,
    surfaces: usize,
    /// Behind the rear principal plane, and behind the last surface.
    sensor_distance_mm: f64,
    sensor_behind_last_surface_mm: f64,
    /// Distance of objects.
    z_mm: f64,
    bands: Vec<Band>,
    masks: Vec<Mask>,
}

/// A band to first order.
#[derive(Debug, Serialize)]
struct Band {
    band: String,
    role: &'static str,
    wavelength_nm: f64,
    focal_length_mm: f64,
    /// Behind the rear principal plane of the band, as seen from the image; in front of the front one if negative.
    pupil_position_mm: f64,
    pupil_radius_mm: f64,
    focus_distance_mm: f64,
    /// At the distance of objects.
    magnification: f64,
    /// Radius of the blur there.
    blur_radius_mm: f64,
}

/// A mask among the surfaces.
#[derive(Debug, Serialize)]
struct Mask {
    mask: usize,
    surface: usize,
    behind_mm: f64,
    zones: Vec<Zone>,
}

/// Shows a camera.
pub(super) fn run(args: &AskedArgs, form: &Form, console: &Console) -> Result<()> {
    let instrument = LoadedInstrument::load(&args.lens.lens, console)?.instrument;
    let asked = Asked::of_instrument(&instrument, args, &CAMERA_FIELDS)?;
    let Lens::Prescription(lens) = &instrument.lens else { bail!("a camera without surfaces") };
    let stand = lens.stand(instrument.sensor.distance_mm)?;
    let places = lens.places(&instrument.apertures)?;
    let camera = Camera::of(&instrument, &stand, &places, asked.z_mm().unwrap_or(f64::NAN));
    form.give(&camera, || drawing(&instrument, &stand, &asked))
}

/// A camera in section, with rays of all bands from where it is in focus.
pub(in crate::commands) fn camera_drawing(instrument: &Instrument) -> Result<Drawing> {
    let asked = Asked::of_camera(instrument, None, None, &CAMERA_FIELDS)?;
    let Lens::Prescription(lens) = &instrument.lens else { bail!("a camera without surfaces") };
    drawing(instrument, &lens.stand(instrument.sensor.distance_mm)?, &asked)
}

fn drawing(instrument: &Instrument, stand: &LensStand, asked: &Asked) -> Result<Drawing> {
    let sensor = &instrument.sensor;
    section(&Drawn {
        asked,
        colours: (0..asked.colours.len()).collect(),
        surfaces: &stand.prescription.surfaces,
        masks: &instrument.apertures,
        half_sensor_mm: Some(0.5 * sensor.size_px[1] as f64 * sensor.pitch_mm),
    })
}

impl Camera {
    fn of(instrument: &Instrument, stand: &LensStand, places: &[MaskPlace], z_mm: f64) -> Self {
        let band = |index: usize| {
            let own = &instrument.bands[index];
            let projection = instrument.projection(own);
            Band {
                band: own.name.clone(),
                role: own.role.name(),
                wavelength_nm: own.wavelength_nm,
                focal_length_mm: projection.focal_length_mm,
                pupil_position_mm: projection.pupil_position_mm,
                pupil_radius_mm: projection.pupil_radius_mm,
                focus_distance_mm: projection.focus_distance_mm(),
                magnification: projection.magnification(z_mm),
                blur_radius_mm: projection.blur_radius_mm(z_mm),
            }
        };
        let mask = |(index, place): (usize, &MaskPlace)| Mask {
            mask: index,
            surface: place.surface,
            behind_mm: place.behind_mm,
            zones: instrument.apertures[index].zones.clone(),
        };
        let distance_mm = instrument.sensor.distance_mm;
        Self {
            name: instrument.name.clone(),
            surfaces: stand.prescription.surfaces.len(),
            sensor_distance_mm: distance_mm,
            sensor_behind_last_surface_mm: stand.rear_principal_mm + distance_mm - stand.length_mm,
            z_mm,
            bands: instrument.bands_by_role().into_iter().map(band).collect(),
            masks: places.iter().enumerate().map(mask).collect(),
        }
    }
}

impl Mask {
    /// Its zones in words.
    fn zones_text(&self) -> String {
        let zone = |zone: &Zone| {
            let passed = if zone.pass.is_empty() { "nothing".to_owned() } else { zone.pass.join(", ") };
            zone.radius_mm.map_or(format!("beyond {passed}"), |mm| format!("to {mm} {passed}"))
        };
        self.zones.iter().map(zone).collect::<Vec<_>>().join("; ")
    }
}

impl Answer for Camera {
    fn text(&self) -> String {
        let mut text = format!(
            "{}: a camera of {} surfaces, its sensor {:.4} behind the rear principal plane and {:.4} behind the last surface; \
             lengths in mm\n\n",
            self.name, self.surfaces, self.sensor_distance_mm, self.sensor_behind_last_surface_mm
        );
        let at = format!("at z = {:.1}: m", self.z_mm);
        let header =
            ["band", "role", "wavelength", "f", "pupil behind H'", "its radius", "in focus", &at, "blur radius"];
        let row = |own: &Band| {
            [
                own.band.clone(),
                own.role.to_owned(),
                format!("{} nm", own.wavelength_nm),
                format!("{:.4}", own.focal_length_mm),
                format!("{:.4}", own.pupil_position_mm),
                format!("{:.4}", own.pupil_radius_mm),
                format!("{:.3}", own.focus_distance_mm),
                format!("{:.5}", own.magnification),
                format!("{:.5}", own.blur_radius_mm.abs()),
            ]
        };
        text += &render(header, &self.bands.iter().map(row).collect::<Vec<_>>());
        let row = |own: &Mask| {
            [own.mask.to_string(), own.surface.to_string(), format!("{:.4}", own.behind_mm), own.zones_text()]
        };
        text += "\n";
        text += &render(["mask", "surface", "behind it", "passes"], &self.masks.iter().map(row).collect::<Vec<_>>());
        text
    }

    /// Its bands.
    fn table(&self) -> Table {
        let words = |of: fn(&Band) -> &str| Cells::Label(self.bands.iter().map(|own| of(own).to_owned()).collect());
        let reals = |of: fn(&Band) -> f64| Cells::Real(self.bands.iter().map(of).collect(), 9);
        Table::new()
            .with("band", words(|own| &own.band))
            .with("role", words(|own| own.role))
            .with("wavelength_nm", reals(|own| own.wavelength_nm))
            .with("focal_length_mm", reals(|own| own.focal_length_mm))
            .with("pupil_position_mm", reals(|own| own.pupil_position_mm))
            .with("pupil_radius_mm", reals(|own| own.pupil_radius_mm))
            .with("focus_distance_mm", reals(|own| own.focus_distance_mm))
            .with("z_mm", Cells::Real(vec![self.z_mm; self.bands.len()], 9))
            .with("magnification", reals(|own| own.magnification))
            .with("blur_radius_mm", reals(|own| own.blur_radius_mm))
    }
}
