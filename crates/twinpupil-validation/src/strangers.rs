//! Cameras and scenes that nobody has chosen: drawn from the range of what could be built, each by a number.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use twinpupil_instrument::{DepthRange, Instrument, Lens, Mosaic, paper};
use twinpupil_reconstruct::Mode;
use twinpupil_simulate::{DotGrid, Illumination, Pattern, Plate, RandomDots, Scene, SceneSpec, TiltAxis};

use crate::limit::{Score, Terms};
use crate::rig::Rig;

/// A camera and a plate of random dots before it.
#[derive(Debug, Clone)]
pub struct Stranger {
    /// The camera.
    pub instrument: Instrument,
    /// What it sees.
    pub scene: Scene,
    terms: Terms,
    seed: u64,
}

/// Sizes of sensors, px.
const SIZES_PX: [[usize; 2]; 4] = [[1280, 1024], [1440, 1080], [1920, 1200], [2448, 2048]];

/// How the bands come.
const MOSAICS: [Mosaic; 5] = [Mosaic::Rgb, Mosaic::Rggb, Mosaic::Bggr, Mosaic::Grbg, Mosaic::Gbrg];

/// Least radius of an image, in pixels of the band's own lattice, and the largest over the height of the sensor.
const RADIUS_STEPS_MIN: f64 = 4.5;
const RADIUS_SHARE_MAX: f64 = 0.04;

/// Dots from so many times that radius on are seen well enough by both bands at which the chief ray of one is shut out: those of
/// the paper begin there at 300 mm.
const CLEAR: f64 = 1.33;

/// Most dots, and the share of the field that they fill at most.
const DOTS_MAX: f64 = 80.0;
const FILLED_MAX: f64 = 0.22;

/// How often something is the case that need not be.
const SOMETIMES: f64 = 0.3;

/// Numbers drawn one after the other.
struct Draw(Pcg64Mcg);

impl Draw {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// As likely in every octave.
    fn scale(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// Either way by up to `size`.
    fn about(&mut self, size: f64) -> f64 {
        self.between(-size, size)
    }

    fn one_of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.0.random_range(0..all.len())]
    }

    fn sometimes(&mut self) -> bool {
        self.0.random::<f64>() < SOMETIMES
    }
}

impl Stranger {
    /// The stranger of a number.
    ///
    /// # Panics
    /// If what is drawn is not legal.
    pub fn of(seed: u64) -> Self {
        let mut draw = Draw(Pcg64Mcg::seed_from_u64(seed));
        let focus_mm = draw.scale(150.0, 700.0);
        let instrument = instrument(&mut draw, focus_mm);
        let (scene, terms) = scene(&mut draw, &instrument, focus_mm, seed);
        Self { instrument, scene, terms, seed }
    }

    /// The same camera with something unusual before it: few dots, rows of them, dark ones, or uneven light. In some of them a
    /// stop cuts pencils of the telecentric band.
    ///
    /// # Panics
    /// If what is drawn is not legal.
    pub fn unusual(seed: u64) -> Self {
        const STREAM: u64 = 0x5eed_0f1e;
        let mut draw = Draw(Pcg64Mcg::seed_from_u64(seed ^ STREAM));
        let stranger = Self::of(seed);
        let r_max_mm =
            stranger.scene.dots().iter().map(|dot| dot.centre_mm[0].hypot(dot.centre_mm[1])).fold(0.0, f64::max);
        let scene = unusual(&mut draw, stranger.scene.spec().clone());
        let instrument =
            if draw.sometimes() { vignetted(&mut draw, stranger.instrument, r_max_mm) } else { stranger.instrument };
        Self { instrument, scene: Scene::new(scene).expect("a legal scene"), ..stranger }
    }

    /// Reads a noisy frame of it.
    ///
    /// # Panics
    /// If the camera cannot be traced.
    pub fn score(&self) -> Score {
        let rig = Rig::new(self.instrument.clone(), Mode::Model);
        Score::on(self.terms, &rig, &self.scene, self.seed)
    }
}

