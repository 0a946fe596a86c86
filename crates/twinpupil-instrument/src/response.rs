//! How a real lens departs from first order, as a plain table: the optics make it, the reconstruction inverts it.

use std::ops::{Add, Mul};

use serde::{Deserialize, Serialize};

use crate::{ImagePoint, Projection};

/// Equally spaced nodes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// First node.
    pub start: f64,
    /// Distance from node to node.
    pub step: f64,
    /// Number of nodes, at least two.
    pub count: usize,
}

impl Grid {
    /// `count` nodes from `start` to `end`.
    pub fn spanning(start: f64, end: f64, count: usize) -> Self {
        let count = count.max(2);
        Self { start, step: (end - start) / (count - 1) as f64, count }
    }

    /// Position of node `index`.
    pub fn node(&self, index: usize) -> f64 {
        self.start + self.step * index as f64
    }

    /// Cell and fraction within it; positions outside belong to the nearest cell, at its nearest edge.
    #[inline]
    pub fn locate(&self, position: f64) -> (usize, f64) {
        let last = (self.count - 1) as f64;
        let index = ((position - self.start) / self.step).clamp(0.0, last);
        let cell = (index as usize).min(self.count - 2);
        (cell, index - cell as f64)
    }
}

/// What reaches the sensor from one object point through one band.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PointResponse {
    /// Light that arrives, relative to the unclipped pupil.
    pub throughput: f64,
    /// Radius of the centroid of its image less the radius of the first-order image, mm.
    pub radial_deviation_mm: f64,
    /// How much farther out than an ideal lens of the band's focal length the lens images the point through the whole pupil,
    /// mm: a mean in which rays count as pixels see them, and nothing is clipped.
    pub aberration_mm: f64,
    /// How its light is spread about that centroid.
    pub spread: PointSpread,
}

/// How the light of an object point is spread, beyond the even disc behind an ideal lens: what its lens adds to where light
/// through the point w of the unit pupil arrives, along the radius of the image, x, and across it, y.
///
/// ```text
/// x: −(growth + stretch) w_x + a w_x² + b w_y² − spherical (w² − ⅔) w_x
/// y: −(growth − stretch) w_y + c w_x w_y       − spherical (w² − ⅔) w_y
/// ```
///
/// An ideal lens images w at −B w, B being the radius of the disc, negative in front of the focus or behind it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PointSpread {
    /// What is added to the radius of the disc, mm.
    pub growth_mm: f64,
    /// Astigmatism: what is added to it along the radius of the image, and taken from it across that, mm.
    pub stretch_mm: f64,
    /// Coma: a, b and c, mm.
    pub coma_mm: [f64; 3],
    /// Spherical aberration, mm.
    pub spherical_mm: f64,
    /// Growth of its light from the middle of the pupil to the end along x, relative.
    pub light_growth: f64,
    /// How much less light pixels get there of an even surface than on the axis, through the whole pupil, relative.
    pub falloff: f64,
    /// What these terms leave of where light through the pupil arrives, root mean square along x and across it, mm.
    pub left_mm: f64,
}

impl Add for PointSpread {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            growth_mm: self.growth_mm + other.growth_mm,
            stretch_mm: self.stretch_mm + other.stretch_mm,
            coma_mm: [0, 1, 2].map(|k| self.coma_mm[k] + other.coma_mm[k]),
            spherical_mm: self.spherical_mm + other.spherical_mm,
            light_growth: self.light_growth + other.light_growth,
            falloff: self.falloff + other.falloff,
            left_mm: self.left_mm + other.left_mm,
        }
    }
}

impl Mul<f64> for PointSpread {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self {
            growth_mm: self.growth_mm * factor,
            stretch_mm: self.stretch_mm * factor,
            coma_mm: self.coma_mm.map(|mm| mm * factor),
            spherical_mm: self.spherical_mm * factor,
            light_growth: self.light_growth * factor,
            falloff: self.falloff * factor,
            left_mm: self.left_mm * factor,
        }
    }
}

/// One band of a [`ResponseTable`]: values over distance (slow) and radius (fast).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BandResponse {
    /// Name of the band.
    pub band: String,
    /// Focal length of the lens at the band's wavelength, mm.
    pub focal_length_mm: f64,
    /// Values at z node `k`, r node `i` stand at index `k · r_mm.count + i`.
    pub nodes: Vec<PointResponse>,
    /// Light on the sensor from an evenly bright ground, relative to the unclipped pupil, at the nodes of
    /// `image_radius_mm` from `ground_centre_mm`, about which the masks shade it, at whatever distance it lies.
    pub ground: Vec<f64>,
    /// Image point whose rays through the middle of the pupil meet the middle of the mask that shades it: that of the axis
    /// unless masks are off it.
    pub ground_centre_mm: [f64; 2],
}

