//! What is fitted: one dot, its light in every band that shows it, and where it is imaged.

use std::f64::consts::PI;

use nalgebra::{Cholesky, Const, Matrix3, Matrix4, SVector, Vector3, Vector4, Vector6};
use smallvec::SmallVec;
use twinpupil_instrument::PixelPoint;

use crate::likelihood::coupling::NearLight;
use crate::likelihood::illumination::shift_px;
use crate::likelihood::normal::{Normal, Shape};
use crate::likelihood::pencil::length;
use crate::likelihood::prior::{Expected, Prior};
use crate::likelihood::refine::Sketch;
use crate::likelihood::samples::{Share, Window};
use crate::likelihood::soft::is_slanted;
use crate::likelihood::spot::{Dot, Spot, SpotJacobian};

/// A dot and its light.
#[derive(Debug, Clone)]
pub(crate) struct Body {
    pub(crate) dot: Dot,
    /// In the order of the bands; `None` where the band does not show it.
    pub(crate) bands: SmallVec<[Option<BandLight>; 2]>,
    /// What is known of it beforehand, if the bands alone do not tell its depth.
    pub(crate) prior: Option<Prior>,
    /// The step that the last equations ask for, in x, y, z and diameter, mm.
    step: Vector4<f64>,
    /// What the last equations tell of them, and its factor.
    information: Matrix4<f64>,
    equations: Option<Cholesky<f64, Const<4>>>,
    /// Size of the last step in standard deviations, and that of its position alone.
    pub(crate) step_sigmas: f64,
    pub(crate) moved_sigmas: f64,
    /// The step that was asked for before, and how many times its length was taken.
    last_step: Vector4<f64>,
    gain: f64,
    /// The length of the last step over that of the one before, if little but the step has changed.
    pace: f64,
    /// How far its edges moved last, over their widths.
    pub(crate) stride: f64,
    /// The same of what its slopes did to them since, and that over the roots of their widths, √px.
    pub(crate) leant: f64,
    pub(crate) leant_felt: f64,
    /// Whether its surface or its light have changed since so that it feels it.
    pub(crate) stirred: bool,
    /// Whether its light could be fitted at all.
    pub(crate) alive: bool,
    /// Rounds in which it has been fitted.
    pub(crate) rounds: usize,
    /// Whether it may be far from its place at first.
    pub(crate) doubtful: bool,
    /// Whether the largest code hides how bright it is.
    pub(crate) saturated: bool,
    /// Its number among the points that the surface is laid through.
    pub(crate) on_surface: Option<usize>,
    /// Whether its place is given, so that nothing but its light is fitted.
    pub(crate) pinned: bool,
    /// Whether the light of a pinned one is known too, but for a last look.
    pub(crate) is_lit: bool,
    /// Whether pixels that do not fit were left out in the last round.
    pub(crate) masked: bool,
    /// How many of its rows were looked at in the last round, and in the one before.
    pub(crate) seen: Share,
    seen_before: Share,
    /// Whether another's light reaches into its window.
    pub(crate) has_neighbours: bool,
    /// Whether it takes part in the round, and whether a neighbour of it does.
    pub(crate) moves: bool,
    pub(crate) is_seen: bool,
    /// How well its pixels are explained, once the last step is taken.
    pub(crate) quality: FitQuality,
}

/// A dot's light in one band.
#[derive(Debug, Clone)]
pub(crate) struct BandLight {
    /// Its light less that of the ground, codes.
    pub(crate) contrast: f64,
    /// What it was found as.
    sketch: Sketch,
    /// The ground about it, codes above black.
    pub(crate) background: f64,
    /// Growth of the illumination along u and v, relative, 1/px.
    pub(crate) illumination_slope: [f64; 2],
    pub(crate) spot: Spot,
    pub(crate) jacobian: SpotJacobian,
    /// Its pixels, once they are read.
    pub(crate) window: Option<Window>,
    /// What the band's pixels said last.
    pub(crate) normal: Normal,
    pub(crate) shape: Option<Shape>,
    /// The step of u, v, radius, blur and contrast that goes with that of the dot, and that of the background.
    pub(crate) step: SVector<f64, 5>,
    background_step: f64,
    /// What the pixels then say of u, v, radius and blur, once its neighbours have taken theirs.
    score: Vector4<f64>,
}

