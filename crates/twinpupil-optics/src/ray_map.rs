//! Rays from a patch of the sensor through a smooth lens, as polynomials.
//!
//! What a lens makes of a ray is a smooth function of the image point p and the pupil point u it runs between, which
//! polynomials describe as aberration theory does [M. Hullin, J. Hanika, W. Heidrich, "Polynomial Optics", Computer
//! Graphics Forum 31(4), 2012]. Over a small patch few terms are enough: with a, p from the middle of the patch over its
//! radius,
//!
//! ```text
//! f(p, u) = Σ c a_xⁱ a_yʲ u_xᵏ u_yˡ        i + j ≤ 3,  k + l ≤ 3, 5 or 7
//! ```
//!
//! for a ray's line in front of the lens, its weight and where it meets the masks. They are fitted to traced rays and
//! compared with others; a patch whose rays are lost at a surface, or which no polynomial follows, has none.

use std::sync::LazyLock;

use multiversion::multiversion;
use twinpupil_instrument::ImagePoint;

use crate::least_squares::least_squares;
use crate::linear::Disc;
use crate::spread::{quadrants, rim};
use crate::stop::Stop;
use crate::{ObjectRays, RayFate, RayLedger};

/// All rays from a patch of the sensor.
#[derive(Debug, Clone)]
pub struct RayMap {
    centre: ImagePoint,
    radius_mm: f64,
    degree: usize,
    /// x, y and both slopes.
    line: [Component; LINE],
    weight: Component,
    /// Masks that some of the rays may not pass, in the order in which they are met, and where.
    masks: Vec<(Stop, [Component; 2])>,
}

/// Position and slopes of a ray.
pub(crate) const LINE: usize = 4;

/// Coefficients of a component: for every power of a those of the powers of u.
#[derive(Debug, Clone)]
struct Component(Vec<f64>);

/// Its coefficients at one image point.
type AtImage = [f64; PUPIL_TERMS_MAX];

/// What tracing tells of rays.
pub(crate) trait Traced {
    /// Rays between image and pupil points, in front of the lens; `None` if a surface stops one.
    fn rays(&self, starts: &[Start]) -> Option<ObjectRays>;

    /// The masks in the order in which rays meet them.
    fn stops(&self) -> &[Stop];

    /// Where rays meet a mask, by its place among those.
    fn crossings(&self, stop: usize, starts: &[Start]) -> [Vec<f64>; 2];
}

/// An image point, mm, and a pupil point.
pub(crate) type Start = ([f64; 2], [f64; 2]);

/// Highest powers of u that are tried, one after the other, and of a.
const DEGREES: [usize; 3] = [3, 5, 7];
const IMAGE_DEGREE: usize = 3;

const PUPIL_TERMS_MAX: usize = terms(DEGREES[DEGREES.len() - 1]);
const IMAGE_TERMS: usize = terms(IMAGE_DEGREE);

/// Rays that polynomials are fitted to: so many image and pupil points in every quadrant, spread a little beyond the
/// patch and the pupil, so that a lens which stops none of them stops none between.
const IMAGE_NODES: usize = 4;
const PUPIL_NODES: usize = 12;
const IMAGE_NODES_ALL: usize = 4 * IMAGE_NODES;
const PUPIL_NODES_ALL: usize = 4 * PUPIL_NODES;
const IMAGE_SPREAD: f64 = 1.15;
const PUPIL_SPREAD: f64 = 1.03;

/// Image and pupil points of the rays that polynomials are compared with.
const CHECKS: [usize; 2] = [7, 9];

/// What polynomials may be off by: positions in mm, slopes and relative weights.
const POSITION_MM: f64 = 1e-7;
const SLOPE: f64 = 1e-9;
const WEIGHT: f64 = 1e-7;

/// Rays whose crossings of a mask are found together.
const TOGETHER: usize = 64;

/// Number of products of powers up to a degree.
const fn terms(degree: usize) -> usize {
    (degree + 1) * (degree + 2) / 2
}

/// Products of powers up to a degree: those of y alone first.
fn powers([x, y]: [f64; 2], degree: usize, all: &mut [f64]) {
    let (mut of_x, mut all) = (1.0, all.iter_mut());
    for k in 0..=degree {
        let row = all.by_ref().take(degree + 1 - k);
        row.fold(of_x, |power, value| {
            *value = power;
            power * y
        });
        of_x *= x;
    }
}

/// Rays that were traced, component by component.
struct Sample<'a> {
    starts: &'a [Start],
    rays: ObjectRays,
    crossings: Vec<[Vec<f64>; 2]>,
}

impl<'a> Sample<'a> {
    /// `None` if a surface stops one of them.
    fn of(rays: &impl Traced, starts: &'a [Start]) -> Option<Self> {
        let crossings = (0..rays.stops().len()).map(|stop| rays.crossings(stop, starts)).collect();
        Some(Self { starts, rays: rays.rays(starts)?, crossings })
    }

