//! Rays through a prescription, surface by surface.
//!
//! Light runs along +z, as in the [`Prescription`]; a ray is stated where it meets a surface, in that surface's axes. A
//! train is made for one wavelength, and reversed for light that runs back. Rays are followed in blocks
//! that stay in the first-level cache from the first surface to the last. No sum depends on the number of threads.

mod aim;
mod asphere;
mod face;
mod facets;
mod fate;
mod first_order;
mod kernel;
mod outline;
mod rays;
mod rigid;
mod seidel;

use rayon::prelude::*;
use twinpupil_instrument::{Annulus, Catalogue, Glass, Prescription, Shape};

pub use aim::Field;
pub use fate::{Fate, FateLedger, SurfaceLosses};
pub use first_order::{FirstOrder, Pupil};
pub use rays::{Ray, Rays};
pub use seidel::{ChromaticSums, SeidelSums};

use crate::OpticsError;
pub(crate) use aim::{Aiming, DIFFERENCE, Seeker, aimed};
pub(crate) use face::Profile as SurfaceProfile;
use face::{Action, Clear, Face, Profile, Rings};
use facets::Facets;
pub(crate) use rays::{Block, LANES};
use rigid::Rigid;

/// A lens at one wavelength, ready to be traced: its surfaces and the image.
#[derive(Debug, Clone, PartialEq)]
pub struct Train {
    faces: Vec<Face>,
}

/// A flat mask across the axis of a lens: the rings that pass a band.
#[derive(Debug, Clone, PartialEq)]
pub struct Mask {
    /// The surface from which its place is measured.
    pub surface: usize,
    /// Distance behind that surface's vertex, mm; in front of it if negative.
    pub behind_mm: f64,
    /// Centre from the axis, mm.
    pub centre_mm: [f64; 2],
    /// The rings that pass, about the centre.
    pub rings: Vec<Annulus>,
}

/// Blocks that a thread takes at a time.
const BLOCKS_AT_A_TIME: usize = 32;

impl Train {
    /// The lens at a wavelength. Materials are those of the prescription, then of `catalogues` in their order, then the
    /// built-in ones.
    pub fn new(
        prescription: &Prescription,
        catalogues: &[&Catalogue],
        wavelength_nm: f64,
    ) -> Result<Self, OpticsError> {
        let mut faces = Vec::with_capacity(prescription.surfaces.len() + 1);
        let (mut axis, mut index) = (Rigid::IDENTITY, 1.0);
        for (i, surface) in prescription.surfaces.iter().enumerate() {
            let [x_mm, y_mm] = surface.decentre_mm;
            let place = axis.shifted([x_mm, y_mm, 0.0]).turned(surface.tilt_deg);
            if surface.shape == Shape::Break {
                axis = place;
            } else {
                let index_before = index;
                if !surface.mirror {
                    let key = format!("surface[{i}].medium");
                    index =
                        Glass::named(&surface.medium, &prescription.media, catalogues, &key)?.index(wavelength_nm)?;
                }
                faces.push(Face {
                    index: i,
                    profile: match Facets::of(prescription, i, catalogues, wavelength_nm)? {
                        Some(facets) => Profile::Facets(facets.into()),
                        None => Profile::of(&surface.shape),
                    },
                    action: action(&surface.shape, surface.mirror, index_before, index),
                    index_before,
                    index_behind: index,
                    clear: Clear::of(surface),
                    axis,
                    place,
                    from_previous: Rigid::IDENTITY,
                    is_first: false,
                });
            }
            axis = axis.shifted([0.0, 0.0, surface.gap_mm]);
        }
        faces.push(Face {
            index: prescription.surfaces.len(),
            profile: Profile::of(&prescription.image),
            action: Action::Pass,
            index_before: index,
            index_behind: index,
            clear: Clear::EVERYWHERE,
            axis,
            place: axis,
            from_previous: Rigid::IDENTITY,
            is_first: false,
        });
        Ok(Self { faces: linked(faces) })
    }