/// Centre and size of a spot as its own band alone measures them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OwnCentre {
    pub(crate) centre: PixelPoint,
    pub(crate) std_px: [f64; 2],
    pub(crate) radius_px: f64,
    /// How much better the band's own centre and size explain its pixels than those of the dot do.
    pub(crate) chi2: f64,
}

impl BandLight {
    pub(crate) fn new(sketch: Sketch, background: f64, (spot, jacobian): (Spot, SpotJacobian)) -> Self {
        Self {
            contrast: sketch.contrast,
            sketch,
            background,
            illumination_slope: [0.0; 2],
            spot,
            jacobian,
            window: None,
            normal: Normal::default(),
            shape: None,
            step: SVector::zeros(),
            background_step: 0.0,
            score: Vector4::zeros(),
        }
    }

    /// How fast its light grows across its edges at most, codes per px: `2/πb`, and as much again for what masks do.
    pub(crate) fn steepness(&self) -> f64 {
        4.0 / PI * self.contrast.abs() / self.spot.edge_px()
    }

    /// What its neighbours see of it.
    pub(crate) fn near(&self) -> NearLight {
        NearLight {
            spot: self.spot.clone(),
            contrast: self.contrast,
            growth: self.growth().map(|slope| slope as f32),
            steepness: self.steepness(),
        }
    }

    /// Growth of the light along u and v, relative, 1/px: of the illumination, and of what the lens lets through.
    pub(crate) fn growth(&self) -> [f64; 2] {
        let ([iu, iv], [lu, lv]) = (self.illumination_slope, self.spot.falloff_slope());
        [iu + lu, iv + lv]
    }

    /// Centre and size that explain the band best by themselves, with the blur that the dot's last step gives them.
    pub(crate) fn own_centre(&self) -> Option<OwnCentre> {
        let shape = self.shape?;
        let information: Matrix3<f64> = shape.information.fixed_view::<3, 3>(0, 0).into_owned();
        let score = self.score - shape.information.column(3) * self.step[3];
        let score: Vector3<f64> = score.fixed_rows::<3>(0).into_owned();
        let covariance = information.try_inverse()?;
        let step = covariance * score;
        // What the dot's own step left of it.
        let left = step - self.step.fixed_rows::<3>(0);
        // What the model of the lens leaves is no contradiction.
        let judged = match &self.spot.smear {
            Some(smear) => (covariance + smear.left_px2().fixed_view::<3, 3>(0, 0)).try_inverse()?,
            None => information,
        };
        // The centre is that of the dot, not of its light.
        let [du, dv] = shift_px(&self.spot, self.illumination_slope);
        let [u, v] = [self.spot.centre_px[0] - du, self.spot.centre_px[1] - dv];
        Some(OwnCentre {
            centre: PixelPoint { u: u + step.x, v: v + step.y },
            std_px: [covariance[(0, 0)].max(0.0).sqrt(), covariance[(1, 1)].max(0.0).sqrt()],
            radius_px: self.spot.radius_px + step.z,
            chi2: left.dot(&(judged * left)).max(0.0),
        })
    }

    /// What the model of a lens leaves of the place and diameter of a dot, given what noise does: `G E Gᵀ` with E of the
    /// image and `G = C Jᵀ I`, C the covariance from noise and I the information on the image. `None` for an ideal lens.
    pub(crate) fn left_mm2(&self, noise_mm2: &Matrix4<f64>) -> Option<Matrix4<f64>> {
        let gain = noise_mm2 * self.jacobian.transpose() * self.shape?.information;
        Some(gain * self.spot.smear.as_ref()?.left_px2() * gain.transpose())
    }

