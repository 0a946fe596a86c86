//! One band of a camera whose lens is given surface by surface.
//!
//! # Where things are
//!
//! The object's z counts from the front principal plane at the design wavelength; the sensor stands `distance_mm` behind
//! the rear one, and masks among the surfaces where they are stated. The axes of the prescription follow the right hand
//! with z along the light, so its y points up where that of the object points down.
//!
//! # Radiometry
//!
//! Rays leave the sensor towards places a in the band's rear principal plane, L behind which the sensor lies. Of light
//! through an area A there the irradiance is `radiance · cos⁴θ · A/L²`, θ between ray and axis, and A follows from the
//! pupil by [`Aim`]. Weights are relative to the axis of the ideal lens. Where one of the surfaces is an ideal lens there is
//! no cos⁴θ, as for the model `thin`. Losses by reflection are left out.

use twinpupil_instrument::{Band, ImagePoint, Instrument, LensStand, MaskPlace, Prescription, PrescriptionLens, Shape};

use crate::aim::{Aim, Sample};
use crate::launch::{Launch, Places, arrive};
use crate::linear::Linear;
use crate::masks::Masks;
use crate::point_image::{Added, minus, spread};
use crate::ray_map::{Start, Traced};
use crate::spread::quadrants;
use crate::stop::Stop;
use crate::stray::{Stray, probes};
use crate::thin::ThinBand;
use crate::train::{Aiming, Block, LANES, Seeker};
use crate::{
    Fate, Mask, ObjectRays, OpticsError, Pencil, PointImage, Ray, RayFate, RayLedger, RayMap, RayStarts, Train,
};

/// Rays from each place that are probed for a pencil, in each quadrant of the pupil: with seven places one block.
const PROBES_PER_QUADRANT: usize = 4;

/// Rays over which the image of a point is averaged, in each quadrant of the pupil: one block of them.
pub(crate) const RAYS_PER_QUADRANT: usize = LANES / 4;

/// The same where speed counts more than the last digits.
pub(crate) const FEW_RAYS_PER_QUADRANT: usize = 4;

/// How far from the object point a ray may pass that counts as its own, mm.
const AIM_TOLERANCE_MM: f64 = 1e-7;

/// Enough for any ray that can be aimed at all.
const AIM_STEPS: usize = 20;

/// Share of the pitch of grooves by which rays may stray beyond that, where all probes happen to meet the same few facets.
const STRAY_PER_PITCH: f64 = 0.01;

/// Step of finite differences on the sensor, mm.
const DERIVATIVE_STEP_MM: f64 = 1e-4;

/// Places on the sensor, and in the pupil for each, from which the aim is learnt.
const AIM_PLACES: [usize; 2] = [12, 8];

/// One band of a camera with a lens surface by surface.
#[derive(Debug, Clone)]
pub(crate) struct PrescribedBand {
    /// From the sensor through the masks to the plane z = 0.
    train: Train,
    /// The same without masks.
    lens: Train,
    aim: Aim,
    /// The same through an ideal lens.
    ideal: ThinBand,
    masks: Masks,
    /// The masks that are not open to all, as rays from the sensor meet them, and the surfaces as far as each.
    stops: Vec<Stop>,
    to_stops: Vec<Train>,
    is_paraxial: bool,
    /// Widest of the grooves that surfaces have, mm; 0 without any.
    pitch_mm: f64,
    /// Weight of a ray along the axis.
    axial_weight: f64,
}

/// The lens of a camera in one band, light coming from the object.
pub(crate) struct BandTrain {
    /// Without masks.
    lens: Train,
    pub(crate) with_masks: Train,
    places: Vec<MaskPlace>,
    /// From the first vertex.
    pub(crate) front_principal_mm: f64,
    prescription: Prescription,
}

impl BandTrain {
    pub(crate) fn new(instrument: &Instrument, lens: &PrescriptionLens, band: &Band) -> Result<Self, OpticsError> {
        let LensStand { prescription, front_principal_mm, .. } = lens.stand(instrument.sensor.distance_mm)?;
        let places = lens.places(&instrument.apertures)?;
        let surfaces = Train::new(&prescription, &[], band.wavelength_nm)?;
        let mut order: Vec<usize> = (0..places.len()).collect();
        // Each is put next to its surface: the farthest one first.
        order.sort_by(|a, b| places[*b].behind_mm.abs().total_cmp(&places[*a].behind_mm.abs()));
        let with_masks = order.iter().fold(surfaces.clone(), |train, &index| {
            let ([x_mm, y_mm], place) = (instrument.apertures[index].centre_mm, places[index]);
            let rings = instrument.apertures[index].annuli(&band.name);
            let centre_mm = [x_mm, -y_mm];
            train.with_mask(index, &Mask { surface: place.surface, behind_mm: place.behind_mm, centre_mm, rings })
        });
        Ok(Self { lens: surfaces, with_masks, places, front_principal_mm, prescription })
    }
}

