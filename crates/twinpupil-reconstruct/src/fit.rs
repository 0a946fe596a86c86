//! Lines and planes through points, by weighted least squares.

use nalgebra::{DMatrix, DVector};
use thiserror::Error;

/// A sample of a line `z = a + b t`, or of a plane `z = a + b x + c y`, with its deviation where it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitPoint {
    /// Position, mm.
    pub position_mm: [f64; 3],
    /// Standard deviation of z, mm.
    pub z_std_mm: Option<f64>,
}

/// Which coordinate a fitted line runs along.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineAxis {
    /// z over x, as in [Ohno2018, Eq. 14].
    X,
    /// z over y.
    Y,
}

/// A fit that could not be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum FitError {
    /// Fewer points than parameters.
    #[error("{found} points are too few: at least {needed} are needed")]
    TooFew {
        /// Points given.
        found: usize,
        /// Points needed.
        needed: usize,
    },
    /// Points that do not determine the parameters, such as a plane through points on a line.
    #[error("the points do not determine the fit: they share one {shared}")]
    Degenerate {
        /// What they share.
        shared: &'static str,
    },
    /// A coordinate that is not a number, or absurdly large.
    #[error("point {index} has a coordinate that is no length: not finite or beyond 1e12 mm")]
    NotFinite {
        /// Its index, from 0.
        index: usize,
    },
}

/// A parameter with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Value.
    pub value: f64,
    /// Standard deviation: from the points' own where all have one, else from their scatter about the fit.
    pub std: f64,
}

/// How well a fit describes its points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// Number of points.
    pub points: usize,
    /// Coefficient of determination, 1 − Σw(z − ẑ)²/Σw(z − z̄)².
    pub r_squared: f64,
    /// Root of the mean square distance in z, mm, unweighted.
    pub rms_mm: f64,
    /// Σ((z − ẑ)/σ)² per degree of freedom, where all points have deviations and there are more than parameters.
    pub reduced_chi2: Option<f64>,
}

/// `tan θ · t − (z − z_fit) = 0`  [Ohno2018, Eq. 14], t being x or y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineFit {
    /// Tilt θ, rad.
    pub tilt_rad: Estimate,
    /// Distance on the axis, z_fit, mm.
    pub z_mm: Estimate,
    /// Goodness.
    pub quality: Quality,
}

/// `z = z_fit + x tan θ_x + y tan θ_y`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneFit {
    /// Slope along x, tan θ_x.
    pub slope_x: Estimate,
    /// Slope along y, tan θ_y.
    pub slope_y: Estimate,
    /// Distance on the axis, mm.
    pub z_mm: Estimate,
    /// Angle between the plane's normal and the optical axis, rad.
    pub tilt_rad: Estimate,
    /// Goodness.
    pub quality: Quality,
}

impl PlaneFit {
    /// How far a point lies behind the plane, along z, mm.
    pub fn distance_mm(&self, point: &FitPoint) -> f64 {
        let [x_mm, y_mm, z_mm] = point.position_mm;
        z_mm - (self.z_mm.value + self.slope_x.value * x_mm + self.slope_y.value * y_mm)
    }
}

/// Fits a line z over x or y.
pub fn fit_line(points: &[FitPoint], axis: LineAxis) -> Result<LineFit, FitError> {
    let coordinate = match axis {
        LineAxis::X => 0,
        LineAxis::Y => 1,
    };
    let solution = solve(points, &[coordinate])?;
    let [z_mm, slope] = [0, 1].map(|k| solution.estimate(k));
    Ok(LineFit { tilt_rad: angle(slope), z_mm, quality: solution.quality })
}

/// Fits a plane.
pub fn fit_plane(points: &[FitPoint]) -> Result<PlaneFit, FitError> {
    let solution = solve(points, &[0, 1])?;
    let [z_mm, slope_x, slope_y] = [0, 1, 2].map(|k| solution.estimate(k));
    let steepest = slope_x.value.hypot(slope_y.value);
    // Deviation of the steepest slope along its own direction.
    let (ux, uy) = if steepest > 0.0 { (slope_x.value / steepest, slope_y.value / steepest) } else { (1.0, 0.0) };
    let c = &solution.covariance;
    let variance = ux * ux * c[(1, 1)] + 2.0 * ux * uy * c[(1, 2)] + uy * uy * c[(2, 2)];
    let tilt_rad = angle(Estimate { value: steepest, std: variance.max(0.0).sqrt() });
    Ok(PlaneFit { slope_x, slope_y, z_mm, tilt_rad, quality: solution.quality })
}

/// Angle of a slope; dθ = d(tan θ) cos² θ.
fn angle(slope: Estimate) -> Estimate {
    Estimate { value: slope.value.atan(), std: slope.std / (1.0 + slope.value * slope.value) }
}

