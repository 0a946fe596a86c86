//! The forward model that is inverted: where the image of a feature lies, given where the feature is.

use std::sync::OnceLock;

use twinpupil_instrument::{ImagePoint, Instrument, PointResponse, Projection, ResponseTable};

/// First-order projections of all bands, and how the lens departs from them. The telecentric band comes first, then the
/// entocentric one, then the others, if there are any.
#[derive(Debug, Clone)]
pub(crate) struct Model {
    projections: Vec<Projection>,
    /// Indices of the bands in the table.
    bands: Vec<usize>,
    /// Where what the lens adds changes unevenly, of each band.
    uneven: Vec<Uneven>,
    table: Option<ResponseTable>,
}

/// Where the centroid of a round feature's light falls on the sensor in the telecentric and the entocentric band.
pub(crate) type ImagePair = [ImagePoint; 2];

impl Model {
    pub(crate) fn new(instrument: &Instrument, table: Option<ResponseTable>) -> Self {
        let bands = instrument.bands_by_role();
        let projections = bands.iter().map(|band| instrument.projection(&instrument.bands[*band])).collect();
        let uneven_of = |band: &usize| table.as_ref().map(|table| Uneven::of(table, *band)).unwrap_or_default();
        let uneven = bands.iter().map(uneven_of).collect();
        Self { projections, bands, uneven, table }
    }

    /// Number of bands.
    pub(crate) fn bands(&self) -> usize {
        self.bands.len()
    }

    /// Index in the instrument of a band.
    pub(crate) fn index(&self, band: usize) -> usize {
        self.bands[band]
    }

    /// What the lens adds to first order, where it is known, with the index of a band in it.
    pub(crate) fn table(&self, band: usize) -> Option<(&ResponseTable, usize)> {
        self.table.as_ref().map(|table| (table, self.bands[band]))
    }

    /// First-order image of an object point in a band.
    pub(crate) fn chief_image(&self, band: usize, object_mm: [f64; 3]) -> ImagePoint {
        self.projections[band].image(object_mm)
    }

    /// First-order images of an object point in the pair.
    pub(crate) fn chief_images(&self, object_mm: [f64; 3]) -> ImagePair {
        [0, 1].map(|band| self.chief_image(band, object_mm))
    }

    /// Telecentric and entocentric magnification at a distance.
    pub(crate) fn magnifications(&self, z_mm: f64) -> [f64; 2] {
        [0, 1].map(|band| self.magnification(band, z_mm))
    }

    /// Magnification of a band at a distance.
    pub(crate) fn magnification(&self, band: usize, z_mm: f64) -> f64 {
        self.projections[band].magnification(z_mm)
    }

    /// Radii of the telecentric and the entocentric image of a point at a distance, mm.
    pub(crate) fn blur_radii_mm(&self, z_mm: f64) -> [f64; 2] {
        [0, 1].map(|band| self.projections[band].blur_radius_mm(z_mm))
    }

    /// Image of a round feature in a band: the centroid of all its light.
    ///
    /// Points near the axis lose part of their light to the other band's mask, and what is left of their blur is
    /// off-centre. On a tilted surface the near half of a disc is imaged larger than the far half. So the centroid is
    /// the mean over the disc of the points' images, weighted by their light:
    ///
    /// ```text
    /// ∫ w J p dA / ∫ w J dA        p = m(z) X + δ(ρ, z) X/ρ,   J = m² + m m′(z) (X·∇z)
    /// ```
    ///
    /// with the throughput w and the radial deviation δ of the table, and the image area J of an area of the disc.
    pub(crate) fn image(&self, band: usize, centre_mm: [f64; 3], disc: &Disc) -> ImagePoint {
        const DIFFERENCE_MM: f64 = 0.01;
        let projection = &self.projections[band];
        let [x_mm, y_mm, z_mm] = centre_mm;
        let slope = (projection.magnification(z_mm + DIFFERENCE_MM) - projection.magnification(z_mm - DIFFERENCE_MM))
            / (2.0 * DIFFERENCE_MM);
        // Where the light changes evenly over the disc four points are as good as many.
        let uneven = self.uneven[band].within(x_mm.hypot(y_mm), 0.5 * disc.diameter_mm);
        let nodes: &'static [[f64; 2]] = if uneven { unit_disc() } else { &EVEN_NODES };
        let (mut light, mut moment) = (0.0, [0.0; 2]);
        for offset_mm in disc.places(nodes) {
            let point_mm: [f64; 3] = std::array::from_fn(|axis| centre_mm[axis] + offset_mm[axis]);
            let [x_mm, y_mm, z_mm] = point_mm;
            let (chief, magnification) = projection.image_and_magnification(point_mm);
            let (image, throughput) = match &self.table {
                Some(table) => table.image(self.bands[band], (x_mm * x_mm + y_mm * y_mm).sqrt(), z_mm, chief),
                None => (chief, 1.0),
            };
            let across = x_mm * disc.slopes[0] + y_mm * disc.slopes[1];
            let stretch = magnification * (magnification + slope * across);
            light += throughput * stretch;
            moment[0] += throughput * stretch * image.x_mm;
            moment[1] += throughput * stretch * image.y_mm;
        }
        if light > 0.0 {
            ImagePoint { x_mm: moment[0] / light, y_mm: moment[1] / light }
        } else {
            projection.image(centre_mm)
        }
    }
}

