//! Normal equations of weighted least squares.

use multiversion::multiversion;
use nalgebra::{Matrix2, Matrix4, Matrix4x2, Matrix6, Vector2, Vector4, Vector6};

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
    /// Contrast and background follow from the shape's step δ as `light_step − light_per_shape δ`.
    light_step: Vector2<f64>,
    light_per_shape: Matrix4x2<f64>,
}

impl Default for Normal {
    fn default() -> Self {
        Self { information: Matrix6::zeros(), score: Vector6::zeros(), chi2: 0.0, used: 0, masked: 0 }
    }
}

/// Derivatives, weights and residuals of pixels.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lines {
    pub(crate) jacobian: [Vec<f32>; UNKNOWNS],
    pub(crate) weight: Vec<f32>,
    pub(crate) residual: Vec<f32>,
    weighted: Vec<f32>,
}

impl Lines {
    /// Makes place for `count` pixels.
    pub(crate) fn resize(&mut self, count: usize) {
        let rest = [&mut self.weight, &mut self.residual, &mut self.weighted];
        self.jacobian.iter_mut().chain(rest).for_each(|values| values.resize(count, 0.0));
    }
}

impl Normal {
    /// Adds pixels.
    pub(crate) fn add(&mut self, lines: &mut Lines) {
        for i in 0..UNKNOWNS {
            scale(&mut lines.weighted, &lines.weight, &lines.jacobian[i]);
            for k in i..UNKNOWNS {
                self.information[(i, k)] += dot(&lines.weighted, &lines.jacobian[k]);
            }
            self.score[i] += dot(&lines.weighted, &lines.residual);
        }
        self.count(lines);
    }

    /// Adds pixels that the dot fills: light and ground change alike, by the last of the derivatives, and nothing else.
    pub(crate) fn add_full(&mut self, lines: &mut Lines) {
        scale(&mut lines.weighted, &lines.weight, &lines.jacobian[5]);
        let square = dot(&lines.weighted, &lines.jacobian[5]);
        let score = dot(&lines.weighted, &lines.residual);
        for (i, k) in [(4, 4), (4, 5), (5, 5)] {
            self.information[(i, k)] += square;
        }
        self.score[4] += score;
        self.score[5] += score;
        self.count(lines);
    }

    /// Adds residuals to χ².
    fn count(&mut self, lines: &mut Lines) {
        scale(&mut lines.weighted, &lines.weight, &lines.residual);
        self.chi2 += dot(&lines.weighted, &lines.residual);
        let used = lines.weight.iter().filter(|weight| **weight > 0.0).count();
        self.used += used;
        self.masked += lines.weight.len() - used;
    }

    /// Fills the lower half of the information once all pixels are in.
    pub(crate) fn complete(&mut self) {
        self.information.fill_lower_triangle_with_upper_triangle();
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
        let inverse: Matrix2<f64> = light.try_inverse()?;
        let light_score = self.score.fixed_rows::<2>(4).into_owned();
        let light_step = inverse * light_score;
        Some(Shape {
            information: self.information.fixed_view::<4, 4>(0, 0) - mixed * inverse * mixed.transpose(),
            score: self.score.fixed_rows::<4>(0) - mixed * light_step,
            light_step,
            light_per_shape: mixed * inverse,
        })
    }
}

impl Shape {
    /// Steps of contrast and background that go with a step of u, v, radius and blur.
    pub(crate) fn light_step(&self, shape_step: &Vector4<f64>) -> Vector2<f64> {
        self.light_step - self.light_per_shape.transpose() * shape_step
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn scale(out: &mut [f32], a: &[f32], b: &[f32]) {
    for (out, (a, b)) in out.iter_mut().zip(a.iter().zip(b)) {
        *out = a * b;
    }
}

/// Sum of products, in lanes that vectorise.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f64 {
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
