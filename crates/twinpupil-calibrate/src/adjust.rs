//! Bundle adjustment: camera, target and all poses at once, by Levenberg and Marquardt's method on an arrow-head matrix.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix4, Matrix6, SMatrix, Vector3, Vector4, Vector6};
use rayon::prelude::*;
use twinpupil_instrument::{Correction, Displacement, LensTerms};
use twinpupil_reconstruct::SpotScore;

use crate::forward::{CAMERA_SLOTS, SLOTS, Slot, Slots, View, ideal_mm, image, spot};
use crate::lattice::median;
use crate::pose::Pose;
use crate::stage::{StagePosition, WAY_SIZE, Way, WayGradient};
use crate::unknown::{Part, Unknown};

/// What one band of one frame says of one dot's image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Observation {
    pub(crate) frame: usize,
    pub(crate) band: usize,
    pub(crate) dot: usize,
    /// Where the image was when it was looked at: u, v, radius and blur, px.
    pub(crate) anchor: Vector4<f64>,
    /// What it says of a change from there: `score·Δ − ½ Δ·information Δ` is the log-likelihood.
    pub(crate) score: Vector4<f64>,
    pub(crate) information: Matrix4<f64>,
    /// From the anchor to the image that it finds most likely, and twice the log-likelihood that this gains.
    pub(crate) change: Vector4<f64>,
    gain: f64,
}

/// A camera's band, before any unknown is moved.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BandCamera {
    /// The values of the slots that are the camera's.
    pub(crate) slots: [f64; CAMERA_SLOTS],
    pub(crate) page_from_reference: [[f64; 3]; 3],
    /// What a real lens adds.
    pub(crate) lens: LensTerms,
    correction: Option<Correction>,
    /// The same, ready to be evaluated.
    pub(crate) displacement: Option<Displacement>,
}

/// The dots of the target, and how well their places are known.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Dots {
    pub(crate) position_mm: Vec<[f64; 2]>,
    pub(crate) diameter_mm: Vec<f64>,
    /// Standard deviation of both coordinates of every dot, mm; `None` if they are held fast.
    pub(crate) place_std_mm: Option<f64>,
}

/// Everything that is adjusted to each other.
#[derive(Debug, Clone)]
pub(crate) struct Problem<'a> {
    pub(crate) pitch_mm: f64,
    pub(crate) cameras: &'a [BandCamera],
    pub(crate) unknowns: &'a [Unknown],
    /// Values of the unknowns for which the cameras are as they are.
    pub(crate) start: &'a [f64],
    pub(crate) dots: &'a Dots,
    /// Ordered by frame.
    pub(crate) observations: &'a [Observation],
    /// Where a stage says that the target stood, frame by frame; empty if there is none.
    pub(crate) stage: &'a [Option<StagePosition>],
    pub(crate) weighing: Weighing,
}

/// What observations count for beside what is known beforehand, and beside each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Weighing {
    /// χ² of an observation beyond which it is doubted.
    pub(crate) doubt_chi2: f64,
    /// Variance of the observations over that of their noise: more than 1 where no camera explains them all, so that what
    /// is known beforehand still counts.
    pub(crate) misfit: f64,
}

/// χ² of one spot's four numbers beyond which it is doubted, over what the typical spot has of noise's.
const DOUBT: f64 = 20.0;

impl Weighing {
    /// By their noise alone, those in doubt that noise does not explain; and none in doubt.
    pub(crate) const DOUBTING: Self = Self { doubt_chi2: DOUBT, misfit: 1.0 };
    pub(crate) const BY_NOISE: Self = Self { doubt_chi2: f64::INFINITY, misfit: 1.0 };

    /// By what the typical one has of noise's χ², no less than 1. What a wrong model leaves is alike in neighbouring dots,
    /// which then count as fewer.
    pub(crate) fn of_typical(chi2: f64, likeness: Likeness) -> Self {
        Self { doubt_chi2: DOUBT * chi2, misfit: 1.0 + (chi2 - 1.0) * likeness.dots_per_own() }
    }
}

/// Values of all unknowns.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct State {
    pub(crate) values: Vec<f64>,
    /// Of every frame; those without observations stay as they are.
    pub(crate) poses: Vec<Pose>,
    /// How far every dot lies beside its place on the target, mm.
    pub(crate) offsets_mm: Vec<[f64; 2]>,
    /// The way of the stage.
    pub(crate) way: Option<Way>,
}

/// The state that explains the observations best.
#[derive(Debug, Clone)]
pub(crate) struct Adjusted {
    pub(crate) state: State,
    /// Of the unknowns, then of the dots' offsets; in units of the prior deviations.
    pub(crate) covariance: DMatrix<f64>,
    /// Of every frame's turns (rad) and shifts (mm).
    pub(crate) pose_covariances: Vec<Matrix6<f64>>,
    /// Sum over the observations, with doubts.
    pub(crate) cost: f64,
    /// See [`Weighing::misfit`].
    pub(crate) misfit: f64,
}

/// Steps at most, and the relative change of the cost that ends them.
const STEPS: usize = 60;
const RESTING: f64 = 1e-10;

/// Shares of the step by which its size is changed when it is good, and when it is not.
const EASIER: f64 = 0.1;
const HARDER: f64 = 10.0;
const DAMPING: [f64; 3] = [1e-12, 1e-4, 1e12];

/// Larger steps of a pose are not trusted: of its turn, rad, and of its place over its distance.
const TURN_RAD_MAX: f64 = 0.3;
const SHIFT_MAX: f64 = 0.2;

