//! What becomes of rays among surfaces.

/// How a ray through a [`Train`](crate::Train) ends. Surfaces count from 0, as in the prescription; the image is the
/// one behind the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// It met every surface.
    Arrived,
    /// It did not meet the sheet of the surface that holds its vertex.
    Missed {
        /// The surface.
        surface: usize,
    },
    /// It met the surface beyond its clear aperture.
    Vignetted {
        /// The surface.
        surface: usize,
    },
    /// It could not leave the denser medium.
    TotalInternalReflection {
        /// The surface.
        surface: usize,
    },
    /// It met a wall between the facets of a Fresnel lens, or was turned along them.
    GrooveWall {
        /// The surface.
        surface: usize,
    },
    /// It met a mask where that does not pass its band.
    Blocked {
        /// Index in the list of masks.
        mask: usize,
    },
}

/// A fate as a lane of a block holds it: 0 as long as the ray is on its way, else the kind, and above it the surface.
pub(crate) type Code = u64;

pub(crate) const MISSED: Code = 1;
pub(crate) const VIGNETTED: Code = 2;
pub(crate) const REFLECTED: Code = 3;
pub(crate) const BLOCKED: Code = 4;
pub(crate) const WALL: Code = 5;
const KIND_BITS: u32 = 3;

/// The code of a loss at a surface or mask.
pub(crate) fn code(index: usize, kind: Code) -> Code {
    ((index as Code) << KIND_BITS) | kind
}

impl Fate {
    pub(crate) fn of(code: Code) -> Self {
        let surface = (code >> KIND_BITS) as usize;
        match code & ((1 << KIND_BITS) - 1) {
            MISSED => Self::Missed { surface },
            VIGNETTED => Self::Vignetted { surface },
            REFLECTED => Self::TotalInternalReflection { surface },
            WALL => Self::GrooveWall { surface },
            BLOCKED => Self::Blocked { mask: surface },
            _ => Self::Arrived,
        }
    }
}

/// Number of rays by fate: launched = arrived + lost, always.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct FateLedger {
    /// Rays that were sent.
    pub launched: u64,
    /// Rays that met every surface.
    pub arrived: u64,
    /// Rays lost at each surface; a missing entry is none.
    pub surfaces: Vec<SurfaceLosses>,
    /// Rays stopped by each mask; a missing entry is none.
    pub blocked: Vec<u64>,
}

/// Rays lost at one surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SurfaceLosses {
    /// They did not meet it.
    pub missed: u64,
    /// They met it beyond its clear aperture.
    pub vignetted: u64,
    /// They could not leave the denser medium.
    pub total_internal_reflection: u64,
    /// They met a wall between facets.
    pub groove_wall: u64,
}

impl FateLedger {
    /// Enters one ray.
    pub fn record(&mut self, fate: Fate) {
        self.launched += 1;
        match fate {
            Fate::Arrived => self.arrived += 1,
            Fate::Missed { surface } => self.at(surface).missed += 1,
            Fate::Vignetted { surface } => self.at(surface).vignetted += 1,
            Fate::TotalInternalReflection { surface } => self.at(surface).total_internal_reflection += 1,
            Fate::GrooveWall { surface } => self.at(surface).groove_wall += 1,
            Fate::Blocked { mask } => *entry(&mut self.blocked, mask) += 1,
        }
    }

    /// Enters rays that all arrived.
    pub(crate) fn record_arrived(&mut self, count: u64) {
        self.launched += count;
        self.arrived += count;
    }

    /// Adds the rays of `other`.
    pub fn merge(mut self, other: &Self) -> Self {
        self.launched += other.launched;
        self.arrived += other.arrived;
        for (surface, losses) in other.surfaces.iter().enumerate() {
            let sum = self.at(surface);
            sum.missed += losses.missed;
            sum.vignetted += losses.vignetted;
            sum.total_internal_reflection += losses.total_internal_reflection;
            sum.groove_wall += losses.groove_wall;
        }
        for (mask, count) in other.blocked.iter().enumerate() {
            *entry(&mut self.blocked, mask) += count;
        }
        self
    }

    /// Sum over all fates, which is `launched`.
    pub fn total(&self) -> u64 {
        let lost = |losses: &SurfaceLosses| {
            losses.missed + losses.vignetted + losses.total_internal_reflection + losses.groove_wall
        };
        self.arrived + self.surfaces.iter().map(lost).sum::<u64>() + self.blocked.iter().sum::<u64>()
    }

    fn at(&mut self, surface: usize) -> &mut SurfaceLosses {
        entry(&mut self.surfaces, surface)
    }
}

/// The count at `index`, made on first use.
fn entry<T: Copy + Default>(counts: &mut Vec<T>, index: usize) -> &mut T {
    if counts.len() <= index {
        counts.resize(index + 1, T::default());
    }
    &mut counts[index]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fate_counts_once_and_merging_adds() {
        let fates = [
            Fate::Arrived,
            Fate::Missed { surface: 0 },
            Fate::Vignetted { surface: 3 },
            Fate::TotalInternalReflection { surface: 3 },
            Fate::GrooveWall { surface: 2 },
            Fate::Blocked { mask: 1 },
        ];
        let codes = [0, code(0, MISSED), code(3, VIGNETTED), code(3, REFLECTED), code(2, WALL), code(1, BLOCKED)];
        assert_eq!(codes.map(Fate::of), fates);
        let mut ledger = FateLedger::default();
        fates.into_iter().for_each(|fate| ledger.record(fate));
        assert_eq!((ledger.launched, ledger.total(), ledger.blocked.len()), (6, 6, 2));
        let sum = FateLedger::default().merge(&ledger).merge(&ledger);
        assert_eq!((sum.launched, sum.total(), sum.surfaces[3].vignetted), (12, 12, 2));
    }
}
