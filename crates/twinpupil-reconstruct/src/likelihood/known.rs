//! Dots whose places are given: which way the pixels would have their images moved.

use std::f64::consts::PI;

use nalgebra::{Matrix4, Vector4};
use smallvec::SmallVec;
use twinpupil_instrument::PlaneView;

use crate::likelihood::body::{BandLight, Body};
use crate::likelihood::illumination::set_illumination;
use crate::likelihood::joint::Joint;
use crate::likelihood::refine::{ForwardModel, Sketch, Workspace};
use crate::likelihood::spot::Dot;
use crate::likelihood::view::BandView;
use crate::noise::Noise;

/// A dot whose place in space is given.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownDot {
    /// Its centre before the front principal point, mm.
    pub centre_mm: [f64; 3],
    /// Slopes dz/dx and dz/dy of its surface.
    pub slopes: [f64; 2],
    /// Its diameter, mm.
    pub diameter_mm: f64,
    /// About its light in each band of the instrument; `None` where it is not looked at.
    pub lights: Vec<Option<KnownLight>>,
}

/// How bright a dot and the ground around it are; all of it is fitted anew.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownLight {
    /// How much brighter than the ground it is, codes.
    pub contrast_codes: f64,
    /// The ground, codes.
    pub ground_codes: f64,
    /// Growth of the illumination along u and v, relative, 1/px, as far as it is significant.
    pub illumination_per_px: [f64; 2],
    /// Whether that was fitted before, with the dot nearly where it is now: one look is enough then.
    pub is_fitted: bool,
}

/// What the pixels of one band say of the image of a dot whose place is given: the log-likelihood of a small change Δ of
/// the image's u, v, radius and blur (px) is `score·Δ − ½ Δ·information Δ`, whatever brightness and ground may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpotScore {
    /// Its slope.
    pub score: Vector4<f64>,
    /// Its curvature: the inverse is the covariance of a measurement.
    pub information: Matrix4<f64>,
    /// χ² of the pixels about the image as it is given.
    pub chi2: f64,
    /// Pixels that count.
    pub used_px: usize,
    /// Pixels that were left out: saturated, dead or foreign.
    pub masked_px: usize,
    /// Whether the masks take some of the dot's light.
    pub is_cut: bool,
    /// Whether a lens that is not ideal is in its light, which the model follows to second order.
    pub is_aberrated: bool,
    /// Its light as the pixels have it.
    pub light: KnownLight,
}

impl ForwardModel {
    /// What the pixels say of given dots, in every band of this model that shows them; their light is that of its bands.
    pub(crate) fn scores(
        &self,
        planes: &[(PlaneView<'_>, Noise)],
        dots: &[(Dot, SmallVec<[Option<KnownLight>; 2]>)],
        workspace: &mut Workspace,
    ) -> Vec<SmallVec<[Option<SpotScore>; 2]>> {
        let mut blacks = std::mem::take(&mut workspace.blacks);
        let scores = self.look(planes, &mut blacks, |views| {
            let Workspace { bodies, buffers, glance, .. } = workspace;
            bodies.clear();
            bodies.extend(dots.iter().map(|(dot, lights)| body(*dot, lights, views)));
            let mut joint = Joint { bands: views, bodies, buffers, threads: 1 };
            joint.begin();
            look_until_known(&mut joint);
            let before: Vec<bool> = joint.bodies.iter().map(is_unevenly_lit).collect();
            if set_illumination(&mut joint, true, glance) {
                for (body, before) in joint.bodies.iter_mut().zip(before) {
                    body.stirred |= before != is_unevenly_lit(body);
                }
                look_until_known(&mut joint);
            }
            let black_levels = views.iter().map(|view| view.black.noise().black_level);
            let black_levels: SmallVec<[f64; 2]> = black_levels.collect();
            let of_body = |body: &Body| {
                let lights = body.bands.iter().zip(&black_levels);
                lights.map(|(light, black_level)| score(light.as_ref()?, *black_level)).collect()
            };
            joint.bodies.iter().map(of_body).collect()
        });
        workspace.blacks = blacks;
        scores
    }
}

fn look_until_known(joint: &mut Joint<'_>) {
    while !joint.bodies.iter().all(Body::rests) {
        joint.refresh_moving();
        joint.round();
    }
}

fn is_unevenly_lit(body: &Body) -> bool {
    body.bands.iter().flatten().any(|light| light.illumination_slope != [0.0; 2])
}

fn body(dot: Dot, lights: &[Option<KnownLight>], views: &[BandView<'_>]) -> Body {
    let mut body = Body::new(dot, None, false);
    body.pinned = true;
    body.is_lit = lights.iter().flatten().all(|light| light.is_fitted);
    body.bands.extend(views.iter().zip(lights).map(|(view, light)| {
        let KnownLight { contrast_codes, ground_codes, illumination_per_px, .. } = (*light)?;
        let background = ground_codes - view.black.noise().black_level;
        let (spot, jacobian) = view.spot(&dot);
        let sketch = Sketch { contrast: contrast_codes, area_px: PI * spot.radius_px * spot.radius_px };
        let mut light = BandLight::new(sketch, background, (spot, jacobian));
        light.illumination_slope = illumination_per_px;
        Some(light)
    }));
    body
}

fn score(light: &BandLight, black_level: f64) -> Option<SpotScore> {
    let shape = light.shape?;
    let is_sound = shape.score.iter().chain(shape.information.iter()).all(|value| value.is_finite());
    is_sound.then_some(SpotScore {
        score: shape.score,
        information: shape.information,
        chi2: light.normal.chi2,
        used_px: light.normal.used,
        masked_px: light.normal.masked,
        is_cut: light.spot.is_clipped(),
        is_aberrated: light.spot.smear.is_some(),
        light: KnownLight {
            contrast_codes: light.contrast,
            ground_codes: light.background + black_level,
            illumination_per_px: light.illumination_slope,
            is_fitted: true,
        },
    })
}
