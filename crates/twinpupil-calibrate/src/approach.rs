//! Poses and instrument as features alone tell them, without the frames that do not fit.

use nalgebra::{Matrix4, Vector4};
use twinpupil_instrument::{Parameter, PixelPoint, Projection, Role};
use twinpupil_reconstruct::{Feature, Reconstructor};

use crate::adjust::{Adjusted, Dots, Observation, Weighing};
use crate::blur::{Edge, added_px};
use crate::calibrate::{CalibrateError, Calibrator, Fault, FrameFault, is_leader};
use crate::forward::Slot;
use crate::lattice::median;
use crate::now::Now;
use crate::pose::{Pose, Sight};
use crate::seen::{Seen, on_page};
use crate::unknown::{Quantity, Unknown};

/// Tolerances from the data sheet beyond which a number is refused as long as features alone tell it.
const SIGMAS_MAX: f64 = 6.0;

/// The deviations of features are rough.
const WEIGHING: Weighing = Weighing { doubt_chi2: 25.0, misfit: 1.0 };

const UNTRIED: CalibrateError = CalibrateError::Undetermined("there is nothing to adjust to");

/// How far the numbers of a feature may be from those of the dot's image.
#[derive(Debug, Clone, Copy)]
struct Trust {
    /// Its centre, px.
    centre_px: f64,
    /// Its radius and that of its blur: of themselves, and px.
    radius: [f64; 2],
    blur: [f64; 2],
}

/// Before anything is known of the masks; and once it is known which dots they cut, of the others and of those.
const ROUGH: Trust = Trust { centre_px: 0.1, radius: [0.02, 1.0], blur: [0.1, 0.7] };
const WHOLE: Trust = Trust { centre_px: 0.01, radius: [0.01, 0.3], blur: [0.03, 0.5] };
const CUT: Trust = Trust { centre_px: 2.0, radius: [0.1, 2.0], blur: [0.2, 2.0] };

/// How far off blurs may be of themselves, as features and an instrument that is hardly known tell them; and once it is known.
const ROUGH_BLUR: f64 = 0.35;
const CLOSE_BLUR: f64 = 0.15;

/// What features lead to from some start.
struct Attempt {
    start: Now,
    observations: Vec<Observation>,
    adjusted: Adjusted,
}

impl Attempt {
    /// The fault of frames all of which are blurred by so much.
    fn blurred(&self, extra_px: f64) -> CalibrateError {
        match self.start.adjusted.state.poses.as_slice() {
            [pose] => CalibrateError::NoFrames(FrameFault::Blurred { extra_px, z_mm: pose.translation_mm.z }),
            _ => CalibrateError::AllBlurred { extra_px },
        }
    }

    /// χ² of the typical feature: masks that cut some dots, or a few wrong ones, make the cost large.
    fn typical_chi2(&self, unknowns: &[Unknown]) -> f64 {
        self.start.problem(unknowns, &self.observations, WEIGHING).typical_chi2(&self.adjusted.state)
    }
}

/// What features lead to first.
pub(crate) struct FirstLook {
    /// The best first.
    attempts: Vec<Attempt>,
    /// What is wrong with the last of the frames that were asked, if something is with all.
    fault: Option<FrameFault>,
}

/// Bands are the other way round if the typical χ² of that is less than this share.
const BETTER_EXCHANGED: f64 = 0.2;

/// Steps of the unknowns, in their deviations, that put the focus of bands elsewhere; the first is none.
fn focal_steps(unknowns: &[Unknown], frames: usize) -> Vec<Vec<f64>> {
    const STEP: f64 = 0.7;
    const STEPS: [f64; 5] = [0.0, -STEP, STEP, -2.0 * STEP, 2.0 * STEP];
    // Several frames lead to their focus from farther away.
    let tried = if frames == 1 { 5 } else { 3 };
    let mut all = vec![Vec::new()];
    for unknown in unknowns {
        let is_focal =
            matches!(unknown.quantity, Quantity::Instrument(Parameter::FocalLength | Parameter::BandFocalLength(_)));
        let steps = &STEPS[..if is_focal { tried } else { 1 }];
        all = all.iter().flat_map(|own| steps.iter().map(|step| [own.as_slice(), &[*step]].concat())).collect();
    }
    all
}

