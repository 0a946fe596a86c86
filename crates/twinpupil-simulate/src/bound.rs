//! The Cramér–Rao bound: how well the best of all estimators could locate the dots of one frame.

use std::collections::BTreeMap;

use rayon::prelude::*;
use twinpupil_instrument::{Instrument, ResponseMatrix, Sensor};
use twinpupil_optics::Camera;

use crate::render::{Renderer, Workspace};
use crate::scene::Scene;
use crate::sensitivity::{SHARED, Sensitivity, UNKNOWNS};
use crate::simulate::{SimulateError, expected_electrons};

/// Share of its information that an unknown must keep once all others before it are unknown too; what is left of one
/// that the frame says nothing about is rounding.
const PIVOT_MIN: f64 = 1e-11;

/// The smallest covariance that an unbiased estimator of a dot's position can have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound {
    /// Covariance of x, y and z, mm².
    pub covariance_mm2: [[f64; 3]; 3],
}

impl Bound {
    /// Smallest standard deviations of x, y and z, mm.
    pub fn std_mm(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.covariance_mm2[axis][axis].sqrt())
    }
}

/// What one frame of a scene tells about its dots: their Fisher information.
///
/// The unknowns of a dot are x, y, z and its diameter, and in every band its brightness and the ground around it: eight
/// for two bands. The way a dot leans is known, and it keeps it when it is moved. The noise of a pixel is that of its
/// photons, of reading and of rounding to codes:
///
/// ```text
/// J = Σ_pixels ∂E ∂Eᵀ / (E + σ_read² + e²/12)        e electrons per code, E expected electrons
/// covariance ≥ J⁻¹
/// ```
///
/// S. M. Kay, "Fundamentals of Statistical Signal Processing: Estimation Theory" (1993), Section 3.9. Pixels that are
/// expected to reach the full well tell nothing. A band is read in its own plane alone; what crosstalk puts there adds
/// to the noise but counts as known. Dots that hide one another count as if they did not, and a picture counts as known.
#[derive(Debug, Clone)]
pub struct DotInformation {
    bands: usize,
    /// Whether each dot is seen, and wholly on the sensor, in every band.
    is_whole: Vec<bool>,
    /// Information about the unknowns of dots `i ≤ j` whose images overlap, and of every dot with itself.
    blocks: BTreeMap<(usize, usize), Block>,
    /// For every dot the others whose images overlap its own in some band.
    neighbours: Vec<Vec<usize>>,
}

/// Information about the unknowns of one dot, by row, and of another, by column.
type Block = Vec<Vec<f64>>;

/// The smallest covariance that any unbiased estimator can reach for every dot of a scene from one frame of it, in the
/// order of [`Scene::dots`]; `None` for dots that are not wholly on the sensor in every band, or without light.
///
/// Each dot shares its pixels with those whose images overlap its own, and their unknowns are unknown too. This is
/// [`DotInformation::joint_bound`] for every dot, where the rest is said.
pub fn dot_bounds(
    instrument: &Instrument,
    scene: &Scene,
    response: &ResponseMatrix,
    pupil_samples: usize,
) -> Result<Vec<Option<Bound>>, SimulateError> {
    let information = DotInformation::new(instrument, scene, response, pupil_samples)?;
    Ok((0..scene.dots().len()).into_par_iter().map(|dot| information.joint_bound(dot)).collect())
}

impl DotInformation {
    /// Renders the derivatives of all pixels by all unknowns and adds up what they tell.
    ///
    /// `pupil_samples` is the number of rays for every pixel and band, 1 to 65536. The bounds are those of the frames
    /// that [`simulate`](crate::simulate) renders with as many rays, whose edges are wider the fewer these are: from
    /// 256 rays to 1024 the bounds of the paper's dots fall by 0.1 to 0.8 %.
    /// Errors are those of [`expected_electrons`].
    pub fn new(
        instrument: &Instrument,
        scene: &Scene,
        response: &ResponseMatrix,
        pupil_samples: usize,
    ) -> Result<Self, SimulateError> {
        let pages = expected_electrons(instrument, scene, response, pupil_samples, &|_| {})?.pages;
        let precision: Vec<_> = pages.iter().map(|page| precision(&instrument.sensor, page)).collect();
        let camera = Camera::new(instrument)?;
        let renderer = |registration| Renderer::new(instrument, &camera, scene, pupil_samples, 0, registration);
        let planes: Vec<_> = (instrument.bands.iter().enumerate())
            .map(|(band, stated)| Plane::new(&renderer(stated.registration), instrument, response, band, &precision))
            .collect();
        Ok(Self::of_planes(&planes, scene.dots().len(), instrument.sensor.size_px[0]))
    }

