//! From frames of a target to the instrument that took them.

use std::error::Error;

use nalgebra::{DMatrix, Matrix4, Vector4};
use rayon::prelude::*;
use thiserror::Error;
use twinpupil_instrument::check::ValueError;
use twinpupil_instrument::{Band, Frame, Instrument, LensTerms, PixelPoint, Projection, Role};
use twinpupil_reconstruct::{Detection, KnownDot, KnownLight, Polarity, Reconstructor, SpotScore};

use crate::adjust::{Adjusted, BandCamera, Dots, Observation, Problem, State};
use crate::camera::cameras;
use crate::forward::Slot;
use crate::lattice::{Spot, median};
use crate::pose::{Pose, Sight};
use crate::result::{Calibration, Conclusion};
use crate::sighting::{Sighting, SightingError, recognise};
use crate::stage::{StagePosition, Way};
use crate::target::Target;
use crate::unknown::{Choices, Quantity, Unknown, UnknownKey};

/// What went wrong outside of this crate.
pub type Foreign = Box<dyn Error + Send + Sync>;

/// Frames that tell nothing of the instrument, or something that it cannot be.
#[derive(Debug, Error)]
pub enum CalibrateError {
    /// A choice that is none.
    #[error(transparent)]
    UnknownKey(#[from] UnknownKey),
    /// A frame that cannot be read, or an instrument that cannot be traced.
    #[error(transparent)]
    Foreign(Foreign),
    /// No frame shows the target.
    #[error("no frame can be used: {0}")]
    NoFrames(FrameFault),
    /// Telecentric and entocentric are the other way round.
    #[error(
        "the bands are swapped: `{telecentric}` is said to be telecentric, but its image changes with distance and that of \
         `{entocentric}` does not; legal: the other way round"
    )]
    Swapped {
        /// The band that is said to be telecentric.
        telecentric: String,
        /// The band that is said to be entocentric.
        entocentric: String,
    },
    /// A number too far from what the data sheet says.
    #[error(
        "`{key}` would be {found:.6}, {sigmas:.1} tolerances from the {expected} that the instrument file says; is the \
         target's pitch_mm = {pitch_mm} right? A pitch of {likely_pitch_mm:.4} would fit the data sheet"
    )]
    OffDataSheet {
        /// Its key.
        key: String,
        /// What it would be.
        found: f64,
        /// What the instrument file says.
        expected: f64,
        /// How far they are apart, in tolerances.
        sigmas: f64,
        /// The pitch of the target file, mm.
        pitch_mm: f64,
        /// The pitch at which the telecentric magnification is that of the data sheet, mm.
        likely_pitch_mm: f64,
    },
    /// An instrument that is none.
    #[error("the frames lead to an instrument that is none: {0}")]
    NoInstrument(#[from] ValueError),
    /// Equations without a solution.
    #[error("the frames do not determine the instrument: {0}")]
    Undetermined(&'static str),
}

/// Why a frame is left out.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum FrameFault {
    /// The target is not recognised.
    #[error(transparent)]
    Sighting(#[from] SightingError),
    /// Its dots lie on one line, or nowhere in space.
    #[error("the dots that both bands show do not lie on a plane before the camera")]
    NoPose,
    /// Edges wider than any distance makes them.
    #[error(
        "the frame is blurred: edges in all bands are {extra_px:.1} px wider than the target's distance of {z_mm:.0} mm \
         makes them"
    )]
    Blurred {
        /// Radius of the blur that is added, px.
        extra_px: f64,
        /// Distance of the target, mm.
        z_mm: f64,
    },
    /// Another pose or another target: nothing fits.
    #[error("the dots lie {off_px:.1} px beside where one camera could see them")]
    Unlike {
        /// Root mean square distance, px.
        off_px: f64,
    },
}

/// A step of a calibration, for whoever watches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Frames are searched for the target.
    Finding,
    /// Frames are compared with the forward model, for the n-th time.
    Comparing(usize),
}

