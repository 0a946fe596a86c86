//! All dots of a frame at once: each is fitted to what the others leave of the pixels, in turn, until none moves.

use nalgebra::{Matrix4, SMatrix};
use twinpupil_instrument::PlaneView;

use crate::likelihood::body::{BandLight, Body};
use crate::likelihood::normal::{Lines, Normal, UNKNOWNS, dot};
use crate::likelihood::pencil::Pencil;
use crate::likelihood::row::{Pixels, Row};
use crate::likelihood::spot::{Dot, Page, Spot};
use crate::noise::Noise;

/// One band of a frame and how it images.
pub(crate) struct BandView<'a> {
    pub(crate) plane: PlaneView<'a>,
    pub(crate) noise: Noise,
    pub(crate) page: Page,
    pub(crate) pencil: &'a Pencil,
    /// What the lens adds to the radius of an image, over (r, z), mm.
    pub(crate) aberration_mm: &'a (dyn Fn(f64, f64) -> f64 + Sync),
}

/// Buffers that are used again from row to row.
#[derive(Debug, Default)]
pub(crate) struct Workspace {
    codes: Vec<f32>,
    row: Row,
    other: Row,
    lines: Lines,
    neighbours: Vec<Vec<u32>>,
}

/// Ground about a spot that is fitted along with it: this share of its radius, and at least so many pixels of the plane.
const MARGIN_SHARE: f64 = 0.1;
const MARGIN_SAMPLES: f64 = 2.0;

/// Residuals beyond so many standard deviations belong to something else, once the fit is near.
const FOREIGN_SIGMAS: f32 = 6.0;

/// How a row is read.
#[derive(Debug, Clone, Copy)]
struct Asked {
    /// Whether the blur tells something of depth.
    feel_blur: bool,
    /// Largest square of a residual over its variance that counts.
    limit: f32,
    /// Whether the dot fills all of its pixels, so that only its brightness matters.
    full: bool,
}

/// A span of pixels of a plane's row.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Span {
    first: usize,
    count: usize,
}

impl Span {
    /// The part before a column.
    fn until(self, column: usize) -> Self {
        Self { count: column.saturating_sub(self.first).min(self.count), ..self }
    }

    /// The part from a column on.
    fn from(self, column: usize) -> Self {
        let end = self.first + self.count;
        let first = column.clamp(self.first, end);
        Self { first, count: end - first }
    }
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
            background,
            illumination_slope: [0.0; 2],
            spot: self.spot(dot),
            jacobian: Spot::jacobian(dot, self.pencil, self.page, self.aberration_mm),
            normal: Normal::default(),
            shape: None,
        }
    }

    /// Rows of the plane within a distance of a centre.
    fn rows(&self, v_px: f64, radius_px: f64) -> std::ops::Range<usize> {
        let (origin, step) = (self.plane.origin_px[1] as f64, self.plane.step_px as f64);
        let first = ((v_px - radius_px - origin) / step).ceil().clamp(0.0, self.plane.rows as f64);
        let end = ((v_px + radius_px - origin) / step).floor() + 1.0;
        first as usize..(end.clamp(0.0, self.plane.rows as f64) as usize).max(first as usize)
    }

    /// Columns of a row within a circle.
    fn span(&self, row: usize, [u_px, v_px]: [f64; 2], radius_px: f64) -> Option<Span> {
        let off_px = self.plane.frame_v_px(row as f64) - v_px;
        let half_px = (radius_px * radius_px - off_px * off_px).max(0.0).sqrt();
        let (origin, step) = (self.plane.origin_px[0] as f64, self.plane.step_px as f64);
        let first = ((u_px - half_px - origin) / step).ceil().clamp(0.0, self.plane.columns as f64) as usize;
        let end = ((u_px + half_px - origin) / step).floor() + 1.0;
        let end = end.clamp(0.0, self.plane.columns as f64) as usize;
        (end > first).then(|| Span { first, count: end - first })
    }

    /// Whether a row passes a spot's centre at less than a distance.
    fn crosses(&self, row: usize, light: &BandLight, radius_px: f64) -> bool {
        (self.plane.frame_v_px(row as f64) - light.spot.centre_px[1]).abs() < radius_px
    }

    fn pixels(&self, row: usize, span: Span) -> Pixels {
        Pixels {
            u_px: self.plane.frame_u_px(span.first as f64),
            v_px: self.plane.frame_v_px(row as f64),
            step_px: self.plane.step_px as f64,
            count: span.count,
        }
    }
}

