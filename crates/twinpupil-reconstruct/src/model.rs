//! The forward model that is inverted: where the image of a feature lies, given where the feature is.

use std::sync::OnceLock;

use twinpupil_instrument::{Chief, ImagePoint, Instrument, Projection, ResponseTable};

use crate::response::{Local, Response};

/// First-order projections of all bands, and how the lens departs from them. The telecentric band comes first, then the
/// entocentric one, then the others, if there are any.
#[derive(Debug, Clone)]
pub(crate) struct Model {
    projections: Vec<Projection>,
    /// Indices of the bands in the table.
    bands: Vec<usize>,
    /// What the lens adds, of each band; none without a table.
    responses: Vec<Response>,
    table: Option<ResponseTable>,
}

/// Where the centroid of a round feature's light falls on the sensor in the telecentric and the entocentric band.
pub(crate) type ImagePair = [ImagePoint; 2];

/// Image of a round feature and how it moves with the feature's centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DiscImage {
    /// Centroid of all its light.
    pub(crate) image: ImagePoint,
    /// Change of both coordinates with x, y and z of the centre.
    pub(crate) slopes: [[f64; 3]; 2],
    /// Whether the lens does something else to every part of it.
    pub(crate) uneven: bool,
}

impl Model {
    pub(crate) fn new(instrument: &Instrument, table: Option<ResponseTable>) -> Self {
        let bands = instrument.bands_by_role();
        let projections = bands.iter().map(|band| instrument.projection(&instrument.bands[*band])).collect();
        let of_table = |table: &ResponseTable| bands.iter().map(|band| Response::of(table, *band)).collect();
        let responses = table.as_ref().map(of_table).unwrap_or_default();
        Self { projections, bands, responses, table }
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

    /// First-order image of an object point in a band, and how it moves with the point.
    pub(crate) fn chief_disc(&self, band: usize, [x_mm, y_mm, z_mm]: [f64; 3]) -> DiscImage {
        let projection = &self.projections[band];
        let chief = projection.chief(z_mm);
        let [m, t] = [chief.magnification, chief.magnification_slope];
        let [cx, cy] = projection.pupil_centre_mm;
        DiscImage {
            image: ImagePoint { x_mm: m * x_mm + chief.shift * cx, y_mm: m * y_mm + chief.shift * cy },
            slopes: [[m, 0.0, t * x_mm + chief.shift_slope * cx], [0.0, m, t * y_mm + chief.shift_slope * cy]],
            uneven: false,
        }
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
        self.projections[band].chief(z_mm).magnification
    }

    /// One over the magnification of a band at a distance, and its slope there, 1/mm: it is linear in the distance.
    pub(crate) fn reduction(&self, band: usize, z_mm: f64) -> (f64, f64) {
        let chief = self.projections[band].chief(z_mm);
        (1.0 / chief.magnification, -chief.magnification_slope / chief.magnification.powi(2))
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
    /// p̄ = ∫ w J p dA / ∫ w J dA      p = q + δ(ρ, z) q/|q|,  q = m(z) X + s(z) c,  J = m² + m m′(z) (X·∇z)
    /// p̄′ = ∫ (w J p′ + w′ J (p − p̄)) dA / ∫ w J dA
    /// ```
    ///
    /// with the throughput w and the radial deviation δ of the table, and the image area J of an area of the disc, which
    /// changes too slowly to matter for the slopes.
    pub(crate) fn image(&self, band: usize, centre_mm: [f64; 3], disc: &Disc) -> DiscImage {
        let projection = &self.projections[band];
        let response = self.responses.get(band);
        let r_mm = (centre_mm[0] * centre_mm[0] + centre_mm[1] * centre_mm[1]).sqrt();
        // Where the light changes evenly over the disc four points are as good as many.
        let uneven = response.is_some_and(|response| response.bends_within(r_mm, 0.5 * disc.diameter_mm));
        let nodes = if uneven { uneven_nodes() } else { &EVEN_NODES };
        let at_distance = |z_mm: f64| (projection.chief(z_mm), response.map(|response| response.slice(z_mm)));
        let (mut level, tilted) = (at_distance(centre_mm[2]), disc.slopes != [0.0; 2]);
        let mut mean = Mean::default();
        for (offset_mm, share) in disc.places(nodes) {
            let [x_mm, y_mm, z_mm] = std::array::from_fn(|axis| centre_mm[axis] + offset_mm[axis]);
            if tilted {
                level = at_distance(z_mm);
            }
            let (chief, slice) = &level;
            let r_mm = (x_mm * x_mm + y_mm * y_mm).sqrt();
            let local = slice.map_or(Local::IDEAL, |slice| slice.at(r_mm));
            let across = x_mm * disc.slopes[0] + y_mm * disc.slopes[1];
            let area = share * chief.magnification * (chief.magnification + chief.magnification_slope * across);
            let inverse = if r_mm > 0.0 { 1.0 / r_mm } else { 0.0 };
            let towards = [x_mm * inverse, y_mm * inverse];
            mean.add(area, local, towards, point_image(projection, chief, [x_mm, y_mm], towards, &local));
        }
        if mean.light > 0.0 {
            DiscImage { uneven, ..mean.settled() }
        } else {
            DiscImage { uneven, ..self.chief_disc(band, centre_mm) }
        }
    }
}

/// Image of a point and its slopes: the first-order image moved along its own radius.
#[inline]
fn point_image(
    projection: &Projection,
    chief: &Chief,
    [x_mm, y_mm]: [f64; 2],
    towards: [f64; 2],
    local: &Local,
) -> ([f64; 2], [[f64; 3]; 2]) {
    let [cx, cy] = projection.pupil_centre_mm;
    let m = chief.magnification;
    let q = [m * x_mm + chief.shift * cx, m * y_mm + chief.shift * cy];
    let q_slopes = [
        chief.magnification_slope * x_mm + chief.shift_slope * cx,
        chief.magnification_slope * y_mm + chief.shift_slope * cy,
    ];
    let radius_mm = (q[0] * q[0] + q[1] * q[1]).sqrt();
    let inverse = if radius_mm > 0.0 { 1.0 / radius_mm } else { 0.0 };
    let (unit, turn) = ([q[0] * inverse, q[1] * inverse], local.radial_deviation_mm * inverse);
    let scale = 1.0 + turn;
    let [by_r, by_z] = local.deviation_slopes;
    // How much farther out the deviation takes the image, less what the turn of the radius already does.
    let outward = [
        by_r * towards[0] - turn * m * unit[0],
        by_r * towards[1] - turn * m * unit[1],
        by_z - turn * (q_slopes[0] * unit[0] + q_slopes[1] * unit[1]),
    ];
    let slopes = [
        [m * scale + unit[0] * outward[0], unit[0] * outward[1], q_slopes[0] * scale + unit[0] * outward[2]],
        [unit[1] * outward[0], m * scale + unit[1] * outward[1], q_slopes[1] * scale + unit[1] * outward[2]],
    ];
    ([q[0] * scale, q[1] * scale], slopes)
}

/// The mean over a disc of its points' images, weighted by their light, while it is summed.
#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    light: f64,
    light_slopes: [f64; 3],
    moment: [f64; 2],
    moment_slopes: [[f64; 3]; 2],
}

impl Mean {
    #[inline]
    fn add(&mut self, area: f64, local: Local, towards: [f64; 2], (image, slopes): ([f64; 2], [[f64; 3]; 2])) {
        let light = area * local.throughput;
        let [by_r, by_z] = local.throughput_slopes.map(|slope| area * slope);
        let light_slopes = [by_r * towards[0], by_r * towards[1], by_z];
        self.light += light;
        for axis in 0..3 {
            self.light_slopes[axis] += light_slopes[axis];
        }
        for k in 0..2 {
            self.moment[k] += light * image[k];
            for axis in 0..3 {
                self.moment_slopes[k][axis] += light * slopes[k][axis] + light_slopes[axis] * image[k];
            }
        }
    }

