//! Shifts and turns of surfaces.

use crate::refraction::{Vector, dot};

/// Where a surface stands: `place = origin + turn · local`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rigid {
    /// Rows of the rotation.
    pub(crate) turn: [Vector; 3],
    /// mm.
    pub(crate) origin: Vector,
}

impl Rigid {
    pub(crate) const IDENTITY: Self =
        Self { turn: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], origin: [0.0; 3] };

    /// This place, then a shift along its own axes.
    pub(crate) fn shifted(self, by_mm: Vector) -> Self {
        let moved = apply(&self.turn, by_mm);
        Self { turn: self.turn, origin: [0, 1, 2].map(|k| self.origin[k] + moved[k]) }
    }

    /// This place, then turns by the right-hand rule about its own x, the new y and the new z, degrees.
    pub(crate) fn turned(self, tilt_deg: [f64; 3]) -> Self {
        let turn = (0..3).filter(|axis| tilt_deg[*axis] != 0.0).fold(self.turn, |turn, axis| {
            let (sin, cos) = tilt_deg[axis].to_radians().sin_cos();
            let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut about = Self::IDENTITY.turn;
            (about[j][j], about[j][k], about[k][j], about[k][k]) = (cos, -sin, sin, cos);
            [0, 1, 2].map(|row| [0, 1, 2].map(|column| dot(turn[row], about.map(|r| r[column]))))
        });
        Self { turn, origin: self.origin }
    }

    /// How places measured from `other` are measured from here.
    pub(crate) fn from(&self, other: &Self) -> Self {
        if self.turn == other.turn && self.turn == Self::IDENTITY.turn {
            return Self { turn: self.turn, origin: [0, 1, 2].map(|k| other.origin[k] - self.origin[k]) };
        }
        let back = transposed(&self.turn);
        let turn = [0, 1, 2].map(|row| [0, 1, 2].map(|column| dot(back[row], other.turn.map(|r| r[column]))));
        let turn = if self.turn == other.turn { Self::IDENTITY.turn } else { turn };
        Self { turn, origin: apply(&back, [0, 1, 2].map(|k| other.origin[k] - self.origin[k])) }
    }
}

#[inline(always)]
pub(crate) fn apply(turn: &[Vector; 3], v: Vector) -> Vector {
    [dot(turn[0], v), dot(turn[1], v), dot(turn[2], v)]
}

fn transposed(turn: &[Vector; 3]) -> [Vector; 3] {
    [0, 1, 2].map(|k| turn.map(|row| row[k]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_follows_the_right_hand_and_is_undone() {
        let place = Rigid::IDENTITY.shifted([1.0, 2.0, 3.0]).turned([90.0, 0.0, 0.0]);
        // Its z now points along −y.
        let there = place.shifted([0.0, 0.0, 5.0]);
        for (found, expected) in there.origin.into_iter().zip([1.0, -3.0, 3.0]) {
            assert!((found - expected).abs() < 1e-14);
        }
        let tilted = place.turned([10.0, -20.0, 35.0]);
        let back = Rigid::IDENTITY.from(&tilted);
        let again = tilted.from(&Rigid::IDENTITY);
        for v in [[1.0, 0.0, 0.0], [0.3, -2.0, 7.0]] {
            let out = [0, 1, 2].map(|k| apply(&back.turn, v)[k] + back.origin[k]);
            let home = [0, 1, 2].map(|k| apply(&again.turn, out)[k] + again.origin[k]);
            for k in 0..3 {
                assert!((home[k] - v[k]).abs() < 1e-13);
            }
        }
    }
}
