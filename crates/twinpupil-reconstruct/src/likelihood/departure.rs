//! How the image of a dot through a real lens departs from that through an ideal one.

use twinpupil_instrument::{Grid, PointSpread, ResponseTable};

use crate::likelihood::pencil::Vector2;
use crate::likelihood::spot::{Dot, Matrix2, Tilt, inverse, product, times};

/// What the lens adds to the images of points in one band, over (r, z).
#[derive(Debug, Clone)]
pub(crate) struct Departures {
    r_mm: Grid,
    z_mm: Grid,
    /// Outwards to the place of the image, mm, at every node; distances are slow, radii fast.
    outwards_mm: Vec<f64>,
    /// What else it does to it.
    spreads: Vec<PointSpread>,
}

/// What the lens adds to the image of one dot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Departure {
    /// To its place, mm.
    pub(crate) shift_mm: Vector2,
    /// To the place of its centre per mm that it is farther away.
    pub(crate) shift_per_mm: Vector2,
    /// To its magnification.
    pub(crate) growth: Matrix2,
    /// To the images of its points: on the average over its rim, and more at the outermost point of that.
    pub(crate) spread: PointSpread,
    pub(crate) outer: PointSpread,
    /// Away from the axis.
    pub(crate) outwards: Vector2,
    /// Its distance from there, and its radius, in parts of their sum.
    pub(crate) away: Vector2,
}

impl Departures {
    /// Of a band of a table; `None` where the lens adds nothing.
    pub(crate) fn of(table: &ResponseTable, band: usize) -> Option<Self> {
        let nodes = &table.bands[band].nodes;
        let adds = nodes.iter().any(|node| node.aberration_mm != 0.0 || node.spread != PointSpread::default());
        adds.then(|| Self {
            r_mm: table.r_mm,
            z_mm: table.z_mm,
            outwards_mm: nodes.iter().map(|node| node.aberration_mm).collect(),
            spreads: nodes.iter().map(|node| node.spread).collect(),
        })
    }

    /// Of a dot.
    pub(crate) fn of_dot(&self, dot: &Dot) -> Departure {
        let [x_mm, y_mm, z_mm] = dot.centre_mm;
        let (r_mm, rho_mm) = ((x_mm * x_mm + y_mm * y_mm).sqrt(), (0.5 * dot.diameter_mm).max(LEAST_MM));
        let [x, y] = if r_mm > 0.0 { [x_mm / r_mm, y_mm / r_mm] } else { [1.0, 0.0] };
        let (shift_mm, growth) = self.moved(dot, rho_mm);
        let [nearer_mm, farther_mm] = [-STEP_MM, STEP_MM].map(|step_mm| self.outwards_mm(r_mm, z_mm + step_mm));
        let per_mm = (farther_mm - nearer_mm) / (2.0 * STEP_MM);
        // A tilted rim meets the radius nearer to its middle, and not at its distance.
        let steepness = dot.slopes[0] * x + dot.slopes[1] * y;
        let rim_mm = rho_mm / (1.0 + steepness * steepness).sqrt();
        let deeper_mm = rim_mm * steepness;
        let [outer, inner] = [1.0, -1.0].map(|side| self.spread((r_mm + side * rim_mm).abs(), z_mm + side * deeper_mm));
        let beside_mm = (r_mm * r_mm + rho_mm * rho_mm).sqrt();
        let [middle, beside] = [r_mm, beside_mm].map(|r_mm| self.spread(r_mm, z_mm));
        let growth_mm = 0.25 * (outer.growth_mm + inner.growth_mm) + 0.5 * beside.growth_mm;
        Departure {
            shift_mm,
            shift_per_mm: [per_mm * x, per_mm * y],
            growth,
            spread: PointSpread { growth_mm, ..middle },
            outer: (outer + inner * -1.0) * 0.5,
            outwards: [x, y],
            away: [r_mm, rho_mm].map(|mm| mm / (r_mm + rho_mm)),
        }
    }

