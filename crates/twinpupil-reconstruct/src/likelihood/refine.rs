//! From first positions to the most likely ones.

use nalgebra::{Matrix3, Matrix4};
use smallvec::SmallVec;
use twinpupil_instrument::{Instrument, Page, PlaneView, Projection, ResponseTable};

use crate::likelihood::black::Black;
use crate::likelihood::body::{BandLight, Body, FitQuality, OwnCentre};
use crate::likelihood::coupling::Coupling;
use crate::likelihood::covariance::{Patch, covariance};
use crate::likelihood::departure::Departures;
use crate::likelihood::illumination::{Glance, set_illumination};
use crate::likelihood::joint::{Buffers, Joint};
use crate::likelihood::pencil::Pencil;
use crate::likelihood::prior::Prior;
use crate::likelihood::spot::{Dot, Raster, Spot};
use crate::likelihood::view::BandView;
use crate::noise::Noise;
use crate::slope::Slopes;
use crate::threads::{for_each, for_each_chosen, for_each_part, part_length};

/// An instrument's forward model, ready to be compared with pixels.
#[derive(Debug, Clone)]
pub(crate) struct ForwardModel {
    bands: Vec<BandModel>,
}

#[derive(Debug, Clone)]
struct BandModel {
    pencil: Pencil,
    raster: Raster,
    /// Its page, unless that is the raster.
    page: Option<Page>,
    /// What the lens adds, unless it is ideal.
    departures: Option<Departures>,
    /// Index of the band in the instrument.
    index: usize,
}

/// A dot as detection and matching know it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Seed {
    pub(crate) centre_mm: [f64; 3],
    pub(crate) diameter_mm: f64,
    /// What every band shows of it.
    pub(crate) sketches: SmallVec<[Option<Sketch>; 2]>,
    /// What is known of it beforehand, unless its bands together tell its depth.
    pub(crate) prior: Option<Prior>,
    /// Whether its place may be off by more than the width of an edge.
    pub(crate) doubtful: bool,
    /// Whether the largest code hides how bright it is.
    pub(crate) saturated: bool,
}

/// A dot in one band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sketch {
    /// Codes.
    pub(crate) contrast: f64,
    /// Area above half of that, px².
    pub(crate) area_px: f64,
}

/// A dot as its pixels know it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Refined {
    pub(crate) dot: Dot,
    /// Of x, y, z and diameter, mm².
    pub(crate) covariance_mm2: Matrix4<f64>,
    /// What each band measures by itself.
    pub(crate) centres: SmallVec<[Option<OwnCentre>; 2]>,
    /// χ² of all pixels over their number less that of the unknowns.
    pub(crate) reduced_chi2: f64,
    /// Excess of the residuals over the noise, relative to the contrast.
    pub(crate) misfit: f64,
    /// Radius of its least blur in any band, px.
    pub(crate) blur_px: f64,
    pub(crate) masked_px: usize,
    pub(crate) used_px: usize,
    /// Whether another's light reaches into its window.
    pub(crate) has_neighbours: bool,
}

impl Refined {
    /// Whether its pixels look like those of a disc: those that count, and nearly all of them do unless the largest
    /// code hides them; where a neighbour lies over it, less of them are its own.
    pub(crate) fn is_disc(&self, is_saturated: bool) -> bool {
        const MISFIT_MAX: f64 = 0.05;
        const MASKED_MAX: f64 = 0.03;
        const MASKED_MAX_TOUCHED: f64 = 0.1;
        let masked = self.masked_px as f64 / (self.used_px + self.masked_px).max(1) as f64;
        let masked_max = if self.has_neighbours { MASKED_MAX_TOUCHED } else { MASKED_MAX };
        self.misfit < MISFIT_MAX && (is_saturated || masked < masked_max)
    }

    /// Whether what is left of a saturated dot's pixels tells how far away it is: of a sharp one that is a line of them,
    /// whose half-lit steps have to be modelled far better than those of a whole edge.
    pub(crate) fn tells_depth(&self) -> bool {
        const STD_MAX: f64 = 0.01;
        const CHI2_MAX: f64 = 1.25;
        const BLUR_PX_MIN: f64 = 4.0;
        self.blur_px > BLUR_PX_MIN
            && self.reduced_chi2 < CHI2_MAX
            && self.covariance_mm2[(2, 2)].sqrt() < STD_MAX * self.dot.centre_mm[2]
    }

    /// Of x, y and z, mm².
    pub(crate) fn position_covariance_mm2(&self) -> Matrix3<f64> {
        self.covariance_mm2.fixed_view::<3, 3>(0, 0).into_owned()
    }
}

