//! One band of a camera with a Fresnel lens, traced facet by facet.
//!
//! # Where the lens stands
//!
//! The object's z counts from the front principal plane of the lens at its design wavelength, the t of the apertures
//! and the sensor from the rear one. One of the two is the plane of the groove peaks; the other lies thickness/n
//! behind the flat face, within the glass. Apertures at t ≥ 0 act on the image-space ray and those at t < 0 on the
//! object-space ray, each extended in a straight line where it would lie within the lens.
//!
//! # Radiometry
//!
//! The irradiance of a sensor point through an area A of the pupil's plane is `E = radiance · cos⁴θ · A/(L − t)²`,
//! θ between the image-side ray and the axis; weights are relative to the axis. Losses by reflection are left out.

use twinpupil_instrument::{FresnelLens, Glass, GrooveSide, ImagePoint};

use crate::lanes::{self, LANES, Lines};
use crate::line::{Line, cos_fourth};
use crate::linear::Linear;
use crate::masks::Masks;
use crate::plate::Plate;
use crate::point_image::{Added, minus, spread};
use crate::spread::quadrants;
use crate::stop::Stop;
use crate::stray::{Stray, probes};
use crate::thin::ThinBand;
use crate::{ObjectRays, OpticsError, Pencil, PointImage, RayFate, RayLedger, RayStarts};

/// A pupil in front of the lens is aimed at by the ideal lens. Rays start over a disc wider by this factor, so that
/// the aberrations of the real lens leave no part of the pupil out; the pupil itself then stops those that miss it.
const AIM_MARGIN: f64 = 1.25;

/// Share of the pitch by which rays may stray beyond that, where all probes happen to meet the same few facets.
const STRAY_PER_PITCH: f64 = 0.01;

/// Rays from each place that are probed for a pencil, in each quadrant of the pupil.
const PROBES_PER_QUADRANT: usize = 5;

/// Rays over which the image of a point is averaged, in each quadrant of the pupil.
const RAYS_PER_QUADRANT: usize = 40;

/// How far from the object point a ray may pass that counts as its own, mm.
const AIM_TOLERANCE_MM: f64 = 1e-6;

/// Enough for any ray that can be aimed at all; three or four are usual.
const NEWTON_STEPS: usize = 20;

/// Step of finite differences on the sensor, mm: far smaller than a groove, far larger than rounding.
const DERIVATIVE_STEP_MM: f64 = 1e-5;

/// One band of a camera with a Fresnel lens.
#[derive(Debug, Clone)]
pub(crate) struct FresnelBand {
    plate: Plate,
    side: GrooveSide,
    /// Depth of the front principal plane below the peaks, mm.
    front_depth_mm: f64,
    masks: Masks,
    /// The same through an ideal lens, for first guesses.
    ideal: ThinBand,
    /// Where rays from the sensor cross the plane of the peaks, mm.
    at_peaks: Linear,
    /// Their sideways step per depth below the peaks.
    slope: Linear,
    /// Apertures behind the lens that can stop a ray, from the sensor inwards, by depth below the peaks, mm.
    behind: Vec<(f64, Stop)>,
    /// Apertures in front of the lens, from there outwards.
    in_front: Vec<(f64, Stop)>,
    /// Weight of a ray along the axis.
    axial_weight: f64,
}

impl FresnelBand {
    pub(crate) fn new(lens: &FresnelLens, wavelength_nm: f64, masks: &Masks) -> Result<Self, OpticsError> {
        let glass = Glass::built_in(&lens.material, "lens.material")?;
        // The principal plane within the glass lies thickness/n from the flat face.
        let below_peaks_mm = lens.thickness_mm * (1.0 - 1.0 / glass.index(lens.design_wavelength_nm)?);
        // Depth grows with t if the grooves face the object, against it if they face the image.
        let (per_t, rear_depth_mm, front_depth_mm) = match lens.grooves {
            GrooveSide::Object => (1.0, below_peaks_mm, 0.0),
            GrooveSide::Image => (-1.0, 0.0, below_peaks_mm),
        };
        let pupil = masks.pupil();
        let aimed = if pupil.position_mm < 0.0 { AIM_MARGIN * AIM_MARGIN } else { 1.0 };
        let slope = aimed_slope(masks).scaled(per_t);
        let sensor_depth_mm = rear_depth_mm + per_t * masks.sensor_distance_mm;
        let (behind, in_front): (Vec<_>, Vec<_>) =
            stops_to_check(masks).into_iter().partition(|stop| stop.position_mm >= 0.0);
        let by_depth = |stops: Vec<Stop>, principal_depth_mm: f64| {
            stops.into_iter().map(|stop| (principal_depth_mm + per_t * stop.position_mm, stop)).collect()
        };
        Ok(Self {
            plate: Plate::new(lens, [glass.index(lens.design_wavelength_nm)?, glass.index(wavelength_nm)?])?,
            side: lens.grooves,
            front_depth_mm,
            ideal: ThinBand::new(masks),
            // Back from the sensor, where s = −p.
            at_peaks: slope.scaled(-sensor_depth_mm).plus_image(-1.0),
            slope,
            behind: by_depth(behind, rear_depth_mm),
            in_front: by_depth(in_front, front_depth_mm),
            axial_weight: aimed / pupil.filled_fraction(masks.pupil_radius_mm),
            masks: masks.clone(),
        })
    }