impl PrescribedBand {
    pub(crate) fn new(
        instrument: &Instrument,
        lens: &PrescriptionLens,
        band: &Band,
        masks: &Masks,
    ) -> Result<Self, OpticsError> {
        let BandTrain { lens: surfaces, with_masks, places, front_principal_mm, prescription } =
            BandTrain::new(instrument, lens, band)?;
        let ends = |train: Train| train.with_end_plane(instrument.apertures.len(), front_principal_mm).reversed();
        let pupil = masks.pupil();
        let is_ideal = |shape: &Shape| matches!(shape, Shape::ThinLens { .. });
        let pitches_mm = prescription.surfaces.iter().map(|surface| match surface.shape {
            Shape::Facets { pitch_mm, .. } => pitch_mm,
            _ => 0.0,
        });
        let train = ends(with_masks);
        let stops: Vec<Stop> = train
            .masks()
            .filter_map(|index| Some(in_train(Stop::new(index, instrument.apertures.get(index)?, &band.name))))
            .filter(|stop| !stop.is_open())
            .collect();
        let mut made = Self {
            to_stops: stops.iter().map(|stop| train.clear_to_mask(stop.aperture)).collect(),
            stops,
            train,
            lens: ends(surfaces),
            aim: Aim::IDEAL,
            ideal: ThinBand::new(masks),
            is_paraxial: prescription.surfaces.iter().any(|surface| is_ideal(&surface.shape)),
            pitch_mm: pitches_mm.fold(0.0, f64::max),
            axial_weight: 1.0 / pupil.filled_fraction(masks.pupil_radius_mm),
            masks: masks.clone(),
        };
        let place = places[masks.pupil];
        if place.surface + 1 < prescription.surfaces.len() || place.behind_mm < 0.0 {
            let mask = &instrument.apertures[masks.pupil];
            let radius_mm = mask.annuli(&band.name).last().map_or(0.0, |ring| ring.outer_mm);
            made.aim = made.learnt_aim(mask.centre_mm, radius_mm, instrument.corner_radius_mm());
        }
        Ok(made)
    }

    /// The same with grooves that are infinitely fine.
    pub(crate) fn smoothed(self) -> Self {
        Self {
            train: self.train.smoothed(),
            lens: self.lens.smoothed(),
            to_stops: self.to_stops.into_iter().map(Train::smoothed).collect(),
            ..self
        }
    }

    /// How rays meet the pupil that the lens, or a part of it, separates from the sensor.
    fn learnt_aim(&self, centre_mm: [f64; 2], radius_mm: f64, image_radius_mm: f64) -> Aim {
        let to_pupil = self.train.clear_to_mask(self.masks.pupil);
        let image = quadrants(AIM_PLACES[0]).map(|place| place.map(|share| share * image_radius_mm));
        let starts: Vec<([f64; 2], [f64; 2])> =
            image.flat_map(|image_mm| quadrants(AIM_PLACES[1]).map(move |pupil| (image_mm, pupil))).collect();
        let ideal_mm = |(image_mm, pupil): &([f64; 2], [f64; 2])| self.on_principal_plane(*image_mm, *pupil);
        let mut seekers: Vec<Seeker> = starts
            .iter()
            .map(|start| {
                let [x, y] = start.1.map(|share| share * radius_mm);
                Seeker::new([centre_mm[0] + x, -centre_mm[1] - y], ideal_mm(start))
            })
            .collect();
        let launch = |index: usize, place_mm: [f64; 2]| self.launch(starts[index].0, place_mm);
        Aiming::at_stop(&to_pupil, &launch, radius_mm).seek(&mut seekers);
        let samples: Vec<Sample> = (starts.iter().zip(&seekers))
            .filter(|(_, seeker)| seeker.is_there)
            .map(|(start, seeker)| {
                let ideal_mm = ideal_mm(start);
                let added_mm = [0, 1].map(|k| seeker.start_mm[k] - ideal_mm[k]);
                Sample { image_mm: start.0, pupil: start.1, added_mm }
            })
            .collect();
        Aim::through(&samples, image_radius_mm)
    }