    /// Area of the dot's image over that of the same dot across the axis: it is foreshortened, and magnified by what its
    /// depth is there.
    fn foreshortened(&self, centre_mm: [f64; 3], [sx, sy]: [f64; 2]) -> f64 {
        let magnified = self.jacobian[(2, 2)] / self.spot.radius_px;
        (1.0 + magnified * (sx * centre_mm[0] + sy * centre_mm[1])).max(0.1) / (1.0 + sx * sx + sy * sy).sqrt()
    }

    /// How much larger than its diameter the dot is found to be, if it has these slopes.
    ///
    /// A blur of radius b moves the half-lit edge of a disc of radius a inwards by b²/8a, which takes π b²/4 off its area.
    fn outgrown(&self, dot: &Dot, slopes: [f64; 2]) -> f64 {
        let Spot { radius_px, blur_px, .. } = self.spot;
        let area = self.sketch.area_px / PI + 0.25 * blur_px * blur_px;
        (area / self.foreshortened(dot.centre_mm, slopes)).sqrt() / radius_px
    }

    /// How far the edges move with the step, over their width.
    fn stride(&self) -> f64 {
        let moved_px = length([self.step[0], self.step[1]]).max(self.step[2].abs());
        moved_px / self.spot.edge_px()
    }

    /// χ² once the step is taken, as the equations foresee it, with the neighbours as they are.
    fn foreseen_chi2(&self) -> f64 {
        let Normal { information, score, chi2, .. } = &self.normal;
        let step = Vector6::from_fn(|i, _| if i < 5 { self.step[i] } else { self.background_step });
        (chi2 - 2.0 * step.dot(score) + step.dot(&(information * step))).max(0.0)
    }
}

/// How well the contrast of a saturated dot is guessed, relative: it is held near the guess until its place is known.
const GUESS_STD: [f64; 2] = [1e-4, 1.0];
const GUESS_ROUNDS: usize = 3;

/// Blur added to the edges of a doubtful dot in the first round, so that they are felt from farther away.
const SOFTENING_PX: f64 = 2.0;

/// After a stride this short, or so many rounds, all rows are looked at; while slopes change by more than that, its
/// neighbours are not in their places yet, and more rows would not help.
const APPROACHED_STRIDE: f64 = 0.1;
const APPROACHED_LEAN: f64 = 0.016;
const APPROACHED_LEAN_FELT: f64 = 0.02;
const APPROACH: usize = 4;

/// Rounds after which pixels that do not fit are left out, come what may.
const PATIENCE: usize = 6;
const PATIENCE_LEANING: usize = 10;
const PATIENCE_SATURATED: usize = 11;

/// When the next step is foreseen to be this small, in standard deviations, or with so little χ² a pixel, a dot is so near
/// its place that pixels which do not fit at all are not its own.
const NEAR_SIGMAS: f64 = 20.0;
const NEAR_CHI2: f64 = 1.5;

/// Rounds after which the light of a dot whose place is given is known: the first finds it, the next weigh pixels by it.
const PINNED_ROUNDS: usize = 3;

/// A dot rests when the next steps of its position alone and with the diameter are foreseen to be this small.
const LAST_SIGMAS: (f64, f64) = (0.2, 0.5);

/// The next step over the last one and its stride.
const BEND: f64 = 2.0;

/// Steps that are longer than this share of those before them lead towards a place farther off, and are lengthened by no more
/// than so many times: where masks cut a dot's light, what its equations leave out may be most of it.
const SLOW: f64 = 0.3;
const GAIN_MAX: f64 = 3.0;

/// Steps below this tell nothing of those that follow.
const SMALL_SIGMAS: f64 = 2.0;