/// What a frame's observations say: of what all frames share, of its pose, and of both together.
struct Share {
    shared: DMatrix<f64>,
    shared_score: DVector<f64>,
    mixed: DMatrix<f64>,
    pose: Matrix6<f64>,
    pose_score: Vector6<f64>,
    cost: f64,
}

/// What frames say of what all frames share, their poses as suit them best: a step Δ, in the prior deviations, costs
/// `cost − 2 score·Δ + Δ·information Δ`.
#[derive(Debug, Clone)]
pub(crate) struct Testimony {
    pub(crate) information: DMatrix<f64>,
    pub(crate) score: DVector<f64>,
    pub(crate) cost: f64,
}

/// The equations of all, the poses eliminated.
struct Reduced {
    factor: Cholesky<f64, Dyn>,
    score: DVector<f64>,
    /// For every frame: the inverse of its pose's information, where it has any.
    pose_inverses: Vec<Option<Matrix6<f64>>>,
}

/// How the target stands to where a stage says.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OnWay {
    pub(crate) position: StagePosition,
    /// How far beside it, mm.
    pub(crate) off_mm: Vector3<f64>,
    /// Change of the place on the way with its numbers.
    gradient: WayGradient,
}

impl Testimony {
    fn of(share: Share) -> Self {
        let Some(inverse) = share.pose.cholesky().map(|factor| factor.inverse()) else {
            return Self { information: share.shared, score: share.shared_score, cost: share.cost };
        };
        let lever = &share.mixed * inverse;
        Self {
            information: share.shared - &lever * share.mixed.transpose(),
            score: share.shared_score - lever * share.pose_score,
            cost: share.cost - share.pose_score.dot(&(inverse * share.pose_score)),
        }
    }

    fn with(self, other: Self) -> Self {
        Self {
            information: self.information + other.information,
            score: self.score + other.score,
            cost: self.cost + other.cost,
        }
    }
}

impl BandCamera {
    pub(crate) fn new(
        slots: [f64; CAMERA_SLOTS],
        page_from_reference: [[f64; 3]; 3],
        lens: LensTerms,
        correction: Option<Correction>,
    ) -> Self {
        let displacement = correction.as_ref().map(Correction::displacement);
        Self { slots, page_from_reference, lens, correction, displacement }
    }

    /// With a coefficient of its correction changed.
    fn change_coefficient(&mut self, term: usize, axis: usize, change_mm: f64) {
        let Some(correction) = &mut self.correction else { return };
        [&mut correction.x_mm, &mut correction.y_mm][axis][term] += change_mm;
    }

    fn made_ready(self) -> Self {
        Self::new(self.slots, self.page_from_reference, self.lens, self.correction)
    }
}

