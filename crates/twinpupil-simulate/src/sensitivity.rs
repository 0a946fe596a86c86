//! How the light of the pixels around one dot answers to what is unknown about the dot.

use twinpupil_instrument::Site;

use crate::bundle::{Bundle, Sight};
use crate::light::sum;
use crate::render::{Renderer, TILE_PX, Workspace};

/// Unknowns of a dot that all bands share: x, y, z and diameter.
pub(crate) const SHARED: usize = 4;

/// Unknowns of a dot in one band: the shared ones, its brightness over the ground, and the ground.
pub(crate) const UNKNOWNS: usize = SHARED + 2;

/// Index of the derivative by the brightness, which is the dot's image in unit light.
const BRIGHTNESS: usize = SHARED;

/// Pixels of ground around the image of a dot that belong to it too, px.
const MARGIN_PX: usize = 8;

/// The pixels of one plane within a rectangle of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Patch {
    /// Columns and rows of the frame from one pixel of the plane to the next.
    step_px: usize,
    /// First column and row of the frame.
    first_px: [usize; 2],
    /// Columns and rows of the patch.
    count: [usize; 2],
}

impl Patch {
    /// Pixels of a plane from `low_px` to below `high_px`.
    fn new(site: Site, low_px: [usize; 2], high_px: [usize; 2]) -> Self {
        let Site { origin_px, step_px, .. } = site;
        let before = |axis: usize, end_px: usize| end_px.saturating_sub(origin_px[axis]).div_ceil(step_px);
        let first = [0, 1].map(|axis| before(axis, low_px[axis]));
        Self {
            step_px,
            first_px: [0, 1].map(|axis| origin_px[axis] + first[axis] * step_px),
            count: [0, 1].map(|axis| before(axis, high_px[axis]).saturating_sub(first[axis])),
        }
    }

    /// Columns and rows of the frame below which the patch ends.
    fn end_px(&self) -> [usize; 2] {
        [0, 1].map(|axis| self.first_px[axis] + self.count[axis] * self.step_px)
    }

    /// The pixels of two patches of the same plane that both have.
    fn intersection(&self, other: &Self) -> Self {
        let (end, other_end) = (self.end_px(), other.end_px());
        let first_px = [0, 1].map(|axis| self.first_px[axis].max(other.first_px[axis]));
        let count = |axis: usize| end[axis].min(other_end[axis]).saturating_sub(first_px[axis]) / self.step_px;
        Self { step_px: self.step_px, first_px, count: [count(0), count(1)] }
    }

    /// Column and row of every pixel, row by row.
    fn pixels(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let Self { step_px, first_px: [column, row], count: [columns, rows] } = *self;
        (0..rows).flat_map(move |j| (0..columns).map(move |i| [column + i * step_px, row + j * step_px]))
    }

    /// Index of the pixel that the frame has at `column` and `row`.
    fn index(&self, [column, row]: [usize; 2]) -> usize {
        (row - self.first_px[1]) / self.step_px * self.count[0] + (column - self.first_px[0]) / self.step_px
    }

    /// Whether a pixel belongs to the outermost ones that the patch's plane has on a frame of `size_px`.
    fn is_outermost(&self, pixel: [usize; 2], size_px: [usize; 2]) -> bool {
        (0..2).any(|axis| pixel[axis] < self.step_px || pixel[axis] + self.step_px >= size_px[axis])
    }
}

/// Derivatives of the electrons in the pixels around one dot, in one band.
#[derive(Debug, Clone)]
pub(crate) struct Sensitivity {
    patch: Patch,
    /// By x, y, z and diameter, in electrons per mm; by brightness over the ground and by the ground, pure numbers.
    derivatives: Vec<[f64; UNKNOWNS]>,
    /// Whether the dot is seen, and by no outermost pixel of its plane.
    pub(crate) is_whole: bool,
}

impl Sensitivity {
    /// Whether the images of two dots have a pixel in common.
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        self.common(other).any(|(_, own, its)| own[BRIGHTNESS] > 0.0 && its[BRIGHTNESS] > 0.0)
    }

    /// Fisher information about the unknowns of two dots from the pixels around both.
    ///
    /// ```text
    /// J[k][l] = Σ_pixels ∂E/∂a_k · ∂E/∂b_l / var E
    /// ```
    ///
    /// `precision` is 1/var of every pixel of the page, row by row, and 0 for those that tell nothing.
    pub(crate) fn information(&self, other: &Self, precision: &[f64], width_px: usize) -> [[f64; UNKNOWNS]; UNKNOWNS] {
        let mut sums = [[0.0; UNKNOWNS]; UNKNOWNS];
        for ([column, row], own, its) in self.common(other) {
            let precision = precision[row * width_px + column];
            for (sums, own) in sums.iter_mut().zip(own) {
                let weighted = own * precision;
                sums.iter_mut().zip(its).for_each(|(sum, its)| *sum += weighted * its);
            }
        }
        sums
    }

    /// The pixels around both dots, each with the derivatives by the unknowns of either.
    fn common<'s>(
        &'s self,
        other: &'s Self,
    ) -> impl Iterator<Item = ([usize; 2], &'s [f64; UNKNOWNS], &'s [f64; UNKNOWNS])> {
        let pixels = self.patch.intersection(&other.patch).pixels();
        pixels.map(|pixel| {
            let own = &self.derivatives[self.patch.index(pixel)];
            (pixel, own, &other.derivatives[other.patch.index(pixel)])
        })
    }
}

