//! What is fitted: one dot, its light in every band that shows it, and where it is imaged.

use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};
use twinpupil_instrument::PixelPoint;

use crate::likelihood::illumination::shift_px;
use crate::likelihood::normal::{Normal, Shape};
use crate::likelihood::spot::{Dot, Spot, SpotJacobian};

/// A dot and its light.
#[derive(Debug, Clone)]
pub(crate) struct Body {
    pub(crate) dot: Dot,
    /// In the order of the bands; `None` where the band does not show it.
    pub(crate) bands: Vec<Option<BandLight>>,
    /// Standard deviation of what is known of z beforehand, mm, if the bands alone do not tell it.
    pub(crate) z_prior_mm: Option<(f64, f64)>,
    /// Information on x, y, z and diameter, 1/mm².
    pub(crate) information: Matrix4<f64>,
    /// Size of the last step in standard deviations.
    pub(crate) step_sigmas: f64,
    /// Whether its light could be fitted at all.
    pub(crate) alive: bool,
    /// Rounds in which it has been fitted.
    pub(crate) rounds: usize,
    /// Whether it may be far from its place at first.
    pub(crate) doubtful: bool,
    /// Whether the largest code hides how bright it is.
    pub(crate) saturated: bool,
    /// Whether pixels that do not fit were left out in the last round.
    pub(crate) masked: bool,
    /// Whether another's light reaches into its window.
    pub(crate) has_neighbours: bool,
}

/// A dot's light in one band.
#[derive(Debug, Clone)]
pub(crate) struct BandLight {
    /// Its light less that of the ground, codes.
    pub(crate) contrast: f64,
    /// What it was thought to be at first, codes.
    pub(crate) first_contrast: f64,
    /// The ground about it, codes above black.
    pub(crate) background: f64,
    /// Growth of the illumination along u and v, relative, 1/px.
    pub(crate) illumination_slope: [f64; 2],
    pub(crate) spot: Spot,
    pub(crate) jacobian: SpotJacobian,
    /// What the band's pixels said last.
    pub(crate) normal: Normal,
    pub(crate) shape: Option<Shape>,
}

/// Centre of a spot as its own band alone measures it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OwnCentre {
    pub(crate) centre: PixelPoint,
    pub(crate) std_px: [f64; 2],
    /// How much better the band's own centre and size explain its pixels than those of the dot do.
    pub(crate) chi2: f64,
}

impl BandLight {
    /// Centre and size that explain the band best by themselves, with the blur that depth gives them.
    pub(crate) fn own_centre(&self) -> Option<OwnCentre> {
        let shape = self.shape?;
        let information: Matrix3<f64> = shape.information.fixed_view::<3, 3>(0, 0).into_owned();
        let score: Vector3<f64> = shape.score.fixed_rows::<3>(0).into_owned();
        let covariance = information.try_inverse()?;
        let step = covariance * score;
        // The centre is that of the dot, not of its light.
        let [du, dv] = shift_px(&self.spot, self.illumination_slope);
        let [u, v] = [self.spot.centre_px[0] - du, self.spot.centre_px[1] - dv];
        Some(OwnCentre {
            centre: PixelPoint { u: u + step.x, v: v + step.y },
            std_px: [covariance[(0, 0)].max(0.0).sqrt(), covariance[(1, 1)].max(0.0).sqrt()],
            chi2: step.dot(&score).max(0.0),
        })
    }
}

/// What is known of a number beforehand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Expected {
    pub(crate) value: f64,
    pub(crate) std: f64,
}

/// How well the contrast of a saturated dot is guessed, relative: it is held near the guess until its place is known.
const GUESS_STD: [f64; 2] = [1e-4, 1.0];
const GUESS_ROUNDS: usize = 3;

/// Blur added to the edges of a doubtful dot in the first round, so that they are felt from farther away.
const SOFTENING_PX: f64 = 2.0;

/// Rounds after which pixels that do not fit are left out, come what may.
const PATIENCE: usize = 6;
const PATIENCE_SATURATED: usize = 11;

/// After a step this small, in standard deviations, a dot is so near its place that pixels which do not fit at all are
/// not its own.
const NEAR_SIGMAS: f64 = 20.0;

/// After a step this small, and with so much χ² a pixel, a dot is where its surface is.
const SETTLED_SIGMAS: f64 = 30.0;
const SETTLED_CHI2: f64 = 2.5;

