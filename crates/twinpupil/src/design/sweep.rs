//! How wide the pupils should be.

use anyhow::Result;
use twinpupil_instrument::{Instrument, Lens, Role, ThinLens};
use twinpupil_optics::Camera;
use twinpupil_simulate::{DotSpec, Scene, SceneSpec, dot_bounds};

use super::Design;

/// Pupils are swept about this share of the focal length, as radii on the lens.
const SHARE: f64 = 0.01;

/// Radii on the lens over that share of the focal length.
const FACTORS: [f64; 5] = [0.5, 0.7, 1.0, 1.4, 2.0];

/// Distances from the axis at which depth is judged, as shares of how far whole dots are seen.
const RADII: [f64; 3] = [0.35, 0.65, 0.95];

/// Rays over the pupil for every pixel.
const SAMPLES: usize = 64;

/// Share of the full well that the brightest dot may fill.
const WELL_SHARE: f64 = 0.7;

/// The dots that depth is judged by.
#[derive(Debug, Clone, Copy)]
pub struct Light {
    /// Diameter, mm.
    pub diameter_mm: f64,
    /// Electrons of a dot through a pupil as wide on the lens as a hundredth of the focal length.
    pub brightness_e: f64,
}

/// One pair of radii and what it makes of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// Radii of the telecentric and the entocentric mask, mm.
    pub radii_mm: [f64; 2],
    /// The same on the lens for light from the focus, over the focal length.
    pub shares: [f64; 2],
    /// Electrons of a dot in the band that has less.
    pub electrons: f64,
    /// Radius of the blur at the nearest and the farthest distance, the larger of both bands, px.
    pub blur_px: [f64; 2],
    /// Radius about the axis within which a band sees nothing, the largest of all distances, mm.
    pub blind_mm: f64,
    /// Standard deviation of z that no unbiased reading can beat, the median over the working volume, mm.
    pub z_std_mm: f64,
    /// Whether blur leaves dots their middle, and the axis is not blind for longer than asked for.
    pub is_fit: bool,
}

/// Every pair of radii to be tried.
pub fn choices(design: &Design) -> Result<Vec<[f64; 2]>> {
    let unit = design.instrument("unit", [1.0, 1.0])?;
    let on_lens = unit.projections().map(|projection| projection.lens_radius_mm(unit.focus_distance_mm()));
    let radius_mm = |band: usize, factor: f64| factor * SHARE * unit.lens.focal_length_mm() / on_lens[band];
    // To a hundredth of a millimetre, or to two digits.
    let round = |mm: f64| {
        let step_mm = 10_f64.powf(mm.log10().floor() - 1.0).min(0.01);
        ((mm / step_mm).round() * step_mm * 1e6).round() / 1e6
    };
    let pairs = FACTORS.into_iter().flat_map(|tele| FACTORS.map(|ento| [tele, ento]));
    Ok(pairs.map(|[tele, ento]| [round(radius_mm(0, tele)), round(radius_mm(1, ento))]).collect())
}

/// What a pair of radii makes of the camera, behind an ideal lens of the same first order: aberrations cost no precision.
pub fn sweep(design: &Design, radii_mm: [f64; 2], light: &Light, blind_mm_max: f64) -> Result<Choice> {
    let instrument = ideal(&design.instrument("swept", radii_mm)?)?;
    let (focus_mm, pair) = (instrument.focus_distance_mm(), instrument.projections());
    let range = instrument.depth_range();
    let on_lens_mm = pair.map(|projection| projection.lens_radius_mm(focus_mm));
    let shares = on_lens_mm.map(|mm| mm / instrument.lens.focal_length_mm());
    let exposed = light.brightness_e * (shares[0].min(shares[1]) / SHARE).powi(2);
    let electrons = exposed.min(WELL_SHARE * instrument.sensor.full_well_e);
    let pitch_mm = instrument.sensor.pitch_mm;
    let blur_px = [range.near_mm, range.far_mm]
        .map(|z_mm| pair.map(|projection| projection.blur_radius_mm(z_mm) / pitch_mm).into_iter().fold(0.0, f64::max));
    let dot_px = |z_mm: f64| {
        let smallest = pair.map(|projection| projection.magnification(z_mm)).into_iter().fold(f64::INFINITY, f64::min);
        0.5 * light.diameter_mm * smallest / pitch_mm
    };
    let blind_mm = blind_radius_mm(&instrument)?;
    let leaves_middle = blur_px[0] < dot_px(range.near_mm) && blur_px[1] < dot_px(range.far_mm);
    Ok(Choice {
        radii_mm,
        shares,
        electrons,
        blur_px,
        blind_mm,
        z_std_mm: median_z_std_mm(&instrument, light.diameter_mm, electrons)?,
        is_fit: leaves_middle && blind_mm <= blind_mm_max,
    })
}

