//! Scenes as they come: dark dots, uneven light, dots of all sizes, bad pixels, too much light, dots that touch.

use twinpupil_instrument::Instrument;
use twinpupil_reconstruct::Point;
use twinpupil_simulate::{
    Defects, DotSpec, Illumination, ImagePattern, Pattern, Picture, Plate, Scene, SceneSpec, TiltAxis,
};

use crate::limit::{Camera, Score, model_rig, plate};
use crate::plates::{Pose, is_near};
use crate::rig::{dots, nearest};

/// A scene before a camera.
#[derive(Debug, Clone)]
pub struct Case {
    /// What is special about it.
    pub name: String,
    /// What lies before the camera.
    pub scene: Scene,
    /// What is wrong with the sensor.
    pub defects: Defects,
}

/// Electrons of bright features, and of what is dark.
const BRIGHT_E: f64 = 20_000.0;
const DARK_E: f64 = 1000.0;

/// Light that falls to half from one side of the field of view to the other, 19 mm, relative to the middle, 1/mm.
const HALVED_ACROSS_THE_FIELD: f64 = 0.035;

impl Case {
    fn new(name: impl Into<String>, scene: Scene) -> Self {
        Self { name: name.into(), scene, defects: Defects::default() }
    }

    fn varied(name: impl Into<String>, scene: &Scene, vary: impl FnOnce(&mut SceneSpec)) -> Self {
        let mut spec = scene.spec().clone();
        vary(&mut spec);
        Self::new(name, Scene::new(spec).expect("a legal scene"))
    }

    /// Reads one frame of it.
    pub fn score(&self, camera: Camera, seed: u64) -> Score {
        let mut rig = model_rig(camera);
        rig.defects = self.defects;
        Score::of(&rig, &self.scene, seed)
    }
}

/// Facing dots, each by x, y, z and diameter.
pub fn discs(places: &[[f64; 4]]) -> Scene {
    let dot = |&[x_mm, y_mm, z_mm, diameter_mm]: &[f64; 4]| DotSpec { x_mm, y_mm, z_mm, diameter_mm };
    let spec = SceneSpec { dots: places.iter().map(dot).collect(), ..dots(&[]).spec().clone() };
    Scene::new(spec).expect("legal dots")
}

/// Dots on rings about the axis, apart from each other, with sizes in turn.
pub fn rings(z_mm: f64, diameters_mm: &[f64], turn_rad: f64) -> Scene {
    let mut places = Vec::new();
    let is_large = diameters_mm.iter().all(|diameter_mm| *diameter_mm > 1.5);
    let circles = if is_large { &[(3.0, 5), (5.7, 9)][..] } else { &[(2.6, 5), (4.4, 8), (5.9, 9)] };
    for (ring, &(r_mm, count)) in circles.iter().enumerate() {
        for k in 0..count {
            let azimuth_rad = turn_rad + 0.4 * ring as f64 + std::f64::consts::TAU * k as f64 / count as f64;
            let (sin, cos) = azimuth_rad.sin_cos();
            // The field is wider than it is high.
            let (x_mm, y_mm) = (r_mm * cos, r_mm * sin);
            if y_mm.abs() < 4.7 {
                places.push([x_mm, y_mm, z_mm, diameters_mm[places.len() % diameters_mm.len()]]);
            }
        }
    }
    discs(&places)
}

/// Dots like the paper's, dark on bright ground.
pub fn dark(pose: Pose, seed: u64) -> Case {
    Case::varied(format!("dark {pose:?}"), &plate(pose, BRIGHT_E, seed), |spec| {
        (spec.background_e, spec.brightness_e) = (BRIGHT_E, DARK_E);
    })
}

/// The paper's plate under light that halves across the field.
pub fn halved(pose: Pose, is_dark: bool, seed: u64) -> Case {
    let case = if is_dark { dark(pose, seed) } else { Case::new(format!("{pose:?}"), plate(pose, BRIGHT_E, seed)) };
    Case::varied(format!("2:1 over the field, {}", case.name), &case.scene, |spec| {
        spec.illumination = Some(Illumination { growth_per_mm: [HALVED_ACROSS_THE_FIELD, 0.02] });
    })
}