/// What a camera is calibrated from.
pub struct Calibrator<'a> {
    /// The data sheet.
    pub instrument: &'a Instrument,
    /// The target.
    pub target: &'a Target,
    /// What is sought.
    pub choices: &'a Choices,
    /// Standard deviation of the places of the target's dots, mm, if they are sought too.
    pub place_std_mm: Option<f64>,
    /// Where a stage says that the target stood, frame by frame; empty if nothing does.
    pub stage: &'a [Option<StagePosition>],
    /// Makes an instrument ready to read frames, whatever the mode.
    pub reader: &'a (dyn Fn(&Instrument) -> Result<Reconstructor, Foreign> + Sync),
    /// Reads a frame.
    pub frame: &'a (dyn Fn(usize) -> Result<Frame, Foreign> + Sync),
    /// Is told of every frame that is done with.
    pub progress: &'a (dyn Fn(Stage) + Sync),
}

/// A frame on which the target is recognised.
#[derive(Debug, Clone)]
pub(crate) struct Seen {
    pub(crate) frame: usize,
    pub(crate) sighting: Sighting,
    /// What every band shows, in pixels of its page.
    spots: Vec<Vec<Spot>>,
    /// Radii of their blur, px; contrasts and ground, codes; deviations of their centres, px.
    edges_px: Vec<Vec<f64>>,
    contrasts: Vec<Vec<f64>>,
    grounds: Vec<Vec<f64>>,
    stds_px: Vec<Vec<f64>>,
}

/// What a spot's pixels come to, beside its score.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Fitness {
    pub(crate) chi2: f64,
    pub(crate) used_px: usize,
}

/// A frame's index and why it is left out.
pub type Fault = (usize, FrameFault);

/// Times that frames are compared at most, and the change of the unknowns in their deviations that is none.
const COMPARISONS: usize = 8;
const RESTING_SIGMAS: f64 = 0.05;

/// χ² of one spot's four numbers beyond which it is doubted, over that of the typical spot.
const DOUBT: f64 = 20.0;

/// χ² of four numbers that half of all exceed.
const MEDIAN_CHI2: f64 = 3.357;

