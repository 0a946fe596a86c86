//! What the real lens makes of a designed camera.

use anyhow::Result;
use twinpupil_instrument::{Instrument, Role};
use twinpupil_optics::response_table_for;

use super::Light;
use super::sweep::{median_z_std_mm, seen_radius_mm};

/// A designed camera through its real lens, the telecentric band first, then the entocentric one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Check {
    /// Radius of the field that is judged, at the middle distance, mm.
    pub field_radius_mm: f64,
    /// Light at the rim of that field over that behind an ideal lens.
    pub rim_light: [f64; 2],
    /// Largest displacement of an image by the lens within that field, px.
    pub displacement_px: [f64; 2],
    /// Largest astigmatism there: how much more the blur reaches along the radius than across, px.
    pub astigmatism_px: [f64; 2],
    /// Distance that is in focus, mm.
    pub focus_mm: [f64; 2],
    /// Depth error at the middle distance if the bands' focal lengths were taken for one, mm.
    pub chromatic_error_mm: f64,
    /// Median of the bound of σ_z over the working volume, mm.
    pub z_std_mm: f64,
}

/// Steps in which the rim of the field is sought, and the light that it has at least.
const FIELD_STEPS: u32 = 200;
const RIM_LIGHT_MIN: f64 = 0.5;

/// Looks through the real lens.
pub fn check(instrument: &Instrument, light: &Light, electrons: f64) -> Result<Check> {
    let table = response_table_for(instrument)?;
    let range = instrument.depth_range();
    let middle_mm = 0.5 * (range.near_mm + range.far_mm);
    let bands = [Role::Telecentric, Role::Entocentric].map(|role| instrument.band_index(role));
    // As far as the sensor sees, and the lens lets light of both bands through.
    let reach_mm = seen_radius_mm(instrument, middle_mm);
    let is_lit = |r_mm: f64| bands.iter().all(|band| table.at(*band, r_mm, middle_mm).throughput > RIM_LIGHT_MIN);
    let mut radii_mm = (1..=FIELD_STEPS).rev().map(|step| reach_mm * f64::from(step) / f64::from(FIELD_STEPS));
    let field_radius_mm = radii_mm.find(|r_mm| is_lit(*r_mm)).unwrap_or(0.0);
    let pitch_mm = instrument.sensor.pitch_mm;
    let depths_mm = [range.near_mm, middle_mm, range.far_mm];
    let largest = |band: usize, value: fn(&twinpupil_instrument::PointResponse) -> f64| {
        let nodes = (0..=20).flat_map(|k| depths_mm.map(|z_mm| (f64::from(k) / 20.0 * field_radius_mm, z_mm)));
        nodes.map(|(r_mm, z_mm)| value(&table.at(band, r_mm, z_mm)).abs() / pitch_mm).fold(0.0, f64::max)
    };
    let projections = instrument.projections();
    Ok(Check {
        field_radius_mm,
        rim_light: bands.map(|band| table.at(band, field_radius_mm, middle_mm).throughput),
        displacement_px: bands.map(|band| largest(band, |node| node.aberration_mm)),
        astigmatism_px: bands.map(|band| largest(band, |node| 2.0 * node.spread.stretch_mm)),
        focus_mm: projections.map(|projection| projection.focus_distance_mm()),
        chromatic_error_mm: chromatic_error_mm(instrument, middle_mm),
        z_std_mm: median_z_std_mm(instrument, light.diameter_mm, electrons)?,
    })
}

/// What z is off by if both bands are taken to have the focal length of the design wavelength.
///
/// ```text
/// Γ = m_R/m_B,    z = Γ L f/(L − f)        [Ohno2018, Eqs. 12, 13]
/// ```
fn chromatic_error_mm(instrument: &Instrument, z_mm: f64) -> f64 {
    let [telecentric, entocentric] = instrument.projections().map(|projection| projection.magnification(z_mm));
    let one = |index: usize| {
        let own = instrument.projections()[index];
        let alike = twinpupil_instrument::Projection {
            focal_length_mm: instrument.lens.focal_length_mm(),
            sensor_distance_mm: instrument.sensor.distance_mm,
            ..own
        };
        alike.magnification(z_mm)
    };
    z_mm * (telecentric / entocentric) / (one(0) / one(1)) - z_mm
}
