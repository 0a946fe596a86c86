//! How the image of a dot through a real lens departs from that through an ideal one.

use std::ops::{Add, Mul};

use twinpupil_instrument::{Grid, PointSpread, ResponseTable};

use crate::likelihood::pencil::Vector2;
use crate::likelihood::spot::{Dot, Matrix2};

/// What the lens adds to the images of points in one band, over (r, z).
#[derive(Debug, Clone)]
pub(crate) struct Departures {
    r_mm: Grid,
    z_mm: Grid,
    /// Outwards to the place of the image, mm, and what else it does to it, of every node; distances are slow, radii fast.
    nodes: Vec<(f64, PointSpread)>,
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
        let nodes: Vec<(f64, PointSpread)> =
            table.bands[band].nodes.iter().map(|node| (node.aberration_mm, node.spread)).collect();
        let adds = nodes.iter().any(|node| *node != (0.0, PointSpread::default()));
        adds.then_some(Self { r_mm: table.r_mm, z_mm: table.z_mm, nodes })
    }

    /// Of a dot, from four points of its rim: the two on its own radius and the two beside its centre.
    ///
    /// An edge moves along its normal alone, so the mean of what the lens does to the two on the radius is what it does to
    /// the place of the rim; the differences of the four tell how the rim grows, along the radius and across it. A lens
    /// that adds k r³ moves the edges of a dot of radius ρ at r as if it went farther out by k r (r² + 3 ρ²), and so do
    /// these.
    pub(crate) fn of_dot(&self, dot: &Dot) -> Departure {
        let [x_mm, y_mm, z_mm] = dot.centre_mm;
        let (r_mm, rho_mm) = ((x_mm * x_mm + y_mm * y_mm).sqrt(), (0.5 * dot.diameter_mm).max(LEAST_MM));
        let [x, y] = if r_mm > 0.0 { [x_mm / r_mm, y_mm / r_mm] } else { [1.0, 0.0] };
        let beside_mm = (r_mm * r_mm + rho_mm * rho_mm).sqrt();
        // A tilted rim meets the radius nearer to its middle, and not at its distance.
        let steepness = dot.slopes[0] * x + dot.slopes[1] * y;
        let rim_mm = rho_mm / (1.0 + steepness * steepness).sqrt();
        let deeper_mm = rim_mm * steepness;
        let [outer_mm, inner_mm] =
            [1.0, -1.0].map(|side| self.outwards_mm(r_mm + side * rim_mm, z_mm + side * deeper_mm));
        let outwards_mm = 0.5 * (outer_mm + inner_mm);
        let across = self.outwards_mm(beside_mm, z_mm) / beside_mm;
        let along = (self.outwards_mm(r_mm + rho_mm, z_mm) - self.outwards_mm(r_mm - rho_mm, z_mm)) / (2.0 * rho_mm);
        let [nearer_mm, farther_mm] = [-STEP_MM, STEP_MM].map(|step_mm| self.outwards_mm(r_mm, z_mm + step_mm));
        let per_mm = (farther_mm - nearer_mm) / (2.0 * STEP_MM);
        let off = (along - across) * x * y;
        let [outer, inner] = [1.0, -1.0].map(|side| self.spread((r_mm + side * rim_mm).abs(), z_mm + side * deeper_mm));
        let [middle, beside] = [r_mm, beside_mm].map(|r_mm| self.spread(r_mm, z_mm));
        let growth_mm = 0.25 * (outer.growth_mm + inner.growth_mm) + 0.5 * beside.growth_mm;
        Departure {
            shift_mm: [outwards_mm * x, outwards_mm * y],
            shift_per_mm: [per_mm * x, per_mm * y],
            growth: [[across + (along - across) * x * x, off], [off, across + (along - across) * y * y]],
            spread: PointSpread { growth_mm, ..middle },
            outer: (outer + inner * -1.0) * 0.5,
            outwards: [x, y],
            away: [r_mm, rho_mm].map(|mm| mm / (r_mm + rho_mm)),
        }
    }

    /// Towards +x of a point at (r, 0, z), r of either sign.
    fn outwards_mm(&self, r_mm: f64, z_mm: f64) -> f64 {
        self.at(r_mm.abs(), z_mm, |node| node.0) * r_mm.signum()
    }

    fn spread(&self, r_mm: f64, z_mm: f64) -> PointSpread {
        self.at(r_mm, z_mm, |node| node.1)
    }

    /// Bilinear between nodes; outside the table as at its edge.
    fn at<T: Copy + Mul<f64, Output = T> + Add<Output = T>>(
        &self,
        r_mm: f64,
        z_mm: f64,
        value: impl Fn(&(f64, PointSpread)) -> T,
    ) -> T {
        let ((i, across), (k, along)) = (self.r_mm.locate(r_mm), self.z_mm.locate(z_mm));
        let near = k * self.r_mm.count + i;
        let far = near + self.r_mm.count;
        let row = |first: usize| value(&self.nodes[first]) * (1.0 - across) + value(&self.nodes[first + 1]) * across;
        row(near) * (1.0 - along) + row(far) * along
    }
}

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