impl Calibrator<'_> {
    /// Calibrates from so many frames.
    pub fn calibrate(&self, frames: usize) -> Result<Calibration, CalibrateError> {
        let unknowns = self.choices.unknowns(self.instrument)?;
        let reader = (self.reader)(self.instrument).map_err(CalibrateError::Foreign)?;
        let (mut seen, mut faults) = self.find(&reader, frames)?;
        let mut now = self.first(&reader, &unknowns, &mut seen, &mut faults)?;
        let mut comparison = self.compare(&mut now, &seen, &[], 0)?;
        for round in 1..=COMPARISONS {
            let next = self.adjust(&now, &unknowns, &comparison.observations, None)?;
            let moved = next.moved_sigmas(&now, &unknowns);
            now = next;
            if moved < RESTING_SIGMAS || round == COMPARISONS {
                break;
            }
            comparison = self.compare(&mut now, &seen, &comparison.lights, round)?;
        }
        self.check_data_sheet(&now, &unknowns, &now.adjusted, SIGMAS_MAX)?;
        Calibration::conclude(Conclusion {
            calibrator: self,
            unknowns: &unknowns,
            now: &now,
            seen: &seen,
            faults,
            observations: &comparison.observations,
            fitness: &comparison.fitness,
        })
    }

    /// Searches all frames for the target.
    fn find(&self, reader: &Reconstructor, frames: usize) -> Result<(Vec<Seen>, Vec<Fault>), CalibrateError> {
        let one = |frame: usize| -> Result<Result<Seen, SightingError>, Foreign> {
            let image = (self.frame)(frame)?;
            let detect = |index: usize| reader.detect_band(&image, index);
            let detections = (0..self.instrument.bands.len()).map(detect).collect::<Result<Vec<_>, _>>()?;
            let seen = self.see(frame, &detections);
            (self.progress)(Stage::Finding);
            Ok(seen)
        };
        let all = (0..frames).into_par_iter().map(one).collect::<Result<Vec<_>, _>>();
        let (mut seen, mut faults) = (Vec::new(), Vec::new());
        for (frame, result) in all.map_err(CalibrateError::Foreign)?.into_iter().enumerate() {
            match result {
                Ok(one) => seen.push(one),
                Err(error) => faults.push((frame, FrameFault::from(error))),
            }
        }
        if seen.is_empty() {
            return Err(no_frames(&faults));
        }
        Ok((seen, faults))
    }

    /// Recognises the target among the features of a frame.
    fn see(&self, frame: usize, detections: &[Detection]) -> Result<Seen, SightingError> {
        let bands = &self.instrument.bands;
        let features = |detection: &Detection| -> Vec<_> {
            detection.features.iter().copied().filter(|feature| !feature.saturated).collect()
        };
        let features: Vec<_> = detections.iter().map(features).collect();
        let on_page = |band: usize, centre: PixelPoint| {
            let image = self.instrument.sensor.image_from_pixel(centre);
            let page = self.instrument.page(&bands[band]).to_page(image);
            [page.u, page.v]
        };
        // Bands are told apart and laid over each other where both have their axis.
        let spots = |place: &dyn Fn(usize, PixelPoint) -> [f64; 2]| -> Vec<Vec<Spot>> {
            let of_band = |(band, features): (usize, &Vec<twinpupil_reconstruct::Feature>)| {
                let spot = |feature: &twinpupil_reconstruct::Feature| Spot {
                    centre_px: place(band, feature.centre),
                    area_px: feature.area_px,
                };
                features.iter().map(spot).collect()
            };
            features.iter().enumerate().map(of_band).collect()
        };
        let upright = spots(&|_, centre| [centre.u, centre.v]);
        let named: Vec<(&str, Vec<Spot>)> = bands.iter().map(|band| band.name.as_str()).zip(upright).collect();
        let sighting = recognise(self.target, &named, self.instrument.sensor.axis_px)?;
        let of_features = |value: &dyn Fn(usize, &twinpupil_reconstruct::Feature) -> f64| -> Vec<Vec<f64>> {
            let of_band = |(band, features): (usize, &Vec<twinpupil_reconstruct::Feature>)| {
                features.iter().map(|feature| value(band, feature)).collect()
            };
            features.iter().enumerate().map(of_band).collect()
        };
        let sign = |band: usize| if detections[band].polarity == Polarity::Dark { -1.0 } else { 1.0 };
        Ok(Seen {
            frame,
            sighting,
            spots: spots(&on_page),
            edges_px: of_features(&|_, feature| feature.edge_px),
            contrasts: of_features(&|band, feature| sign(band) * feature.height_codes),
            grounds: of_features(&|_, feature| feature.ground_codes),
            stds_px: of_features(&|_, feature| feature.centre_std_px[0].hypot(feature.centre_std_px[1])),
        })
    }

    /// Poses and instrument as the features alone tell them, without frames that do not fit.
    fn first(
        &self,
        reader: &Reconstructor,
        unknowns: &[Unknown],
        seen: &mut Vec<Seen>,
        faults: &mut Vec<Fault>,
    ) -> Result<Now, CalibrateError> {
        let mut poses = Vec::new();
        let bands = self.pair();
        seen.retain(|one| match self.first_pose(one, bands) {
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
            return Err(no_frames(faults));
        }
        loop {
            let stage = seen.iter().map(|one| self.stage.get(one.frame).copied().flatten()).collect();
            let start = Now::start(self, reader, unknowns, poses.clone(), stage);
            let cameras = &start.cameras;
            let observations = |seen: &[Seen]| -> Vec<Observation> {
                let state = &start.adjusted.state;
                let of_frame =
                    |(place, one): (usize, &Seen)| self.rough(&start, one, place, cameras, &state.poses[place]);
                seen.iter().enumerate().flat_map(of_frame).collect()
            };
            let observations = observations(seen);
            let adjusted = self.solve(&start, unknowns, &observations, Some(ROUGH_DOUBT_CHI2))?;
            self.check_roles(&start, unknowns, seen, (&observations, &adjusted))?;
            self.check_data_sheet(&start, unknowns, &adjusted, ROUGH_SIGMAS_MAX)?;
            let now = start.moved_to(unknowns, adjusted)?;
            let Some((place, fault)) = self.worst_fault(&now, seen, &observations) else { return Ok(now) };
            faults.push((seen.remove(place).frame, fault));
            poses.remove(place);
            if seen.is_empty() {
                return Err(no_frames(faults));
            }
        }
    }

    /// The telecentric and the entocentric band.
    fn pair(&self) -> [usize; 2] {
        [Role::Telecentric, Role::Entocentric].map(|role| self.instrument.band_index(role))
    }

    /// The pose that the paper's equations give: x and y from the telecentric one of two bands, z from the ratio.
    fn first_pose(&self, seen: &Seen, bands: [usize; 2]) -> Option<Pose> {
        let [telecentric, entocentric] = self.instrument.projections();
        let focus_mm = self.instrument.focus_distance_mm();
        let image_mm = |band: usize, feature: usize| {
            let [u, v] = seen.spots[band][feature].centre_px;
            self.instrument.page(&self.instrument.bands[band]).to_image(PixelPoint { u, v })
        };
        let sight = |(dot, feature): &(usize, usize)| {
            let own = &seen.sighting[bands[1]];
            let other = own.binary_search_by_key(dot, |(dot, _)| *dot).ok()?;
            let [t, e] = [image_mm(bands[0], *feature), image_mm(bands[1], own[other].1)];
            let m = telecentric.magnification(focus_mm);
            let radii = [t.radius_mm(), e.radius_mm()];
            // Of a lens of one focal length; what is left the adjustment finds.
            let z_mm = entocentric.magnification(focus_mm) / m * focus_mm * radii[0] / radii[1].max(1e-9);
            let target_mm = self.target.dots()[*dot].position_mm;
            Some(Sight { target_mm, seen_mm: [t.x_mm / m, t.y_mm / m, z_mm], weight: radii[0] * radii[0] })
        };
        let sights: Vec<Sight> = seen.sighting[bands[0]].iter().filter_map(sight).collect();
        let pose = Pose::through(&sights)?;
        (pose.translation_mm.z > 0.0).then_some(pose)
    }

    /// What the features of a frame tell: centres well, size and blur roughly.
    fn rough(&self, now: &Now, seen: &Seen, place: usize, cameras: &[BandCamera], pose: &Pose) -> Vec<Observation> {
        const CENTRE_PX: f64 = 0.1;
        const SIZE: f64 = 0.02;
        const BLUR_PX: f64 = 0.7;
        const BLUR: f64 = 0.1;
        let problem = now.problem(self, &[], &[], 1.0);
        let mut observations = Vec::new();
        for (band, labelled) in seen.sighting.iter().enumerate() {
            for (dot, feature) in labelled {
                let foreseen = problem.image(band, *dot, cameras, &now.adjusted.state, pose);
                let Spot { centre_px: [u, v], area_px } = seen.spots[band][*feature];
                let radius_px = (area_px / std::f64::consts::PI / pose.tilt_rad().cos().max(0.2)).sqrt();
                let edge_px = seen.edges_px[band][*feature];
                let stds = [
                    CENTRE_PX.hypot(seen.stds_px[band][*feature]),
                    CENTRE_PX.hypot(seen.stds_px[band][*feature]),
                    SIZE * radius_px + 1.0,
                    BLUR_PX + BLUR * edge_px,
                ];
                observations.push(Observation {
                    frame: place,
                    band,
                    dot: *dot,
                    anchor: Vector4::new(u, v, radius_px * foreseen.z.signum(), edge_px.copysign(foreseen.w)),
                    score: Vector4::zeros(),
                    information: Matrix4::from_diagonal(&Vector4::from(stds.map(|std| std.powi(-2)))),
                });
            }
        }
        observations
    }

    /// The frame that fits worst, if it does not fit at all.
    fn worst_fault(&self, now: &Now, seen: &[Seen], observations: &[Observation]) -> Option<(usize, FrameFault)> {
        const OFF_PX_MAX: f64 = 3.0;
        const EXTRA_PX_MAX: f64 = 2.0;
        const EXTRA_SHARE_MAX: f64 = 0.35;
        let problem = now.problem(self, &[], &[], 1.0);
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
            // Motion and dirt widen edges in all bands.
            let extra_px = |band: usize| {
                let own = own().filter(|observation| observation.band == band);
                median(own.map(|observation| {
                    let (seen_px, foreseen_px) = (observation.anchor.w.abs(), image(observation).w.abs());
                    let excess_px = seen_px - foreseen_px - EXTRA_SHARE_MAX * foreseen_px;
                    if excess_px > EXTRA_PX_MAX { (seen_px.powi(2) - foreseen_px.powi(2)).sqrt() } else { 0.0 }
                }))
            };
            let extra_px = (0..seen[place].sighting.len()).map(extra_px).fold(f64::INFINITY, f64::min);
            let z_mm = state.poses[place].translation_mm.z;
            (extra_px > 0.0).then_some((extra_px, FrameFault::Blurred { extra_px, z_mm }))
        };
        let faults = (0..seen.len()).filter_map(|place| Some((place, fault(place)?)));
        faults.max_by(|a, b| a.1.0.total_cmp(&b.1.0)).map(|(place, (_, fault))| (place, fault))
    }

    /// Refuses bands whose roles explain the frames far better the other way round.
    fn check_roles(
        &self,
        start: &Now,
        unknowns: &[Unknown],
        seen: &[Seen],
        (observations, adjusted): (&[Observation], &Adjusted),
    ) -> Result<(), CalibrateError> {
        const POOR_CHI2: f64 = 8.0;
        const BETTER: f64 = 0.2;
        if adjusted.cost < POOR_CHI2 * observations.len() as f64 {
            return Ok(());
        }
        let [telecentric, entocentric] = self.pair();
        let poses: Option<Vec<Pose>> =
            seen.iter().map(|one| self.first_pose(one, [entocentric, telecentric])).collect();
        let Some(poses) = poses else { return Ok(()) };
        let swapped: Vec<Observation> = observations
            .iter()
            .map(|observation| {
                let band = match observation.band {
                    band if band == telecentric => entocentric,
                    band if band == entocentric => telecentric,
                    band => band,
                };
                // Blur tells nothing of masks that are others.
                let mut information = observation.information;
                information[(3, 3)] = 0.0;
                Observation { band, information, ..*observation }
            })
            .collect();
        let mut start = start.clone();
        start.adjusted.state.poses = poses;
        let Ok(other) = self.solve(&start, unknowns, &swapped, Some(ROUGH_DOUBT_CHI2)) else { return Ok(()) };
        if other.cost < BETTER * adjusted.cost {
            let [telecentric, entocentric] =
                [telecentric, entocentric].map(|band| self.instrument.bands[band].name.clone());
            return Err(CalibrateError::Swapped { telecentric, entocentric });
        }
        Ok(())
    }

    /// Refuses numbers that no camera of this data sheet has, adjusted from where `now` is.
    fn check_data_sheet(
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
        let cameras = now.problem(self, unknowns, &[], 1.0).cameras_of(values);
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

    /// Compares all frames with the forward model of an instrument; `lights` are those of the comparison before.
    fn compare(
        &self,
        now: &mut Now,
        seen: &[Seen],
        lights: &[Lights],
        round: usize,
    ) -> Result<Comparison, CalibrateError> {
        let reader = (self.reader)(&now.instrument).map_err(CalibrateError::Foreign)?;
        now.see_through(reader.projections(), reader.lens_terms());
        let now = &*now;
        let problem = now.problem(self, &[], &[], 1.0);
        let one = |(place, one): (usize, &Seen)| -> Result<Compared, Foreign> {
            let frame = (self.frame)(one.frame)?;
            let state = &now.adjusted.state;
            let dots = self.known_dots(now, one, lights.get(place), place);
            let scores = reader.scores(&frame, &dots)?;
            let mut compared = Compared::default();
            for (band, labelled) in one.sighting.iter().enumerate() {
                for (dot, _) in labelled {
                    let Some(score) = scores[*dot][band] else { continue };
                    let observation = Observation {
                        frame: place,
                        band,
                        dot: *dot,
                        anchor: problem.image(band, *dot, &now.cameras, state, &state.poses[place]),
                        score: score.score,
                        information: score.information,
                    };
                    if let Some(observation) = observation.with_model_error(score.is_cut) {
                        compared.observations.push(observation);
                        compared.fitness.push(Fitness { chi2: score.chi2, used_px: score.used_px });
                    }
                }
            }
            let light = |score: &Option<SpotScore>| score.map(|score| score.light);
            compared.lights = scores.iter().map(|bands| bands.iter().map(light).collect()).collect();
            (self.progress)(Stage::Comparing(round));
            Ok(compared)
        };
        let all = seen.par_iter().enumerate().map(one).collect::<Result<Vec<_>, _>>();
        let mut comparison = Comparison::default();
        for compared in all.map_err(CalibrateError::Foreign)? {
            comparison.observations.extend(compared.observations);
            comparison.fitness.extend(compared.fitness);
            comparison.lights.push(compared.lights);
        }
        Ok(comparison)
    }

    /// All dots of the target as they stand in a frame; those that a band does not show are at most neighbours there.
    fn known_dots(&self, now: &Now, seen: &Seen, lights: Option<&Lights>, place: usize) -> Vec<KnownDot> {
        let state = &now.adjusted.state;
        let slopes = state.poses[place].slopes();
        let of_all =
            |values: &[Vec<f64>]| -> Vec<f64> { values.iter().map(|values| median(values.iter().copied())).collect() };
        let (contrasts, grounds) = (of_all(&seen.contrasts), of_all(&seen.grounds));
        let dot = |(index, dot): (usize, &crate::target::TargetDot)| {
            let light = |band: usize| {
                if let Some(fitted) = lights.and_then(|lights| lights[index][band]) {
                    return Some(fitted);
                }
                let labelled = &seen.sighting[band];
                let own = labelled.binary_search_by_key(&index, |(dot, _)| *dot).ok().map(|own| labelled[own].1);
                Some(KnownLight {
                    contrast_codes: own.map_or(contrasts[band], |own| seen.contrasts[band][own]),
                    ground_codes: own.map_or(grounds[band], |own| seen.grounds[band][own]),
                    is_fitted: false,
                })
            };
            KnownDot {
                centre_mm: state.dot_mm(&now.dots, place, index).into(),
                slopes,
                diameter_mm: dot.diameter_mm * now.diameter_scale,
                lights: (0..seen.sighting.len()).map(light).collect(),
            }
        };
        self.target.dots().iter().enumerate().map(dot).collect()
    }

    /// Adjusts everything to the observations, from where it is now.
    pub(crate) fn adjust(
        &self,
        now: &Now,
        unknowns: &[Unknown],
        observations: &[Observation],
        doubt_chi2: Option<f64>,
    ) -> Result<Now, CalibrateError> {
        let adjusted = self.solve(now, unknowns, observations, doubt_chi2)?;
        Ok(now.moved_to(unknowns, adjusted)?)
    }

    fn solve(
        &self,
        now: &Now,
        unknowns: &[Unknown],
        observations: &[Observation],
        doubt_chi2: Option<f64>,
    ) -> Result<Adjusted, CalibrateError> {
        let state = now.adjusted.state.clone();
        let typical = |adjusted: &Adjusted, problem: &Problem<'_>| {
            let state = &adjusted.state;
            let cameras = problem.cameras_of(&state.values);
            let chi2 = |observation: &Observation| {
                let pose = &state.poses[observation.frame];
                observation.chi2(&problem.image(observation.band, observation.dot, &cameras, state, pose))
            };
            (median(observations.iter().map(chi2)) / MEDIAN_CHI2).max(1.0)
        };
        let failed = || CalibrateError::Undetermined("their equations have no solution");
        let mut adjusted =
            now.problem(self, unknowns, observations, doubt_chi2.unwrap_or(DOUBT)).adjust(state).ok_or_else(failed)?;
        if doubt_chi2.is_none() {
            // What counts as doubtful depends on how well the rest is explained.
            let scale = typical(&adjusted, &now.problem(self, unknowns, observations, DOUBT));
            if scale > 1.0 {
                let problem = now.problem(self, unknowns, observations, DOUBT * scale);
                adjusted = problem.adjust(adjusted.state).ok_or_else(failed)?;
            }
        }
        Ok(adjusted)
    }
}