    /// The same lens with a mask in its light, `number` in the list of masks.
    pub fn with_mask(mut self, number: usize, mask: &Mask) -> Self {
        let is_surface = |face: &Face| face.clear.rings.is_none() && face.index == mask.surface;
        let at = self.faces.iter().position(is_surface).unwrap_or(self.faces.len() - 1);
        let reference = &self.faces[at];
        let (axis, in_front) = (reference.axis.shifted([0.0, 0.0, mask.behind_mm]), mask.behind_mm < 0.0);
        let index = if in_front { reference.index_before } else { reference.index_behind };
        let rings = Rings { centre_mm: mask.centre_mm, rings: mask.rings.clone() };
        let face = Face::mask(number, axis, index, rings);
        self.faces.insert(if in_front { at } else { at + 1 }, face);
        Self { faces: linked(self.faces) }
    }

    /// The same lens, whose rays from the image end in the plane z = `depth_mm` of the axes of the lens, wherever that is.
    /// As a mask it is `number`.
    pub(crate) fn with_end_plane(mut self, number: usize, depth_mm: f64) -> Self {
        let axis = Rigid::IDENTITY.shifted([0.0, 0.0, depth_mm]);
        self.faces.insert(0, Face::mask(number, axis, 1.0, Rings::everywhere()));
        Self { faces: linked(self.faces) }
    }

    /// The surfaces as far as a mask of that number, clear everywhere.
    pub(crate) fn clear_to_mask(&self, number: usize) -> Self {
        let is_mask = |face: &Face| face.clear.rings.is_some() && face.index == number;
        let count = self.faces.iter().position(is_mask).map_or(self.faces.len(), |at| at + 1);
        let faces = self.faces[..count].iter().map(|face| Face { clear: Clear::EVERYWHERE, ..face.clone() });
        Self { faces: linked(faces.collect()) }
    }

    /// The numbers of its masks, in the order in which light meets them.
    pub(crate) fn masks(&self) -> impl Iterator<Item = usize> {
        self.faces.iter().filter(|face| face.clear.rings.is_some()).map(|face| face.index)
    }

    /// Whether what it does to rays changes smoothly from one to the next, wherever it lets all pass about them.
    pub(crate) fn is_smooth(&self) -> bool {
        let is_broken = |face: &Face| matches!(face.profile, Profile::Facets(_)) || face.clear.squares_mm2[0] > 0.0;
        !self.faces.iter().any(is_broken)
    }

    /// The same with grooves of Fresnel lenses that are infinitely fine.
    pub(crate) fn smoothed(self) -> Self {
        let smoothed = |face: Face| match &face.profile {
            Profile::Facets(facets) => {
                let profile = Profile::Facets(Facets::clone(facets).smoothed().into());
                Face { profile, ..face }
            }
            _ => face,
        };
        Self { faces: self.faces.into_iter().map(smoothed).collect() }
    }

    /// The same surfaces, clear everywhere.
    pub(crate) fn clear(&self) -> Self {
        let faces = self.faces.iter().map(|face| Face { clear: Clear::EVERYWHERE, ..face.clone() });
        Self { faces: linked(faces.collect()) }
    }

    /// The surfaces behind the first `count`, for rays that are stated in the axes of the last of those.
    pub(crate) fn behind(&self, count: usize) -> Self {
        let (before, behind) = self.faces.split_at(count);
        let start = before.last().map(|last| Face {
            place: last.place,
            clear: Clear::EVERYWHERE,
            ..Face::mask(0, last.axis, last.index_behind, Rings::everywhere())
        });
        Self { faces: linked(start.into_iter().chain(behind.iter().cloned()).collect()) }
    }

    /// The plane from which rays before the lens are counted, and nothing else.
    pub(crate) fn plane_in_front(&self) -> Self {
        let place = self.faces[0].place;
        let plane = Face { place, ..Face::mask(0, place, self.faces[0].index_before, Rings::everywhere()) };
        Self { faces: linked(vec![plane]) }
    }

    /// How far behind the first vertex of the lens the first face stands, from whose plane rays are counted.
    pub(crate) fn first_depth_mm(&self) -> f64 {
        self.faces[0].axis.origin[2]
    }

    /// Whether one of its surfaces is an ideal lens.
    pub(crate) fn has_ideal_lens(&self) -> bool {
        self.faces.iter().any(|face| matches!(face.action, Action::ThinLens { .. }))
    }

