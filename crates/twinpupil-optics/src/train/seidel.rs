//! Aberrations of third order, surface by surface.

use std::ops::Add;

use super::Train;
use super::face::{Action, Face, Profile};
use twinpupil_instrument::{ParaxialRay, paraxial_rays};

/// Seidel sums of a surface or of a lens, mm: wavefront aberrations are S_I/8 at the rim of the pupil and so on, of a
/// wavefront that is late.
///
/// ```text
/// A = n i,  Ā = n ī,  H = n (u ȳ − ū y),  P = c Δ(1/n)
/// S_I = −A² y Δ(u/n)     S_II = −A Ā y Δ(u/n)     S_III = −Ā² y Δ(u/n)     S_IV = −H² P
/// S_V = −Ā [Ā² y Δ(1/n²) + (H − Ā y) ȳ P], which is Ā (S_III + S_IV)/A
/// ```
///
/// and of an asphere, whose depth is G r⁴ beyond that of a sphere, with q = 8 G Δn y⁴, `q, q ȳ/y, q ȳ²/y², 0, q ȳ³/y³`
/// [Welford, Aberrations of Optical Systems, ch. 8]. Ideal lenses and Fresnel surfaces have none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SeidelSums {
    /// S_I.
    pub spherical_mm: f64,
    /// S_II.
    pub coma_mm: f64,
    /// S_III.
    pub astigmatism_mm: f64,
    /// S_IV, that of Petzval.
    pub field_curvature_mm: f64,
    /// S_V.
    pub distortion_mm: f64,
}

/// Chromatic sums of a surface or of a lens between two wavelengths, mm.
///
/// ```text
/// C_I = A y Δ(δn/n)     C_II = Ā y Δ(δn/n)        [Welford, sec. 10.2]
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ChromaticSums {
    /// C_I: axial colour.
    pub axial_mm: f64,
    /// C_II: lateral colour.
    pub lateral_mm: f64,
}

impl Add for SeidelSums {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            spherical_mm: self.spherical_mm + other.spherical_mm,
            coma_mm: self.coma_mm + other.coma_mm,
            astigmatism_mm: self.astigmatism_mm + other.astigmatism_mm,
            field_curvature_mm: self.field_curvature_mm + other.field_curvature_mm,
            distortion_mm: self.distortion_mm + other.distortion_mm,
        }
    }
}

impl Add for ChromaticSums {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { axial_mm: self.axial_mm + other.axial_mm, lateral_mm: self.lateral_mm + other.lateral_mm }
    }
}

/// A marginal and a chief ray through one surface. Indices are negative behind an odd number of mirrors.
struct Passage<'a> {
    face: &'a Face,
    indices: [f64; 2],
    /// y, ȳ.
    heights_mm: [f64; 2],
    /// u and u', then ū and ū'.
    slopes: [[f64; 2]; 2],
}

impl Train {
    /// Seidel sums of every surface of the lens, for a marginal and a chief ray in front of the first.
    pub fn seidel(&self, marginal: ParaxialRay, chief: ParaxialRay) -> Vec<SeidelSums> {
        self.passages([marginal, chief]).iter().map(Passage::seidel).collect()
    }

    /// Surfaces of the lens whose flat facets have no sums of third order: [`Train::seidel`] has none of them.
    pub fn flat_lenses(&self) -> Vec<usize> {
        let is_flat = |face: &&Face| matches!(face.profile, Profile::Fresnel(_) | Profile::Facets(_));
        self.lens_faces().filter(is_flat).map(|face| face.index).collect()
    }

    /// Chromatic sums of every surface of the lens between the wavelengths of `shorter` and `longer`, which are the same
    /// lens, for a marginal and a chief ray in front of the first.
    pub fn chromatic(
        &self,
        shorter: &Self,
        longer: &Self,
        marginal: ParaxialRay,
        chief: ParaxialRay,
    ) -> Vec<ChromaticSums> {
        let passages = self.passages([marginal, chief]);
        let colours = shorter.lens_faces().zip(longer.lens_faces());
        let sums = passages.iter().zip(colours).map(|(passage, (shorter, longer))| {
            let dispersion = [
                (shorter.index_before - longer.index_before) / passage.face.index_before,
                (shorter.index_behind - longer.index_behind) / passage.face.index_behind,
            ];
            passage.chromatic(dispersion[1] - dispersion[0])
        });
        sums.collect()
    }