    fn settled(&self) -> DiscImage {
        let inverse = 1.0 / self.light;
        let mean = self.moment.map(|moment| moment * inverse);
        let slope = |k: usize, axis: usize| (self.moment_slopes[k][axis] - mean[k] * self.light_slopes[axis]) * inverse;
        DiscImage {
            image: ImagePoint { x_mm: mean[0], y_mm: mean[1] },
            slopes: std::array::from_fn(|k| std::array::from_fn(|axis| slope(k, axis))),
            uneven: false,
        }
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

/// A point that stands for a part of the unit disc, and that part's share of its area.
type Node = ([f64; 2], f64);

impl Disc {
    /// Points spread over the disc as `nodes` are over the unit disc, relative to its centre, mm. Their second moments
    /// are the disc's.
    fn places(&self, nodes: &'static [Node]) -> impl Iterator<Item = ([f64; 3], f64)> + use<> {
        let [sx, sy] = self.slopes;
        // Two unit vectors in the surface: along the steepest slope, where the disc is foreshortened, and across it.
        let steepest = (sx * sx + sy * sy).sqrt();
        let (ux, uy) = if steepest > 0.0 { (sx / steepest, sy / steepest) } else { (1.0, 0.0) };
        let cos_tilt = 1.0 / (1.0 + steepest * steepest).sqrt();
        let radius_mm = 0.5 * self.diameter_mm;
        nodes.iter().map(move |([u, v], share)| {
            let (along, across) = (radius_mm * u * cos_tilt, radius_mm * v);
            ([along * ux - across * uy, along * uy + across * ux, along * steepest], *share)
        })
    }
}

/// Four points that stand for the unit disc: the mean over them is that over the disc of every cubic function.
const EVEN_NODES: [Node; 4] = {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    [([half, 0.0], 0.25), ([0.0, half], 0.25), ([-half, 0.0], 0.25), ([0.0, -half], 0.25)]
};

/// Points for where the light changes unevenly: three rings, by Gauss and Legendre in the square of the radius.
fn uneven_nodes() -> &'static [Node] {
    const SPOKES: usize = 8;
    static NODES: OnceLock<Vec<Node>> = OnceLock::new();
    NODES.get_or_init(|| {
        let off = 0.5 * 0.6_f64.sqrt();
        let rings = [(0.5 - off, 5.0 / 18.0, 0.5), (0.5, 8.0 / 18.0, 0.0), (0.5 + off, 5.0 / 18.0, 0.5)];
        let ring = |(radius2, share, turn): (f64, f64, f64)| {
            (0..SPOKES).map(move |spoke| {
                let (sin, cos) = (std::f64::consts::TAU * (spoke as f64 + turn) / SPOKES as f64).sin_cos();
                ([radius2.sqrt() * cos, radius2.sqrt() * sin], share / SPOKES as f64)
            })
        };
        rings.into_iter().flat_map(ring).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    const FACING: Disc = Disc { diameter_mm: 1.0, slopes: [0.0; 2] };

    use twinpupil_instrument::{BandResponse, Grid, PointResponse, paper};

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
            let (image, chief) = (model.image(band, object_mm, &FACING).image, model.chief_image(band, object_mm));
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
        let shift_mm = model.image(0, object_mm, &FACING).image.x_mm - model.chief_image(0, object_mm).x_mm;
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
        let [telecentric, entocentric] = [0, 1].map(|band| model.image(band, centre_mm, &disc).image);
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
        assert!(model.responses[0].bends_within(4.4, 0.5) && !model.responses[0].bends_within(4.6, 0.5));
        let mut always = model.clone();
        always.responses.iter_mut().for_each(Response::bend_everywhere);
        let disc = Disc { diameter_mm: 1.0, slopes: [1.0, 0.3] };
        let object_mm = [5.2, 1.0, 290.0];
        for band in [0, 1] {
            let [few, many] = [&model, &always].map(|model| model.image(band, object_mm, &disc).image);
            assert!((few.x_mm - many.x_mm).hypot(few.y_mm - many.y_mm) < 1e-6, "{few:?} {many:?}");
        }
    }

    #[test]
    fn slopes_are_those_of_the_image() {
        const STEP_MM: f64 = 1e-4;
        // Clipped, displaced and off the axis.
        let clipped = table(|r| PointResponse {
            throughput: (0.2 * r).min(0.6),
            radial_deviation_mm: 0.05 * (3.0 - r).max(0.0),
            aberration_mm: 0.0,
        });
        let model = Model::new(&paper::instrument(), Some(clipped));
        let disc = Disc { diameter_mm: 0.4, slopes: [0.3, -0.2] };
        for centre_mm in [[1.2, 0.8, 280.0], [-0.4, 2.2, 320.0], [5.0, -4.0, 300.0]] {
            for band in [0, 1] {
                let found = model.image(band, centre_mm, &disc);
                for axis in 0..3 {
                    let at = |sign: f64| {
                        let mut moved_mm = centre_mm;
                        moved_mm[axis] += sign * STEP_MM;
                        model.image(band, moved_mm, &disc).image
                    };
                    let (a, b) = (at(-1.0), at(1.0));
                    let expected = [b.x_mm - a.x_mm, b.y_mm - a.y_mm].map(|change| change / (2.0 * STEP_MM));
                    for (slopes, expected) in found.slopes.iter().zip(expected) {
                        assert!((slopes[axis] - expected).abs() < 2e-3, "{centre_mm:?} {axis}: {found:?} {expected}");
                    }
                }
            }
        }
    }
}
