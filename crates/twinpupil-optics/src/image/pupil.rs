//! Light and wavefront over the exit pupil.

use super::{Deviation, Sight};
use crate::train::{Aiming, Seeker};
use crate::{Fate, Ray, Rays};

/// Amplitude and wavefront over the exit pupil on a square grid of directions: of the sine, times the refractive index, of the
/// angle at which light from a place of the reference sphere comes to the middle of the image.
///
/// That grid makes diffraction a Fourier transform, whatever the pupil looks like from the image. Light is that of a beam that
/// is even across its direction, or of a small surface that faces along the axis and looks alike from everywhere.
#[derive(Debug, Clone, PartialEq)]
pub struct PupilFunction {
    /// Places along a side of the grid.
    pub(super) size: usize,
    /// From one to the next.
    pub(super) step: f64,
    pub(super) wavelength_mm: f64,
    /// Half the width of the pupil along x and y.
    half_widths: [f64; 2],
    /// Row by row, along y; `None` where no light comes through.
    pub(super) cells: Vec<Option<Cell>>,
}

/// What comes through a place of the pupil.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    /// Of the light, in any unit, where there is some.
    pub(super) amplitude: f64,
    /// Where that is.
    pub(super) lit: Lit,
    pub(super) deviation: Deviation,
}

impl Cell {
    /// Amplitude on the average over the place.
    pub(super) fn mean_amplitude(&self) -> f64 {
        self.amplitude * self.lit.share()
    }

    /// Light on the average over the place.
    pub(super) fn light(&self) -> f64 {
        self.amplitude * self.amplitude * self.lit.share()
    }
}

/// Which parts of a place light comes through: a bit for every ray that tells of it, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Lit(u64);

impl Lit {
    const ALL: Self = Self(u64::MAX);

    fn of(rays: &[Option<Ray>]) -> Self {
        Self(rays.iter().rev().fold(0, |bits, ray| bits << 1 | u64::from(ray.is_some())))
    }

    fn share(self) -> f64 {
        f64::from(self.0.count_ones()) / f64::from(u64::BITS)
    }

    /// Share of a place that is lit in another one as well.
    pub(super) fn shared(self, other: Self) -> f64 {
        Self(self.0 & other.0).share()
    }
}

/// Rays a side of a place on the rim that tell where it is lit: a bit of a word each.
const RIM_RAYS: usize = 8;

/// Rays to the rim of the pupil that tell how wide it is.
const RIM: usize = 32;

/// How far out, in parts of the pupil, rays tell how directions follow from starts, to first order.
const INNER: f64 = 0.5;

/// How near to its direction a ray must come, in parts of the pupil.
const TOLERANCE: f64 = 1e-9;

/// How far beyond the ellipse about the pupil rays are still sought: no pupil is so far from one.
const MARGIN: f64 = 1.15;

/// The grid, and how rays to it are started.
struct Grid {
    size: usize,
    centre: [f64; 2],
    half_widths: [f64; 2],
    step: f64,
    /// Start of the ray in the middle, and steps to the rim along x and y, mm.
    start_mm: [f64; 2],
    to_rim_mm: [[f64; 2]; 2],
}