    fn line(&self) -> [&Vec<f64>; LINE] {
        let ObjectRays { x_mm, y_mm, slope_x, slope_y, .. } = &self.rays;
        [x_mm, y_mm, slope_x, slope_y]
    }
}

impl RayMap {
    /// That of a disc on the ideal image plane.
    pub(crate) fn of(rays: &impl Traced, centre: ImagePoint, radius_mm: f64) -> Option<Self> {
        let starts = |image: &[[f64; 2]], pupil: &[[f64; 2]]| -> Vec<Start> {
            let mm = |[x, y]: [f64; 2]| [centre.x_mm + radius_mm * x, centre.y_mm + radius_mm * y];
            image.iter().flat_map(|a| pupil.iter().map(move |u| (mm(*a), *u))).collect()
        };
        let nodes = starts(&image_nodes(), &pupil_nodes());
        let checks = starts(&check_places(CHECKS[0]), &check_places(CHECKS[1]));
        let (nodes, checks) = (Sample::of(rays, &nodes)?, Sample::of(rays, &checks)?);
        FITS.iter().find_map(|fit| {
            let through = |values: &Vec<f64>| fit.through(values);
            let crossings = nodes.crossings.iter().map(|values| values.each_ref().map(through));
            let map = Self {
                centre,
                radius_mm,
                degree: fit.degree,
                line: nodes.line().map(through),
                weight: through(&nodes.rays.weight),
                masks: rays.stops().iter().cloned().zip(crossings).collect(),
            };
            map.follows(&checks).then(|| map.without_open_masks())
        })
    }

    /// Without the masks that the whole patch passes.
    fn without_open_masks(mut self) -> Self {
        self.masks.retain(|(stop, components)| {
            let [(x, around_x), (y, around_y)] = components.each_ref().map(Component::sums);
            !stop.passes_disc(&Disc { centre: [x, y], radius: around_x.hypot(around_y) })
        });
        self
    }

    /// Whether it says of all these rays what tracing did.
    fn follows(&self, sample: &Sample<'_>) -> bool {
        let line = self.line.iter().zip([POSITION_MM, POSITION_MM, SLOPE, SLOPE]);
        let crossings = self.masks.iter().flat_map(|(_, components)| components);
        let components =
            line.chain([(&self.weight, WEIGHT)]).chain(crossings.map(|component| (component, POSITION_MM)));
        let values = sample.line().into_iter().chain([&sample.rays.weight]).chain(sample.crossings.iter().flatten());
        components.zip(values).all(|((component, limit), values)| {
            let mut first = 0;
            sample.starts.chunk_by(|a, b| a.0 == b.0).all(|starts| {
                let values = &values[first..first + starts.len()];
                first += starts.len();
                let found = self.component(component, starts);
                found.iter().zip(values).all(|(found, value)| (found - value).abs() <= limit)
            })
        })
    }

    /// A component for rays from one image point.
    fn component(&self, component: &Component, starts: &[Start]) -> Vec<f64> {
        let [u, v] = [0, 1].map(|axis| starts.iter().map(|start| start.1[axis]).collect::<Vec<f64>>());
        let (mut at, mut values) = ([0.0; PUPIL_TERMS_MAX], vec![0.0; starts.len()]);
        let [x_mm, y_mm] = starts[0].0;
        component.at(&self.image_powers(ImagePoint { x_mm, y_mm }), self.degree, &mut at);
        evaluate(self.degree, &at, [&u, &v], &mut values);
        values
    }

    fn image_powers(&self, ImagePoint { x_mm, y_mm }: ImagePoint) -> [f64; IMAGE_TERMS] {
        let per_mm = 1.0 / self.radius_mm;
        let mut all = [0.0; IMAGE_TERMS];
        powers([(x_mm - self.centre.x_mm) * per_mm, (y_mm - self.centre.y_mm) * per_mm], IMAGE_DEGREE, &mut all);
        all
    }

    /// Rays from an image point of the patch to pupil points, as
    /// [`BandOptics::trace`](crate::BandOptics::trace) gives them.
    pub fn trace(&self, image: ImagePoint, pupil: [&[f64]; 2], rays: &mut ObjectRays, ledger: &mut RayLedger) {
        let image_powers = self.image_powers(image);
        self.weigh_at(&image_powers, pupil, rays, ledger);
        let ObjectRays { x_mm, y_mm, slope_x, slope_y, .. } = rays;
        let mut at = [0.0; PUPIL_TERMS_MAX];
        for (component, values) in self.line.iter().zip([x_mm, y_mm, slope_x, slope_y]) {
            component.at(&image_powers, self.degree, &mut at);
            evaluate(self.degree, &at, pupil, values);
        }
    }

