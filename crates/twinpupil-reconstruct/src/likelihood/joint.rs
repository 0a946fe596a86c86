//! All dots of a frame at once: each explains the light that the others leave, and all move together, until none moves.

use std::f64::consts::SQRT_2;

use nalgebra::Vector6;
use twinpupil_instrument::{Page, PlaneView};

use crate::likelihood::black::Black;
use crate::likelihood::blocks::Blocks;
use crate::likelihood::body::{BandLight, Body};
use crate::likelihood::coupling::{Coupling, Near, NearLight};
use crate::likelihood::departure::Departures;
use crate::likelihood::full::{Full, FullLight};
use crate::likelihood::illumination::{bend, shift_px};
use crate::likelihood::light::{Light, Places, is_slanted};
use crate::likelihood::neighbours::{Circle, Neighbours};
use crate::likelihood::normal::Normal;
use crate::likelihood::outline::Outline;
use crate::likelihood::pencil::{Pencil, length};
use crate::likelihood::samples::{Rings, Samples};
use crate::likelihood::spot::{Dot, Raster, Spot, SpotJacobian};
use crate::likelihood::weigh::{Judge, Levels, Weights};

/// One band of a frame and how it images.
pub(crate) struct BandView<'a> {
    pub(crate) plane: PlaneView<'a>,
    pub(crate) black: &'a Black,
    pub(crate) raster: Raster,
    /// What its page is, unless it is that raster.
    pub(crate) page: Option<&'a Page>,
    pub(crate) pencil: &'a Pencil,
    /// What the lens adds to images, unless it is ideal.
    pub(crate) departures: Option<&'a Departures>,
}

/// Buffers that are used again from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Buffers {
    samples: Samples,
    /// The samples of the spot that is looked at, about its centre, its light there and that of others.
    places: Places,
    codes: Vec<f32>,
    own: Light,
    narrow: Light,
    others: Vec<f32>,
    near: Vec<Near>,
    weights: Weights,
    /// For the bands of one body after the other.
    pub(crate) neighbours: Neighbours,
    /// For every body.
    pub(crate) couplings: Vec<Vec<Coupling>>,
    moving: Vec<u32>,
}

/// Ground about a spot that is fitted along with it: this share of its radius, and at least so many pixels of the plane.
const MARGIN_SHARE: f64 = 0.1;
const MARGIN_SAMPLES: f64 = 2.0;

/// Residuals beyond so many standard deviations belong to something else, once the fit is near.
const FOREIGN_SIGMAS: f32 = 6.0;

/// Times that the bodies are solved for in turn, and the change in standard deviations that ends it.
const TURNS: usize = 40;
const TURN_SIGMAS: f64 = 0.02;

impl BandView<'_> {
    /// A dot's image in this band, and its changes with the dot.
    pub(crate) fn spot(&self, dot: &Dot) -> (Spot, SpotJacobian) {
        let departure = self.departures.map(|departures| departures.of_dot(dot));
        let (mut spot, mut jacobian) = Spot::with_jacobian(dot, self.pencil, self.raster, departure);
        if let Some(page) = self.page {
            spot.lay_on(page, self.pencil, &mut jacobian);
        }
        (spot, jacobian)
    }

    /// Length of the longer side of its page, px.
    fn size_px(&self) -> f64 {
        (self.plane.columns.max(self.plane.rows) * self.plane.step_px) as f64
    }

    /// Whether an image is no wider than the page, and on it or beside it.
    fn is_near(&self, spot: &Spot) -> bool {
        let (size_px, PlaneView { origin_px, columns, rows, step_px, .. }) = (self.size_px(), self.plane);
        let middle_px = |axis: usize, count: usize| (origin_px[axis] + count * step_px / 2) as f64;
        let off_px = [spot.centre_px[0] - middle_px(0, columns), spot.centre_px[1] - middle_px(1, rows)];
        spot.reach_px() <= 0.5 * size_px && length(off_px) <= size_px
    }

    pub(crate) fn window_px(&self, spot: &Spot) -> f64 {
        let step_px = self.plane.step_px as f64;
        spot.reach_px() + (MARGIN_SHARE * spot.radius_px).max(MARGIN_SAMPLES * step_px)
    }
}

