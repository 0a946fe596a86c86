//! All dots of a frame at once: each is fitted to what the others leave of the pixels, in turn, until none moves.

use nalgebra::{Matrix4, SMatrix};
use twinpupil_instrument::PlaneView;

use crate::likelihood::black::Black;
use crate::likelihood::body::{BandLight, Body};
use crate::likelihood::illumination::{bend, shift_px};
use crate::likelihood::light::{Light, Places};
use crate::likelihood::normal::{Lines, Normal, UNKNOWNS, dot};
use crate::likelihood::pencil::Pencil;
use crate::likelihood::samples::{Rings, Samples};
use crate::likelihood::spot::{Dot, Page, Spot};
use crate::noise::Noise;

/// One band of a frame and how it images.
pub(crate) struct BandView<'a> {
    pub(crate) plane: PlaneView<'a>,
    pub(crate) noise: Noise,
    pub(crate) black: Black,
    pub(crate) page: Page,
    pub(crate) pencil: &'a Pencil,
    /// What the lens adds to the radius of an image, over (r, z), mm.
    pub(crate) aberration_mm: &'a (dyn Fn(f64, f64) -> f64 + Sync),
}

/// Buffers that are used again from spot to spot.
#[derive(Debug, Default)]
pub(crate) struct Workspace {
    pub(crate) samples: Samples,
    own: Light,
    narrow: Light,
    /// Light of others on the samples.
    pub(crate) others: Vec<f32>,
    near: Near,
    lines: Lines,
    neighbours: Vec<Vec<u32>>,
}

/// The samples that one neighbour reaches, and its light there.
#[derive(Debug, Default)]
struct Near {
    index: Vec<u32>,
    places: Places,
    light: Light,
}

/// Ground about a spot that is fitted along with it: this share of its radius, and at least so many pixels of the plane.
const MARGIN_SHARE: f64 = 0.1;
const MARGIN_SAMPLES: f64 = 2.0;

/// Residuals beyond so many standard deviations belong to something else, once the fit is near.
const FOREIGN_SIGMAS: f32 = 6.0;

/// Pixels that ought to be nearer to the largest code than this, in standard deviations, count as saturated.
const FULL_SIGMAS: f32 = 3.0;

/// How pixels are compared with the model.
#[derive(Debug, Clone, Copy)]
struct Asked {
    /// Whether the blur tells something of depth.
    feel_blur: bool,
    /// Largest square of a residual over its variance that counts.
    limit: f32,
}

impl BandView<'_> {
    /// A dot's image in this band.
    pub(crate) fn spot(&self, dot: &Dot) -> Spot {
        let [x_mm, y_mm, z_mm] = dot.centre_mm;
        Spot::of(dot, self.pencil, self.page, (self.aberration_mm)(x_mm.hypot(y_mm), z_mm))
    }

    /// A dot's light in this band before it has been fitted.
    pub(crate) fn light(&self, dot: &Dot, contrast: f64, background: f64) -> BandLight {
        BandLight {
            contrast,
            first_contrast: contrast,
            background,
            illumination_slope: [0.0; 2],
            spot: self.spot(dot),
            jacobian: Spot::jacobian(dot, self.pencil, self.page, self.aberration_mm),
            normal: Normal::default(),
            shape: None,
        }
    }

    /// Turns light, in `lines.residual`, into weights and residuals, and derivatives of light into those of codes.
    fn compare(&self, codes: &[f32], asked: Asked, unknowns: std::ops::Range<usize>, lines: &mut Lines) {
        let saturated = f32::from(self.plane.code_max);
        let black_level = self.noise.black_level as f32;
        let (floor, slope) = (self.noise.floor_codes2 as f32, self.noise.slope_codes as f32);
        let Lines { jacobian, weight, residual, .. } = lines;
        // What should read the largest code and does not was spared by its noise.
        let spread = FULL_SIGMAS * self.noise.variance(f64::from(saturated)).sqrt() as f32;
        let (full, spared) = (saturated - black_level - spread, saturated - 2.0 * spread);
        let mut dark = false;
        for ((code, weight), residual) in codes.iter().zip(&mut *weight).zip(&mut *residual) {
            dark |= *residual < self.black.light_max;
            let trust = 1.0 / (floor + slope * residual.max(0.0));
            let left = code - black_level - *residual;
            let out = (*code >= saturated) | ((*residual > full) & (*code > spared)) | (left * left * trust > asked.limit);
            *weight = if out { 0.0 } else { trust };
            *residual = left;
        }
        if !dark {
            return;
        }
        for k in 0..codes.len() {
            let read = codes[k] - black_level;
            let light = read - residual[k];
            if light < self.black.light_max && codes[k] < saturated {
                let reading = self.black.read(light);
                let left = read - reading.mean;
                weight[k] = if left * left * reading.trust > asked.limit { 0.0 } else { reading.trust };
                residual[k] = left;
                for unknown in unknowns.clone() {
                    jacobian[unknown][k] *= reading.slope;
                }
            }
        }
    }
}

