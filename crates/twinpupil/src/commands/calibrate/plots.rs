//! The drawings of a calibration.

use twinpupil_calibrate::{Calibration, Residual, Target, significant};
use twinpupil_instrument::{Band, Instrument, Page, PixelPoint, Projection, Role};
use twinpupil_reconstruct::{Options, Reconstructor};

use super::residuals::{PixelUnit, Spot, means, reach};
use crate::heat_map::HeatMap;
use crate::plot::{Chart, Colour, PlotPoint, Stroke};
use crate::precision::Grid;
use crate::report::Figure;
use crate::vector_map::{Arrow, VectorMap};

/// The colour of a band by its role.
fn colour(role: Role) -> Colour {
    match role {
        Role::Telecentric => Colour::Vermilion,
        Role::Entocentric => Colour::Blue,
        Role::Intermediate => Colour::Green,
    }
}

/// For every band, how its spots lie beside where they should, over the sensor.
pub(super) fn residual_maps(calibration: &Calibration, unit: PixelUnit) -> Vec<Figure> {
    let instrument = &calibration.instrument;
    let size_px = instrument.sensor.size_px.map(|size| size as f64);
    let sensor = [[-0.5; 2], size_px.map(|size| size - 0.5)];
    let map = |band: usize| {
        let own: Vec<&Residual> = calibration.residuals.iter().filter(|residual| residual.band == band).collect();
        let (arrows, is_mean) = arrows(&own, size_px);
        let svg =
            VectorMap::new(sensor, &arrows, colour(instrument.bands[band].role)).into_svg(unit.per_px, &unit.suffix());
        let what = if is_mean { "the mean of spots close together" } else { "one spot" };
        let text = format!(
            "Band {}, {} spots: how far they lie from where they should, over the sensor. Each arrow is {what}, \
             enlarged as the key tells.",
            instrument.bands[band].name,
            own.len()
        );
        Figure::new(svg, text)
    };
    (0..instrument.bands.len()).map(map).collect()
}

/// For every band with a correction, where that has its images, over the sensor.
pub(super) fn correction_maps(instrument: &Instrument) -> Vec<Figure> {
    const COLUMNS: usize = 20;
    let size_px = instrument.sensor.size_px.map(|size| size as f64);
    let step_px = size_px[0] / COLUMNS as f64;
    let rows = (size_px[1] / step_px) as usize;
    let map = |band: &Band| {
        let displacement = band.correction.as_ref()?.displacement();
        let page = instrument.page(band);
        let arrow = |k: usize| {
            let at = [k % COLUMNS, k / COLUMNS].map(|place| (place as f64 + 0.5) * step_px);
            let image = page.to_image(PixelPoint { u: at[0], v: at[1] });
            let offset = displacement.at([image.x_mm, image.y_mm]).map(|mm| mm / instrument.sensor.pitch_mm);
            Arrow { at, offset }
        };
        let arrows: Vec<Arrow> = (0..COLUMNS * rows).map(arrow).collect();
        let square = |Arrow { offset: [du, dv], .. }: &Arrow| du * du + dv * dv;
        let rms_px = (arrows.iter().map(square).sum::<f64>() / arrows.len().max(1) as f64).sqrt();
        let unit = PixelUnit::of(rms_px);
        let sensor = [[-0.5; 2], size_px.map(|size| size - 0.5)];
        let svg = VectorMap::new(sensor, &arrows, colour(band.role)).into_svg(unit.per_px, &unit.suffix());
        let text = format!(
            "Band {}: how far its correction displaces images, over the sensor; root mean square {} {}. Beyond the dots of the \
             frames it goes on as its terms do, and is worth little.",
            band.name,
            significant(unit.per_px * rms_px, 2),
            unit.suffix()
        );
        Some(Figure::new(svg, text))
    };
    instrument.bands.iter().filter_map(map).collect()
}

/// An arrow for every spot, or means over squares of the sensor where there are too many to tell apart.
fn arrows(residuals: &[&Residual], size_px: [f64; 2]) -> (Vec<Arrow>, bool) {
    const ARROWS_MAX: usize = 500;
    const COLUMNS: f64 = 24.0;
    let arrow = |residual: &&Residual| {
        let ([u, v, ..], [du, dv, ..]) = (residual.foreseen_px, residual.off_px);
        Arrow { at: [u, v], offset: [du, dv] }
    };
    let all: Vec<Arrow> = residuals.iter().map(arrow).collect();
    if all.len() <= ARROWS_MAX {
        return (all, false);
    }
    let side_px = size_px[0] / COLUMNS;
    let square = |arrow: &Arrow| arrow.at.map(|place| (place / side_px).floor() as i64);
    let mut sorted = all;
    sorted.sort_by_key(square);
    let mean = |own: &[Arrow]| {
        let of = |part: &dyn Fn(&Arrow) -> f64| own.iter().map(part).sum::<f64>() / own.len() as f64;
        Arrow { at: [0, 1].map(|k| of(&|arrow| arrow.at[k])), offset: [0, 1].map(|k| of(&|arrow| arrow.offset[k])) }
    };
    (sorted.chunk_by(|a, b| square(a) == square(b)).map(mean).collect(), true)
}

