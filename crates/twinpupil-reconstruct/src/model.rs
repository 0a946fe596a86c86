//! The forward model that is inverted: where the image of a feature lies, given where the feature is.

use std::sync::OnceLock;

use twinpupil_instrument::{ImagePoint, Instrument, Projection, ResponseTable};

/// First-order projections of all bands, and how the lens departs from them. The telecentric band comes first, then the
/// entocentric one, then the others, if there are any.
#[derive(Debug, Clone)]
pub(crate) struct Model {
    projections: Vec<Projection>,
    /// Indices of the bands in the table.
    bands: Vec<usize>,
    table: Option<ResponseTable>,
}

/// Where the centroid of a round feature's light falls on the sensor in the telecentric and the entocentric band.
pub(crate) type ImagePair = [ImagePoint; 2];

impl Model {
    pub(crate) fn new(instrument: &Instrument, table: Option<ResponseTable>) -> Self {
        let bands = instrument.bands_by_role();
        let projections = bands.iter().map(|band| instrument.projection(&instrument.bands[*band])).collect();
        Self { projections, bands, table }
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
        let z_mm = centre_mm[2];
        let slope = (projection.magnification(z_mm + DIFFERENCE_MM) - projection.magnification(z_mm - DIFFERENCE_MM))
            / (2.0 * DIFFERENCE_MM);
        let (mut light, mut moment) = (0.0, [0.0; 2]);
        for offset_mm in disc.nodes() {
            let point_mm: [f64; 3] = std::array::from_fn(|axis| centre_mm[axis] + offset_mm[axis]);
            let [x_mm, y_mm, z_mm] = point_mm;
            let chief = projection.image(point_mm);
            let (image, throughput) = match &self.table {
                Some(table) => table.image(self.bands[band], (x_mm * x_mm + y_mm * y_mm).sqrt(), z_mm, chief),
                None => (chief, 1.0),
            };
            let magnification = projection.magnification(z_mm);
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
    /// Points spread over the disc, relative to its centre, mm. Their second moments are the disc's.
    fn nodes(&self) -> impl Iterator<Item = [f64; 3]> + use<> {
        let [sx, sy] = self.slopes;
        // Two unit vectors in the surface: along the steepest slope, where the disc is foreshortened, and across it.
        let steepest = sx.hypot(sy);
        let (ux, uy) = if steepest > 0.0 { (sx / steepest, sy / steepest) } else { (1.0, 0.0) };
        let cos_tilt = 1.0 / 1.0_f64.hypot(steepest);
        let radius_mm = 0.5 * self.diameter_mm;
        unit_disc().iter().map(move |[u, v]| {
            let (along, across) = (radius_mm * u * cos_tilt, radius_mm * v);
            [along * ux - across * uy, along * uy + across * ux, along * steepest]
        })
    }
}

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
}
