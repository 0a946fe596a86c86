//! The grooves of a Fresnel lens among other surfaces: facets and walls, ray by ray.

use twinpupil_instrument::check::ValueError;
use twinpupil_instrument::{Catalogue, FresnelLens, Glass, GrooveSide, Prescription, Shape};

use super::face::Face;
use super::fate::{MISSED, REFLECTED, WALL, code};
use super::rays::{Block, LANES};
use crate::line::Line;
use crate::plate::Plate;
use crate::refraction::{Vector, dot};
use crate::{OpticsError, RayFate};

/// The grooves of a Fresnel lens. The plane of their peaks is z = 0.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Facets {
    plate: Plate,
    /// How depths below the peaks grow with z: 1 or −1.
    depth_per_z: f64,
}

impl Facets {
    pub(crate) fn vertex_curvature_per_mm(&self) -> f64 {
        self.depth_per_z * self.plate.grooves[0].facet.curvature_per_mm
    }

    /// The same infinitely fine.
    pub(crate) fn smoothed(self) -> Self {
        Self { plate: self.plate.smoothed(), ..self }
    }

    /// Depth along z at a distance from the axis, mm.
    pub(crate) fn depth_mm(&self, r_mm: f64) -> f64 {
        self.depth_per_z * self.plate.facet_depth_mm(r_mm)
    }

    /// Sends a block of rays through, one by one: each meets a facet of its own.
    pub(crate) fn pass(&self, face: &Face, block: &mut Block) {
        for lane in (0..LANES).filter(|lane| block.fate[*lane] == 0).collect::<Vec<_>>() {
            let ([x, y, z], direction) = (block.position(lane), block.going(lane));
            let from = [x, y, z + face.from_previous.origin[2]];
            match self.through(from, direction) {
                Ok((place, out)) => {
                    let way = dot([0, 1, 2].map(|k| place[k] - from[k]), direction);
                    block.path_mm[lane] += face.index_before * way;
                    block.put(lane, place, out);
                }
                Err(fate) => block.fate[lane] = code(face.index, loss(fate)),
            }
        }
    }

    /// Where a ray meets a facet, and where it goes from there.
    fn through(&self, from: Vector, direction: Vector) -> Result<(Vector, Vector), RayFate> {
        let in_depth = |[x, y, z]: Vector| [x, y, self.depth_per_z * z];
        let deeper = in_depth(direction)[2];
        // A line runs towards growing depth, whichever way its ray does.
        let line = Line::through(in_depth(from), in_depth(direction).map(|c| if deeper < 0.0 { -c } else { c }));
        let (place, out) = if deeper > 0.0 { self.plate.enter_facet(&line) } else { self.plate.leave_facet(&line) }?;
        let along = out.direction();
        let length = dot(along, along).sqrt().copysign(deeper);
        Ok((in_depth(place), in_depth(along.map(|c| c / length))))
    }
}

fn loss(fate: RayFate) -> u64 {
    match fate {
        RayFate::GrooveWall => WALL,
        RayFate::TotalInternalReflection => REFLECTED,
        _ => MISSED,
    }
}

impl Facets {
    /// Those of surface `index` of a prescription, if it has facets, at a wavelength.
    pub(crate) fn of(
        prescription: &Prescription,
        index: usize,
        catalogues: &[&Catalogue],
        wavelength_nm: f64,
    ) -> Result<Option<Self>, OpticsError> {
        let surface = &prescription.surfaces[index];
        let Shape::Facets { focal_length_mm, pitch_mm, draft_deg, design_wavelength_nm } = surface.shape else {
            return Ok(None);
        };
        let key = |name: &str| format!("surface[{index}].{name}");
        let before = index.checked_sub(1).map(|previous| &prescription.surfaces[previous]);
        let is_air = |medium: &str| medium.eq_ignore_ascii_case("air");
        let (grooves, medium, thickness_mm) = match before {
            _ if !is_air(&surface.medium) && before.is_none_or(|before| is_air(&before.medium)) => {
                (GrooveSide::Object, &surface.medium, surface.gap_mm)
            }
            Some(before) if is_air(&surface.medium) && !is_air(&before.medium) => {
                (GrooveSide::Image, &before.medium, before.gap_mm)
            }
            _ => {
                let legal = "glass on one side of facets and air on the other";
                return Err(ValueError::new(key("medium"), &surface.medium, legal).into());
            }
        };
        let round = surface.semi_diameter_mm.map(|radius_mm| [2.0 * radius_mm; 2]);
        let Some(size_mm) = surface.half_size_mm.map(|half_mm| half_mm.map(|mm| 2.0 * mm)).or(round) else {
            let legal = "a `semi_diameter_mm` or a `half_size_mm`, which tells how many facets there are";
            return Err(ValueError::new(key("semi_diameter_mm"), "missing", legal).into());
        };
        let glass = Glass::named(medium, &prescription.media, catalogues, &key("medium"))?;
        let indices = [glass.index(design_wavelength_nm)?, glass.index(wavelength_nm)?];
        let lens = FresnelLens {
            focal_length_mm,
            design_wavelength_nm,
            material: medium.clone(),
            thickness_mm,
            groove_pitch_mm: pitch_mm,
            draft_deg,
            grooves,
            size_mm,
        };
        let depth_per_z = if grooves == GrooveSide::Object { 1.0 } else { -1.0 };
        let plate = Plate::new(&lens, indices).map_err(|error| of_surface(error, index))?;
        Ok(Some(Self { plate, depth_per_z }))
    }
}

/// What is wrong with grooves, as values of the surface that has them.
fn of_surface(error: OpticsError, index: usize) -> OpticsError {
    let key = format!("surface[{index}].shape.pitch_mm");
    let wrong = match error {
        OpticsError::GrooveTooDeep { radius_mm, thickness_mm } => {
            let found = format!(
                "so wide that the groove {radius_mm} mm from the axis is deeper than the glass, {thickness_mm} mm"
            );
            ValueError::new(key, found, "thicker glass, fewer or finer grooves, a longer focal length")
        }
        OpticsError::TooManyGrooves { groove_pitch_mm, count } => {
            ValueError::new(key, format!("{groove_pitch_mm}, which makes {count} grooves"), "at most 200000 grooves")
        }
        other => return other,
    };
    wrong.into()
}