    /// Refractive index before the image.
    pub(crate) fn index_before_image(&self) -> f64 {
        self.faces.last().map_or(1.0, |image| image.index_before)
    }

    /// Sends a block of rays through all surfaces.
    #[inline]
    pub(crate) fn send(&self, block: &mut Block) {
        kernel::trace(&self.faces, block);
    }

    /// For light that runs from the image back to the first surface. Axes stay as they are, so directions have negative z.
    pub fn reversed(&self) -> Self {
        let faces = self.faces.iter().rev().map(|face| Face {
            action: match face.action {
                Action::Refract { index_ratio } => Action::Refract { index_ratio: 1.0 / index_ratio },
                same => same,
            },
            index_before: face.index_behind,
            index_behind: face.index_before,
            ..face.clone()
        });
        Self { faces: linked(faces.collect()) }
    }

    /// Number of surfaces met, masks and image included.
    pub fn len(&self) -> usize {
        self.faces.len()
    }

    /// Whether there are no surfaces.
    pub fn is_empty(&self) -> bool {
        self.faces.is_empty()
    }

    /// Sends rays, stated in the axes of the first surface, through all surfaces; they end in the axes of the last.
    pub fn trace(&self, rays: &mut Rays) -> FateLedger {
        let mut ledger = FateLedger::default();
        for at in 0..rays.blocks.len() {
            let count = rays.in_block(at);
            self.follow(&mut rays.blocks[at], count, &mut ledger);
        }
        ledger
    }

    /// [`Self::trace`] on all threads of the pool, with the same result.
    pub fn trace_parallel(&self, rays: &mut Rays) -> FateLedger {
        let len = rays.len();
        let ledgers = rays.blocks.par_chunks_mut(BLOCKS_AT_A_TIME).enumerate().map(|(chunk, blocks)| {
            let mut ledger = FateLedger::default();
            for (k, block) in (chunk * BLOCKS_AT_A_TIME..).zip(blocks) {
                self.follow(block, LANES.min(len - k * LANES), &mut ledger);
            }
            ledger
        });
        ledgers.reduce(FateLedger::default, |sum, ledger| sum.merge(&ledger))
    }

    /// Where a ray meets each surface, as far as it comes, and how it ends.
    pub fn path(&self, ray: &Ray) -> (Vec<Ray>, Fate) {
        let mut block = Block::ON_AXIS;
        block.set(0, ray);
        let mut met = Vec::with_capacity(self.faces.len());
        for face in &self.faces {
            kernel::trace(std::slice::from_ref(face), &mut block);
            if !matches!(Fate::of(block.fate[0]), Fate::Arrived | Fate::TotalInternalReflection { .. }) {
                break;
            }
            met.push(block.ray(0));
            if block.fate[0] != 0 {
                break;
            }
        }
        (met, Fate::of(block.fate[0]))
    }

    /// The surfaces of the lens, without masks and image.
    fn lens_faces(&self) -> impl Iterator<Item = &Face> {
        let image = self.faces.iter().map(|face| face.index).max().unwrap_or(0);
        self.faces.iter().filter(move |face| face.clear.rings.is_none() && face.index < image)
    }

    fn follow(&self, block: &mut Block, count: usize, ledger: &mut FateLedger) {
        kernel::trace(&self.faces, block);
        block.settle(count, ledger);
    }
}

/// With the way from each face to the next.
fn linked(mut faces: Vec<Face>) -> Vec<Face> {
    for k in 0..faces.len() {
        faces[k].is_first = k == 0;
        faces[k].from_previous = match k.checked_sub(1) {
            Some(previous) => faces[k].place.from(&faces[previous].place),
            None => Rigid::IDENTITY,
        };
    }
    faces
}

/// What a surface does to rays.
fn action(shape: &Shape, is_mirror: bool, index_before: f64, index_behind: f64) -> Action {
    match shape {
        Shape::ThinLens { focal_length_mm } => {
            Action::ThinLens { power_per_mm: 1.0 / (index_behind * focal_length_mm) }
        }
        _ if is_mirror => Action::Reflect,
        _ if index_before == index_behind => Action::Pass,
        _ => Action::Refract { index_ratio: index_before / index_behind },
    }
}