/// Throughput and image displacement of object points over (r, z), for every band, about the optical axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResponseTable {
    /// Distance from the axis in object space, mm.
    pub r_mm: Grid,
    /// Distance from the lens, mm.
    pub z_mm: Grid,
    /// Distance on the ideal image plane from the middle of a band's shade, mm.
    pub image_radius_mm: Grid,
    /// In the order of the instrument's bands.
    pub bands: Vec<BandResponse>,
}

impl ResponseTable {
    /// Response of a band to a point at (r, z), bilinear between nodes and held constant outside.
    pub fn at(&self, band: usize, r_mm: f64, z_mm: f64) -> PointResponse {
        let corners = self.corners(band, r_mm, z_mm);
        let blend = |value: fn(&PointResponse) -> f64| corners.iter().map(|(node, weight)| weight * value(node)).sum();
        PointResponse {
            throughput: blend(|node| node.throughput),
            radial_deviation_mm: blend(|node| node.radial_deviation_mm),
            aberration_mm: blend(|node| node.aberration_mm),
            spread: corners.iter().fold(PointSpread::default(), |sum, (node, weight)| sum + node.spread * *weight),
        }
    }

    /// The nodes about (r, z) and their weights.
    #[inline]
    fn corners(&self, band: usize, r_mm: f64, z_mm: f64) -> [(&PointResponse, f64); 4] {
        let ((i, fr), (k, fz)) = (self.r_mm.locate(r_mm), self.z_mm.locate(z_mm));
        let start = k * self.r_mm.count + i;
        let (near, far) = (start, start + self.r_mm.count);
        let nodes = &self.bands[band].nodes;
        [
            (&nodes[near], (1.0 - fz) * (1.0 - fr)),
            (&nodes[near + 1], (1.0 - fz) * fr),
            (&nodes[far], fz * (1.0 - fr)),
            (&nodes[far + 1], fz * fr),
        ]
    }

    /// Light of an evenly bright ground at a distance from the middle of its shade, linear between nodes.
    pub fn ground(&self, band: usize, image_radius_mm: f64) -> f64 {
        let (i, fraction) = self.image_radius_mm.locate(image_radius_mm);
        let ground = &self.bands[band].ground;
        ground[i] + fraction * (ground[i + 1] - ground[i])
    }

    /// Distance from the middle of its shade beyond which the ground is not shaded, mm.
    pub fn ground_clear_mm(&self, band: usize) -> f64 {
        let last_shaded = self.bands[band].ground.iter().rposition(|light| *light != 1.0);
        last_shaded.map_or(0.0, |node| self.image_radius_mm.node(node + 1))
    }

    /// The image of a band at (r, z) and its throughput: the first-order image moved along its own radius.
    #[inline]
    pub fn image(&self, band: usize, r_mm: f64, z_mm: f64, first_order: ImagePoint) -> (ImagePoint, f64) {
        let (mut throughput, mut radial_deviation_mm) = (0.0, 0.0);
        for (node, weight) in self.corners(band, r_mm, z_mm) {
            throughput += weight * node.throughput;
            radial_deviation_mm += weight * node.radial_deviation_mm;
        }
        let radius_mm = (first_order.x_mm.powi(2) + first_order.y_mm.powi(2)).sqrt();
        let scale = if radius_mm > 0.0 { 1.0 + radial_deviation_mm / radius_mm } else { 1.0 };
        (ImagePoint { x_mm: first_order.x_mm * scale, y_mm: first_order.y_mm * scale }, throughput)
    }
}

/// The most of what a lens adds to first order in a band, in two numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LensTerms {
    /// How much farther away objects seem, mm: by where the band's front principal plane is.
    pub farther_mm: f64,
    /// Distortion: an image at p lies farther out by this times p³, 1/mm².
    pub cubic_per_mm2: f64,
}

