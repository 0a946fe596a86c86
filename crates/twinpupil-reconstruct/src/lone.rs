//! The centre of a feature that stands alone: all light in its window is its own, so one pass over the window's rows
//! tells all.

use crate::background::Polarity;
use crate::centroid::Centre;
use crate::lattice::Shape;
use crate::noise::Noise;
use crate::scout::ground::Ground;
use crate::scout::light::Light;
use crate::scout::row::{Moments, Sums};
use crate::window::Disc;

/// Variance of a pixel over its contrast, which is linear: that of moments then needs nothing but moments.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scatter {
    ground: f64,
    growth: f64,
}

impl Scatter {
    /// Of pixels on a ground.
    pub(crate) fn on(ground: &Ground, noise: &Noise) -> Self {
        let side = if ground.polarity == Polarity::Bright { 1.0 } else { -1.0 };
        let variance = noise.variance(ground.level);
        Self { ground: variance, growth: noise.variance(ground.level + side) - variance }
    }
}

/// Centroid of all light in a feature's window, and the shape of it; `None` where there is no light.
///
/// A window that leaves the plane is trimmed on its far side too, so that it stays symmetric, and moved until it rests.
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
        let window = Window::about(light, centre, disc.radius)?;
        let (mean, shape) = window.mean(light, scatter, line)?;
        let step = (mean.position[0] - centre[0]).hypot(mean.position[1] - centre[1]);
        centre = mean.position;
        found = Some((mean, shape));
        if !window.trimmed || step < RESTING {
            break;
        }
    }
    found
}

/// A round window, cut off alike on both sides where it leaves the plane.
struct Window {
    centre: [f64; 2],
    radius: f64,
    half_width: f64,
    half_height: f64,
    trimmed: bool,
}

impl Window {
    fn about(light: &Light<'_>, centre: [f64; 2], radius: f64) -> Option<Self> {
        let last = [light.columns(), light.rows()].map(|count| (count - 1) as f64);
        // Half sides that keep both a pixel and its mirror image inside.
        let half = |axis: usize| radius.min(centre[axis]).min(last[axis] - centre[axis]);
        let (half_width, half_height) = (half(0), half(1));
        let trimmed = half_width < radius || half_height < radius;
        (half_width >= 0.0 && half_height >= 0.0).then_some(Self { centre, radius, half_width, half_height, trimmed })
    }

    /// Centroid of the light in the window, and its shape.
    fn mean(&self, light: &Light<'_>, scatter: Scatter, line: &mut Vec<f32>) -> Option<(Centre, Shape)> {
        let [c0, r0] = self.centre;
        let mut moments = Moments::default();
        // Number of pixels, and their squared distances from the centre along columns and rows.
        let (mut pixels, mut places) = (0.0, [0.0; 2]);
        for row in (r0 - self.half_height).ceil() as usize..=(r0 + self.half_height).floor() as usize {
            let dr = row as f64 - r0;
            let chord = (self.radius * self.radius - dr * dr).max(0.0).sqrt().min(self.half_width);
            let (first, end) = ((c0 - chord).ceil() as usize, (c0 + chord).floor() as usize + 1);
            if end <= first {
                continue;
            }
            line.resize(end - first, 0.0);
            light.read(row, first, line);
            let (shift, count) = (first as f64 - c0, line.len() as f64);
            let [p1, p2] = [0.5 * count * (count - 1.0), count * (count - 1.0) * (2.0 * count - 1.0) / 6.0];
            pixels += count;
            places[0] += p2 + 2.0 * shift * p1 + shift * shift * count;
            places[1] += dr * dr * count;
            moments.add(line, [shift, dr]);
        }
        let Sums { light, squares, first, second } = moments.sums();
        if light.is_nan() || light <= 0.0 {
            return None;
        }
        let inside = |axis: usize, half: f64| (first[axis] / light).abs() <= half;
        if !(inside(0, self.half_width) && inside(1, self.half_height)) {
            return None;
        }
        let std = |axis: usize| {
            let own = if axis == 0 { second[0] } else { second[2] };
            (scatter.ground * places[axis] + scatter.growth * own).max(0.0).sqrt() / light
        };
        let position = [c0 + first[0] / light, r0 + first[1] / light];
        let scatter = scatter.ground * pixels + scatter.growth * light;
        Some((Centre { position, std: [std(0), std(1)] }, Shape { light, squares, scatter, second }))
    }
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
