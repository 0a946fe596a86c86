//! What the fit of pixels starts from: the points, and what else shines on them.

use std::f64::consts::PI;

use smallvec::SmallVec;
use twinpupil_instrument::PixelPoint;

use super::late::Lone;
use super::{Fitting, Placed, Placing, Reconstructor};
use crate::detect::{Detection, Feature};
use crate::likelihood::prior::{Expected, Prior};
use crate::likelihood::refine::{Seed, Sketch};
use crate::quantile::{STD_PER_DISTANCE, median};
use crate::rejection::{Bystander, RejectionReason};

/// What fills this share of a frame is no dot whose skirts could matter.
const WIDEST_SHARE: f64 = 0.5;

/// Depth of a dot that only one band shows is about that of the others, mm.
const Z_STD_MM: f64 = 30.0;

/// Sizes and contrasts are known no better beforehand than to this share.
const LEAST_SPREAD: f64 = 0.05;

/// Why light is none of a point's.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Source {
    /// The detection's feature of this index has no partner.
    Alone(usize),
    /// The border cuts it.
    Cut,
    /// It could not be measured.
    Flawed,
}

impl Reconstructor {
    /// Collects all that the light of a frame comes from.
    pub(super) fn collect_seeds(&self, detections: &[Detection], placing: &Placing, fitting: &mut Fitting) {
        fitting.seeds.clear();
        fitting.seeds.extend(placing.points.iter().flatten().map(|placed| seed(placed, detections)));
        self.add_lone_seeds(detections, placing, fitting);
    }

    /// Adds the features of one band that became no point, as dots somewhere along the line of sight.
    fn add_lone_seeds(&self, detections: &[Detection], placing: &Placing, fitting: &mut Fitting) {
        let Fitting { seeds, lone, values, is_shown, .. } = fitting;
        lone.clear();
        let points = || placing.points.iter().flatten();
        let z_mm = middle(values, points().map(|placed| placed.point.position_mm[2]));
        let z_mm = Expected { value: z_mm.unwrap_or(self.instrument.focus_distance_mm()), std: Z_STD_MM };
        let diameter_mm = typical(values, points().map(|placed| placed.point.diameter_mm));
        for (band, detection) in detections.iter().enumerate() {
            let height_codes = typical(values, detection.features.iter().map(|feature| feature.height_codes));
            is_shown.clear();
            is_shown.resize(detection.features.len(), false);
            for (group, _) in placing.groups.iter().zip(&placing.points).filter(|(_, point)| point.is_some()) {
                group.feature(band).into_iter().for_each(|index| is_shown[index] = true);
            }
            let shown = detection.features.iter().zip(&*is_shown).enumerate();
            let alone = shown.filter(|(_, (_, shown))| !**shown);
            let alone = alone.map(|(index, (feature, _))| (*feature, Source::Alone(index)));
            let bystanders = detection.rejected.iter().map(|Bystander { feature, reason }| {
                (*feature, if *reason == RejectionReason::CutByBorder { Source::Cut } else { Source::Flawed })
            });
            for (feature, source) in alone.chain(bystanders) {
                let typical = diameter_mm.zip(height_codes).filter(|_| source == Source::Cut);
                let feature = match typical {
                    Some((diameter_mm, height_codes)) => {
                        self.completed(band, feature, diameter_mm.value, height_codes.value, z_mm.value)
                    }
                    None => feature,
                };
                let sign = detection.polarity.sign();
                let prior = Prior {
                    z_mm,
                    diameter_mm: typical.map(|(diameter_mm, _)| diameter_mm),
                    contrast: typical.map(|(_, height)| Expected { value: sign * height.value, std: height.std }),
                };
                let Some(seed) = self.lone_seed(band, &feature, detections, prior) else { continue };
                if let Source::Alone(feature) = source {
                    lone.push(Lone { band, feature, seed: seeds.len() });
                }
                seeds.push(seed);
            }
        }
    }

    /// A feature of one band as a dot of some depth.
    fn lone_seed(&self, band: usize, feature: &Feature, detections: &[Detection], prior: Prior) -> Option<Seed> {
        let [width_px, height_px] = self.instrument.sensor.size_px;
        let diameter_px = 2.0 * (feature.area_px / PI).sqrt();
        let magnification = self.model.magnification(band, prior.z_mm.value);
        let image = self.instrument.sensor.image_from_pixel(feature.centre);
        let mut sketches = SmallVec::from_elem(None, detections.len());
        sketches[band] = Some(sketch(feature, &detections[band]));
        (diameter_px < WIDEST_SHARE * width_px.min(height_px) as f64).then(|| Seed {
            centre_mm: [image.x_mm / magnification, image.y_mm / magnification, prior.z_mm.value],
            diameter_mm: (diameter_px * self.instrument.sensor.pitch_mm / magnification).max(1e-3),
            sketches,
            prior: Some(prior),
            doubtful: true,
            saturated: feature.saturated,
        })
    }