impl Renderer<'_> {
    /// For every dot the pixels of the plane at `site` around it, or `None` where it is out of sight.
    pub(crate) fn patches(&self, band: usize, site: Site) -> Vec<Option<Patch>> {
        let size_px = self.sensor.size_px;
        let mut corners: Vec<Option<[[usize; 2]; 2]>> = vec![None; self.scene.dots().len()];
        let mut nearby = Vec::new();
        for row in (0..size_px[1]).step_by(TILE_PX) {
            for column in (0..size_px[0]).step_by(TILE_PX) {
                let (low, high) = ([column, row], [column + TILE_PX, row + TILE_PX]);
                let (centre, radius_mm) = self.disc(band, low, [TILE_PX; 2]);
                let bundle = Bundle::new(self.bands[band].optics, centre, radius_mm);
                self.find_dots(band, &bundle, &mut nearby);
                for &id in nearby.iter().filter(|&&id| self.sight(band, &bundle, id) != Sight::Beside) {
                    let [old_low, old_high] = corners[id].unwrap_or([low, high]);
                    corners[id] = Some([
                        [0, 1].map(|axis| low[axis].min(old_low[axis])),
                        [0, 1].map(|axis| high[axis].max(old_high[axis])),
                    ]);
                }
            }
        }
        let patch = |[low, high]: [[usize; 2]; 2]| {
            let high = [0, 1].map(|axis| size_px[axis].min(high[axis] + MARGIN_PX));
            Patch::new(site, low.map(|low| low.saturating_sub(MARGIN_PX)), high)
        };
        corners.into_iter().map(|corners| corners.map(patch)).collect()
    }

    /// How the pixels of `patch`, whose response to the band is `response`, answer to dot `id`.
    pub(crate) fn sensitivity(
        &self,
        band: usize,
        id: usize,
        patch: Patch,
        response: f64,
        workspace: &mut Workspace,
    ) -> Sensitivity {
        let (centre, radius_mm) = self.disc(band, patch.first_px, patch.count.map(|count| count * patch.step_px));
        let of_patch = Bundle::new(self.bands[band].optics, centre, radius_mm);
        let contrast_e = self.scene.brightness_e - self.scene.background_e;
        let mut is_seen = false;
        let mut is_cut = false;
        let derivatives = patch
            .pixels()
            .map(|pixel| {
                let (centre, radius_mm) = self.disc(band, pixel, [1, 1]);
                let bundle = of_patch.part(centre, radius_mm);
                let (light, [covered, shared @ ..]) = self.light_of_dot(band, id, pixel, &bundle, workspace);
                is_seen |= covered > 0.0;
                is_cut |= covered > 0.0 && patch.is_outermost(pixel, self.sensor.size_px);
                let [x, y, z, diameter] = shared.map(|derivative| contrast_e * derivative);
                let lit = self.scene.illumination.map_or(1.0, |lit| self.light_on(&bundle, &lit, Some(id)));
                [x, y, z, diameter, covered, light].map(|derivative| response * lit * derivative)
            })
            .collect();
        Sensitivity { patch, derivatives, is_whole: is_seen && !is_cut }
    }

    /// Light in a pixel from ground of unit brightness; light from a dot of unit brightness and its derivatives by
    /// the dot's x, y, z and diameter, per mm.
    fn light_of_dot(
        &self,
        band: usize,
        id: usize,
        [column, row]: [usize; 2],
        bundle: &Bundle<'_>,
        workspace: &mut Workspace,
    ) -> (f64, [f64; 1 + SHARED]) {
        let sight = self.sight(band, bundle, id);
        let uniform = |light: f64| {
            let covered = if sight == Sight::Within { light } else { 0.0 };
            (light, [covered, 0.0, 0.0, 0.0, 0.0])
        };
        if sight != Sight::Across && bundle.is_unclipped() {
            return uniform(1.0);
        }
        let (bank, discs) = self.sampling(band, bundle);
        let samples = bank.of_pixel(band, column, row);
        self.trace(band, [column, row], bundle, samples, workspace);
        let light = sum(&workspace.rays.weight) / samples.len() as f64;
        if sight != Sight::Across {
            return uniform(light);
        }
        let of_dot = discs[id].light_sensitivity(&workspace.rays);
        (light, of_dot.map(|sum| sum / samples.len() as f64))
    }

    /// How a bundle meets dot `id`.
    fn sight(&self, band: usize, bundle: &Bundle<'_>, id: usize) -> Sight {
        bundle.sight(&self.scene.dots()[id], self.bands[band].discs[id].shadow_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patches_hold_the_pixels_of_their_plane() {
        let site = Site { page: 0, origin_px: [1, 0], step_px: 2 };
        let patch = Patch::new(site, [4, 2], [8, 5]);
        let pixels: Vec<_> = patch.pixels().collect();
        assert_eq!(pixels, [[5, 2], [7, 2], [5, 4], [7, 4]]);
        assert!(pixels.iter().enumerate().all(|(index, pixel)| patch.index(*pixel) == index));
        let next = Patch::new(site, [6, 4], [20, 20]);
        assert_eq!(patch.intersection(&next).pixels().collect::<Vec<_>>(), [[7, 4]]);
        assert_eq!(next.intersection(&patch), patch.intersection(&next));
        let beside = Patch::new(site, [10, 0], [20, 5]);
        assert_eq!(patch.intersection(&beside).pixels().count(), 0);
        assert_eq!(Patch::new(site, [3, 3], [3, 3]).pixels().count(), 0);
    }

    #[test]
    fn outermost_pixels_have_no_neighbour_on_some_side() {
        let patch = Patch::new(Site { page: 0, origin_px: [1, 0], step_px: 2 }, [0, 0], [9, 9]);
        let outermost: Vec<_> = patch.pixels().filter(|pixel| !patch.is_outermost(*pixel, [9, 9])).collect();
        assert_eq!(outermost.first(), Some(&[3, 2]));
        assert_eq!(outermost.last(), Some(&[5, 6]));
    }
}