    /// Their weights alone; where the rays go, `rays` does not tell then.
    pub fn weigh(&self, image: ImagePoint, pupil: [&[f64]; 2], rays: &mut ObjectRays, ledger: &mut RayLedger) {
        self.weigh_at(&self.image_powers(image), pupil, rays, ledger);
    }

    fn weigh_at(
        &self,
        image_powers: &[f64; IMAGE_TERMS],
        pupil: [&[f64]; 2],
        rays: &mut ObjectRays,
        ledger: &mut RayLedger,
    ) {
        rays.resize(pupil[0].len().min(pupil[1].len()));
        let weight = &mut rays.weight;
        let pupil = pupil.map(|values| &values[..weight.len()]);
        let mut at = [0.0; PUPIL_TERMS_MAX];
        self.weight.at(image_powers, self.degree, &mut at);
        evaluate(self.degree, &at, pupil, weight);
        let mut lost = 0;
        let mut places = [at; 2];
        for (stop, components) in &self.masks {
            let met = components.iter().zip(&mut places);
            met.for_each(|(component, at)| component.at(image_powers, self.degree, at));
            if !stop.passes_disc(&reach(&places, self.degree, pupil)) {
                lost += self.block(stop, &places, pupil, weight, ledger);
            }
        }
        ledger.launched += weight.len() as u64;
        ledger.arrived += weight.len() as u64 - lost;
    }

    /// Takes the weight of the rays that a mask stops; how many they are.
    fn block(
        &self,
        stop: &Stop,
        places: &[AtImage; 2],
        pupil: [&[f64]; 2],
        weight: &mut [f64],
        ledger: &mut RayLedger,
    ) -> u64 {
        let mut lost = 0;
        for first in (0..weight.len()).step_by(TOGETHER) {
            let range = first..weight.len().min(first + TOGETHER);
            let mut met_mm = [[0.0; TOGETHER]; 2];
            for (met_mm, places) in met_mm.iter_mut().zip(places) {
                evaluate(self.degree, places, pupil.map(|values| &values[range.clone()]), &mut met_mm[..range.len()]);
            }
            for (lane, weight) in weight[range].iter_mut().enumerate() {
                if *weight != 0.0 && stop.check([met_mm[0][lane], met_mm[1][lane]]).is_err() {
                    *weight = 0.0;
                    lost += 1;
                    ledger.settle(RayFate::Blocked { aperture: stop.aperture });
                }
            }
        }
        lost
    }
}

impl Component {
    /// Puts its coefficients at an image point into `at`.
    fn at(&self, image_powers: &[f64; IMAGE_TERMS], degree: usize, at: &mut AtImage) {
        add_up(&self.0, image_powers, &mut at[..terms(degree)]);
    }

    /// The constant, and the absolute values of all other coefficients added up: no ray goes farther from it.
    fn sums(&self) -> (f64, f64) {
        (self.0[0], self.0[1..].iter().map(|factor| factor.abs()).sum())
    }
}

/// Sum of rows, each times its factor.
#[multiversion(targets("x86_64+avx2+fma"))]
fn add_up(rows: &[f64], factors: &[f64], sums: &mut [f64]) {
    sums.fill(0.0);
    for (factor, row) in factors.iter().zip(rows.chunks_exact(sums.len())) {
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum = value.mul_add(*factor, *sum));
    }
}

/// A disc that holds where the rays to these pupil points go: what is linear in u spreads over an ellipse, and the other
/// terms add no more than they are.
fn reach([x, y]: &[AtImage; 2], degree: usize, pupil: [&[f64]; 2]) -> Disc {
    // The powers of u_y alone come first, then those with one u_x.
    let [along_y, along_x] = [1, degree + 1];
    let higher = |at: &AtImage| {
        let all: f64 = at[1..].iter().map(|factor| factor.abs()).sum();
        all - at[along_x].abs() - at[along_y].abs()
    };
    let [a, b, c, d] = [x[along_x], x[along_y], y[along_x], y[along_y]];
    let (squares, determinant) = (a * a + b * b + c * c + d * d, a * d - b * c);
    // The larger singular value.
    let stretch = (0.5 * (squares + (squares * squares - 4.0 * determinant * determinant).max(0.0).sqrt())).sqrt();
    let reach = farthest(pupil);
    Disc { centre: [x[0], y[0]], radius: reach * stretch + higher(x).hypot(higher(y)) * reach.max(reach * reach) }
}