impl Sight<'_> {
    /// Light and wavefront on a grid of `size` places a side; `None` if too few rays arrive to tell where the pupil is.
    pub fn pupil_function(&self, size: usize) -> Option<PupilFunction> {
        let grid = self.grid(size)?;
        let mut cells = vec![None; size * size];
        let near: Vec<usize> = (0..size * size).filter(|n| grid.is_near(*n)).collect();
        let mut seekers: Vec<Seeker> =
            near.iter().map(|n| Seeker::new(grid.direction(*n), grid.guess_mm(*n))).collect();
        let aiming = Aiming {
            train: &self.imager.clear,
            launch: &|_, start_mm| self.field.ray(start_mm),
            reached: &|ray| self.reference.aperture(ray),
            step_mm: self.start_step_mm(),
            tolerance: TOLERANCE * grid.half_widths[0].max(grid.half_widths[1]),
        };
        aiming.seek(&mut seekers);
        let there: Vec<(usize, &Seeker)> =
            near.into_iter().zip(&seekers).filter(|(_, seeker)| seeker.is_there).collect();
        let starts: Vec<Ray> = there.iter().map(|(_, seeker)| self.field.ray(seeker.start_mm)).collect();
        let passed = self.passed(&starts);
        let mut places = vec![Place::default(); size * size];
        for ((n, _), (start, ray)) in there.iter().zip(starts.iter().zip(&passed)) {
            places[*n] = Place { start_mm: Some(self.at_plane_mm(start)), is_lit: ray.is_some() };
        }
        let on_rim: Vec<bool> = there.iter().map(|(n, _)| grid.is_on_rim(*n, &places)).collect();
        let rims = self.rims(&grid, &places, there.iter().zip(&on_rim).filter(|(_, is)| **is).map(|((n, _), _)| *n));
        let mut rims = rims.into_iter();
        for (((n, seeker), is_on_rim), (start, ray)) in there.into_iter().zip(on_rim).zip(starts.iter().zip(passed)) {
            let lit = if is_on_rim { rims.next() } else { ray.map(|_| Lit::ALL) };
            let Some(lit) = lit.filter(|lit| lit.share() > 0.0) else { continue };
            // A place that is lit beside its middle has the wavefront that would be there.
            let ray = ray.or_else(|| self.imager.through_all(start));
            let light = |ray: Ray| Cell {
                amplitude: (self.falloff(start) / seeker.spread).sqrt(),
                lit,
                deviation: self.deviation(&ray),
            };
            cells[n] = ray.map(light).filter(|cell| cell.amplitude.is_finite());
        }
        let Grid { step, half_widths, .. } = grid;
        Some(PupilFunction { size, step, wavelength_mm: self.wavelength_mm(), half_widths, cells })
    }

    fn grid(&self, size: usize) -> Option<Grid> {
        let rim: Vec<[f64; 2]> = (0..RIM).map(|k| at_azimuth(k as f64 / RIM as f64)).collect();
        let aperture = |ray: &Ray| self.reference.aperture(ray);
        let directions: Vec<[f64; 2]> = self.clear_rays(&rim).iter().flatten().map(aperture).collect();
        let [low, high] = [f64::min, f64::max].map(|pick: fn(f64, f64) -> f64| {
            [0, 1].map(|k| directions.iter().map(|direction| direction[k]).reduce(pick))
        });
        let ([Some(left), Some(below)], [Some(right), Some(above)]) = (low, high) else { return None };
        let half_widths = [0.5 * (right - left), 0.5 * (above - below)];
        let inner = [[INNER, 0.0], [-INNER, 0.0], [0.0, INNER], [0.0, -INNER]];
        let rays = self.imager.rays(self.field, &inner);
        let starts_mm: Vec<[f64; 2]> = rays.iter().flatten().map(|ray| self.at_plane_mm(ray)).collect();
        let [east, west, north, south] = starts_mm[..] else { return None };
        // Whichever way round the lens images the pupil.
        let ends: Vec<[f64; 2]> = self.clear_rays(&inner).iter().flatten().map(aperture).collect();
        let [to_east, to_west, to_north, to_south] = ends[..] else { return None };
        let per_direction = |axis: usize, [one, other]: [[f64; 2]; 2], [to_one, to_other]: [[f64; 2]; 2]| {
            [0, 1].map(|k| (one[k] - other[k]) / (to_one[axis] - to_other[axis]) * half_widths[axis])
        };
        let x = per_direction(0, [east, west], [to_east, to_west]);
        let y = per_direction(1, [north, south], [to_north, to_south]);
        let is_found =
            half_widths.iter().all(|c| *c > 0.0) && half_widths.iter().chain(&x).chain(&y).all(|c| c.is_finite());
        is_found.then(|| Grid {
            size,
            centre: [0.5 * (left + right), 0.5 * (below + above)],
            half_widths,
            step: 2.0 * half_widths[0].max(half_widths[1]) / size as f64,
            start_mm: [0, 1].map(|k| 0.25 * (east[k] + west[k] + north[k] + south[k])),
            to_rim_mm: [x, y],
        })
    }

    /// Where light comes through places on the rim.
    fn rims(&self, grid: &Grid, places: &[Place], on_rim: impl Iterator<Item = usize>) -> Vec<Lit> {
        let offsets = || (0..RIM_RAYS).map(|k| (k as f64 + 0.5) / RIM_RAYS as f64 - 0.5);
        let starts: Vec<Ray> = on_rim
            .flat_map(|n| {
                let ([x_mm, y_mm], [along_x, along_y]) = grid.starts_about(n, places);
                offsets()
                    .flat_map(move |v| offsets().map(move |u| [u, v]))
                    .map(move |[u, v]| [x_mm + u * along_x[0] + v * along_y[0], y_mm + u * along_x[1] + v * along_y[1]])
            })
            .map(|start_mm| self.field.ray(start_mm))
            .collect();
        self.passed(&starts).chunks(RIM_RAYS * RIM_RAYS).map(Lit::of).collect()
    }

    /// Where a ray crosses the plane z = 0, mm.
    fn at_plane_mm(&self, ray: &Ray) -> [f64; 2] {
        [0, 1].map(|k| ray.position_mm[k] - ray.position_mm[2] * ray.direction[k] / ray.direction[2])
    }

    /// How much light falls on an even part of the plane z = 0 about a ray: cos⁴ from a point.
    fn falloff(&self, start: &Ray) -> f64 {
        if start.position_mm[2] == 0.0 { 1.0 } else { start.direction[2].powi(4) }
    }

    /// Rays in the image that come through the pupil and all that clips the light.
    fn passed(&self, starts: &[Ray]) -> Vec<Option<Ray>> {
        let [mut at_pupil, mut rays]: [Rays; 2] = [0, 1].map(|_| starts.iter().copied().collect());
        self.imager.to_pupil.trace(&mut at_pupil);
        self.imager.train.trace(&mut rays);
        let is_within = |ray: Ray| {
            let [x, y] = [0, 1].map(|k| ray.position_mm[k] - self.imager.centre_mm[k]);
            x.hypot(y) <= self.imager.radius_mm
        };
        let pass = |((on_pupil, _), (ray, fate)): ((Ray, Fate), (Ray, Fate))| {
            (is_within(on_pupil) && fate == Fate::Arrived).then_some(ray)
        };
        at_pupil.iter().zip(rays.iter()).map(pass).collect()
    }
}

