//! Where a feature lies: the estimators, side by side, each from the light in the feature's window.

use crate::contrast::Contrast;
use crate::noise::Noise;
use crate::window::Windows;

/// Centre of a feature in pixels of its plane, with standard deviations from the noise of its pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Centre {
    pub(crate) position: [f64; 2],
    pub(crate) std: [f64; 2],
}

/// Moves every window to the centroid of the light in it until all rest; overlapping ones settle together.
///
/// A window that is trimmed or shared moves its centroid along with it, by a share ρ of the step, so steps shrink like
/// 1, ρ, ρ², …; from the second on they are lengthened by 1/(1 − ρ) to where they lead (Aitken).
///
/// Returns the centres, `None` where a window holds no light or `among` leaves it out.
pub(crate) fn cartesian_means(
    windows: &mut Windows<'_>,
    contrast: &Contrast,
    noise: &Noise,
    among: impl Fn(usize) -> bool,
) -> Vec<Option<Centre>> {
    const ROUNDS: f64 = 14.0;
    const SHARED_PIXELS_MAX: f64 = 3e7;
    const RESTING: f64 = 3e-3;
    const RATIO_MAX: f64 = 0.85;
    const SETTLING: usize = 2;
    let count = windows.centres.len();
    // A frame crowded with features gets fewer rounds rather than take forever.
    let rounds = (SHARED_PIXELS_MAX / windows.shared_pixels()).clamp(2.0, ROUNDS) as usize;
    let mut centres = vec![None; count];
    let mut steps = vec![[0.0_f64; 2]; count];
    let mut restless: Vec<usize> = (0..count).filter(|&feature| among(feature)).collect();
    for round in 0..rounds {
        restless.retain(|&feature| {
            let before = windows.centres[feature];
            centres[feature] = cartesian_mean(windows, contrast, noise, feature);
            let Some(Centre { position, .. }) = &mut centres[feature] else { return false };
            for axis in 0..2 {
                let step = position[axis] - before[axis];
                let ratio = step / steps[feature][axis];
                let gain = if ratio > 0.0 && ratio < 1.0 { 1.0 / (1.0 - ratio.min(RATIO_MAX)) } else { 1.0 };
                position[axis] = before[axis] + gain * step;
                steps[feature][axis] = step;
            }
            windows.centres[feature] = *position;
            if strayed(windows, feature) {
                centres[feature] = Some(outline_centre(windows, feature));
                windows.centres[feature] = windows.outlines[feature].0;
                return false;
            }
            // What rests among neighbours that have hardly begun to move may be moved by them yet.
            let settling = windows.overlaps(feature) && round < SETTLING;
            settling || steps[feature][0].hypot(steps[feature][1]) > RESTING
        });
        if restless.is_empty() {
            break;
        }
    }
    centres
}

/// Whether a window has left its outline: among many neighbours that touch, sharing may run away.
fn strayed(windows: &Windows<'_>, feature: usize) -> bool {
    const LEASH: f64 = 0.6;
    let ([c0, r0], extent) = windows.outlines[feature];
    let [c, r] = windows.centres[feature];
    (c - c0).hypot(r - r0) > LEASH * extent
}

/// The centre of an outline, where the light itself gives none.
fn outline_centre(windows: &Windows<'_>, feature: usize) -> Centre {
    const SHARE_OF_EXTENT: f64 = 0.05;
    let (position, extent) = windows.outlines[feature];
    Centre { position, std: [SHARE_OF_EXTENT * extent; 2] }
}

/// How far the share of light that two features claim may be wrong; it counts towards their deviations.
const SHARE_ERROR: f64 = 0.1;

/// Centroid of the light in one window, in Cartesian coordinates.
fn cartesian_mean(windows: &Windows<'_>, contrast: &Contrast, noise: &Noise, feature: usize) -> Option<Centre> {
    let [c0, r0] = windows.centres[feature];
    let Moments { light, first, variance, doubt } = Moments::of_shared_light(windows, contrast, noise, feature);
    let position = [c0 + first[0] / light, r0 + first[1] / light];
    let [c, r] = position;
    let inside = c >= 0.0 && r >= 0.0 && c < contrast.columns as f64 && r < contrast.rows as f64;
    let std = |axis: usize| variance[axis].max(0.0).sqrt().hypot(SHARE_ERROR * doubt[axis]) / light;
    (light > 0.0 && inside).then(|| Centre { position, std: [std(0), std(1)] })
}

/// Sums over a window, about its centre.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    light: f64,
    /// First moments along columns and rows.
    first: [f64; 2],
    /// Variances of the first moments.
    variance: [f64; 2],
    /// First moments of the light whose owner is in doubt.
    doubt: [f64; 2],
}

impl Moments {
    /// Pixel by pixel, with the feature's share of each.
    fn of_shared_light(windows: &Windows<'_>, contrast: &Contrast, noise: &Noise, feature: usize) -> Self {
        let [c0, r0] = windows.centres[feature];
        let mut moments = Self::default();
        windows.for_each_pixel(feature, |pixel| {
            let (dc, dr) = (pixel.column - c0, pixel.row - r0);
            let scatter = pixel.share * pixel.share * noise.variance(contrast.code(pixel.contrast));
            moments.light += pixel.signal;
            moments.first[0] += dc * pixel.signal;
            moments.first[1] += dr * pixel.signal;
            moments.variance[0] += dc * dc * scatter;
            moments.variance[1] += dr * dr * scatter;
            let doubtful = pixel.signal * (1.0 - pixel.share);
            moments.doubt[0] += dc * doubtful;
            moments.doubt[1] += dr * doubtful;
        });
        moments
    }
}

/// The paper's centre of a feature, in polar coordinates about the axis, both in units of the plane's pixels.
///
/// ```text
/// r̄ = ∫∫ r I r dr dφ / ∫∫ I r dr dφ                     [Ohno2018, Eqs. 9, 10]
/// φ̄ = ∫∫ r φ I r dr dφ / (r̄ ∫∫ I r dr dφ)               [Ohno2018, Eq. 11, one band's half of it]
/// ```
///
/// r̄ is the mean of the radii, not the radius of the mean: for a disc of radius a it is larger by about a²/8r̄. φ runs
/// from −π to π, so a feature across the negative x axis has no meaningful φ̄. Both are the paper's; use
/// [`cartesian_means`] for measuring.
pub(crate) fn radial_mean(windows: &Windows<'_>, feature: usize, axis: [f64; 2]) -> Option<[f64; 2]> {
    let (mut sum, mut radius_sum, mut azimuth_sum) = (0.0, 0.0, 0.0);
    windows.for_each_pixel(feature, |pixel| {
        let (x, y) = (pixel.column - axis[0], pixel.row - axis[1]);
        let radius = x.hypot(y);
        sum += pixel.signal;
        radius_sum += radius * pixel.signal;
        azimuth_sum += radius * y.atan2(x) * pixel.signal;
    });
    let radius = radius_sum / sum;
    let azimuth = azimuth_sum / (radius * sum);
    (sum > 0.0 && radius > 0.0 && azimuth.is_finite()).then_some([radius, azimuth])
}