/// A camera that is sharp at a distance.
fn instrument(draw: &mut Draw, focus_mm: f64) -> Instrument {
    let mut spec = paper::instrument().into_spec();
    let f_mm = focus_mm / draw.between(2.4, 5.0);
    let sensor = &mut spec.sensor;
    sensor.distance_mm = focus_mm * f_mm / (focus_mm - f_mm);
    sensor.size_px = draw.one_of(&SIZES_PX);
    sensor.pitch_mm = draw.scale(0.0024, 0.0065);
    sensor.axis_px = sensor.size_px.map(|size| 0.5 * size as f64 + draw.about(30.0));
    sensor.mosaic = draw.one_of(&MOSAICS);
    sensor.bit_depth = draw.one_of(&[10, 12, 14]);
    sensor.full_well_e = draw.scale(8000.0, 60_000.0);
    sensor.read_noise_e = draw.scale(1.5, 12.0);
    sensor.black_level = if draw.sometimes() { 1 << (sensor.bit_depth - 6) } else { 0 };
    if draw.sometimes() {
        sensor.tilt_deg = [draw.about(0.6), draw.about(0.6)];
    }
    let corner_mm = 0.5 * sensor.pitch_mm * (sensor.size_px[0] as f64).hypot(sensor.size_px[1] as f64);
    if draw.sometimes() {
        spec.bands.iter_mut().for_each(|band| band.distortion.k1_per_mm2 = draw.about(0.004) / corner_mm.powi(2));
    }
    // Narrow enough for the blur to stay below the dots, wide enough for diffraction to stay below the pixels.
    let on_lens_mm = 0.01 * f_mm * draw.between(0.5, 1.3);
    let in_focal_plane_mm = 0.5 * on_lens_mm * draw.between(0.7, 1.4);
    let [on_lens, in_focal_plane, stop] = &mut spec.apertures[..] else { panic!("the paper has three apertures") };
    on_lens.zones[0].radius_mm = Some(on_lens_mm);
    (in_focal_plane.position_mm, in_focal_plane.zones[0].radius_mm) = (f_mm, Some(in_focal_plane_mm));
    (stop.position_mm, stop.zones[0].radius_mm) = (0.4 * f_mm, Some(0.2 * f_mm + corner_mm));
    if draw.sometimes() {
        on_lens.centre_mm = [draw.about(0.05) * on_lens_mm, draw.about(0.05) * on_lens_mm];
        in_focal_plane.centre_mm = [draw.about(0.1) * in_focal_plane_mm, draw.about(0.1) * in_focal_plane_mm];
    }
    if let Lens::Thin(lens) = &mut spec.lens {
        lens.focal_length_mm = f_mm;
        if draw.sometimes() {
            let bands = ["red", "blue"].map(|band| (band.to_owned(), f_mm * (1.0 + draw.about(0.015))));
            lens.focal_length_mm_by_band = bands.into();
        }
    }
    spec.depth_range = Some(DepthRange { near_mm: 0.75 * focus_mm, far_mm: 1.3 * focus_mm });
    Instrument::new(spec).expect("a legal camera")
}

/// The camera with its stop so narrow that it cuts pencils of the telecentric band from dots about so far from the axis.
fn vignetted(draw: &mut Draw, instrument: Instrument, r_max_mm: f64) -> Instrument {
    let focal_length_mm = instrument.lens.focal_length_mm();
    let mut spec = instrument.into_spec();
    let stop = &mut spec.apertures[2];
    // The band's chief rays come along the axis and meet it in the focal plane.
    let height = 1.0 - stop.position_mm / focal_length_mm;
    stop.zones[0].radius_mm = Some(draw.between(0.85, 1.1) * height * r_max_mm);
    Instrument::new(spec).expect("a legal camera")
}