/// A place on the rim, by parts of a turn.
fn at_azimuth(turn: f64) -> [f64; 2] {
    let (sin, cos) = (std::f64::consts::TAU * turn).sin_cos();
    [cos, sin]
}

/// What is known of a place of the grid.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Place {
    /// Where its ray crosses the plane z = 0, mm; none without a ray.
    start_mm: Option<[f64; 2]>,
    is_lit: bool,
}

impl Grid {
    /// Whether light ends between a place and one of those about it.
    fn is_on_rim(&self, n: usize, places: &[Place]) -> bool {
        let beside = |at: usize| at.saturating_sub(1)..(at + 2).min(self.size);
        let (column, row) = (n % self.size, n / self.size);
        let is_inner = (1..self.size - 1).contains(&column) && (1..self.size - 1).contains(&row);
        let differs = |other: usize| places[other].is_lit != places[n].is_lit;
        let mut about = beside(row).flat_map(|row| beside(column).map(move |column| row * self.size + column));
        about.any(differs) || (!is_inner && places[n].is_lit)
    }

    /// Where the ray of a place starts, and how far from there those of the next places along x and y do, mm.
    fn starts_about(&self, n: usize, places: &[Place]) -> ([f64; 2], [[f64; 2]; 2]) {
        let start_mm = |n: Option<usize>| n.and_then(|n| places.get(n)?.start_mm);
        let here_mm = start_mm(Some(n)).unwrap_or_else(|| self.guess_mm(n));
        let step = |axis: usize| {
            let (at, stride) = [(n % self.size, 1), (n / self.size, self.size)][axis];
            let before = start_mm(n.checked_sub(stride).filter(|_| at > 0));
            let after = start_mm(Some(n + stride).filter(|_| at + 1 < self.size));
            let from_to = |from: [f64; 2], to: [f64; 2], steps: f64| [0, 1].map(|k| (to[k] - from[k]) / steps);
            match (before, after) {
                (Some(before), Some(after)) => from_to(before, after, 2.0),
                (Some(before), None) => from_to(before, here_mm, 1.0),
                (None, Some(after)) => from_to(here_mm, after, 1.0),
                (None, None) => self.to_rim_mm[axis].map(|mm| mm * self.step / self.half_widths[axis]),
            }
        };
        (here_mm, [step(0), step(1)])
    }