/// Where a band's response bends with the distance from the axis: where the masks and the stop begin to clip, and for a
/// real lens perhaps everywhere.
#[derive(Debug, Clone, Default)]
struct Uneven {
    /// First node and distance between nodes, mm.
    start_mm: f64,
    step_mm: f64,
    /// For every node, how many nodes before it are bent at some distance.
    before: Vec<u32>,
}

impl Uneven {
    fn of(table: &ResponseTable, band: usize) -> Self {
        const THROUGHPUT: f64 = 1e-4;
        const DEVIATION_MM: f64 = 1e-6;
        let bent = |node: usize| {
            let mut rows = table.bands[band].nodes.chunks_exact(table.r_mm.count);
            rows.any(|row| {
                let [Some(a), Some(b), Some(c)] =
                    [node.checked_sub(1), Some(node), Some(node + 1)].map(|node| node.and_then(|node| row.get(node)))
                else {
                    return false;
                };
                let bend = |value: fn(&PointResponse) -> f64| (value(a) - 2.0 * value(b) + value(c)).abs();
                bend(|node| node.throughput) > THROUGHPUT || bend(|node| node.radial_deviation_mm) > DEVIATION_MM
            })
        };
        let count = |sum: &mut u32, node: usize| {
            let before = *sum;
            *sum += u32::from(bent(node));
            Some(before)
        };
        let before = (0..=table.r_mm.count).scan(0, count).collect();
        Self { start_mm: table.r_mm.start, step_mm: table.r_mm.step, before }
    }

    /// Whether the response bends within a distance of a place.
    fn within(&self, r_mm: f64, reach_mm: f64) -> bool {
        let Some(last) = self.before.len().checked_sub(1) else { return false };
        let node = |r_mm: f64| (r_mm - self.start_mm) / self.step_mm;
        let first = (node(r_mm - reach_mm).floor().max(0.0) as usize).min(last);
        let end = ((node(r_mm + reach_mm).ceil().max(0.0) as usize) + 1).min(last);
        self.before[end] > self.before[first]
    }
}

/// A round feature on a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Disc {
    /// Its diameter in the surface, mm.
    pub(crate) diameter_mm: f64,
    /// Slopes of the surface, dz/dx and dz/dy.
    pub(crate) slopes: [f64; 2],
}

/// Rings and spokes of the quadrature over a disc, over equal areas.
const RINGS: usize = 4;
const SPOKES: usize = 12;

impl Disc {
    /// Points spread over the disc as `nodes` are over the unit disc, relative to its centre, mm. Their second moments
    /// are the disc's.
    fn places(&self, nodes: &'static [[f64; 2]]) -> impl Iterator<Item = [f64; 3]> + use<> {
        let [sx, sy] = self.slopes;
        // Two unit vectors in the surface: along the steepest slope, where the disc is foreshortened, and across it.
        let steepest = sx.hypot(sy);
        let (ux, uy) = if steepest > 0.0 { (sx / steepest, sy / steepest) } else { (1.0, 0.0) };
        let cos_tilt = 1.0 / 1.0_f64.hypot(steepest);
        let radius_mm = 0.5 * self.diameter_mm;
        nodes.iter().map(move |[u, v]| {
            let (along, across) = (radius_mm * u * cos_tilt, radius_mm * v);
            [along * ux - across * uy, along * uy + across * ux, along * steepest]
        })
    }
}

/// Four points that stand for the unit disc: the mean over them is that over the disc of every cubic function.
const EVEN_NODES: [[f64; 2]; 4] = {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    [[half, 0.0], [0.0, half], [-half, 0.0], [0.0, -half]]
};

