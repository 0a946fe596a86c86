//! The part of a dot's edge that masks take from a pencil.
//!
//! The light of a pencil changes with the dot as its edge moves across the pupil,
//!
//! ```text
//! ∂L/∂c = (1/π b) ∫ n ds        ∂L/∂R = (1/π b) ∫ ds        ∂L/∂b = −(1/π b) ∫ w·n ds
//! ```
//!
//! over the arc s of the edge, with its normal n, that lies in the pupil and is open. The edge is taken as its circle of
//! curvature where it is nearest to the sample, at x from the middle of the pupil:
//!
//! ```text
//! w = (x − ρ (1 − cos θ), ρ sin θ)        |θ| ≤ h        sin²(h/2) = (1 − x²)/(4 ρ (ρ − x))
//! ```

use crate::likelihood::chords::{Circles, Edges, LANES, Lanes, lanes};

/// What masks take from an edge, over its length without them: from the integrals above.
#[derive(Default)]
pub(crate) struct Taken {
    /// Of n, across the edge where it is nearest and along it.
    pub(crate) across: Lanes,
    pub(crate) along: Lanes,
    pub(crate) length: Lanes,
    /// Of w·n.
    pub(crate) blur: Lanes,
}

/// Pieces of the arc on either side of its middle.
const PIECES: usize = 4;

/// Edges are this near to the middle of the pupil, and this much bent, at least.
const FARTHEST: f32 = 0.99;
const STRAIGHTEST: f32 = 1e-3;

/// What the masks take from the edges, light being outside the shut circles and inside the rims.
#[inline(always)]
pub(crate) fn taken(edges: &Edges, shuts: &[Circles], rims: &[Circles]) -> Taken {
    const PIECE: f32 = 0.5 / PIECES as f32;
    let x = lanes(|lane| (edges.straight_px[lane] / edges.blur_px[lane]).clamp(-FARTHEST, FARTHEST));
    let rho = lanes(|lane| {
        let bend = edges.curvature[lane] * edges.blur_px[lane];
        1.0 / bend.abs().max(STRAIGHTEST).copysign(bend)
    });
    // Halved three times, h is half a piece. All of an edge lies in the pupil that bends around before its middle.
    let half2 = lanes(|lane| {
        let bound = 4.0 * rho[lane] * (rho[lane] - x[lane]);
        if bound > 0.0 { ((1.0 - x[lane] * x[lane]) / bound).min(1.0) } else { 1.0 }
    });
    let half2 = halved(&half2);
    let sin = lanes(|lane| half2[lane].sqrt());
    let cos = lanes(|lane| (1.0 - half2[lane]).sqrt());
    let half2 = halved(&half2);
    let mut at = [lanes(|lane| half2[lane].sqrt()), lanes(|lane| (1.0 - half2[lane]).sqrt())];
    let per_piece = lanes(|lane| 0.5 / (rho[lane] * at[0][lane]).abs().max(1e-6));
    let mut taken = Taken::default();
    for _ in 0..PIECES {
        let [sin_at, cos_at] = at;
        let depth = lanes(|lane| rho[lane] * (1.0 - cos_at[lane]));
        for side in [-1.0, 1.0] {
            let place = [lanes(|lane| x[lane] - depth[lane]), lanes(|lane| side * rho[lane] * sin_at[lane])];
            let mut share = [1.0; LANES];
            for rim in rims {
                rim.pass(&place, &per_piece, 1.0, &mut share);
            }
            for shut in shuts {
                shut.pass(&place, &per_piece, -1.0, &mut share);
            }
            for lane in 0..LANES {
                let (sin, cos) = (side * sin_at[lane], cos_at[lane]);
                let blur = x[lane].mul_add(cos, depth[lane]);
                let piece = PIECE * (1.0 - share[lane]);
                taken.across[lane] = piece.mul_add(cos, taken.across[lane]);
                taken.along[lane] = piece.mul_add(sin, taken.along[lane]);
                taken.length[lane] += piece;
                taken.blur[lane] = piece.mul_add(blur, taken.blur[lane]);
            }
        }
        for lane in 0..LANES {
            at[0][lane] = sin_at[lane].mul_add(cos[lane], cos_at[lane] * sin[lane]);
            at[1][lane] = cos_at[lane].mul_add(cos[lane], -sin_at[lane] * sin[lane]);
        }
    }
    taken
}

/// sin²(a/2) of sin² a.
#[inline(always)]
fn halved(sin2: &Lanes) -> Lanes {
    lanes(|lane| sin2[lane] / (2.0 + 2.0 * (1.0 - sin2[lane]).sqrt()))
}

impl Circles {
    /// Takes from the shares of pieces about these places what lies outside (1) or inside (−1) of the circles.
    #[inline(always)]
    fn pass(&self, [x, y]: &[Lanes; 2], per_piece: &Lanes, inside: f32, share: &mut Lanes) {
        for lane in 0..LANES {
            let (dx, dy) = (x[lane] - self.x[lane], y[lane] - self.y[lane]);
            let within = self.radius - dx.mul_add(dx, dy * dy).sqrt();
            share[lane] *= (inside * within).mul_add(per_piece[lane], 0.5).clamp(0.0, 1.0);
        }
    }
}
