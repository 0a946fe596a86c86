//! The grooves of a Fresnel lens among other surfaces: facets and walls, ray by ray.

use twinpupil_instrument::{FresnelLens, Glass, GrooveSide};

use super::face::{Action, Clear, Face, Profile};
use super::fate::{MISSED, REFLECTED, WALL, code};
use super::rays::{Block, LANES};
use super::rigid::Rigid;
use super::{Train, linked};
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
        let (place, out) =
            if deeper > 0.0 { self.plate.into_grooves(&line) } else { self.plate.out_of_grooves(&line) }?;
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

impl Train {
    /// A Fresnel lens with the facets and walls that the camera's model `fresnel` has, and a flat image at a distance behind its
    /// last face. Rays are counted from its first face, where the object is.
    pub fn fresnel(lens: &FresnelLens, wavelength_nm: f64, image_behind_mm: f64) -> Result<Self, OpticsError> {
        let index = Glass::built_in(&lens.material, "lens.material")?.index(wavelength_nm)?;
        let plate = Plate::new(lens, index)?;
        let facets = |depth_per_z: f64| Profile::Facets(Facets { plate: plate.clone(), depth_per_z }.into());
        let profiles = match lens.grooves {
            GrooveSide::Object => [facets(1.0), Profile::Plane, Profile::Plane],
            GrooveSide::Image => [Profile::Plane, facets(-1.0), Profile::Plane],
        };
        let indices = [1.0, index, 1.0, 1.0];
        let depths_mm = [0.0, lens.thickness_mm, lens.thickness_mm + image_behind_mm];
        let half_size_mm = Some(plate.half_size_mm);
        let face = |(k, profile): (usize, Profile)| {
            let place = Rigid::IDENTITY.shifted([0.0, 0.0, depths_mm[k]]);
            let is_image = k == 2;
            Face {
                index: k,
                profile,
                action: if is_image {
                    Action::Pass
                } else {
                    Action::Refract { index_ratio: indices[k] / indices[k + 1] }
                },
                index_before: indices[k],
                index_behind: indices[k + 1],
                clear: if is_image { Clear::EVERYWHERE } else { Clear { half_size_mm, ..Clear::EVERYWHERE } },
                axis: place,
                place,
                from_previous: Rigid::IDENTITY,
                is_first: false,
            }
        };
        Ok(Self { faces: linked(profiles.into_iter().enumerate().map(face).collect()) })
    }
}
