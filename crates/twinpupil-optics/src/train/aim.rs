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

/// Step of the difference quotients relative to the stop's radius. Its error only slows the method down.
const DIFFERENCE: f64 = 1e-6;

impl Field {
    /// The ray from the field through a point of the plane z = 0 before the first surface.
    fn ray(&self, [x, y]: [f64; 2]) -> Ray {
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

    /// Where a ray to a point of the plane z = `depth_mm` crosses the plane z = 0.
    fn at_first_surface(&self, depth_mm: f64, [x, y]: [f64; 2]) -> [f64; 2] {
        match self {
            Self::Infinite { slope } => [x - slope[0] * depth_mm, y - slope[1] * depth_mm],
            Self::Point { position_mm: [x0, y0, z0] } => {
                let share = z0 / (z0 - depth_mm);
                [x0 + (x - x0) * share, y0 + (y - y0) * share]
            }
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
        let to_stop = self.clear_to(stop);
        let pupil = self.first_order(Some(stop)).entrance_pupil.filter(|pupil| pupil.position_mm.is_finite());
        let guess_mm = |place_mm: [f64; 2]| match pupil {
            Some(pupil) => field.at_first_surface(pupil.position_mm, place_mm.map(|mm| mm * pupil.magnification)),
            None => [0.0; 2],
        };
        let mut seekers: Vec<Seeker> =
            places_mm.iter().map(|place_mm| Seeker::new(*place_mm, guess_mm(*place_mm))).collect();
        seek(&to_stop, &|_, start_mm| field.ray(start_mm), &mut seekers, stop_radius_mm);
        seekers.into_iter().map(|seeker| seeker.is_there.then(|| field.ray(seeker.start_mm))).collect()
    }

    /// The surfaces as far as the stop, clear everywhere.
    fn clear_to(&self, stop: usize) -> Self {
        let lens = self.faces.iter().filter(|face| face.clear.rings.is_none());
        let count = lens.clone().position(|face| face.index == stop).map_or(0, |at| at + 1);
        let faces = lens.take(count).map(|face| Face { clear: Clear::EVERYWHERE, ..face.clone() });
        Self { faces: super::linked(faces.collect()) }
    }
}

/// A ray on its way to its place in the stop.
pub(crate) struct Seeker {
    place_mm: [f64; 2],
    /// Where it crosses the plane by which it is started.
    pub(crate) start_mm: [f64; 2],
    pub(crate) is_there: bool,
}

impl Seeker {
    pub(crate) fn new(place_mm: [f64; 2], start_mm: [f64; 2]) -> Self {
        Self { place_mm, start_mm, is_there: false }
    }
}

/// Where a seeker's ray starts, by its index and the place where it crosses the plane by which it is started.
type Launch<'a> = dyn Fn(usize, [f64; 2]) -> Ray + 'a;

/// Newton's method for all seekers through the surfaces as far as the stop.
pub(crate) fn seek(to_stop: &Train, launch: &Launch<'_>, seekers: &mut [Seeker], stop_radius_mm: f64) {
    for _ in 0..STEPS_MAX {
        if !improve(to_stop, launch, seekers, stop_radius_mm) {
            break;
        }
    }
}

/// One step of Newton's method for all that are not there; whether there were any.
fn improve(to_stop: &Train, launch: &Launch<'_>, seekers: &mut [Seeker], stop_radius_mm: f64) -> bool {
    let step_mm = DIFFERENCE * stop_radius_mm;
    let mut open: Vec<(usize, &mut Seeker)> =
        seekers.iter_mut().enumerate().filter(|(_, seeker)| !seeker.is_there).collect();
    // Each ray, and one beside it along x and y.
    let trios = open.iter().flat_map(|(index, seeker)| {
        let [x, y] = seeker.start_mm;
        [[x, y], [x + step_mm, y], [x, y + step_mm]].map(|start_mm| launch(*index, start_mm))
    });
    let mut rays: Rays = trios.collect();
    to_stop.trace(&mut rays);
    for (n, (_, seeker)) in open.iter_mut().enumerate() {
        let at = |j: usize| rays.ray(3 * n + j).position_mm;
        let arrived = (0..3).all(|j| rays.fate(3 * n + j) == Fate::Arrived);
        let miss_mm = [0, 1].map(|c| seeker.place_mm[c] - at(0)[c]);
        seeker.is_there = arrived && miss_mm[0].hypot(miss_mm[1]) <= TOLERANCE * stop_radius_mm;
        if seeker.is_there {
            continue;
        }
        let column = |j: usize| [0, 1].map(|c| (at(j)[c] - at(0)[c]) / step_mm);
        let change_mm = if arrived { solve([column(1), column(2)], miss_mm) } else { None };
        // A ray that does not get to the stop starts again nearer to the axis.
        seeker.start_mm = match change_mm {
            Some(change_mm) => [0, 1].map(|c| seeker.start_mm[c] + change_mm[c]),
            None => seeker.start_mm.map(|mm| 0.5 * mm),
        };
    }
    !open.is_empty()
}

/// The solution of two linear equations, by the columns of their matrix.
fn solve([a, b]: [[f64; 2]; 2], right: [f64; 2]) -> Option<[f64; 2]> {
    let determinant = a[0] * b[1] - b[0] * a[1];
    let solution =
        [(right[0] * b[1] - b[0] * right[1]) / determinant, (a[0] * right[1] - right[0] * a[1]) / determinant];
    solution.iter().all(|c| c.is_finite()).then_some(solution)
}