impl Problem<'_> {
    /// Finds the state at which no small step is better.
    pub(crate) fn adjust(&self, mut state: State) -> Option<Adjusted> {
        let mut damping = DAMPING[1];
        let mut shares = self.shares(&state);
        let mut cost = self.cost(&shares, &state);
        for _ in 0..STEPS {
            let Some((next, next_shares, next_cost)) = self.step(&state, &shares, damping, cost) else {
                damping *= HARDER;
                if damping > DAMPING[2] {
                    break;
                }
                continue;
            };
            let gain = cost - next_cost;
            (state, shares) = (next, next_shares);
            let is_done = gain <= RESTING * cost.max(1.0);
            cost = next_cost;
            damping = (damping * EASIER).max(DAMPING[0]);
            if is_done {
                break;
            }
        }
        let reduced = self.reduced(&state, &shares, 0.0)?;
        let covariance = reduced.factor.inverse();
        let pose_covariance = |(share, inverse): (&Share, &Option<Matrix6<f64>>)| {
            let inverse = inverse.unwrap_or_else(Matrix6::zeros);
            let lever = inverse * share.mixed.transpose();
            inverse + &lever * &covariance * lever.transpose()
        };
        let pose_covariances = shares.iter().zip(&reduced.pose_inverses).map(pose_covariance).collect();
        Some(Adjusted { state, covariance, pose_covariances, cost, misfit: self.weighing.misfit })
    }

    /// One step, if it is for the better.
    fn step(&self, state: &State, shares: &[Share], damping: f64, cost: f64) -> Option<(State, Vec<Share>, f64)> {
        let reduced = self.reduced(state, shares, damping)?;
        let shared = reduced.factor.solve(&reduced.score);
        let mut is_trusted = shared.iter().all(|step| step.is_finite());
        let mut next = state.clone();
        for ((value, unknown), step) in next.values.iter_mut().zip(self.unknowns).zip(shared.iter()) {
            *value += step * unknown.prior_std;
        }
        if let Some(std_mm) = self.dots.place_std_mm {
            let steps = shared.as_slice()[self.unknowns.len()..].chunks_exact(2);
            // The numbers of a way, which may follow, are no offsets.
            for (offset, step) in next.offsets_mm.iter_mut().zip(steps) {
                *offset = [offset[0] + step[0] * std_mm, offset[1] + step[1] * std_mm];
            }
        }
        if let (Some(first), Some(way)) = (self.way_start(state), &mut next.way) {
            *way = way.moved(&shared.fixed_rows::<WAY_SIZE>(first).into_owned());
        }
        for ((pose, share), inverse) in next.poses.iter_mut().zip(shares).zip(&reduced.pose_inverses) {
            let Some(inverse) = inverse else { continue };
            let left = share.pose_score - share.mixed.transpose() * &shared;
            let step: Vector6<f64> = inverse * left;
            let (turn, shift) = (step.fixed_rows::<3>(0).into_owned(), step.fixed_rows::<3>(3).into_owned());
            is_trusted &= turn.norm() < TURN_RAD_MAX && shift.norm() < SHIFT_MAX * pose.translation_mm.z;
            *pose = pose.moved(turn, shift);
        }
        if !is_trusted {
            return None;
        }
        let next_shares = self.shares(&next);
        let next_cost = self.cost(&next_shares, &next);
        (next_cost <= cost).then_some((next, next_shares, next_cost))
    }

    /// Eliminates the poses.
    fn reduced(&self, state: &State, shares: &[Share], damping: f64) -> Option<Reduced> {
        let mut score = self.prior_score(state);
        let size = score.len();
        let mut information = DMatrix::identity(size, size);
        for share in shares {
            information += &share.shared;
            score += &share.shared_score;
        }
        for k in 0..size {
            information[(k, k)] *= 1.0 + damping;
        }
        let mut pose_inverses = Vec::with_capacity(shares.len());
        for share in shares {
            let mut pose = share.pose;
            for k in 0..6 {
                pose[(k, k)] *= 1.0 + damping;
            }
            let inverse = pose.cholesky().map(|factor| factor.inverse());
            if let Some(inverse) = &inverse {
                let lever = &share.mixed * inverse;
                information -= &lever * share.mixed.transpose();
                score -= lever * share.pose_score;
            }
            pose_inverses.push(inverse);
        }
        Some(Reduced { factor: information.cholesky()?, score, pose_inverses })
    }

    /// What is known beforehand, in the prior deviations, the information of which is 1 each.
    pub(crate) fn prior_score(&self, state: &State) -> DVector<f64> {
        let mut score = DVector::zeros(self.shared_size(state));
        for (k, (value, unknown)) in state.values.iter().zip(self.unknowns).enumerate() {
            score[k] = (unknown.expected - value) / unknown.prior_std;
        }
        if let Some(std_mm) = self.dots.place_std_mm {
            for (k, offset) in state.offsets_mm.iter().flatten().enumerate() {
                score[self.unknowns.len() + k] = -offset / std_mm;
            }
        }
        score
    }

    /// What so many parts of the frames, taken by turns, say of what all share, whatever the poses.
    pub(crate) fn testimonies(&self, state: &State, parts: usize) -> Vec<Testimony> {
        let cameras = self.cameras_of(&state.values);
        let of_part = |part: usize| {
            let frames: Vec<usize> = (part..state.poses.len()).step_by(parts).collect();
            let of_frame = |frame: usize| Testimony::of(self.share_of(frame, &cameras, state));
            let own: Vec<Testimony> = frames.into_par_iter().map(of_frame).collect();
            let size = self.shared_size(state);
            let none = Testimony { information: DMatrix::zeros(size, size), score: DVector::zeros(size), cost: 0.0 };
            own.into_iter().fold(none, Testimony::with)
        };
        (0..parts).map(of_part).collect()
    }

    /// Unknowns that all frames share: those sought, then where dots lie, then the way of the stage.
    fn shared_size(&self, state: &State) -> usize {
        self.way_start(state).map_or_else(|| self.placed_end(), |first| first + WAY_SIZE)
    }

    fn placed_end(&self) -> usize {
        self.unknowns.len() + if self.dots.place_std_mm.is_some() { 2 * self.dots.position_mm.len() } else { 0 }
    }

    /// The first number of the stage's way among what all frames share.
    fn way_start(&self, state: &State) -> Option<usize> {
        (state.way.is_some() && !self.stage.is_empty()).then(|| self.placed_end())
    }

    /// How the target stands to where the stage says.
    pub(crate) fn on_way(&self, state: &State, frame: usize) -> Option<OnWay> {
        let position = (*self.stage.get(frame)?)?;
        let (place_mm, gradient) = state.way?.at(position.travel_mm);
        Some(OnWay { position, off_mm: state.poses[frame].translation_mm - place_mm, gradient })
    }

    /// Adds what the stage says of a frame.
    fn add_stage(&self, share: &mut Share, state: &State, frame: usize) {
        let Some(first) = self.way_start(state) else { return };
        let Some(OnWay { off_mm, gradient, position }) = self.on_way(state, frame) else { return };
        // What does not go together with the frames may be the stage.
        let weight = position.std_mm.powi(-2) / self.weighing.misfit;
        share.cost += weight * off_mm.norm_squared();
        for k in 0..3 {
            share.pose[(3 + k, 3 + k)] += weight;
            share.pose_score[3 + k] -= weight * off_mm[k];
        }
        let mut shared = share.shared.fixed_view_mut::<WAY_SIZE, WAY_SIZE>(first, first);
        shared += weight * gradient.transpose() * gradient;
        let mut score = share.shared_score.fixed_rows_mut::<WAY_SIZE>(first);
        score += weight * gradient.transpose() * off_mm;
        let mut mixed = share.mixed.fixed_view_mut::<WAY_SIZE, 3>(first, 3);
        mixed -= weight * gradient.transpose();
    }

    fn shares(&self, state: &State) -> Vec<Share> {
        let cameras = self.cameras_of(&state.values);
        (0..state.poses.len()).into_par_iter().map(|frame| self.share_of(frame, &cameras, state)).collect()
    }

    fn share_of(&self, frame: usize, cameras: &[BandCamera], state: &State) -> Share {
        let first = self.observations.partition_point(|observation| observation.frame < frame);
        let end = self.observations.partition_point(|observation| observation.frame <= frame);
        self.share(&self.observations[first..end], cameras, state, frame)
    }

    fn share(&self, observations: &[Observation], cameras: &[BandCamera], state: &State, frame: usize) -> Share {
        let size = self.shared_size(state);
        let mut share = Share {
            shared: DMatrix::zeros(size, size),
            shared_score: DVector::zeros(size),
            mixed: DMatrix::zeros(size, 6),
            pose: Matrix6::zeros(),
            pose_score: Vector6::zeros(),
            cost: 0.0,
        };
        for observation in observations {
            let (slots, view) = self.look(observation.band, observation.dot, cameras, state, &state.poses[frame]);
            let (image, gradient) = spot(&slots, &view);
            let chi2 = observation.chi2(&image);
            let Weighing { doubt_chi2, misfit } = self.weighing;
            let (doubted, trust) = doubt(chi2, doubt_chi2);
            let weight = trust / misfit;
            share.cost += doubted / misfit;
            let score = (observation.score - observation.information * (image - observation.anchor)) * weight;
            let information = observation.information * weight;
            let columns = self.columns(observation, (&slots, &view), &gradient);
            let pose: SMatrix<f64, 4, 6> = gradient.fixed_columns::<6>(CAMERA_SLOTS).into_owned();
            let pose_information = information * pose;
            share.pose += pose.transpose() * pose_information;
            share.pose_score += pose.transpose() * score;
            for (i, column) in &columns {
                share.shared_score[*i] += column.dot(&score);
                let weighted = information * column;
                for (k, other) in &columns {
                    share.shared[(*i, *k)] += weighted.dot(other);
                }
                for k in 0..6 {
                    share.mixed[(*i, k)] += weighted.dot(&pose.column(k));
                }
            }
        }
        // A frame that shows nothing does not tell where the stage is either.
        if !observations.is_empty() {
            self.add_stage(&mut share, state, frame);
        }
        share
    }

    /// Change of an image with what all frames share, each in units of its prior deviation.
    fn columns(
        &self,
        observation: &Observation,
        (slots, view): (&Slots, &View<'_>),
        gradient: &SMatrix<f64, 4, SLOTS>,
    ) -> Vec<(usize, Vector4<f64>)> {
        let mut columns = Vec::with_capacity(self.unknowns.len() + 2);
        let correction = self.cameras[observation.band].correction.as_ref();
        let polynomials = correction.map(|correction| correction.polynomials(ideal_mm(slots, view)));
        let of = |slot: Slot| gradient.column(slot as usize);
        for (k, unknown) in self.unknowns.iter().enumerate() {
            let mut column = Vector4::zeros();
            for feed in unknown.feeds.iter().filter(|feed| feed.band == observation.band) {
                match (feed.part, &polynomials) {
                    (Part::Slot(slot, factor), _) => column += of(slot) * (factor * unknown.prior_std),
                    (Part::Coefficient(term, axis), Some(polynomials)) => {
                        let [re, im] = polynomials[term];
                        let [x, y] = if axis == 0 { [re, im] } else { [-im, re] };
                        column += (of(Slot::ShiftX) * x + of(Slot::ShiftY) * y) * unknown.prior_std;
                    }
                    (Part::Coefficient(..), None) => {}
                }
            }
            if column != Vector4::zeros() {
                columns.push((k, column));
            }
        }
        if let Some(std_mm) = self.dots.place_std_mm {
            let shifts = gradient.fixed_columns::<3>(CAMERA_SLOTS + 3);
            let along = shifts * view.rotation.fixed_columns::<2>(0) * std_mm;
            let start = self.unknowns.len() + 2 * observation.dot;
            columns.extend([0, 1].map(|k| (start + k, along.column(k).into_owned())));
        }
        columns
    }

    /// The cameras with the unknowns at other values.
    pub(crate) fn cameras_of(&self, values: &[f64]) -> Vec<BandCamera> {
        let mut cameras = self.cameras.to_vec();
        for ((unknown, value), start) in self.unknowns.iter().zip(values).zip(self.start) {
            for feed in &unknown.feeds {
                let (camera, change) = (&mut cameras[feed.band], value - start);
                match feed.part {
                    Part::Slot(slot, factor) => camera.slots[slot as usize] += factor * change,
                    Part::Coefficient(term, axis) => camera.change_coefficient(term, axis, change),
                }
            }
        }
        cameras.into_iter().map(BandCamera::made_ready).collect()
    }

    pub(crate) fn look<'c>(
        &self,
        band: usize,
        dot: usize,
        cameras: &'c [BandCamera],
        state: &State,
        pose: &Pose,
    ) -> (Slots, View<'c>) {
        let camera = &cameras[band];
        let mut slots = Slots::zeros();
        slots.as_mut_slice()[..CAMERA_SLOTS].copy_from_slice(&camera.slots);
        slots.fixed_rows_mut::<3>(CAMERA_SLOTS + 3).copy_from(&pose.translation_mm);
        let ([x_mm, y_mm], [dx_mm, dy_mm]) = (self.dots.position_mm[dot], state.offsets_mm[dot]);
        let view = View {
            target_mm: [x_mm + dx_mm, y_mm + dy_mm],
            diameter_mm: self.dots.diameter_mm[dot],
            rotation: *pose.rotation.matrix(),
            pitch_mm: self.pitch_mm,
            page_from_reference: camera.page_from_reference,
            lens: camera.lens,
            displacement: camera.displacement.as_ref(),
        };
        (slots, view)
    }

    /// u, v, radius and blur of a dot's image, px.
    pub(crate) fn image(
        &self,
        band: usize,
        dot: usize,
        cameras: &[BandCamera],
        state: &State,
        pose: &Pose,
    ) -> Vector4<f64> {
        let (slots, view) = self.look(band, dot, cameras, state, pose);
        image(&slots, &view)
    }

    /// χ² of the typical observation.
    pub(crate) fn typical_chi2(&self, state: &State) -> f64 {
        let cameras = self.cameras_of(&state.values);
        median(self.observations.iter().map(|observation| {
            let pose = &state.poses[observation.frame];
            observation.chi2(&self.image(observation.band, observation.dot, &cameras, state, pose))
        }))
    }

    /// How much alike neighbouring dots lie beside where they should.
    pub(crate) fn likeness(&self, state: &State) -> Likeness {
        let cameras = self.cameras_of(&state.values);
        let off_px = |own: &Observation| {
            let image = self.image(own.band, own.dot, &cameras, state, &state.poses[own.frame]);
            (own.change - (image - own.anchor)).xy()
        };
        let pairs = neighbours(&self.dots.position_mm);
        let (mut product, mut count, mut square) = (0.0, 0, 0.0);
        for own in self.observations.chunk_by(|a, b| (a.frame, a.band) == (b.frame, b.band)) {
            let mut off_of_dot = vec![None; self.dots.position_mm.len()];
            let typical_px = median(own.iter().map(|own| off_px(own).norm())).max(f64::MIN_POSITIVE);
            for own in own {
                // A wrong dot has no neighbours like it.
                let off = off_px(own) / typical_px;
                let off = off / off.norm().max(1.0);
                square += off.norm_squared();
                off_of_dot[own.dot] = Some(off);
            }
            for (first, second) in pairs.iter().filter_map(|[a, b]| off_of_dot[*a].zip(off_of_dot[*b])) {
                product += first.dot(&second);
                count += 1;
            }
        }
        let mean_square = square / self.observations.len().max(1) as f64;
        Likeness { correlation: product / f64::from(count.max(1)) / mean_square.max(f64::MIN_POSITIVE) }
    }

    /// What the observations tell of every unknown if all others were known, in units of its prior deviation.
    pub(crate) fn information_of_each(&self, state: &State) -> Vec<f64> {
        let shares = self.shares(state);
        (0..self.unknowns.len()).map(|k| shares.iter().map(|share| share.shared[(k, k)]).sum()).collect()
    }

    fn cost(&self, shares: &[Share], state: &State) -> f64 {
        let priors = state.values.iter().zip(self.unknowns);
        let known: f64 = priors.map(|(value, unknown)| ((value - unknown.expected) / unknown.prior_std).powi(2)).sum();
        let placed: f64 = self
            .dots
            .place_std_mm
            .map_or(0.0, |std_mm| state.offsets_mm.iter().flatten().map(|offset| (offset / std_mm).powi(2)).sum());
        shares.iter().map(|share| share.cost).sum::<f64>() + known + placed
    }
}

