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

use std::f64::consts::{FRAC_PI_2, TAU};

use twinpupil_instrument::{FresnelLens, GrooveSide, ImagePoint};

use crate::line::Line;
use crate::linear::Linear;
use crate::masks::Masks;
use crate::plate::Plate;
use crate::stop::Stop;
use crate::thin::ThinBand;
use crate::{Footprint, Glass, ObjectRays, OpticsError, PointImage, RayFate, RayLedger, RayStarts};

/// A pupil in front of the lens is aimed at by the ideal lens. Rays start over a disc wider by this factor, so that
/// the aberrations of the real lens leave no part of the pupil out; the pupil itself then stops those that miss it.
const AIM_MARGIN: f64 = 1.25;

/// Share by which a footprint exceeds the rays probed for it, for field curvature and coma between the probes.
const FOOTPRINT_MARGIN: f64 = 0.05;

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
    /// Distance of the plane of the peaks from the rear principal plane, t, mm.
    peaks_mm: f64,
    /// Depth of the front principal plane below the peaks, mm.
    front_depth_mm: f64,
    groove_pitch_mm: f64,
    masks: Masks,
    /// The same through an ideal lens, for first guesses.
    ideal: ThinBand,
    /// Apertures that can stop a ray, from the sensor outwards.
    stops: Vec<Stop>,
    /// Weight of a ray along the axis.
    axial_weight: f64,
}

/// A ray in image space: through the physical position `at_sensor_mm`, sideways per distance t.
#[derive(Debug, Clone, Copy)]
struct SensorRay {
    at_sensor_mm: [f64; 2],
    slope: [f64; 2],
}

/// A ray in object space.
#[derive(Debug, Clone, Copy)]
struct ObjectRay {
    at_front_mm: [f64; 2],
    slope: [f64; 2],
}

impl ObjectRay {
    fn at(&self, z_mm: f64) -> [f64; 2] {
        [0, 1].map(|k| self.at_front_mm[k] + self.slope[k] * z_mm)
    }
}

impl FresnelBand {
    pub(crate) fn new(lens: &FresnelLens, wavelength_nm: f64, masks: &Masks) -> Result<Self, OpticsError> {
        let glass = Glass::from_name(&lens.material)?;
        // The principal plane within the glass lies thickness/n from the flat face.
        let below_peaks_mm = lens.thickness_mm * (1.0 - 1.0 / glass.index(lens.design_wavelength_nm)?);
        let (peaks_mm, front_depth_mm) = match lens.grooves {
            GrooveSide::Object => (-below_peaks_mm, 0.0),
            GrooveSide::Image => (0.0, below_peaks_mm),
        };
        let pupil = masks.pupil();
        let in_front = pupil.position_mm < 0.0;
        let aimed = if in_front { AIM_MARGIN * AIM_MARGIN } else { 1.0 };
        let stops = masks.stops.iter().filter(|stop| {
            let always_met = !in_front && std::ptr::eq(*stop, pupil) && pupil.is_full();
            !(stop.is_open() || always_met)
        });
        let mut stops: Vec<Stop> = stops.cloned().collect();
        stops.sort_by(|a, b| b.position_mm.total_cmp(&a.position_mm));
        Ok(Self {
            plate: Plate::new(lens, glass.index(wavelength_nm)?)?,
            side: lens.grooves,
            peaks_mm,
            front_depth_mm,
            groove_pitch_mm: lens.groove_pitch_mm,
            ideal: ThinBand::new(masks),
            stops,
            axial_weight: aimed / pupil.filled_fraction(masks.pupil_radius_mm),
            masks: masks.clone(),
        })
    }

    pub(crate) fn trace(&self, starts: RayStarts<'_>, rays: &mut ObjectRays, ledger: &mut RayLedger) {
        let count = starts.len();
        rays.resize(count);
        for k in 0..count {
            let image_mm = [starts.image_x_mm[k], starts.image_y_mm[k]];
            let (ray, weight) = self.launch(image_mm, [starts.pupil_x[k], starts.pupil_y[k]]);
            let (fate, found, weight) = match self.follow(&ray) {
                Ok(found) => (RayFate::Arrived, found, weight),
                Err(fate) => (fate, ObjectRay { at_front_mm: [0.0; 2], slope: [0.0; 2] }, 0.0),
            };
            ledger.record(fate);
            [rays.x_mm[k], rays.y_mm[k]] = found.at_front_mm;
            [rays.slope_x[k], rays.slope_y[k]] = found.slope;
            rays.weight[k] = weight;
        }
    }