    /// The same with grooves that are infinitely fine.
    pub(crate) fn smoothed(self) -> Self {
        Self { plate: self.plate.smoothed(), ..self }
    }

    pub(crate) fn trace(&self, starts: RayStarts<'_>, rays: &mut ObjectRays, ledger: &mut RayLedger) {
        let count = starts.len();
        rays.resize(count);
        ledger.launched += count as u64;
        for first in (0..count).step_by(LANES) {
            let block = first..count.min(first + LANES);
            let weight = &mut rays.weight[block.clone()];
            let lines = self.launch_all(starts.slice(block.clone()), weight);
            block_all(&self.behind, &lines, weight, ledger);
            let out = self.refract_all(&lines, weight, ledger);
            block_all(&self.in_front, &out, weight, ledger);
            ledger.arrived += weight.iter().filter(|weight| **weight > 0.0).count() as u64;
            let (front_depth_mm, z_per_depth) = (self.front_depth_mm, self.z_per_depth());
            for (k, at_mm, slope) in [(0, &mut rays.x_mm, &mut rays.slope_x), (1, &mut rays.y_mm, &mut rays.slope_y)] {
                let (at_mm, slope) = (&mut at_mm[block.clone()], &mut slope[block.clone()]);
                lanes::write_component(&out, k, front_depth_mm, z_per_depth, at_mm, slope);
            }
        }
    }

    /// The rays of a block by depth below the peaks, and their weights.
    fn launch_all(&self, starts: RayStarts<'_>, weight: &mut [f64]) -> Lines {
        let mut lines = Lines::default();
        lanes::launch(&mut lines, 0, &self.at_peaks, &self.slope, starts.image_x_mm, starts.pupil_x);
        lanes::launch(&mut lines, 1, &self.at_peaks, &self.slope, starts.image_y_mm, starts.pupil_y);
        lanes::weigh(&lines, self.axial_weight, weight);
        lines
    }

    /// Lines through the lens; those that do not get through lose their weight.
    fn refract_all(&self, lines: &Lines, weight: &mut [f64], ledger: &mut RayLedger) -> Lines {
        let mut out = match self.side {
            GrooveSide::Object => self.plate.enter_flat_face_all(lines),
            GrooveSide::Image => self.plate.enter_grooves_all(lines),
        };
        for (lane, weight) in weight.iter_mut().enumerate() {
            if *weight > 0.0 && !out.is_settled(lane) {
                match self.refract(&lines.get(lane)) {
                    Ok(found) => out.set(lane, found),
                    Err(fate) => {
                        ledger.settle(fate);
                        *weight = 0.0;
                    }
                }
            }
        }
        out
    }

    /// The ray from an upright image position to a point of the unit disc on the pupil, by depth below the peaks.
    fn launch(&self, image_mm: [f64; 2], pupil: [f64; 2]) -> Line {
        let along = |linear: &Linear| [0, 1].map(|k| linear.component(k, pupil[k], image_mm[k]));
        Line { at_peaks_mm: along(&self.at_peaks), slope: along(&self.slope) }
    }

    /// Through the lens alone.
    fn refract(&self, line: &Line) -> Result<Line, RayFate> {
        match self.side {
            GrooveSide::Object => self.plate.enter_flat_face(line),
            GrooveSide::Image => self.plate.enter_grooves(line),
        }
    }

