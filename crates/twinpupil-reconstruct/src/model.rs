//! The forward model that is inverted: where the image of a feature lies, given where the feature is.

use twinpupil_instrument::{ImagePoint, Instrument, Projection, ResponseTable, Role};

/// First-order projections of the telecentric and the entocentric band, and how the lens departs from them.
#[derive(Debug, Clone)]
pub(crate) struct Model {
    projections: [Projection; 2],
    /// Indices of the two bands in the table.
    bands: [usize; 2],
    table: Option<ResponseTable>,
}

/// Where the centroid of a round feature's light falls on the sensor in the telecentric and the entocentric band.
pub(crate) type ImagePair = [ImagePoint; 2];

impl Model {
    pub(crate) fn new(instrument: &Instrument, table: Option<ResponseTable>) -> Self {
        let bands = [Role::Telecentric, Role::Entocentric].map(|role| instrument.band_index(role));
        Self { projections: instrument.projections(), bands, table }
    }

    /// First-order images of an object point.
    pub(crate) fn chief_images(&self, object_mm: [f64; 3]) -> ImagePair {
        self.projections.map(|projection| projection.image(object_mm))
    }

    /// Telecentric and entocentric magnification at a distance.
    pub(crate) fn magnifications(&self, z_mm: f64) -> [f64; 2] {
        self.projections.map(|projection| projection.magnification(z_mm))
    }

    /// Images of a round feature of a diameter, centred on an object point and facing the camera.
    ///
    /// Points of the feature near the axis lose part of their light to the other band's mask, and what is left of
    /// their blur is off-centre; the centroid of the whole is the mean of the points' centroids by their light.
    pub(crate) fn images(&self, object_mm: [f64; 3], diameter_mm: f64) -> ImagePair {
        let chief = self.chief_images(object_mm);
        let Some(table) = &self.table else { return chief };
        let [x_mm, y_mm, z_mm] = object_mm;
        let r_mm = x_mm.hypot(y_mm);
        if r_mm == 0.0 {
            return chief;
        }
        let direction = [x_mm / r_mm, y_mm / r_mm];
        std::array::from_fn(|role| {
            let magnification = self.projections[role].magnification(z_mm);
            let shift_mm = radial_shift_mm(table, self.bands[role], magnification, r_mm, z_mm, 0.5 * diameter_mm);
            ImagePoint {
                x_mm: chief[role].x_mm + shift_mm * direction[0],
                y_mm: chief[role].y_mm + shift_mm * direction[1],
            }
        })
    }
}

/// Rings and spokes of the quadrature over a feature; spokes cover one half, the other is its mirror image.
const RINGS: usize = 5;
const SPOKES: usize = 10;

/// How far the centroid of a disc of radius a at (r, z) lies outside its first-order image, along the radius, mm.
///
/// ```text
/// shift = ∫ w(ρ) [ m·(ξ − r) + δ(ρ) ξ/ρ ] dA / ∫ w(ρ) dA        ξ: coordinate along r,  ρ: distance from the axis
/// ```
///
/// with the throughput w and the radial deviation δ of the table, over equal areas of the disc.
fn radial_shift_mm(
    table: &ResponseTable,
    band: usize,
    magnification: f64,
    r_mm: f64,
    z_mm: f64,
    radius_mm: f64,
) -> f64 {
    let (mut light, mut moment) = (0.0, 0.0);
    for ring in 0..RINGS {
        let a = radius_mm * ((ring as f64 + 0.5) / RINGS as f64).sqrt();
        for spoke in 0..SPOKES {
            let (sin, cos) = (std::f64::consts::PI * (spoke as f64 + 0.5) / SPOKES as f64).sin_cos();
            let (along, across) = (r_mm + a * cos, a * sin);
            let rho = along.hypot(across);
            let response = table.at(band, rho, z_mm);
            light += response.throughput;
            let outwards = if rho > 0.0 { along / rho } else { 0.0 };
            moment += response.throughput * (magnification * (along - r_mm) + response.radial_deviation_mm * outwards);
        }
    }
    if light > 0.0 { moment / light } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use twinpupil_instrument::{BandResponse, Grid, PointResponse, paper};

    fn table(response: impl Fn(f64) -> PointResponse) -> ResponseTable {
        let (r_mm, z_mm) = (Grid::spanning(0.0, 10.0, 401), Grid::spanning(240.0, 360.0, 2));
        let nodes: Vec<PointResponse> = (0..802).map(|n| response(r_mm.node(n % 401))).collect();
        let bands = ["red", "blue"].map(|band| BandResponse { band: band.to_owned(), nodes: nodes.clone() });
        ResponseTable { r_mm, z_mm, bands: bands.to_vec() }
    }

    #[test]
    fn an_ideal_response_is_first_order() {
        let ideal = table(|_| PointResponse { throughput: 1.0, radial_deviation_mm: 0.0 });
        let model = Model::new(&paper::instrument(), Some(ideal));
        let object_mm = [3.0, -1.0, 280.0];
        for (image, chief) in model.images(object_mm, 1.0).into_iter().zip(model.chief_images(object_mm)) {
            assert!((image.x_mm - chief.x_mm).abs() < 1e-12 && (image.y_mm - chief.y_mm).abs() < 1e-12);
        }
    }

    #[test]
    fn linear_shading_moves_a_disc_by_a_quarter_of_its_radius_squared() {
        // ∫ (1 + g ξ) ξ dA / ∫ (1 + g ξ) dA = g a²/4 for a disc of radius a far from the axis.
        let shaded = table(|r| PointResponse { throughput: 0.1 * r, radial_deviation_mm: 0.0 });
        let model = Model::new(&paper::instrument(), Some(shaded));
        let object_mm = [8.0, 0.0, 300.0];
        let expected_mm = 0.51 * 0.25 * 0.25 / 8.0;
        let shift_mm = model.images(object_mm, 1.0)[0].x_mm - model.chief_images(object_mm)[0].x_mm;
        assert!((shift_mm / expected_mm - 1.0).abs() < 0.02, "{shift_mm} {expected_mm}");
    }
}
