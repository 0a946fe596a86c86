//! What two dots have in common whose light falls on the same pixels.

use nalgebra::SMatrix;

use crate::likelihood::chords::LANES;
use crate::likelihood::light::{Light, Places};
use crate::likelihood::normal::{UNKNOWNS, products_with};
use crate::likelihood::profile::Profiles;
use crate::likelihood::spot::{PIXEL_REACH_PX, Spot};
use crate::likelihood::weigh::Weights;

/// `JᵀWJ′` between the unknowns of a spot and those of a neighbour (its u, v, radius, blur and contrast) in one band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Coupling {
    /// Index of the neighbour's body.
    pub(crate) other: usize,
    pub(crate) band: usize,
    pub(crate) block: SMatrix<f64, UNKNOWNS, 5>,
}

/// The samples of a spot's window that a neighbour reaches, and its light there.
#[derive(Debug, Clone, Default)]
pub(crate) struct Near {
    index: Vec<u32>,
    places: Places,
    light: Light,
    /// Weights and columns of the spot itself there, as whole lanes.
    weight: Vec<f32>,
    columns: [Vec<f32>; UNKNOWNS],
}

/// A neighbour whose light falls into a window.
#[derive(Debug, Clone)]
pub(crate) struct NearLight {
    pub(crate) spot: Spot,
    pub(crate) contrast: f64,
    /// Growth of the illumination along u and v, 1/px.
    pub(crate) growth: [f32; 2],
    /// How fast its light grows across its edges at most, codes per px.
    pub(crate) steepness: f64,
}

impl Near {
    /// Finds the samples, placed about `about_px`, that a neighbour reaches, and its light there.
    pub(crate) fn find(&mut self, near: &NearLight, about_px: [f64; 2], places: &Places, profiles: &mut Profiles) {
        let shift = |axis: usize| (about_px[axis] - near.spot.centre_px[axis]) as f32;
        let reach_px = near.spot.reach_px() + PIXEL_REACH_PX * (f64::from(places.square_px) - 1.0);
        let (shift_u, shift_v, reach) = (shift(0), shift(1), reach_px as f32);
        self.index.clear();
        self.places.clear();
        (self.places.square_px, self.places.closely) = (places.square_px, places.closely);
        let is_near = |du: f32, dv: f32| {
            let (du, dv) = (du + shift_u, dv + shift_v);
            du * du + dv * dv < reach * reach
        };
        for (chunk, (du, dv)) in places.du.chunks(LANES).zip(places.dv.chunks(LANES)).enumerate() {
            // Most pixels are no neighbour's.
            let near = du.iter().zip(dv).map(|(du, dv)| u32::from(is_near(*du, *dv)));
            if near.sum::<u32>() > 0 {
                self.take(chunk * LANES, [du, dv], [shift_u, shift_v], is_near);
            }
        }
        (self.places.edge, self.places.lit) = (self.index.len(), self.index.len());
        if !self.index.is_empty() {
            self.light.fill(&near.spot, &self.places, profiles);
        }
    }

    /// Takes those of a few samples that are near.
    #[inline(always)]
    fn take(
        &mut self,
        first: usize,
        [du, dv]: [&[f32]; 2],
        [shift_u, shift_v]: [f32; 2],
        is_near: impl Fn(f32, f32) -> bool,
    ) {
        let (mut count, Self { index, places, .. }) = (self.index.len(), self);
        index.resize(count + LANES, 0);
        places.du.resize(count + LANES, 0.0);
        places.dv.resize(count + LANES, 0.0);
        // Each is written, and the next one over it unless it is near: branches cost more.
        for (lane, (du, dv)) in du.iter().zip(dv).enumerate() {
            (index[count], places.du[count], places.dv[count]) = ((first + lane) as u32, du + shift_u, dv + shift_v);
            count += usize::from(is_near(*du, *dv));
        }
        index.truncate(count);
        places.du.truncate(count);
        places.dv.truncate(count);
    }

    /// Adds the neighbour's light to that on the samples.
    pub(crate) fn add(&self, near: &NearLight, others: &mut [f32]) {
        let ([gu, gv], contrast) = (near.growth, near.contrast as f32);
        for (k, sample) in self.index.iter().enumerate() {
            let lit = 1.0 + gu * self.places.du[k] + gv * self.places.dv[k];
            others[*sample as usize] += contrast * lit * self.light.light[k];
        }
    }

    /// The products of the derivatives of a spot, of some contrast, and its neighbour on the pixels that both reach; `None`
    /// without such pixels.
    pub(crate) fn block(
        &mut self,
        near: &NearLight,
        contrast: f64,
        own: &Light,
        weights: &Weights,
    ) -> Option<SMatrix<f64, UNKNOWNS, 5>> {
        if self.index.is_empty() {
            return None;
        }
        let Self { index, light: other, weight, columns, .. } = self;
        gather(index, &weights.weight, weight);
        let of_own = [&own.with_u, &own.with_v, &own.with_radius, &own.with_blur, &own.light, &own.open];
        columns.iter_mut().zip(of_own).for_each(|(column, own)| gather(index, own, column));
        let scales = [contrast, contrast, contrast, contrast, 1.0, 1.0];
        let others = [&other.with_u[..], &other.with_v, &other.with_radius, &other.with_blur, &other.light];
        let other_scales = [near.contrast, near.contrast, near.contrast, near.contrast, 1.0];
        let mut products = [[0.0; 5]; UNKNOWNS];
        products_with(others, weight, columns.each_ref().map(|column| &column[..]), &mut products);
        Some(SMatrix::from_fn(|i, k| scales[i] * other_scales[k] * products[i][k]))
    }
}

/// The values with these indices, and zeros behind them that fill the last lanes.
fn gather(index: &[u32], values: &[f32], gathered: &mut Vec<f32>) {
    gathered.clear();
    gathered.extend(index.iter().map(|k| values[*k as usize]));
    gathered.resize(index.len().next_multiple_of(LANES), 0.0);
}