/// Tolerances from the data sheet beyond which a number is refused: at first, from features alone, and at last.
const ROUGH_SIGMAS_MAX: f64 = 6.0;
const SIGMAS_MAX: f64 = 4.0;

/// χ² of a feature's numbers beyond which it is doubted: their deviations are rough.
const ROUGH_DOUBT_CHI2: f64 = 25.0;

/// The light of every dot of the target in every band, as a frame shows it.
type Lights = Vec<Vec<Option<KnownLight>>>;

/// What the comparison of all frames comes to; lights frame by frame.
#[derive(Default)]
struct Comparison {
    observations: Vec<Observation>,
    fitness: Vec<Fitness>,
    lights: Vec<Lights>,
}

/// The same of one frame.
#[derive(Default)]
struct Compared {
    observations: Vec<Observation>,
    fitness: Vec<Fitness>,
    lights: Lights,
}

fn no_frames(faults: &[Fault]) -> CalibrateError {
    match faults.first() {
        Some((_, fault)) => CalibrateError::NoFrames(fault.clone()),
        None => CalibrateError::Undetermined("there are none"),
    }
}

/// Where the calibration stands.
#[derive(Debug, Clone)]
pub(crate) struct Now {
    pub(crate) instrument: Instrument,
    pub(crate) projections: Vec<Projection>,
    /// What the lens adds to them, band by band.
    pub(crate) lens: Vec<LensTerms>,
    pub(crate) cameras: Vec<BandCamera>,
    pub(crate) dots: Dots,
    /// Of every frame that is used.
    pub(crate) stage: Vec<Option<StagePosition>>,
    pub(crate) diameter_scale: f64,
    pub(crate) adjusted: Adjusted,
}