/// How far the forward model's images may be from those of the real masks. Centres are off at random; radius and blur alike
/// for all dots of a frame, which many dots make no better: theirs are larger by the square root of the dots that share them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ModelError {
    /// Of u, v, radius and blur, px.
    std_px: [f64; 4],
    /// Of the blur, more, in parts of it.
    blur_share: f64,
}

/// How far blurs are off behind an ideal lens, in parts of them.
pub(crate) const BLUR_SHARE: f64 = 5e-5;

impl ModelError {
    /// Behind an ideal lens, as frames without noise show it: on the average over frames radius and blur are off by up to 2e-5
    /// and 1e-4 px and 6e-6 of the blur; in one frame blur by up to 3e-4 px either way.
    const IDEAL: Self = Self { std_px: [3e-4, 3e-4, 1.5e-4, 8e-4], blur_share: BLUR_SHARE };

    /// Behind a real one, whose aberrations the model follows to second order: a double Gauss's leave 0.0005 px of the radius.
    const REAL: Self = Self { std_px: [3e-4, 3e-4, 2e-3, 4e-3], blur_share: 1.2e-3 };

    /// Where the masks cut the light, near the axis.
    const CUT: Self = Self { std_px: [1e-3, 1e-3, 2e-3, 5e-3], blur_share: 1.2e-3 };

