//! Rays side by side.

use super::fate::{Code, Fate, FateLedger};
use crate::refraction::Vector;

/// Rays that are followed together through all surfaces: their few numbers stay in the first-level cache.
pub(crate) const LANES: usize = 128;

/// A ray where it meets a surface, in that surface's own axes: origin at the vertex, z along the light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it is, mm.
    pub position_mm: [f64; 3],
    /// Where it goes, of unit length.
    pub direction: [f64; 3],
    /// Optical path length so far, mm.
    pub path_mm: f64,
}

impl Ray {
    /// A ray through a point in a direction of any length.
    pub fn new(position_mm: [f64; 3], direction: [f64; 3]) -> Self {
        let length = direction.map(|component| component * component).iter().sum::<f64>().sqrt();
        Self { position_mm, direction: direction.map(|component| component / length), path_mm: 0.0 }
    }
}

/// Many rays, as blocks of arrays: the layout that vectorises.
#[derive(Debug, PartialEq, Default)]
pub struct Rays {
    pub(crate) blocks: Vec<Block>,
    len: usize,
}

/// The rays of one block, component by component.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
pub(crate) struct Block {
    pub(crate) position_mm: [[f64; LANES]; 3],
    pub(crate) direction: [[f64; LANES]; 3],
    pub(crate) path_mm: [f64; LANES],
    pub(crate) fate: [Code; LANES],
    /// Lanes that need not be followed: no ray is in them.
    idle: usize,
}

/// Lanes are followed in pairs of vectors.
const FOLLOWED_TOGETHER: usize = 8;

impl Block {
    /// Rays along the axis.
    pub(crate) const ON_AXIS: Self = Self {
        position_mm: [[0.0; LANES]; 3],
        direction: [[0.0; LANES], [0.0; LANES], [1.0; LANES]],
        path_mm: [0.0; LANES],
        fate: [0; LANES],
        idle: 0,
    };

    /// Rays along the axis, of which the first `count` are followed.
    pub(crate) fn of(count: usize) -> Self {
        Self { idle: LANES - count.next_multiple_of(FOLLOWED_TOGETHER).min(LANES), ..Self::ON_AXIS }
    }

    /// Lanes that are followed.
    #[inline(always)]
    pub(crate) fn lanes(&self) -> usize {
        LANES - self.idle.min(LANES)
    }

    pub(crate) fn ray(&self, lane: usize) -> Ray {
        Ray {
            position_mm: [0, 1, 2].map(|k| self.position_mm[k][lane]),
            direction: [0, 1, 2].map(|k| self.direction[k][lane]),
            path_mm: self.path_mm[lane],
        }
    }

    pub(crate) fn set(&mut self, lane: usize, ray: &Ray) {
        for k in 0..3 {
            self.position_mm[k][lane] = ray.position_mm[k];
            self.direction[k][lane] = ray.direction[k];
        }
        self.path_mm[lane] = ray.path_mm;
        self.fate[lane] = 0;
    }

    /// How the ray of a lane has ended.
    pub(crate) fn ended(&self, lane: usize) -> Fate {
        Fate::of(self.fate[lane])
    }

    /// Whether the first `count` rays have arrived.
    pub(crate) fn all_arrived(&self, count: usize) -> bool {
        self.fate[..count].iter().fold(0, |any, code| any | code) == 0
    }

    /// Enters the fates of the first `count` rays.
    pub(crate) fn settle(&self, count: usize, ledger: &mut FateLedger) {
        if self.all_arrived(count) {
            ledger.record_arrived(count as u64);
        } else {
            self.fate[..count].iter().for_each(|code| ledger.record(Fate::of(*code)));
        }
    }

    #[inline(always)]
    pub(crate) fn put(&mut self, lane: usize, position: Vector, direction: Vector) {
        let ([x, y, z], [dx, dy, dz]) = (&mut self.position_mm, &mut self.direction);
        (x[lane], y[lane], z[lane]) = (position[0], position[1], position[2]);
        (dx[lane], dy[lane], dz[lane]) = (direction[0], direction[1], direction[2]);
    }

    #[inline(always)]
    pub(crate) fn position(&self, lane: usize) -> Vector {
        [self.position_mm[0][lane], self.position_mm[1][lane], self.position_mm[2][lane]]
    }

    #[inline(always)]
    pub(crate) fn going(&self, lane: usize) -> Vector {
        [self.direction[0][lane], self.direction[1][lane], self.direction[2][lane]]
    }
}

impl Rays {
    /// Number of rays.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are no rays.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The ray at `index`, below the number of rays; of one that was lost, position and direction mean nothing.
    pub fn ray(&self, index: usize) -> Ray {
        self.blocks[index / LANES].ray(index % LANES)
    }

    /// Puts a ray on its way at `index`, below the number of rays.
    pub fn set(&mut self, index: usize, ray: &Ray) {
        self.blocks[index / LANES].set(index % LANES, ray);
    }

    /// How the ray at `index`, below the number of rays, has ended.
    pub fn fate(&self, index: usize) -> Fate {
        Fate::of(self.blocks[index / LANES].fate[index % LANES])
    }

    /// Adds a ray.
    pub fn push(&mut self, ray: &Ray) {
        if self.len.is_multiple_of(LANES) {
            self.blocks.push(Block::ON_AXIS);
        }
        self.len += 1;
        self.set(self.len - 1, ray);
    }

    /// All of them, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (Ray, Fate)> {
        (0..self.len).map(|index| (self.ray(index), self.fate(index)))
    }

    /// Number of rays in the block at `index`.
    pub(crate) fn in_block(&self, index: usize) -> usize {
        LANES.min(self.len - index * LANES)
    }
}

impl Clone for Rays {
    fn clone(&self) -> Self {
        Self { blocks: self.blocks.clone(), len: self.len }
    }

    /// Allocates only beyond the largest number of rays so far.
    fn clone_from(&mut self, other: &Self) {
        self.blocks.clear();
        self.blocks.extend_from_slice(&other.blocks);
        self.len = other.len;
    }
}

impl FromIterator<Ray> for Rays {
    fn from_iter<I: IntoIterator<Item = Ray>>(rays: I) -> Self {
        let mut all = Self::default();
        rays.into_iter().for_each(|ray| all.push(&ray));
        all
    }
}