    /// A feature that the border cuts, made whole: the border is the page's.
    fn completed(&self, band: usize, feature: Feature, diameter_mm: f64, height_codes: f64, z_mm: f64) -> Feature {
        let (register, sensor) = (&self.registers[band], &self.instrument.sensor);
        let mut feature = register.on_page(&feature);
        let pitch_mm = sensor.pitch_mm * register.area_px2(feature.centre).sqrt();
        let diameter_px = diameter_mm * self.model.magnification(band, z_mm).abs() / pitch_mm;
        complete(&mut feature, diameter_px, height_codes, sensor.size_px);
        if register.is_identity() { feature } else { register.mapped(&feature) }
    }
}

/// A point as the fit starts from it.
fn seed(placed: &Placed, detections: &[Detection]) -> Seed {
    let sketches = detections
        .iter()
        .enumerate()
        .map(|(band, detection)| placed.feature(band).map(|feature| sketch(feature, detection)));
    Seed {
        centre_mm: placed.point.position_mm,
        diameter_mm: placed.point.diameter_mm,
        sketches: sketches.collect(),
        prior: None,
        doubtful: placed.point.telecentric.overlapped || placed.point.entocentric.overlapped || placed.is_saturated(),
        saturated: placed.is_saturated(),
    }
}

/// A feature as the fit starts from it.
fn sketch(feature: &Feature, detection: &Detection) -> Sketch {
    Sketch { contrast: detection.polarity.sign() * probable_height_codes(feature), area_px: feature.area_px }
}

/// Contrast of a feature, as a guess where the largest code cuts it off.
fn probable_height_codes(feature: &Feature) -> f64 {
    const OVEREXPOSED: f64 = 1.3;
    if feature.saturated { OVEREXPOSED * feature.height_codes } else { feature.height_codes }
}

/// The value in the middle of some.
fn middle(values: &mut Vec<f64>, all: impl Iterator<Item = f64>) -> Option<f64> {
    values.clear();
    values.extend(all);
    median(values)
}

/// The value in the middle of some that are above zero, and how far they scatter about it.
fn typical(values: &mut Vec<f64>, all: impl Iterator<Item = f64>) -> Option<Expected> {
    let value = middle(values, all)?;
    values.iter_mut().for_each(|other| *other = (*other - value).abs());
    let spread = STD_PER_DISTANCE * median(values)?;
    Some(Expected { value, std: spread.max(LEAST_SPREAD * value) })
}

/// Makes what the border leaves of a feature a whole disc of the typical diameter, which shows that area.
///
/// Of a disc of radius R whose centre lies h inside of a line, `R² arccos(−h/R) + h √(R² − h²)` is inside.
fn complete(feature: &mut Feature, diameter_px: f64, height_codes: f64, size_px: [usize; 2]) {
    const HALVINGS: usize = 30;
    let radius_px = 0.5 * diameter_px;
    if feature.area_px > PI * radius_px * radius_px {
        return;
    }
    let inside = |h: f64| radius_px * radius_px * (-h / radius_px).acos() + h * (radius_px * radius_px - h * h).sqrt();
    let (mut low, mut high) = (-radius_px, radius_px);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if inside(middle) < feature.area_px { low = middle } else { high = middle }
    }
    let [width_px, height_px] = size_px.map(|size| size as f64 - 0.5);
    let PixelPoint { u, v } = feature.centre;
    let gaps_px = [u + 0.5, width_px - u, v + 0.5, height_px - v];
    let nearest = (0..4).min_by(|a, b| gaps_px[*a].total_cmp(&gaps_px[*b])).unwrap_or(0);
    let centre = &mut feature.centre;
    match nearest {
        0 => centre.u = low - 0.5,
        1 => centre.u = width_px - low,
        2 => centre.v = low - 0.5,
        _ => centre.v = height_px - low,
    }
    feature.area_px = PI * radius_px * radius_px;
    feature.height_codes = feature.height_codes.max(height_codes);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_dot_at_the_border_is_a_whole_one() {
        let seen = |u: f64, v: f64, area_px: f64| {
            let centre = PixelPoint { u, v };
            let mut feature = Feature {
                centre,
                centre_std_px: [0.5; 2],
                area_px,
                height_codes: 900.0,
                ground_codes: 0.0,
                edge_px: 2.0,
                overlapped: false,
                saturated: false,
            };
            complete(&mut feature, 40.0, 1000.0, [200, 100]);
            feature
        };
        let half = seen(60.0, 8.0, 0.5 * PI * 400.0);
        assert!((half.centre.v + 0.5).abs() < 1e-6 && half.centre.u == 60.0, "{half:?}");
        assert!((half.area_px - PI * 400.0).abs() < 1e-9 && half.height_codes == 1000.0);
        let sliver = seen(196.0, 50.0, 100.0);
        assert!((200.0..219.5).contains(&sliver.centre.u), "{sliver:?}");
        assert_eq!(seen(60.0, 8.0, 2000.0).area_px, 2000.0);
    }
}
