//! What became of every ray.

/// How a ray ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RayFate {
    /// It left the camera towards the object.
    Arrived,
    /// It met an aperture where that does not pass its band.
    Blocked {
        /// Index in the instrument's list of apertures.
        aperture: usize,
    },
    /// It passed beside the lens.
    MissedLens,
    /// It met the riser between two grooves of a Fresnel lens, or was shaded by it.
    GrooveWall,
    /// It could not leave the glass.
    TotalInternalReflection,
}

/// Number of rays by fate; `launched` is the sum of all others.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RayLedger {
    /// Rays that left the sensor.
    pub launched: u64,
    /// Rays that reached object space.
    pub arrived: u64,
    /// Rays stopped by each of the instrument's apertures; a missing entry is zero.
    pub blocked: Vec<u64>,
    /// Rays that passed beside the lens.
    pub missed_lens: u64,
    /// Rays that met the riser of a groove.
    pub groove_wall: u64,
    /// Rays that could not leave the glass.
    pub total_internal_reflection: u64,
}

impl RayLedger {
    /// Enters one ray.
    pub fn record(&mut self, fate: RayFate) {
        self.launched += 1;
        self.settle(fate);
    }

    /// Enters the fate of a ray that has been launched already.
    pub(crate) fn settle(&mut self, fate: RayFate) {
        match fate {
            RayFate::Arrived => self.arrived += 1,
            RayFate::Blocked { aperture } => *self.blocked_by(aperture) += 1,
            RayFate::MissedLens => self.missed_lens += 1,
            RayFate::GrooveWall => self.groove_wall += 1,
            RayFate::TotalInternalReflection => self.total_internal_reflection += 1,
        }
    }

    /// Adds the rays of `other`.
    pub fn merge(&mut self, other: &Self) {
        self.launched += other.launched;
        self.arrived += other.arrived;
        for (aperture, count) in other.blocked.iter().enumerate() {
            *self.blocked_by(aperture) += count;
        }
        self.missed_lens += other.missed_lens;
        self.groove_wall += other.groove_wall;
        self.total_internal_reflection += other.total_internal_reflection;
    }

    /// Sum over all fates, which is `launched`.
    pub fn total(&self) -> u64 {
        let lost = self.missed_lens + self.groove_wall + self.total_internal_reflection;
        self.arrived + self.blocked.iter().sum::<u64>() + lost
    }

    /// Count of one aperture, made on first use.
    pub(crate) fn blocked_by(&mut self, aperture: usize) -> &mut u64 {
        if self.blocked.len() <= aperture {
            self.blocked.resize(aperture + 1, 0);
        }
        &mut self.blocked[aperture]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fate_counts_once_and_merging_adds() {
        let fates = [
            RayFate::Arrived,
            RayFate::Blocked { aperture: 2 },
            RayFate::MissedLens,
            RayFate::GrooveWall,
            RayFate::TotalInternalReflection,
        ];
        let mut ledger = RayLedger::default();
        fates.into_iter().for_each(|fate| ledger.record(fate));
        assert_eq!((ledger.launched, ledger.total()), (5, 5));
        assert_eq!(ledger.blocked, [0, 0, 1]);
        let mut sum = RayLedger::default();
        sum.merge(&ledger);
        sum.merge(&ledger);
        assert_eq!((sum.launched, sum.total(), sum.blocked[2]), (10, 10, 2));
    }
}
