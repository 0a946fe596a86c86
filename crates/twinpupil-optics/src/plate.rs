//! A ray through a Fresnel lens, facet by facet, in depths below the groove peaks.

use twinpupil_instrument::FresnelLens;

use crate::conic::Conic;
use crate::envelope::Envelope;
use crate::grooves::{Groove, grooves};
use crate::line::Line;
use crate::refraction::{Vector, refract};
use crate::{OpticsError, RayFate};

/// A Fresnel lens as a plate: grooves on one face, the other flat.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Plate {
    /// From the centre outwards; at least one.
    pub(crate) grooves: Vec<Groove>,
    pub(crate) pitch_mm: f64,
    pub(crate) tan_draft: f64,
    pub(crate) thickness_mm: f64,
    pub(crate) half_size_mm: [f64; 2],
    /// Refractive index in the band.
    pub(crate) index: f64,
    envelope: Envelope,
    /// Whether rays meet the envelope instead of facets and walls.
    pub(crate) is_smooth: bool,
}

/// The flat face's normal.
pub(crate) const ALONG_AXIS: Vector = [0.0, 0.0, 1.0];

impl Plate {
    /// With the index of its glass at the design wavelength, and in the band.
    pub(crate) fn new(lens: &FresnelLens, [design_index, index]: [f64; 2]) -> Result<Self, OpticsError> {
        Ok(Self {
            grooves: grooves(lens, design_index)?,
            pitch_mm: lens.groove_pitch_mm,
            tan_draft: lens.draft_deg.to_radians().tan(),
            thickness_mm: lens.thickness_mm,
            half_size_mm: lens.size_mm.map(|size_mm| 0.5 * size_mm),
            index,
            envelope: Envelope::of(lens, design_index),
            is_smooth: false,
        })
    }

    /// The same with grooves that are infinitely fine, and no walls.
    pub(crate) fn smoothed(self) -> Self {
        Self { is_smooth: true, ..self }
    }

    /// In through the flat face, out through a facet.
    pub(crate) fn enter_flat_face(&self, outside: &Line) -> Result<Line, RayFate> {
        let inside = self.through_flat_face(outside, 1.0 / self.index)?;
        Ok(self.leave_facet(&inside)?.1)
    }

    /// In through a facet, out through the flat face.
    pub(crate) fn enter_grooves(&self, outside: &Line) -> Result<Line, RayFate> {
        let (_, inside) = self.enter_facet(outside)?;
        self.through_flat_face(&inside, self.index)
    }

    /// From the glass out of a facet: where it is met, and the line beyond.
    pub(crate) fn leave_facet(&self, inside: &Line) -> Result<(Vector, Line), RayFate> {
        if self.is_smooth {
            return self.through_envelope(inside, self.index);
        }
        let (k, depth_mm) = self.facet_from_within(inside)?;
        let (place, out) = self.through_facet(inside, &self.grooves[k].facet, depth_mm, self.index)?;
        // The riser of the next groove stands up to the peaks: within it is within its cone.
        if out.radius_mm(0.0) >= self.peak_mm(k + 1) { Err(RayFate::GrooveWall) } else { Ok((place, out)) }
    }

    /// Into the glass through a facet: where it is met, and the line beyond.
    pub(crate) fn enter_facet(&self, outside: &Line) -> Result<(Vector, Line), RayFate> {
        self.on_lens(outside, 0.0)?;
        if self.is_smooth {
            return self.through_envelope(outside, 1.0 / self.index);
        }
        let (k, depth_mm) = self.facet_from_without(outside)?;
        let (place, inside) = self.through_facet(outside, &self.grooves[k].facet, depth_mm, 1.0 / self.index)?;
        // Heading inwards, it must pass below the foot of its own groove's riser.
        if depth_mm < self.grooves[k].foot_mm && self.before_riser(&inside, k) {
            return Err(RayFate::GrooveWall);
        }
        Ok((place, inside))
    }

    /// Depth of the facets at a distance from the axis, mm; NaN beyond the last.
    pub(crate) fn facet_depth_mm(&self, r_mm: f64) -> f64 {
        self.grooves.get(self.groove_at(r_mm)).map_or(f64::NAN, |groove| groove.facet.depth_mm(r_mm))
    }

    /// Behind the flat face.
    fn through_flat_face(&self, line: &Line, index_ratio: f64) -> Result<Line, RayFate> {
        bent(line, self.on_lens(line, self.thickness_mm)?, ALONG_AXIS, index_ratio)
    }

    /// Where the line meets a facet at a depth, and the line behind it.
    fn through_facet(
        &self,
        line: &Line,
        facet: &Conic,
        depth_mm: f64,
        index_ratio: f64,
    ) -> Result<(Vector, Line), RayFate> {
        let place = self.on_lens(line, depth_mm)?;
        Ok((place, bent(line, place, facet.normal(place), index_ratio)?))
    }

