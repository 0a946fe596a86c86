//! What follows from an instrument, as `instrument show` prints it.

use std::fmt::Write;

use anyhow::Result;
use serde::Serialize;
use twinpupil_instrument::{Band, Instrument, Lens, Projection, ResponseMatrix, ResponseTable};
use twinpupil_optics::smoothed_response_table_for;

use crate::load::LoadedInstrument;
use crate::text_table;

/// Object radii for which the depth per pixel is stated, mm: where the paper's dots lie.
const RADII_MM: [f64; 3] = [2.0, 5.0, 7.5];
/// The most distances in the table over depth.
const DISTANCES_MAX: f64 = 9.0;

/// Share of a band's brightest object point below which a point counts as unseen.
const BLIND_SHARE: f64 = 0.01;
/// Share of a band's brightest object point from which on a point counts as unclipped.
const UNCLIPPED_SHARE: f64 = 0.99;

/// Derived figures of an instrument.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figures {
    name: String,
    lens: String,
    /// Distance at which the data sheet's focal length images sharply, mm.
    focus_distance_mm: f64,
    sensor_size_mm: [f64; 2],
    bands: Vec<BandFigures>,
    depth: Vec<DepthFigures>,
    response: Vec<PlaneResponse>,
}

/// One band.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct BandFigures {
    name: String,
    role: &'static str,
    wavelength_nm: f64,
    focal_length_mm: f64,
    focus_distance_mm: f64,
    pupil_position_mm: f64,
    pupil_diameter_mm: f64,
    field_of_view_near_mm: [f64; 2],
    field_of_view_far_mm: [f64; 2],
}

/// One distance; arrays hold the telecentric band, then the entocentric one.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct DepthFigures {
    z_mm: f64,
    magnification: [f64; 2],
    blur_diameter_px: [f64; 2],
    /// Closer to the axis than this, at least one band sees nothing; none where a band sees nothing at all.
    blind_radius_mm: Option<f64>,
    /// Closer to the axis than this, the masks clip each other's pupils in at least one band.
    clipping_radius_mm: Option<f64>,
    /// Depth for one pixel between the two images of a point at each of `RADII_MM`.
    depth_per_pixel_mm: [f64; 3],
}

/// One plane of the sensor.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct PlaneResponse {
    plane: String,
    /// Signal from unit light of every band, in the order of the bands.
    bands: Vec<f64>,
}

impl Figures {
    /// The figures of an instrument.
    pub fn of(loaded: &LoadedInstrument) -> Result<Self> {
        let instrument = &loaded.instrument;
        let sensor = &instrument.sensor;
        let table = smoothed_response_table_for(instrument)?;
        Ok(Self {
            name: instrument.name.clone(),
            lens: lens(instrument),
            focus_distance_mm: instrument.focus_distance_mm(),
            sensor_size_mm: sensor.size_px.map(|size| size as f64 * sensor.pitch_mm),
            bands: instrument.bands_by_role().iter().map(|index| band(instrument, &instrument.bands[*index])).collect(),
            depth: distances_mm(instrument).into_iter().map(|z_mm| depth(instrument, &table, z_mm)).collect(),
            response: response(instrument, &loaded.response_matrix()?),
        })
    }

