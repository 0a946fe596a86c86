//! The outline of a spot, and how far from it its edge is felt.

use crate::likelihood::pencil::length;
use crate::likelihood::spot::{Matrix2, PIXEL_REACH_PX, Spot};

/// An ellipse about a spot's outline: pixels well within it see nothing but the dot, those well beyond it none of it.
///
/// The outline is the image of the unit circle under A. A pencil's disc that reaches ρ px from a pixel at p reaches
/// `ρ/a` from `A⁻¹ p` at most, with the shorter half axis a; so `1 ∓ ρ/a` are sizes of the outline between which all
/// pixels lie that feel its edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Outline {
    pub(crate) centre_px: [f64; 2],
    /// A, px, and its inverse.
    axes_px: Matrix2,
    per_px: Matrix2,
    shorter_px: f64,
    reach_px: f64,
}

/// One of the two sizes between which the edge is felt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    Inner,
    Outer,
}

/// A side of the edge as rows cross it: at v below the centre it lies about `−lean v`, `√(size² − narrowing v²)` wide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Curve {
    pub(crate) lean: f64,
    pub(crate) size2: f64,
    pub(crate) narrowing: f64,
}

impl Outline {
    /// Of a spot, none of whose ways through the masks matters.
    pub(crate) fn of(spot: &Spot) -> Self {
        let [[a, b], [c, d]] = spot.inverse;
        let scale = |matrix: Matrix2, by: f64| matrix.map(|row| row.map(|value| by * value));
        // The longer half axis of the inverse is one over the shorter of the outline.
        let (squares, product) = (a * a + b * b + c * c + d * d, (a * d - b * c).abs());
        let steepest = 0.5 * ((squares + 2.0 * product).sqrt() + (squares - 2.0 * product).max(0.0).sqrt());
        Self {
            centre_px: spot.centre_px,
            axes_px: scale(spot.shape, spot.radius_px),
            per_px: scale(spot.inverse, 1.0 / spot.radius_px),
            shorter_px: spot.radius_px / steepest.max(1e-12),
            reach_px: spot.blur_reach_px() * (1.0 + length(spot.blur_gradient())) + PIXEL_REACH_PX,
        }
    }

    /// How far from it its edge is felt, px.
    pub(crate) fn reach_px(&self) -> f64 {
        self.reach_px
    }

    /// The same with an edge that is felt farther.
    pub(crate) fn widened(self, by_px: f64) -> Self {
        Self { reach_px: self.reach_px + by_px, ..self }
    }

    /// Size at a side of the edge, in units of the outline; 0 where nothing lies within.
    fn size(&self, side: Side) -> f64 {
        match side {
            Side::Inner => (1.0 - self.reach_px / self.shorter_px).max(0.0),
            Side::Outer => 1.0 + self.reach_px / self.shorter_px,
        }
    }

    /// Area between the two sides of the edge, px².
    pub(crate) fn edge_px2(&self) -> f64 {
        let [[a, b], [c, d]] = self.axes_px;
        let [inner, outer] = [Side::Inner, Side::Outer].map(|side| self.size(side));
        std::f64::consts::PI * (outer * outer - inner * inner) * (a * d - b * c).abs()
    }

    /// A side of the edge, ready to be crossed by rows.
    pub(crate) fn curve(&self, side: Side) -> Curve {
        let [[a, b], [c, d]] = self.per_px;
        let size = self.size(side);
        let per_square = 1.0 / (a * a + c * c);
        let lean = (a * b + c * d) * per_square;
        Curve { lean, size2: size * size * per_square, narrowing: (b * b + d * d) * per_square - lean * lean }
    }

