//! How well a dot is known when its neighbours are known no better.

use nalgebra::{Matrix4, SMatrix, SVector};
use smallvec::SmallVec;

use crate::likelihood::body::{BandLight, Body};
use crate::likelihood::coupling::Coupling;

/// Covariance of x, y, z and diameter of a body, with the unknowns of the neighbours that share its light left open.
///
/// The information on all of them is one symmetric matrix of blocks; eliminating the neighbours from it leaves what is
/// known of the body.
pub(crate) fn covariance(
    bodies: &[Body],
    couplings: &[Vec<Coupling>],
    index: usize,
    patch: &mut Patch,
) -> Option<Matrix4<f64>> {
    let alone = bodies[index].information();
    if couplings[index].is_empty() {
        return positive_inverse(alone);
    }
    patch.fill(bodies, couplings, index);
    // Where the sums over the two windows contradict each other the neighbours leave nothing: as little as they can.
    patch.last_after_elimination().or_else(|| positive_inverse(alone).map(|covariance| covariance * CONTRADICTED))
}

/// Growth of the variances of a dot whose information its neighbours' seems to exceed.
const CONTRADICTED: f64 = 4.0;

/// Inverse of an information matrix, if it can be one.
fn positive_inverse(information: Matrix4<f64>) -> Option<Matrix4<f64>> {
    information.try_inverse().filter(|covariance| covariance.diagonal().iter().all(|variance| *variance > 0.0))
}

/// Information on a body and its neighbours: for each x, y, z, diameter and its contrasts; the body itself is the last.
#[derive(Debug, Clone, Default)]
pub(crate) struct Patch {
    /// Row by row.
    matrix: Vec<f64>,
    size: usize,
    /// Unknowns of each body.
    unknowns: usize,
}

/// Derivatives of u, v, radius, blur and contrast of one band with the dot alone.
type ToDot = SMatrix<f64, 5, 4>;

impl BandLight {
    /// Information on u, v, radius, blur and contrast, the background eliminated, and what is left of a sum over the
    /// background in each row.
    fn without_background(&self) -> (SMatrix<f64, 5, 5>, SVector<f64, 5>) {
        let information = &self.normal.information;
        let mixed: SVector<f64, 5> = information.fixed_view::<5, 1>(0, 5).into_owned();
        let share = mixed / information[(5, 5)].max(1e-12);
        (information.fixed_view::<5, 5>(0, 0) - share * mixed.transpose(), share)
    }

    fn to_dot(&self) -> ToDot {
        let mut to_dot = ToDot::zeros();
        to_dot.fixed_view_mut::<4, 4>(0, 0).copy_from(&self.jacobian);
        to_dot
    }
}

impl Patch {
    fn fill(&mut self, bodies: &[Body], couplings: &[Vec<Coupling>], index: usize) {
        let mut members: SmallVec<[usize; 16]> = couplings[index].iter().map(|coupling| coupling.other).collect();
        members.sort_unstable();
        members.dedup();
        members.push(index);
        let unknowns = 4 + bodies[index].bands.len();
        self.unknowns = unknowns;
        self.size = unknowns * members.len();
        self.matrix.clear();
        self.matrix.resize(self.size * self.size, 0.0);
        for (place, member) in members.iter().enumerate() {
            self.add_own(&bodies[*member], place * unknowns);
            for coupling in &couplings[*member] {
                // Each pair once, as the later of the two sees it.
                if let Some(other) = members[..place].iter().position(|other| *other == coupling.other) {
                    self.add_shared(bodies, *member, coupling, [place, other].map(|place| place * unknowns));
                }
            }
        }
    }

    fn add_own(&mut self, body: &Body, start: usize) {
        for (band, light) in body.bands.iter().enumerate() {
            let Some(light) = light else {
                self.matrix[(start + 4 + band) * (self.size + 1)] = 1.0;
                continue;
            };
            let (information, _) = light.without_background();
            self.add(&information, [light.to_dot(), light.to_dot()], [start, start], band);
        }
        if let Some(prior) = &body.prior {
            for (unknown, information) in prior.information().iter().enumerate() {
                self.matrix[(start + unknown) * (self.size + 1)] += information;
            }
        }
    }

    fn add_shared(&mut self, bodies: &[Body], own: usize, coupling: &Coupling, starts: [usize; 2]) {
        let Coupling { other, band, block } = coupling;
        if let (Some(own), Some(other)) = (&bodies[own].bands[*band], &bodies[*other].bands[*band]) {
            let (_, share) = own.without_background();
            let shared = block.fixed_rows::<5>(0) - share * block.row(5);
            self.add(&shared, [own.to_dot(), other.to_dot()], starts, *band);
        }
    }

    /// Adds information on the images of two dots in a band to that on the dots themselves, in the lower half.
    fn add(&mut self, information: &SMatrix<f64, 5, 5>, to_dots: [ToDot; 2], starts: [usize; 2], band: usize) {
        let [rows, columns] = to_dots;
        let half = information * columns;
        let dots = rows.transpose() * half;
        let contrast_row = half.row(4);
        let contrast_column = rows.transpose() * information.column(4);
        for i in 0..4 {
            for k in 0..4 {
                *self.at(starts[0] + i, starts[1] + k) += dots[(i, k)];
            }
            *self.at(starts[0] + 4 + band, starts[1] + i) += contrast_row[i];
            *self.at(starts[0] + i, starts[1] + 4 + band) += contrast_column[i];
        }
        *self.at(starts[0] + 4 + band, starts[1] + 4 + band) += information[(4, 4)];
    }

    fn at(&mut self, row: usize, column: usize) -> &mut f64 {
        &mut self.matrix[row * self.size + column]
    }

    /// Covariance of the last body's x, y, z and diameter, by Cholesky's elimination; `None` if the matrix is no
    /// information.
    fn last_after_elimination(&mut self) -> Option<Matrix4<f64>> {
        let size = self.size;
        for column in 0..size {
            let (above, below) = self.matrix.split_at_mut((column + 1) * size);
            let pivot_row = &mut above[column * size..];
            let square = pivot_row[column] - pivot_row[..column].iter().map(|x| x * x).sum::<f64>();
            if square.is_nan() || square <= 1e-12 * pivot_row[column] {
                return None;
            }
            pivot_row[column] = square.sqrt();
            let (known, pivot) = (&pivot_row[..column], pivot_row[column]);
            for row in below.chunks_exact_mut(size) {
                let sum: f64 = row[..column].iter().zip(known).map(|(a, b)| a * b).sum();
                row[column] = (row[column] - sum) / pivot;
            }
        }
        self.last_block()
    }

    /// Inverse of what the factor leaves of the last body's information, of which the first four unknowns count.
    fn last_block(&self) -> Option<Matrix4<f64>> {
        let (count, last) = (self.unknowns, self.size - self.unknowns);
        let factor = |i: usize, k: usize| self.matrix[(last + i) * self.size + last + k];
        // Columns of the inverse factor.
        let mut inverse: SmallVec<[[f64; 4]; 8]> = SmallVec::from_elem([0.0; 4], count);
        for column in 0..4 {
            for row in column..count {
                let unit = if row == column { 1.0 } else { 0.0 };
                let sum: f64 = (column..row).map(|k| factor(row, k) * inverse[k][column]).sum();
                inverse[row][column] = (unit - sum) / factor(row, row);
            }
        }
        let covariance = Matrix4::from_fn(|i, k| inverse.iter().map(|row| row[i] * row[k]).sum::<f64>());
        covariance.iter().all(|value: &f64| value.is_finite()).then_some(covariance)
    }
}