    /// As a tidy page for a terminal.
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        // Writing into a string does not fail.
        let _ = writeln!(text, "{}: {}", self.name, self.lens);
        let _ = writeln!(text, "in focus at {:.2} mm, sensor {}", self.focus_distance_mm, size(self.sensor_size_mm));
        text + "\n" + &self.bands_text() + "\n" + &self.depth_text() + "\n" + &self.response_text()
    }

    fn bands_text(&self) -> String {
        let [near_mm, far_mm] = [self.depth.first(), self.depth.last()].map(|row| row.map_or(f64::NAN, |row| row.z_mm));
        let (near, far) = (format!("view at {near_mm} mm"), format!("view at {far_mm} mm"));
        let header = ["band", "role", "λ, nm", "f, mm", "focus, mm", "pupil at, mm", "⌀, mm", &near, &far];
        let row = |band: &BandFigures| {
            [
                band.name.clone(),
                band.role.to_owned(),
                band.wavelength_nm.to_string(),
                format!("{:.2}", band.focal_length_mm),
                format!("{:.2}", band.focus_distance_mm),
                readable(band.pupil_position_mm),
                readable(band.pupil_diameter_mm),
                size(band.field_of_view_near_mm),
                size(band.field_of_view_far_mm),
            ]
        };
        text_table::render(header, &self.bands.iter().map(row).collect::<Vec<_>>())
    }

    fn depth_text(&self) -> String {
        let [first, second] = [0, 1].map(|i| self.bands.get(i).map_or("", |band| &band.name));
        let magnification = [first, second].map(|name| format!("mag. {name}"));
        let blur = [first, second].map(|name| format!("blur {name}, px"));
        let per_pixel = RADII_MM.map(|r_mm| format!("mm/px r={r_mm}"));
        let header = [
            "z, mm",
            &magnification[0],
            &magnification[1],
            &blur[0],
            &blur[1],
            "blind r, mm",
            "clipped r, mm",
            &per_pixel[0],
            &per_pixel[1],
            &per_pixel[2],
        ];
        let row = |row: &DepthFigures| {
            let [m0, m1] = row.magnification.map(|magnification| format!("{magnification:.4}"));
            let [b0, b1] = row.blur_diameter_px.map(|blur_px| format!("{blur_px:.1}"));
            let [d0, d1, d2] = row.depth_per_pixel_mm.map(|depth_mm| format!("{depth_mm:.3}"));
            let [blind, clipped] = [row.blind_radius_mm, row.clipping_radius_mm]
                .map(|radius_mm| radius_mm.map_or("all".to_owned(), |radius_mm| format!("{radius_mm:.2}")));
            [row.z_mm.to_string(), m0, m1, b0, b1, blind, clipped, d0, d1, d2]
        };
        text_table::render(header, &self.depth.iter().map(row).collect::<Vec<_>>())
    }

    fn response_text(&self) -> String {
        let names = self.bands.iter().map(|band| band.name.as_str()).collect::<Vec<_>>().join(", ");
        let mut text = format!("signal in each plane from unit light of {names}\n");
        for plane in &self.response {
            let values = plane.bands.iter().map(|value| format!("{value:.4}")).collect::<Vec<_>>().join("  ");
            let _ = writeln!(text, "{}  {values}", plane.plane);
        }
        text
    }
}

/// To a ten-thousandth, without zeros at the end.
fn readable(mm: f64) -> String {
    ((1e4 * mm).round() / 1e4).to_string()
}

fn lens(instrument: &Instrument) -> String {
    match &instrument.lens {
        Lens::Thin(lens) => format!("thin lens, f = {} mm", lens.focal_length_mm),
        Lens::Fresnel(lens) => format!(
            "Fresnel lens of {}, f = {} mm at {} nm, grooves of {} mm towards the {}",
            lens.material,
            lens.focal_length_mm,
            lens.design_wavelength_nm,
            lens.groove_pitch_mm,
            format!("{:?}", lens.grooves).to_lowercase(),
        ),
        Lens::Prescription(lens) => format!(
            "lens of {} surfaces, f = {:.4} mm at {} nm",
            lens.prescription.as_ref().map_or(0, |spec| spec.surfaces.len()),
            instrument.lens.focal_length_mm(),
            lens.design_wavelength_nm,
        ),
    }
}

fn band(instrument: &Instrument, band: &Band) -> BandFigures {
    let projection = instrument.projection(band);
    let range = instrument.depth_range();
    BandFigures {
        name: band.name.clone(),
        role: band.role.name(),
        wavelength_nm: band.wavelength_nm,
        focal_length_mm: projection.focal_length_mm,
        focus_distance_mm: projection.focus_distance_mm(),
        pupil_position_mm: projection.pupil_position_mm,
        pupil_diameter_mm: 2.0 * projection.pupil_radius_mm,
        field_of_view_near_mm: field_of_view_mm(instrument, &projection, range.near_mm),
        field_of_view_far_mm: field_of_view_mm(instrument, &projection, range.far_mm),
    }
}

