//! Where a calibration stands between its steps.

use nalgebra::{DMatrix, DVector};
use twinpupil_instrument::check::ValueError;
use twinpupil_instrument::{Band, Instrument, LensTerms, Projection};

use crate::adjust::{Adjusted, BandCamera, Dots, Observation, Problem, State, Weighing};
use crate::calibrate::CalibrateError;
use crate::camera::cameras;
use crate::pose::Pose;
use crate::stage::{StagePosition, Way};
use crate::unknown::{Quantity, Unknown};

/// χ² of four numbers that half of all exceed.
const MEDIAN_CHI2: f64 = 3.357;

/// Times at most that observations are weighed anew, and the relative change of their misfit that is none.
const MISFIT_ROUNDS: usize = 6;
const MISFIT_RESTING: f64 = 0.03;

const UNSOLVED: CalibrateError = CalibrateError::Undetermined("their equations have no solution");

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
    /// At the data sheet, which makes images by these projections and what the lens adds to them, with rough poses.
    pub(crate) fn start(
        instrument: Instrument,
        (projections, lens): (Vec<Projection>, Vec<LensTerms>),
        dots: Dots,
        unknowns: &[Unknown],
        poses: Vec<Pose>,
        stage: Vec<Option<StagePosition>>,
    ) -> Self {
        let cameras = cameras(&instrument, &projections, &lens, 1.0);
        let state = State {
            values: unknowns.iter().map(|unknown| unknown.expected).collect(),
            way: Way::through(&poses, &stage),
            poses,
            offsets_mm: vec![[0.0; 2]; dots.position_mm.len()],
        };
        let adjusted = Adjusted {
            state,
            covariance: DMatrix::zeros(0, 0),
            pose_covariances: Vec::new(),
            cost: f64::INFINITY,
            misfit: 1.0,
        };
        Self { instrument, projections, lens, cameras, dots, stage, diameter_scale: 1.0, adjusted }
    }

    /// The adjustment of these unknowns, and of the poses, to observations.
    pub(crate) fn problem<'a>(
        &'a self,
        unknowns: &'a [Unknown],
        observations: &'a [Observation],
        weighing: Weighing,
    ) -> Problem<'a> {
        Problem {
            pitch_mm: self.instrument.sensor.pitch_mm,
            cameras: &self.cameras,
            unknowns,
            start: &self.adjusted.state.values,
            dots: &self.dots,
            observations,
            // Poses that are fitted alone are seen by the camera alone.
            stage: if unknowns.is_empty() { &[] } else { &self.stage },
            weighing,
        }
    }

    /// Adjusted to observations, some of which may be wrong: what counts as doubtful, and how much all of them count beside
    /// what is known beforehand, depends on how well they are explained.
    pub(crate) fn adjusted_to(
        &self,
        unknowns: &[Unknown],
        observations: &[Observation],
    ) -> Result<Self, CalibrateError> {
        let mut adjusted = self.solved(unknowns, observations, Weighing::DOUBTING)?;
        for _ in 0..MISFIT_ROUNDS {
            let weighing = self.weighing(unknowns, observations, &adjusted.state);
            if (weighing.misfit / adjusted.misfit - 1.0).abs() < MISFIT_RESTING {
                break;
            }
            let problem = self.problem(unknowns, observations, weighing);
            adjusted = problem.adjust(adjusted.state).ok_or(UNSOLVED)?;
        }
        Ok(self.moved_to(unknowns, adjusted)?)
    }

    /// What observations count for where a state explains them as it does.
    pub(crate) fn weighing(&self, unknowns: &[Unknown], observations: &[Observation], state: &State) -> Weighing {
        let problem = self.problem(unknowns, observations, Weighing::BY_NOISE);
        let typical = (problem.typical_chi2(state) / MEDIAN_CHI2).max(1.0);
        Weighing::of_typical(typical, problem.likeness(state))
    }

    /// Root mean square distance of the places that observations find most likely from where the images are, px.
    pub(crate) fn rms_px(&self, observations: &[Observation]) -> f64 {
        let problem = self.problem(&[], observations, Weighing::BY_NOISE);
        let state = &self.adjusted.state;
        let square = |own: &Observation| {
            let image = problem.image(own.band, own.dot, &self.cameras, state, &state.poses[own.frame]);
            (own.change - (image - own.anchor)).xy().norm_squared()
        };
        (observations.iter().map(square).sum::<f64>() / observations.len().max(1) as f64).sqrt()
    }

    /// What explains observations best.
    pub(crate) fn solved(
        &self,
        unknowns: &[Unknown],
        observations: &[Observation],
        weighing: Weighing,
    ) -> Result<Adjusted, CalibrateError> {
        let problem = self.problem(unknowns, observations, weighing);
        problem.adjust(self.adjusted.state.clone()).ok_or(UNSOLVED)
    }

    /// The instrument that the adjusted unknowns make.
    pub(crate) fn moved_to(&self, unknowns: &[Unknown], adjusted: Adjusted) -> Result<Self, ValueError> {
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

    /// With the unknowns moved by so many of their deviations.
    pub(crate) fn stepped(&self, unknowns: &[Unknown], sigmas: &[f64]) -> Result<Self, ValueError> {
        let mut adjusted = self.adjusted.clone();
        for ((value, unknown), sigmas) in adjusted.state.values.iter_mut().zip(unknowns).zip(sigmas) {
            *value += sigmas * unknown.prior_std;
        }
        self.moved_to(unknowns, adjusted)
    }

    /// Where others are sought than before.
    pub(crate) fn seeking(&self, unknowns: &[Unknown]) -> Self {
        let value = |unknown: &Unknown| match unknown.quantity {
            Quantity::Instrument(parameter) => parameter.value(&self.instrument),
            Quantity::DotDiameter => self.diameter_scale,
        };
        let mut next = self.clone();
        next.adjusted.state.values = unknowns.iter().map(value).collect();
        next
    }

    /// Without one of the frames.
    pub(crate) fn without_frame(mut self, place: usize) -> Self {
        self.stage.remove(place);
        self.adjusted.state.poses.remove(place);
        self.adjusted.state.way = Way::through(&self.adjusted.state.poses, &self.stage);
        self
    }

    /// Takes the bands' projections from the optics, and what the lens adds to them.
    pub(crate) fn see_through(&mut self, projections: Vec<Projection>, lens: Vec<LensTerms>) {
        self.cameras = cameras(&self.instrument, &projections, &lens, self.diameter_scale);
        self.lens = lens;
        self.projections = projections;
    }

    /// The change of the unknowns since `before`, in the deviations of what changed most, be it a number or many together; of
    /// the poses, one by one, if nothing else is sought.
    pub(crate) fn moved_sigmas(&self, before: &Self, unknowns: &[Unknown]) -> f64 {
        let (after, before) = (&self.adjusted, &before.adjusted);
        if unknowns.is_empty() {
            let poses = after.state.poses.iter().zip(&before.state.poses).zip(&after.pose_covariances);
            let sigmas = poses.flat_map(|((after, before), covariance)| {
                let moved_mm = after.translation_mm - before.translation_mm;
                (0..3).map(move |k| moved_mm[k].abs() / covariance[(3 + k, 3 + k)].sqrt())
            });
            return sigmas.fold(0.0, f64::max);
        }
        let values = after.state.values.iter().zip(&before.state.values).zip(unknowns);
        let steps = values.map(|((value, before), unknown)| (value - before) / unknown.prior_std);
        let step = DVector::from_iterator(unknowns.len(), steps);
        let size = (unknowns.len(), unknowns.len());
        let factor = after.covariance.view((0, 0), size).into_owned().cholesky();
        // Without one some are known as good as exactly: that is not at rest.
        factor.map_or(f64::INFINITY, |factor| step.dot(&factor.solve(&step)).max(0.0).sqrt())
    }
}
