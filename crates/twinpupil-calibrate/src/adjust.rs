//! Bundle adjustment: camera, target and all poses at once, by Levenberg and Marquardt's method on an arrow-head matrix.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix4, Matrix6, SMatrix, Vector3, Vector4, Vector6};
use rayon::prelude::*;

use crate::forward::{CAMERA_SLOTS, SLOTS, Slots, View, spot};
use crate::pose::Pose;
use crate::unknown::Unknown;

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
}

/// A camera's band, before any unknown is moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BandCamera {
    /// The values of the slots that are the camera's.
    pub(crate) slots: [f64; CAMERA_SLOTS],
    pub(crate) page_from_reference: [[f64; 3]; 3],
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
    /// χ² of an observation beyond which it is doubted.
    pub(crate) doubt_chi2: f64,
}

/// Values of all unknowns.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct State {
    pub(crate) values: Vec<f64>,
    /// Of every frame; those without observations stay as they are.
    pub(crate) poses: Vec<Pose>,
    /// How far every dot lies beside its place on the target, mm.
    pub(crate) offsets_mm: Vec<[f64; 2]>,
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
}

/// Steps at most, and the relative change of the cost that ends them.
const STEPS: usize = 60;
const RESTING: f64 = 1e-10;

/// Shares of the step by which its size is changed when it is good, and when it is not.
const EASIER: f64 = 0.1;
const HARDER: f64 = 10.0;
const DAMPING: [f64; 3] = [1e-12, 1e-4, 1e12];

/// Larger steps are not trusted: of an unknown in its prior deviations, of a pose's turn, rad, and of its place over its
/// distance.
const STEP_SIGMAS_MAX: f64 = 3.0;
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