    /// Whether every pixel that feels the edge of `later` lies where the edge of this one is felt.
    ///
    /// Seen from the unit disc of `later`, this one's is `B e + m`, `B = A′⁻¹A`, whose points lie no farther out than the
    /// longer half axis of B and the length of m allow, and no nearer than the shorter one does.
    pub(crate) fn holds(&self, later: &Self) -> bool {
        let [[a, b], [c, d]] = product(&later.per_px, &self.axes_px);
        let moved = [0, 1].map(|axis| self.centre_px[axis] - later.centre_px[axis]);
        let moved = later.per_px.map(|[x, y]| x * moved[0] + y * moved[1]);
        let moved = length(moved);
        let (squares, area) = (a * a + b * b + c * c + d * d, (a * d - b * c).abs());
        let (sum, difference) = ((squares + 2.0 * area).sqrt(), (squares - 2.0 * area).max(0.0).sqrt());
        let (longer, shorter) = (0.5 * (sum + difference), 0.5 * (sum - difference));
        let inner = self.size(Side::Inner);
        let is_full = inner == 0.0 || inner * longer + moved <= later.size(Side::Inner);
        is_full && self.size(Side::Outer) * shorter - moved >= later.size(Side::Outer)
    }
}

impl Curve {
    /// A circle about the centre.
    pub(crate) fn circle(radius_px: f64) -> Self {
        Self { lean: 0.0, size2: radius_px * radius_px, narrowing: 1.0 }
    }
}

fn product(m: &Matrix2, n: &Matrix2) -> Matrix2 {
    m.map(|[x, y]| [x * n[0][0] + y * n[1][0], x * n[0][1] + y * n[1][1]])
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;
    use crate::likelihood::light::{Light, Places};
    use crate::likelihood::pencil::Pencil;
    use crate::likelihood::profile::Profiles;
    use crate::likelihood::spot::{Dot, Raster};

    fn spot(z_mm: f64, slopes: [f64; 2]) -> Spot {
        let instrument = paper::instrument();
        let pencil = Pencil::of_band(&instrument, &instrument.bands[1], 100.0);
        let raster = Raster { axis_px: [959.5, 599.5], pitch_mm: 0.00586 };
        Spot::of(&Dot { centre_mm: [4.0, -3.0, z_mm], diameter_mm: 1.0, slopes }, &pencil, raster, None)
    }

    #[test]
    fn the_edge_is_felt_between_its_sides_alone() {
        for (z_mm, slopes) in [(297.0, [0.0, 0.0]), (303.0, [0.0, 1.0]), (312.0, [-1.0, 1.4]), (270.0, [0.3, 0.2])] {
            let spot = spot(z_mm, slopes);
            let sides = [Side::Inner, Side::Outer].map(|side| Outline::of(&spot).curve(side));
            let (mut places, mut light) = (Places::default(), Light::default());
            let span = || (-75..=75).map(f64::from);
            span().for_each(|dv| span().for_each(|du| places.push(du as f32, dv as f32)));
            light.fill(&spot, &places, &mut Profiles::default());
            for (index, (dv, du)) in span().flat_map(|dv| span().map(move |du| (dv, du))).enumerate() {
                let [is_inner, is_outer] = sides.map(|side| {
                    let half2 = side.size2 - side.narrowing * dv * dv;
                    (du + side.lean * dv).powi(2) < half2
                });
                let off = if is_inner { 1.0 - light.light[index] } else { light.light[index] };
                assert!(is_inner != is_outer || off.abs() < 1e-4, "{z_mm} {slopes:?} at {du} {dv}: {off}");
            }
        }
    }

    #[test]
    fn an_outline_holds_what_has_moved_no_farther_than_it_is_widened() {
        let before = Outline::of(&spot(303.0, [0.0, 1.0]));
        let moved = |px: f64| Outline { centre_px: [before.centre_px[0] + px, before.centre_px[1]], ..before };
        assert!(before.widened(1.0).holds(&moved(0.7)) && !before.widened(1.0).holds(&moved(1.5)));
        assert!(before.widened(1.0).holds(&before.widened(0.9)) && !before.holds(&before.widened(0.1)));
    }
}
