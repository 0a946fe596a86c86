//! From first positions to the most likely ones.

use nalgebra::{Matrix3, Matrix4};
use twinpupil_instrument::{Instrument, PlaneView, ResponseTable};

use crate::likelihood::black::Black;
use crate::likelihood::body::{Body, OwnCentre};
use crate::likelihood::illumination::set_illumination;
use crate::likelihood::joint::{BandView, Joint, Workspace};
use crate::likelihood::pencil::Pencil;
use crate::likelihood::spot::{Dot, Page};
use crate::noise::Noise;
use crate::slope::local_slopes;

/// An instrument's forward model, ready to be compared with pixels.
#[derive(Debug, Clone)]
pub(crate) struct ForwardModel {
    bands: Vec<BandModel>,
    table: Option<ResponseTable>,
}

#[derive(Debug, Clone)]
struct BandModel {
    pencil: Pencil,
    page: Page,
    /// Index of the band in the instrument and in the table.
    index: usize,
}

/// A dot as detection and matching know it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Seed {
    pub(crate) centre_mm: [f64; 3],
    pub(crate) diameter_mm: f64,
    /// Contrast in every band that shows it, codes.
    pub(crate) contrast: Vec<Option<f64>>,
    /// Whether its bands together tell its depth.
    pub(crate) placed: bool,
    /// Whether its place may be off by more than the width of an edge.
    pub(crate) doubtful: bool,
    /// Whether the largest code hides how bright it is.
    pub(crate) saturated: bool,
}

/// A dot as its pixels know it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Refined {
    pub(crate) dot: Dot,
    /// Of x, y, z and diameter, mm².
    pub(crate) covariance_mm2: Matrix4<f64>,
    /// What each band measures by itself.
    pub(crate) centres: Vec<Option<OwnCentre>>,
    /// χ² of all pixels over their number less that of the unknowns.
    pub(crate) reduced_chi2: f64,
    /// Excess of the residuals over the noise, relative to the contrast.
    pub(crate) misfit: f64,
    /// Radius of its least blur in any band, px.
    pub(crate) blur_px: f64,
    pub(crate) masked_px: usize,
    pub(crate) used_px: usize,
}

impl Refined {
    /// Whether its pixels look like those of a disc: those that count, and nearly all of them do unless the largest
    /// code hides them.
    pub(crate) fn is_disc(&self, is_saturated: bool) -> bool {
        const MISFIT_MAX: f64 = 0.05;
        const MASKED_MAX: f64 = 0.03;
        let masked = self.masked_px as f64 / (self.used_px + self.masked_px).max(1) as f64;
        self.misfit < MISFIT_MAX && (is_saturated || masked < MASKED_MAX)
    }

    /// Whether what is left of a saturated dot's pixels tells how far away it is: of a sharp one that is a line of them,
    /// whose half-lit steps have to be modelled far better than those of a whole edge.
    pub(crate) fn tells_depth(&self) -> bool {
        const STD_MAX: f64 = 0.01;
        const CHI2_MAX: f64 = 1.25;
        const BLUR_PX_MIN: f64 = 4.0;
        self.blur_px > BLUR_PX_MIN && self.reduced_chi2 < CHI2_MAX && self.covariance_mm2[(2, 2)].sqrt() < STD_MAX * self.dot.centre_mm[2]
    }

    /// Of x, y and z, mm².
    pub(crate) fn position_covariance_mm2(&self) -> Matrix3<f64> {
        self.covariance_mm2.fixed_view::<3, 3>(0, 0).into_owned()
    }
}

/// Depth of a dot that only one band shows is about that of the others, mm.
const LONE_Z_STD_MM: f64 = 30.0;

/// A change of slope that moves a dot by some tenths of its deviation, and the step after which it is looked at again.
const SLOPE_FELT: f64 = 0.003;
const SLOPE_SIGMAS: f64 = 20.0;

/// Rounds at most.
const SWEEPS: usize = 16;

/// Rounds before which the slopes of surfaces are found: from the first positions, and when they are settled again.
const SLOPE_ROUNDS: [usize; 5] = [0, 1, 2, 3, 5];

/// Rounds before which it is found how the light grows: from about where the dots are, and from where they are.
const LIGHT_ROUNDS: [usize; 2] = [1, 3];

/// From this round on only dots that have settled tell the slope of their neighbours' surface.
const SETTLED_ROUND: usize = 3;

impl ForwardModel {
    /// The model of the bands of an instrument with these indices.
    pub(crate) fn new(instrument: &Instrument, table: Option<&ResponseTable>, bands: &[usize]) -> Self {
        let band = |index: usize| {
            let axis_px = instrument.axis_px(&instrument.bands[index]);
            let page = Page { axis_px, pitch_mm: instrument.sensor.pitch_mm };
            let focal_length_mm = match table {
                Some(table) => table.bands[index].focal_length_mm,
                None => instrument.projection(&instrument.bands[index]).focal_length_mm,
            };
            let pencil = Pencil::of_band(instrument, &instrument.bands[index], focal_length_mm);
            BandModel { pencil, page, index }
        };
        Self { bands: bands.iter().map(|index| band(*index)).collect(), table: table.cloned() }
    }