    /// Where the ideal ray from an image point to a pupil point crosses the rear principal plane, mm.
    fn on_principal_plane(&self, image_mm: [f64; 2], pupil: [f64; 2]) -> [f64; 2] {
        let lens = self.ideal.object_map(0.0);
        [0, 1].map(|k| lens.component(k, pupil[k], image_mm[k]))
    }

    /// The ray that leaves the sensor at an upright image point for a place in the rear principal plane, in the axes of the
    /// prescription.
    fn launch(&self, [x_mm, y_mm]: [f64; 2], place_mm: [f64; 2]) -> Ray {
        let away = [place_mm[0] + x_mm, -place_mm[1] - y_mm, -self.masks.sensor_distance_mm];
        Ray::new([-x_mm, y_mm, 0.0], away)
    }

    /// Rays from image points to pupil points, and their weights.
    fn launch_all(&self, starts: &RayStarts<'_>, block: &mut Block, weight: &mut [f64]) {
        let map = self.ideal.object_map(0.0);
        let mut places = Places::ideal(&map, starts);
        if !self.aim.is_ideal() {
            places.aim(|image_mm| self.aim.at(image_mm), starts, map.per_pupil);
        }
        let launch = Launch {
            sensor_distance_mm: self.masks.sensor_distance_mm,
            axial_weight: self.axial_weight,
            is_paraxial: self.is_paraxial,
        };
        launch.fill(starts, &places, block, weight);
    }

    pub(crate) fn trace(&self, starts: RayStarts<'_>, rays: &mut ObjectRays, ledger: &mut RayLedger) {
        let count = starts.len();
        rays.resize(count);
        ledger.launched += count as u64;
        for first in (0..count).step_by(LANES) {
            let block = first..count.min(first + LANES);
            self.trace_block(&self.train, starts.slice(block.clone()), block.start, rays, ledger);
        }
    }

    /// Fills the rays from `first` on with those of up to [`LANES`] starts.
    fn trace_block(
        &self,
        train: &Train,
        starts: RayStarts<'_>,
        first: usize,
        rays: &mut ObjectRays,
        ledger: &mut RayLedger,
    ) {
        let count = starts.len();
        let mut block = Block::of(count);
        self.launch_all(&starts, &mut block, &mut rays.weight[first..first + count]);
        train.send(&mut block);
        arrive(&block, first, count, rays);
        if block.all_arrived(count) {
            ledger.arrived += count as u64;
            return;
        }
        for (lane, weight) in rays.weight[first..first + count].iter_mut().enumerate() {
            let fate = of_train(block.ended(lane));
            ledger.settle(fate);
            if fate != RayFate::Arrived {
                *weight = 0.0;
            }
        }
    }

    /// The ideal lens's pencil, moved to where rays from all over the pupil and from the centre and the rim of the image
    /// disc are on the average.
    pub(crate) fn pencil(&self, centre: ImagePoint, radius_mm: f64) -> Pencil {
        let ideal = self.ideal.pencil(centre, radius_mm);
        let starts: Vec<_> = probes(centre, radius_mm, PROBES_PER_QUADRANT).collect();
        let mut rays = ObjectRays::default();
        self.trace_through(&self.lens, &starts, &mut rays);
        let from = |linear: &Linear, k: usize, n: usize| linear.component(k, starts[n].1[k], starts[n].0[k]);
        let stray = |n: usize| Stray {
            position_mm: [rays.x_mm[n] - from(&ideal.lens, 0, n), rays.y_mm[n] - from(&ideal.lens, 1, n)],
            slope: [rays.slope_x[n] - from(&ideal.slope, 0, n), rays.slope_y[n] - from(&ideal.slope, 1, n)],
        };
        let strays: Vec<Stray> = (0..starts.len()).filter(|n| rays.weight[*n] > 0.0).map(stray).collect();
        let facet_mm = STRAY_PER_PITCH * self.pitch_mm;
        ideal.strayed(&strays, [facet_mm, facet_mm / self.masks.focal_length_mm])
    }

    /// Its rays from an image disc as polynomials.
    pub(crate) fn ray_map(&self, centre: ImagePoint, radius_mm: f64) -> Option<RayMap> {
        if self.train.is_smooth() { RayMap::of(self, centre, radius_mm) } else { None }
    }