    /// How z grows with the depth below the peaks: ±1.
    fn z_per_depth(&self) -> f64 {
        match self.side {
            GrooveSide::Object => -1.0,
            GrooveSide::Image => 1.0,
        }
    }

    /// Depth below the peaks of the plane at distance z, mm.
    fn depth_mm(&self, z_mm: f64) -> f64 {
        self.front_depth_mm + self.z_per_depth() * z_mm
    }

    /// The ideal lens's pencil, moved to where rays from all over the pupil and from the centre and the rim of the image
    /// disc are on the average.
    pub(crate) fn pencil(&self, centre: ImagePoint, radius_mm: f64) -> Pencil {
        let ideal = self.ideal.pencil(centre, radius_mm);
        let starts = probes(centre, radius_mm, PROBES_PER_QUADRANT);
        let strays: Vec<Stray> = starts.filter_map(|(image_mm, pupil)| self.stray(&ideal, image_mm, pupil)).collect();
        let facet_mm = STRAY_PER_PITCH * self.plate.pitch_mm;
        ideal.strayed(&strays, [facet_mm, facet_mm / self.masks.focal_length_mm])
    }

    /// How far a ray through the lens is from the ideal one.
    fn stray(&self, ideal: &Pencil, image_mm: [f64; 2], pupil: [f64; 2]) -> Option<Stray> {
        let out = self.refract(&self.launch(image_mm, pupil)).ok()?;
        let at_mm = out.at(self.front_depth_mm);
        let from = |linear: &Linear, k: usize| linear.component(k, pupil[k], image_mm[k]);
        Some(Stray {
            position_mm: [0, 1].map(|k| at_mm[k] - from(&ideal.lens, k)),
            slope: [0, 1].map(|k| self.z_per_depth() * out.slope[k] - from(&ideal.slope, k)),
        })
    }

    /// Average over 160 rays that meet the object point, found by aiming them from the sensor.
    ///
    /// A bundle of unit density over sensor and pupil has the density 1/|∂x/∂p| over the object, which makes each
    /// ray's share its weight over that determinant; the ideal lens's determinant is the unit.
    pub(crate) fn point_image(&self, object_mm: [f64; 3]) -> PointImage {
        let map = self.ideal.object_map(object_mm[2]);
        let (mut light, mut moment, mut weighed) = (0.0, [0.0, 0.0], [0.0, 0.0]);
        let (mut added, mut weights) = (Vec::with_capacity(4 * RAYS_PER_QUADRANT), 0.0);
        let object_xy_mm = [object_mm[0], object_mm[1]];
        for pupil in quadrants(RAYS_PER_QUADRANT).filter(|point| self.masks.is_open(*point)) {
            let Some(Arrival { weight, share, image_mm, passes }) = self.arrival(&map, object_mm, pupil) else {
                continue;
            };
            let added_mm = minus(image_mm, map.image_mm(object_xy_mm, pupil));
            added.push(Added { pupil, added_mm, weight });
            weights += weight;
            weighed = [0, 1].map(|k| weighed[k] + weight * image_mm[k]);
            if passes {
                light += share;
                moment = [0, 1].map(|k| moment[k] + share * image_mm[k]);
            }
        }
        let ideal = self.masks.point_image(object_mm);
        if added.is_empty() {
            return PointImage { throughput: 0.0, ..ideal };
        }
        // The middle of the ideal lens's rays.
        let chief_mm = map.image_mm(object_xy_mm, [0.0; 2]);
        let lit = light > 0.0;
        let [x_mm, y_mm] = moment.map(|moment| moment / light);
        PointImage {
            throughput: light / (4 * RAYS_PER_QUADRANT) as f64,
            centroid: if lit { ImagePoint { x_mm, y_mm } } else { ideal.centroid },
            aberration_mm: minus(weighed.map(|weighed| weighed / weights), chief_mm),
            spread: spread(object_mm, &added),
        }
    }