    /// The ray from an upright image position to a point of the unit disc on the pupil, and its weight.
    fn launch(&self, image_mm: [f64; 2], pupil: [f64; 2]) -> (SensorRay, f64) {
        let (masks, stop) = (&self.masks, self.masks.pupil());
        let at_sensor_mm = image_mm.map(|p| -p);
        let (radius_mm, t) = (masks.pupil_radius_mm, stop.position_mm);
        let (l, t_aimed_mm) = (masks.sensor_distance_mm, t.max(0.0));
        let aimed_mm = [0, 1].map(|k| {
            if t >= 0.0 {
                return stop.centre_mm[k] + radius_mm * pupil[k];
            }
            // a = (m − β s)/α through the ideal lens.
            let m = stop.centre_mm[k] + AIM_MARGIN * radius_mm * pupil[k];
            (m - t / l * at_sensor_mm[k]) / masks.sensor_pencil(t)
        });
        let slope = [0, 1].map(|k| (at_sensor_mm[k] - aimed_mm[k]) / (l - t_aimed_mm));
        let cos_squared = 1.0 / (1.0 + slope[0] * slope[0] + slope[1] * slope[1]);
        (SensorRay { at_sensor_mm, slope }, self.axial_weight * cos_squared * cos_squared)
    }

    /// Through all apertures and the lens.
    fn follow(&self, ray: &SensorRay) -> Result<ObjectRay, RayFate> {
        self.check_behind(ray)?;
        let found = self.refract(ray)?;
        self.check_in_front(&found)?;
        Ok(found)
    }

    /// Through the apertures behind the lens.
    fn check_behind(&self, ray: &SensorRay) -> Result<(), RayFate> {
        let l = self.masks.sensor_distance_mm;
        let mut behind = self.stops.iter().take_while(|stop| stop.position_mm >= 0.0);
        behind.try_for_each(|stop| {
            stop.check([0, 1].map(|k| ray.at_sensor_mm[k] - ray.slope[k] * (l - stop.position_mm)))
        })
    }

    /// Through the apertures in front of the lens.
    fn check_in_front(&self, ray: &ObjectRay) -> Result<(), RayFate> {
        let mut in_front = self.stops.iter().skip_while(|stop| stop.position_mm >= 0.0);
        in_front.try_for_each(|stop| stop.check(ray.at(-stop.position_mm)))
    }

    /// Through the lens alone.
    fn refract(&self, ray: &SensorRay) -> Result<ObjectRay, RayFate> {
        let to_peaks_mm = self.masks.sensor_distance_mm - self.peaks_mm;
        let at_peaks_mm = [0, 1].map(|k| ray.at_sensor_mm[k] - ray.slope[k] * to_peaks_mm);
        // Depth grows with t if the grooves face the object, against it if they face the image; z runs against t.
        let (out, against) = match self.side {
            GrooveSide::Object => (self.plate.enter_flat_face(&Line { at_peaks_mm, slope: ray.slope })?, -1.0),
            GrooveSide::Image => {
                (self.plate.enter_grooves(&Line { at_peaks_mm, slope: ray.slope.map(|slope| -slope) })?, 1.0)
            }
        };
        Ok(ObjectRay { at_front_mm: out.at(self.front_depth_mm), slope: out.slope.map(|slope| against * slope) })
    }

    /// Circle about rays from the rim of the pupil and the rim of the image disc, with a margin: 5 % of its radius for
    /// what lies between them, and one groove pitch for the steps from facet to facet. Where no ray gets through to
    /// show the way, the circle of the ideal lens, with 25 %.
    pub(crate) fn footprint(&self, centre: ImagePoint, radius_mm: f64, z_mm: f64) -> Footprint {
        let image = rim(6).chain([[0.0, 0.0]]);
        let points: Vec<[f64; 2]> = image
            .flat_map(|[x, y]| {
                let from = [centre.x_mm + radius_mm * x, centre.y_mm + radius_mm * y];
                rim(12).chain([[0.0, 0.0]]).map(move |pupil| (from, pupil))
            })
            .filter_map(|(from, pupil)| Some(self.refract(&self.launch(from, pupil).0).ok()?.at(z_mm)))
            .collect();
        let ideal = self.ideal.footprint(centre, radius_mm, z_mm);
        if points.is_empty() {
            return Footprint { radius_mm: (1.0 + 5.0 * FOOTPRINT_MARGIN) * ideal.radius_mm, ..ideal };
        }
        let mean = |k: usize| points.iter().map(|point| point[k]).sum::<f64>() / points.len() as f64;
        let (x_mm, y_mm) = (mean(0), mean(1));
        let reach_mm = points.iter().map(|point| (point[0] - x_mm).hypot(point[1] - y_mm)).fold(0.0, f64::max);
        Footprint { x_mm, y_mm, radius_mm: (1.0 + FOOTPRINT_MARGIN) * reach_mm + self.groove_pitch_mm }
    }

