//! Normal equations of weighted least squares.

use multiversion::multiversion;
use nalgebra::{Matrix2, Matrix4, Matrix4x2, Matrix6, Vector2, Vector4, Vector6};

use crate::likelihood::chords::{LANES, Lanes};
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
    pub(crate) fn of(light: &Light, places: &Places, contrast: f64, weights: &Weights) -> Self {
        let mut sums = Sums::default();
        sums.fill(light, places.edge, weights);
        let scales = [contrast, contrast, contrast, contrast, 1.0, 1.0];
        let information = |i: usize, k: usize| sums.products[i.min(k)][i.max(k)] * scales[i] * scales[k];
        Self {
            information: Matrix6::from_fn(information),
            score: Vector6::from_fn(|i, _| sums.score[i] * scales[i]),
            chi2: sums.chi2,
            used: sums.used,
            masked: places.len() - sums.used,
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
    /// The first `edge` pixels, and those that share their last [`LANES`], feel all unknowns; the others contrast and
    /// background alone.
    fn fill(&mut self, light: &Light, edge: usize, weights: &Weights) {
        let Light { light, with_u, with_v, with_radius, with_blur, open, .. } = light;
        let columns = [with_u, with_v, with_radius, with_blur, light, open];
        let count = weights.weight.len();
        let edge = edge.next_multiple_of(LANES);
        for (range, feels_edge) in [(0..edge, true), (edge..count, false)] {
            let mut products = Products::default();
            for start in range.clone().step_by(BLOCK) {
                let block = start..(start + BLOCK).min(range.end);
                let [weight, residual] = [&weights.weight, &weights.residual].map(|values| &values[block.clone()]);
                multiply(columns.map(|column| &column[block.clone()]), weight, residual, feels_edge, &mut products);
                self.used += used(weight);
            }
            if !range.is_empty() {
                add_products(&products, self);
            }
        }
    }
}

/// Adds products in lanes.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "x86_64+avx"))]
fn add_products(Products { u, v, radius, blur, light, open, chi2 }: &Products, sums: &mut Sums) {
    let rows: [&[Lanes]; UNKNOWNS] = [u, v, radius, blur, light, open];
    for (i, row) in rows.into_iter().enumerate() {
        let [with_columns @ .., with_residual] = row else { continue };
        sums.products[i][i..].iter_mut().zip(with_columns).for_each(|(sum, lanes)| *sum += total(lanes));
        sums.score[i] += total(with_residual);
    }
    sums.chi2 += total(&chi2[0]);
}

/// Pixels whose derivatives are near at hand.
const BLOCK: usize = 512;

/// Sums of the products of every column with those from it on, and with the residuals; and of their squares.
#[derive(Default)]
struct Products {
    u: [Lanes; 7],
    v: [Lanes; 6],
    radius: [Lanes; 5],
    blur: [Lanes; 4],
    light: [Lanes; 3],
    open: [Lanes; 2],
    chi2: [Lanes; 1],
}

#[inline(always)]
fn total(lanes: &Lanes) -> f64 {
    let mut quarters = [0.0; LANES / 4];
    for lane in 0..LANES / 4 {
        quarters[lane] = (lanes[lane] + lanes[lane + 4]) + (lanes[lane + 8] + lanes[lane + 12]);
    }
    f64::from((quarters[0] + quarters[2]) + (quarters[1] + quarters[3]))
}

/// Pixels that count.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "x86_64+avx"))]
fn used(weight: &[f32]) -> usize {
    weight.iter().map(|weight| u32::from(*weight > 0.0)).sum::<u32>() as usize
}

/// Adds the products of all columns, or of those of light and open share.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "x86_64+avx"))]
fn multiply(
    [u, v, radius, blur, light, open]: [&[f32]; UNKNOWNS],
    weight: &[f32],
    residual: &[f32],
    all: bool,
    products: &mut Products,
) {
    if all {
        add(weight, u, [u, v, radius, blur, light, open, residual], &mut products.u);
        add(weight, v, [v, radius, blur, light, open, residual], &mut products.v);
        add(weight, radius, [radius, blur, light, open, residual], &mut products.radius);
        add(weight, blur, [blur, light, open, residual], &mut products.blur);
    }
    add(weight, light, [light, open, residual], &mut products.light);
    add(weight, open, [open, residual], &mut products.open);
    add(weight, residual, [residual], &mut products.chi2);
}

/// Adds the weighted products of a column with others, for whole lanes.
#[inline(always)]
fn add<const N: usize>(weight: &[f32], column: &[f32], others: [&[f32]; N], sums: &mut [Lanes; N]) {
    add_some(weight, [column], others, std::array::from_mut(sums));
}

/// The same for some columns at once.
#[inline(always)]
fn add_some<const M: usize, const N: usize>(
    weight: &[f32],
    columns: [&[f32]; M],
    others: [&[f32]; N],
    sums: &mut [[Lanes; N]; M],
) {
    let count = weight.len() / LANES;
    let weights = &weight.as_chunks::<LANES>().0[..count];
    let columns = columns.map(|column| &column.as_chunks::<LANES>().0[..count]);
    let others = others.map(|other| &other.as_chunks::<LANES>().0[..count]);
    // Sums of their own stay in registers, as long as they are not added up here.
    let mut own = *sums;
    for chunk in 0..count {
        for (column, own) in columns.iter().zip(&mut own) {
            let mut weighted = [0.0; LANES];
            for lane in 0..LANES {
                weighted[lane] = weights[chunk][lane] * column[chunk][lane];
            }
            for (other, own) in others.iter().zip(own) {
                for lane in 0..LANES {
                    own[lane] += weighted[lane] * other[chunk][lane];
                }
            }
        }
    }
    *sums = own;
}

/// Weighted sums of the products of a spot's columns with those of a neighbour, by whole lanes.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "x86_64+avx"))]
pub(crate) fn products_with(
    others: [&[f32]; 5],
    weight: &[f32],
    columns: [&[f32]; UNKNOWNS],
    products: &mut [[f64; 5]; UNKNOWNS],
) {
    // Several at once: sums that wait for one another take longer.
    const SOME: usize = 3;
    const { assert!(UNKNOWNS.is_multiple_of(SOME)) };
    let (columns, products) = (columns.as_chunks::<SOME>().0, products.as_chunks_mut::<SOME>().0);
    for (columns, products) in columns.iter().zip(products) {
        let mut sums = [[[0.0; LANES]; 5]; SOME];
        add_some(weight, *columns, others, &mut sums);
        for (product, sum) in products.as_flattened_mut().iter_mut().zip(sums.as_flattened()) {
            *product = total(sum);
        }
    }
}