/// Dots each of which is lit twice as brightly on one side as on the other: across, or towards the axis.
pub fn halved_on_each(z_mm: f64, towards_axis: bool) -> Case {
    let (scene, growth) = if towards_axis {
        (discs(&[-3.4, -2.0, -0.6, 0.8, 2.2, 3.6].map(|y| [3.5, y, z_mm, 1.0])), [-0.19, 0.0])
    } else {
        (discs(&[-4.4, -3.1, 2.4, 3.7].map(|y| [0.1, y, z_mm, 1.0])), [0.66, 0.0])
    };
    let way = if towards_axis { "along" } else { "across" };
    Case::varied(format!("2:1 {way} each dot at {z_mm}"), &scene, |spec| {
        spec.illumination = Some(Illumination { growth_per_mm: growth });
    })
}

/// Dots of given diameters.
pub fn sized(z_mm: f64, diameters_mm: &[f64]) -> Case {
    Case::new(format!("{diameters_mm:?} mm at {z_mm}"), rings(z_mm, diameters_mm, 0.1))
}

/// A sensor a thousandth of whose pixels is stuck.
pub fn struck(pose: Pose, seed: u64) -> Case {
    let case = Case::new(format!("stuck pixels, {pose:?}"), plate(pose, BRIGHT_E, seed));
    Case { defects: Defects { dead: 5e-4, hot: 5e-4, seed }, ..case }
}

/// Dots with 1.5 times the light that the full well holds.
pub fn overexposed(pose: Pose, seed: u64) -> Case {
    Case::new(format!("1.5 full wells, {pose:?}"), plate(pose, 1.5 * 32_700.0, seed))
}

/// A grid of dots 0.1 mm apart.
pub fn grid(z_mm: f64, gap_mm: f64) -> Case {
    let place = |k: i32| [f64::from(k % 9 - 4), f64::from(k / 9 - 3)].map(|n| n * (0.6 + gap_mm));
    let places: Vec<[f64; 4]> = (0..63).map(place).map(|[x, y]| [4.5 + x, y, z_mm, 0.6]).collect();
    Case::new(format!("grid at {z_mm}, gaps of {gap_mm}"), discs(&places))
}

/// Pairs of dots that touch, one farther away than the other.
pub fn pairs(z_mm: f64, behind_mm: f64) -> Case {
    let pair = |k: i32| {
        let (sin, cos) = (0.2 + 0.898 * f64::from(k)).sin_cos();
        let (along, across) = (1.7 * f64::from(k)).sin_cos();
        let place = |side: f64, z_mm: f64| [4.6 * cos + side * 0.5 * across, 4.2 * sin + side * 0.5 * along, z_mm, 1.0];
        [place(-1.0, z_mm), place(1.0, z_mm + behind_mm)]
    };
    Case::new(
        format!("touching pairs at {z_mm}, {behind_mm} apart in depth"),
        discs(&(0..7).flat_map(pair).collect::<Vec<_>>()),
    )
}

/// All of them, but for the noise.
pub fn all() -> Vec<Case> {
    let mut cases = Vec::new();
    for pose in [Pose::Facing(260.0), Pose::Facing(300.0), Pose::Facing(340.0), Pose::Tilted(30.0), Pose::Tilted(45.0)]
    {
        cases.push(dark(pose, 21));
    }
    for pose in [Pose::Facing(270.0), Pose::Facing(300.0), Pose::Facing(330.0), Pose::Tilted(30.0)] {
        cases.push(halved(pose, false, 22));
        cases.push(halved(pose, true, 23));
    }
    for z_mm in [270.0, 300.0, 330.0] {
        cases.extend([halved_on_each(z_mm, false), halved_on_each(z_mm, true)]);
    }
    for z_mm in [280.0, 300.0, 320.0] {
        for diameters_mm in [&[0.2][..], &[0.5], &[2.0], &[0.2, 2.0, 0.5, 1.0]] {
            cases.push(sized(z_mm, diameters_mm));
        }
    }
    for pose in [Pose::Facing(250.0), Pose::Facing(300.0), Pose::Facing(325.0), Pose::Tilted(30.0)] {
        cases.push(struck(pose, 24));
    }
    for pose in [Pose::Facing(270.0), Pose::Facing(300.0), Pose::Facing(340.0), Pose::Tilted(30.0)] {
        cases.push(overexposed(pose, 25));
    }
    cases.extend([grid(270.0, 0.1), grid(300.0, 0.03), grid(330.0, 0.1)]);
    cases.extend([pairs(280.0, 0.0), pairs(280.0, 10.0), pairs(300.0, 30.0)]);
    cases
}