impl Now {
    fn start(
        calibrator: &Calibrator<'_>,
        reader: &Reconstructor,
        unknowns: &[Unknown],
        poses: Vec<Pose>,
        stage: Vec<Option<StagePosition>>,
    ) -> Self {
        let instrument = calibrator.instrument.clone();
        let projections = reader.projections();
        let lens = reader.lens_terms();
        let cameras = cameras(&instrument, &projections, &lens, 1.0);
        let dots = Dots {
            position_mm: calibrator.target.dots().iter().map(|dot| dot.position_mm).collect(),
            diameter_mm: calibrator.target.dots().iter().map(|dot| dot.diameter_mm).collect(),
            place_std_mm: calibrator.place_std_mm,
        };
        let state = State {
            values: unknowns.iter().map(|unknown| unknown.expected).collect(),
            way: Way::through(&poses, &stage),
            poses,
            offsets_mm: vec![[0.0; 2]; dots.position_mm.len()],
        };
        let adjusted =
            Adjusted { state, covariance: DMatrix::zeros(0, 0), pose_covariances: Vec::new(), cost: f64::INFINITY };
        Self { instrument, projections, lens, cameras, dots, stage, diameter_scale: 1.0, adjusted }
    }

    pub(crate) fn problem<'a>(
        &'a self,
        calibrator: &Calibrator<'_>,
        unknowns: &'a [Unknown],
        observations: &'a [Observation],
        doubt_chi2: f64,
    ) -> Problem<'a> {
        Problem {
            pitch_mm: calibrator.instrument.sensor.pitch_mm,
            cameras: &self.cameras,
            unknowns,
            start: &self.adjusted.state.values,
            dots: &self.dots,
            observations,
            // Poses that are fitted alone are seen by the camera alone.
            stage: if unknowns.is_empty() { &[] } else { &self.stage },
            doubt_chi2,
        }
    }

    /// The instrument that the adjusted unknowns make.
    fn moved_to(&self, unknowns: &[Unknown], adjusted: Adjusted) -> Result<Self, ValueError> {
        let mut spec = self.instrument.clone().into_spec();
        let mut diameter_scale = self.diameter_scale;
        for (unknown, value) in unknowns.iter().zip(&adjusted.state.values) {
            match unknown.quantity {
                Quantity::Instrument(parameter) => parameter.set(&mut spec, *value),
                Quantity::DotDiameter => diameter_scale = *value,
            }
        }
        let instrument = Instrument::new(spec)?;
        // Until it is traced anew, a real lens has its focal lengths in the proportions that it had.
        let projection = |(band, before): (&Band, &Projection)| {
            let [stated, stated_before] =
                [&instrument, &self.instrument].map(|instrument| instrument.projection(band).focal_length_mm);
            let focal_length_mm = before.focal_length_mm / stated_before * stated;
            Projection { focal_length_mm, ..instrument.projection(band) }
        };
        let projections = instrument.bands.iter().zip(&self.projections).map(projection).collect();
        let mut next = Self {
            instrument,
            projections: Vec::new(),
            lens: Vec::new(),
            cameras: Vec::new(),
            dots: self.dots.clone(),
            stage: self.stage.clone(),
            diameter_scale,
            adjusted,
        };
        next.see_through(projections, self.lens.clone());
        Ok(next)
    }

    /// Takes the bands' projections from the optics.
    fn see_through(&mut self, projections: Vec<Projection>, lens: Vec<LensTerms>) {
        self.cameras = cameras(&self.instrument, &projections, &lens, self.diameter_scale);
        self.lens = lens;
        self.projections = projections;
    }

    /// The largest change of an unknown since `before`, in its deviations.
    fn moved_sigmas(&self, before: &Self, unknowns: &[Unknown]) -> f64 {
        let values = self.adjusted.state.values.iter().zip(&before.adjusted.state.values);
        let sigmas = values.zip(unknowns).enumerate().map(|(k, ((after, before), unknown))| {
            (after - before).abs() / (unknown.prior_std * self.adjusted.covariance[(k, k)].sqrt())
        });
        sigmas.fold(0.0, f64::max)
    }
}