    /// Average over 160 rays that meet the object point, found by aiming them from the sensor.
    ///
    /// A bundle of unit density over sensor and pupil has the density 1/|∂x/∂p| over the object, which makes each
    /// ray's share its weight over that determinant; the ideal lens's determinant is the unit.
    pub(crate) fn point_image(&self, object_mm: [f64; 3]) -> PointImage {
        let map = self.ideal.object_map(object_mm[2]);
        let (mut light, mut moment) = (0.0, [0.0, 0.0]);
        for pupil in quadrants(RAYS_PER_QUADRANT) {
            if let Some((share, image_mm)) = self.aimed_share(&map, object_mm, pupil) {
                light += share;
                moment = [moment[0] + share * image_mm[0], moment[1] + share * image_mm[1]];
            }
        }
        if light == 0.0 {
            return PointImage { throughput: 0.0, centroid: self.masks.point_image(object_mm).centroid };
        }
        PointImage {
            throughput: light / (4 * RAYS_PER_QUADRANT) as f64,
            centroid: ImagePoint { x_mm: moment[0] / light, y_mm: moment[1] / light },
        }
    }

    /// Share and upright image position of the ray through a pupil point and the object point, if it gets through.
    fn aimed_share(&self, map: &Linear, object_mm: [f64; 3], pupil: [f64; 2]) -> Option<(f64, [f64; 2])> {
        let (image_mm, ray) = self.aim(map, object_mm, pupil)?;
        let (start, weight) = self.launch(image_mm, pupil);
        self.check_behind(&start).and_then(|()| self.check_in_front(&ray)).ok()?;
        let (z_mm, at_mm) = (object_mm[2], ray.at(object_mm[2]));
        let derivative = |k: usize| {
            let mut beside_mm = image_mm;
            beside_mm[k] += DERIVATIVE_STEP_MM;
            let moved_mm = self.refract(&self.launch(beside_mm, pupil).0).ok()?.at(z_mm);
            Some([0, 1].map(|j| (moved_mm[j] - at_mm[j]) / DERIVATIVE_STEP_MM))
        };
        let unit = map.per_image * map.per_image;
        let determinant = match (derivative(0), derivative(1)) {
            (Some(x), Some(y)) => (x[0] * y[1] - x[1] * y[0]).abs(),
            // A riser next door says nothing about this ray.
            _ => unit,
        };
        Some((weight * unit / determinant, image_mm))
    }

    /// The upright image position whose ray through a pupil point meets the object point, and that ray in object
    /// space, if the lens lets it through.
    fn aim(&self, map: &Linear, object_mm: [f64; 3], pupil: [f64; 2]) -> Option<([f64; 2], ObjectRay)> {
        let mut image_mm = [0, 1].map(|k| (object_mm[k] - map.component(k, pupil[k], 0.0)) / map.per_image);
        // Newton's method with the ideal lens's derivative, which the real one's differs from by some per cent.
        for _ in 0..NEWTON_STEPS {
            let ray = self.refract(&self.launch(image_mm, pupil).0).ok()?;
            let at_mm = ray.at(object_mm[2]);
            let miss_mm = [object_mm[0] - at_mm[0], object_mm[1] - at_mm[1]];
            if miss_mm[0].hypot(miss_mm[1]) < AIM_TOLERANCE_MM {
                return Some((image_mm, ray));
            }
            image_mm = [0, 1].map(|k| image_mm[k] + miss_mm[k] / map.per_image);
        }
        None
    }
}

/// Points on the unit circle.
fn rim(count: usize) -> impl Iterator<Item = [f64; 2]> {
    (0..count).map(move |k| {
        let (sin, cos) = (k as f64 / count as f64 * TAU).sin_cos();
        [cos, sin]
    })
}

/// Points that fill the unit disc evenly, mirrored from quadrant to quadrant: their centroid is the centre.
///
/// Azimuths follow the golden section. No two radii of a quadrant are alike, for rings of points would beat with the
/// rings of grooves.
fn quadrants(count: usize) -> impl Iterator<Item = [f64; 2]> {
    (0..count).flat_map(move |k| {
        let radius = ((k as f64 + 0.5) / count as f64).sqrt();
        let (sin, cos) = ((k as f64 * GOLDEN_SECTION).fract() * FRAC_PI_2).sin_cos();
        let (x, y) = (radius * cos, radius * sin);
        [[x, y], [-x, y], [-x, -y], [x, -y]]
    })
}

const GOLDEN_SECTION: f64 = 0.618_033_988_749_894_9;