/// The equations of all, the poses eliminated.
struct Reduced {
    factor: Cholesky<f64, Dyn>,
    score: DVector<f64>,
    /// For every frame: the inverse of its pose's information, where it has any.
    pose_inverses: Vec<Option<Matrix6<f64>>>,
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
        Some(Adjusted { state, covariance, pose_covariances, cost })
    }

    /// One step, if it is for the better.
    fn step(&self, state: &State, shares: &[Share], damping: f64, cost: f64) -> Option<(State, Vec<Share>, f64)> {
        let reduced = self.reduced(state, shares, damping)?;
        let shared = reduced.factor.solve(&reduced.score);
        let mut is_trusted = shared.rows(0, self.unknowns.len()).amax() < STEP_SIGMAS_MAX;
        let mut next = state.clone();
        for ((value, unknown), step) in next.values.iter_mut().zip(self.unknowns).zip(shared.iter()) {
            *value += step * unknown.prior_std;
        }
        if let Some(std_mm) = self.dots.place_std_mm {
            let steps = shared.as_slice()[self.unknowns.len()..].chunks_exact(2);
            for (offset, step) in next.offsets_mm.iter_mut().zip(steps) {
                *offset = [offset[0] + step[0] * std_mm, offset[1] + step[1] * std_mm];
            }
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
        let size = self.shared_size();
        let (mut information, mut score) = (DMatrix::identity(size, size), DVector::zeros(size));
        for (k, (value, unknown)) in state.values.iter().zip(self.unknowns).enumerate() {
            score[k] = (unknown.expected - value) / unknown.prior_std;
        }
        if let Some(std_mm) = self.dots.place_std_mm {
            for (k, offset) in state.offsets_mm.iter().flatten().enumerate() {
                score[self.unknowns.len() + k] = -offset / std_mm;
            }
        }
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

    /// Unknowns that all frames share.
    fn shared_size(&self) -> usize {
        self.unknowns.len() + if self.dots.place_std_mm.is_some() { 2 * self.dots.position_mm.len() } else { 0 }
    }

    fn shares(&self, state: &State) -> Vec<Share> {
        let cameras = self.cameras_of(&state.values);
        let of_frame = |frame: usize| {
            let first = self.observations.partition_point(|observation| observation.frame < frame);
            let end = self.observations.partition_point(|observation| observation.frame <= frame);
            self.share(&self.observations[first..end], &cameras, state, frame)
        };
        (0..state.poses.len()).into_par_iter().map(of_frame).collect()
    }

    fn share(&self, observations: &[Observation], cameras: &[BandCamera], state: &State, frame: usize) -> Share {
        let size = self.shared_size();
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
            let (doubted, weight) = doubt(chi2, self.doubt_chi2);
            share.cost += doubted;
            let score = (observation.score - observation.information * (image - observation.anchor)) * weight;
            let information = observation.information * weight;
            let columns = self.columns(observation, &gradient, &view);
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
        share
    }

    /// Change of an image with what all frames share, each in units of its prior deviation.
    fn columns(
        &self,
        observation: &Observation,
        gradient: &SMatrix<f64, 4, SLOTS>,
        view: &View,
    ) -> Vec<(usize, Vector4<f64>)> {
        let mut columns = Vec::with_capacity(CAMERA_SLOTS + 2);
        for (k, unknown) in self.unknowns.iter().enumerate() {
            let mut column = Vector4::zeros();
            for feed in unknown.feeds.iter().filter(|feed| feed.band == observation.band) {
                column += gradient.column(feed.slot as usize) * (feed.factor * unknown.prior_std);
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
                cameras[feed.band].slots[feed.slot as usize] += feed.factor * (value - start);
            }
        }
        cameras
    }

    pub(crate) fn look(
        &self,
        band: usize,
        dot: usize,
        cameras: &[BandCamera],
        state: &State,
        pose: &Pose,
    ) -> (Slots, View) {
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
        spot(&slots, &view).0
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

/// How far the forward model's images may be from those of the real masks: u, v, radius and blur, px. The light across an
/// edge is modelled to some ten-thousandths of a pixel, alike for all dots of a frame, so that many dots make it no better:
/// radius and blur count for less than their noise would have them.
const MODEL_STD_PX: [f64; 4] = [2e-4, 2e-4, 3e-3, 8e-3];

/// The same where the masks cut the light, near the axis.
const CUT_STD_PX: [f64; 4] = [2.5e-3, 2.5e-3, 2.5e-2, 2.5e-2];

impl Observation {
    /// With what the model may be wrong by added to the noise: of the covariance `S⁻¹ + F` the inverse is
    /// `S − S (S + F⁻¹)⁻¹ S`, even where S has none. `None` if S is no information, as of a dot of which the masks leave
    /// next to nothing.
    pub(crate) fn with_model_error(self, is_cut: bool) -> Option<Self> {
        const LEAST: f64 = -1e-6;
        let std_px = if is_cut { CUT_STD_PX } else { MODEL_STD_PX };
        let eigenvalues = self.information.symmetric_eigenvalues();
        let is_information = eigenvalues.max() > 0.0 && eigenvalues.min() > LEAST * eigenvalues.max();
        let model = Matrix4::from_diagonal(&Vector4::from(std_px.map(|std| std.powi(-2))));
        let factor = (self.information + model).cholesky().filter(|_| is_information)?;
        Some(Self {
            information: self.information - self.information * factor.solve(&self.information),
            score: self.score - self.information * factor.solve(&self.score),
            ..self
        })
    }

    /// χ² of an image: of its change from the most likely one.
    pub(crate) fn chi2(&self, image: &Vector4<f64>) -> f64 {
        let change = image - self.anchor;
        let quadratic = change.dot(&(self.information * change)) - 2.0 * change.dot(&self.score);
        (quadratic + self.best_chi2()).max(0.0)
    }

    /// What the change to the most likely image would gain.
    fn best_chi2(&self) -> f64 {
        self.most_likely_change().map_or(0.0, |change| change.dot(&self.score))
    }

    /// From the anchor to the image that this observation alone finds most likely.
    pub(crate) fn most_likely_change(&self) -> Option<Vector4<f64>> {
        // Where something is not told at all the rest still is.
        const LEAST: f64 = 1e-9;
        let eigen = self.information.symmetric_eigen();
        let largest = eigen.eigenvalues.max();
        if largest.is_nan() || largest <= 0.0 {
            return None;
        }
        let mut change = Vector4::zeros();
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value > LEAST * largest {
                change += vector * (vector.dot(&self.score) / value);
            }
        }
        Some(change)
    }
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
