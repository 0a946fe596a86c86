//! Where masks can stand in a lens.

use twinpupil_instrument::check::ValueError;
use twinpupil_instrument::{LensStand, MaskImage, MaskPlace, PrescriptionLens, Shape};

use crate::train::SurfaceProfile;

/// Air in which a flat mask can stand, by its distance behind a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Room {
    /// The surface; in front of the first one if `to_mm` is negative.
    pub surface: usize,
    /// Nearest and farthest place, mm.
    pub from_mm: f64,
    /// Farthest place, mm.
    pub to_mm: f64,
}

/// How far in front of the lens a mask is looked for, mm.
const IN_FRONT_MM: f64 = 100.0;

/// The rooms of a lens for masks of a radius, from the object to the sensor: `clearance_mm` away from every surface within
/// that radius, and from the sensor.
pub fn rooms(stand: &LensStand, radius_mm: f64, clearance_mm: f64) -> Vec<Room> {
    let surfaces = &stand.prescription.surfaces;
    let depth_mm = |shape: &Shape| {
        let depth_mm = SurfaceProfile::of(shape).depth_mm([0.0, radius_mm]);
        // A mask wider than a surface has no place beside it but beyond its vertex.
        if depth_mm.is_nan() { 0.0 } else { depth_mm }
    };
    let front = surfaces.first().map(|first| Room {
        surface: 0,
        from_mm: -IN_FRONT_MM,
        to_mm: depth_mm(&first.shape).min(0.0) - clearance_mm,
    });
    let behind = surfaces.iter().enumerate().filter(|(_, surface)| surface.medium.eq_ignore_ascii_case("air"));
    let behind = behind.map(|(index, surface)| {
        let next_mm = surfaces.get(index + 1).map_or(0.0, |next| depth_mm(&next.shape).min(0.0));
        Room {
            surface: index,
            from_mm: depth_mm(&surface.shape).max(0.0) + clearance_mm,
            to_mm: surface.gap_mm + next_mm - clearance_mm,
        }
    });
    front.into_iter().chain(behind).filter(|room| room.from_mm <= room.to_mm).collect()
}

/// The place among `rooms` where a mask appears nearest to the principal planes at a wavelength, to a hundredth of a
/// millimetre, and how it appears there; `None` without any room.
///
/// # Errors
/// Where a material is not known at that wavelength.
pub fn entocentric_place(
    lens: &PrescriptionLens,
    rooms: &[Room],
    wavelength_nm: f64,
) -> Result<Option<(MaskPlace, MaskImage)>, ValueError> {
    let image_of = lens.images_of_masks(wavelength_nm)?;
    let mut best: Option<(MaskPlace, MaskImage)> = None;
    for room in rooms {
        let steps = ((room.to_mm - room.from_mm) / STEP_MM).floor() as usize;
        for step in 0..=steps {
            let behind_mm = (100.0 * (room.from_mm + STEP_MM * step as f64)).round() / 100.0;
            let place = MaskPlace { surface: room.surface, behind_mm };
            let image = image_of(place);
            let is_nearer = best.is_none_or(|(_, best)| image.position_mm.abs() < best.position_mm.abs());
            if image.scale > 0.0 && is_nearer {
                best = Some((place, image));
            }
        }
    }
    Ok(best)
}

/// Steps in which places are tried, mm.
const STEP_MM: f64 = 0.05;

/// The rear focal plane of a wavelength, behind the last surface.
///
/// # Errors
/// Where that lies within the lens or too near to it for a mask, and where a material is not known at that wavelength.
pub fn telecentric_place(
    lens: &PrescriptionLens,
    rooms: &[Room],
    stand: &LensStand,
    wavelength_nm: f64,
) -> Result<MaskPlace, ValueError> {
    let points = lens.cardinal_points(wavelength_nm)?;
    let behind_mm = points.rear_principal_mm + points.focal_length_mm;
    let last = stand.prescription.surfaces.len().saturating_sub(1);
    match rooms.iter().find(|room| room.surface == last && room.to_mm >= 0.0) {
        Some(room) if (room.from_mm..=room.to_mm).contains(&behind_mm) => Ok(MaskPlace { surface: last, behind_mm }),
        room => {
            let legal = room.map_or("air behind the last surface".to_owned(), |room| {
                format!("{:.2} to {:.2} mm behind it, where there is room for a mask", room.from_mm, room.to_mm)
            });
            Err(ValueError::new("the rear focal plane behind the last surface", format!("{behind_mm:.2}"), legal))
        }
    }
}