impl Body {
    pub(crate) fn new(dot: Dot, prior: Option<Prior>, doubtful: bool) -> Self {
        Self {
            dot,
            bands: SmallVec::new(),
            prior,
            step: Vector4::zeros(),
            information: Matrix4::zeros(),
            equations: None,
            step_sigmas: f64::INFINITY,
            moved_sigmas: f64::INFINITY,
            last_step: Vector4::zeros(),
            gain: 1.0,
            pace: 0.0,
            stride: f64::INFINITY,
            leant: 0.0,
            leant_felt: 0.0,
            stirred: false,
            alive: true,
            rounds: 0,
            doubtful,
            saturated: false,
            on_surface: None,
            pinned: false,
            is_lit: false,
            masked: false,
            seen: Share::Quarter,
            seen_before: Share::Quarter,
            has_neighbours: false,
            moves: true,
            is_seen: false,
            quality: FitQuality::default(),
        }
    }

    /// Whether its bands together tell its depth.
    pub(crate) fn tells_depth(&self) -> bool {
        self.prior.is_none()
    }

    /// Whether it stands where its bands together tell.
    pub(crate) fn is_placed(&self) -> bool {
        self.alive && self.tells_depth()
    }

    /// Blur to be added in the coming round, px.
    pub(crate) fn softening_px(&self) -> f64 {
        if self.doubtful && self.rounds == 0 { SOFTENING_PX } else { 0.0 }
    }

    /// What the contrast of its light should be, where the pixels may not tell.
    pub(crate) fn expected_contrast(&self, light: &BandLight) -> Option<Expected> {
        if !self.saturated {
            return self.prior.and_then(|prior| prior.contrast);
        }
        let share = GUESS_STD[usize::from(self.rounds >= GUESS_ROUNDS)];
        let value = light.sketch.contrast;
        Some(Expected { value, std: share * value.abs().max(1.0) })
    }

    /// Whether it is near enough to its place that pixels which do not fit are not its own.
    pub(crate) fn is_near(&self) -> bool {
        if self.saturated {
            let is_settling = self.rounds > GUESS_ROUNDS && self.foreseen_sigmas().1 < NEAR_SIGMAS;
            return is_settling || self.rounds > PATIENCE_SATURATED;
        }
        if self.is_lit {
            return true;
        }
        if self.rounds == 0 {
            return false;
        }
        if self.pinned {
            return self.explains(NEAR_CHI2);
        }
        // On slopes that still change it may fit well what is left once the pixels that tell otherwise are left out.
        if self.leant > APPROACHED_LEAN && self.rounds <= PATIENCE_LEANING {
            return self.explains(NEAR_CHI2);
        }
        self.foreseen_sigmas().1 < NEAR_SIGMAS || self.explains(NEAR_CHI2) || self.rounds > PATIENCE
    }

    /// Whether its pixels lie about their model with so much χ² each.
    pub(crate) fn explains(&self, chi2_max: f64) -> bool {
        self.quality.chi2 < chi2_max * self.quality.used as f64
    }

    /// Whether nearly all of its pixels count.
    pub(crate) fn is_whole(&self) -> bool {
        const MASKED_MAX: f64 = 0.1;
        (self.quality.masked as f64) < MASKED_MAX * self.quality.used as f64
    }

    /// Whether another round would not move it, or nobody would notice: a dot that no depth is known of matters to those
    /// only on whom its light falls.
    pub(crate) fn rests(&self) -> bool {
        if self.pinned {
            let is_known = self.rounds >= if self.is_lit { 1 } else { PINNED_ROUNDS };
            return !self.alive || !self.stirred && is_known;
        }
        let is_idle = !self.tells_depth()
            && (!self.has_neighbours || self.rounds > 0 && self.explains(NEAR_CHI2) || self.rounds > PATIENCE);
        let (moved, step) = self.foreseen_sigmas();
        let is_last = !self.stirred && moved < LAST_SIGMAS.0 && step < LAST_SIGMAS.1;
        !self.alive || is_idle || (self.masked || self.is_clean()) && self.seen == Share::All && is_last
    }

