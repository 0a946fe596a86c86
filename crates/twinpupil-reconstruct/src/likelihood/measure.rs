//! What the pixels about one body say of it: its normal equations, and what it has in common with its neighbours.

use std::f64::consts::SQRT_2;

use crate::likelihood::blocks::Blocks;
use crate::likelihood::body::{BandLight, Body};
use crate::likelihood::coupling::{Coupling, Near, NearLight};
use crate::likelihood::full::{Full, FullLight};
use crate::likelihood::illumination::bend;
use crate::likelihood::light::{Light, Places};
use crate::likelihood::neighbours::Neighbours;
use crate::likelihood::normal::Normal;
use crate::likelihood::outline::Outline;
use crate::likelihood::profile::Profiles;
use crate::likelihood::samples::{Rings, Samples};
use crate::likelihood::soft::is_slanted;
use crate::likelihood::view::BandView;
use crate::likelihood::weigh::{Judge, Levels, Weights};

/// What bodies are measured against: a frame, and the light of all others as a round begins.
#[derive(Clone, Copy)]
pub(crate) struct Surroundings<'a> {
    pub(crate) bands: &'a [BandView<'a>],
    /// For the bands of one body after the other.
    pub(crate) neighbours: &'a Neighbours,
    /// The light of all neighbours of those that are measured.
    pub(crate) lights: &'a [Option<NearLight>],
}

/// What one thread measures bodies with: the pixels that it has read for them, and buffers that are used again from frame to
/// frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Desk {
    samples: Samples,
    /// The samples of the spot that is looked at, about its centre, its light there and that of others.
    places: Places,
    codes: Vec<f32>,
    own: Light,
    narrow: Light,
    others: Vec<f32>,
    near: Vec<Near>,
    weights: Weights,
    profiles: Profiles,
}

/// Residuals beyond so many standard deviations belong to something else, once the fit is near.
const FOREIGN_SIGMAS: f32 = 6.0;

impl Desk {
    /// Forgets all pixels.
    pub(crate) fn clear(&mut self) {
        self.samples.clear();
    }

    /// Sums the normal equations of a body over its windows, and what it has in common with its neighbours. All bodies that are
    /// measured at a desk from one frame are always measured there.
    pub(crate) fn measure(
        &mut self,
        around: &Surroundings<'_>,
        index: usize,
        body: &mut Body,
        couplings: &mut Vec<Coupling>,
    ) {
        couplings.clear();
        let mask_foreign = body.is_near();
        for band in 0..around.bands.len() {
            self.read_window(around, index, band, body);
        }
        let windows = body.bands.iter().flatten().filter_map(|light| light.window.as_ref());
        let share = body.share();
        body.seen = windows.map(|window| window.share(share)).min().unwrap_or(share);
        body.masked = mask_foreign;
        for band in 0..around.bands.len() {
            self.measure_band(around, index, band, body, couplings);
        }
        body.factorise();
    }

    /// Reads the pixels about a spot, unless those that were read before still serve.
    fn read_window(&mut self, around: &Surroundings<'_>, index: usize, band: usize, body: &mut Body) {
        let is_pinned = body.pinned;
        let Some(light) = &mut body.bands[band] else { return };
        let rings = around.rings(index, band, light, is_pinned);
        let reach_px = light.spot.reach_px();
        if light.window.as_ref().is_some_and(|window| window.serves(&rings, reach_px)) {
            return;
        }
        let BandView { plane, black, .. } = &around.bands[band];
        light.window = Some(self.samples.read(plane, black.noise(), &rings));
    }

    fn measure_band(
        &mut self,
        around: &Surroundings<'_>,
        index: usize,
        band: usize,
        body: &mut Body,
        couplings: &mut Vec<Coupling>,
    ) {
        let Some(light) = &body.bands[band] else { return };
        let Some(window) = &light.window else { return };
        let view = &around.bands[band];
        let Self { samples, places, profiles, codes, own, narrow, others, near, weights } = self;
        samples.about(window, body.seen, light.spot.centre_px, places, codes);
        let near_lights = || around.near(index, band).filter(|(_, other)| window.is_reached(&other.spot));
        others.clear();
        others.resize(codes.len(), 0.0);
        for (place, (_, other)) in near_lights().enumerate() {
            if near.len() <= place {
                near.push(Near::default());
            }
            near[place].find(other, light.spot.centre_px, places, profiles);
            near[place].add(other, others);
        }
        own.fill(&light.spot, places, profiles);
        bend(own, &light.spot, light.illumination_slope, places, profiles, narrow);
        let growth = light.growth();
        let levels = Levels {
            contrast: light.contrast as f32,
            background: light.background as f32,
            growth: growth.map(|slope| slope as f32),
        };
        let limit = if body.masked { FOREIGN_SIGMAS * FOREIGN_SIGMAS } else { f32::INFINITY };
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
            if let Some(block) = near.block(neighbour, light.contrast, own, weights) {
                couplings.push(Coupling { other, band, block });
            }
        }
        if let Some(light) = &mut body.bands[band] {
            light.shape = normal.shape();
            light.normal = normal;
        }
    }
}

impl Surroundings<'_> {
    /// The neighbours of a body in a band, and their light.
    fn near(&self, index: usize, band: usize) -> impl Iterator<Item = (usize, &NearLight)> {
        let bands = self.bands.len();
        let neighbours = self.neighbours.of(index * bands + band).iter();
        neighbours.filter_map(move |k| {
            let other = *k as usize / bands;
            Some((other, self.lights[other * bands + band].as_ref()?))
        })
    }

    /// The window about a spot; masks and others whose light reaches into it make its parts uneven.
    fn rings(&self, index: usize, band: usize, light: &BandLight, is_pinned: bool) -> Rings {
        let [u_px, v_px] = light.spot.centre_px;
        let view = &self.bands[band];
        let (mut gap_px, mut blur_px) = (f64::INFINITY, light.spot.blur_px_min());
        let mut steepness = light.steepness();
        for (_, near) in self.near(index, band) {
            let [du, dv] = [near.spot.centre_px[0] - u_px, near.spot.centre_px[1] - v_px];
            gap_px = gap_px.min((du * du + dv * dv).sqrt() - near.spot.reach_px());
            blur_px = blur_px.min(near.spot.blur_px_min());
            steepness += near.steepness;
        }
        let ground = light.background + view.black.noise().black_level;
        // Calibration has to be as near to the pixels as can be; where rims cut pencils or conics tell them, light bends.
        let is_plain = !is_pinned && !is_slanted(&light.spot) && !light.spot.has_rims();
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
}