impl BandLight {
    /// Growth of the illumination along u and v, per px.
    fn growth(&self) -> [f32; 2] {
        self.illumination_slope.map(|slope| slope as f32)
    }
}

/// Fits bodies to the bands of a frame.
pub(crate) struct Joint<'a> {
    pub(crate) bands: &'a [BandView<'a>],
    pub(crate) bodies: Vec<Body>,
}

impl Joint<'_> {
    /// One round: every body that does not rest yet, each after what was just learnt of its neighbours.
    pub(crate) fn sweep(&mut self, workspace: &mut Workspace) {
        for index in 0..self.bodies.len() {
            if self.bodies[index].rests() {
                continue;
            }
            let softening_px = self.bodies[index].softening_px();
            let mask_foreign = self.bodies[index].is_near();
            self.bodies[index].masked = mask_foreign;
            self.refresh(index, softening_px);
            for band in 0..self.bands.len() {
                self.measure(index, band, mask_foreign, softening_px == 0.0, workspace);
            }
            self.bodies[index].step();
        }
    }

    /// Brings the images of a body up to date with its dot.
    pub(crate) fn refresh(&mut self, index: usize, softening_px: f64) {
        let Body { dot, bands, .. } = &mut self.bodies[index];
        for (view, light) in self.bands.iter().zip(bands) {
            if let Some(light) = light {
                light.spot = view.spot(dot);
                light.spot.soften(softening_px);
                light.spot.shift(shift_px(&light.spot, light.illumination_slope));
                light.jacobian = Spot::jacobian(dot, view.pencil, view.page, view.aberration_mm);
            }
        }
    }

    /// Finds again which bodies' images touch.
    pub(crate) fn meet_neighbours(&mut self, workspace: &mut Workspace) {
        let (bands, bodies) = (self.bands.len(), self.bodies.len());
        workspace.neighbours.resize_with(bands * bodies, Vec::new);
        workspace.neighbours.iter_mut().for_each(Vec::clear);
        for band in 0..bands {
            let mut order: Vec<(f64, u32, f64, f64)> = Vec::with_capacity(bodies);
            for (index, body) in self.bodies.iter().enumerate() {
                if let (Some(light), true) = (&body.bands[band], body.alive) {
                    let [u_px, v_px] = light.spot.centre_px;
                    order.push((u_px, index as u32, v_px, self.window_px(band, &light.spot)));
                }
            }
            order.sort_by(|a, b| a.0.total_cmp(&b.0));
            let widest = order.iter().map(|entry| entry.3).fold(0.0, f64::max);
            for (place, &(u_px, index, v_px, reach_px)) in order.iter().enumerate() {
                for &(other_u_px, other, other_v_px, other_px) in &order[place + 1..] {
                    if other_u_px - u_px > reach_px + widest {
                        break;
                    }
                    if (other_u_px - u_px).hypot(other_v_px - v_px) < reach_px + other_px {
                        workspace.neighbours[index as usize * bands + band].push(other);
                        workspace.neighbours[other as usize * bands + band].push(index);
                    }
                }
            }
        }
        for (index, body) in self.bodies.iter_mut().enumerate() {
            let own = &workspace.neighbours[index * bands..(index + 1) * bands];
            body.has_neighbours = own.iter().any(|neighbours| !neighbours.is_empty());
        }
    }

    fn window_px(&self, band: usize, spot: &Spot) -> f64 {
        let step_px = self.bands[band].plane.step_px as f64;
        spot.reach_px() + (MARGIN_SHARE * spot.radius_px).max(MARGIN_SAMPLES * step_px)
    }

    /// Sums the normal equations of a body in a band over its window.
    fn measure(&mut self, index: usize, band: usize, mask_foreign: bool, feel_blur: bool, workspace: &mut Workspace) {
        let Some(light) = &self.bodies[index].bands[band] else { return };
        let view = &self.bands[band];
        let limit = if mask_foreign { FOREIGN_SIGMAS * FOREIGN_SIGMAS } else { f32::INFINITY };
        let asked = Asked { feel_blur, limit };
        let rings = self.rings(index, band, light, workspace);
        workspace.samples.gather(&view.plane, &rings);
        let mut normal = Normal::default();
        self.compare_edge(index, band, asked, workspace);
        normal.add(&mut workspace.lines);
        let Workspace { samples, lines, .. } = workspace;
        let Samples { full_places, full_codes, .. } = samples;
        lines.resize(full_codes.len());
        let ([gu, gv], level) = (light.growth(), (light.contrast + light.background) as f32);
        for k in 0..full_codes.len() {
            let lit = 1.0 + gu * full_places.du[k] + gv * full_places.dv[k];
            lines.jacobian[5][k] = lit;
            lines.residual[k] = level * lit;
        }
        view.compare(full_codes, asked, 5..6, lines);
        normal.add_full(lines);
        normal.complete();
        if let Some(expected) = self.bodies[index].expected_contrast(light) {
            normal.expect_contrast(expected.value - light.contrast, expected.std);
        }
        if let Some(light) = &mut self.bodies[index].bands[band] {
            light.shape = normal.shape();
            light.normal = normal;
        }
    }

    /// The window about a spot, and the part of it that the spot fills and no other reaches.
    pub(crate) fn rings(&self, index: usize, band: usize, light: &BandLight, workspace: &Workspace) -> Rings {
        let [u_px, v_px] = light.spot.centre_px;
        let gap_px = |neighbour: &u32| {
            let spot = &self.bodies[*neighbour as usize].bands[band].as_ref()?.spot;
            Some((spot.centre_px[0] - u_px).hypot(spot.centre_px[1] - v_px) - spot.reach_px())
        };
        let gaps_px = workspace.neighbours[index * self.bands.len() + band].iter().filter_map(gap_px);
        Rings {
            centre_px: light.spot.centre_px,
            window_px: self.window_px(band, &light.spot),
            full_px: gaps_px.fold(light.spot.full_px(), f64::min).max(0.0),
        }
    }

    /// Derivatives, weights and residuals of the samples about a spot that it does not fill.
    fn compare_edge(&self, index: usize, band: usize, asked: Asked, workspace: &mut Workspace) {
        let Some(light) = &self.bodies[index].bands[band] else { return };
        self.light_of_others(index, band, &light.spot, workspace);
        let Workspace { samples: Samples { places, codes, .. }, own, narrow, others, lines, .. } = workspace;
        own.fill(&light.spot, places);
        bend(own, light, places, narrow);
        let count = places.len();
        lines.resize(count);
        let [gu, gv] = light.growth();
        let (contrast, background) = (light.contrast as f32, light.background as f32);
        // An added blur tells nothing of depth.
        let with_blur = if asked.feel_blur { contrast } else { 0.0 };
        let Lines { jacobian: [to_u, to_v, to_radius, to_blur, to_contrast, to_ground], residual, .. } = lines;
        let (du, dv) = (&places.du[..count], &places.dv[..count]);
        for k in 0..count {
            let lit = 1.0 + gu * du[k] + gv * dv[k];
            let scale = contrast * lit;
            to_u[k] = scale * own.with_u[k];
            to_v[k] = scale * own.with_v[k];
            to_radius[k] = scale * own.with_radius[k];
            to_blur[k] = with_blur * lit * own.with_blur[k];
            to_contrast[k] = lit * own.light[k];
            to_ground[k] = lit * own.open[k];
            residual[k] = others[k] + contrast * to_contrast[k] + background * to_ground[k];
        }
        self.bands[band].compare(codes, asked, 0..UNKNOWNS, lines);
    }

    /// Light of the neighbours of a spot on its samples.
    pub(crate) fn light_of_others(&self, index: usize, band: usize, spot: &Spot, workspace: &mut Workspace) {
        let Workspace { samples, others, near, neighbours, .. } = workspace;
        others.clear();
        others.resize(samples.places.len(), 0.0);
        for &neighbour in &neighbours[index * self.bands.len() + band] {
            let Some(light) = &self.bodies[neighbour as usize].bands[band] else { continue };
            near.find(&light.spot, spot, &samples.places);
            let ([gu, gv], contrast) = (light.growth(), light.contrast as f32);
            for (k, sample) in near.index.iter().enumerate() {
                let lit = 1.0 + gu * near.places.du[k] + gv * near.places.dv[k];
                others[*sample as usize] += contrast * lit * near.light.light[k];
            }
        }
    }

    /// Covariance of x, y, z and diameter of a body, with the neighbours' own unknowns left open.
    ///
    /// Each neighbour takes `X F⁻¹ Xᵀ` from the information, with F its own and X what both share.
    pub(crate) fn covariance(&self, index: usize, workspace: &mut Workspace) -> Option<Matrix4<f64>> {
        let body = &self.bodies[index];
        let (mut information, _) = body.equations();
        for (band, light) in body.bands.iter().enumerate() {
            let Some(light) = light else { continue };
            let neighbours = std::mem::take(&mut workspace.neighbours[index * self.bands.len() + band]);
            if !neighbours.is_empty() {
                let rings = Rings { full_px: 0.0, ..self.rings(index, band, light, workspace) };
                workspace.samples.gather(&self.bands[band].plane, &rings);
                self.compare_edge(index, band, Asked { feel_blur: true, limit: f32::INFINITY }, workspace);
            }
            let mut lost = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
            for &neighbour in &neighbours {
                let Some(other) = &self.bodies[neighbour as usize].bands[band] else { continue };
                // The neighbour's blur follows from its depth, which its other band tells.
                let known = other.normal.information.remove_row(3).remove_column(3);
                let Some(inverse) = known.try_inverse() else { continue };
                let shared = shared(light, other, workspace);
                lost += shared * inverse * shared.transpose();
            }
            workspace.neighbours[index * self.bands.len() + band] = neighbours;
            information -= light.jacobian.transpose() * without_light(light, &lost) * light.jacobian;
        }
        positive_inverse(information).or_else(|| {
            // So many share its light that each by itself takes too much: they tell as little as they can.
            let (alone, _) = body.equations();
            positive_inverse(alone).map(|covariance| covariance * SHARED_BY_MANY)
        })
    }
}