/// After a step this small the next would be none: each is about the square of the last, over the width of the edge.
const LAST_SIGMAS: f64 = 8.0;

/// A step this small, in standard deviations, is none, also to the neighbours.
const RESTING_SIGMAS: f64 = 0.3;

impl Body {
    /// Blur to be added in the coming round, px.
    pub(crate) fn softening_px(&self) -> f64 {
        if self.doubtful && self.rounds == 0 { SOFTENING_PX } else { 0.0 }
    }

    /// What the contrast of its light should be, where the pixels may not tell.
    pub(crate) fn expected_contrast(&self, light: &BandLight) -> Option<Expected> {
        let share = GUESS_STD[usize::from(self.rounds >= GUESS_ROUNDS)];
        let value = light.first_contrast;
        self.saturated.then(|| Expected { value, std: share * value.abs().max(1.0) })
    }

    /// Whether it is near enough to its place that pixels which do not fit are not its own.
    pub(crate) fn is_near(&self) -> bool {
        let patience = if self.saturated { PATIENCE_SATURATED } else { PATIENCE };
        let settling = self.rounds > if self.saturated { GUESS_ROUNDS } else { 1 };
        settling && self.step_sigmas < NEAR_SIGMAS || self.rounds > patience
    }

    /// Whether it has come to where its pixels are explained.
    pub(crate) fn is_settled(&self) -> bool {
        let (used, _, chi2) = self.fit_quality();
        self.step_sigmas < SETTLED_SIGMAS && chi2 < SETTLED_CHI2 * used as f64
    }

    /// Whether another round would not move it.
    pub(crate) fn rests(&self) -> bool {
        let enough = if self.has_neighbours || self.saturated { RESTING_SIGMAS } else { LAST_SIGMAS };
        !self.alive || self.rounds > 1 && self.masked && self.step_sigmas < enough
    }

    /// Information and score on x, y, z and diameter from all bands.
    pub(crate) fn equations(&self) -> (Matrix4<f64>, Vector4<f64>) {
        let (mut information, mut score) = (Matrix4::zeros(), Vector4::zeros());
        for light in self.bands.iter().flatten() {
            if let Some(shape) = &light.shape {
                information += light.jacobian.transpose() * shape.information * light.jacobian;
                score += light.jacobian.transpose() * shape.score;
            }
        }
        if let Some((z_mm, std_mm)) = self.z_prior_mm {
            information[(2, 2)] += std_mm.powi(-2);
            score[2] += (z_mm - self.dot.centre_mm[2]) / std_mm.powi(2);
        }
        (information, score)
    }

    /// Moves dot and light by what the equations ask for.
    pub(crate) fn step(&mut self) {
        let (information, score) = self.equations();
        let Some(mut step) = information.cholesky().map(|cholesky| cholesky.solve(&score)) else {
            self.alive = false;
            return;
        };
        self.step_sigmas = step.dot(&(information * step)).max(0.0).sqrt();
        // Far from the solution a full step may overshoot: no spot moves by more than a quarter of its size.
        let limit = 0.25 * self.dot.diameter_mm / step.xy().norm().max(step.w.abs()).max(1e-12);
        let limit = limit.min(10.0 / step.z.abs().max(1e-12)).min(1.0);
        step *= limit;
        for (coordinate, change) in self.dot.centre_mm.iter_mut().zip(step.iter()) {
            *coordinate += change;
        }
        self.dot.diameter_mm += step.w;
        self.information = information;
        self.rounds += 1;
        for light in self.bands.iter_mut().flatten() {
            if let Some(shape) = &light.shape {
                let change = shape.light_step(&(light.jacobian * step));
                light.contrast += change.x;
                light.background += change.y;
            }
        }
        self.alive = self.dot.diameter_mm > 0.0
            && self.dot.centre_mm[2] > 0.0
            && self.dot.centre_mm.iter().all(|coordinate| coordinate.is_finite());
    }

    /// Pixels used, pixels masked, and χ² of all bands.
    pub(crate) fn fit_quality(&self) -> (usize, usize, f64) {
        let normals = || self.bands.iter().flatten().map(|light| &light.normal);
        (
            normals().map(|normal| normal.used).sum(),
            normals().map(|normal| normal.masked).sum(),
            normals().map(|normal| normal.chi2).sum(),
        )
    }
}
