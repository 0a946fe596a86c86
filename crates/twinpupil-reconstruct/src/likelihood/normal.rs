//! Normal equations of weighted least squares.

use std::ops::Range;

use multiversion::multiversion;
use nalgebra::{Matrix2, Matrix4, Matrix4x2, Matrix6, Vector2, Vector4, Vector6};

use crate::likelihood::full::FullSums;
use crate::likelihood::light::{Light, Places};
use crate::likelihood::weigh::Weights;

/// Unknowns of a spot in one band: u, v, radius, blur, contrast, background.
pub(crate) const UNKNOWNS: usize = 6;

/// `JᵀWJ`, `JᵀWr` and `rᵀWr` of one spot in one band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Normal {
    pub(crate) information: Matrix6<f64>,
    pub(crate) score: Vector6<f64>,
    pub(crate) chi2: f64,
    /// Pixels that count, and those that were left out as saturated, dead or foreign.
    pub(crate) used: usize,
    pub(crate) masked: usize,
}

/// [`Normal`] with contrast and background eliminated: what the band says of u, v, radius and blur.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Shape {
    pub(crate) information: Matrix4<f64>,
    pub(crate) score: Vector4<f64>,
    /// Covariance of contrast and background if the shape is known.
    light_covariance: Matrix2<f64>,
    /// Change of both with the shape, and of its score with theirs.
    light_per_shape: Matrix4x2<f64>,
}

impl Default for Normal {
    fn default() -> Self {
        Self { information: Matrix6::zeros(), score: Vector6::zeros(), chi2: 0.0, used: 0, masked: 0 }
    }
}

impl Normal {
    /// Of pixels that see a spot of some contrast.
    pub(crate) fn of(
        light: &Light,
        places: &Places,
        contrast: f64,
        weights: &Weights,
        weighted: &mut Vec<f32>,
    ) -> Self {
        let count = weights.weight.len();
        weighted.resize(BLOCK, 0.0);
        let mut sums = Sums::default();
        sums.fill(light, places.edge, weights, weighted);
        let scales = [contrast, contrast, contrast, contrast, 1.0, 1.0];
        let information = |i: usize, k: usize| sums.products[i.min(k)][i.max(k)] * scales[i] * scales[k];
        Self {
            information: Matrix6::from_fn(information),
            score: Vector6::from_fn(|i, _| sums.score[i] * scales[i]),
            chi2: sums.chi2,
            used: sums.used,
            masked: count - sums.used,
        }
    }

    /// Adds pixels that the dot fills: light and ground change alike, and nothing else does.
    pub(crate) fn add_full(&mut self, full: &FullSums, masked: usize) {
        for i in 4..UNKNOWNS {
            self.score[i] += full.score;
            for k in 4..UNKNOWNS {
                self.information[(i, k)] += full.information;
            }
        }
        self.chi2 += full.chi2;
        self.used += full.used;
        self.masked += masked;
    }

    /// Adds ground that sees none of the dot.
    pub(crate) fn add_ground(&mut self, ground: &FullSums) {
        self.score[5] += ground.score;
        self.information[(5, 5)] += ground.information;
        self.chi2 += ground.chi2;
        self.used += ground.used;
    }

    /// Adds what is known of the contrast beforehand: how far above the present one it should be, with its deviation.
    pub(crate) fn expect_contrast(&mut self, above: f64, std: f64) {
        self.information[(4, 4)] += std.powi(-2);
        self.score[4] += above / (std * std);
    }

    /// Contrast and background eliminated; `None` if the pixels do not tell them.
    pub(crate) fn shape(&self) -> Option<Shape> {
        let light = self.information.fixed_view::<2, 2>(4, 4).into_owned();
        let mixed = self.information.fixed_view::<4, 2>(0, 4).into_owned();
        let light_covariance = light.try_inverse()?;
        let light_per_shape = mixed * light_covariance;
        let mut shape = Shape {
            information: self.information.fixed_view::<4, 4>(0, 0) - light_per_shape * mixed.transpose(),
            score: Vector4::zeros(),
            light_covariance,
            light_per_shape,
        };
        shape.score = shape.reduced_score(&self.score);
        Some(shape)
    }
}