    pub(crate) fn of(score: &SpotScore) -> Self {
        match score {
            SpotScore { is_cut: true, .. } => Self::CUT,
            SpotScore { is_aberrated: true, .. } => Self::REAL,
            SpotScore { .. } => Self::IDEAL,
        }
    }
}

impl Observation {
    /// What an image is given for: frame, band and dot.
    pub(crate) fn new(
        (frame, band, dot): (usize, usize, usize),
        anchor: Vector4<f64>,
        score: Vector4<f64>,
        information: Matrix4<f64>,
    ) -> Self {
        let change = most_likely_change(&score, &information);
        Self { frame, band, dot, anchor, score, information, change, gain: change.dot(&score) }
    }

    /// With what the model may be wrong by added to the noise: of the covariance `S⁻¹ + F` the inverse is
    /// `S − S (S + F⁻¹)⁻¹ S`, even where S has none. `None` if S is no information, as of a dot of which the masks leave
    /// next to nothing.
    pub(crate) fn with_model_error(self, ModelError { std_px, blur_share }: ModelError) -> Option<Self> {
        const LEAST: f64 = -1e-6;
        let std_px = [std_px[0], std_px[1], std_px[2], std_px[3].hypot(blur_share * self.anchor.w)];
        let eigenvalues = self.information.symmetric_eigenvalues();
        let is_information = eigenvalues.max() > 0.0 && eigenvalues.min() > LEAST * eigenvalues.max();
        let model = Matrix4::from_diagonal(&Vector4::from(std_px.map(|std| std.powi(-2))));
        let factor = (self.information + model).cholesky().filter(|_| is_information)?;
        Some(Self::new(
            (self.frame, self.band, self.dot),
            self.anchor,
            self.score - self.information * factor.solve(&self.score),
            self.information - self.information * factor.solve(&self.information),
        ))
    }