/// The most precise of the choices that are fit, else of all.
pub fn best(choices: &[Choice]) -> Option<Choice> {
    let of = |fit: bool| {
        let fit = choices.iter().filter(|choice| choice.z_std_mm.is_finite() && (choice.is_fit || !fit));
        fit.min_by(|a, b| a.z_std_mm.total_cmp(&b.z_std_mm)).copied()
    };
    of(true).or_else(|| of(false))
}

/// The camera behind an ideal lens: each mask where the band sees it whose pupil it is.
fn ideal(instrument: &Instrument) -> Result<Instrument> {
    let mut spec = instrument.clone().into_spec();
    let by_band = instrument.bands.iter().map(|band| (band.name.clone(), instrument.projection(band).focal_length_mm));
    spec.lens = Lens::Thin(ThinLens {
        focal_length_mm: instrument.lens.focal_length_mm(),
        focal_length_mm_by_band: by_band.collect(),
    });
    for role in [Role::Telecentric, Role::Entocentric] {
        let (band, index) = (instrument.band(role), instrument.pupil_index(instrument.band(role)));
        spec.apertures[index] = instrument.ideal_apertures(band)[index].clone();
    }
    Ok(Instrument::new(spec)?)
}

/// The largest radius within which a band sees nothing, over the depth range.
fn blind_radius_mm(instrument: &Instrument) -> Result<f64> {
    let camera = Camera::new(instrument)?;
    let range = instrument.depth_range();
    let distances_mm = [range.near_mm, 0.5 * (range.near_mm + range.far_mm), range.far_mm];
    let of_band = |z_mm: f64| camera.bands().iter().map(move |band| band.blind_radius_mm(z_mm));
    Ok(distances_mm.into_iter().flat_map(of_band).fold(0.0, f64::max))
}

/// Median of the smallest standard deviations of z that any unbiased reading of dots can have: near and far, in the middle
/// and at the rim of the field.
pub(super) fn median_z_std_mm(instrument: &Instrument, diameter_mm: f64, brightness_e: f64) -> Result<f64> {
    let range = instrument.depth_range();
    let mut found_mm = Vec::new();
    for z_mm in [range.near_mm, 0.5 * (range.near_mm + range.far_mm), range.far_mm] {
        let scene = Scene::new(SceneSpec {
            schema: 1,
            name: "depths".to_owned(),
            seed: 0,
            background_e: 0.0,
            brightness_e,
            illumination: None,
            dots: dots(instrument, z_mm, diameter_mm),
            plate: None,
        })?;
        let bounds = dot_bounds(instrument, &scene, &instrument.response_matrix(), SAMPLES)?;
        found_mm.extend(bounds.into_iter().flatten().map(|bound| bound.std_mm()[2]));
    }
    found_mm.sort_by(f64::total_cmp);
    Ok(found_mm.get(found_mm.len() / 2).copied().unwrap_or(f64::NAN))
}

/// Dots side by side across the field, no two in one direction.
fn dots(instrument: &Instrument, z_mm: f64, diameter_mm: f64) -> Vec<DotSpec> {
    let reach_mm = seen_radius_mm(instrument, z_mm) - diameter_mm;
    let directions = [0.6, 2.7, 4.8_f64];
    let dot = |(share, direction): (f64, f64)| {
        let (r_mm, (sin, cos)) = (share * reach_mm, direction.sin_cos());
        DotSpec { x_mm: r_mm * cos, y_mm: r_mm * sin, z_mm, diameter_mm }
    };
    RADII.into_iter().zip(directions).map(dot).collect()
}

/// Radius about the axis that both bands see in every direction, with the blur of its rim, mm.
pub(super) fn seen_radius_mm(instrument: &Instrument, z_mm: f64) -> f64 {
    let sensor = &instrument.sensor;
    let half_mm = |axis: usize| {
        let last_px = (sensor.size_px[axis] - 1) as f64;
        sensor.pitch_mm * sensor.axis_px[axis].min(last_px - sensor.axis_px[axis])
    };
    let half_mm = half_mm(0).min(half_mm(1));
    let seen = instrument
        .projections()
        .map(|projection| (half_mm - projection.blur_radius_mm(z_mm)) / projection.magnification(z_mm).abs());
    seen[0].min(seen[1])
}