    /// Rays of up to [`LANES`] image and pupil points.
    fn trace_through(&self, train: &Train, starts: &[Start], rays: &mut ObjectRays) {
        rays.resize(starts.len());
        self.trace_block(train, Columns::of(starts).starts(), 0, rays, &mut RayLedger::default());
    }

    /// What the masks do to the image of a point is what they do behind the ideal lens; where the light of the whole pupil
    /// lies, how wide and how much it is, an average over so many rays in each quadrant that meet the point, found by aiming
    /// them from the sensor.
    ///
    /// A bundle of unit density over sensor and pupil has the density 1/|∂x/∂p| over the object, which makes each
    /// ray's share its weight over that determinant; the ideal lens's determinant is the unit.
    pub(crate) fn point_image(&self, object_mm: [f64; 3], rays_per_quadrant: usize) -> PointImage {
        let behind_ideal = self.masks.point_image(object_mm);
        let map = self.ideal.object_map(object_mm[2]);
        let starts: Vec<Start> = quadrants(rays_per_quadrant)
            .filter(|point| self.masks.is_open(*point))
            .map(|point| (map.image_mm([object_mm[0], object_mm[1]], point), point))
            .collect();
        let arrivals = self.arrivals(&map, object_mm, &starts);
        let light: f64 = arrivals.iter().flatten().map(|arrival| arrival.share).sum();
        let ImagePoint { x_mm, y_mm } = behind_ideal.centroid;
        if light <= 0.0 {
            return PointImage { throughput: 0.0, ..behind_ideal };
        }
        let added: Vec<Added> = (starts.iter().zip(&arrivals))
            .filter_map(|(start, arrival)| {
                let Arrival { weight, image_mm, .. } = *arrival.as_ref()?;
                Some(Added { pupil: start.1, added_mm: minus(image_mm, start.0), weight })
            })
            .collect();
        // Of the ideal lens's rays the mean is where it images the point.
        let count = starts.len() as f64;
        let ideal_mm = [0, 1].map(|k| starts.iter().map(|start| start.0[k]).sum::<f64>() / count);
        let moved_mm = |share: fn(&Arrival) -> f64| minus(mean_mm(&arrivals, share), ideal_mm);
        let [dx_mm, dy_mm] = moved_mm(|arrival| arrival.share);
        PointImage {
            throughput: behind_ideal.throughput * light / (4 * rays_per_quadrant) as f64,
            centroid: ImagePoint { x_mm: x_mm + dx_mm, y_mm: y_mm + dy_mm },
            aberration_mm: moved_mm(|arrival| arrival.weight),
            spread: spread(object_mm, &added),
        }
    }

    /// How every ray arrives that meets an object point through the pupil points of `starts`, which say where the ideal lens
    /// would image it; `None` for one that does not get through.
    fn arrivals(&self, map: &Linear, object_mm: [f64; 3], starts: &[Start]) -> Vec<Option<Arrival>> {
        let mut now = starts.to_vec();
        let mut rays = ObjectRays::default();
        let at = |rays: &ObjectRays, n: usize| {
            [rays.x_mm[n] + rays.slope_x[n] * object_mm[2], rays.y_mm[n] + rays.slope_y[n] * object_mm[2]]
        };
        let mut is_there = vec![false; now.len()];
        for _ in 0..AIM_STEPS {
            self.trace_through(&self.lens, &now, &mut rays);
            // The ideal lens's derivative, which the real one's differs from by some per cent.
            for (n, (image_mm, _)) in now.iter_mut().enumerate() {
                let at_mm = at(&rays, n);
                let miss_mm = [object_mm[0] - at_mm[0], object_mm[1] - at_mm[1]];
                is_there[n] = miss_mm[0].hypot(miss_mm[1]) < AIM_TOLERANCE_MM;
                if !is_there[n] {
                    *image_mm = [0, 1].map(|k| image_mm[k] + miss_mm[k] / map.per_image);
                }
            }
            if is_there.iter().all(|there| *there) {
                break;
            }
        }
        let (weight, found): (Vec<f64>, Vec<[f64; 2]>) = (0..now.len()).map(|n| (rays.weight[n], at(&rays, n))).unzip();
        let beside = |axis: usize| {
            let mut moved = now.clone();
            moved.iter_mut().for_each(|(image_mm, _)| image_mm[axis] += DERIVATIVE_STEP_MM);
            let mut rays = ObjectRays::default();
            self.trace_through(&self.lens, &moved, &mut rays);
            (0..moved.len()).map(|n| (rays.weight[n] > 0.0).then(|| at(&rays, n))).collect::<Vec<_>>()
        };
        let [by_x, by_y] = [0, 1].map(beside);
        let unit = map.per_image * map.per_image;
        let arrival = |n: usize| {
            let slope = |to: &[Option<[f64; 2]>]| to[n].map(|to| minus(to, found[n]).map(|mm| mm / DERIVATIVE_STEP_MM));
            let determinant = match (slope(&by_x), slope(&by_y)) {
                (Some([a, b]), Some([c, d])) => (a * d - b * c).abs(),
                // A wall between facets next door says nothing about this ray.
                _ => unit,
            };
            let share = weight[n] * unit / determinant;
            let arrives = is_there[n] && share.is_finite() && share > 0.0;
            arrives.then_some(Arrival { weight: weight[n], share, image_mm: now[n].0 })
        };
        (0..now.len()).map(arrival).collect()
    }
}

