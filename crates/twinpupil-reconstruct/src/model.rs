//! The forward model that is inverted: where the image of a feature lies, given where the feature is.

use std::sync::OnceLock;

use multiversion::multiversion;
use twinpupil_instrument::{Chief, ImagePoint, Instrument, Projection, ResponseTable};

use crate::response::{Local, Response, Slice};

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
        let mean = mean_over(nodes, projection, response, centre_mm, disc);
        if mean.light > 0.0 {
            DiscImage { uneven, ..mean.settled() }
        } else {
            DiscImage { uneven, ..self.chief_disc(band, centre_mm) }
        }
    }
}

/// Points of a disc, side by side.
const LANES: usize = 4;

/// One number of each.
type Lanes = [f64; LANES];

/// What chief rays and lens do at some points of a disc.
struct Levels {
    magnification: Lanes,
    magnification_slope: Lanes,
    shift: Lanes,
    shift_slope: Lanes,
    throughput: Lanes,
    deviation_mm: Lanes,
    throughput_slopes: [Lanes; 2],
    deviation_slopes: [Lanes; 2],
}

/// Sums over the points of a disc.
#[multiversion(targets("x86_64+avx2+fma"))]
fn mean_over(
    nodes: &[Nodes],
    projection: &Projection,
    response: Option<&Response>,
    centre_mm: [f64; 3],
    disc: &Disc,
) -> Mean {
    let axes = disc.axes();
    let [cx, cy] = projection.pupil_centre_mm;
    let level = Level::at(projection, response, centre_mm[2]);
    let mut sums = [[0.0_f64; LANES]; 12];
    for Nodes { places: [u, v], shares } in nodes {
        let (mut x, mut y, mut z, mut r) = ([0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for k in 0..LANES {
            x[k] = centre_mm[0] + u[k] * axes.along_mm[0] + v[k] * axes.across_mm[0];
            y[k] = centre_mm[1] + u[k] * axes.along_mm[1] + v[k] * axes.across_mm[1];
            z[k] = centre_mm[2] + u[k] * axes.along_mm[2];
            r[k] = (x[k] * x[k] + y[k] * y[k]).sqrt();
        }
        let at = match disc.slopes == [0.0; 2] {
            true => Levels::even(&level, &r),
            false => Levels::tilted(projection, response, &r, &z),
        };
        for k in 0..LANES {
            let (m, m_z, s, s_z) = (at.magnification[k], at.magnification_slope[k], at.shift[k], at.shift_slope[k]);
            let inverse_r = 1.0 / (r[k] + TINY);
            let towards = [x[k] * inverse_r, y[k] * inverse_r];
            // The image and its slopes: the first-order image q, moved along its own radius.
            let q = [m * x[k] + s * cx, m * y[k] + s * cy];
            let q_z = [m_z * x[k] + s_z * cx, m_z * y[k] + s_z * cy];
            let inverse_q = 1.0 / ((q[0] * q[0] + q[1] * q[1]).sqrt() + TINY);
            let (unit, turn) = ([q[0] * inverse_q, q[1] * inverse_q], at.deviation_mm[k] * inverse_q);
            let scale = 1.0 + turn;
            let [by_r, by_z] = [at.deviation_slopes[0][k], at.deviation_slopes[1][k]];
            // How much farther out the deviation takes the image, less what the turn of the radius already does.
            let outward = [
                by_r * towards[0] - turn * m * unit[0],
                by_r * towards[1] - turn * m * unit[1],
                by_z - turn * (q_z[0] * unit[0] + q_z[1] * unit[1]),
            ];
            let image = [q[0] * scale, q[1] * scale];
            // The light, and what it adds to the slopes of the moments.
            let across = x[k] * disc.slopes[0] + y[k] * disc.slopes[1];
            let area = shares[k] * m * (m + m_z * across);
            let light = area * at.throughput[k];
            let by_r = area * at.throughput_slopes[0][k];
            let light_slopes = [by_r * towards[0], by_r * towards[1], area * at.throughput_slopes[1][k]];
            sums[0][k] += light;
            sums[1][k] += light_slopes[0];
            sums[2][k] += light_slopes[1];
            sums[3][k] += light_slopes[2];
            sums[4][k] += light * image[0];
            sums[5][k] += light * image[1];
            sums[6][k] += light * (m * scale + unit[0] * outward[0]) + light_slopes[0] * image[0];
            sums[7][k] += light * (unit[0] * outward[1]) + light_slopes[1] * image[0];
            sums[8][k] += light * (q_z[0] * scale + unit[0] * outward[2]) + light_slopes[2] * image[0];
            sums[9][k] += light * (unit[1] * outward[0]) + light_slopes[0] * image[1];
            sums[10][k] += light * (m * scale + unit[1] * outward[1]) + light_slopes[1] * image[1];
            sums[11][k] += light * (q_z[1] * scale + unit[1] * outward[2]) + light_slopes[2] * image[1];
        }
    }
    let [light, lx, ly, lz, mx, my, xx, xy, xz, yx, yy, yz] = sums.map(|lanes| lanes.iter().sum::<f64>());
    Mean { light, light_slopes: [lx, ly, lz], moment: [mx, my], moment_slopes: [[xx, xy, xz], [yx, yy, yz]] }
}

impl Levels {
    /// At one distance and several radii.
    #[inline(always)]
    fn even(level: &Level<'_>, r_mm: &Lanes) -> Self {
        let mut levels = Self::of(&level.chief);
        if let Some(slice) = &level.slice {
            for (lane, r_mm) in r_mm.iter().enumerate() {
                levels.set_response(lane, &slice.at(*r_mm));
            }
        }
        levels
    }

    /// At several distances and radii.
    #[inline(always)]
    fn tilted(projection: &Projection, response: Option<&Response>, r_mm: &Lanes, z_mm: &Lanes) -> Self {
        let mut levels = Self::of(&projection.chief(z_mm[0]));
        for (lane, z_mm) in z_mm.iter().enumerate() {
            let chief = projection.chief(*z_mm);
            levels.magnification[lane] = chief.magnification;
            levels.magnification_slope[lane] = chief.magnification_slope;
            levels.shift[lane] = chief.shift;
            levels.shift_slope[lane] = chief.shift_slope;
        }
        if let Some(response) = response {
            for (lane, (r_mm, z_mm)) in r_mm.iter().zip(z_mm).enumerate() {
                levels.set_response(lane, &response.slice(*z_mm).at(*r_mm));
            }
        }
        levels
    }

    /// The same chief rays everywhere, behind an ideal lens.
    #[inline(always)]
    fn of(chief: &Chief) -> Self {
        Self {
            magnification: [chief.magnification; LANES],
            magnification_slope: [chief.magnification_slope; LANES],
            shift: [chief.shift; LANES],
            shift_slope: [chief.shift_slope; LANES],
            throughput: [1.0; LANES],
            deviation_mm: [0.0; LANES],
            throughput_slopes: [[0.0; LANES]; 2],
            deviation_slopes: [[0.0; LANES]; 2],
        }
    }

    #[inline(always)]
    fn set_response(&mut self, lane: usize, local: &Local) {
        self.throughput[lane] = local.throughput;
        self.deviation_mm[lane] = local.radial_deviation_mm;
        for axis in 0..2 {
            self.throughput_slopes[axis][lane] = local.throughput_slopes[axis];
            self.deviation_slopes[axis][lane] = local.deviation_slopes[axis];
        }
    }
}

/// Distances that are none, mm.
const TINY: f64 = 1e-12;

/// What chief rays and lens do at one distance.
#[derive(Clone, Copy)]
struct Level<'a> {
    chief: Chief,
    slice: Option<Slice<'a>>,
}

impl<'a> Level<'a> {
    #[inline(always)]
    fn at(projection: &Projection, response: Option<&'a Response>, z_mm: f64) -> Self {
        Self { chief: projection.chief(z_mm), slice: response.map(|response| response.slice(z_mm)) }
    }
}

/// Sums over a disc of its points' images, weighted by their light.
#[derive(Debug, Clone, Copy)]
struct Mean {
    light: f64,
    light_slopes: [f64; 3],
    moment: [f64; 2],
    moment_slopes: [[f64; 3]; 2],
}

impl Mean {
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

/// Points that each stand for a part of the unit disc, and those parts' shares of its area.
struct Nodes {
    places: [Lanes; 2],
    shares: Lanes,
}

/// Axes in the surface of a disc, as long as its radius, mm.
struct Axes {
    along_mm: [f64; 3],
    across_mm: [f64; 2],
}

impl Disc {
    /// Along the steepest slope, where the disc is foreshortened, and across it.
    #[inline]
    fn axes(&self) -> Axes {
        let [sx, sy] = self.slopes;
        let steepest = (sx * sx + sy * sy).sqrt();
        let (ux, uy) = if steepest > 0.0 { (sx / steepest, sy / steepest) } else { (1.0, 0.0) };
        let radius_mm = 0.5 * self.diameter_mm;
        let along_mm = radius_mm / (1.0 + steepest * steepest).sqrt();
        Axes {
            along_mm: [along_mm * ux, along_mm * uy, along_mm * steepest],
            across_mm: [-radius_mm * uy, radius_mm * ux],
        }
    }
}

/// Four points that stand for the unit disc: the mean over them is that over the disc of every cubic function.
const EVEN_NODES: [Nodes; 1] = {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    [Nodes { places: [[half, 0.0, -half, 0.0], [0.0, half, 0.0, -half]], shares: [0.25; LANES] }]
};

/// Points for where the light changes unevenly: three rings, by Gauss and Legendre in the square of the radius.
fn uneven_nodes() -> &'static [Nodes] {
    const SPOKES: usize = 8;
    static NODES: OnceLock<Vec<Nodes>> = OnceLock::new();
    NODES.get_or_init(|| {
        let off = 0.5 * 0.6_f64.sqrt();
        let rings = [(0.5 - off, 5.0 / 18.0, 0.5), (0.5, 8.0 / 18.0, 0.0), (0.5 + off, 5.0 / 18.0, 0.5)];
        let part = |(radius2, share, turn): (f64, f64, f64), first: usize| {
            let angle = |k: usize| std::f64::consts::TAU * ((first + k) as f64 + turn) / SPOKES as f64;
            let along = |of: fn(f64) -> f64| std::array::from_fn(|k| radius2.sqrt() * of(angle(k)));
            Nodes { places: [along(f64::cos), along(f64::sin)], shares: [share / SPOKES as f64; LANES] }
        };
        rings.into_iter().flat_map(|ring| [part(ring, 0), part(ring, LANES)]).collect()
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
            ground_centre_mm: [0.0; 2],
        };
        let image_radius_mm = Grid::spanning(0.0, 10.0, 2);
        ResponseTable { r_mm, z_mm, image_radius_mm, bands: ["red", "blue"].map(band).to_vec() }
    }

    #[test]
    fn an_ideal_response_is_first_order() {
        let ideal = table(|_| PointResponse { throughput: 1.0, ..PointResponse::default() });
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
        let shaded = table(|r| PointResponse { throughput: 0.1 * r, ..PointResponse::default() });
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
        let clipped =
            table(|r| PointResponse { throughput: bent(r), radial_deviation_mm: 0.01, ..PointResponse::default() });
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
            ..PointResponse::default()
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