    /// Whether its pixels lie about their model so closely that none of them will be left out: one that does not belong to it
    /// adds more than χ² scatters by.
    fn is_clean(&self) -> bool {
        let used = self.quality.used as f64;
        self.rounds > 0 && self.quality.chi2 < used + (2.0 * used).sqrt()
    }

    /// Takes other slopes. At first the largest of its outlines tells its diameter, since those of other bands may have
    /// lost more to the masks; later the area of its foreshortened image does.
    pub(crate) fn lean(&mut self, slopes: [f64; 2]) {
        let dot = self.dot;
        let lights = self.bands.iter().flatten();
        let growth = if self.rounds == 0 {
            lights.map(|light| light.outgrown(&dot, slopes)).fold(0.0, f64::max)
        } else {
            let area = |slopes: [f64; 2]| -> f64 {
                lights.clone().map(|light| light.foreshortened(dot.centre_mm, slopes)).sum()
            };
            (area(dot.slopes) / area(slopes)).sqrt()
        };
        self.dot = Dot { slopes, diameter_mm: growth * dot.diameter_mm, ..dot };
    }

    /// How many of its rows are to be looked at.
    pub(crate) fn share(&self) -> Share {
        let is_settled = self.leant < APPROACHED_LEAN && self.leant_felt < APPROACHED_LEAN_FELT;
        let is_close = self.stride < APPROACHED_STRIDE && is_settled;
        // Those that no depth is known of may rest at once, and their light falls on others.
        let may_rest = || !self.tells_depth() && self.bands.iter().flatten().any(|light| is_slanted(&light.spot));
        let is_whole = self.is_lit || is_close || self.rounds >= APPROACH || may_rest();
        if is_whole { Share::All } else { Share::Quarter }
    }

    /// About how large the next step will be, of the position alone and with the diameter, in standard deviations: what
    /// derivatives miss of a step grows with its stride, unless steps have been seen to shrink more slowly.
    fn foreseen_sigmas(&self) -> (f64, f64) {
        let shrinkage = self.pace.max(BEND * self.stride);
        (shrinkage * self.moved_sigmas, shrinkage * self.step_sigmas)
    }

    /// Compares the step with the one before, and finds how much of it to take.
    ///
    /// Equations that miss a share λ of every step ask for `s = (1 − λ) e` at a distance e from the place. Once g s was taken the
    /// next step is `s′ = s (1 − g (1 − λ))`, so that `g/(1 − s′/s) = 1/(1 − λ)` leads there.
    fn pace_itself(&mut self) {
        let along = |a: &Vector4<f64>| self.last_step.dot(&(self.information * a));
        let (ratio, before_sigmas) = (along(&self.step) / along(&self.last_step), along(&self.last_step).sqrt());
        // Other rows lead to another place, and conics too, but for what the equations of a dot that masks cut leave out.
        let is_cut = |light: &BandLight| light.spot.is_clipped() && !is_slanted(&light.spot);
        let is_like_before = self.seen == self.seen_before || self.bands.iter().flatten().any(is_cut);
        let tells = self.rounds > 1
            && is_like_before
            && self.leant < APPROACHED_LEAN
            && self.moved_sigmas.min(before_sigmas) > SMALL_SIGMAS
            && ratio.is_finite();
        self.pace = if tells { ratio.abs().min(1.0) } else { 0.0 };
        let is_slow = tells && (ratio > SLOW || self.gain > 1.0) && ratio < 1.0;
        self.gain = if is_slow { (self.gain / (1.0 - ratio)).clamp(1.0, GAIN_MAX) } else { 1.0 };
        self.last_step = self.step;
        self.seen_before = self.seen;
    }

    /// Information on x, y, z and diameter from all bands when they were last looked at.
    pub(crate) fn information(&self) -> Matrix4<f64> {
        self.information
    }

    fn sum_information(&self) -> Matrix4<f64> {
        let mut information = Matrix4::zeros();
        for light in self.bands.iter().flatten() {
            if let Some(shape) = &light.shape {
                information += light.jacobian.transpose() * shape.information * light.jacobian;
            }
        }
        if let Some(prior) = &self.prior {
            information += Matrix4::from_diagonal(&prior.information());
        }
        information
    }