/// What residuals are drawn over.
const OVER: [&str; 3] = ["r, mm", "z, mm", "azimuth, °"];
const AZIMUTH: usize = 2;

/// The residuals over r, z and azimuth: outwards, then sideways.
pub(super) fn trends(instrument: &Instrument, spots: &[Spot], unit: PixelUnit) -> Vec<Figure> {
    let reach_px = reach(spots.iter().flat_map(|spot| spot.off_px));
    let chart = |over: usize, part: usize| trend(instrument, spots, unit, reach_px, [over, part]);
    (0..OVER.len()).flat_map(|over| [0, 1].map(|part| chart(over, part))).collect()
}

fn trend(instrument: &Instrument, spots: &[Spot], unit: PixelUnit, reach_px: f64, [over, part]: [usize; 2]) -> Figure {
    let direction = ["outwards", "sideways"][part];
    let mut chart = Chart::new(OVER[over], &format!("{direction}, {}", unit.name))
        .y_range(-unit.per_px * reach_px, unit.per_px * reach_px);
    if over == AZIMUTH {
        chart = chart.x_range(-180.0, 180.0);
    }
    let of_band = |band: usize| -> Vec<[f64; 2]> {
        let own = spots.iter().filter(|spot| spot.band == band);
        own.map(|spot| [spot.place[over], unit.per_px * spot.off_px[part]]).collect()
    };
    let bands: Vec<Vec<[f64; 2]>> = (0..instrument.bands.len()).map(of_band).collect();
    let all = || bands.iter().flatten();
    let is_shown = |point: &&[f64; 2]| point[1].abs() <= unit.per_px * reach_px;
    for (band, points) in instrument.bands.iter().zip(&bands) {
        let shown: Vec<[f64; 2]> = thinned(points).filter(is_shown).copied().collect();
        chart = chart.cloud(colour(band.role), &shown);
    }
    let ends = all().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [x, _]| [low.min(*x), high.max(*x)]);
    chart = chart.line("", Colour::Grey, Stroke::Dashed, &ends.map(|x| [x, 0.0]));
    for (band, points) in instrument.bands.iter().zip(&bands) {
        let means: Vec<PlotPoint> =
            means(points).iter().map(|mean| PlotPoint { x: mean.x, y: mean.y, y_error: mean.y_std }).collect();
        chart = chart.points(&band.name, colour(band.role), &means);
    }
    let beyond = all().filter(|point| !is_shown(point)).count();
    let what = ["away from the axis", "about the axis"][part];
    let mut caption =
        format!("The part of the residuals {what}. Faint: single spots; bold: means with their deviation.");
    if beyond > 0 {
        caption += &format!(" {beyond} lie beyond the frame.");
    }
    Figure::new(chart.into_svg(), caption)
}

/// As many points as a plot needs, evenly taken.
fn thinned<T>(points: &[T]) -> impl Iterator<Item = &T> {
    const POINTS_MAX: usize = 1200;
    points.iter().step_by(points.len().div_ceil(POINTS_MAX).max(1))
}

/// Where the dots were that the calibration rests on.
pub(super) fn coverage(spots: &[Spot], instrument: &Instrument) -> Figure {
    let of = |role: Role| -> Vec<[f64; 2]> {
        let own: Vec<&Spot> = spots.iter().filter(|spot| spot.band == instrument.band_index(role)).collect();
        thinned(&own).map(|spot| [spot.place[0], spot.place[1]]).collect()
    };
    let range = instrument.depth_range();
    let points: Vec<PlotPoint> = of(Role::Entocentric).into_iter().map(PlotPoint::from).collect();
    let outermost_mm = points.iter().map(|point| point.x).fold(0.0, f64::max).max(1e-3);
    let chart = Chart::new("r, mm", "z, mm")
        .band("depth range", Colour::Grey, [0.0, outermost_mm], [range.near_mm, range.far_mm])
        .points("dots", colour(Role::Entocentric), &points);
    Figure::new(
        chart.into_svg(),
        "Where the dots were that the calibration rests on. Far from them its numbers hold less than the map says.",
    )
}