/// Growth of the variances of a dot of whose own light the neighbours leave too little to say how much.
const SHARED_BY_MANY: f64 = 4.0;

/// Inverse of an information matrix, if it can be one.
fn positive_inverse(information: Matrix4<f64>) -> Option<Matrix4<f64>> {
    information.try_inverse().filter(|covariance| covariance.diagonal().iter().all(|variance| *variance > 0.0))
}

impl Near {
    /// Finds the samples, placed about `about`, that `spot` reaches, and its light there.
    fn find(&mut self, spot: &Spot, about: &Spot, places: &Places) {
        let shift = |axis: usize| (about.centre_px[axis] - spot.centre_px[axis]) as f32;
        let (shift_u, shift_v, reach) = (shift(0), shift(1), spot.reach_px() as f32);
        self.index.clear();
        self.places.clear();
        for (index, (du, dv)) in places.du.iter().zip(&places.dv).enumerate() {
            let (du, dv) = (du + shift_u, dv + shift_v);
            if du * du + dv * dv < reach * reach {
                self.index.push(index as u32);
                self.places.push(du, dv);
            }
        }
        self.light.fill(spot, &self.places);
    }
}

/// What a loss of information on all six unknowns of a spot costs its shape, contrast and background free.
fn without_light(light: &BandLight, lost: &SMatrix<f64, UNKNOWNS, UNKNOWNS>) -> Matrix4<f64> {
    let reduced = Normal { information: light.normal.information - lost, ..light.normal };
    match (light.shape, reduced.shape()) {
        (Some(before), Some(after)) => before.information - after.information,
        _ => Matrix4::zeros(),
    }
}

/// `JᵀWJ′` between the unknowns of the spot that the workspace has just compared and those of another (of which u, v,
/// radius, contrast and background).
fn shared(own: &BandLight, other: &BandLight, workspace: &mut Workspace) -> SMatrix<f64, UNKNOWNS, 5> {
    let Workspace { samples, near, lines, .. } = workspace;
    near.find(&other.spot, &own.spot, &samples.places);
    let contrast = other.contrast as f32;
    let Light { light, with_u, with_v, with_radius, .. } = &near.light;
    let mut weighted = vec![0.0; near.index.len()];
    let mut shared = SMatrix::<f64, UNKNOWNS, 5>::zeros();
    for i in 0..UNKNOWNS {
        for (weighted, sample) in weighted.iter_mut().zip(&near.index) {
            *weighted = lines.weight[*sample as usize] * lines.jacobian[i][*sample as usize];
        }
        let columns = [(with_u, contrast), (with_v, contrast), (with_radius, contrast), (light, 1.0)];
        for (k, (column, scale)) in columns.into_iter().enumerate() {
            shared[(i, k)] = f64::from(scale) * dot(&weighted, column);
        }
    }
    shared
}