/// A change of slope that moves a dot's edge by so much is felt, over the root of the edge's half width, √px: the wider it is
/// the less is known of its place.
const SLOPE_FELT: f64 = 0.006;

/// A dot whose χ² a pixel is below the first, or below so many times that of dots that are explained well, is where its surface
/// is.
const SETTLED_CHI2: f64 = 2.5;
const SETTLED_SHARE: f64 = 3.0;

/// Rounds at most.
const ROUNDS: usize = 16;

/// Every so many rounds those that rest take the slopes of the surface as well: others may never come to rest.
const LOOK_BACK: usize = 4;

/// Buffers that are used again from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Workspace {
    pub(crate) bodies: Vec<Body>,
    pub(crate) buffers: Buffers,
    /// One for every thread.
    patches: Vec<Patch>,
    pub(crate) blacks: Vec<Black>,
    slopes: Slopes,
    chi2s: Vec<f64>,
    pub(crate) glance: Glance,
}

/// Rounds before which it is found how the light grows: from about where the dots are, and from where they are; and on
/// if it does.
const LIGHT_ROUNDS: [usize; 2] = [1, 2];
const LIGHT_ROUNDS_UNEVEN: [usize; 3] = [3, 4, 6];

/// Times that it is found again when all dots rest; and that their slopes are, which for a dot between two planes may go on
/// changing as the dot does.
const LAST_LOOKS: usize = 2;
const LAST_SLOPES: usize = 2;

impl ForwardModel {
    /// The model of the bands of an instrument with these indices.
    pub(crate) fn new(instrument: &Instrument, table: Option<&ResponseTable>, bands: &[usize]) -> Self {
        let band = |index: usize| {
            let focal_length_mm = match table {
                Some(table) => table.bands[index].focal_length_mm,
                None => instrument.projection(&instrument.bands[index]).focal_length_mm,
            };
            let pencil = Pencil::of_band(instrument, &instrument.bands[index], focal_length_mm);
            let page = Page::new(&instrument.sensor, &instrument.bands[index], &pencil.projection);
            let departures = table.and_then(|table| Departures::of(table, index));
            match page.raster() {
                Some((axis, pitch_mm)) => {
                    let raster = Raster { axis_px: [axis.u, axis.v], pitch_mm };
                    BandModel { pencil, raster, page: None, departures, index }
                }
                None => {
                    let raster = Raster { axis_px: instrument.sensor.axis_px, pitch_mm: instrument.sensor.pitch_mm };
                    BandModel { pencil, raster, page: Some(page), departures, index }
                }
            }
        };
        Self { bands: bands.iter().map(|index| band(*index)).collect() }
    }