    /// How the lens moves the image of a dot, mm, and how it changes its magnification along x and y.
    ///
    /// An edge shows what moves it along its normal. Of the rim `c + ρ T e`, e on the unit circle and T what the tilt of the
    /// dot does to it across the axis, moved by d(e), that is to the unit circle `f(e) = e·T⁻¹ d`. Its mean and the waves of it
    /// that go around once and twice are those of a rim that is moved by δ and grows by G:
    ///
    /// ```text
    /// δ = 2 T ⟨f e⟩        G = T ⟨f (4 e eᵀ − 1)⟩ T⁻¹ / ρ
    /// ```
    ///
    /// A lens that adds k r³ thus moves a dot across the axis as if that were at r by k r (r² + 3 ρ²).
    fn moved(&self, dot: &Dot, rho_mm: f64) -> (Vector2, Matrix2) {
        let [x_mm, y_mm, z_mm] = dot.centre_mm;
        let tilt = Tilt::of(dot.slopes);
        let shape = tilt.shape([0.0; 2]);
        let inverse = inverse(shape);
        let (mut mean, mut once, mut twice) = (0.0, [0.0; 2], [0.0; 2]);
        for [c, s] in RIM {
            let [along, across] = times(shape, [rho_mm * c, rho_mm * s]);
            let [x, y] = [x_mm + along, y_mm + across];
            let r_mm = (x * x + y * y).sqrt().max(f64::MIN_POSITIVE);
            let per_mm = self.outwards_mm(r_mm, z_mm + rho_mm * c * tilt.sin) / r_mm;
            let [du, dv] = times(inverse, [per_mm * x, per_mm * y]);
            let moved_mm = (c * du + s * dv) / RIM.len() as f64;
            mean += moved_mm;
            once = [once[0] + 2.0 * moved_mm * c, once[1] + 2.0 * moved_mm * s];
            twice = [twice[0] + 2.0 * moved_mm * (c * c - s * s), twice[1] + 4.0 * moved_mm * c * s];
        }
        let shift_mm = times(shape, once);
        let grown = [[mean + twice[0], twice[1]], [twice[1], mean - twice[0]]].map(|row| row.map(|mm| mm / rho_mm));
        let growth = product(product(shape, grown), inverse);
        (shift_mm, growth)
    }

    /// Away from the axis of a point at (r, z): through the four nodes next to it each way, so that a quadratic is exact.
    fn outwards_mm(&self, r_mm: f64, z_mm: f64) -> f64 {
        let ((i, across), (k, along)) = (self.r_mm.locate(r_mm), self.z_mm.locate(z_mm));
        let (columns, rows) = (self.r_mm.count, self.z_mm.count);
        let row_mm = |row: usize| {
            let row = &self.outwards_mm[row * columns..(row + 1) * columns];
            let [own, next] = [row[i], row[i + 1]];
            // The same on the other side of the axis, if the table begins there.
            let before = match i {
                0 if self.r_mm.start == 0.0 => -next,
                0 => 2.0 * own - next,
                _ => row[i - 1],
            };
            let after = row.get(i + 2).copied().unwrap_or(2.0 * next - own);
            between([before, own, next, after], across)
        };
        let [own, next] = [row_mm(k), row_mm(k + 1)];
        let before = if k > 0 { row_mm(k - 1) } else { 2.0 * own - next };
        let after = if k + 2 < rows { row_mm(k + 2) } else { 2.0 * next - own };
        between([before, own, next, after], along)
    }

    /// Bilinear between nodes; outside the table as at its edge.
    fn spread(&self, r_mm: f64, z_mm: f64) -> PointSpread {
        let ((i, across), (k, along)) = (self.r_mm.locate(r_mm), self.z_mm.locate(z_mm));
        let near = k * self.r_mm.count + i;
        let far = near + self.r_mm.count;
        let row = |first: usize| self.spreads[first] * (1.0 - across) + self.spreads[first + 1] * across;
        row(near) * (1.0 - along) + row(far) * along
    }
}

