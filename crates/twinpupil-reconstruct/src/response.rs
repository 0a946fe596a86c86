//! What the lens does to the image of a point, with its slopes: a band of the response table made ready to be read often.

use twinpupil_instrument::{Grid, PointResponse, ResponseTable};

/// The response of one band over (r, z).
#[derive(Debug, Clone)]
pub(crate) struct Response {
    r_mm: Grid,
    z_mm: Grid,
    /// Nodes a mm along both.
    densities: [f64; 2],
    /// Throughput and radial deviation, mm, of every node; distances are slow, radii fast.
    nodes: Vec<[f64; 2]>,
    /// For every radius, how many before it are bent at some distance.
    bent_before: Vec<u32>,
}

/// The response at one distance, from the nodes before and behind it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slice<'a> {
    near: &'a [[f64; 2]],
    far: &'a [[f64; 2]],
    share: f64,
    start_mm: f64,
    densities: [f64; 2],
}

/// The response at one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Local {
    pub(crate) throughput: f64,
    pub(crate) radial_deviation_mm: f64,
    /// Change of the throughput with r and z, 1/mm.
    pub(crate) throughput_slopes: [f64; 2],
    /// Change of the radial deviation with r and z.
    pub(crate) deviation_slopes: [f64; 2],
}

impl Response {
    /// Of a band of a table.
    pub(crate) fn of(table: &ResponseTable, band: usize) -> Self {
        let nodes = &table.bands[band].nodes;
        let count = |sum: &mut u32, radius: usize| {
            let before = *sum;
            *sum += u32::from(bends(nodes, table.r_mm.count, radius));
            Some(before)
        };
        let bent_before = (0..=table.r_mm.count).scan(0, count).collect();
        let nodes = nodes.iter().map(|node| [node.throughput, node.radial_deviation_mm]).collect();
        let densities = [1.0 / table.r_mm.step, 1.0 / table.z_mm.step];
        Self { r_mm: table.r_mm, z_mm: table.z_mm, densities, nodes, bent_before }
    }

    /// At a distance; outside the table as at its edge.
    #[inline(always)]
    pub(crate) fn slice(&self, z_mm: f64) -> Slice<'_> {
        let (k, share) = self.z_mm.locate(z_mm);
        let near = k * self.r_mm.count;
        let (near, far) = self.nodes[near..near + 2 * self.r_mm.count].split_at(self.r_mm.count);
        Slice { near, far, share, start_mm: self.r_mm.start, densities: self.densities }
    }

    /// Whether the response bends with the distance from the axis within a reach of a place: where the masks and the
    /// stop begin to clip, and for a real lens perhaps everywhere.
    pub(crate) fn bends_within(&self, r_mm: f64, reach_mm: f64) -> bool {
        let last = self.bent_before.len() - 1;
        let node = |r_mm: f64| (r_mm - self.r_mm.start) / self.r_mm.step;
        let first = (node(r_mm - reach_mm).floor().max(0.0) as usize).min(last);
        let end = ((node(r_mm + reach_mm).ceil().max(0.0) as usize) + 1).min(last);
        self.bent_before[end] > self.bent_before[first]
    }

    /// Takes every radius for a bent one.
    #[cfg(test)]
    pub(crate) fn bend_everywhere(&mut self) {
        self.bent_before.iter_mut().zip(0..).for_each(|(before, radius)| *before = radius);
    }
}

impl Slice<'_> {
    /// At a radius, bilinear between nodes; outside the table as at its edge.
    #[inline(always)]
    pub(crate) fn at(&self, r_mm: f64) -> Local {
        let last = self.near.len() - 1;
        let place = ((r_mm - self.start_mm) * self.densities[0]).clamp(0.0, last as f64);
        let cell = (place as usize).min(last - 1);
        let across = place - cell as f64;
        let [a, b, c, d] = [self.near[cell], self.near[cell + 1], self.far[cell], self.far[cell + 1]];
        let value = |k: usize| {
            let (near, far) = (b[k] - a[k], d[k] - c[k]);
            let (start, end) = (a[k] + across * near, c[k] + across * far);
            let by_r = near + self.share * (far - near);
            (start + self.share * (end - start), [by_r * self.densities[0], (end - start) * self.densities[1]])
        };
        let ((throughput, throughput_slopes), (radial_deviation_mm, deviation_slopes)) = (value(0), value(1));
        Local { throughput, radial_deviation_mm, throughput_slopes, deviation_slopes }
    }
}

/// Whether the response bends at a radius, at some distance.
fn bends(nodes: &[PointResponse], radii: usize, radius: usize) -> bool {
    const THROUGHPUT: f64 = 1e-4;
    const DEVIATION_MM: f64 = 1e-6;
    let around =
        |row: &[PointResponse]| Some([*row.get(radius.checked_sub(1)?)?, *row.get(radius)?, *row.get(radius + 1)?]);
    nodes.chunks_exact(radii).filter_map(around).any(|[a, b, c]| {
        let bend = |value: fn(&PointResponse) -> f64| (value(&a) - 2.0 * value(&b) + value(&c)).abs();
        bend(|node| node.throughput) > THROUGHPUT || bend(|node| node.radial_deviation_mm) > DEVIATION_MM
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use twinpupil_instrument::BandResponse;

    #[test]
    fn values_are_the_tables_and_slopes_their_differences() {
        const STEP_MM: f64 = 1e-4;
        let (r_mm, z_mm) = (Grid::spanning(0.0, 4.0, 5), Grid::spanning(100.0, 200.0, 3));
        let node = |n: usize| {
            let (r, z) = (r_mm.node(n % 5), z_mm.node(n / 5));
            PointResponse {
                throughput: (r + 0.01 * z).sin(),
                radial_deviation_mm: 0.1 * r * z,
                ..PointResponse::default()
            }
        };
        let band = BandResponse {
            band: "a".to_owned(),
            focal_length_mm: 100.0,
            nodes: (0..15).map(node).collect(),
            ground: vec![1.0; 2],
            ground_centre_mm: [0.0; 2],
        };
        let table = ResponseTable { r_mm, z_mm, image_radius_mm: Grid::spanning(0.0, 2.0, 2), bands: vec![band] };
        let response = Response::of(&table, 0);
        for (r, z) in [(0.3, 110.0), (2.6, 171.0), (3.99, 199.0)] {
            let (local, stated) = (response.slice(z).at(r), table.at(0, r, z));
            assert!((local.throughput - stated.throughput).abs() < 1e-12);
            assert!((local.radial_deviation_mm - stated.radial_deviation_mm).abs() < 1e-12);
            let along = |dr: f64, dz: f64| {
                let [a, b] = [-1.0, 1.0].map(|sign| table.at(0, r + sign * dr, z + sign * dz));
                [b.throughput - a.throughput, b.radial_deviation_mm - a.radial_deviation_mm]
                    .map(|d| d / (2.0 * STEP_MM))
            };
            for (axis, [throughput, deviation]) in [along(STEP_MM, 0.0), along(0.0, STEP_MM)].into_iter().enumerate() {
                assert!((local.throughput_slopes[axis] - throughput).abs() < 1e-6, "{r} {z}");
                assert!((local.deviation_slopes[axis] - deviation).abs() < 1e-6, "{r} {z}");
            }
        }
        assert_eq!(response.slice(300.0).at(9.0).throughput, table.at(0, 4.0, 200.0).throughput);
    }
}