    fn of_planes(planes: &[Plane<'_>], dots: usize, width_px: usize) -> Self {
        let is_whole = (0..dots).map(|id| planes.iter().all(|plane| plane.is_whole(id))).collect();
        let neighbours: Vec<Vec<usize>> = (0..dots)
            .into_par_iter()
            .map(|id| (0..dots).filter(|&other| planes.iter().any(|plane| plane.overlap(id, other))).collect())
            .collect();
        let pairs: Vec<_> = neighbours
            .iter()
            .enumerate()
            .flat_map(|(id, others)| others.iter().filter(move |&&other| other > id).map(move |&other| (id, other)))
            .chain((0..dots).map(|id| (id, id)))
            .collect();
        let block = |pair: (usize, usize)| (pair, block(planes, pair, width_px));
        Self {
            bands: planes.len(),
            is_whole,
            blocks: pairs.into_par_iter().map(block).collect::<Vec<_>>().into_iter().collect(),
            neighbours,
        }
    }

    /// The bound of a dot, if all about the others is known; `None` if it is not wholly on the sensor in every band,
    /// or without light, or has no such index.
    pub fn lone_bound(&self, dot: usize) -> Option<Bound> {
        self.bound(&[dot])
    }

    /// The bound of a dot, if all about those is unknown too whose images overlap its own, and all else is known;
    /// `None` like [`DotInformation::lone_bound`].
    pub fn joint_bound(&self, dot: usize) -> Option<Bound> {
        let unknown: Vec<usize> = std::iter::once(dot).chain(self.neighbours.get(dot)?.iter().copied()).collect();
        self.bound(&unknown)
    }

    /// The others whose images overlap that of a dot in some band; none if it has no such index.
    pub fn neighbours(&self, dot: usize) -> &[usize] {
        self.neighbours.get(dot).map_or(&[], Vec::as_slice)
    }

    /// The bound of the first of `dots`, of which all is unknown.
    fn bound(&self, dots: &[usize]) -> Option<Bound> {
        self.is_whole.get(dots[0]).filter(|whole| **whole)?;
        let mut information = self.assembled(dots);
        let own: Vec<f64> = (0..information.len()).map(|k| information[k][k]).collect();
        for k in (3..information.len()).rev() {
            eliminate(&mut information, k, PIVOT_MIN * own[k]);
        }
        inverse(std::array::from_fn(|i| std::array::from_fn(|j| information[i][j])), [own[0], own[1], own[2]])
            .map(|covariance_mm2| Bound { covariance_mm2 })
    }

    /// Information about all unknowns of `dots`, one dot after the other.
    fn assembled(&self, dots: &[usize]) -> Vec<Vec<f64>> {
        let unknowns = unknowns(self.bands);
        let mut all = vec![vec![0.0; unknowns * dots.len()]; unknowns * dots.len()];
        for (i, &first) in dots.iter().enumerate() {
            for (j, &second) in dots.iter().enumerate() {
                let Some(block) = self.blocks.get(&(first.min(second), first.max(second))) else { continue };
                for k in 0..unknowns {
                    for l in 0..unknowns {
                        let value = if first <= second { block[k][l] } else { block[l][k] };
                        all[i * unknowns + k][j * unknowns + l] = value;
                    }
                }
            }
        }
        all
    }
}

/// Number of unknowns of a dot.
fn unknowns(bands: usize) -> usize {
    SHARED + (UNKNOWNS - SHARED) * bands
}

/// Unknown of a dot that is unknown `k` of a band.
fn unknown(band: usize, k: usize) -> usize {
    if k < SHARED { k } else { k + (UNKNOWNS - SHARED) * band }
}

/// The plane of a band, with how its pixels answer to every dot.
struct Plane<'a> {
    /// 1/variance of the pixels of its page.
    precision: &'a [f64],
    dots: Vec<Option<Sensitivity>>,
}

