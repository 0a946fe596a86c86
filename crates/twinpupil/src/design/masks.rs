//! Where both masks and the sensor go.

use anyhow::{Context, Result, bail};
use twinpupil_instrument::check::ValueError;
use twinpupil_instrument::{
    Aperture, CardinalPoints, DepthRange, Instrument, InstrumentSpec, Lens, LensStand, MaskImage, MaskPlace,
    PrescriptionLens, Role, Zone,
};
use twinpupil_optics::{Room, entocentric_place, rooms, telecentric_place};

/// What a camera is to be.
#[derive(Debug, Clone)]
pub struct Wishes {
    /// The lens.
    pub lens: PrescriptionLens,
    /// A camera whose sensor and bands are kept.
    pub like: Instrument,
    /// Distance from the front principal plane that is to be in focus, mm.
    pub distance_mm: f64,
    /// Distances at which objects may be.
    pub depth_range: DepthRange,
    /// Radius within which masks keep clear of glass, and by how much, mm.
    pub mask_radius_mm: f64,
    /// How far masks keep from glass, mm.
    pub clearance_mm: f64,
    /// Where the entocentric mask goes, if that is not left open.
    pub entocentric: Option<MaskPlace>,
}

/// Lens, masks and sensor in place; how wide the pupils are is left open.
#[derive(Debug, Clone)]
pub struct Design {
    /// What was asked for.
    pub wishes: Wishes,
    /// The lens and the sensor.
    pub stand: LensStand,
    /// Where masks have room.
    pub rooms: Vec<Room>,
    /// Where the entocentric mask goes, and how it appears to its band.
    pub entocentric: (MaskPlace, MaskImage),
    /// Where the telecentric mask goes.
    pub telecentric: MaskPlace,
    /// Rear principal plane to sensor, mm.
    pub sensor_distance_mm: f64,
    /// At the wavelengths of the telecentric and the entocentric band.
    pub points: [CardinalPoints; 2],
}

/// Puts the masks where they belong and the sensor where both bands together are in focus.
pub fn design(wishes: Wishes) -> Result<Design> {
    let pair = [Role::Telecentric, Role::Entocentric].map(|role| wishes.like.band(role).wavelength_nm);
    if wishes.like.bands.len() > 2 {
        bail!("the camera whose bands are kept has more than two; legal: one telecentric and one entocentric band");
    }
    let points = of_pair(pair, |nm| wishes.lens.cardinal_points(nm))?;
    let own = wishes.lens.cardinal_points(wishes.lens.design_wavelength_nm)?;
    let sensor_distance_mm = sensor_distance_mm(&own, &points, wishes.distance_mm)?;
    let stand = wishes.lens.stand(sensor_distance_mm)?;
    let rooms = rooms(&stand, wishes.mask_radius_mm, wishes.clearance_mm);
    let telecentric = telecentric_place(&wishes.lens, &rooms, &stand, pair[0])
        .context("the telecentric mask has no room behind this lens")?;
    let telecentric = MaskPlace { behind_mm: round(telecentric.behind_mm), ..telecentric };
    let entocentric = match wishes.entocentric {
        Some(place) => (place, wishes.lens.image_of_mask(place, pair[1])?),
        None => entocentric_place(&wishes.lens, &rooms, pair[1])?
            .with_context(|| format!("no air in the lens has room for a mask of {} mm", wishes.mask_radius_mm))?,
    };
    Ok(Design { stand, rooms, entocentric, telecentric, sensor_distance_mm, points, wishes })
}

fn of_pair(
    pair: [f64; 2],
    points: impl Fn(f64) -> Result<CardinalPoints, ValueError>,
) -> Result<[CardinalPoints; 2], ValueError> {
    Ok([points(pair[0])?, points(pair[1])?])
}

/// To a ten-thousandth of a millimetre.
fn round(mm: f64) -> f64 {
    (1e4 * mm).round() / 1e4
}

/// Rear principal plane of the design wavelength to sensor: half way between where the two bands are in focus.
fn sensor_distance_mm(own: &CardinalPoints, points: &[CardinalPoints; 2], distance_mm: f64) -> Result<f64> {
    const FAR: f64 = 1000.0;
    let focal_length_mm = own.focal_length_mm;
    if !(focal_length_mm.is_finite() && focal_length_mm > 0.0) {
        bail!("the lens has a focal length of {focal_length_mm:.4} mm and forms no image on a sensor; legal: above 0");
    }
    if distance_mm > FAR * focal_length_mm {
        bail!(
            "objects at {distance_mm} mm are as good as at infinity, where both bands see alike; legal: up to {FAR:.0} focal \
             lengths of {focal_length_mm:.4} mm"
        );
    }
    let image_mm = points.map(|band| {
        // Object and image distances of the band count from its own principal planes.
        let z_mm = distance_mm + band.front_principal_mm - own.front_principal_mm;
        band.focal_length_mm * z_mm / (z_mm - band.focal_length_mm) + band.rear_principal_mm - own.rear_principal_mm
    });
    let distance_mm = round(0.5 * (image_mm[0] + image_mm[1]));
    if image_mm.into_iter().all(|mm| mm.is_finite() && mm > focal_length_mm) {
        return Ok(distance_mm);
    }
    bail!("objects must be farther from the lens than its focal length of {focal_length_mm:.4} mm")
}

impl Design {
    /// The camera with pupils of these radii of its telecentric and its entocentric mask, mm.
    pub fn instrument(&self, name: &str, radii_mm: [f64; 2]) -> Result<Instrument> {
        let like = &self.wishes.like;
        let names = [Role::Telecentric, Role::Entocentric].map(|role| like.band(role).name.clone());
        let mask = |place: MaskPlace, band: usize| Aperture {
            position_mm: place.behind_mm,
            surface: Some(place.surface),
            zones: vec![
                Zone { radius_mm: Some(radii_mm[band]), pass: vec![names[band].clone()] },
                Zone { radius_mm: None, pass: vec![names[1 - band].clone()] },
            ],
            centre_mm: [0.0; 2],
        };
        let mut spec: InstrumentSpec = like.clone().into_spec();
        name.clone_into(&mut spec.name);
        spec.lens = Lens::Prescription(Box::new(self.wishes.lens.clone()));
        spec.sensor.distance_mm = self.sensor_distance_mm;
        spec.apertures = vec![mask(self.entocentric.0, 1), mask(self.telecentric, 0)];
        spec.depth_range = Some(self.wishes.depth_range);
        spec.calibration = None;
        Ok(Instrument::new(spec)?)
    }
}