/// What the uncertainty of the instrument's numbers does to depth, over r and z; `None` if it was not calibrated.
pub(super) fn depth_map(instrument: &Instrument) -> Option<Figure> {
    let grid = Grid::new(instrument, None, None, 0.0);
    let reader = Reconstructor::new(instrument.clone(), None, Options::default());
    let pair = [Role::Telecentric, Role::Entocentric].map(|role| {
        let band = instrument.band(role);
        (instrument.projection(band), instrument.page(band))
    });
    let value = |z_mm: f64, r_mm: f64| depth_std_um(&reader, &pair, z_mm, r_mm).unwrap_or(f64::NAN);
    let row = |z_mm: &f64| grid.r_mm.iter().map(|r_mm| value(*z_mm, *r_mm)).collect::<Vec<f64>>();
    let values: Vec<Vec<f64>> = grid.z_mm.iter().map(row).collect();
    if !values.iter().flatten().any(|value| value.is_finite()) {
        return None;
    }
    let names = |values: &[f64]| values.iter().map(|value| ((1e6 * value).round() / 1e6).to_string()).collect();
    let map = HeatMap::new("σ_z, µm", ["r, mm", "z, mm"], names(&grid.r_mm), names(&grid.z_mm), values);
    Some(Figure::new(
        map.into_svg(),
        "What the calibration leaves uncertain of depth: the standard deviation that all points near by share, so that \
         averaging does not lessen it. Empty: not on the sensor.",
    ))
}

/// The root mean square over azimuths of the deviation of depth, µm, where both bands show the point.
fn depth_std_um(reader: &Reconstructor, pair: &[(Projection, Page); 2], z_mm: f64, r_mm: f64) -> Option<f64> {
    const AZIMUTHS: u8 = 12;
    let sensor = &reader.instrument().sensor;
    let is_seen = |position_mm: [f64; 3]| {
        pair.iter().all(|(projection, page)| {
            let pixel = page.to_page(projection.image(position_mm));
            [pixel.u, pixel.v].iter().zip(sensor.size_px).all(|(place, size)| (0.0..size as f64).contains(place))
        })
    };
    let variance = |k: u8| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(AZIMUTHS)).sin_cos();
        let position_mm = [r_mm * cos, r_mm * sin, z_mm];
        if is_seen(position_mm) { Some(reader.calibration_covariance_mm2(position_mm)?[2][2]) } else { None }
    };
    let variances: Vec<f64> = (0..AZIMUTHS).filter_map(variance).collect();
    let mean = variances.iter().sum::<f64>() / variances.len() as f64;
    (mean >= 0.0).then(|| 1e3 * mean.sqrt())
}

/// Where the target's dots lie beside their places, if that was sought.
pub(super) fn target_map(target: &Target, offsets_mm: &[[f64; 2]]) -> Figure {
    let spec = target.spec();
    let half_mm = [spec.columns, spec.rows].map(|count| 0.5 * count as f64 * spec.pitch_mm);
    let arrow =
        |(dot, offset): (&twinpupil_calibrate::TargetDot, &[f64; 2])| Arrow { at: dot.position_mm, offset: *offset };
    let arrows: Vec<Arrow> = target.dots().iter().zip(offsets_mm).map(arrow).collect();
    let svg = VectorMap::new([half_mm.map(|half| -half), half_mm], &arrows, Colour::Purple).into_svg(1e3, "µm");
    Figure::new(svg, "Where the target's dots lie beside the places that its file states.")
}

#[cfg(test)]
mod tests {
    use super::super::page::tests::calibration;
    use super::*;

    #[test]
    fn crowded_spots_are_averaged() {
        let one = calibration().residuals[0];
        let at =
            |k: u32| Residual { foreseen_px: [f64::from(k), 10.0, 1.0, 1.0], off_px: [f64::from(k % 2); 4], ..one };
        let many: Vec<Residual> = (0..960).map(at).collect();
        let (arrows, is_mean) = arrows(&many.iter().collect::<Vec<_>>(), [960.0, 600.0]);
        assert_eq!((arrows.len(), is_mean), (24, true));
        assert_eq!(arrows[0], Arrow { at: [19.5, 10.0], offset: [0.5, 0.5] });
        assert_eq!(thinned(&many).count(), 960);
        assert_eq!(thinned(&[0; 3000]).count(), 1000);
        assert_eq!(thinned::<u8>(&[]).count(), 0);
    }

    #[test]
    fn an_instrument_that_was_not_calibrated_has_no_map() {
        assert_eq!(depth_map(&twinpupil_instrument::paper::instrument()), None);
    }
}