    /// Where the line meets the plane of the peaks, and the line behind it.
    fn through_envelope(&self, line: &Line, index_ratio: f64) -> Result<(Vector, Line), RayFate> {
        let place = self.on_lens(line, 0.0)?;
        Ok((place, bent(line, place, self.envelope.normal(place), index_ratio)?))
    }

    /// Facet and depth at which a line from outside first meets the grooves: always in the groove above which it
    /// comes in, for facets fall outwards from the peaks.
    fn facet_from_without(&self, line: &Line) -> Result<(usize, f64), RayFate> {
        let k = self.groove_at(line.radius_mm(0.0));
        let groove = self.grooves.get(k).ok_or(RayFate::MissedLens)?;
        let depth_mm = groove.facet.meets(line);
        if line.radius_mm(depth_mm) <= groove.valley_mm { Ok((k, depth_mm)) } else { Err(RayFate::GrooveWall) }
    }

    /// Facet and depth at which a line from the glass first meets the grooves, walking from groove to groove.
    fn facet_from_within(&self, line: &Line) -> Result<(usize, f64), RayFate> {
        let leaves_mm = line.radius_mm(0.0);
        let floor_mm = self.grooves.get(self.groove_at(leaves_mm)).or(self.grooves.last()).map_or(0.0, |g| g.floor_mm);
        let comes_mm = line.radius_mm(floor_mm);
        let outwards = leaves_mm >= comes_mm;
        let mut k = self.groove_at(comes_mm);
        loop {
            let groove = self.grooves.get(k).ok_or(RayFate::MissedLens)?;
            let depth_mm = groove.facet.meets(line);
            let r_mm = line.radius_mm(depth_mm);
            if groove.peak_mm <= r_mm && r_mm <= groove.valley_mm {
                return Ok((k, depth_mm));
            }
            // Outwards it passes below the valley into the next groove; inwards the riser may stand in its way.
            k = match k.checked_sub(1) {
                _ if outwards && groove.peak_mm <= leaves_mm => k + 1,
                Some(inner) if !outwards && self.before_riser(line, k) => inner,
                _ => return Err(RayFate::GrooveWall),
            };
        }
    }

    /// Whether a line, at the depth of its foot, is inside the riser that comes down from peak k.
    fn before_riser(&self, line: &Line, k: usize) -> bool {
        let foot_mm = self.grooves[k].foot_mm;
        line.radius_mm(foot_mm) < self.peak_mm(k) - self.tan_draft * foot_mm
    }

    pub(crate) fn groove_at(&self, r_mm: f64) -> usize {
        (r_mm / self.pitch_mm) as usize
    }

    fn peak_mm(&self, k: usize) -> f64 {
        k as f64 * self.pitch_mm
    }

    /// The point of a line at a depth, if it is within the lens.
    fn on_lens(&self, line: &Line, depth_mm: f64) -> Result<Vector, RayFate> {
        let [x, y] = line.at(depth_mm);
        let within = x.abs() <= self.half_size_mm[0] && y.abs() <= self.half_size_mm[1];
        if within { Ok([x, y, depth_mm]) } else { Err(RayFate::MissedLens) }
    }
}