impl BandLight {
    pub(crate) fn near(&self) -> NearLight<'_> {
        NearLight { spot: &self.spot, contrast: self.contrast, growth: self.growth().map(|slope| slope as f32) }
    }
}

/// Fits bodies to the bands of a frame.
pub(crate) struct Joint<'a> {
    pub(crate) bands: &'a [BandView<'a>],
    pub(crate) bodies: &'a mut Vec<Body>,
    pub(crate) buffers: &'a mut Buffers,
}

impl Joint<'_> {
    /// Before the first round: images of all bodies, and no pixels read.
    pub(crate) fn begin(&mut self) {
        let Buffers { samples, couplings, neighbours, .. } = &mut *self.buffers;
        samples.clear();
        neighbours.clear();
        couplings.iter_mut().for_each(Vec::clear);
        if couplings.len() < self.bodies.len() {
            couplings.resize_with(self.bodies.len(), Vec::new);
        }
    }

    /// One round of Gauss–Newton steps of all bodies that do not rest yet; the images of those that go on moving are
    /// brought up to date by [`Self::refresh_moving`].
    pub(crate) fn round(&mut self) {
        self.meet_neighbours();
        let mut moving = std::mem::take(&mut self.buffers.moving);
        moving.clear();
        self.bodies.iter_mut().for_each(|body| body.moves = !body.rests());
        moving.extend((0..self.bodies.len() as u32).filter(|index| self.is_stirred(*index as usize)));
        moving.iter().for_each(|index| self.bodies[*index as usize].moves = true);
        for index in &moving {
            self.measure(*index as usize);
        }
        self.solve(&moving);
        for index in &moving {
            let body = &mut self.bodies[*index as usize];
            body.advance();
            if body.rests() {
                self.refresh(*index as usize, 0.0);
            }
        }
        self.buffers.moving = moving;
    }

    /// Whether a body moves, or a neighbour that is far from its place yet.
    fn is_stirred(&self, index: usize) -> bool {
        const FAR_SIGMAS: f64 = 6.0;
        let bands = self.bands.len();
        let is_far = |other: &u32| {
            let other = &self.bodies[*other as usize / bands];
            other.moves && other.moved_sigmas > FAR_SIGMAS
        };
        let body = &self.bodies[index];
        let neighbours = || (0..bands).flat_map(|band| self.buffers.neighbours.of(index * bands + band));
        body.moves || body.alive && body.is_placed() && neighbours().any(is_far)
    }

    /// Brings the images of all bodies up to date that do not rest.
    pub(crate) fn refresh_moving(&mut self) {
        for index in 0..self.bodies.len() {
            if !self.bodies[index].rests() {
                self.refresh(index, self.bodies[index].softening_px());
            }
        }
    }

    /// Brings the images of a body up to date with its dot; an added blur tells nothing of depth.
    fn refresh(&mut self, index: usize, softening_px: f64) {
        let Body { dot, bands, alive, .. } = &mut self.bodies[index];
        for (view, light) in self.bands.iter().zip(bands) {
            if let Some(light) = light {
                (light.spot, light.jacobian) = view.spot(dot);
                *alive &= view.is_near(&light.spot);
                if softening_px > 0.0 {
                    light.spot.soften(softening_px);
                    light.jacobian.row_mut(3).fill(0.0);
                }
                light.spot.shift(shift_px(&light.spot, light.illumination_slope));
            }
        }
    }

    /// Finds again which bodies' images touch.
    fn meet_neighbours(&mut self) {
        let Self { bands, bodies, buffers } = self;
        let bands: &[BandView<'_>] = bands;
        // Images of different bands never meet: each band lies beside the one before.
        let apart_px = 4.0 * bands.iter().map(BandView::size_px).fold(0.0, f64::max);
        let circles = bodies.iter().enumerate().filter(|(_, body)| body.alive).flat_map(|(index, body)| {
            body.bands.iter().enumerate().filter_map(move |(band, light)| {
                let spot = &light.as_ref()?.spot;
                let [u_px, v_px] = spot.centre_px;
                Some(Circle {
                    index: (index * bands.len() + band) as u32,
                    centre_px: [u_px + apart_px * band as f64, v_px],
                    radius_px: bands[band].window_px(spot),
                })
            })
        });
        buffers.neighbours.find(circles, bodies.len() * bands.len());
        for (index, body) in bodies.iter_mut().enumerate() {
            let own = index * bands.len()..(index + 1) * bands.len();
            body.has_neighbours = own.into_iter().any(|index| !buffers.neighbours.of(index).is_empty());
        }
    }

    /// Sums the normal equations of a body over its windows, and what it has in common with its neighbours.
    fn measure(&mut self, index: usize) {
        self.buffers.couplings[index].clear();
        let mask_foreign = self.bodies[index].is_near();
        for band in 0..self.bands.len() {
            self.read_window(index, band);
        }
        let body = &mut self.bodies[index];
        let windows = body.bands.iter().flatten().filter_map(|light| light.window.as_ref());
        let share = body.share();
        body.seen = windows.map(|window| window.share(share)).min().unwrap_or(share);
        body.masked = mask_foreign;
        for band in 0..self.bands.len() {
            self.measure_band(index, band, mask_foreign);
        }
        self.bodies[index].factorise();
    }

    /// Reads the pixels about a spot, unless those that were read before still serve.
    fn read_window(&mut self, index: usize, band: usize) {
        let Some(light) = &self.bodies[index].bands[band] else { return };
        let view = &self.bands[band];
        let rings = self.rings(index, band, light);
        let reach_px = light.spot.reach_px();
        if light.window.as_ref().is_some_and(|window| window.serves(&rings, reach_px)) {
            return;
        }
        let window = self.buffers.samples.read(&view.plane, view.black.noise(), &rings);
        if let Some(light) = &mut self.bodies[index].bands[band] {
            light.window = Some(window);
        }
    }

    /// The window about a spot; masks and others whose light reaches into it make its parts uneven.
    fn rings(&self, index: usize, band: usize, light: &BandLight) -> Rings {
        let [u_px, v_px] = light.spot.centre_px;
        let view = &self.bands[band];
        let neighbours = self.buffers.neighbours.of(index * self.bands.len() + band).iter();
        let neighbours = neighbours.filter_map(|k| self.bodies[*k as usize / self.bands.len()].bands[band].as_ref());
        let (mut gap_px, mut blur_px) = (f64::INFINITY, light.spot.blur_px_min());
        let mut steepness = light.steepness();
        for near in neighbours {
            let [du, dv] = [near.spot.centre_px[0] - u_px, near.spot.centre_px[1] - v_px];
            gap_px = gap_px.min((du * du + dv * dv).sqrt() - near.spot.reach_px());
            blur_px = blur_px.min(near.spot.blur_px_min());
            steepness += near.steepness();
        }
        let ground = light.background + view.black.noise().black_level;
        // Calibration has to be as near to the pixels as can be; where rims cut pencils or lines tell them, light bends.
        let is_plain = !self.bodies[index].pinned && !is_slanted(&light.spot) && !light.spot.has_rims();
        let grain = if is_plain { Blocks::grain_for(blur_px, view.plane.step_px) } else { 1 };
        let across_px = ((grain - 1) * view.plane.step_px) as f64 * SQRT_2;
        Rings {
            outline: Outline::of(&light.spot),
            window_px: view.window_px(&light.spot),
            even_px: if light.spot.is_clipped() { 0.0 } else { gap_px },
            levels: [light.contrast + ground, ground].map(|level| level as f32),
            grain,
            rise: (steepness * across_px) as f32,
        }
    }

    fn measure_band(&mut self, index: usize, band: usize, mask_foreign: bool) {
        let Self { bands, bodies, buffers } = self;
        let body = &bodies[index];
        let Some(light) = &body.bands[band] else { return };
        let Some(window) = &light.window else { return };
        let view = &bands[band];
        let Buffers { samples, places, codes, own, narrow, others, near, weights, neighbours, couplings, .. } =
            &mut **buffers;
        samples.about(window, body.seen, light.spot.centre_px, places, codes);
        let near_lights = || {
            neighbours.of(index * bands.len() + band).iter().filter_map(|neighbour| {
                let other = *neighbour as usize / bands.len();
                let near = bodies[other].bands[band].as_ref()?;
                window.is_reached(&near.spot).then_some((other, near))
            })
        };
        others.clear();
        others.resize(codes.len(), 0.0);
        for (place, (_, other)) in near_lights().enumerate() {
            if near.len() <= place {
                near.push(Near::default());
            }
            near[place].find(&other.near(), light.spot.centre_px, places);
            near[place].add(&other.near(), others);
        }
        own.fill(&light.spot, places);
        bend(own, &light.spot, light.illumination_slope, places, narrow);
        let growth = light.growth();
        let levels = Levels {
            contrast: light.contrast as f32,
            background: light.background as f32,
            growth: growth.map(|slope| slope as f32),
        };
        let limit = if mask_foreign { FOREIGN_SIGMAS * FOREIGN_SIGMAS } else { f32::INFINITY };
        let saturated = f32::from(view.plane.code_max);
        let judge = Judge::new(view.black, saturated, limit, window.pixels as f32);
        weights.compare(codes, places, own, others, &levels, &judge);
        let mut normal = Normal::of(own, places, light.contrast, weights);
        let [offset_u, offset_v] = window.offset_px(light.spot.centre_px);
        let lit = 1.0 - growth[0] * offset_u - growth[1] * offset_v;
        let sums = |full: &Full, level: f64| full.sums(&FullLight { level, lit, growth }, view.black);
        if window.full.count() > 0.0 {
            normal.add_full(&sums(&window.full, light.contrast + light.background), window.full.masked);
        }
        if window.ground.count() > 0.0 {
            normal.add_ground(&sums(&window.ground, light.background));
        }
        if let Some(expected) = body.expected_contrast(light) {
            normal.expect_contrast(expected.value - light.contrast, expected.std);
        }
        for (near, (other, neighbour)) in near.iter_mut().zip(near_lights()) {
            if let Some(block) = near.block(&neighbour.near(), light.contrast, own, weights) {
                couplings[index].push(Coupling { other, band, block });
            }
        }
        if let Some(light) = &mut bodies[index].bands[band] {
            light.shape = normal.shape();
            light.normal = normal;
        }
    }

    /// Finds the steps of bodies that together solve the equations of all; bodies that rest take none.
    fn solve(&mut self, moving: &[u32]) {
        for turn in 0..TURNS {
            let mut largest_sigmas = 0.0_f64;
            for index in moving {
                let index = *index as usize;
                let couplings = &self.buffers.couplings[index];
                if turn > 0 && couplings.is_empty() {
                    continue;
                }
                let (before, rest) = self.bodies.split_at_mut(index);
                let Some((body, after)) = rest.split_first_mut() else { continue };
                let other = |other: usize| if other < index { &before[other] } else { &after[other - index - 1] };
                let change_sigmas = body.solve(|band| {
                    let mut taken = Vector6::zeros();
                    for coupling in couplings.iter().filter(|coupling| coupling.band == band) {
                        let other = other(coupling.other);
                        if let (true, Some(light)) = (other.moves, &other.bands[band]) {
                            taken += coupling.block * light.step;
                        }
                    }
                    taken
                });
                if !couplings.is_empty() {
                    largest_sigmas = largest_sigmas.max(change_sigmas);
                }
            }
            if largest_sigmas < TURN_SIGMAS {
                break;
            }
        }
    }
}
