//! A block of rays through a face: a loop over its lanes without a branch, so that it is vectorised.
//!
//! Products and sums are fused (`mul_add`) wherever they can be: it saves a third of the instructions, and of a short
//! loop the processor has more turns under way at once, which hides the twenty cycles that a root takes. Results are the
//! same to the last bit on every machine; one that cannot fuse takes some twenty times as long.

use multiversion::multiversion;

use super::asphere::{self, Met};
use super::face::{Action, Clear, Face, Profile};
use super::fate::{BLOCKED, Code, MISSED, REFLECTED, VIGNETTED, code};
use super::rays::{Block, LANES};
use super::rigid::{Rigid, apply};
use crate::refraction::Vector;
use crate::stop::holds;

/// Sends a block through faces, one after the other.
#[multiversion(targets("x86_64+avx2+fma"))]
pub(crate) fn trace(faces: &[Face], block: &mut Block) {
    for face in faces {
        pass(face, block);
    }
}

#[inline(always)]
fn pass(face: &Face, block: &mut Block) {
    place(&face.from_previous, block);
    match &face.profile {
        Profile::Plane => act(face, &Flat, block),
        Profile::Sphere { c } if (c * face.from_previous.origin[2]).abs() < NEAR && !face.is_first => {
            act(face, &Sphere { c: *c }, block);
        }
        Profile::Sphere { c } => act(face, &FarSphere { near: Sphere { c: *c } }, block),
        Profile::Conic { c, k } => act(face, &Conic { c: *c, k: *k }, block),
        Profile::Cylinder { c, along: 0 } => act(face, &Cylinder::<0> { c: *c }, block),
        Profile::Cylinder { c, .. } => act(face, &Cylinder::<1> { c: *c }, block),
        Profile::Asphere(polynomial) => {
            let met = asphere::meet(polynomial, face.from_previous.origin[2], block);
            act(face, &met, block);
        }
        Profile::Fresnel(polynomial) => {
            let met = asphere::meet_flat(polynomial, face.from_previous.origin[2], block);
            act(face, &met, block);
        }
        Profile::Facets(facets) => facets.pass(face, block),
    }
    clip(&face.clear, face.index, block);
}

/// Into axes that are turned or shifted sideways.
#[inline(always)]
fn place(from_previous: &Rigid, block: &mut Block) {
    let rows = &from_previous.turn;
    if *rows != Rigid::IDENTITY.turn {
        for lane in 0..block.lanes() {
            let (position, direction) = (apply(rows, block.position(lane)), apply(rows, block.going(lane)));
            block.put(lane, position, direction);
        }
    }
    for (component, shift_mm) in block.position_mm.iter_mut().zip(&from_previous.origin[..2]) {
        if *shift_mm != 0.0 {
            component.iter_mut().for_each(|at_mm| *at_mm += shift_mm);
        }
    }
}

#[inline(always)]
fn act<S: Surface>(face: &Face, surface: &S, block: &mut Block) {
    match face.action {
        Action::Pass => step(face, surface, &Straight, block),
        Action::Refract { index_ratio } => step(face, surface, &Refracting { index_ratio }, block),
        Action::Reflect => step(face, surface, &Reflecting, block),
        Action::ThinLens { power_per_mm } => step(face, surface, &Bending { power_per_mm }, block),
    }
}

/// From the face before to this one, and on behind it.
#[inline(always)]
fn step<S: Surface, B: Bend>(face: &Face, surface: &S, bend: &B, block: &mut Block) {
    let ([_, outer_mm2], ahead_z_mm, index) = (face.clear.squares_mm2, face.from_previous.origin[2], face.index_before);
    // As wide as the lanes, which a `bool` would first have to be packed into.
    let mut lost = 0_u64;
    for lane in 0..block.lanes() {
        let direction = block.going(lane);
        let [x, y, z] = block.position(lane);
        let from_vertex = [x, y, z + ahead_z_mm];
        let hit = surface.hit(lane, from_vertex, direction);
        let place = moved(from_vertex, hit.distance_mm, direction);
        let behind = bend.bend(surface, lane, direction, &hit, place);
        let passes = surface.is_met(lane, place) & (across(place) <= outer_mm2) & behind.goes_on;
        lost |= if passes { 0 } else { 1 };
        block.path_mm[lane] = index.mul_add(hit.distance_mm, block.path_mm[lane] + behind.path_mm);
        block.put(lane, place, behind.direction);
    }
    if lost != 0 {
        lose(face, surface, block);
    }
}