/// Behind a face with that normal at that place.
fn bent(line: &Line, place: Vector, normal: Vector, index_ratio: f64) -> Result<Line, RayFate> {
    let direction = refract(line.direction(), normal, index_ratio);
    if direction[2].is_nan() {
        return Err(RayFate::TotalInternalReflection);
    }
    // Turned round by a steep facet, it would run along the grooves.
    if direction[2] > 0.0 { Ok(Line::through(place, direction)) } else { Err(RayFate::GrooveWall) }
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;
    use twinpupil_instrument::{Glass, GrooveSide};

    use super::*;
    use crate::paraxial::cardinal_points;

    pub(crate) fn lens(grooves: GrooveSide) -> FresnelLens {
        FresnelLens {
            focal_length_mm: 100.0,
            design_wavelength_nm: 587.6,
            material: "pmma".to_owned(),
            thickness_mm: 2.0,
            groove_pitch_mm: 0.25,
            draft_deg: 3.0,
            grooves,
            size_mm: [77.0, 77.0],
        }
    }

    fn plate(lens: &FresnelLens, wavelength_nm: f64) -> Plate {
        let glass = Glass::built_in("pmma", "lens.material").unwrap();
        Plate::new(lens, [lens.design_wavelength_nm, wavelength_nm].map(|nm| glass.index(nm).unwrap())).unwrap()
    }

    /// Where a ray that comes parallel to the axis from the object crosses it, and its slope: x = slope · (t − t₀).
    fn parallel_ray(lens: &FresnelLens, plate: &Plate, height_mm: f64) -> Result<(f64, f64), RayFate> {
        let line = Line { at_peaks_mm: [height_mm, 0.0], slope: [0.0, 0.0] };
        let n_d = Glass::built_in("pmma", "lens.material").unwrap().index(lens.design_wavelength_nm).unwrap();
        // t of the groove peaks, and the sense of depth.
        let (out, peaks_mm, sense) = match lens.grooves {
            GrooveSide::Object => (plate.enter_grooves(&line)?, lens.thickness_mm * (1.0 / n_d - 1.0), 1.0),
            GrooveSide::Image => (plate.enter_flat_face(&line)?, 0.0, -1.0),
        };
        let depth_on_axis_mm = -out.at_peaks_mm[0] / out.slope[0];
        Ok((peaks_mm + sense * depth_on_axis_mm, sense * out.slope[0]))
    }

    #[test]
    fn a_parallel_beam_meets_in_the_focal_point_at_the_design_wavelength() {
        for (grooves, tolerance_mm) in [(GrooveSide::Image, 1e-9), (GrooveSide::Object, 0.03)] {
            let lens = lens(grooves);
            let plate = plate(&lens, 587.6);
            for k in 1..100 {
                let (focus_mm, _) = parallel_ray(&lens, &plate, 0.03 + 0.2 * f64::from(k)).unwrap();
                assert!((focus_mm - 100.0).abs() < tolerance_mm, "{grooves:?} {k}: {focus_mm}");
            }
        }
    }

    #[test]
    fn real_rays_have_the_paraxial_focal_length_in_the_limit() {
        for grooves in [GrooveSide::Object, GrooveSide::Image] {
            let lens = FresnelLens { groove_pitch_mm: 0.01, ..lens(grooves) };
            for wavelength_nm in [400.0, 450.0, 587.6, 680.0, 1000.0] {
                let plate = plate(&lens, wavelength_nm);
                // Heights in the middle of a facet; the error is quadratic in the height.
                let [near, far] = [0.505, 1.005].map(|height_mm| {
                    let (_, slope) = parallel_ray(&lens, &plate, height_mm).unwrap();
                    (height_mm * height_mm, -height_mm / slope)
                });
                let limit_mm = near.1 - near.0 * (far.1 - near.1) / (far.0 - near.0);
                let paraxial_mm = cardinal_points(&lens, wavelength_nm).unwrap().focal_length_mm;
                let lensmaker_mm = 100.0
                    * (Glass::built_in("pmma", "lens.material").unwrap().index(587.6).unwrap() - 1.0)
                    / (plate.index - 1.0);
                assert!((paraxial_mm / lensmaker_mm - 1.0).abs() < 1e-12);
                assert!((limit_mm / lensmaker_mm - 1.0).abs() < 1e-6, "{wavelength_nm}: {limit_mm} {lensmaker_mm}");
            }
        }
    }

    #[test]
    fn rays_beside_the_lens_miss_it_and_slanted_ones_meet_risers() {
        let plate = plate(&lens(GrooveSide::Object), 587.6);
        let line = |x_mm: f64, slope: f64| Line { at_peaks_mm: [x_mm, 0.0], slope: [slope, 0.0] };
        assert_eq!(plate.enter_flat_face(&line(38.6, 0.0)), Err(RayFate::MissedLens));
        assert_eq!(plate.enter_grooves(&line(38.6, 0.0)), Err(RayFate::MissedLens));
        let walls = |slope: f64| {
            let rays = (0..2500).map(|k| plate.enter_grooves(&line(30.0 + 0.001 * f64::from(k), slope)));
            rays.filter(|ray| *ray == Err(RayFate::GrooveWall)).count()
        };
        // Straight down, a ray is lost if in the glass, on its way to the focus n f deep, it falls short of the foot
        // of the riser behind it: foot × 30/(n f) of every pitch.
        let groove = plate.grooves[125];
        let expected = 2500.0 * groove.depth_mm * (30.0 / (100.0 * plate.index)) / 0.25;
        assert!((walls(0.0) as f64 - expected).abs() < 0.15 * expected, "{} {expected}", walls(0.0));
        assert!(walls(0.5) > walls(0.0));
    }

    proptest! {
        #[test]
        fn light_goes_back_the_way_it_came(
            x in -38.0..38.0_f64, y in -38.0..38.0_f64, gx in -0.4..0.4_f64, gy in -0.4..0.4_f64,
            object in any::<bool>(), draft_deg in 0.0..10.0_f64,
        ) {
            let side = if object { GrooveSide::Object } else { GrooveSide::Image };
            let plate = plate(&FresnelLens { draft_deg, ..lens(side) }, 450.0);
            let line = Line { at_peaks_mm: [x, y], slope: [gx, gy] };
            let both = [
                plate.enter_flat_face(&line).ok().map(|out| plate.enter_grooves(&out)),
                plate.enter_grooves(&line).ok().map(|out| plate.enter_flat_face(&out)),
            ];
            for back in both.into_iter().flatten() {
                let back = back.expect("a ray that came through goes back");
                for k in 0..2 {
                    prop_assert!((back.at_peaks_mm[k] - line.at_peaks_mm[k]).abs() < 1e-9);
                    prop_assert!((back.slope[k] - line.slope[k]).abs() < 1e-10);
                }
            }
        }
    }
}