    /// A place from the middle, in half widths.
    fn share(&self, n: usize) -> [f64; 2] {
        let from_middle = [n % self.size, n / self.size].map(|k| k as f64 + 0.5 - 0.5 * self.size as f64);
        [0, 1].map(|k| from_middle[k] * self.step / self.half_widths[k])
    }

    fn is_near(&self, n: usize) -> bool {
        let [x, y] = self.share(n);
        x.hypot(y) <= MARGIN
    }

    fn direction(&self, n: usize) -> [f64; 2] {
        let share = self.share(n);
        [0, 1].map(|k| self.centre[k] + self.half_widths[k] * share[k])
    }

    fn guess_mm(&self, n: usize) -> [f64; 2] {
        let [x, y] = self.share(n);
        [0, 1].map(|k| self.start_mm[k] + x * self.to_rim_mm[0][k] + y * self.to_rim_mm[1][k])
    }
}

impl PupilFunction {
    /// The largest change of the wavefront from one place to the next, in wavelengths. From ½ on the grid is too coarse to
    /// tell diffraction.
    pub fn steepest_step(&self) -> f64 {
        let opd_mm = |n: usize| self.cells.get(n).copied().flatten().map(|cell| cell.deviation.opd_mm);
        let step = |n: usize, to: usize| Some((opd_mm(to)? - opd_mm(n)?).abs());
        let steps = (0..self.cells.len()).flat_map(|n| {
            let along_x = if n % self.size + 1 < self.size { step(n, n + 1) } else { None };
            [along_x, step(n, n + self.size)].into_iter().flatten()
        });
        steps.fold(0.0, f64::max) / self.wavelength_mm
    }

    /// Numerical aperture along x and y.
    pub fn apertures(&self) -> [f64; 2] {
        self.half_widths
    }

    /// Share of the places within the ellipse of its half widths through which light comes.
    pub fn filled_share(&self) -> f64 {
        let [a, b] = self.half_widths.map(|half_width| half_width / self.step);
        self.lit().map(|cell| cell.lit.share()).sum::<f64>() / (std::f64::consts::PI * a * b)
    }

    /// Root of the mean square of the wavefront about its mean, mm: the light counts.
    pub fn rms_opd_mm(&self) -> f64 {
        let light =
            |power: i32| -> f64 { self.lit().map(|cell| cell.light() * cell.deviation.opd_mm.powi(power)).sum() };
        let (light, mean_mm, square) = (light(0), light(1) / light(0), light(2));
        (square / light - mean_mm * mean_mm).max(0.0).sqrt()
    }

    /// Places with light.
    pub(super) fn lit(&self) -> impl Iterator<Item = &Cell> {
        self.cells.iter().flatten()
    }

    /// Row and column from the middle of a place.
    pub(super) fn offset(&self, n: usize) -> [f64; 2] {
        [n % self.size, n / self.size].map(|k| (k as f64 + 0.5 - 0.5 * self.size as f64) * self.step)
    }

    /// Of the wavefront at a place, rad.
    pub(super) fn phase_rad(&self, cell: &Cell) -> f64 {
        std::f64::consts::TAU * cell.deviation.opd_mm / self.wavelength_mm
    }
}