impl BandLight {
    /// Illumination relative to the centre's at the first pixel of a row, and its growth from pixel to pixel.
    fn illumination(&self, pixels: &Pixels) -> (f32, f32) {
        let [gu, gv] = self.illumination_slope;
        let [u_px, v_px] = self.spot.centre_px;
        let first = 1.0 + gu * (pixels.u_px - u_px) + gv * (pixels.v_px - v_px);
        (first as f32, (gu * pixels.step_px) as f32)
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
            self.bodies[index].softened = softening_px > 0.0;
            let mask_foreign = self.bodies[index].is_near();
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
                light.jacobian = Spot::jacobian(dot, view.pencil, view.page, view.aberration_mm);
            }
        }
    }

    /// Finds again which bodies' images touch.
    pub(crate) fn meet_neighbours(&self, workspace: &mut Workspace) {
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
    }

    fn window_px(&self, band: usize, spot: &Spot) -> f64 {
        let step_px = self.bands[band].plane.step_px as f64;
        spot.reach_px() + (MARGIN_SHARE * spot.radius_px).max(MARGIN_SAMPLES * step_px)
    }

    /// Sums the normal equations of a body in a band over its window.
    fn measure(&mut self, index: usize, band: usize, mask_foreign: bool, feel_blur: bool, workspace: &mut Workspace) {
        let Some(light) = &self.bodies[index].bands[band] else { return };
        let view = &self.bands[band];
        let radius_px = self.window_px(band, &light.spot);
        let mut normal = Normal::default();
        let limit = if mask_foreign { FOREIGN_SIGMAS * FOREIGN_SIGMAS } else { f32::INFINITY };
        let asked = Asked { feel_blur, limit, full: false };
        let full_px = light.spot.full_px();
        for row in view.rows(light.spot.centre_px[1], radius_px) {
            let Some(span) = view.span(row, light.spot.centre_px, radius_px) else { continue };
            // Where the dot fills the pixels, they tell of its light alone.
            let full = view.span(row, light.spot.centre_px, full_px).filter(|_| view.crosses(row, light, full_px));
            let (left, right) = match full {
                Some(full) => (span.until(full.first), span.from(full.first + full.count)),
                None => (span, Span { first: 0, count: 0 }),
            };
            for part in [left, right] {
                if part.count > 0 {
                    self.read_row(index, band, row, part, asked, workspace);
                    normal.add(&mut workspace.lines);
                }
            }
            if let Some(full) = full {
                self.read_row(index, band, row, full, Asked { full: true, ..asked }, workspace);
                normal.add_full(&mut workspace.lines);
            }
        }
        normal.complete();
        if let Some(light) = &mut self.bodies[index].bands[band] {
            light.shape = normal.shape();
            light.normal = normal;
        }
    }

    /// Derivatives, weights and residuals of a body's model along a row.
    fn read_row(&self, index: usize, band: usize, row: usize, span: Span, asked: Asked, workspace: &mut Workspace) {
        let view = &self.bands[band];
        let Some(light) = &self.bodies[index].bands[band] else { return };
        let pixels = view.pixels(row, span);
        let Workspace { codes, row: own, other, lines, neighbours } = workspace;
        codes.resize(span.count, 0.0);
        view.plane.read_span(row, span.first, codes);
        lines.resize(span.count);
        if !asked.full {
            own.fill(&light.spot, &pixels);
        }
        let saturated = f32::from(view.plane.code_max);
        let black = view.noise.black_level as f32;
        // `residual` first holds the light of the others, then that of all.
        lines.residual.fill(0.0);
        for &neighbour in &neighbours[index * self.bands.len() + band] {
            self.add_light(neighbour as usize, band, row, span, other, &mut lines.residual);
        }
        let (first, growth) = light.illumination(&pixels);
        let (contrast, background) = (light.contrast as f32, light.background as f32);
        // An added blur tells nothing of depth.
        let with_blur = if asked.feel_blur { contrast } else { 0.0 };
        let (floor, slope) = (view.noise.floor_codes2 as f32, view.noise.slope_codes as f32);
        let Lines { jacobian, weight, residual, .. } = lines;
        if asked.full {
            for k in 0..span.count {
                jacobian[5][k] = first + growth * k as f32;
                residual[k] += (contrast + background) * jacobian[5][k];
            }
        } else {
            for k in 0..span.count {
                let lit = first + growth * k as f32;
                let scale = contrast * lit;
                jacobian[0][k] = scale * own.with_u[k];
                jacobian[1][k] = scale * own.with_v[k];
                jacobian[2][k] = scale * own.with_radius[k];
                jacobian[3][k] = with_blur * lit * own.with_blur[k];
                jacobian[4][k] = lit * own.light[k];
                jacobian[5][k] = lit * own.open[k];
                residual[k] += contrast * jacobian[4][k] + background * jacobian[5][k];
            }
        }
        for k in 0..span.count {
            let trust = 1.0 / (floor + slope * residual[k].max(0.0));
            let left = codes[k] - black - residual[k];
            let out = (codes[k] >= saturated) | (left * left * trust > asked.limit);
            weight[k] = if out { 0.0 } else { trust };
            residual[k] = left;
        }
    }

    /// Adds the light of a body to the pixels of a row that it reaches.
    fn add_light(&self, index: usize, band: usize, row: usize, span: Span, buffer: &mut Row, sum: &mut [f32]) {
        let view = &self.bands[band];
        let Some(light) = &self.bodies[index].bands[band] else { return };
        let Some(own) = view.span(row, light.spot.centre_px, light.spot.reach_px()) else { return };
        let (first, end) = (own.first.max(span.first), (own.first + own.count).min(span.first + span.count));
        if end <= first {
            return;
        }
        let pixels = view.pixels(row, Span { first, count: end - first });
        buffer.fill(&light.spot, &pixels);
        let (illumination, growth) = light.illumination(&pixels);
        let contrast = light.contrast as f32;
        for (k, (sum, light)) in sum[first - span.first..].iter_mut().zip(&buffer.light).enumerate() {
            *sum += contrast * (illumination + growth * k as f32) * light;
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
            let neighbours = workspace.neighbours[index * self.bands.len() + band].clone();
            for neighbour in neighbours {
                let Some(other) = &self.bodies[neighbour as usize].bands[band] else { continue };
                let Some(shared) = self.shared(index, neighbour as usize, band, workspace) else { continue };
                // The neighbour's blur follows from its depth, which its other band tells.
                let own = other.normal.information;
                let known = own.remove_row(3).remove_column(3);
                let Some(inverse) = known.try_inverse() else { continue };
                let lost = shared * inverse * shared.transpose();
                let lost = self.without_light(light, &lost);
                information -= light.jacobian.transpose() * lost * light.jacobian;
            }
        }
        information.try_inverse().filter(|covariance| covariance.diagonal().iter().all(|variance| *variance > 0.0))
    }

    /// What a loss of information on all six unknowns of a spot costs its shape, contrast and background free.
    fn without_light(&self, light: &BandLight, lost: &SMatrix<f64, 6, 6>) -> Matrix4<f64> {
        let reduced = Normal { information: light.normal.information - lost, ..light.normal };
        match (light.shape, reduced.shape()) {
            (Some(before), Some(after)) => before.information - after.information,
            _ => Matrix4::zeros(),
        }
    }

    /// `JᵀWJ′` between the unknowns of two spots (of the other: u, v, radius, contrast, background).
    fn shared(
        &self,
        index: usize,
        neighbour: usize,
        band: usize,
        workspace: &mut Workspace,
    ) -> Option<SMatrix<f64, UNKNOWNS, 5>> {
        let view = &self.bands[band];
        let (own, other) = (self.bodies[index].bands[band].as_ref()?, self.bodies[neighbour].bands[band].as_ref()?);
        let (radius_px, other_px) = (self.window_px(band, &own.spot), other.spot.reach_px());
        let mut shared = SMatrix::<f64, UNKNOWNS, 5>::zeros();
        let mut row_buffer = Row::default();
        let contrast = other.contrast as f32;
        for row in view.rows(own.spot.centre_px[1], radius_px) {
            let (Some(a), Some(b)) =
                (view.span(row, own.spot.centre_px, radius_px), view.span(row, other.spot.centre_px, other_px))
            else {
                continue;
            };
            let (first, end) = (a.first.max(b.first), (a.first + a.count).min(b.first + b.count));
            if end <= first {
                continue;
            }
            let span = Span { first, count: end - first };
            self.read_row(
                index,
                band,
                row,
                span,
                Asked { feel_blur: true, limit: f32::INFINITY, full: false },
                workspace,
            );
            row_buffer.fill(&other.spot, &view.pixels(row, span));
            let Row { light, with_u, with_v, with_radius, .. } = &row_buffer;
            for i in 0..UNKNOWNS {
                let weighted: Vec<f32> =
                    workspace.lines.weight.iter().zip(&workspace.lines.jacobian[i]).map(|(w, j)| w * j).collect();
                for (k, (column, scale)) in
                    [(with_u, contrast), (with_v, contrast), (with_radius, contrast), (light, 1.0)]
                        .into_iter()
                        .enumerate()
                {
                    shared[(i, k)] += f64::from(scale) * dot(&weighted, column);
                }
            }
        }
        Some(shared)
    }
}