struct Solution {
    parameters: DVector<f64>,
    covariance: DMatrix<f64>,
    quality: Quality,
}

impl Solution {
    fn estimate(&self, index: usize) -> Estimate {
        Estimate { value: self.parameters[index], std: self.covariance[(index, index)].max(0.0).sqrt() }
    }
}

/// Least squares for `z = p₀ + Σ p_k · position[coordinate_k]`.
fn solve(points: &[FitPoint], coordinates: &[usize]) -> Result<Solution, FitError> {
    let (count, parameters) = (points.len(), coordinates.len() + 1);
    if count < parameters {
        return Err(FitError::TooFew { found: count, needed: parameters });
    }
    // Nothing measured lies farther than a thousand kilometres; beyond, squares would overflow.
    const FARTHEST_MM: f64 = 1e12;
    if let Some(index) = points.iter().position(|point| !point.position_mm.iter().all(|c| c.abs() < FARTHEST_MM)) {
        return Err(FitError::NotFinite { index });
    }
    let weights = weights(points);
    let total: f64 = weights.iter().map(|w| w * w).sum();
    let mean = |coordinate: usize| {
        points.iter().zip(&weights).map(|(p, w)| w * w * p.position_mm[coordinate]).sum::<f64>() / total
    };
    // About the weighted mean the columns are nearly orthogonal and the solution loses no digits.
    let means: Vec<f64> = coordinates.iter().map(|&k| mean(k)).collect();
    let z_mean = mean(2);
    let design = DMatrix::from_fn(count, parameters, |i, j| {
        let column = if j == 0 { 1.0 } else { points[i].position_mm[coordinates[j - 1]] - means[j - 1] };
        weights[i] * column
    });
    let right = DVector::from_fn(count, |i, _| weights[i] * (points[i].position_mm[2] - z_mean));
    let normal = design.transpose() * &design;
    degenerate(&normal, total)?;
    let shared = if coordinates.len() == 1 { "position" } else { "line" };
    let factor = normal.cholesky().ok_or(FitError::Degenerate { shared })?;
    let centred = factor.solve(&(design.transpose() * &right));
    let residual = &right - &design * &centred;
    let has_std = points.iter().all(known_std);
    let quality = quality(points, &weights, &residual, z_mean, parameters, has_std);
    let scale = if has_std { 1.0 } else { residual.norm_squared() / (count - parameters).max(1) as f64 };
    // Back from the weighted mean to the origin: z₀ = z̄ + p₀ − Σ p_k x̄_k.
    let shift = DMatrix::from_fn(parameters, parameters, |i, j| match (i, j) {
        (0, j) if j > 0 => -means[j - 1],
        (i, j) => f64::from(u8::from(i == j)),
    });
    let mut parameters = &shift * &centred;
    parameters[0] += z_mean;
    let covariance = &shift * factor.inverse() * shift.transpose() * scale;
    Ok(Solution { parameters, covariance, quality })
}

fn known_std(point: &FitPoint) -> bool {
    point.z_std_mm.is_some_and(|std_mm| std_mm.is_finite() && std_mm > 0.0)
}

/// One over the deviation of each point where all have one, else one for all.
fn weights(points: &[FitPoint]) -> Vec<f64> {
    if points.iter().all(known_std) {
        points.iter().map(|point| 1.0 / point.z_std_mm.unwrap_or(1.0)).collect()
    } else {
        vec![1.0; points.len()]
    }
}

/// Refuses points that span less than a nanometre along one of the coordinates, or along a combination of them less than
/// measured points stray from a line: their errors in depth go with those across, so that some plane fits them all too well.
fn degenerate(normal: &DMatrix<f64>, total: f64) -> Result<(), FitError> {
    const SPAN_MIN_MM: f64 = 1e-6;
    const SPAN_SHARE_MIN: f64 = 3e-3;
    let spans = normal.view((1, 1), (normal.nrows() - 1, normal.ncols() - 1)) / total;
    let values = spans.symmetric_eigenvalues();
    let (shared, share_min) = if spans.nrows() == 1 { ("position", 0.0) } else { ("line", SPAN_SHARE_MIN) };
    let span_min_mm = SPAN_MIN_MM.max(share_min * values.max().max(0.0).sqrt());
    if values.min() < span_min_mm * span_min_mm { Err(FitError::Degenerate { shared }) } else { Ok(()) }
}