    /// The most likely dots, in the order of `seeds`; `None` where a seed led nowhere.
    pub(crate) fn refine(
        &self,
        planes: &[(PlaneView<'_>, Noise)],
        seeds: &[Seed],
        background: &[f64],
        workspace: &mut Workspace,
    ) -> Vec<Option<Refined>> {
        let aberrations: Vec<_> = self.bands.iter().map(|band| self.aberration_mm(band.index)).collect();
        let views: Vec<BandView<'_>> = (self.bands.iter().zip(planes))
            .zip(&aberrations)
            .map(|((band, (plane, noise)), aberration_mm)| BandView {
                plane: *plane,
                noise: *noise,
                black: Black::new(noise),
                page: band.page,
                pencil: &band.pencil,
                aberration_mm,
            })
            .collect();
        let bodies = seeds.iter().map(|seed| body(seed, &views, background)).collect();
        let mut joint = Joint { bands: &views, bodies };
        for round in 0..SWEEPS {
            if SLOPE_ROUNDS.contains(&round) {
                set_slopes(&mut joint.bodies, seeds, round < SETTLED_ROUND);
            }
            joint.meet_neighbours(workspace);
            if LIGHT_ROUNDS.contains(&round) {
                set_illumination(&mut joint, workspace);
            }
            joint.sweep(workspace);
            if joint.bodies.iter().all(Body::rests) {
                break;
            }
        }
        (0..seeds.len()).map(|index| refined(&joint, index, workspace)).collect()
    }

    fn aberration_mm(&self, band: usize) -> impl Fn(f64, f64) -> f64 + Sync + '_ {
        move |r_mm, z_mm| self.table.as_ref().map_or(0.0, |table| table.at(band, r_mm, z_mm).aberration_mm)
    }
}

fn body(seed: &Seed, views: &[BandView<'_>], background: &[f64]) -> Body {
    let dot = Dot { centre_mm: seed.centre_mm, diameter_mm: seed.diameter_mm, slopes: [0.0; 2] };
    let lights = views.iter().zip(&seed.contrast).zip(background);
    Body {
        dot,
        bands: lights.map(|((view, contrast), ground)| contrast.map(|c| view.light(&dot, c, *ground))).collect(),
        z_prior_mm: (!seed.placed).then_some((seed.centre_mm[2], LONE_Z_STD_MM)),
        information: Matrix4::zeros(),
        step_sigmas: f64::INFINITY,
        alive: true,
        rounds: 0,
        doubtful: seed.doubtful,
        saturated: seed.saturated,
        masked: false,
        has_neighbours: false,
    }
}

/// Gives every placed dot the slopes of the surface that its neighbours show: all of them, or those that have settled.
fn set_slopes(bodies: &mut [Body], seeds: &[Seed], all: bool) {
    let places = |bodies: &[Body], all: bool| -> Vec<[f64; 3]> {
        let counts = |(body, seed): &(&Body, &Seed)| seed.placed && body.alive && (all || body.is_settled());
        bodies.iter().zip(seeds).filter(counts).map(|(body, _)| body.dot.centre_mm).collect()
    };
    let mut slopes = local_slopes(&places(bodies, all), &places(bodies, true)).into_iter();
    for (body, _) in bodies.iter_mut().zip(seeds).filter(|(body, seed)| seed.placed && body.alive) {
        let before = body.dot.slopes;
        body.dot.slopes = slopes.next().flatten().unwrap_or(before);
        // A dot that leans otherwise than it seemed is not where it seemed.
        if (0..2).any(|axis| (before[axis] - body.dot.slopes[axis]).abs() > SLOPE_FELT) {
            body.step_sigmas = body.step_sigmas.max(SLOPE_SIGMAS);
        }
        // The area of its foreshortened image is what is known of its size.
        let stretch = |[sx, sy]: [f64; 2]| 1.0 + sx * sx + sy * sy;
        body.dot.diameter_mm *= (stretch(body.dot.slopes) / stretch(before)).powf(0.25);
    }
}

fn refined(joint: &Joint<'_>, index: usize, workspace: &mut Workspace) -> Option<Refined> {
    let body = &joint.bodies[index];
    if !body.alive {
        return None;
    }
    let (used, masked_px, chi2) = body.fit_quality();
    let unknowns = 4 + 2 * body.bands.iter().flatten().count();
    let reduced_chi2 = chi2 / used.saturating_sub(unknowns).max(1) as f64;
    let covariance_mm2 = joint.covariance(index, workspace)? * reduced_chi2.max(1.0);
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
    })
}