/// Width and height that fill the sensor at distance `z_mm`.
fn field_of_view_mm(instrument: &Instrument, projection: &Projection, z_mm: f64) -> [f64; 2] {
    let sensor = &instrument.sensor;
    sensor.size_px.map(|size| size as f64 * sensor.pitch_mm / projection.magnification(z_mm).abs())
}

fn depth(instrument: &Instrument, table: &ResponseTable, z_mm: f64) -> DepthFigures {
    let projections = instrument.projections();
    let pitch_mm = instrument.sensor.pitch_mm;
    DepthFigures {
        z_mm,
        magnification: projections.map(|projection| projection.magnification(z_mm)),
        blur_diameter_px: projections.map(|projection| 2.0 * projection.blur_radius_mm(z_mm) / pitch_mm),
        blind_radius_mm: radius_of_share_mm(table, z_mm, BLIND_SHARE),
        clipping_radius_mm: clipping_radius_mm(table, z_mm),
        depth_per_pixel_mm: RADII_MM.map(|r_mm| pitch_mm / disparity_slope(&projections, z_mm) / r_mm),
    }
}

/// Radius from which on the masks hardly clip each other's pupils at `z_mm`.
pub(super) fn clipping_radius_mm(table: &ResponseTable, z_mm: f64) -> Option<f64> {
    radius_of_share_mm(table, z_mm, UNCLIPPED_SHARE)
}

/// Radius from which on both bands see a point at `z_mm` with at least `share` of their brightest.
fn radius_of_share_mm(table: &ResponseTable, z_mm: f64, share: f64) -> Option<f64> {
    let radii_mm: Vec<f64> = (0..table.r_mm.count).map(|i| table.r_mm.node(i)).collect();
    let reached_mm = |band: usize| {
        let throughputs: Vec<f64> = radii_mm.iter().map(|&r_mm| table.at(band, r_mm, z_mm).throughput).collect();
        let level = share * throughputs.iter().copied().fold(0.0, f64::max);
        let first = throughputs.iter().position(|&throughput| throughput > 0.0 && throughput >= level)?;
        Some(crossing_mm(&radii_mm, &throughputs, first, level))
    };
    let reached_mm = (0..table.bands.len()).map(reached_mm).collect::<Option<Vec<f64>>>()?;
    reached_mm.into_iter().reduce(f64::max)
}

/// Where the throughput reaches `level` on its way to node `first`, linear between nodes.
fn crossing_mm(radii_mm: &[f64], throughputs: &[f64], first: usize, level: f64) -> f64 {
    let Some(before) = first.checked_sub(1) else { return 0.0 };
    let fraction = (level - throughputs[before]) / (throughputs[first] - throughputs[before]);
    radii_mm[before] + fraction * (radii_mm[first] - radii_mm[before])
}

/// How fast the distance between the two images of a point at r = 1 mm changes with depth, by a central difference.
///
/// With a pupil in the focal plane and one at the lens it is `r_B / z` for r = 1, the inverse of ∂z/∂r_B.
fn disparity_slope(projections: &[Projection; 2], z_mm: f64) -> f64 {
    let step_mm = 1e-4 * z_mm;
    let disparity = |z_mm: f64| projections[0].magnification(z_mm) - projections[1].magnification(z_mm);
    ((disparity(z_mm + step_mm) - disparity(z_mm - step_mm)) / (2.0 * step_mm)).abs()
}

/// The ends of the depth range and the round distances between them.
fn distances_mm(instrument: &Instrument) -> Vec<f64> {
    let range = instrument.depth_range();
    let step_mm = round_step((range.far_mm - range.near_mm) / (DISTANCES_MAX - 2.0));
    let first = (range.near_mm / step_mm).floor() as i64 + 1;
    let inner = (first..).map(|k| k as f64 * step_mm).take_while(|z_mm| *z_mm < range.far_mm);
    std::iter::once(range.near_mm).chain(inner).chain([range.far_mm]).collect()
}

