//! How spots lie beside where they should: along and across the direction from the axis, and over what that may depend
//! on.

use twinpupil_calibrate::{Calibration, Residual};
use twinpupil_instrument::{ImagePoint, Instrument};

/// A spot, seen from the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spot {
    pub(super) band: usize,
    /// Where its dot is: distance from the axis (mm), depth (mm), azimuth (degrees).
    pub(super) place: [f64; 3],
    /// Outwards and sideways, towards growing azimuth, px.
    pub(super) off_px: [f64; 2],
}

/// All spots of a calibration but those that are doubted.
pub(super) fn spots(calibration: &Calibration) -> Vec<Spot> {
    let instrument = &calibration.instrument;
    let axes: Vec<[f64; 2]> = (0..instrument.bands.len()).map(|band| axis_px(instrument, band)).collect();
    let sound = calibration.residuals.iter().filter(|residual| !residual.is_doubted);
    sound.map(|residual| spot(residual, axes[residual.band])).collect()
}

fn spot(residual: &Residual, axis_px: [f64; 2]) -> Spot {
    let ([u, v, ..], [x, y, z]) = (residual.foreseen_px, residual.position_mm);
    let from_axis = [u - axis_px[0], v - axis_px[1]];
    let radius_px = from_axis[0].hypot(from_axis[1]);
    let [cos, sin] = if radius_px > 0.0 { from_axis.map(|part| part / radius_px) } else { [1.0, 0.0] };
    let [du, dv, ..] = residual.off_px;
    Spot {
        band: residual.band,
        place: [x.hypot(y), z, y.atan2(x).to_degrees()],
        off_px: [cos * du + sin * dv, cos * dv - sin * du],
    }
}

/// Where the axis meets the page of a band.
fn axis_px(instrument: &Instrument, band: usize) -> [f64; 2] {
    let axis = instrument.page(&instrument.bands[band]).to_page(ImagePoint::default());
    [axis.u, axis.v]
}

/// A unit in which lengths on the sensor are numbers of few digits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PixelUnit {
    pub(super) per_px: f64,
    pub(super) name: &'static str,
}

impl PixelUnit {
    /// That for lengths about so long.
    pub(super) fn of(length_px: f64) -> Self {
        match length_px {
            small if small < 3e-4 => Self { per_px: 1e6, name: "10⁻⁶ px" },
            medium if medium < 0.3 => Self { per_px: 1e3, name: "10⁻³ px" },
            _ => Self { per_px: 1.0, name: "px" },
        }
    }

    /// What stands behind a number of it.
    pub(super) fn suffix(self) -> String {
        if self.per_px > 1.0 { format!("× {}", self.name) } else { self.name.to_owned() }
    }
}

/// A mean with its own deviation, at the middle of what it is the mean of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Mean {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) y_std: f64,
}

/// Means over equal steps of the abscissa, where there are points enough.
pub(super) fn means(points: &[[f64; 2]]) -> Vec<Mean> {
    const STEPS: usize = 12;
    const POINTS_MIN: usize = 4;
    let xs = || points.iter().map(|[x, _]| *x);
    let (low, high) = (xs().fold(f64::INFINITY, f64::min), xs().fold(f64::NEG_INFINITY, f64::max));
    let step = |x: f64| (((x - low) / (high - low) * STEPS as f64) as usize).min(STEPS - 1);
    let mean = |own: Vec<&[f64; 2]>| {
        let count = own.len() as f64;
        let of = |axis: usize| own.iter().map(|point| point[axis]).sum::<f64>() / count;
        let [x, y] = [of(0), of(1)];
        let variance = own.iter().map(|point| (point[1] - y).powi(2)).sum::<f64>() / (count - 1.0);
        Mean { x, y, y_std: (variance / count).sqrt() }
    };
    let of_step = |index: usize| points.iter().filter(move |[x, _]| step(*x) == index).collect::<Vec<_>>();
    (0..STEPS).map(of_step).filter(|own| own.len() >= POINTS_MIN).map(mean).collect()
}

/// Half a range about 0 that shows all but wrong values: so many times the typical one at most.
pub(super) fn reach(values: impl Iterator<Item = f64>) -> f64 {
    const TYPICAL: f64 = 6.0;
    let mut sizes: Vec<f64> = values.map(f64::abs).filter(|size| size.is_finite()).collect();
    sizes.sort_by(f64::total_cmp);
    let (Some(most), Some(typical)) = (sizes.last(), sizes.get(sizes.len() / 2)) else { return 1.0 };
    let reach = most.min(TYPICAL * typical);
    if reach > 0.0 { 1.05 * reach } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn residuals_are_taken_apart_about_the_axis() {
        let residual = |foreseen_px: [f64; 4], off_px: [f64; 4]| Residual {
            frame: 0,
            band: 1,
            dot: 0,
            foreseen_px,
            off_px,
            std_px: [1.0; 4],
            chi2: 0.0,
            is_doubted: false,
            is_cut: false,
            position_mm: [0.0, -3.0, 280.0],
        };
        // Above the axis, outwards is up and growing azimuth is to the right.
        let above = spot(&residual([10.0, 5.0, 1.0, 1.0], [0.2, -0.3, 0.0, 0.0]), [10.0, 20.0]);
        assert_eq!(above, Spot { band: 1, place: [3.0, 280.0, -90.0], off_px: [0.3, 0.2] });
        let on_axis = spot(&residual([10.0, 20.0, 1.0, 1.0], [0.2, -0.3, 0.0, 0.0]), [10.0, 20.0]);
        assert_eq!(on_axis.off_px, [0.2, -0.3]);
    }

    #[test]
    fn means_tell_how_well_they_are_known() {
        let points: Vec<[f64; 2]> = (0..48).map(|k| [f64::from(k / 4), f64::from(k % 2)]).collect();
        let means = means(&points);
        assert_eq!(means.len(), 12);
        assert_eq!((means[3].x, means[3].y), (3.0, 0.5));
        assert!((means[3].y_std - (1.0_f64 / 3.0 / 4.0).sqrt()).abs() < 1e-12);
        assert!(super::means(&[]).is_empty() && super::means(&[[1.0, 1.0]; 3]).is_empty());
        assert_eq!(super::means(&[[1.0, 2.0]; 5])[0], Mean { x: 1.0, y: 2.0, y_std: 0.0 });
    }

    #[test]
    fn a_wrong_spot_does_not_stretch_the_range() {
        let range = reach([1.0, -1.0, 1.0, 900.0].into_iter());
        assert!((range - 6.3).abs() < 1e-12, "{range}");
        assert_eq!(reach([0.0, f64::NAN].into_iter()), 1.0);
        assert_eq!(reach(std::iter::empty()), 1.0);
    }
}