    /// Gets ready to solve its equations.
    pub(crate) fn factorise(&mut self) {
        self.information = self.sum_information();
        self.equations = self.information.cholesky();
        self.alive &= self.pinned || self.equations.is_some();
        self.step = Vector4::zeros();
        for light in self.bands.iter_mut().flatten() {
            light.step = SVector::zeros();
            light.background_step = 0.0;
        }
    }

    /// Solves its equations, with what the steps of its neighbours take from its scores, for every band; how far the step
    /// is from the one before, in standard deviations.
    pub(crate) fn solve(&mut self, taken: impl Fn(usize) -> Vector6<f64>) -> f64 {
        let scores: SmallVec<[Vector6<f64>; 2]> = (0..self.bands.len())
            .map(|band| self.bands[band].as_ref().map_or(Vector6::zeros(), |light| light.normal.score - taken(band)))
            .collect();
        if self.pinned {
            self.follow(&scores);
            self.step_sigmas = 0.0;
            return 0.0;
        }
        let Some(equations) = &self.equations else { return 0.0 };
        let mut score = Vector4::zeros();
        for (light, own) in self.bands.iter().zip(&scores) {
            if let Some(BandLight { jacobian, shape: Some(shape), .. }) = light {
                score += jacobian.transpose() * shape.reduced_score(own);
            }
        }
        if let Some(prior) = &self.prior {
            score += prior.score(&self.dot);
        }
        let before = self.step;
        self.step = equations.solve(&score);
        let factor = equations.l().transpose();
        let sigmas = |step: &Vector4<f64>| (factor * step).norm();
        self.step_sigmas = sigmas(&self.step);
        let change_sigmas = sigmas(&(self.step - before));
        self.follow(&scores);
        change_sigmas
    }

    /// The steps of images and light that go with that of the dot.
    fn follow(&mut self, scores: &[Vector6<f64>]) {
        for (light, own) in self.bands.iter_mut().zip(scores) {
            if let Some(light) = light {
                light.follow(&self.step, own);
            }
        }
    }

    /// Takes the step that was solved for.
    pub(crate) fn advance(&mut self) {
        self.moved_sigmas = self.moved_sigmas();
        self.pace_itself();
        (self.stirred, self.leant, self.leant_felt) = (false, 0.0, 0.0);
        self.stride = self.gain * self.bands.iter().flatten().map(BandLight::stride).fold(0.0, f64::max);
        self.quality = self.foreseen_quality();
        // Far from the solution a full step may overshoot: no spot moves by more than a quarter of its size.
        let step = self.gain * self.step;
        let limit = 0.25 * self.dot.diameter_mm / step.xy().norm().max(step.w.abs()).max(1e-12);
        let limit = limit.min(10.0 / step.z.abs().max(1e-12)).min(1.0);
        for (coordinate, change) in self.dot.centre_mm.iter_mut().zip(step.iter()) {
            *coordinate += limit * change;
        }
        self.dot.diameter_mm += limit * step.w;
        self.rounds += 1;
        for light in self.bands.iter_mut().flatten() {
            light.contrast += limit * self.gain * light.step[4];
            light.background += limit * self.gain * light.background_step;
        }
        self.alive &= self.dot.diameter_mm > 0.0
            && self.dot.centre_mm[2] > 0.0
            && self.dot.centre_mm.iter().all(|coordinate| coordinate.is_finite());
    }

    /// Size of the step of x, y and z in standard deviations, whatever the diameter may do.
    fn moved_sigmas(&self) -> f64 {
        let information = &self.information;
        let shared: Vector3<f64> = information.fixed_view::<3, 1>(0, 3).into_owned();
        let own = information.fixed_view::<3, 3>(0, 0) - shared * shared.transpose() / information[(3, 3)].max(1e-12);
        let step = self.step.xyz();
        step.dot(&(own * step)).max(0.0).sqrt()
    }