/// Between the second and the third of four values, by Catmull and Rom's cubic (Computer Aided Geometric Design, 1974).
fn between([before, own, next, after]: [f64; 4], share: f64) -> f64 {
    let (rise, falls) = (0.5 * (next - before), 0.5 * (after - own));
    let step = next - own;
    let (leaves, meets) = (rise - step, step - falls);
    let left = 1.0 - share;
    own + share * (step + left * (left * leaves + share * meets))
}

/// Points around the unit circle.
const RIM: [Vector2; 8] = {
    use std::f64::consts::FRAC_1_SQRT_2 as HALF;
    [[1.0, 0.0], [HALF, HALF], [0.0, 1.0], [-HALF, HALF], [-1.0, 0.0], [-HALF, -HALF], [0.0, -1.0], [HALF, -HALF]]
};

/// Smallest radius by which growth is told, mm.
const LEAST_MM: f64 = 0.01;

/// Step of the change with the distance, mm.
const STEP_MM: f64 = 1.0;

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{BandResponse, PointResponse};

    use super::*;

    #[test]
    fn cubic_distortion_moves_and_stretches_a_rim_as_algebra_says() {
        const K: f64 = 1e-4;
        let (r_mm, z_mm) = (Grid::spanning(0.0, 10.0, 2001), Grid::spanning(250.0, 350.0, 3));
        let node = |n: usize| PointResponse {
            throughput: 1.0,
            radial_deviation_mm: 0.0,
            aberration_mm: K * r_mm.node(n % 2001).powi(3) * z_mm.node(n / 2001) / 300.0,
            spread: PointSpread { growth_mm: 0.01, ..PointSpread::default() },
        };
        let band = BandResponse {
            band: "a".to_owned(),
            focal_length_mm: 100.0,
            nodes: (0..3 * 2001).map(node).collect(),
            ground: vec![1.0; 2],
            ground_centre_mm: [0.0; 2],
        };
        let table = ResponseTable { r_mm, z_mm, image_radius_mm: Grid::spanning(0.0, 2.0, 2), bands: vec![band] };
        let departures = Departures::of(&table, 0).unwrap();
        let dot = Dot { centre_mm: [3.0, 4.0, 300.0], diameter_mm: 1.0, slopes: [0.0; 2] };
        let found = departures.of_dot(&dot);
        // 2 ⟨n·|X|²X n⟩ over the rim, and the Jacobian of |X|² X, (|X|² + 2 X Xᵀ), a ρ²-th changed.
        let square = 25.0 + 3.0 * 0.25;
        for (k, centre_mm) in [3.0, 4.0].into_iter().enumerate() {
            assert!((found.shift_mm[k] - K * centre_mm * square).abs() < 1e-8, "{found:?}");
            assert!((found.shift_per_mm[k] - K * centre_mm * 25.0 / 300.0).abs() < 1e-8, "{found:?}");
        }
        assert!((found.growth[0][1] - 2.0 * K * 12.0).abs() < 1e-7, "{found:?}");
        assert!((found.growth[0][0] - K * (25.25 + 2.0 * 9.0)).abs() < 2e-6, "{found:?}");
        assert!((found.spread.growth_mm - 0.01).abs() < 1e-15);
    }

    #[test]
    fn an_ideal_lens_adds_nothing() {
        let (r_mm, z_mm) = (Grid::spanning(0.0, 1.0, 2), Grid::spanning(1.0, 2.0, 2));
        let node = PointResponse { throughput: 0.5, radial_deviation_mm: 0.1, ..PointResponse::default() };
        let band = BandResponse {
            band: "a".to_owned(),
            focal_length_mm: 100.0,
            nodes: vec![node; 4],
            ground: vec![1.0; 2],
            ground_centre_mm: [0.0; 2],
        };
        let table = ResponseTable { r_mm, z_mm, image_radius_mm: r_mm, bands: vec![band] };
        assert!(Departures::of(&table, 0).is_none());
    }
}