impl Traced for PrescribedBand {
    fn rays(&self, starts: &[Start]) -> Option<ObjectRays> {
        let mut rays = ObjectRays::default();
        rays.resize(starts.len());
        let columns = Columns::of(starts);
        for first in (0..starts.len()).step_by(LANES) {
            let block = columns.starts().slice(first..starts.len().min(first + LANES));
            self.trace_block(&self.lens, block, first, &mut rays, &mut RayLedger::default());
        }
        (!rays.weight.contains(&0.0)).then_some(rays)
    }

    fn stops(&self) -> &[Stop] {
        &self.stops
    }

    fn crossings(&self, stop: usize, starts: &[Start]) -> [Vec<f64>; 2] {
        let mut crossings: [Vec<f64>; 2] = Default::default();
        let mut weight = [0.0; LANES];
        for starts in starts.chunks(LANES) {
            let columns = Columns::of(starts);
            let mut block = Block::of(starts.len());
            self.launch_all(&columns.starts(), &mut block, &mut weight[..starts.len()]);
            self.to_stops[stop].send(&mut block);
            let met = crossings.iter_mut().zip(&block.position_mm);
            met.for_each(|(crossings, met_mm)| crossings.extend_from_slice(&met_mm[..starts.len()]));
        }
        crossings
    }
}

/// Image and pupil points, component by component.
struct Columns([Vec<f64>; 4]);

impl Columns {
    fn of(starts: &[Start]) -> Self {
        let column = |of: fn(&Start) -> f64| starts.iter().map(of).collect();
        Self([
            column(|start| start.0[0]),
            column(|start| start.0[1]),
            column(|start| start.1[0]),
            column(|start| start.1[1]),
        ])
    }

    fn starts(&self) -> RayStarts<'_> {
        let [image_x_mm, image_y_mm, pupil_x, pupil_y] = &self.0;
        RayStarts { image_x_mm, image_y_mm, pupil_x, pupil_y }
    }
}

/// A mask in the axes of the prescription, whose y points up where that of the object points down.
fn in_train(stop: Stop) -> Stop {
    let [x_mm, y_mm] = stop.centre_mm;
    Stop { centre_mm: [x_mm, -y_mm], ..stop }
}

/// A ray from an object point that arrives on the sensor.
struct Arrival {
    /// What it counts for a pixel there.
    weight: f64,
    /// What it counts of the light of the point.
    share: f64,
    image_mm: [f64; 2],
}

/// Mean place of arrivals.
fn mean_mm(arrivals: &[Option<Arrival>], share: fn(&Arrival) -> f64) -> [f64; 2] {
    let arrivals = || arrivals.iter().flatten();
    let total: f64 = arrivals().map(share).sum();
    [0, 1].map(|k| arrivals().map(|arrival| share(arrival) * arrival.image_mm[k]).sum::<f64>() / total)
}

/// How a ray ends, for a camera.
fn of_train(fate: Fate) -> RayFate {
    match fate {
        Fate::Arrived => RayFate::Arrived,
        Fate::Blocked { mask } => RayFate::Blocked { aperture: mask },
        Fate::Missed { .. } | Fate::Vignetted { .. } => RayFate::MissedLens,
        Fate::GrooveWall { .. } => RayFate::GrooveWall,
        Fate::TotalInternalReflection { .. } => RayFate::TotalInternalReflection,
    }
}