    fn foreseen_quality(&self) -> FitQuality {
        let mut quality = FitQuality::default();
        for light in self.bands.iter().flatten() {
            quality.used += light.normal.used;
            quality.masked += light.normal.masked;
            quality.chi2 += light.foreseen_chi2();
        }
        quality
    }
}

/// Pixels of all bands, and how they lie about the model.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct FitQuality {
    pub(crate) used: usize,
    pub(crate) masked: usize,
    pub(crate) chi2: f64,
}

impl BandLight {
    /// The steps of image and light that go with that of the dot.
    fn follow(&mut self, step: &Vector4<f64>, score: &Vector6<f64>) {
        let Some(shape) = &self.shape else { return };
        self.score = shape.reduced_score(score);
        let image_step = self.jacobian * step;
        let light_step = shape.light_step(score, &image_step);
        self.step.fixed_rows_mut::<4>(0).copy_from(&image_step);
        self.step[4] = light_step.x;
        self.background_step = light_step.y;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix6;
    use twinpupil_instrument::paper;

    use super::*;
    use crate::likelihood::pencil::Pencil;
    use crate::likelihood::spot::Raster;

    /// A band whose pixels ask for this step of u, v, radius, blur, contrast and background.
    fn asking_for(step: Vector6<f64>) -> BandLight {
        let instrument = paper::instrument();
        let pencil = Pencil::of_band(&instrument, &instrument.bands[0], 100.0);
        let dot = Dot { centre_mm: [1.76, -1.32, 340.0], diameter_mm: 1.0, slopes: [0.0; 2] };
        let raster = Raster { axis_px: [959.5, 599.5], pitch_mm: 0.00586 };
        let image = Spot::with_jacobian(&dot, &pencil, raster, None);
        let mut light = BandLight::new(Sketch { contrast: 1000.0, area_px: 3000.0 }, 0.0, image);
        let factor = Matrix6::from_fn(|i, k| if i == k { 3.0 } else { ((5 * i + 3 * k) as f64).sin() });
        let information = 1e5 * factor * factor.transpose();
        light.normal = Normal { information, score: information * step, ..Normal::default() };
        light.shape = light.normal.shape();
        light
    }

    /// Its own centre and size once the dot's step moves its image so.
    fn own_after(light: &mut BandLight, image_step: Vector4<f64>) -> OwnCentre {
        let dot_step = light.jacobian.try_inverse().expect("a dot out of focus") * image_step;
        light.follow(&dot_step, &light.normal.score.clone());
        light.own_centre().expect("the pixels tell all six")
    }

    #[test]
    fn a_band_agrees_with_a_dot_that_does_what_it_asks_for() {
        let asked = Vector6::new(0.01, -0.02, 0.03, 0.05, 4.0, -2.0);
        let mut light = asking_for(asked);
        let own = own_after(&mut light, asked.fixed_rows::<4>(0).into_owned());
        assert!(own.chi2 < 1e-9, "{}", own.chi2);
        let Spot { centre_px: [u, v], radius_px, .. } = light.spot;
        let left = [own.centre.u - u - asked[0], own.centre.v - v - asked[1], own.radius_px - radius_px - asked[2]];
        assert!(left.iter().all(|left| left.abs() < 1e-9), "{left:?}");
    }

    #[test]
    fn a_band_contradicts_a_dot_by_the_square_of_what_that_leaves_of_it() {
        let asked = Vector6::new(0.01, -0.02, 0.03, 0.05, 4.0, -2.0);
        let left = Vector4::new(0.004, 0.0, -0.003, 0.0);
        let mut light = asking_for(asked);
        let chi2 = own_after(&mut light, asked.fixed_rows::<4>(0) - left).chi2;
        let expected = left.dot(&(light.shape.expect("the pixels tell all six").information * left));
        assert!((chi2 / expected - 1.0).abs() < 1e-9, "{chi2} for {expected}");
    }
}
