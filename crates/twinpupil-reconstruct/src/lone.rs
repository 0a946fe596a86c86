//! The centre of a feature that stands alone: all light in its window is its own, so one pass over the window's rows
//! tells all.

use multiversion::multiversion;

use crate::centroid::Centre;
use crate::lattice::Shape;
use crate::noise::Noise;
use crate::scout::ground::Ground;
use crate::scout::light::Light;
use crate::scout::row::{Moments, Sums};
use crate::window::{Disc, Span, Window};

/// Variance of a pixel over its contrast, which is linear: that of moments then needs nothing but moments.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scatter {
    ground: f64,
    growth: f64,
}

impl Scatter {
    /// Of pixels on a ground.
    pub(crate) fn on(ground: &Ground, noise: &Noise) -> Self {
        let variance = noise.variance(ground.level);
        Self { ground: variance, growth: noise.variance(ground.level + ground.polarity.sign()) - variance }
    }

    /// Variance of the light of so many pixels.
    pub(crate) fn of_light(&self, pixels: f64, light: f64) -> f64 {
        (self.ground * pixels + self.growth * light).max(0.0)
    }

    /// Variance of a first moment, from the squared distances of all pixels and the light's own second moment.
    pub(crate) fn of_moment(&self, places: f64, second: f64) -> f64 {
        (self.ground * places + self.growth * second).max(0.0)
    }
}

/// Centroid of all light in a feature's window, and the shape of it; `None` where there is no light.
///
/// A window that leaves the plane is moved until it rests.
pub(crate) fn lone_mean(
    light: &Light<'_>,
    scatter: Scatter,
    disc: &Disc,
    line: &mut Vec<f32>,
) -> Option<(Centre, Shape)> {
    const ROUNDS: usize = 14;
    const RESTING: f64 = 3e-3;
    let mut centre = disc.centre;
    let mut found = None;
    for _ in 0..ROUNDS {
        let window = Window::about([light.columns(), light.rows()], centre, disc.radius)?;
        let (mean, shape) = Content::of(light, window, line).mean(scatter)?;
        let step = (mean.position[0] - centre[0]).hypot(mean.position[1] - centre[1]);
        centre = mean.position;
        found = Some((mean, shape));
        if !window.trimmed() || step < RESTING {
            break;
        }
    }
    found
}

/// What a window holds, summed about its centre.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Content {
    pub(crate) window: Window,
    pub(crate) sums: Sums,
    /// Number of pixels, and their squared distances from the centre along columns and rows.
    pub(crate) pixels: f64,
    pub(crate) places: [f64; 2],
}

impl Content {
    /// All light of a window.
    pub(crate) fn of(light: &Light<'_>, window: Window, line: &mut Vec<f32>) -> Self {
        light.fetch(window.rows(), window.columns());
        sum_up(light, window, line)
    }

    /// Its centroid and shape; `None` without light.
    pub(crate) fn mean(&self, scatter: Scatter) -> Option<(Centre, Shape)> {
        let Window { centre: [c0, r0], half_width, half_height, .. } = self.window;
        let Sums { light, squares, first, second } = self.sums;
        if light.is_nan() || light <= 0.0 {
            return None;
        }
        let inside = |axis: usize, half: f64| (first[axis] / light).abs() <= half;
        if !(inside(0, half_width) && inside(1, half_height)) {
            return None;
        }
        let std = [0, 1].map(|axis| scatter.of_moment(self.places[axis], second[2 * axis]).sqrt() / light);
        let position = [c0 + first[0] / light, r0 + first[1] / light];
        let scatter = scatter.of_light(self.pixels, light);
        Some((Centre { position, std }, Shape { light, squares, scatter, second }))
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn sum_up(light: &Light<'_>, window: Window, line: &mut Vec<f32>) -> Content {
    let [c0, r0] = window.centre;
    let mut moments = Moments::default();
    let (mut pixels, mut places) = (0.0, [0.0; 2]);
    line.resize(window.columns().len(), 0.0);
    for Span { row, first, end } in window.spans() {
        let line = &mut line[..end - first];
        light.read_another(row, first, line);
        let (shift, dr) = (first as f64 - c0, row as f64 - r0);
        let squares = squares_of_places(shift, dr, line.len());
        pixels += line.len() as f64;
        places = [places[0] + squares[0], places[1] + squares[1]];
        moments.add_another(line, [shift, dr]);
    }
    Content { window, sums: moments.sums(), pixels, places }
}

/// Squared distances along and across of so many pixels of a row, summed; the first lies at `[along, across]`.
fn squares_of_places(along: f64, across: f64, count: usize) -> [f64; 2] {
    let n = count as f64;
    let [p1, p2] = [0.5 * n * (n - 1.0), n * (n - 1.0) * (2.0 * n - 1.0) / 6.0];
    [p2 + 2.0 * along * p1 + along * along * n, across * across * n]
}

#[cfg(test)]
mod tests {
    use super::*;

    const EVEN: Scatter = Scatter { ground: 4.0, growth: 0.0 };

    fn square(first: [usize; 2], side: usize) -> Vec<f32> {
        let inside = |place: usize, first: usize| (first..first + side).contains(&place);
        (0..50 * 40).map(|i| if inside(i % 50, first[0]) && inside(i / 50, first[1]) { 10.0 } else { 0.0 }).collect()
    }

    fn measure(contrasts: &[f32], centre: [f64; 2]) -> Option<(Centre, Shape)> {
        let light = Light::Field { columns: 50, contrasts };
        lone_mean(&light, EVEN, &Disc { centre, extent: 5.0, radius: 9.0 }, &mut Vec::new())
    }

    #[test]
    fn a_square_is_measured_by_hand() {
        let (centre, shape) = measure(&square([20, 15], 4), [21.2, 16.9]).expect("light");
        assert!((centre.position[0] - 21.5).abs() < 1e-6 && (centre.position[1] - 16.5).abs() < 1e-6, "{centre:?}");
        assert!((shape.light - 160.0).abs() < 1e-6 && (shape.squares - 1600.0).abs() < 1e-6);
        // σ² = Σ σ₀² x² / (Σ I)² over a disc of radius R: σ₀² π R⁴/4.
        let expected = (4.0 * std::f64::consts::PI * 9.0_f64.powi(4) / 4.0).sqrt() / 160.0;
        assert!((centre.std[0] / expected - 1.0).abs() < 0.05, "{centre:?} {expected}");
    }

    #[test]
    fn a_window_cut_off_by_the_plane_stays_true() {
        let (centre, _) = measure(&square([2, 1], 4), [3.9, 2.2]).expect("light");
        assert!((centre.position[0] - 3.5).abs() < 1e-2 && (centre.position[1] - 2.5).abs() < 1e-2, "{centre:?}");
    }

    #[test]
    fn no_light_is_no_centre() {
        assert!(measure(&[0.0; 50 * 40], [20.0, 20.0]).is_none());
    }
}
