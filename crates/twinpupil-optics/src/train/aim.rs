//! Rays aimed at the stop.

use super::face::{Clear, Face};
use super::{Fate, Ray, Rays, Train};

/// Where rays come from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Field {
    /// A point at infinity, by the slopes dx/dz and dy/dz of its rays. Their path lengths count from one wavefront.
    Infinite {
        /// Along x and y.
        slope: [f64; 2],
    },
    /// A point in front of the first surface, in its axes. Rays start there.
    Point {
        /// x, y, z.
        position_mm: [f64; 3],
    },
}

/// Steps of Newton's method after which a ray that misses its aim is given up.
const STEPS_MAX: usize = 25;

/// How near a ray must come to its place in the stop, relative to the stop's radius: ten times what rounding leaves.
const TOLERANCE: f64 = 1e-12;

/// Step of the difference quotients relative to the stop's radius.
pub(crate) const DIFFERENCE: f64 = 1e-6;

impl Field {
    /// The ray from the field through a point of the plane z = 0 before the first surface.
    pub(crate) fn ray(&self, [x, y]: [f64; 2]) -> Ray {
        match self {
            Self::Infinite { slope } => {
                let ray = Ray::new([x, y, 0.0], [slope[0], slope[1], 1.0]);
                let path_mm = ray.direction[0] * x + ray.direction[1] * y;
                Ray { path_mm, ..ray }
            }
            Self::Point { position_mm } => {
                Ray::new(*position_mm, [x - position_mm[0], y - position_mm[1], -position_mm[2]])
            }
        }
    }

    /// The same field as far from the lens, on its axis.
    pub(crate) fn on_axis(&self) -> Self {
        match self {
            Self::Infinite { .. } => Self::Infinite { slope: [0.0; 2] },
            Self::Point { position_mm } => Self::Point { position_mm: [0.0, 0.0, position_mm[2]] },
        }
    }

    /// Where a ray that shall meet a place of the stop crosses the plane z = 0, to first order.
    fn guess_mm(&self, to_stop: &CloseRays, place_mm: [f64; 2]) -> [f64; 2] {
        let CloseRays { axial_mm, per_height, per_slope_mm } = to_stop;
        let start_mm = [0, 1].map(|k| match self {
            Self::Infinite { slope } => (place_mm[k] - axial_mm[k] - per_slope_mm * slope[k]) / per_height,
            Self::Point { position_mm } => {
                // A start at h has the slope (h − x)/D.
                let (x_mm, distance_mm) = (position_mm[k], -position_mm[2]);
                (place_mm[k] - axial_mm[k] + per_slope_mm * x_mm / distance_mm)
                    / (per_height + per_slope_mm / distance_mm)
            }
        });
        if start_mm.iter().all(|mm| mm.is_finite()) { start_mm } else { [0.0; 2] }
    }
}

/// Where rays close to the axis end behind some surfaces: by the height in which they cross the plane z = 0, and by their
/// slope before it.
struct CloseRays {
    /// That of the axis itself, mm.
    axial_mm: [f64; 2],
    per_height: f64,
    per_slope_mm: f64,
}

/// How close to the axis they are: in parts of the stop's radius, and as a slope.
const CLOSE: f64 = 1e-4;

impl CloseRays {
    fn through(to_stop: &Train, stop_radius_mm: f64) -> Self {
        let height_mm = CLOSE * stop_radius_mm;
        let starts = [([0.0; 3], 0.0), ([0.0, height_mm, 0.0], 0.0), ([0.0; 3], CLOSE)];
        let mut rays: Rays =
            starts.map(|(start_mm, slope)| Ray::new(start_mm, [0.0, slope, 1.0])).into_iter().collect();
        to_stop.trace(&mut rays);
        let [x, y, _] = rays.ray(0).position_mm;
        Self {
            axial_mm: [x, y],
            per_height: (rays.ray(1).position_mm[1] - y) / height_mm,
            per_slope_mm: (rays.ray(2).position_mm[1] - y) / CLOSE,
        }
    }
}

impl Train {
    /// Rays in front of the first surface, from the field through places of the stop, which is surface `stop` of the
    /// prescription; places are in mm from its vertex and `stop_radius_mm` says how large they are. `None` where no ray
    /// gets there. Clear apertures are not asked.
    ///
    /// Newton's method for every ray by itself, so that none depends on its neighbours.
    pub fn aim(&self, stop: usize, field: Field, places_mm: &[[f64; 2]], stop_radius_mm: f64) -> Vec<Option<Ray>> {
        aimed(&self.clear_to(stop), field, places_mm, stop_radius_mm)
    }

    /// How far from its vertex a ray meets the stop, surface `stop` of the prescription, that comes from the field and crosses
    /// the plane of the first vertex at a height; `None` if it does not get there. For the rim of the entrance pupil that
    /// is the radius of the stop.
    pub fn height_at_stop_mm(&self, stop: usize, field: Field, height_mm: f64) -> Option<f64> {
        let mut rays: Rays = [field.ray([0.0, height_mm])].into_iter().collect();
        self.clear_to(stop).trace(&mut rays);
        let [x_mm, y_mm, _] = rays.ray(0).position_mm;
        (rays.fate(0) == Fate::Arrived).then(|| x_mm.hypot(y_mm))
    }

    /// The surfaces as far as the stop, clear everywhere.
    pub(crate) fn clear_to(&self, stop: usize) -> Self {
        let lens = self.faces.iter().filter(|face| face.clear.rings.is_none());
        let count = lens.clone().position(|face| face.index == stop).map_or(0, |at| at + 1);
        let faces = lens.take(count).map(|face| Face { clear: Clear::EVERYWHERE, ..face.clone() });
        Self { faces: super::linked(faces.collect()) }
    }
}