impl ResponseTable {
    /// The terms that come nearest to what the lens adds to the images of a band, as far as `image_radius_mm` from the axis.
    ///
    /// ```text
    /// a(r, z) = farther m′ r + cubic (m r)³
    /// ```
    pub fn lens_terms(&self, band: usize, projection: &Projection, image_radius_mm: f64) -> LensTerms {
        let (mut normal, mut right, mut steepest) = ([[0.0; 2]; 2], [0.0; 2], 0.0);
        for (index, node) in self.bands[band].nodes.iter().enumerate() {
            let (r_mm, z_mm) = (self.r_mm.node(index % self.r_mm.count), self.z_mm.node(index / self.r_mm.count));
            let chief = projection.chief(z_mm);
            let p_mm = chief.magnification * r_mm;
            if p_mm.abs() <= image_radius_mm && node.throughput > 0.0 {
                let basis = [chief.magnification_slope * r_mm, p_mm.powi(3)];
                steepest += (p_mm / z_mm).powi(2);
                for (row, own) in basis.iter().enumerate() {
                    right[row] += own * node.aberration_mm;
                    basis.iter().zip(&mut normal[row]).for_each(|(other, sum)| *sum += own * other);
                }
            }
        }
        let [[a, b], [_, d]] = normal;
        let determinant = a * d - b * b;
        // Where images hardly depend on the distance, only the distortion is left.
        if a > 0.01 * steepest && determinant > 1e-6 * a * d {
            return LensTerms {
                farther_mm: (right[0] * d - b * right[1]) / determinant,
                cubic_per_mm2: (a * right[1] - b * right[0]) / determinant,
            };
        }
        LensTerms { farther_mm: 0.0, cubic_per_mm2: if d > 0.0 { right[1] / d } else { 0.0 } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shift_and_a_distortion_are_told_apart() {
        let projection = Projection {
            focal_length_mm: 100.0,
            sensor_distance_mm: 151.0,
            pupil_position_mm: 0.0,
            pupil_centre_mm: [0.0; 2],
            pupil_radius_mm: 1.0,
        };
        let (r_mm, z_mm) = (Grid::spanning(0.0, 8.0, 33), Grid::spanning(250.0, 350.0, 11));
        let node = |n: usize| {
            let (r, z) = (r_mm.node(n % 33), z_mm.node(n / 33));
            let chief = projection.chief(z);
            let aberration_mm = 0.4 * chief.magnification_slope * r - 2e-5 * (chief.magnification * r).powi(3);
            PointResponse {
                throughput: 1.0,
                radial_deviation_mm: aberration_mm,
                aberration_mm,
                ..PointResponse::default()
            }
        };
        let band = BandResponse {
            band: "a".to_owned(),
            focal_length_mm: 100.0,
            nodes: (0..33 * 11).map(node).collect(),
            ground: vec![1.0; 2],
            ground_centre_mm: [0.0; 2],
        };
        let table = ResponseTable { r_mm, z_mm, image_radius_mm: Grid::spanning(0.0, 2.0, 2), bands: vec![band] };
        let terms = table.lens_terms(0, &projection, 3.0);
        assert!((terms.farther_mm - 0.4).abs() < 1e-9 && (terms.cubic_per_mm2 + 2e-5).abs() < 1e-12, "{terms:?}");
    }

    #[test]
    fn a_bilinear_function_is_interpolated_exactly() {
        let (r_mm, z_mm) = (Grid::spanning(0.0, 4.0, 5), Grid::spanning(100.0, 200.0, 3));
        let deviation = |r: f64, z: f64| 0.5 + 2.0 * r - 0.01 * z + 0.003 * r * z;
        let nodes = (0..15)
            .map(|n| PointResponse {
                throughput: 1.0,
                radial_deviation_mm: deviation(r_mm.node(n % 5), z_mm.node(n / 5)),
                ..PointResponse::default()
            })
            .collect();
        let image_radius_mm = Grid::spanning(0.0, 2.0, 3);
        let band = BandResponse {
            band: "a".to_owned(),
            focal_length_mm: 100.0,
            nodes,
            ground: vec![0.0, 0.5, 1.0],
            ground_centre_mm: [0.0; 2],
        };
        let table = ResponseTable { r_mm, z_mm, image_radius_mm, bands: vec![band] };
        assert_eq!((table.ground(0, 0.5), table.ground(0, 9.0)), (0.25, 1.0));
        assert_eq!(table.ground_clear_mm(0), 2.0);
        for (r, z) in [(0.0, 100.0), (1.3, 111.0), (4.0, 200.0), (3.99, 150.0)] {
            assert!((table.at(0, r, z).radial_deviation_mm - deviation(r, z)).abs() < 1e-12);
        }
        assert_eq!(table.at(0, 9.0, 300.0), table.at(0, 4.0, 200.0));
        assert_eq!(table.at(0, -1.0, 0.0), table.at(0, 0.0, 100.0));
    }
}