impl Calibrator<'_> {
    /// What features lead to first; frames that stand nowhere are left out.
    pub(crate) fn first_look(
        &self,
        reader: &Reconstructor,
        unknowns: &[Unknown],
        seen: &mut Vec<Seen<'_>>,
        faults: &mut Vec<Fault>,
    ) -> Result<FirstLook, CalibrateError> {
        let mut poses = Vec::new();
        seen.retain(|one| match self.first_pose(one) {
            Some(pose) => {
                poses.push(pose);
                true
            }
            None => {
                faults.push((one.frame, FrameFault::NoPose));
                false
            }
        });
        if seen.is_empty() {
            return Err(CalibrateError::no_frames(faults));
        }
        let start = self.start(reader, unknowns, seen, poses);
        let asked: Vec<usize> = (0..seen.len()).filter(|place| is_leader(*place, seen.len())).collect();
        // Blur of another origin would lead the focus astray.
        let (sound, fault) = self.without_faults(&start, unknowns, seen, &asked)?;
        let attempts = self.attempts(&start, unknowns, (seen, if sound.is_empty() { &asked } else { &sound }))?;
        self.check_roles(&start, unknowns, (seen, &asked), attempts.first().ok_or(UNTRIED)?)?;
        Ok(FirstLook { attempts, fault })
    }

    /// Poses and instrument as the features alone tell them from one of the attempts, by its rank, without frames that do not
    /// fit.
    pub(crate) fn approach(
        &self,
        look: &FirstLook,
        rank: usize,
        reader: &Reconstructor,
        unknowns: &[Unknown],
        seen: &mut Vec<Seen<'_>>,
        faults: &mut Vec<Fault>,
    ) -> Result<Now, CalibrateError> {
        let mut start = self.focused(look, rank, unknowns, seen)?;
        loop {
            let all: Vec<usize> = (0..seen.len()).collect();
            let Attempt { start: before, observations, adjusted } =
                self.attempt(start, unknowns, (seen, &all), &mut Vec::new())?;
            self.check_data_sheet(&before, unknowns, &adjusted, SIGMAS_MAX)?;
            let mut now = before.moved_to(unknowns, adjusted)?;
            let mut worst = self.worst_fault(&now, (&observations, &all), ROUGH_BLUR);
            if worst.is_none() {
                let (closer, observations) = self.closer(&now, reader, unknowns, seen)?;
                worst = self.worst_fault(&closer, (&observations, &all), CLOSE_BLUR);
                now = closer;
            }
            let Some((place, mut fault)) = worst else { return Ok(now) };
            if matches!(fault, FrameFault::Unlike { .. }) && self.is_exchanged(&now, seen, place)? {
                fault = FrameFault::Exchanged;
            }
            faults.push((seen.remove(place).frame, fault));
            if seen.is_empty() {
                return Err(CalibrateError::no_frames(faults));
            }
            start = now.without_frame(place);
        }
    }

    /// What some frames lead to from the data sheet and with the focus of bands elsewhere, the best first: on which side of the
    /// focus a dot is does not show in its blur, and by the data sheet it may be on the wrong one.
    fn attempts(
        &self,
        start: &Now,
        unknowns: &[Unknown],
        frames: (&[Seen<'_>], &[usize]),
    ) -> Result<Vec<Attempt>, CalibrateError> {
        let mut tried = Vec::new();
        let mut attempts = vec![self.attempt(start.clone(), unknowns, frames, &mut tried)?];
        for steps in focal_steps(unknowns, frames.0.len()).iter().skip(1) {
            let Ok(elsewhere) = start.stepped(unknowns, steps) else { continue };
            attempts.extend(self.attempt(elsewhere, unknowns, frames, &mut tried));
        }
        attempts.sort_by(|a, b| a.adjusted.cost.total_cmp(&b.adjusted.cost));
        Ok(attempts)
    }

    /// The instrument with its focus where an attempt puts it, if that is sound, and the poses of all frames as it sees them.
    fn focused(
        &self,
        look: &FirstLook,
        rank: usize,
        unknowns: &[Unknown],
        seen: &[Seen<'_>],
    ) -> Result<Now, CalibrateError> {
        let best = look.attempts.get(rank).ok_or(UNTRIED)?;
        self.check_sharpness(best, seen)?;
        let is_off_sheet = self.check_data_sheet(&best.start, unknowns, &best.adjusted, SIGMAS_MAX);
        is_off_sheet.map_err(|error| look.fault.clone().map_or(error, CalibrateError::NoFrames))?;
        let now = best.start.moved_to(unknowns, best.adjusted.clone())?;
        let all: Vec<usize> = (0..seen.len()).collect();
        now.adjusted_to(&[], &self.observations(&now, (seen, &all), |_| &ROUGH))
    }

    /// Those of some frames that have no fault as they are seen from the data sheet; if none is left, the fault of the last.
    fn without_faults(
        &self,
        start: &Now,
        unknowns: &[Unknown],
        seen: &[Seen<'_>],
        places: &[usize],
    ) -> Result<(Vec<usize>, Option<FrameFault>), CalibrateError> {
        let mut places = places.to_vec();
        let mut last = None;
        while !places.is_empty() {
            let Attempt { start, observations, adjusted } =
                self.attempt(start.clone(), unknowns, (seen, &places), &mut Vec::new())?;
            let Ok(now) = start.moved_to(unknowns, adjusted) else { return Ok((Vec::new(), None)) };
            let Some((faulty, fault)) = self.worst_fault(&now, (&observations, &places), ROUGH_BLUR) else {
                return Ok((places, None));
            };
            places.retain(|place| *place != faulty);
            last = Some(fault);
        }
        Ok((places, last))
    }

    /// Adjusts to the features of some frames, each dot on that side of the focus where it is found by then; what was tried
    /// is not tried again.
    fn attempt(
        &self,
        mut now: Now,
        unknowns: &[Unknown],
        frames: (&[Seen<'_>], &[usize]),
        tried: &mut Vec<Vec<bool>>,
    ) -> Result<Attempt, CalibrateError> {
        const ROUNDS: usize = 4;
        let mut best: Option<Attempt> = None;
        for _ in 0..ROUNDS {
            let observations = self.observations(&now, frames, |_| &ROUGH);
            let sides: Vec<bool> = observations.iter().map(|observation| observation.anchor.w < 0.0).collect();
            if tried.contains(&sides) {
                break;
            }
            tried.push(sides);
            let adjusted = now.solved(unknowns, &observations, WEIGHING)?;
            let next = now.moved_to(unknowns, adjusted.clone());
            if best.as_ref().is_none_or(|best| adjusted.cost < best.adjusted.cost) {
                best = Some(Attempt { start: now, observations, adjusted });
            }
            let Ok(next) = next else { break };
            now = next;
        }
        best.ok_or(UNTRIED)
    }

    /// Once more, now that it is known which dots the masks cut: the centres of the others are good to hundredths of a pixel,
    /// and radii and blurs to some percent.
    fn closer(
        &self,
        now: &Now,
        reader: &Reconstructor,
        unknowns: &[Unknown],
        seen: &[Seen<'_>],
    ) -> Result<(Now, Vec<Observation>), CalibrateError> {
        let observations = self.close_observations(now, reader, seen);
        Ok((now.adjusted_to(unknowns, &observations)?, observations))
    }

    /// Poses of some frames anew, by their places among those seen, as the instrument sees them by now.
    pub(crate) fn posed(
        &self,
        now: &Now,
        reader: &Reconstructor,
        seen: &[Seen<'_>],
        is_sought: impl Fn(usize) -> bool,
    ) -> Result<Now, CalibrateError> {
        let mut observations = self.close_observations(now, reader, seen);
        observations.retain(|observation| is_sought(observation.frame));
        now.adjusted_to(&[], &observations)
    }

    fn close_observations(&self, now: &Now, reader: &Reconstructor, seen: &[Seen<'_>]) -> Vec<Observation> {
        let is_cut = |(place, one): (usize, &Seen<'_>)| -> Vec<Vec<bool>> {
            self.known_dots(now, one, None, place).iter().map(|dot| reader.is_cut(dot)).collect()
        };
        let is_cut: Vec<Vec<Vec<bool>>> = seen.iter().enumerate().map(is_cut).collect();
        let trust = |(place, band, dot): (usize, usize, usize)| if is_cut[place][dot][band] { &CUT } else { &WHOLE };
        let all: Vec<usize> = (0..seen.len()).collect();
        self.observations(now, (seen, &all), trust)
    }

    fn start(&self, reader: &Reconstructor, unknowns: &[Unknown], seen: &[Seen<'_>], poses: Vec<Pose>) -> Now {
        let dots = Dots {
            position_mm: self.target.dots().iter().map(|dot| dot.position_mm).collect(),
            diameter_mm: self.target.dots().iter().map(|dot| dot.diameter_mm).collect(),
            place_std_mm: self.place_std_mm,
        };
        let stage = seen.iter().map(|one| self.stage.get(one.frame).copied().flatten()).collect();
        let optics = (reader.projections(), reader.lens_terms());
        Now::start(self.instrument.clone(), optics, dots, unknowns, poses, stage)
    }

    /// The telecentric and the entocentric band.
    fn pair(&self) -> [usize; 2] {
        [Role::Telecentric, Role::Entocentric].map(|role| self.instrument.band_index(role))
    }

    /// The pose that the paper's equations give: x and y from the telecentric band, z from the ratio.
    fn first_pose(&self, seen: &Seen<'_>) -> Option<Pose> {
        let bands = self.pair();
        let [telecentric, entocentric] = self.instrument.projections();
        let focus_mm = self.instrument.focus_distance_mm();
        let sight = |(dot, feature): (usize, &Feature)| {
            let other = seen.feature(bands[1], dot)?;
            let [t, e] = [feature, other].map(|feature| self.instrument.sensor.image_from_pixel(feature.centre));
            let m = telecentric.magnification(focus_mm);
            let radii = [t.radius_mm(), e.radius_mm()];
            // Of a lens of one focal length; what is left the adjustment finds.
            let z_mm = entocentric.magnification(focus_mm) / m * focus_mm * radii[0] / radii[1].max(1e-9);
            let target_mm = self.target.dots()[dot].position_mm;
            Some(Sight { target_mm, seen_mm: [t.x_mm / m, t.y_mm / m, z_mm], weight: radii[0] * radii[0] })
        };
        let sights: Vec<Sight> = seen.dots(bands[0]).filter_map(sight).collect();
        let pose = Pose::through(&sights)?;
        (pose.translation_mm.z > 0.0).then_some(pose)
    }

    /// What the features of some frames tell, each as far as it is trusted, by frame, band and dot.
    fn observations(
        &self,
        now: &Now,
        (seen, places): (&[Seen<'_>], &[usize]),
        trust: impl Fn((usize, usize, usize)) -> &'static Trust,
    ) -> Vec<Observation> {
        let problem = now.problem(&[], &[], Weighing::BY_NOISE);
        let state = &now.adjusted.state;
        let mut observations = Vec::new();
        for &place in places {
            let (one, pose) = (&seen[place], &state.poses[place]);
            for band in 0..one.sighting.len() {
                for (dot, feature) in one.dots(band) {
                    let foreseen = problem.image(band, dot, &now.cameras, state, pose);
                    let image = self.image(band, feature, pose, &foreseen);
                    let of = (place, band, dot);
                    let information = trust(of).information(feature, &image);
                    observations.push(Observation::new(of, image, Vector4::zeros(), information));
                }
            }
        }
        observations
    }

    /// u, v, radius and blur of the image of a dot as its feature tells them, px.
    ///
    /// A disc of radius a, blurred over one of radius b, has the light that a straight edge has at `t b` from itself nearer
    /// to its centre by `(1 − t²) b²/6a`, the mean height of its arc over a chord of the blur. So the area where it is half
    /// lit is `π (a² − b²/3)`, and an edge measured from there to t is `1 + t b/6a` times too wide.
    fn image(&self, band: usize, feature: &Feature, pose: &Pose, foreseen: &Vector4<f64>) -> Vector4<f64> {
        const COS_MIN: f64 = 0.2;
        /// About where edges of features are measured.
        const T: f64 = 0.8;
        let PixelPoint { u, v } = on_page(self.instrument, band, feature.centre);
        let half_lit_px = (feature.area_px / std::f64::consts::PI).sqrt();
        let bend = T * feature.edge_px / (6.0 * half_lit_px);
        let blur_px = feature.edge_px * 2.0 / (1.0 + (1.0 + 4.0 * bend).sqrt());
        let area_px2 = half_lit_px * half_lit_px / pose.tilt_rad().cos().max(COS_MIN);
        let radius_px = (area_px2 + blur_px * blur_px / 3.0).sqrt();
        Vector4::new(u, v, radius_px.copysign(foreseen.z), blur_px.copysign(foreseen.w))
    }

    /// The frame of some that fits worst, if it does not fit at all.
    fn worst_fault(
        &self,
        now: &Now,
        (observations, places): (&[Observation], &[usize]),
        blur_share: f64,
    ) -> Option<(usize, FrameFault)> {
        const OFF_PX_MAX: f64 = 3.0;
        const EXTRA_PX_MAX: f64 = 2.0;
        let problem = now.problem(&[], &[], Weighing::BY_NOISE);
        let state = &now.adjusted.state;
        let fault = |place: usize| -> Option<(f64, FrameFault)> {
            let own = || observations.iter().filter(|observation| observation.frame == place);
            let image = |observation: &Observation| {
                problem.image(observation.band, observation.dot, &now.cameras, state, &state.poses[place])
            };
            let off_px = median(own().map(|observation| (image(observation) - observation.anchor).xy().norm()));
            if off_px > OFF_PX_MAX {
                return Some((off_px, FrameFault::Unlike { off_px }));
            }
            // Motion and dirt widen edges in all bands, by squares that add up.
            let extra_px = |band: usize| {
                let own = own().filter(|observation| observation.band == band);
                let square_px2 = median(own.map(|observation| {
                    let foreseen_px2 = image(observation).w.powi(2);
                    let doubtful_px2 = EXTRA_PX_MAX.powi(2) + ((1.0 + blur_share).powi(2) - 1.0) * foreseen_px2;
                    let extra_px2 = observation.anchor.w.powi(2) - foreseen_px2;
                    if extra_px2 > doubtful_px2 { extra_px2 } else { 0.0 }
                }));
                square_px2.sqrt()
            };
            let extra_px = (0..self.instrument.bands.len()).map(extra_px).fold(f64::INFINITY, f64::min);
            let z_mm = state.poses[place].translation_mm.z;
            (extra_px > 0.0).then_some((extra_px, FrameFault::Blurred { extra_px, z_mm }))
        };
        let faults = places.iter().filter_map(|place| Some((*place, fault(*place)?)));
        faults.max_by(|a, b| a.1.0.total_cmp(&b.1.0)).map(|(place, (_, fault))| (place, fault))
    }

    /// Refuses frames all of which are blurred by something else than distance.
    fn check_sharpness(&self, attempt: &Attempt, seen: &[Seen<'_>]) -> Result<(), CalibrateError> {
        let Some(extra_px) = self.added_blur_px(&attempt.start, &attempt.observations) else { return Ok(()) };
        // One frame near the focus may be blurred alone: without it the others do not show that.
        let is_shown_without = |place: usize| {
            let others = attempt.observations.iter().filter(|own| own.frame != place).copied().collect::<Vec<_>>();
            self.added_blur_px(&attempt.start, &others).is_some()
        };
        if seen.len() > 1 && !(0..seen.len()).all(is_shown_without) {
            return Ok(());
        }
        Err(attempt.blurred(extra_px))
    }

    /// What is wrong with frames that lead to a camera which is not that of the data sheet: blur that no distance makes, if
    /// they show that, or what is given.
    pub(crate) fn blur_instead(&self, look: &FirstLook, error: CalibrateError) -> CalibrateError {
        let (CalibrateError::OffDataSheet { .. }, Some(best)) = (&error, look.attempts.first()) else { return error };
        let extra_px = self.added_blur_px(&best.start, &best.observations);
        extra_px.map_or(error, |extra_px| best.blurred(extra_px))
    }

    /// Radius of a blur that no distance makes, which features show where they are sharpest in any band, px; `None` if they
    /// do not show it, or it is that of pixels.
    pub(crate) fn added_blur_px(&self, now: &Now, observations: &[Observation]) -> Option<f64> {
        /// Pixels and the noise of edges add half a pixel.
        const LEAST_PX: f64 = 1.4;
        let problem = now.problem(&[], &[], Weighing::BY_NOISE);
        let state = &now.adjusted.state;
        let edge = |Observation { frame, band, dot, anchor, .. }: &Observation| -> Edge {
            [problem.image(*band, *dot, &now.cameras, state, &state.poses[*frame]).w, anchor.w]
        };
        let of_band = |band: usize| {
            let edges: Vec<Edge> = observations.iter().filter(|own| own.band == band).map(edge).collect();
            added_px(&edges)
        };
        let shown: Vec<f64> = (0..self.instrument.bands.len()).filter_map(of_band).collect();
        shown.into_iter().reduce(f64::min).filter(|added_px| *added_px > LEAST_PX)
    }

    /// Features of one frame, as roughly as they are trusted at first.
    pub(crate) fn rough_observations(&self, now: &Now, seen: &[Seen<'_>], place: usize) -> Vec<Observation> {
        self.observations(now, (seen, &[place]), |_| &ROUGH)
    }

    /// Refuses bands whose roles explain the frames that were asked far better the other way round than the best attempt does.
    fn check_roles(
        &self,
        start: &Now,
        unknowns: &[Unknown],
        (seen, asked): (&[Seen<'_>], &[usize]),
        best: &Attempt,
    ) -> Result<(), CalibrateError> {
        const POOR_CHI2: f64 = 3.0;
        /// If that leads to a camera of the data sheet, and as they are they do not: a facing frame fits either way.
        const BETTER_ON_SHEET: f64 = 1.0;
        let is_on_sheet =
            |attempt: &Attempt| self.check_data_sheet(&attempt.start, unknowns, &attempt.adjusted, SIGMAS_MAX).is_ok();
        if best.typical_chi2(unknowns) < POOR_CHI2 && is_on_sheet(best) {
            return Ok(());
        }
        let exchanged = self.exchanged(seen);
        let poses: Option<Vec<Pose>> = exchanged.iter().map(|one| self.first_pose(one)).collect();
        let Some(poses) = poses else { return Ok(()) };
        let mut other = start.clone();
        other.adjusted.state.poses = poses;
        // Single frames may fit either way where all of them do not.
        let best =
            |start: &Now, seen: &[Seen<'_>]| self.attempts(start, unknowns, (seen, asked)).ok()?.into_iter().next();
        let Some((as_it_is, exchanged)) = best(start, seen).zip(best(&other, &exchanged)) else { return Ok(()) };
        let is_shown_by_sheet = !is_on_sheet(&as_it_is) && is_on_sheet(&exchanged);
        let times = if is_shown_by_sheet { BETTER_ON_SHEET } else { BETTER_EXCHANGED };
        if exchanged.typical_chi2(unknowns) < times * as_it_is.typical_chi2(unknowns) {
            let [telecentric, entocentric] = self.pair().map(|band| self.instrument.bands[band].name.clone());
            return Err(CalibrateError::Swapped { telecentric, entocentric });
        }
        Ok(())
    }

    /// Frames as they would be seen if telecentric and entocentric were the other way round.
    fn exchanged<'a>(&self, seen: &[Seen<'a>]) -> Vec<Seen<'a>> {
        seen.iter().map(|one| one.exchanged(self.pair())).collect()
    }

    /// Whether the camera explains the features of a frame far better with its bands the other way round.
    pub(crate) fn is_exchanged(&self, now: &Now, seen: &[Seen<'_>], place: usize) -> Result<bool, CalibrateError> {
        let exchanged = self.exchanged(seen);
        let Some(pose) = self.first_pose(&exchanged[place]) else { return Ok(false) };
        let mut other = now.clone();
        other.adjusted.state.poses[place] = pose;
        let typical_chi2 = |now: Now, seen: &[Seen<'_>]| {
            let attempt = self.attempt(now, &[], (seen, &[place]), &mut Vec::new())?;
            Ok::<f64, CalibrateError>(attempt.typical_chi2(&[]))
        };
        Ok(typical_chi2(other, &exchanged)? < BETTER_EXCHANGED * typical_chi2(now.clone(), seen)?)
    }

    /// Refuses numbers that no camera of this data sheet has, adjusted from where `now` is.
    pub(crate) fn check_data_sheet(
        &self,
        now: &Now,
        unknowns: &[Unknown],
        adjusted: &Adjusted,
        sigmas_max: f64,
    ) -> Result<(), CalibrateError> {
        let values = &adjusted.state.values;
        let sigmas = |(unknown, value): &(&Unknown, &f64)| ((*value - unknown.expected) / unknown.prior_std).abs();
        let worst = unknowns.iter().zip(values).max_by(|a, b| sigmas(a).total_cmp(&sigmas(b)));
        let Some(worst) = worst.filter(|worst| sigmas(worst) > sigmas_max) else { return Ok(()) };
        let focus_mm = self.instrument.focus_distance_mm();
        let [stated, _] = self.instrument.projections();
        let cameras = now.problem(unknowns, &[], Weighing::BY_NOISE).cameras_of(values);
        let slots = &cameras[self.instrument.band_index(Role::Telecentric)].slots;
        let found = Projection {
            sensor_distance_mm: slots[Slot::SensorDistance as usize],
            focal_length_mm: slots[Slot::FocalLength as usize],
            pupil_position_mm: slots[Slot::PupilPosition as usize],
            ..stated
        };
        let growth = found.magnification(focus_mm) / stated.magnification(focus_mm);
        let pitch_mm = self.target.spec().pitch_mm;
        Err(CalibrateError::OffDataSheet {
            key: worst.0.quantity.key(self.instrument),
            found: *worst.1,
            expected: worst.0.expected,
            sigmas: sigmas(&worst),
            pitch_mm,
            likely_pitch_mm: pitch_mm * growth,
        })
    }
}

impl Trust {
    fn information(&self, feature: &Feature, image: &Vector4<f64>) -> Matrix4<f64> {
        let [std_u_px, std_v_px] = feature.centre_std_px;
        let centre_px = self.centre_px.hypot(std_u_px).hypot(std_v_px);
        let of = |[share, least_px]: [f64; 2], value_px: f64| share * value_px.abs() + least_px;
        let stds_px = [centre_px, centre_px, of(self.radius, image.z), of(self.blur, image.w)];
        Matrix4::from_diagonal(&Vector4::from(stds_px.map(|std_px| std_px.powi(-2))))
    }
}
