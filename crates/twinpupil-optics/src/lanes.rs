//! Many rays through the lens side by side.
//!
//! Nearly every ray meets the facet under which it runs, so this case is worked out for a block of rays at a time, with
//! no branch that would keep the loops from being vectorised. Of the few others it says nothing: their line is NaN, and
//! [`Plate`] follows them one by one. Both use the same formulas.

use multiversion::multiversion;

use crate::grooves::Groove;
use crate::line::{Line, cos_fourth};
use crate::linear::Linear;
use crate::plate::{ALONG_AXIS, Plate};
use crate::refraction::{Vector, refract};
use crate::stop::{Stop, holds};

/// Lines that are followed together: their few numbers stay in the first-level cache.
pub(crate) const LANES: usize = 64;

/// A block of lines, by depth below the peaks.
#[derive(Debug, Clone)]
pub(crate) struct Lines {
    at_peaks_mm: [[f64; LANES]; 2],
    slope: [[f64; LANES]; 2],
}

impl Default for Lines {
    fn default() -> Self {
        Self { at_peaks_mm: [[0.0; LANES]; 2], slope: [[0.0; LANES]; 2] }
    }
}

impl Lines {
    /// Lines none of which is settled.
    fn unsettled() -> Self {
        Self { slope: [[f64::NAN; LANES]; 2], ..Self::default() }
    }

    #[inline(always)]
    pub(crate) fn get(&self, lane: usize) -> Line {
        let ([x_mm, y_mm], [gx, gy]) = (&self.at_peaks_mm, &self.slope);
        Line { at_peaks_mm: [x_mm[lane], y_mm[lane]], slope: [gx[lane], gy[lane]] }
    }

    #[inline(always)]
    pub(crate) fn set(&mut self, lane: usize, line: Line) {
        for k in 0..2 {
            self.at_peaks_mm[k][lane] = line.at_peaks_mm[k];
            self.slope[k][lane] = line.slope[k];
        }
    }

    /// Whether the common case was the case.
    pub(crate) fn is_settled(&self, lane: usize) -> bool {
        !self.slope[0][lane].is_nan()
    }
}

impl Plate {
    /// [`Plate::enter_flat_face`] in the common case.
    pub(crate) fn enter_flat_face_all(&self, outside: &Lines) -> Lines {
        if self.is_smooth {
            return Lines::unsettled();
        }
        let mut lines = outside.clone();
        enter_flat_face(self, &mut lines);
        leave_facets(self, &self.grooves_at_peaks(&lines), &mut lines);
        lines
    }

    /// [`Plate::enter_grooves`] in the common case.
    pub(crate) fn enter_grooves_all(&self, outside: &Lines) -> Lines {
        if self.is_smooth {
            return Lines::unsettled();
        }
        let mut lines = outside.clone();
        enter_facets(self, &self.grooves_at_peaks(&lines), &mut lines);
        lines
    }

    /// The groove in which each line crosses the plane of the peaks.
    fn grooves_at_peaks(&self, lines: &Lines) -> [Groove; LANES] {
        let radius_mm = radii_at_peaks(lines);
        // A line beside the lens is not within the last groove, which settles nothing.
        std::array::from_fn(|lane| self.grooves[self.groove_at(radius_mm[lane]).min(self.grooves.len() - 1)])
    }

    #[inline(always)]
    fn holds(&self, [x, y, _]: Vector) -> bool {
        (x.abs() <= self.half_size_mm[0]) & (y.abs() <= self.half_size_mm[1])
    }
}

/// Component `k` of the lines from image positions to pupil points.
pub(crate) fn launch(lines: &mut Lines, k: usize, at_peaks: &Linear, slope: &Linear, image_mm: &[f64], pupil: &[f64]) {
    at_peaks.fill(k, pupil, image_mm, &mut lines.at_peaks_mm[k]);
    slope.fill(k, pupil, image_mm, &mut lines.slope[k]);
}

/// Weights of lines that come from the sensor.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn weigh(lines: &Lines, axial_weight: f64, weight: &mut [f64]) {
    let slopes = lines.slope[0].iter().zip(&lines.slope[1]);
    for (weight, (gx, gy)) in weight.iter_mut().zip(slopes) {
        *weight = axial_weight * cos_fourth([*gx, *gy]);
    }
}

/// Takes the weight of lines that a stop at that depth does not pass, and counts them.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn block(lines: &Lines, stop: &Stop, depth_mm: f64, weight: &mut [f64]) -> u64 {
    let mut passes = [false; LANES];
    for ring in &stop.rings {
        for (lane, passes) in passes.iter_mut().enumerate() {
            let [x, y] = lines.get(lane).at(depth_mm);
            let (x, y) = (x - stop.centre_mm[0], y - stop.centre_mm[1]);
            *passes |= holds(ring, x * x + y * y);
        }
    }
    let mut blocked = 0;
    for (weight, passes) in weight.iter_mut().zip(passes) {
        blocked += u64::from((*weight > 0.0) & !passes);
        *weight = if passes { *weight } else { 0.0 };
    }
    blocked
}