/// A camera with a small sensor beside the axis: it sees x from 2.3 to 8 mm and y within 2.4 mm.
pub fn corner(camera: Camera) -> Instrument {
    let mut spec = camera.instrument().into_spec();
    spec.sensor.size_px = [540, 420];
    spec.sensor.axis_px = [-190.0, 209.5];
    Instrument::new(spec).expect("the paper's instrument with a part of its sensor")
}

/// Twelve facing dots before [`corner`], with sizes in turn.
pub fn patch(z_mm: f64, diameters_mm: &[f64]) -> Scene {
    let place = |k: usize| {
        let (column, row) = ((k % 4) as f64, (k / 4) as f64);
        let diameter_mm = diameters_mm[k % diameters_mm.len()];
        [3.3 + 1.25 * column + 0.04 * row, 1.3 * (row - 1.0) + 0.03 * column, z_mm, diameter_mm]
    };
    discs(&(0..12).map(place).collect::<Vec<_>>())
}

/// A plate of shapes that are no discs before [`corner`], with where their middles are.
pub fn shapes(z_mm: f64) -> (Scene, Vec<[f64; 3]>) {
    const SIZE_MM: [f64; 2] = [16.4, 4.8];
    const PX_PER_MM: f64 = 150.0;
    let size_px = SIZE_MM.map(|length_mm| (length_mm * PX_PER_MM) as usize);
    let mut values = vec![0.0_f32; size_px[0] * size_px[1]];
    let mut middles_mm = Vec::new();
    for k in 0..6 {
        let middle_mm = [3.3 + 1.9 * f64::from(k % 3), 2.1 * f64::from(k / 3) - 1.05];
        let [x_mm, y_mm] = draw(&mut values, size_px[0], PX_PER_MM, middle_mm, SIZE_MM, 0.37 * f64::from(k), k % 5);
        middles_mm.push([x_mm, y_mm, z_mm]);
    }
    let pattern = Pattern::Image(ImagePattern { image: "shapes.png".to_owned(), width_mm: SIZE_MM[0] });
    let plate = Plate { distance_mm: z_mm, tilt_deg: 0.0, tilt_axis: TiltAxis::Y, pattern };
    let scene = Scene::new(SceneSpec { plate: Some(plate), ..dots(&[]).spec().clone() }).expect("a legal plate");
    let picture = Picture::new(size_px[0], size_px[1], values).expect("a picture");
    (scene.with_picture(picture).expect("a picture of the plate"), middles_mm)
}

/// Draws a shape of about 1 mm and returns its centroid: a square, a triangle, a ring, an L or a half disc.
fn draw(
    values: &mut [f32],
    width_px: usize,
    px_per_mm: f64,
    middle_mm: [f64; 2],
    size_mm: [f64; 2],
    turn_rad: f64,
    kind: i32,
) -> [f64; 2] {
    let (sin, cos) = turn_rad.sin_cos();
    let within = |x: f64, y: f64| match kind {
        0 => x.abs() < 0.4 && y.abs() < 0.4,
        1 => y < 0.35 && y > -0.45 + 1.7 * x.abs(),
        2 => (0.25..0.5).contains(&x.hypot(y)),
        3 => (x.abs() < 0.4 && y.abs() < 0.4) && (x < -0.1 || y > 0.1),
        _ => x.hypot(y) < 0.5 && y > -0.1,
    };
    let (mut sum, mut sums) = (0.0, [0.0; 2]);
    for (index, value) in values.iter_mut().enumerate() {
        let place_mm = [index % width_px, index / width_px].map(|place| (place as f64 + 0.5) / px_per_mm);
        let [dx, dy] = [0, 1].map(|axis| place_mm[axis] - 0.5 * size_mm[axis] - middle_mm[axis]);
        if dx.abs().max(dy.abs()) < 1.0 && within(cos * dx + sin * dy, cos * dy - sin * dx) {
            *value = 1.0;
            sum += 1.0;
            sums = [sums[0] + dx, sums[1] + dy];
        }
    }
    [0, 1].map(|axis| middle_mm[axis] + sums[axis] / sum)
}

/// Errors of z, mm, with the deviations that were reported, of the points that lie where something is.
pub fn errors_mm(points: &[Point], middles_mm: &[[f64; 3]]) -> Vec<[f64; 2]> {
    let near = |middle_mm: &[f64; 3]| {
        let point = nearest(points, *middle_mm).filter(|point| is_near(point.position_mm, *middle_mm))?;
        Some([point.position_mm[2] - middle_mm[2], point.std_mm[2]])
    };
    middles_mm.iter().filter_map(near).collect()
}