    /// Variances of what it tells of u, v, radius and blur, px².
    pub(crate) fn variances_px2(&self) -> Vector4<f64> {
        told_inverse(&self.information).diagonal()
    }

    /// χ² of an image: of its change from the most likely one.
    pub(crate) fn chi2(&self, image: &Vector4<f64>) -> f64 {
        let change = image - self.anchor;
        let quadratic = change.dot(&(self.information * change)) - 2.0 * change.dot(&self.score);
        (quadratic + self.gain).max(0.0)
    }
}

/// From the anchor to the image that a score finds most likely; where something is not told at all the rest still is.
fn most_likely_change(score: &Vector4<f64>, information: &Matrix4<f64>) -> Vector4<f64> {
    told_inverse(information) * score
}

/// Inverse of what an information tells: directions in which it tells next to nothing, or less for rounding, count for none.
fn told_inverse(information: &Matrix4<f64>) -> Matrix4<f64> {
    const LEAST: f64 = 1e-9;
    let eigen = information.symmetric_eigen();
    let least = LEAST * eigen.eigenvalues.max();
    let told = eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()).filter(|(value, _)| **value > least);
    told.map(|(value, vector)| vector * vector.transpose() / *value).sum()
}

/// How much neighbours on a grid are alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Likeness {
    /// Correlation of a dot with that beside it.
    correlation: f64,
}

impl Likeness {
    /// How many dots tell of their mean as much as one would by itself: along a row whose correlation ρ falls as ρⁿ these are
    /// `(1 + ρ)/(1 − ρ)` (G. E. P. Box, G. M. Jenkins, G. C. Reinsel, "Time Series Analysis", section 2.1), and as many
    /// across it.
    pub(crate) fn dots_per_own(self) -> f64 {
        const CORRELATION_MAX: f64 = 0.9;
        let correlation = self.correlation.clamp(0.0, CORRELATION_MAX);
        ((1.0 + correlation) / (1.0 - correlation)).powi(2)
    }
}

/// Pairs of dots that are about as near to each other as any.
fn neighbours(position_mm: &[[f64; 2]]) -> Vec<[usize; 2]> {
    const NEAR: f64 = 1.2;
    let distance_mm = |a: usize, b: usize| {
        let ([ax, ay], [bx, by]) = (position_mm[a], position_mm[b]);
        (ax - bx).hypot(ay - by)
    };
    let all = || (0..position_mm.len()).flat_map(|a| (0..a).map(move |b| [a, b]));
    let pitch_mm = all().map(|[a, b]| distance_mm(a, b)).fold(f64::INFINITY, f64::min);
    all().filter(|[a, b]| distance_mm(*a, *b) < NEAR * pitch_mm).collect()
}

/// Huber's cost of a χ², and the weight that goes with it.
fn doubt(chi2: f64, doubt_chi2: f64) -> (f64, f64) {
    if chi2 <= doubt_chi2 {
        return (chi2, 1.0);
    }
    let (distance, bend) = (chi2.sqrt(), doubt_chi2.sqrt());
    (2.0 * bend * distance - doubt_chi2, bend / distance)
}

impl State {
    /// Positions of a dot in a frame, mm.
    pub(crate) fn dot_mm(&self, dots: &Dots, frame: usize, dot: usize) -> Vector3<f64> {
        let ([x_mm, y_mm], [dx_mm, dy_mm]) = (dots.position_mm[dot], self.offsets_mm[dot]);
        self.poses[frame].at([x_mm + dx_mm, y_mm + dy_mm])
    }
}

#[cfg(test)]
mod tests {
    use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
    use nalgebra::storage::Owned;
    use nalgebra::{Dyn, Rotation3};
    use twinpupil_instrument::{Instrument, Parameter, Projection, paper};

    use super::*;
    use crate::camera::cameras;
    use crate::unknown::{Choices, Quantity};