/// Points spread over the unit disc, each for an equal area.
fn unit_disc() -> &'static [[f64; 2]] {
    static NODES: OnceLock<Vec<[f64; 2]>> = OnceLock::new();
    NODES.get_or_init(|| {
        let node = |ring: usize, spoke: usize| {
            let radius = ((ring as f64 + 0.5) / RINGS as f64).sqrt();
            let (sin, cos) = (std::f64::consts::TAU * (spoke as f64 + 0.5) / SPOKES as f64).sin_cos();
            [radius * cos, radius * sin]
        };
        (0..RINGS).flat_map(|ring| (0..SPOKES).map(move |spoke| node(ring, spoke))).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    const FACING: Disc = Disc { diameter_mm: 1.0, slopes: [0.0; 2] };

    use twinpupil_instrument::{BandResponse, Grid, paper};

    fn table(response: impl Fn(f64) -> PointResponse) -> ResponseTable {
        let (r_mm, z_mm) = (Grid::spanning(0.0, 10.0, 401), Grid::spanning(240.0, 360.0, 2));
        let nodes: Vec<PointResponse> = (0..802).map(|n| response(r_mm.node(n % 401))).collect();
        let band = |name: &str| BandResponse {
            band: name.to_owned(),
            focal_length_mm: 100.0,
            nodes: nodes.clone(),
            ground: vec![1.0; 2],
        };
        let image_radius_mm = Grid::spanning(0.0, 10.0, 2);
        ResponseTable { r_mm, z_mm, image_radius_mm, bands: ["red", "blue"].map(band).to_vec() }
    }

    #[test]
    fn an_ideal_response_is_first_order() {
        let ideal = table(|_| PointResponse { throughput: 1.0, radial_deviation_mm: 0.0, aberration_mm: 0.0 });
        let model = Model::new(&paper::instrument(), Some(ideal));
        let object_mm = [3.0, -1.0, 280.0];
        for band in [0, 1] {
            let (image, chief) = (model.image(band, object_mm, &FACING), model.chief_image(band, object_mm));
            assert!((image.x_mm - chief.x_mm).abs() < 1e-12 && (image.y_mm - chief.y_mm).abs() < 1e-12);
        }
    }

    #[test]
    fn linear_shading_moves_a_disc_by_a_quarter_of_its_radius_squared() {
        // ∫ (1 + g ξ) ξ dA / ∫ (1 + g ξ) dA = g a²/4 for a disc of radius a far from the axis.
        let shaded = table(|r| PointResponse { throughput: 0.1 * r, radial_deviation_mm: 0.0, aberration_mm: 0.0 });
        let model = Model::new(&paper::instrument(), Some(shaded));
        let object_mm = [8.0, 0.0, 300.0];
        let expected_mm = 0.51 * 0.25 * 0.25 / 8.0;
        let shift_mm = model.image(0, object_mm, &FACING).x_mm - model.chief_image(0, object_mm).x_mm;
        assert!((shift_mm / expected_mm - 1.0).abs() < 0.02, "{shift_mm} {expected_mm}");
    }

    #[test]
    fn a_tilted_disc_is_imaged_off_its_centre() {
        // p = L (x₀ + ξ)/(z₀ + ξ t) over a disc whose image area shrinks with z³: to first order in 1/z₀ the centroid
        // lies −4 t L ⟨ξ²⟩/z₀² beside the image of the centre, ⟨ξ²⟩ = (a cos θ)²/4.
        let model = Model::new(&paper::instrument(), None);
        let tilt = 45.0_f64.to_radians();
        let disc = Disc { diameter_mm: 1.0, slopes: [tilt.tan(), 0.0] };
        let centre_mm = [0.0, 4.0, 300.0];
        let [telecentric, entocentric] = [0, 1].map(|band| model.image(band, centre_mm, &disc));
        let [telecentric_chief, entocentric_chief] = model.chief_images(centre_mm);
        let expected_mm = -4.0 * tilt.tan() * 151.0 * (0.5 * tilt.cos()).powi(2) / 4.0 / 300.0_f64.powi(2);
        assert!(((entocentric.x_mm - entocentric_chief.x_mm) / expected_mm - 1.0).abs() < 1e-3);
        assert!((telecentric.x_mm - telecentric_chief.x_mm).abs() < 1e-12);
    }

    #[test]
    fn four_points_are_as_good_as_many_where_the_light_changes_evenly() {
        let bent = |r: f64| if r < 4.0 { 0.25 * r } else { 1.0 };
        let clipped = table(|r| PointResponse { throughput: bent(r), radial_deviation_mm: 0.01, aberration_mm: 0.0 });
        let model = Model::new(&paper::instrument(), Some(clipped));
        assert!(model.uneven[0].within(4.4, 0.5) && !model.uneven[0].within(4.6, 0.5));
        let everywhere =
            || Uneven { before: (0..model.uneven[0].before.len() as u32).collect(), ..model.uneven[0].clone() };
        let always = Model { uneven: vec![everywhere(), everywhere()], ..model.clone() };
        let disc = Disc { diameter_mm: 1.0, slopes: [1.0, 0.3] };
        let object_mm = [5.2, 1.0, 290.0];
        for band in [0, 1] {
            let [few, many] = [&model, &always].map(|model| model.image(band, object_mm, &disc));
            assert!((few.x_mm - many.x_mm).hypot(few.y_mm - many.y_mm) < 1e-6, "{few:?} {many:?}");
        }
    }
}