/// Radius of the farthest pupil point.
#[multiversion(targets("x86_64+avx2"))]
fn farthest([u, v]: [&[f64]; 2]) -> f64 {
    const LANES: usize = 8;
    let mut lanes = [0.0_f64; LANES];
    for (u, v) in u.chunks(LANES).zip(v.chunks(LANES)) {
        for (lane, (u, v)) in lanes.iter_mut().zip(u.iter().zip(v)) {
            let square = u * u + v * v;
            *lane = if square > *lane { square } else { *lane };
        }
    }
    lanes.into_iter().fold(0.0, f64::max).sqrt()
}

/// A component for rays to many pupil points.
#[multiversion(targets("x86_64+avx2+fma"))]
fn evaluate(degree: usize, at: &AtImage, pupil: [&[f64]; 2], values: &mut [f64]) {
    match degree {
        3 => horner::<3>(at, pupil, values),
        5 => horner::<5>(at, pupil, values),
        _ => horner::<7>(at, pupil, values),
    }
}

/// Horner's scheme in both directions.
#[inline(always)]
fn horner<const DEGREE: usize>(at: &AtImage, [u, v]: [&[f64]; 2], values: &mut [f64]) {
    for (value, (u, v)) in values.iter_mut().zip(u.iter().zip(v)) {
        let (mut sum, mut end) = (0.0_f64, terms(DEGREE));
        for power in (0..=DEGREE).rev() {
            let row = &at[end - (DEGREE + 1 - power)..end];
            end -= row.len();
            let along_v = row.iter().rev().fold(0.0_f64, |sum, factor| sum.mul_add(*v, *factor));
            sum = sum.mul_add(*u, along_v);
        }
        *value = sum;
    }
}

/// From values at all nodes to coefficients: what the nodes count.
struct Fit {
    /// For every power of a each image node.
    image: Vec<f64>,
    /// For every pupil node each power of u.
    pupil: Vec<f64>,
    degree: usize,
}

/// For every one of [`DEGREES`].
static FITS: LazyLock<[Fit; DEGREES.len()]> = LazyLock::new(|| {
    DEGREES.map(|degree| Fit {
        image: pseudo_inverse(&image_nodes(), IMAGE_DEGREE),
        pupil: transposed(&pseudo_inverse(&pupil_nodes(), degree), PUPIL_NODES_ALL),
        degree,
    })
});

impl Fit {
    /// Values go from pupil node to pupil node, then from image node to image node.
    fn through(&self, values: &[f64]) -> Component {
        let terms = terms(self.degree);
        let mut by_image_node = vec![0.0; IMAGE_NODES_ALL * terms];
        let nodes = values.chunks_exact(PUPIL_NODES_ALL).zip(by_image_node.chunks_exact_mut(terms));
        nodes.for_each(|(values, sums)| add_up(&self.pupil, values, sums));
        let mut coefficients = vec![0.0; IMAGE_TERMS * terms];
        let powers = self.image.chunks_exact(IMAGE_NODES_ALL).zip(coefficients.chunks_exact_mut(terms));
        powers.for_each(|(shares, sums)| add_up(&by_image_node, shares, sums));
        Component(coefficients)
    }
}

/// For every power up to a degree what each node counts in the polynomial that comes nearest to all.
fn pseudo_inverse(nodes: &[[f64; 2]], degree: usize) -> Vec<f64> {
    let mut rows = vec![0.0; nodes.len() * terms(degree)];
    nodes.iter().zip(rows.chunks_exact_mut(terms(degree))).for_each(|(node, row)| powers(*node, degree, row));
    let columns: Vec<Vec<f64>> = transposed(&rows, terms(degree)).chunks(nodes.len()).map(<[f64]>::to_vec).collect();
    let by_node: Vec<f64> = (0..nodes.len())
        .flat_map(|node| {
            let unit = (0..nodes.len()).map(|other| f64::from(u8::from(other == node))).collect();
            least_squares(columns.clone(), [unit, vec![0.0; nodes.len()]]).into_iter().map(|[factor, _]| factor)
        })
        .collect();
    transposed(&by_node, terms(degree))
}

/// Rows of `width` values as columns.
fn transposed(rows: &[f64], width: usize) -> Vec<f64> {
    (0..width).flat_map(|column| rows.iter().skip(column).step_by(width).copied()).collect()
}

fn image_nodes() -> Vec<[f64; 2]> {
    quadrants(IMAGE_NODES).map(|place| place.map(|c| IMAGE_SPREAD * c)).collect()
}

fn pupil_nodes() -> Vec<[f64; 2]> {
    quadrants(PUPIL_NODES).map(|place| place.map(|c| PUPIL_SPREAD * c)).collect()
}

/// Places on the rim, and between it and the middle.
fn check_places(count: usize) -> Vec<[f64; 2]> {
    let inner = rim(count).map(|[x, y]| [0.55 * y, -0.55 * x]);
    rim(count).chain(inner).chain([[0.0; 2]]).collect()
}