/// Component `k` of the lines where z = 0, at a depth, and its slope by z, which grows by `z_per_depth`.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(crate) fn write_component(
    lines: &Lines,
    k: usize,
    front_depth_mm: f64,
    z_per_depth: f64,
    at_mm: &mut [f64],
    slope: &mut [f64],
) {
    let inputs = lines.at_peaks_mm[k].iter().zip(&lines.slope[k]);
    for ((at_mm, slope), (at_peaks_mm, per_depth)) in at_mm.iter_mut().zip(slope).zip(inputs) {
        *at_mm = at_peaks_mm + per_depth * front_depth_mm;
        *slope = z_per_depth * per_depth;
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn radii_at_peaks(lines: &Lines) -> [f64; LANES] {
    let mut radius_mm = [0.0; LANES];
    for (lane, radius_mm) in radius_mm.iter_mut().enumerate() {
        *radius_mm = lines.get(lane).radius_mm(0.0);
    }
    radius_mm
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn enter_flat_face(plate: &Plate, lines: &mut Lines) {
    for lane in 0..LANES {
        let outside = lines.get(lane);
        lines.set(lane, bent(plate, &outside, place(&outside, plate.thickness_mm), ALONG_AXIS, 1.0 / plate.index));
    }
}

/// From the glass out through the groove that each line both comes to and leaves by.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn leave_facets(plate: &Plate, grooves: &[Groove; LANES], lines: &mut Lines) {
    for (lane, groove) in grooves.iter().enumerate() {
        let inside = lines.get(lane);
        let exit = place(&inside, groove.facet.meets(&inside));
        let out = bent(plate, &inside, exit, groove.facet.normal(exit), plate.index);
        let (comes_mm, r_mm) = (inside.radius_mm(groove.floor_mm), inside.radius_mm(exit[2]));
        let next_peak_mm = groove.peak_mm + plate.pitch_mm;
        let comes_to_it = (groove.peak_mm <= comes_mm) & (comes_mm < next_peak_mm);
        let on_facet = (groove.peak_mm <= r_mm) & (r_mm <= groove.valley_mm);
        lines.set(lane, only_if(comes_to_it & on_facet & (out.radius_mm(0.0) < next_peak_mm), out));
    }
}

/// From outside in through the grooves and out through the flat face.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn enter_facets(plate: &Plate, grooves: &[Groove; LANES], lines: &mut Lines) {
    for (lane, groove) in grooves.iter().enumerate() {
        let outside = lines.get(lane);
        let entry = place(&outside, groove.facet.meets(&outside));
        let inside = bent(plate, &outside, entry, groove.facet.normal(entry), 1.0 / plate.index);
        let out = bent(plate, &inside, place(&inside, plate.thickness_mm), ALONG_AXIS, plate.index);
        let on_facet = plate.holds(place(&outside, 0.0)) & (outside.radius_mm(entry[2]) <= groove.valley_mm);
        // Deeper than the foot of its own groove's riser, or outside of it there.
        let foot_radius_mm = groove.peak_mm - plate.tan_draft * groove.foot_mm;
        let below_riser = (entry[2] >= groove.foot_mm) | (inside.radius_mm(groove.foot_mm) >= foot_radius_mm);
        lines.set(lane, only_if(on_facet & below_riser, out));
    }
}

#[inline(always)]
fn place(line: &Line, depth_mm: f64) -> Vector {
    let [x, y] = line.at(depth_mm);
    [x, y, depth_mm]
}

/// Behind a face with that normal at that place; NaN where [`Plate`] would say what stops the line.
#[inline(always)]
fn bent(plate: &Plate, line: &Line, place: Vector, normal: Vector, index_ratio: f64) -> Line {
    only_if(plate.holds(place), Line::through(place, refract(line.direction(), normal, index_ratio)))
}

#[inline(always)]
fn only_if(sure: bool, line: Line) -> Line {
    let [gx, gy] = line.slope;
    Line { slope: [if sure { gx } else { f64::NAN }, gy], ..line }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use twinpupil_instrument::{FresnelLens, GrooveSide};

    use super::*;
    use crate::plate::tests::lens;

    proptest! {
        #[test]
        fn what_is_settled_is_what_the_plate_says(
            x in -40.0..40.0_f64, y in -40.0..40.0_f64, gx in -0.5..0.5_f64, gy in -0.5..0.5_f64,
            step in 0.0..0.05_f64, draft_deg in 0.0..10.0_f64,
        ) {
            for side in [GrooveSide::Object, GrooveSide::Image] {
                let plate = Plate::new(&FresnelLens { draft_deg, ..lens(side) }, [1.49, 1.5]).unwrap();
                let mut lines = Lines::default();
                for lane in 0..LANES {
                    lines.set(lane, Line { at_peaks_mm: [x + step * lane as f64, y], slope: [gx, gy] });
                }
                let (through_flat, through_grooves) =
                    (plate.enter_flat_face_all(&lines), plate.enter_grooves_all(&lines));
                for lane in 0..LANES {
                    let line = lines.get(lane);
                    for (all, one) in [
                        (&through_flat, plate.enter_flat_face(&line)),
                        (&through_grooves, plate.enter_grooves(&line)),
                    ] {
                        prop_assert!(!all.is_settled(lane) || Ok(all.get(lane)) == one, "{:?} {one:?}", all.get(lane));
                    }
                }
            }
        }
    }

    #[test]
    fn nearly_all_rays_of_the_paper_are_settled() {
        for side in [GrooveSide::Object, GrooveSide::Image] {
            let plate = Plate::new(&lens(side), [1.49, 1.5]).unwrap();
            let mut lines = Lines::default();
            for lane in 0..LANES {
                // Chief rays of the telecentric band, from 6 to 10 mm off the axis to its focal point.
                let x_mm = 6.0 + 4.0 * lane as f64 / LANES as f64;
                let slope = x_mm / 100.0 * if side == GrooveSide::Object { -1.0 } else { 1.0 };
                lines.set(lane, Line { at_peaks_mm: [x_mm, 0.0], slope: [slope, 0.0] });
            }
            let out = match side {
                GrooveSide::Object => plate.enter_flat_face_all(&lines),
                GrooveSide::Image => plate.enter_grooves_all(&lines),
            };
            assert!((0..LANES).filter(|lane| out.is_settled(*lane)).count() >= 56, "{side:?}");
        }
    }
}