impl Shape {
    /// The score of u, v, radius and blur, light eliminated.
    pub(crate) fn reduced_score(&self, score: &Vector6<f64>) -> Vector4<f64> {
        score.fixed_rows::<4>(0) - self.light_per_shape * score.fixed_rows::<2>(4)
    }

    /// Steps of contrast and background that go with a step of u, v, radius and blur.
    pub(crate) fn light_step(&self, score: &Vector6<f64>, shape_step: &Vector4<f64>) -> Vector2<f64> {
        self.light_covariance * score.fixed_rows::<2>(4) - self.light_per_shape.transpose() * shape_step
    }
}

/// Sums over pixels of products of the derivatives of light.
#[derive(Debug, Default)]
struct Sums {
    products: [[f64; UNKNOWNS]; UNKNOWNS],
    score: [f64; UNKNOWNS],
    chi2: f64,
    used: usize,
}

impl Sums {
    /// The first `edge` pixels feel all unknowns, the others contrast and background alone.
    fn fill(&mut self, light: &Light, edge: usize, weights: &Weights, weighted: &mut [f32]) {
        let Light { light, with_u, with_v, with_radius, with_blur, open, .. } = light;
        let columns: [&[f32]; UNKNOWNS] = [with_u, with_v, with_radius, with_blur, light, open];
        let count = weights.weight.len();
        let blocks = |range: Range<usize>| {
            let end = range.end;
            range.step_by(BLOCK).map(move |start| start..(start + BLOCK).min(end))
        };
        for block in blocks(0..edge) {
            let (weight, residual) = (&weights.weight[block.clone()], &weights.residual[block.clone()]);
            let columns = columns.map(|column| &column[block.clone()]);
            add_products(columns, weight, residual, &mut weighted[..block.len()], 0, self);
        }
        for block in blocks(edge..count) {
            let (weight, residual) = (&weights.weight[block.clone()], &weights.residual[block.clone()]);
            let columns = [&light[block.clone()], &open[block.clone()]];
            add_products(columns, weight, residual, &mut weighted[..block.len()], 4, self);
        }
    }
}

/// Pixels whose derivatives are near at hand.
const BLOCK: usize = 512;

#[multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
fn add_products<const N: usize>(
    columns: [&[f32]; N],
    weight: &[f32],
    residual: &[f32],
    weighted: &mut [f32],
    first: usize,
    sums: &mut Sums,
) {
    for (i, column) in columns.into_iter().enumerate() {
        scale(weighted, weight, column);
        for (product, column) in sums.products[first + i][first..].iter_mut().zip(&columns).skip(i) {
            *product += sum(weighted, column);
        }
        sums.score[first + i] += sum(weighted, residual);
    }
    scale(weighted, weight, residual);
    sums.chi2 += sum(weighted, residual);
    sums.used += weight.iter().map(|weight| u32::from(*weight > 0.0)).sum::<u32>() as usize;
}

#[inline(always)]
fn scale(out: &mut [f32], a: &[f32], b: &[f32]) {
    for (out, (a, b)) in out.iter_mut().zip(a.iter().zip(b)) {
        *out = a * b;
    }
}

/// Sum of products, in lanes that vectorise.
#[inline(always)]
fn sum(a: &[f32], b: &[f32]) -> f64 {
    const LANES: usize = 16;
    let mut lanes = [0.0_f32; LANES];
    let (a_chunks, b_chunks) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f32 = a_chunks.remainder().iter().zip(b_chunks.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a_chunks.zip(b_chunks) {
        for lane in 0..LANES {
            lanes[lane] += a[lane] * b[lane];
        }
    }
    f64::from(lanes.iter().sum::<f32>() + rest)
}

/// [`sum`], for the callers that sum few.
#[multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f64 {
    sum(a, b)
}