/// The next larger of 1, 2.5 and 5 times a power of ten.
fn round_step(step: f64) -> f64 {
    let decade = 10_f64.powf(step.log10().floor());
    [1.0, 2.5, 5.0, 10.0].into_iter().map(|factor| factor * decade).find(|round| *round >= step).unwrap_or(step)
}

fn response(instrument: &Instrument, matrix: &ResponseMatrix) -> Vec<PlaneResponse> {
    let order = instrument.bands_by_role();
    let row = |plane: String| {
        let values = matrix.of_plane(&plane);
        PlaneResponse { plane, bands: order.iter().map(|band| values[*band]).collect() }
    };
    instrument.planes().into_iter().map(row).collect()
}

fn size([width_mm, height_mm]: [f64; 2]) -> String {
    format!("{width_mm:.2} × {height_mm:.2} mm")
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::console::Console;

    fn paper() -> Figures {
        Figures::of(&LoadedInstrument::load(Path::new("paper"), &Console::new(true)).expect("the paper's"))
            .expect("figures")
    }

    #[test]
    fn the_papers_figures_follow_from_its_equations() {
        let figures = paper();
        assert!((figures.focus_distance_mm - 296.078_431).abs() < 1e-6);
        let at_300 = figures.depth.iter().find(|row| row.z_mm == 300.0).expect("a round distance");
        assert!((at_300.magnification[0] - 0.51).abs() < 1e-12);
        // ∂z/∂r_B = −z/r_B with r_B = L r/z.
        let expected_mm = 300.0 / (151.0 * 2.0 / 300.0) * 0.00586;
        assert!((at_300.depth_per_pixel_mm[0] - expected_mm).abs() < 1e-6);
        // The telecentric pencil is 0.5 · 300/100 mm wide on the lens, whose disc of 1 mm it must clear: r = 2.5. The
        // entocentric one is blind while its image in the focal plane, r/3 ± 1/3 mm, lies within 0.5 mm: r = 0.5.
        assert!((at_300.clipping_radius_mm.unwrap_or(0.0) - 2.5).abs() < 0.1, "{at_300:?}");
        assert!((at_300.blind_radius_mm.unwrap_or(0.0) - 0.5).abs() < 0.15, "{at_300:?}");
        assert_eq!(figures.response.len(), 3);
        assert_eq!(figures.response[0].bands, [1.0, 0.0]);
    }

    #[test]
    fn grooves_do_not_make_masks_clip_farther_out() {
        let ideal = paper();
        let (before, rest) = twinpupil_instrument::paper::INSTRUMENT_TOML.split_once("[lens]").expect("a lens");
        let (_, behind) = rest.split_once("[sensor]").expect("a sensor");
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("camera.toml");
        for grooves in ["object", "image"] {
            let lens = format!("[lens]\nmodel = \"fresnel\"\nfocal_length_mm = 100.0\ngrooves = \"{grooves}\"");
            std::fs::write(&path, format!("{before}{lens}\n[sensor]{behind}")).expect("a file");
            let figures =
                Figures::of(&LoadedInstrument::load(&path, &Console::new(true)).expect("legal")).expect("figures");
            for (own, ideal) in figures.depth.iter().zip(&ideal.depth) {
                let [own_mm, ideal_mm] = [own, ideal].map(|row| row.clipping_radius_mm.unwrap_or(f64::INFINITY));
                assert!((own_mm - ideal_mm).abs() < 0.15, "{grooves} {}: {own_mm} {ideal_mm}", own.z_mm);
            }
        }
    }

    #[test]
    fn distances_are_round_and_few() {
        let distances: Vec<f64> = paper().depth.iter().map(|row| row.z_mm).collect();
        assert_eq!(distances, [235.0, 250.0, 275.0, 300.0, 325.0, 350.0, 370.0]);
        assert_eq!([0.9, 1.0, 1.1, 19.3, 30.0, 71.0].map(round_step), [1.0, 1.0, 2.5, 25.0, 50.0, 100.0]);
    }
}