fn quality(
    points: &[FitPoint],
    weights: &[f64],
    residual: &DVector<f64>,
    z_mean: f64,
    parameters: usize,
    has_std: bool,
) -> Quality {
    let total: f64 = points.iter().zip(weights).map(|(p, w)| (w * (p.position_mm[2] - z_mean)).powi(2)).sum();
    let left = residual.norm_squared();
    let count = points.len();
    let rms_mm2 = residual.iter().zip(weights).map(|(r, w)| (r / w).powi(2)).sum::<f64>() / count as f64;
    let freedom = count - parameters;
    Quality {
        points: count,
        // Points all at one distance leave nothing to explain.
        r_squared: if total > 0.0 { 1.0 - left / total } else { f64::NAN },
        rms_mm: rms_mm2.sqrt(),
        reduced_chi2: (has_std && freedom > 0).then(|| left / freedom as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64, y: f64, z: f64, z_std_mm: Option<f64>) -> FitPoint {
        FitPoint { position_mm: [x, y, z], z_std_mm }
    }

    #[test]
    fn an_exact_line_is_found() {
        let slope = 30.0_f64.to_radians().tan();
        let points: Vec<_> = (-5..=5).map(|k| point(f64::from(k), 0.3, 300.0 + slope * f64::from(k), None)).collect();
        let line = fit_line(&points, LineAxis::X).expect("a line");
        assert!((line.tilt_rad.value.to_degrees() - 30.0).abs() < 1e-12);
        assert!((line.z_mm.value - 300.0).abs() < 1e-11);
        assert!(line.quality.r_squared > 1.0 - 1e-12);
    }

    #[test]
    fn textbook_line_with_deviations() {
        // Three points at x = 0, 1, 2 with σ = 1: var(slope) = σ²/Σ(x − x̄)² = 1/2, var(z at 0) = σ² (1/3 + 1/2).
        let points =
            [point(0.0, 0.0, 0.0, Some(1.0)), point(1.0, 0.0, 1.0, Some(1.0)), point(2.0, 0.0, 1.0, Some(1.0))];
        let line = fit_line(&points, LineAxis::X).expect("a line");
        assert!((line.tilt_rad.value.tan() - 0.5).abs() < 1e-12);
        assert!((line.tilt_rad.std - 0.5_f64.sqrt() / 1.25).abs() < 1e-12);
        assert!((line.z_mm.std - (1.0_f64 / 3.0 + 0.5).sqrt()).abs() < 1e-12);
        // Residuals −1/6, 1/3, −1/6.
        assert!((line.quality.reduced_chi2.expect("deviations") - 1.0 / 6.0).abs() < 1e-12);
        assert!((line.quality.r_squared - 0.75).abs() < 1e-12);
    }

    #[test]
    fn a_heavier_point_pulls_harder() {
        let points =
            [point(0.0, 0.0, 0.0, Some(1e-6)), point(1.0, 0.0, 1.0, Some(1.0)), point(1.0, 0.0, 3.0, Some(1.0))];
        let line = fit_line(&points, LineAxis::X).expect("a line");
        assert!(line.z_mm.value.abs() < 1e-9 && (line.tilt_rad.value.tan() - 2.0).abs() < 1e-9);
    }

    #[test]
    fn an_exact_plane_is_found() {
        let points: Vec<_> = (0..12)
            .map(|k| (f64::from(k % 4), f64::from(k / 4)))
            .map(|(x, y)| point(x, y, 250.0 + 0.3 * x - 0.4 * y, None))
            .collect();
        let plane = fit_plane(&points).expect("a plane");
        assert!((plane.tilt_rad.value - 0.5_f64.atan()).abs() < 1e-12);
        assert!((plane.z_mm.value - 250.0).abs() < 1e-10);
    }

    #[test]
    fn points_that_cannot_determine_the_fit_are_errors() {
        let on_a_line: Vec<_> = (0..5).map(|k| point(f64::from(k), 2.0 * f64::from(k), 300.0, None)).collect();
        assert_eq!(fit_plane(&on_a_line), Err(FitError::Degenerate { shared: "line" }));
        let measured = |k: u32| {
            let seen = 1.0 + 1e-5 * f64::from(k * 7 % 5);
            point(3.5 * seen, f64::from(k) * seen, 300.0 * seen, Some(0.001))
        };
        let on_one: Vec<_> = (0..6).map(measured).collect();
        assert_eq!(fit_plane(&on_one), Err(FitError::Degenerate { shared: "line" }));
        let one_place = [point(1.0, 0.0, 3.0, None), point(1.0, 2.0, 4.0, None)];
        assert_eq!(fit_line(&one_place, LineAxis::X), Err(FitError::Degenerate { shared: "position" }));
        assert_eq!(fit_line(&[], LineAxis::X), Err(FitError::TooFew { found: 0, needed: 2 }));
        let nan = [point(f64::NAN, 0.0, 0.0, None), point(1.0, 0.0, 0.0, None)];
        assert_eq!(fit_line(&nan, LineAxis::X), Err(FitError::NotFinite { index: 0 }));
    }
}
