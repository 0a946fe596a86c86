//! All dots of a frame at once: each explains the light that the others leave, and all move together, until none moves.

use nalgebra::Vector6;

use crate::likelihood::body::{BandLight, Body};
use crate::likelihood::coupling::{Coupling, NearLight};
use crate::likelihood::illumination::shift_px;
use crate::likelihood::measure::{Desk, Surroundings};
use crate::likelihood::neighbours::{Circle, Neighbours};
use crate::likelihood::view::BandView;
use crate::threads::{for_each, for_each_chosen, for_each_part, part_length, worthwhile};

/// Buffers that are used again from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Buffers {
    /// One for every thread; every body keeps to its own.
    desks: Vec<Desk>,
    /// For the bands of one body after the other.
    pub(crate) neighbours: Neighbours,
    /// Light of those whose neighbours take part in a round, as it begins.
    lights: Vec<Option<NearLight>>,
    /// For every body.
    pub(crate) couplings: Vec<Vec<Coupling>>,
    moving: Vec<u32>,
}

/// Bodies whose measuring, and whose moving, is worth a thread.
const MEASURED_EACH: usize = 4;
const MOVED_EACH: usize = 64;

/// Times that the bodies are solved for in turn, and the change in standard deviations that ends it.
const TURNS: usize = 40;
const TURN_SIGMAS: f64 = 0.02;

/// Fits bodies to the bands of a frame.
pub(crate) struct Joint<'a> {
    pub(crate) bands: &'a [BandView<'a>],
    pub(crate) bodies: &'a mut Vec<Body>,
    pub(crate) buffers: &'a mut Buffers,
    /// Threads that share the work.
    pub(crate) threads: usize,
}

impl Joint<'_> {
    /// Before the first round: images of all bodies, and no pixels read.
    pub(crate) fn begin(&mut self) {
        let Buffers { desks, couplings, neighbours, .. } = &mut *self.buffers;
        desks.iter_mut().for_each(Desk::clear);
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
        self.measure(&moving);
        self.solve(&moving);
        let bands = self.bands;
        let moves = |body: &Body| body.moves;
        for_each_chosen(self.bodies, MOVED_EACH, self.threads, moves, |body| {
            body.advance();
            if body.rests() {
                refresh(bands, body, 0.0);
            }
        });
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
        let bands = self.bands;
        let is_restless = |body: &Body| !body.rests();
        for_each_chosen(self.bodies, MOVED_EACH, self.threads, is_restless, |body| {
            refresh(bands, body, body.softening_px());
        });
    }

    /// Finds again which bodies' images touch.
    fn meet_neighbours(&mut self) {
        let Self { bands, bodies, buffers, .. } = self;
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

    /// Takes down the light of all neighbours of those that take part in the round.
    fn show_lights(&mut self, moving: &[u32]) {
        let Self { bands, bodies, buffers, threads } = self;
        let Buffers { neighbours, lights, .. } = &mut **buffers;
        let bands = bands.len();
        let count = bodies.len() * bands;
        // What is left of rounds before is looked at by nobody.
        if lights.len() < count {
            lights.resize_with(count, || None);
        }
        bodies.iter_mut().for_each(|body| body.is_seen = false);
        for index in moving.iter().flat_map(|body| (0..bands).map(move |band| *body as usize * bands + band)) {
            neighbours.of(index).iter().for_each(|other| bodies[*other as usize / bands].is_seen = true);
        }
        let bodies = &**bodies;
        for_each(&mut lights[..count], worthwhile(moving.len(), MOVED_EACH, *threads), |place, light| {
            let body = &bodies[place / bands];
            if body.is_seen {
                *light = body.bands[place % bands].as_ref().map(BandLight::near);
            }
        });
    }

    /// Measures all bodies that take part in the round.
    fn measure(&mut self, moving: &[u32]) {
        self.show_lights(moving);
        let Self { bands, bodies, buffers, threads } = self;
        let Buffers { desks, neighbours, lights, couplings, .. } = &mut **buffers;
        let around = Surroundings { bands, neighbours, lights };
        let length = part_length(bodies.len(), *threads);
        let parts = bodies.chunks_mut(length).zip(couplings.chunks_mut(length));
        let sharing = worthwhile(moving.len(), MEASURED_EACH, *threads);
        for_each_part(parts, desks, sharing, |number, (bodies, couplings), desk| {
            for (place, (body, couplings)) in bodies.iter_mut().zip(&mut **couplings).enumerate() {
                if body.moves {
                    desk.measure(&around, number * length + place, body, couplings);
                }
            }
        });
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

/// Brings the images of a body up to date with its dot; an added blur tells nothing of depth.
fn refresh(views: &[BandView<'_>], body: &mut Body, softening_px: f64) {
    let Body { dot, bands, alive, .. } = body;
    for (view, light) in views.iter().zip(bands) {
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