/// Says what has become of the rays that did not pass.
#[inline(always)]
fn lose<S: Surface>(face: &Face, surface: &S, block: &mut Block) {
    let (missed, vignetted) = (code(face.index, MISSED), code(face.index, VIGNETTED));
    let reflected = code(face.index, REFLECTED);
    let [_, outer_mm2] = face.clear.squares_mm2;
    for lane in 0..block.lanes() {
        let (place, forward) = (block.position(lane), block.direction[2][lane]);
        let square_mm2 = across(place);
        let loss = if forward.is_nan() { reflected } else { 0 };
        let loss = if square_mm2 <= outer_mm2 { loss } else { vignetted };
        let loss = if surface.is_met(lane, place) & (square_mm2 <= f64::MAX) { loss } else { missed };
        let fate = block.fate[lane];
        block.fate[lane] = if fate == 0 { loss } else { fate };
    }
}

/// The point of a ray that is nearest to the vertex, and how far ahead it lies. From there nothing cancels, however far the
/// ray has come.
#[inline(always)]
fn nearest_to_vertex(position: Vector, direction: Vector) -> (Vector, f64) {
    let ahead_mm = -product(position, direction);
    (moved(position, ahead_mm, direction), ahead_mm)
}

/// a · b, fused.
#[inline(always)]
fn product(a: Vector, b: Vector) -> f64 {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// x + t d, fused.
#[inline(always)]
pub(crate) fn moved(x: Vector, t: f64, d: Vector) -> Vector {
    [t.mul_add(d[0], x[0]), t.mul_add(d[1], x[1]), t.mul_add(d[2], x[2])]
}

/// Squared distance from the axis.
#[inline(always)]
pub(crate) fn across(place: Vector) -> f64 {
    place[0].mul_add(place[0], place[1] * place[1])
}

/// A root, which has no sign, with that of `sign`.
#[inline(always)]
fn signed(root: f64, sign: f64) -> f64 {
    f64::from_bits(root.to_bits() | (sign.to_bits() & (-0.0_f64).to_bits()))
}

/// Where a ray meets a surface.
struct Hit {
    /// Along the ray.
    distance_mm: f64,
    /// −direction · normal, which has the sign of d_z, and its square.
    against: f64,
    against_squared: f64,
}

/// A kind of surface. Its normals point against z at the vertex.
trait Surface {
    /// Where a ray from x in direction d meets it.
    fn hit(&self, lane: usize, x: Vector, d: Vector) -> Hit;

    /// `direction + t normal`.
    fn along_normal(&self, lane: usize, direction: Vector, t: f64, place: Vector) -> Vector;

    /// normal²; 1 unless the surface has a simpler vector along its normal.
    #[inline(always)]
    fn normal_squared(&self, _: usize, _: Vector) -> f64 {
        1.0
    }

    /// Whether a place where a ray meets it belongs to the sheet of the vertex; false if it is NaN.
    fn is_met(&self, lane: usize, place: Vector) -> bool;
}

struct Flat;

impl Surface for Flat {
    #[inline(always)]
    fn hit(&self, _: usize, x: Vector, d: Vector) -> Hit {
        Hit { distance_mm: -x[2] / d[2], against: d[2], against_squared: d[2] * d[2] }
    }

    #[inline(always)]
    fn along_normal(&self, _: usize, [x, y, z]: Vector, t: f64, _: Vector) -> Vector {
        [x, y, z - t]
    }

    #[inline(always)]
    fn is_met(&self, _: usize, _: Vector) -> bool {
        true
    }
}

/// A sphere that rays reach from nearby.
///
/// ```text
/// c t² − 2 b t + q = 0,    b = d_z − c x·d,    q = c x² − 2 z,    cos I = √(b² − c q)
/// ```
struct Sphere {
    c: f64,
}

/// How far away a sphere may be to be reached from where rays are, in radii: b² loses no more than two digits.
const NEAR: f64 = 4.0;

impl Surface for Sphere {
    #[inline(always)]
    fn hit(&self, _: usize, x: Vector, d: Vector) -> Hit {
        let half = (-self.c).mul_add(product(x, d), d[2]);
        let constant = self.c.mul_add(product(x, x), -2.0 * x[2]);
        solve(d[2], half, half.mul_add(half, -self.c * constant), constant)
    }

    #[inline(always)]
    fn along_normal(&self, _: usize, direction: Vector, t: f64, place: Vector) -> Vector {
        let [x, y, z] = moved(direction, t * self.c, place);
        [x, y, z - t]
    }

    #[inline(always)]
    fn is_met(&self, _: usize, place: Vector) -> bool {
        self.c * place[2] <= 1.0
    }
}

/// A sphere that rays reach from afar, by way of the point p nearest to its vertex, where p·d = 0.
///
/// ```text
/// c t² − 2 d_z t + c p² − 2 p_z = 0
/// ```
///
/// [Welford, Aberrations of Optical Systems, sec. 4.3]
struct FarSphere {
    near: Sphere,
}

impl Surface for FarSphere {
    #[inline(always)]
    fn hit(&self, _: usize, x: Vector, d: Vector) -> Hit {
        let c = self.near.c;
        let (p, ahead_mm) = nearest_to_vertex(x, d);
        let constant = c.mul_add(product(p, p), -2.0 * p[2]);
        solve(d[2], d[2], d[2].mul_add(d[2], -c * constant), constant).after(ahead_mm)
    }

    #[inline(always)]
    fn along_normal(&self, lane: usize, direction: Vector, t: f64, place: Vector) -> Vector {
        self.near.along_normal(lane, direction, t, place)
    }

    #[inline(always)]
    fn normal_squared(&self, lane: usize, place: Vector) -> f64 {
        self.near.normal_squared(lane, place)
    }

    #[inline(always)]
    fn is_met(&self, lane: usize, place: Vector) -> bool {
        self.near.is_met(lane, place)
    }
}

/// A conic of revolution, reached in the same way.
///
/// ```text
/// c (x² + y² + (1 + k) z²) − 2 z = 0
/// ```
struct Conic {
    c: f64,
    k: f64,
}

impl Surface for Conic {
    #[inline(always)]
    fn hit(&self, _: usize, x: Vector, d: Vector) -> Hit {
        let Self { c, k } = *self;
        let (p, ahead_mm) = nearest_to_vertex(x, d);
        let constant = c.mul_add(product(p, p) + k * p[2] * p[2], -2.0 * p[2]);
        let half = (-c * k * p[2]).mul_add(d[2], d[2]);
        let quadratic = c * (k * d[2]).mul_add(d[2], 1.0);
        solve(d[2], half, half.mul_add(half, -quadratic * constant), constant).after(ahead_mm)
    }

    #[inline(always)]
    fn along_normal(&self, _: usize, direction: Vector, t: f64, [x, y, z]: Vector) -> Vector {
        let [x, y, z] = moved(direction, t * self.c, [x, y, (1.0 + self.k) * z]);
        [x, y, z - t]
    }

    /// `1 − k c² r²`, since it is a conic.
    #[inline(always)]
    fn normal_squared(&self, _: usize, place: Vector) -> f64 {
        (-self.k * self.c * self.c).mul_add(across(place), 1.0)
    }

    #[inline(always)]
    fn is_met(&self, _: usize, place: Vector) -> bool {
        self.c * (1.0 + self.k) * place[2] <= 1.0
    }
}

/// A cylinder, curved along one component: a circle in that one and z.
struct Cylinder<const ALONG: usize> {
    c: f64,
}

impl<const ALONG: usize> Surface for Cylinder<ALONG> {
    #[inline(always)]
    fn hit(&self, _: usize, x: Vector, d: Vector) -> Hit {
        let c = self.c;
        let (p, ahead_mm) = nearest_to_vertex(x, d);
        let constant = c.mul_add(p[ALONG] * p[ALONG] + p[2] * p[2], -2.0 * p[2]);
        let half = d[2] - c * (p[ALONG] * d[ALONG] + p[2] * d[2]);
        let quadratic = c * (d[ALONG] * d[ALONG] + d[2] * d[2]);
        solve(d[2], half, half.mul_add(half, -quadratic * constant), constant).after(ahead_mm)
    }

    #[inline(always)]
    fn along_normal(&self, _: usize, direction: Vector, t: f64, place: Vector) -> Vector {
        let mut out = direction;
        out[ALONG] += t * self.c * place[ALONG];
        out[2] += t * (self.c * place[2] - 1.0);
        out
    }

    #[inline(always)]
    fn is_met(&self, _: usize, place: Vector) -> bool {
        self.c * place[2] <= 1.0
    }
}

/// The distance t of `a t² − 2 half t + constant = 0`, `square` = half² − a · constant, that stays where a vanishes.
#[inline(always)]
fn solve(forward: f64, half: f64, square: f64, constant: f64) -> Hit {
    let root = signed(square.sqrt(), forward);
    Hit { distance_mm: constant / (half + root), against: root, against_squared: square }
}

impl Hit {
    /// Of a ray that starts farther back.
    #[inline(always)]
    fn after(self, ahead_mm: f64) -> Self {
        Self { distance_mm: ahead_mm + self.distance_mm, ..self }
    }
}

impl Surface for Met {
    #[inline(always)]
    fn hit(&self, lane: usize, x: Vector, d: Vector) -> Hit {
        let distance_mm = self.distance_mm[lane];
        let against = -product(self.normal(lane, moved(x, distance_mm, d)), d);
        Hit { distance_mm, against, against_squared: against * against }
    }

    #[inline(always)]
    fn along_normal(&self, lane: usize, direction: Vector, t: f64, place: Vector) -> Vector {
        moved(direction, t, self.normal(lane, place))
    }

    #[inline(always)]
    fn normal_squared(&self, lane: usize, place: Vector) -> f64 {
        let normal = self.normal(lane, place);
        product(normal, normal)
    }

    #[inline(always)]
    fn is_met(&self, lane: usize, _: Vector) -> bool {
        self.is_met[lane]
    }
}

impl Met {
    #[inline(always)]
    fn normal(&self, lane: usize, [x, y, _]: Vector) -> Vector {
        [self.slope_per_radius[lane] * x, self.slope_per_radius[lane] * y, -1.0]
    }
}

/// A ray behind a surface.
struct Behind {
    direction: Vector,
    /// Path length that the surface itself adds, mm.
    path_mm: f64,
    /// Whether it gets there.
    goes_on: bool,
}

/// What a surface does to rays.
trait Bend {
    fn bend<S: Surface>(&self, surface: &S, lane: usize, direction: Vector, hit: &Hit, place: Vector) -> Behind;
}

struct Straight;

impl Bend for Straight {
    #[inline(always)]
    fn bend<S: Surface>(&self, _: &S, _: usize, direction: Vector, _: &Hit, _: Vector) -> Behind {
        Behind { direction, path_mm: 0.0, goes_on: true }
    }
}

/// Snell's law, as [`refract`](crate::refraction::refract) has it for a direction of unit length.
struct Refracting {
    index_ratio: f64,
}

impl Bend for Refracting {
    #[inline(always)]
    fn bend<S: Surface>(&self, surface: &S, lane: usize, direction: Vector, hit: &Hit, place: Vector) -> Behind {
        let (ratio, ratio_squared) = (self.index_ratio, self.index_ratio * self.index_ratio);
        let normal_squared = surface.normal_squared(lane, place);
        let square = ratio_squared.mul_add(hit.against_squared, (1.0 - ratio_squared) * normal_squared);
        let t = ratio.mul_add(hit.against, -signed(square.sqrt(), hit.against)) / normal_squared;
        let scaled = [ratio * direction[0], ratio * direction[1], ratio * direction[2]];
        let direction = surface.along_normal(lane, scaled, t, place);
        Behind { direction, path_mm: 0.0, goes_on: square >= 0.0 }
    }
}

struct Reflecting;

impl Bend for Reflecting {
    #[inline(always)]
    fn bend<S: Surface>(&self, surface: &S, lane: usize, direction: Vector, hit: &Hit, place: Vector) -> Behind {
        let t = 2.0 * hit.against / surface.normal_squared(lane, place);
        Behind { direction: surface.along_normal(lane, direction, t, place), path_mm: 0.0, goes_on: true }
    }
}

/// An ideal lens. Its path length makes light that comes along the axis meet in the focal point in phase:
/// `f − √(f² + r²)`, with the sign of f.
struct Bending {
    power_per_mm: f64,
}

impl Bend for Bending {
    #[inline(always)]
    fn bend<S: Surface>(&self, _: &S, _: usize, direction: Vector, _: &Hit, place: Vector) -> Behind {
        let (power, per_z) = (self.power_per_mm, 1.0 / direction[2]);
        // Towards the axis, whichever way the light runs.
        let pull = power * 1.0_f64.copysign(per_z);
        let (gx, gy) = (direction[0] * per_z - place[0] * pull, direction[1] * per_z - place[1] * pull);
        let along = (1.0 / (1.0 + gx * gx + gy * gy).sqrt()).copysign(per_z);
        let square = across(place);
        let path_mm = -square * power / (1.0 + (1.0 + square * power * power).sqrt());
        Behind { direction: [gx * along, gy * along, along], path_mm, goes_on: true }
    }
}

/// What is clear only in parts.
#[inline(always)]
fn clip(clear: &Clear, index: usize, block: &mut Block) {
    let [inner_mm2, _] = clear.squares_mm2;
    if inner_mm2 > 0.0 {
        for lane in 0..block.lanes() {
            let passes = across(block.position(lane)) >= inner_mm2;
            settle(&mut block.fate[lane], passes, code(index, VIGNETTED));
        }
    }
    if let Some([half_width_mm, half_height_mm]) = clear.half_size_mm {
        for lane in 0..block.lanes() {
            let [x, y, _] = block.position(lane);
            let passes = (x.abs() <= half_width_mm) & (y.abs() <= half_height_mm);
            settle(&mut block.fate[lane], passes, code(index, VIGNETTED));
        }
    }
    let Some(mask) = &clear.rings else { return };
    let mut passes = [false; LANES];
    for ring in &mask.rings {
        for (lane, passes) in passes[..block.lanes()].iter_mut().enumerate() {
            let [x, y, _] = block.position(lane);
            let (x, y) = (x - mask.centre_mm[0], y - mask.centre_mm[1]);
            *passes |= holds(ring, x * x + y * y);
        }
    }
    let lanes = block.lanes();
    for (fate, passes) in block.fate[..lanes].iter_mut().zip(passes) {
        settle(fate, passes, code(index, BLOCKED));
    }
}

/// Ends the way of a ray that does not pass, unless it has ended already.
#[inline(always)]
fn settle(fate: &mut Code, passes: bool, loss: Code) {
    *fate = if passes | (*fate != 0) { *fate } else { loss };
}