/// Rays from a field through places of a stop, `to_stop` being the surfaces as far as that.
pub(crate) fn aimed(to_stop: &Train, field: Field, places_mm: &[[f64; 2]], stop_radius_mm: f64) -> Vec<Option<Ray>> {
    let close = CloseRays::through(to_stop, stop_radius_mm);
    let mut seekers: Vec<Seeker> =
        places_mm.iter().map(|place_mm| Seeker::new(*place_mm, field.guess_mm(&close, *place_mm))).collect();
    Aiming::at_stop(to_stop, &|_, start_mm| field.ray(start_mm), stop_radius_mm).seek(&mut seekers);
    seekers.into_iter().map(|seeker| seeker.is_there.then(|| field.ray(seeker.start_mm))).collect()
}

/// A ray on its way to its aim.
pub(crate) struct Seeker {
    /// What shall be reached: a place in the stop, mm, or whatever else is asked of rays.
    aim: [f64; 2],
    /// Where it crosses the plane by which it is started.
    pub(crate) start_mm: [f64; 2],
    pub(crate) is_there: bool,
    /// How much of what is reached a unit of area of its starts covers; known where it is there.
    pub(crate) spread: f64,
}

impl Seeker {
    pub(crate) fn new(aim: [f64; 2], start_mm: [f64; 2]) -> Self {
        Self { aim, start_mm, is_there: false, spread: 0.0 }
    }
}

/// Where a seeker's ray starts, by its index and the place where it crosses the plane by which it is started.
type Launch<'a> = dyn Fn(usize, [f64; 2]) -> Ray + 'a;

/// How rays are aimed.
pub(crate) struct Aiming<'a> {
    /// The surfaces that they go through.
    pub(crate) train: &'a Train,
    pub(crate) launch: &'a Launch<'a>,
    /// What shall be as it is aimed at, of a ray behind the surfaces.
    pub(crate) reached: &'a dyn Fn(&Ray) -> [f64; 2],
    /// Step of the difference quotients. Its error only slows the method down.
    pub(crate) step_mm: f64,
    /// How near is near enough.
    pub(crate) tolerance: f64,
}

impl<'a> Aiming<'a> {
    /// At places of a stop.
    pub(crate) fn at_stop(train: &'a Train, launch: &'a Launch<'a>, stop_radius_mm: f64) -> Self {
        let reached = &|ray: &Ray| [ray.position_mm[0], ray.position_mm[1]];
        Self { train, launch, reached, step_mm: DIFFERENCE * stop_radius_mm, tolerance: TOLERANCE * stop_radius_mm }
    }

    /// Newton's method for all seekers.
    pub(crate) fn seek(&self, seekers: &mut [Seeker]) {
        for _ in 0..STEPS_MAX {
            if !self.improve(seekers) {
                break;
            }
        }
    }

    /// One step of it for all that are not there; whether there were any.
    fn improve(&self, seekers: &mut [Seeker]) -> bool {
        let mut open: Vec<(usize, &mut Seeker)> =
            seekers.iter_mut().enumerate().filter(|(_, seeker)| !seeker.is_there).collect();
        // Each ray, and one beside it along x and y.
        let trios = open.iter().flat_map(|(index, seeker)| {
            let [x, y] = seeker.start_mm;
            let starts_mm = [[x, y], [x + self.step_mm, y], [x, y + self.step_mm]];
            starts_mm.map(|start_mm| (self.launch)(*index, start_mm))
        });
        let mut rays: Rays = trios.collect();
        self.train.trace(&mut rays);
        for (n, (_, seeker)) in open.iter_mut().enumerate() {
            let arrived = (0..3).all(|j| rays.fate(3 * n + j) == Fate::Arrived);
            self.step(seeker, arrived.then(|| [0, 1, 2].map(|j| (self.reached)(&rays.ray(3 * n + j)))));
        }
        !open.is_empty()
    }

    /// A seeker's step, by what its ray and those beside it have reached.
    fn step(&self, seeker: &mut Seeker, reached: Option<[[f64; 2]; 3]>) {
        let change_mm = reached.and_then(|at| {
            let miss = [0, 1].map(|c| seeker.aim[c] - at[0][c]);
            let [a, b] = [1, 2].map(|j| [0, 1].map(|c| (at[j][c] - at[0][c]) / self.step_mm));
            seeker.is_there = miss[0].hypot(miss[1]) <= self.tolerance;
            seeker.spread = (a[0] * b[1] - b[0] * a[1]).abs();
            solve([a, b], miss)
        });
        if seeker.is_there {
            return;
        }
        // A ray that does not get to the stop starts again nearer to the axis.
        seeker.start_mm = match change_mm {
            Some(change_mm) => [0, 1].map(|c| seeker.start_mm[c] + change_mm[c]),
            None => seeker.start_mm.map(|mm| 0.5 * mm),
        };
    }
}

/// The solution of two linear equations, by the columns of their matrix.
fn solve([a, b]: [[f64; 2]; 2], right: [f64; 2]) -> Option<[f64; 2]> {
    let determinant = a[0] * b[1] - b[0] * a[1];
    let solution =
        [(right[0] * b[1] - b[0] * right[1]) / determinant, (a[0] * right[1] - right[0] * a[1]) / determinant];
    solution.iter().all(|c| c.is_finite()).then_some(solution)
}