    /// How the ray through a pupil point and the object point arrives, if it gets through the lens.
    fn arrival(&self, map: &Linear, object_mm: [f64; 3], pupil: [f64; 2]) -> Option<Arrival> {
        let (image_mm, ray) = self.aim(map, object_mm, pupil)?;
        let start = self.launch(image_mm, pupil);
        let passes = check(&self.behind, &start).and_then(|()| check(&self.in_front, &ray)).is_ok();
        let (depth_mm, at_mm) = (self.depth_mm(object_mm[2]), ray.at(self.depth_mm(object_mm[2])));
        let derivative = |k: usize| {
            let mut beside_mm = image_mm;
            beside_mm[k] += DERIVATIVE_STEP_MM;
            let moved_mm = self.refract(&self.launch(beside_mm, pupil)).ok()?.at(depth_mm);
            Some([0, 1].map(|j| (moved_mm[j] - at_mm[j]) / DERIVATIVE_STEP_MM))
        };
        let unit = map.per_image * map.per_image;
        let determinant = match (derivative(0), derivative(1)) {
            (Some(x), Some(y)) => (x[0] * y[1] - x[1] * y[0]).abs(),
            // A riser next door says nothing about this ray.
            _ => unit,
        };
        let weight = self.axial_weight * cos_fourth(start.slope);
        Some(Arrival { weight, share: weight * unit / determinant, image_mm, passes })
    }

    /// The upright image position whose ray through a pupil point meets the object point, and that ray in object
    /// space, if the lens lets it through.
    fn aim(&self, map: &Linear, object_mm: [f64; 3], pupil: [f64; 2]) -> Option<([f64; 2], Line)> {
        let mut image_mm = map.image_mm([object_mm[0], object_mm[1]], pupil);
        // Newton's method with the ideal lens's derivative, which the real one's differs from by some per cent.
        for _ in 0..NEWTON_STEPS {
            let ray = self.refract(&self.launch(image_mm, pupil)).ok()?;
            let at_mm = ray.at(self.depth_mm(object_mm[2]));
            let miss_mm = [object_mm[0] - at_mm[0], object_mm[1] - at_mm[1]];
            if miss_mm[0].hypot(miss_mm[1]) < AIM_TOLERANCE_MM {
                return Some((image_mm, ray));
            }
            image_mm = [0, 1].map(|k| image_mm[k] + miss_mm[k] / map.per_image);
        }
        None
    }
}

/// A ray from an object point that the lens lets through.
struct Arrival {
    /// What it counts for a pixel.
    weight: f64,
    /// What it counts of the light of the point.
    share: f64,
    image_mm: [f64; 2],
    /// Whether the masks let it through as well.
    passes: bool,
}

/// Apertures that can stop a ray, from the sensor outwards.
fn stops_to_check(masks: &Masks) -> Vec<Stop> {
    let pupil = masks.pupil();
    let always_met = |stop: &Stop| std::ptr::eq(stop, pupil) && pupil.is_full() && pupil.position_mm >= 0.0;
    let mut stops: Vec<Stop> =
        masks.stops.iter().filter(|stop| !stop.is_open() && !always_met(stop)).cloned().collect();
    stops.sort_by(|a, b| b.position_mm.total_cmp(&a.position_mm));
    stops
}

/// Slope per t of the ray from an image position p, which is the sensor point s = −p, to a pupil point.
fn aimed_slope(masks: &Masks) -> Linear {
    let (l, pupil) = (masks.sensor_distance_mm, masks.pupil());
    let (t, aim_mm) = (pupil.position_mm, masks.pupil_radius_mm);
    let on_pupil = |per_pupil: f64| Linear { per_pupil, per_image: 0.0, constant: pupil.centre_mm };
    if t >= 0.0 {
        return on_pupil(aim_mm).plus_image(1.0).scaled(-1.0 / (l - t));
    }
    // Through the ideal lens, a = (m − s t/L)/α.
    let at_lens = on_pupil(AIM_MARGIN * aim_mm).plus_image(t / l).scaled(1.0 / masks.sensor_pencil(t));
    at_lens.plus_image(1.0).scaled(-1.0 / l)
}

/// Through apertures by depth.
fn check(stops: &[(f64, Stop)], line: &Line) -> Result<(), RayFate> {
    stops.iter().try_for_each(|(depth_mm, stop)| stop.check(line.at(*depth_mm)))
}

/// Takes the weight of lines that the apertures stop.
fn block_all(stops: &[(f64, Stop)], lines: &Lines, weight: &mut [f64], ledger: &mut RayLedger) {
    for (depth_mm, stop) in stops {
        *ledger.blocked_by(stop.aperture) += lanes::block(lines, stop, *depth_mm, weight);
    }
}