impl<'a> Plane<'a> {
    fn new(
        renderer: &Renderer<'_>,
        instrument: &Instrument,
        response: &ResponseMatrix,
        band: usize,
        precision: &'a [Vec<f64>],
    ) -> Self {
        let stated = &instrument.bands[band];
        let response = response.of_plane(&stated.plane).get(band).copied().unwrap_or(0.0);
        let site = instrument.site(stated);
        let dots = renderer
            .patches(band, site)
            .into_par_iter()
            .enumerate()
            .map_init(Workspace::default, |workspace, (id, patch)| {
                patch.map(|patch| renderer.sensitivity(band, id, patch, response, workspace))
            });
        Self { precision: &precision[site.page], dots: dots.collect() }
    }

    fn is_whole(&self, id: usize) -> bool {
        self.dots[id].as_ref().is_some_and(|dot| dot.is_whole)
    }

    fn overlap(&self, id: usize, other: usize) -> bool {
        match (&self.dots[id], &self.dots[other]) {
            (Some(dot), Some(its)) => id != other && dot.overlaps(its),
            _ => false,
        }
    }
}

/// Information about the unknowns of two dots from all planes.
fn block(planes: &[Plane<'_>], (first, second): (usize, usize), width_px: usize) -> Block {
    let count = unknowns(planes.len());
    let mut block = vec![vec![0.0; count]; count];
    for (band, plane) in planes.iter().enumerate() {
        let (Some(own), Some(its)) = (&plane.dots[first], &plane.dots[second]) else { continue };
        let sums = own.information(its, plane.precision, width_px);
        for (k, row) in sums.iter().enumerate() {
            for (l, sum) in row.iter().enumerate() {
                block[unknown(band, k)][unknown(band, l)] += sum;
            }
        }
    }
    block
}

/// 1/variance of every pixel in electrons⁻²; 0 where it is expected to reach the full well.
fn precision(sensor: &Sensor, electrons: &[f64]) -> Vec<f64> {
    let dark_e2 = sensor.read_noise_e.powi(2) + sensor.electrons_per_code().powi(2) / 12.0;
    let precision = |&e: &f64| if e < sensor.full_well_e { 1.0 / (e + dark_e2) } else { 0.0 };
    electrons.iter().map(precision).collect()
}

/// Makes unknown `k` and all beyond it unknown: what is left is the information about the unknowns before it.
///
/// ```text
/// J' = J − J[·][k] J[k][·] / J[k][k]
/// ```
///
/// An unknown of which no more than `least` is known takes nothing from the others: they did not depend on it.
fn eliminate(information: &mut [Vec<f64>], k: usize, least: f64) {
    let (before, pivot) = information.split_at_mut(k);
    let pivot = &pivot[0];
    if pivot[k] <= least {
        return;
    }
    for row in before {
        let factor = row[k] / pivot[k];
        row[..k].iter_mut().zip(pivot).for_each(|(value, pivot)| *value -= factor * pivot);
    }
}

/// Inverse of the information about three unknowns, or `None` where too little is left of `own`, which each had
/// before the others became unknown.
fn inverse(information: [[f64; 3]; 3], own: [f64; 3]) -> Option<[[f64; 3]; 3]> {
    let m = &information;
    let minor = |i: usize, j: usize| {
        let ([a, b], [c, d]) = ([(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * minor(0, j)).sum();
    let is_regular = determinant > PIVOT_MIN * own.iter().product::<f64>();
    is_regular.then(|| std::array::from_fn(|i| std::array::from_fn(|j| minor(j, i) / determinant)))
}