    /// The most likely dots, in the order of `seeds`; `None` where a seed led nowhere. So many threads share the work.
    pub(crate) fn refine(
        &self,
        planes: &[(PlaneView<'_>, Noise)],
        seeds: &[Seed],
        background: &[f64],
        threads: usize,
        workspace: &mut Workspace,
        refined: &mut Vec<Option<Refined>>,
    ) {
        let mut blacks = std::mem::take(&mut workspace.blacks);
        self.look(planes, &mut blacks, |views| {
            Self::refine_views(views, seeds, background, threads, workspace, refined)
        });
        workspace.blacks = blacks;
    }

    /// Hands out the bands of a frame, ready to be compared.
    pub(crate) fn look<T>(
        &self,
        planes: &[(PlaneView<'_>, Noise)],
        blacks: &mut Vec<Black>,
        then: impl FnOnce(&[BandView<'_>]) -> T,
    ) -> T {
        if !blacks.iter().map(Black::noise).eq(planes.iter().map(|(_, noise)| noise)) {
            *blacks = planes.iter().map(|(_, noise)| Black::new(noise)).collect();
        }
        let views: SmallVec<[BandView<'_>; 2]> = (self.bands.iter().zip(planes))
            .zip(&*blacks)
            .map(|((band, (plane, _)), black)| BandView {
                plane: *plane,
                black,
                raster: band.raster,
                page: band.page.as_ref(),
                pencil: &band.pencil,
                departures: band.departures.as_ref(),
            })
            .collect();
        then(&views)
    }

    fn refine_views(
        views: &[BandView<'_>],
        seeds: &[Seed],
        background: &[f64],
        threads: usize,
        workspace: &mut Workspace,
        refined: &mut Vec<Option<Refined>>,
    ) {
        let Workspace { bodies, buffers, patches, slopes, chi2s, glance, .. } = workspace;
        // Bodies are large: those that are there are written over, where they lie.
        bodies.truncate(seeds.len());
        for_each(bodies, threads, |index, place| *place = body(&seeds[index], views, background));
        bodies.extend(seeds[bodies.len()..].iter().map(|seed| body(seed, views, background)));
        let on_surface = bodies.iter_mut().filter(|body| body.tells_depth());
        on_surface.enumerate().for_each(|(index, body)| body.on_surface = Some(index));
        let mut joint = Joint { bands: views, bodies, buffers, threads };
        joint.begin();
        slopes.lay_through(joint.bodies.iter().filter(|body| body.tells_depth()).map(|body| body.dot.centre_mm));
        slopes.get_to_know(threads);
        let (mut is_uneven, mut last_looks, mut last_slopes) = (false, 0, 0);
        for round in 0..ROUNDS {
            renew_surface(joint.bodies, slopes, chi2s);
            set_slopes(joint.bodies, slopes, threads, |body| !body.rests() || round % LOOK_BACK == LOOK_BACK - 1);
            if joint.bodies.iter().all(Body::rests) {
                // Those that came to rest first may stand on a surface that is known better by now.
                if last_slopes < LAST_SLOPES {
                    set_slopes(joint.bodies, slopes, threads, |_| true);
                    last_slopes += 1;
                }
                // And their light may grow as nobody could tell before.
                if (is_uneven || round < LIGHT_ROUNDS[1]) && last_looks < LAST_LOOKS {
                    is_uneven = set_illumination(&mut joint, true, glance);
                    last_looks += 1;
                }
                if joint.bodies.iter().all(Body::rests) {
                    break;
                }
            }
            if LIGHT_ROUNDS.contains(&round) || is_uneven && LIGHT_ROUNDS_UNEVEN.contains(&round) {
                is_uneven = set_illumination(&mut joint, round > LIGHT_ROUNDS[0], glance);
            }
            joint.refresh_moving();
            joint.round();
        }
        joint.refresh_moving();
        refined.clear();
        refined.resize(seeds.len(), None);
        let (bodies, couplings) = (&*joint.bodies, &joint.buffers.couplings);
        let length = part_length(seeds.len(), threads);
        for_each_part(refined.chunks_mut(length), patches, threads, |number, part, patch| {
            for (place, refined) in part.iter_mut().enumerate() {
                *refined = self::refined(bodies, couplings, number * length + place, patch);
            }
        });
    }

    /// Of all bands, in the order of the instrument's.
    pub(crate) fn projections(&self) -> Vec<Projection> {
        let mut bands: Vec<&BandModel> = self.bands.iter().collect();
        bands.sort_by_key(|band| band.index);
        bands.into_iter().map(|band| band.pencil.projection).collect()
    }

    /// Whether the masks take some of a dot's light, for every band of this model.
    pub(crate) fn is_cut(&self, dot: &Dot) -> SmallVec<[bool; 2]> {
        let is_cut = |band: &BandModel| {
            let departure = band.departures.as_ref().map(|departures| departures.of_dot(dot));
            Spot::with_jacobian(dot, &band.pencil, band.raster, departure).0.is_clipped()
        };
        self.bands.iter().map(is_cut).collect()
    }
}

fn body(seed: &Seed, views: &[BandView<'_>], background: &[f64]) -> Body {
    let dot = Dot { centre_mm: seed.centre_mm, diameter_mm: seed.diameter_mm, slopes: [0.0; 2] };
    let mut body = Body::new(dot, seed.prior, seed.doubtful);
    body.saturated = seed.saturated;
    let lights = views.iter().zip(&seed.sketches).zip(background);
    body.bands.extend(
        lights.map(|((view, sketch), ground)| sketch.map(|sketch| BandLight::new(sketch, *ground, view.spot(&dot)))),
    );
    body
}

/// Lays the surface through the placed dots that are where it is.
fn renew_surface(bodies: &[Body], slopes: &mut Slopes, chi2s: &mut Vec<f64>) {
    let settled_chi2 = SETTLED_CHI2.max(SETTLED_SHARE * lower_chi2(bodies, chi2s));
    let is_settled = |body: &Body| body.alive && (body.rounds == 0 || body.explains(settled_chi2) && body.is_whole());
    let placed = bodies.iter().filter(|body| body.tells_depth());
    slopes.renew(placed.map(|body| (body.dot.centre_mm, is_settled(body))));
}

/// Gives dots the slopes of the surface: those that are placed lie on it, and the others probably do.
fn set_slopes(
    bodies: &mut [Body],
    slopes: &mut Slopes,
    threads: usize,
    is_asked: impl Fn(&Body) -> bool + Sync + Send,
) {
    const LEANT_EACH: usize = 32;
    let known = &*slopes;
    for_each_chosen(
        bodies,
        LEANT_EACH,
        threads,
        |body| body.alive && is_asked(body),
        |body| {
            let found = body.on_surface.and_then(|index| known.at_known(index));
            found.into_iter().for_each(|slopes| lean(body, slopes));
        },
    );
    for body in bodies.iter_mut().filter(|body| body.on_surface.is_none() && body.alive && is_asked(body)) {
        slopes.at(body.dot.centre_mm).into_iter().for_each(|slopes| lean(body, slopes));
    }
}

/// Gives a dot the slopes of its surface; one that rests and would not feel it keeps those that it has.
fn lean(body: &mut Body, slopes: [f64; 2]) {
    let before = body.dot.slopes;
    let shift_px = |light: &BandLight| edge_shift_px(light.spot.radius_px, before, slopes);
    let largest = |shares: &dyn Fn(&BandLight) -> f64| body.bands.iter().flatten().map(shares).fold(0.0, f64::max);
    let felt = largest(&|light| shift_px(light) / light.spot.edge_px().sqrt());
    if body.rests() && felt <= SLOPE_FELT {
        return;
    }
    let leant = largest(&|light| shift_px(light) / light.spot.edge_px());
    body.stirred |= felt > SLOPE_FELT;
    (body.leant, body.leant_felt) = (leant, felt);
    body.lean(slopes);
}

/// How far the outline of a disc moves when it leans otherwise, px: by the change of the cosine of its tilt; the blur and
/// the scale that change across it move it by some per cent of the change of slope at most.
fn edge_shift_px(radius_px: f64, before: [f64; 2], after: [f64; 2]) -> f64 {
    const ACROSS: f64 = 0.05;
    let middle = [0, 1].map(|axis| 0.5 * (before[axis] + after[axis]));
    let square = middle[0] * middle[0] + middle[1] * middle[1];
    let change = ((after[0] - before[0]).powi(2) + (after[1] - before[1]).powi(2)).sqrt();
    radius_px * change * (square.sqrt() / ((1.0 + square) * (1.0 + square).sqrt())).max(ACROSS)
}

/// χ² a pixel that three in four dots exceed.
fn lower_chi2(bodies: &[Body], chi2s: &mut Vec<f64>) -> f64 {
    let fitted = bodies.iter().filter(|body| body.alive && body.rounds > 0);
    chi2s.clear();
    chi2s.extend(fitted.map(|body| body.quality.chi2 / body.quality.used.max(1) as f64));
    let quarter = chi2s.len() / 4;
    if chi2s.is_empty() { 0.0 } else { *chi2s.select_nth_unstable_by(quarter, f64::total_cmp).1 }
}

fn refined(bodies: &[Body], couplings: &[Vec<Coupling>], index: usize, patch: &mut Patch) -> Option<Refined> {
    let body = &bodies[index];
    if !body.alive {
        return None;
    }
    let FitQuality { used, masked: masked_px, chi2 } = body.quality;
    let unknowns = 4 + 2 * body.bands.iter().flatten().count();
    let reduced_chi2 = chi2 / used.saturating_sub(unknowns).max(1) as f64;
    let noise_mm2 = covariance(bodies, couplings, index, patch)?;
    let left_mm2 = body.bands.iter().flatten().filter_map(|light| light.left_mm2(&noise_mm2));
    let covariance_mm2 = left_mm2.fold(noise_mm2 * reduced_chi2.max(1.0), |sum, left| sum + left);
    let misfits = body.bands.iter().flatten().map(|light| {
        let normal = &light.normal;
        let excess = (normal.chi2 / normal.used.max(1) as f64 - 1.0).max(0.0);
        // Information on the contrast over its pixels is the mean weight times the mean square of the light.
        let contrast_sigmas2 = normal.information[(4, 4)] * light.contrast.powi(2) / normal.used.max(1) as f64;
        (excess / contrast_sigmas2.max(1e-12)).sqrt()
    });
    Some(Refined {
        dot: body.dot,
        covariance_mm2,
        centres: body.bands.iter().map(|light| light.as_ref().and_then(|light| light.own_centre())).collect(),
        reduced_chi2,
        misfit: misfits.fold(0.0, f64::max),
        blur_px: body.bands.iter().flatten().map(|light| light.spot.blur_px_min()).fold(f64::INFINITY, f64::min),
        masked_px,
        used_px: used,
        has_neighbours: body.has_neighbours,
    })
}
