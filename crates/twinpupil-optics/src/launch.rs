//! Rays from the sensor towards places in the rear principal plane, and what comes out in front of the lens: a block of them
//! side by side, in loops without a branch.

use multiversion::multiversion;

use crate::aim::AimAt;
use crate::linear::Linear;
use crate::train::{Block, LANES};
use crate::{ObjectRays, RayStarts};

/// Where the rays of a block cross the rear principal plane, and the area there that each stands for.
pub(crate) struct Places {
    at_mm: [[f64; LANES]; 2],
    /// Over that behind the ideal lens.
    area: [f64; LANES],
}

/// How rays leave the sensor.
pub(crate) struct Launch {
    /// Rear principal plane to sensor, mm.
    pub(crate) sensor_distance_mm: f64,
    /// Weight of a ray along the axis.
    pub(crate) axial_weight: f64,
    /// Whether rays weigh alike, whatever angle they make with the axis.
    pub(crate) is_paraxial: bool,
}

impl Places {
    /// Behind an ideal lens.
    pub(crate) fn ideal(map: &Linear, starts: &RayStarts<'_>) -> Self {
        let mut places = Self { at_mm: [[0.0; LANES]; 2], area: [1.0; LANES] };
        let [x_mm, y_mm] = &mut places.at_mm;
        map.fill(0, starts.pupil_x, starts.image_x_mm, x_mm);
        map.fill(1, starts.pupil_y, starts.image_y_mm, y_mm);
        places
    }

    /// Moves them to where the real lens needs them. `per_pupil_mm` is the unit of the pupil behind the ideal lens.
    pub(crate) fn aim(&mut self, aim: impl Fn([f64; 2]) -> AimAt, starts: &RayStarts<'_>, per_pupil_mm: f64) {
        let image_mm = |lane: usize| [starts.image_x_mm[lane], starts.image_y_mm[lane]];
        let mut first = 0;
        while first < starts.len() {
            // Most blocks start at one image point.
            let end = (first..starts.len()).find(|lane| image_mm(*lane) != image_mm(first)).unwrap_or(starts.len());
            let aimed = aim(image_mm(first));
            let [x_mm, y_mm] = &mut self.at_mm;
            let places_mm = [&mut x_mm[first..end], &mut y_mm[first..end]];
            let pupil = [&starts.pupil_x[first..end], &starts.pupil_y[first..end]];
            add(&aimed, per_pupil_mm, pupil, places_mm, &mut self.area[first..end]);
            first = end;
        }
    }
}

impl Launch {
    /// Puts rays from the sensor to their places into a block, and their weights.
    pub(crate) fn fill(&self, starts: &RayStarts<'_>, places: &Places, block: &mut Block, weight: &mut [f64]) {
        leave(self, starts, places, block, weight);
    }
}

/// Adds what the lens does to places from one image point, and how it spreads them.
#[multiversion(targets("x86_64+avx2+fma"))]
fn add(aim: &AimAt, per_pupil_mm: f64, [u, v]: [&[f64]; 2], [x_mm, y_mm]: [&mut [f64]; 2], area: &mut [f64]) {
    let per_mm = 1.0 / per_pupil_mm;
    let places_mm = x_mm.iter_mut().zip(y_mm);
    for ((u, v), ((x_mm, y_mm), area)) in u.iter().zip(v).zip(places_mm.zip(area)) {
        let aimed = aim.at([*u, *v]);
        let [[a, b], [c, d]] = aimed.slopes_mm;
        *x_mm += aimed.place_mm[0];
        *y_mm += aimed.place_mm[1];
        *area = ((1.0 + per_mm * a) * (1.0 + per_mm * d) - per_mm * per_mm * (b * c)).abs();
    }
}

/// In the axes of the prescription, whose y points up where that of the sensor points down.
#[multiversion(targets("x86_64+avx2+fma"))]
fn leave(launch: &Launch, starts: &RayStarts<'_>, places: &Places, block: &mut Block, weight: &mut [f64]) {
    let count = weight.len().min(LANES);
    let (x_mm, y_mm) = (&starts.image_x_mm[..count], &starts.image_y_mm[..count]);
    let ([to_x_mm, to_y_mm], area) = (&places.at_mm, &places.area);
    let away_mm = launch.sensor_distance_mm;
    for lane in 0..count {
        let (dx, dy) = (to_x_mm[lane] + x_mm[lane], -to_y_mm[lane] - y_mm[lane]);
        let square = dx.mul_add(dx, dy.mul_add(dy, away_mm * away_mm));
        let per_length = 1.0 / square.sqrt();
        let cos = away_mm * per_length;
        let falloff = if launch.is_paraxial { 1.0 } else { (cos * cos) * (cos * cos) };
        weight[lane] = launch.axial_weight * area[lane] * falloff;
        block.put(lane, [-x_mm[lane], y_mm[lane], 0.0], [dx * per_length, dy * per_length, -cos]);
    }
}

/// The lines of a block of rays in front of the lens, in the order of `rays` from `first` on.
#[multiversion(targets("x86_64+avx2+fma"))]
pub(crate) fn arrive(block: &Block, first: usize, count: usize, rays: &mut ObjectRays) {
    let range = first..first + count.min(LANES);
    let ([x, y, _], [dx, dy, dz]) = (&block.position_mm, &block.direction);
    let (x_mm, y_mm) = (&mut rays.x_mm[range.clone()], &mut rays.y_mm[range.clone()]);
    let (slope_x, slope_y) = (&mut rays.slope_x[range.clone()], &mut rays.slope_y[range]);
    let count = x_mm.len().min(y_mm.len()).min(slope_x.len()).min(slope_y.len()).min(LANES);
    for lane in 0..count {
        let per_z = 1.0 / dz[lane];
        (x_mm[lane], y_mm[lane]) = (x[lane], -y[lane]);
        (slope_x[lane], slope_y[lane]) = (-dx[lane] * per_z, dy[lane] * per_z);
    }
}