    fn passages(&self, rays: [ParaxialRay; 2]) -> Vec<Passage<'_>> {
        let surfaces = self.paraxial_surfaces();
        let first_index = self.lens_faces().next().map_or(1.0, |face| face.index_before);
        let met = rays.map(|ray| paraxial_rays(&surfaces, first_index, ray));
        let passage = |(k, face): (usize, _)| {
            let before = |j: usize| k.checked_sub(1).map_or(rays[j].slope, |previous| met[j][previous].slope);
            Passage {
                face,
                indices: [k.checked_sub(1).map_or(first_index, |i| surfaces[i].index_behind), surfaces[k].index_behind],
                heights_mm: [met[0][k].height_mm, met[1][k].height_mm],
                slopes: [0, 1].map(|j| [before(j), met[j][k].slope]),
            }
        };
        self.lens_faces().enumerate().map(passage).collect()
    }
}

impl Passage<'_> {
    /// A and Ā.
    fn incidences(&self) -> [f64; 2] {
        let c = self.face.vertex_curvature_per_mm();
        [0, 1].map(|j| self.indices[0] * (self.slopes[j][0] + self.heights_mm[j] * c))
    }

    fn seidel(&self) -> SeidelSums {
        let is_flat_lens = matches!(self.face.profile, Profile::Fresnel(_) | Profile::Facets(_));
        if is_flat_lens || matches!(self.face.action, Action::ThinLens { .. }) {
            return SeidelSums::default();
        }
        let ([n, n_behind], [y, y_chief]) = (self.indices, self.heights_mm);
        let [a, a_chief] = self.incidences();
        let [[u, u_behind], [u_chief, _]] = self.slopes;
        let invariant = n * (u * y_chief - u_chief * y);
        let bending = u_behind / n_behind - u / n;
        let petzval = self.face.vertex_curvature_per_mm() * (1.0 / n_behind - 1.0 / n);
        let square = 1.0 / (n_behind * n_behind) - 1.0 / (n * n);
        let sphere = SeidelSums {
            spherical_mm: -a * a * y * bending,
            coma_mm: -a * a_chief * y * bending,
            astigmatism_mm: -a_chief * a_chief * y * bending,
            field_curvature_mm: -invariant * invariant * petzval,
            distortion_mm: -a_chief * (a_chief * a_chief * y * square + (invariant - a_chief * y) * y_chief * petzval),
        };
        let q = 8.0 * self.face.fourth_order_per_mm3() * (n_behind - n);
        sphere
            + SeidelSums {
                spherical_mm: q * y.powi(4),
                coma_mm: q * y.powi(3) * y_chief,
                astigmatism_mm: q * y * y * y_chief * y_chief,
                field_curvature_mm: 0.0,
                distortion_mm: q * y * y_chief.powi(3),
            }
    }

    /// With Δ(δn/n).
    fn chromatic(&self, dispersion: f64) -> ChromaticSums {
        let [a, a_chief] = self.incidences();
        let y = self.heights_mm[0];
        ChromaticSums { axial_mm: a * y * dispersion, lateral_mm: a_chief * y * dispersion }
    }
}

impl Face {
    /// G: what the r⁴ of the depth is beyond that of a sphere of the same curvature at the vertex, 1/mm³.
    fn fourth_order_per_mm3(&self) -> f64 {
        match &self.profile {
            Profile::Plane | Profile::Sphere { .. } | Profile::Cylinder { .. } => 0.0,
            Profile::Fresnel(_) | Profile::Facets(_) => 0.0,
            Profile::Conic { c, k } => k * c.powi(3) / 8.0,
            Profile::Asphere(polynomial) => {
                polynomial.fourth_order_per_mm3() - self.vertex_curvature_per_mm().powi(3) / 8.0
            }
        }
    }
}