    /// MINPACK's method on all unknowns and poses at once.
    struct Dense<'a> {
        problem: &'a Problem<'a>,
        start: &'a State,
        /// Of the unknowns in their prior deviations, then turns (rad) and shifts (mm) of the poses from the start.
        steps: DVector<f64>,
    }

    impl Dense<'_> {
        fn state(&self) -> State {
            let mut state = self.start.clone();
            let count = self.problem.unknowns.len();
            for ((value, unknown), step) in state.values.iter_mut().zip(self.problem.unknowns).zip(self.steps.iter()) {
                *value += step * unknown.prior_std;
            }
            for (place, pose) in state.poses.iter_mut().enumerate() {
                let own = |k: usize| self.steps.fixed_rows::<3>(count + 6 * place + k).into_owned();
                *pose = pose.moved(own(0), own(3));
            }
            state
        }
    }

    impl LeastSquaresProblem<f64, Dyn, Dyn> for Dense<'_> {
        type ParameterStorage = Owned<f64, Dyn>;
        type ResidualStorage = Owned<f64, Dyn>;
        type JacobianStorage = Owned<f64, Dyn, Dyn>;

        fn set_params(&mut self, steps: &DVector<f64>) {
            self.steps.copy_from(steps);
        }

        fn params(&self) -> DVector<f64> {
            self.steps.clone()
        }

        /// `Lᵀ (p − p₀) − L⁻¹ s` of every observation of the information L Lᵀ and the score s at p₀; the priors.
        fn residuals(&self) -> Option<DVector<f64>> {
            let state = self.state();
            let cameras = self.problem.cameras_of(&state.values);
            let mut residuals = Vec::new();
            for observation in self.problem.observations {
                let Observation { band, dot, frame, anchor, score, information, .. } = observation;
                let image = self.problem.image(*band, *dot, &cameras, &state, &state.poses[*frame]);
                let lower = information.cholesky()?.l();
                let residual = lower.transpose() * (image - anchor) - lower.solve_lower_triangular(score)?;
                residuals.extend(residual.iter());
            }
            let priors = state.values.iter().zip(self.problem.unknowns);
            residuals.extend(priors.map(|(value, unknown)| (value - unknown.expected) / unknown.prior_std));
            Some(DVector::from_vec(residuals))
        }

        /// By turns about the poses as they are, which are as good as those about the start.
        fn jacobian(&self) -> Option<DMatrix<f64>> {
            let state = self.state();
            let cameras = self.problem.cameras_of(&state.values);
            let count = self.problem.unknowns.len();
            let rows = 4 * self.problem.observations.len();
            let mut jacobian = DMatrix::zeros(rows + count, self.steps.len());
            for (place, observation) in self.problem.observations.iter().enumerate() {
                let pose = &state.poses[observation.frame];
                let (slots, view) = self.problem.look(observation.band, observation.dot, &cameras, &state, pose);
                let (_, gradient) = spot(&slots, &view);
                let upper = observation.information.cholesky()?.l().transpose();
                for (k, column) in self.problem.columns(observation, (&slots, &view), &gradient) {
                    jacobian.fixed_view_mut::<4, 1>(4 * place, k).copy_from(&(upper * column));
                }
                let first = count + 6 * observation.frame;
                let own = upper * gradient.fixed_columns::<6>(CAMERA_SLOTS);
                jacobian.fixed_view_mut::<4, 6>(4 * place, first).copy_from(&own);
            }
            for k in 0..count {
                jacobian[(rows + k, k)] = 1.0;
            }
            Some(jacobian)
        }
    }

    /// Frames of a grid of dots seen by a camera off its data sheet, with errors of some thousandths of a pixel.
    fn observations(start: &Problem<'_>, values: &[f64], poses: &[Pose]) -> Vec<Observation> {
        let state = State { values: values.to_vec(), poses: poses.to_vec(), offsets_mm: vec![[0.0; 2]; 35], way: None };
        let cameras = start.cameras_of(values);
        let mut observations = Vec::new();
        for (frame, pose) in poses.iter().enumerate() {
            for band in 0..2 {
                for dot in 0..35 {
                    let image = start.image(band, dot, &cameras, &state, pose);
                    let error = |k: usize| 2e-3 * ((7 * frame + 3 * band + 5 * dot + 11 * k) as f64).sin();
                    let mixed = Matrix4::from_fn(|i, k| if i == k { 500.0 } else { 40.0 * (i as f64 - k as f64) });
                    let information = mixed.transpose() * mixed;
                    let off = Vector4::new(error(0), error(1), 5.0 * error(2), 9.0 * error(3));
                    // Looked at a little beside.
                    let anchor = image + Vector4::new(0.1, -0.2, 0.05, 0.3);
                    let score = information * (image + off - anchor);
                    observations.push(Observation::new((frame, band, dot), anchor, score, information));
                }
            }
        }
        observations
    }

    #[test]
    fn an_independent_solver_finds_the_same() {
        let instrument: Instrument = paper::instrument();
        let unknowns = Choices::default().unknowns(&instrument).unwrap();
        let projections: Vec<Projection> = instrument.bands.iter().map(|band| instrument.projection(band)).collect();
        let cameras = cameras(&instrument, &projections, &[LensTerms::default(); 2], 1.0);
        let position_mm = (0..35).map(|dot| [1.8 * f64::from(dot % 7 - 3), 1.8 * f64::from(dot / 7 - 2)]).collect();
        let dots = Dots { position_mm, diameter_mm: vec![0.9; 35], place_std_mm: None };
        let expected: Vec<f64> = unknowns.iter().map(|unknown| unknown.expected).collect();
        let pose = |z_mm: f64, x_rad: f64, y_rad: f64| Pose {
            rotation: Rotation3::new(Vector3::new(x_rad, y_rad, 0.05)),
            translation_mm: Vector3::new(0.3, -0.2, z_mm),
        };
        let poses = [pose(260.0, 0.0, 0.1), pose(285.0, 0.5, 0.0), pose(310.0, -0.1, -0.5), pose(335.0, -0.4, 0.2)];
        let mut problem = Problem {
            pitch_mm: instrument.sensor.pitch_mm,
            cameras: &cameras,
            unknowns: &unknowns,
            start: &expected,
            dots: &dots,
            observations: &[],
            stage: &[],
            weighing: Weighing::BY_NOISE,
        };
        let values: Vec<f64> = unknowns
            .iter()
            .enumerate()
            .map(|(k, unknown)| unknown.expected + 0.4 * (k as f64).cos() * unknown.prior_std)
            .collect();
        let observations = observations(&problem, &values, &poses);
        problem.observations = &observations;
        let start = State {
            values: expected.clone(),
            poses: poses.iter().map(|pose| pose.moved(Vector3::new(0.01, -0.02, 0.01), Vector3::repeat(0.5))).collect(),
            offsets_mm: vec![[0.0; 2]; 35],
            way: None,
        };
        let own = problem.adjust(start.clone()).unwrap();
        let steps = DVector::zeros(unknowns.len() + 6 * poses.len());
        let dense = Dense { problem: &problem, start: &start, steps };
        let (dense, report) = LevenbergMarquardt::new().minimize(dense);
        assert!(report.termination.was_successful(), "{report:?}");
        let other = dense.state();
        // Twice half the sum of squares.
        assert!((own.cost - 2.0 * report.objective_function).abs() < 1e-6 * own.cost, "{} {report:?}", own.cost);
        for (k, unknown) in unknowns.iter().enumerate() {
            let std = unknown.prior_std * own.covariance[(k, k)].sqrt();
            let sigmas = (own.state.values[k] - other.values[k]).abs() / std;
            assert!(sigmas < 1e-3, "{}: {sigmas} σ", unknown.quantity.key(&instrument));
        }
        for (own, other) in own.state.poses.iter().zip(&other.poses) {
            assert!((own.translation_mm - other.translation_mm).norm() < 1e-5);
            assert!((own.rotation.matrix() - other.rotation.matrix()).norm() < 1e-6);
        }
        // Its covariance, too: that of the dense equations.
        let jacobian = dense.jacobian().unwrap();
        let covariance = (jacobian.transpose() * jacobian).try_inverse().unwrap();
        for k in 0..unknowns.len() {
            let ratio = (own.covariance[(k, k)] / covariance[(k, k)]).sqrt();
            assert!((ratio - 1.0).abs() < 1e-3, "{}: {ratio}", unknowns[k].quantity.key(&instrument));
        }
    }

    #[test]
    fn dots_that_are_alike_count_as_fewer() {
        let dots_per_own = |correlation: f64| Likeness { correlation }.dots_per_own();
        assert_eq!([dots_per_own(-0.2), dots_per_own(0.0)], [1.0; 2]);
        assert!((dots_per_own(0.5) - 9.0).abs() < 1e-12);
        let noise = Weighing::of_typical(1.0, Likeness { correlation: 0.5 });
        assert_eq!(noise, Weighing::DOUBTING);
        let wrong = Weighing::of_typical(5.0, Likeness { correlation: 0.5 });
        assert_eq!((wrong.doubt_chi2, wrong.misfit), (100.0, 37.0));
        let grid: Vec<[f64; 2]> = (0..12).map(|k| [f64::from(k % 4), f64::from(k / 4)]).collect();
        // Of 3 rows of 4: 9 along rows, 8 along columns.
        assert_eq!(neighbours(&grid).len(), 17);
        assert!(neighbours(&[]).is_empty());
    }

    #[test]
    fn columns_of_a_correction_are_differences() {
        let mut spec = paper::instrument().into_spec();
        spec.sensor.tilt_deg = [1.0, -0.5];
        spec.bands[1].correction = Some(Correction::none(6.0, 3));
        let instrument = Instrument::new(spec).expect("legal");
        let of = |axis: usize| Quantity::Instrument(Parameter::Correction(1, 7, axis));
        let unknowns = [0, 1].map(|axis| Unknown::of(of(axis), &instrument, 1e-3));
        let projections: Vec<Projection> = instrument.bands.iter().map(|band| instrument.projection(band)).collect();
        let cameras = cameras(&instrument, &projections, &[LensTerms::default(); 2], 1.0);
        let dots = Dots { position_mm: vec![[3.0, -4.0]], diameter_mm: vec![0.9], place_std_mm: None };
        let (rotation, translation_mm) = (Rotation3::new(Vector3::new(0.2, -0.3, 0.1)), Vector3::new(0.3, -0.2, 280.0));
        let pose = Pose { rotation, translation_mm };
        let state = State { values: vec![0.0; 2], poses: vec![pose], offsets_mm: vec![[0.0; 2]], way: None };
        let problem = Problem {
            pitch_mm: instrument.sensor.pitch_mm,
            cameras: &cameras,
            unknowns: &unknowns,
            start: &[0.0; 2],
            dots: &dots,
            observations: &[],
            stage: &[],
            weighing: Weighing::BY_NOISE,
        };
        let (slots, view) = problem.look(1, 0, &cameras, &state, &pose);
        let (image, gradient) = spot(&slots, &view);
        let observation = Observation::new((0, 1, 0), image, Vector4::zeros(), Matrix4::identity());
        let columns = problem.columns(&observation, (&slots, &view), &gradient);
        assert_eq!(columns.len(), 2);
        for (k, column) in columns {
            let at = |steps: f64| {
                let mut values = [0.0; 2];
                values[k] = steps * 1e-3;
                problem.image(1, 0, &problem.cameras_of(&values), &state, &pose)
            };
            let expected = 0.5 * (at(1.0) - at(-1.0));
            assert!((column - expected).norm() < 1e-6 && expected.norm() > 0.02, "{k}: {column:?} {expected:?}");
        }
    }
}