/// A plate about the distance at which a camera is sharp, and how it is scored.
fn scene(draw: &mut Draw, instrument: &Instrument, focus_mm: f64, seed: u64) -> (Scene, Terms) {
    let sensor = &instrument.sensor;
    let [telecentric, entocentric] = instrument.projections();
    let distance_mm = focus_mm * draw.between(0.86, 1.16);
    let tilt_deg = if draw.sometimes() { 0.0 } else { draw.about(60.0) };
    let steps = if sensor.mosaic == Mosaic::Rgb { 1.0 } else { 2.0 };
    let magnification = telecentric.magnification(distance_mm).min(entocentric.magnification(distance_mm)).abs();
    let height_px = sensor.size_px[1] as f64;
    let radius_px = draw.scale(RADIUS_STEPS_MIN * steps, RADIUS_SHARE_MAX * height_px);
    // A dot that is blurred more than it is large has no edge to measure.
    let blur_px = [telecentric, entocentric].map(|band| band.blur_radius_mm(distance_mm).abs() / sensor.pitch_mm);
    let radius_px = radius_px.max(1.3 * blur_px[0].max(blur_px[1]));
    let diameter_mm = 2.0 * radius_px * sensor.pitch_mm / magnification;
    let r_max_mm = 0.42 * sensor.pitch_mm * sensor.size_px[0] as f64 / magnification;
    let r_min_mm = CLEAR * shaded_radius_mm(instrument, distance_mm);
    let fitting = FILLED_MAX * 4.0 * r_max_mm * r_max_mm / (diameter_mm * diameter_mm);
    let count = draw.between(0.3, 1.0) * DOTS_MAX.min(fitting);
    let gap_mm = draw.between(0.1, 0.6) * diameter_mm;
    let tilt_deg = within_depth(tilt_deg, r_max_mm, distance_mm, focus_mm);
    let plate = Plate {
        distance_mm,
        tilt_deg,
        tilt_axis: draw.one_of(&[TiltAxis::X, TiltAxis::Y]),
        pattern: Pattern::RandomDots(RandomDots {
            count: count.max(8.0) as u32,
            diameter_mm,
            r_min_mm: (0.75 * r_min_mm).min(0.5 * r_max_mm),
            r_max_mm,
            gap_mm,
        }),
    };
    let brightness_e = draw.scale(0.02, 0.85) * sensor.full_well_e;
    let background_e = if draw.sometimes() { 0.05 * brightness_e } else { 0.0 };
    let spec = SceneSpec {
        schema: 1,
        name: format!("stranger-{seed}"),
        seed,
        background_e,
        brightness_e,
        illumination: None,
        dots: Vec::new(),
        plate: Some(plate),
    };
    let terms = Terms { r_min_mm, reach_mm: [0.3 * diameter_mm, 0.02 * distance_mm] };
    (Scene::new(spec).expect("a legal plate"), terms)
}

/// Another plate in the place of one of random dots.
fn unusual(draw: &mut Draw, mut spec: SceneSpec) -> SceneSpec {
    let Some(Plate { pattern, .. }) = &mut spec.plate else { return spec };
    let Pattern::RandomDots(dots) = pattern else { return spec };
    let (diameter_mm, r_max_mm) = (dots.diameter_mm, dots.r_max_mm);
    match draw.one_of(&[0, 1, 2]) {
        0 => dots.count = draw.between(1.0, 9.0) as u32,
        1 => {
            let pitch_mm = draw.between(1.4, 2.5) * diameter_mm;
            let fitting = (1.6 * r_max_mm / pitch_mm).min(draw.between(4.0, 14.0));
            *pattern = Pattern::Grid(DotGrid {
                rows: draw.one_of(&[1, 1, 2, 3]),
                columns: fitting.max(2.0) as u32,
                pitch_mm,
                diameter_mm,
                centre_mm: [
                    draw.about(0.2) * r_max_mm,
                    (0.5 * draw.between(0.6, 1.0)).copysign(draw.about(1.0)) * r_max_mm,
                ],
                turn_deg: if draw.sometimes() { 0.0 } else { draw.about(25.0) },
                ..DotGrid::default()
            });
        }
        _ => {}
    }
    if draw.sometimes() {
        (spec.background_e, spec.brightness_e) = (spec.brightness_e, draw.between(0.03, 0.3) * spec.brightness_e);
    }
    if !draw.sometimes() {
        // Up to about twice as much on one side of the field as on the other.
        let (growth_per_mm, turn_rad) = (draw.between(0.05, 0.35) / r_max_mm, draw.about(std::f64::consts::PI));
        let (sin, cos) = turn_rad.sin_cos();
        spec.illumination = Some(Illumination { growth_per_mm: [growth_per_mm * cos, growth_per_mm * sin] });
    }
    spec
}

/// How far from the axis the masks leave nothing of a pencil's middle: the chief ray of one band meets the disc that shuts
/// that band out, on the lens or in the focal plane.
fn shaded_radius_mm(instrument: &Instrument, distance_mm: f64) -> f64 {
    let disc_mm = |aperture: usize| instrument.apertures[aperture].zones[0].radius_mm.unwrap_or(0.0);
    disc_mm(0).max(disc_mm(1) * distance_mm / instrument.lens.focal_length_mm())
}

/// A tilt that leaves the whole plate in the depth that the camera is made for.
fn within_depth(tilt_deg: f64, r_max_mm: f64, distance_mm: f64, focus_mm: f64) -> f64 {
    let room_mm = (1.27 * focus_mm - distance_mm).min(distance_mm - 0.78 * focus_mm);
    let largest_deg = (room_mm / r_max_mm).atan().to_degrees();
    tilt_deg.clamp(-largest_deg, largest_deg)
}
