//! A disc whose pencils the masks cut.
//!
//! What a mask takes is an area of the pupil's disc P: that of its own shadow M within it and, where the dot D does not
//! fill the pencil, within the dot as well:
//!
//! ```text
//! open = 1 − |P∩M|/π        light = (|P∩D| − |P∩D∩M|)/π
//! ```
//!
//! `|P∩D|` is the light of the uncut spot, `|P∩M|` the overlap of two discs. Only where the edge of the dot and that of a
//! mask meet in a pencil, lines across the pupil have to tell the rest, see [`chords`](crate::likelihood::chords).

use multiversion::multiversion;
use smallvec::SmallVec;

use crate::likelihood::arcs::taken;
use crate::likelihood::chords::{
    Circles, Dots, Edges, LANES, LINES, Lanes, POSITIONS, lanes, moments, open_lengths, passing, share,
};
use crate::likelihood::light::{EdgeView, Light, Local, Places, SHARP_PX};
use crate::likelihood::pencil::Edge;
use crate::likelihood::sharp::Trapezoid;
use crate::likelihood::soft::{Overlap, in_the_middle};
use crate::likelihood::spot::Spot;

/// From this blur on two points across an edge stand for the square of a pixel.
const TWO_POINTS_PX: f64 = 12.0;

/// Root of the mean square distance from the middle of a pixel along a row.
const HALF_WIDTH_PX: f32 = 0.288_675_13;

/// Lines across the pupil of a nearly sharp pixel, at [`POSITIONS`]: half their lengths, and shares of the pupil.
const LINE_HALVES: [f32; LINES] = [
    0.183_749_51,
    0.361_241_67,
    0.526_432_16,
    0.673_695_6,
    0.798_017_2,
    0.895_163_3,
    0.961_825_64,
    0.995_734_18,
    0.995_734_18,
    0.961_825_64,
    0.895_163_3,
    0.798_017_2,
    0.673_695_6,
    0.526_432_16,
    0.361_241_67,
    0.183_749_51,
];
const LINE_SHARES: [f32; LINES] = [
    0.003_972_221_8,
    0.015_352_417,
    0.032_603_626,
    0.053_395_98,
    0.074_921_352,
    0.094_272_63,
    0.108_836_3,
    0.116_645_48,
    0.116_645_48,
    0.108_836_3,
    0.094_272_63,
    0.074_921_352,
    0.053_395_98,
    0.032_603_626,
    0.015_352_417,
    0.003_972_221_8,
];

/// Turns the light of an uncut spot into that of the cut one.
pub(crate) fn cut(spot: &Spot, local: &Local, places: &Places, out: &mut Light) {
    let points = Points::of(spot);
    if let [way] = spot.ways.as_slice() {
        cut_way(&Way::of(way, spot), local, points, places, out);
        return;
    }
    let uncut = out.clone();
    let mut sum = Light::default();
    sum.resize(places.len());
    for way in &spot.ways {
        out.clone_from(&uncut);
        cut_way(&Way::of(way, spot), local, points, places, out);
        sum.add(out);
    }
    *out = sum;
}

/// Adds what only lines across the pupil tell of an uncut spot whose outline is foreshortened.
pub(crate) fn by_lines(local: &Local, places: &Places, out: &mut Light) {
    let mut meetings = std::mem::take(&mut out.meetings);
    meetings.touched.clear();
    meetings.touched.resize(places.len(), 1.0);
    meetings.find(local, places);
    add_by_lines(local, places, &meetings.soft, out);
    out.meetings = meetings;
}

impl Light {
    fn add(&mut self, other: &Self) {
        let add = |sum: &mut [f32], other: &[f32]| sum.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
        add(&mut self.light, &other.light);
        add(&mut self.with_u, &other.with_u);
        add(&mut self.with_v, &other.with_v);
        add(&mut self.with_radius, &other.with_radius);
        add(&mut self.with_blur, &other.with_blur);
        add(&mut self.open, &other.open);
    }
}

/// Where masks cut the pencils of samples, and where in such pencils the edge of the dot lies.
#[derive(Debug, Clone, Default)]
pub(crate) struct Meetings {
    /// 1 where a mask cuts the pencil, 0 elsewhere.
    touched: Vec<f32>,
    /// Of the former, 1 where the edge of the dot is in the pencil too, and 2 where its blur is below [`SHARP_PX`].
    kind: Vec<f32>,
    /// Samples of the one and of the other kind.
    soft: Vec<u32>,
    sharp: Vec<u32>,
}

impl Meetings {
    /// Finds the edge of the dot in the pencils that are touched.
    fn find(&mut self, local: &Local, places: &Places) {
        self.kind.clear();
        self.kind.resize(places.len(), 0.0);
        kinds(local, places, &self.touched, &mut self.kind);
        let kind = &self.kind[..places.edge];
        pick(kind, 1.0, &mut self.soft);
        pick(kind, 2.0, &mut self.sharp);
    }
}

/// The samples of a kind.
fn pick(kind: &[f32], wanted: f32, picked: &mut Vec<u32>) {
    picked.clear();
    picked.resize(kind.len(), 0);
    let mut count = 0;
    // Each is written, and the next one over it unless it is wanted: branches cost more where kinds alternate.
    for (index, kind) in (0..).zip(kind) {
        picked[count] = index;
        count += usize::from(*kind == wanted);
    }
    picked.truncate(count);
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn kinds(local: &Local, places: &Places, touched: &[f32], kind: &mut [f32]) {
    let count = places.edge;
    let (du, dv) = (&places.du[..count], &places.dv[..count]);
    let (touched, kind) = (&touched[..count], &mut kind[..count]);
    for index in 0..count {
        let edge = EdgeView::at(local, du[index], dv[index]);
        let near = if edge.is_felt() { touched[index] } else { 0.0 };
        kind[index] = if edge.blur_px.abs() < SHARP_PX as f32 { 2.0 * near } else { near };
    }
}

/// The edges along one way through the masks.
struct Way {
    /// Light passes outside the shut ones and inside the rims.
    shuts: SmallVec<[Circle; 2]>,
    rims: SmallVec<[Circle; 2]>,
}

/// An [`Edge`] in the unit disc of the pupil.
#[derive(Debug, Clone, Copy)]
struct Circle {
    /// As the centre of the spot sees its centre.
    x: f32,
    y: f32,
    /// Movement of that with the place.
    per_px: f32,
    radius: f32,
}

impl Way {
    fn of(way: &[Edge], spot: &Spot) -> Self {
        let [x_mm, y_mm] = spot.image_mm(spot.centre_px);
        let circles = |passes_inside: bool| {
            let edges = way.iter().filter(move |edge| edge.passes_inside == passes_inside);
            let circle = |edge: &Edge| Circle {
                x: (edge.start[0] + edge.per_image * x_mm) as f32,
                y: (edge.start[1] + edge.per_image * y_mm) as f32,
                per_px: (edge.per_image * spot.pitch_mm) as f32,
                radius: edge.radius as f32,
            };
            edges.map(circle).collect()
        };
        Self { shuts: circles(false), rims: circles(true) }
    }

    /// The shut circles and the rims as samples see them.
    #[inline(always)]
    fn seen_by(&self, edges: &Edges) -> [SmallVec<[Circles; 2]>; 2] {
        let mut seen = [SmallVec::new(), SmallVec::new()];
        // Functions that are handed closures may not be made for the processor.
        for (seen, circles) in seen.iter_mut().zip([&self.shuts, &self.rims]) {
            for circle in circles {
                seen.push(circle.seen_by(edges));
            }
        }
        seen
    }
}

impl Circle {
    #[inline(always)]
    fn seen_by(&self, edges: &Edges) -> Circles {
        let mut seen = Circles { x: [0.0; LANES], y: [0.0; LANES], radius: self.radius, per_px: self.per_px };
        for lane in 0..LANES {
            let x = self.per_px.mul_add(edges.du[lane], self.x);
            let y = self.per_px.mul_add(edges.dv[lane], self.y);
            seen.x[lane] = edges.normal_u[lane].mul_add(x, edges.normal_v[lane] * y);
            seen.y[lane] = edges.normal_u[lane].mul_add(y, -edges.normal_v[lane] * x);
        }
        seen
    }
}

/// Turns the light of an uncut spot into what passes one way.
fn cut_way(way: &Way, local: &Local, points: Points, places: &Places, out: &mut Light) {
    let count = places.len();
    let mut meetings = std::mem::take(&mut out.meetings);
    meetings.touched.clear();
    meetings.touched.resize(count, 0.0);
    out.open.fill(1.0);
    for circle in &way.shuts {
        close(circle, 1.0, places, &mut meetings.touched, &mut out.open);
    }
    for circle in &way.rims {
        close(circle, -1.0, places, &mut meetings.touched, &mut out.open);
    }
    if way.rims.len() > 1 || !(way.rims.is_empty() || way.shuts.is_empty()) {
        open_by_lines(way, local, places, &meetings.touched, &mut out.open);
    }
    meetings.find(local, places);
    cut_sharp(way, local, places, &meetings.sharp, out);
    cut_soft(way, local, points, places, &meetings.soft, out);
    dim(&meetings.kind, out);
    out.meetings = meetings;
}

/// Takes what one circle shuts, inside (1) or outside (−1), from the open share of the pencils.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn close(circle: &Circle, inside: f32, places: &Places, touched: &mut [f32], open: &mut [f32]) {
    let count = places.len();
    let (du, dv) = (&places.du[..count], &places.dv[..count]);
    let (touched, open) = (&mut touched[..count], &mut open[..count]);
    let Circle { x, y, per_px, radius } = *circle;
    let spread = places.square_px * per_px.abs() * HALF_WIDTH_PX;
    let is_wide = places.square_px > 1.0;
    for index in 0..count {
        let (x, y) = (per_px.mul_add(du[index], x), per_px.mul_add(dv[index], y));
        let offset = x.mul_add(x, y * y).sqrt();
        // Across the square of a block the shadow's edge bends. Two places on either side have its second moment along the
        // way to the middle; that across it lies farther from there.
        let shadow = |offset: f32| Overlap::of(offset, radius).light;
        let within = if is_wide {
            let middle = offset.mul_add(offset, spread * spread).sqrt();
            0.5 * (shadow(middle + spread) + shadow((middle - spread).abs()))
        } else {
            shadow(offset)
        };
        let within = radius * radius * within;
        let shut = if inside > 0.0 { within } else { 1.0 - within };
        let meets = inside * (offset - radius) < 1.0 + spread;
        touched[index] = if meets { 1.0 } else { touched[index] };
        open[index] = if meets { (open[index] - shut).clamp(0.0, 1.0) } else { open[index] };
    }
}

/// The open share where several circles may overlap, one of them a rim.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn open_by_lines(way: &Way, local: &Local, places: &Places, touched: &[f32], open: &mut [f32]) {
    let touched: Vec<u32> = (0..places.len() as u32).filter(|index| touched[*index as usize] > 0.0).collect();
    for indices in touched.chunks(LANES) {
        let edges = Edges::of(local, places, indices);
        let [shuts, rims] = way.seen_by(&edges);
        let passing = passing(None, &shuts, &rims);
        for (lane, index) in indices.iter().enumerate() {
            open[*index as usize] = passing[lane].clamp(0.0, 1.0);
        }
    }
}

/// What `sum` makes of all that lies within the rims, less what it makes of the part of that in each shut circle.
#[inline(always)]
fn opened(shuts: &[Circles], rims: &[Circles], sum: impl Fn(&[Circles]) -> [Lanes; 2]) -> [Lanes; 2] {
    let mut opened = sum(rims);
    let mut circles: SmallVec<[Circles; 3]> = SmallVec::from_slice(rims);
    for shut in shuts {
        circles.push(*shut);
        let taken = sum(&circles);
        circles.pop();
        for (opened, taken) in opened.iter_mut().zip(taken) {
            *opened = lanes(|lane| opened[lane] - taken[lane]);
        }
    }
    opened
}

/// Adds to the light of a cut spot, and to the ground about it, what its pencils get unevenly if the light of the scene
/// grows by `growth`, relative, 1/px.
///
/// The pixel at p sees the place p + b w through the point w of the pupil, b the blur's radius, and so, beyond
/// `(1 + growth·p)` times what even light would give it,
///
/// ```text
/// b growth·∫ w dw/π        over the open part of its pupil behind which the dot lies
/// ```
///
/// Where masks cut the pencils, as they were found to with the light, the samples are listed as lopsided; elsewhere nothing is
/// added.
pub(crate) fn uneven(spot: &Spot, growth: [f32; 2], places: &Places, out: &mut Light) {
    let mut lopsided = std::mem::take(&mut out.lopsided);
    lopsided.clear();
    // Of several ways only the last is told.
    let is_cut = |index: &u32| spot.ways.len() != 1 || out.meetings.touched[*index as usize] > 0.0;
    lopsided.extend((0..places.len() as u32).filter(is_cut));
    let local = Local::of(spot, places);
    for way in &spot.ways {
        add_uneven(&Way::of(way, spot), &local, growth, places, &lopsided, out);
    }
    out.lopsided = lopsided;
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn add_uneven(way: &Way, local: &Local, growth: [f32; 2], places: &Places, indices: &[u32], out: &mut Light) {
    for indices in indices.chunks(LANES) {
        let edges = Edges::of(local, places, indices);
        let [shuts, rims] = way.seen_by(&edges);
        let dots = Dots::stepped(local, &edges, &[0.0; LANES]);
        let grown = |[across, along]: [Lanes; 2]| {
            lanes(|lane| {
                let (cos, sin) = (edges.normal_u[lane], edges.normal_v[lane]);
                let (with_across, with_along) = (growth[0] * cos + growth[1] * sin, growth[1] * cos - growth[0] * sin);
                local.blur_px * (with_across * across[lane] + with_along * along[lane])
            })
        };
        let light = grown(opened(&shuts, &rims, |circles| moments(Some(&dots), circles)));
        let open = grown(opened(&shuts, &rims, |circles| moments(None, circles)));
        for (lane, index) in indices.iter().enumerate() {
            out.light[*index as usize] += light[lane];
            out.open[*index as usize] += open[lane];
        }
    }
}

/// Dims light and derivatives where the edge of the dot is not cut.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn dim(kind: &[f32], out: &mut Light) {
    let Light { light, with_u, with_v, with_radius, with_blur, open, .. } = out;
    for values in [light, with_u, with_v, with_radius, with_blur] {
        for (value, (open, kind)) in values.iter_mut().zip(open.iter().zip(kind)) {
            *value *= if *kind > 0.0 { 1.0 } else { *open };
        }
    }
}

/// Points across an edge that stand for the square of a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Points {
    /// With the second moment of the square, whichever way it is turned.
    Two,
    /// With the fourth too, see [`EdgeView::pixel_points`].
    Three,
}

impl Points {
    fn of(spot: &Spot) -> Self {
        if spot.blur_px_min() < TWO_POINTS_PX { Self::Three } else { Self::Two }
    }

    /// Mean over the squares of the samples of what `passing` makes of circles and of the dots behind the pupils.
    #[inline(always)]
    fn mean<const N: usize>(
        self,
        local: &Local,
        edges: &Edges,
        circles: [&[Circles]; N],
        passing: impl Fn(&Dots, [&[Circles]; N]) -> Lanes,
    ) -> Lanes {
        let (step_px, side) = match self {
            Self::Two => ([HALF_WIDTH_PX * local.square_px; LANES], [0.5; LANES]),
            Self::Three => (edges.point_px, edges.point_share),
        };
        let inner = stepped(local, edges, circles, &lanes(|lane| -step_px[lane]), &passing);
        let outer = stepped(local, edges, circles, &step_px, &passing);
        let sides = lanes(|lane| side[lane] * (inner[lane] + outer[lane]));
        if self == Self::Two {
            return sides;
        }
        let middle = stepped(local, edges, circles, &[0.0; LANES], &passing);
        lanes(|lane| sides[lane] + (1.0 - 2.0 * side[lane]) * middle[lane])
    }
}

/// What passes, seen from so far outwards of the samples' middles.
#[inline(always)]
fn stepped<const N: usize>(
    local: &Local,
    edges: &Edges,
    circles: [&[Circles]; N],
    outwards_px: &Lanes,
    passing: &impl Fn(&Dots, [&[Circles]; N]) -> Lanes,
) -> Lanes {
    let mut circles = circles.map(SmallVec::<[Circles; 2]>::from_slice);
    for circle in circles.iter_mut().flatten() {
        circle.step(outwards_px);
    }
    passing(&Dots::stepped(local, edges, outwards_px), circles.each_ref().map(SmallVec::as_slice))
}

impl Dots {
    /// Seen from so far outwards of the samples' middles, which the curvature of the edge moves a little.
    #[inline(always)]
    fn stepped(local: &Local, edges: &Edges, outwards_px: &Lanes) -> Self {
        Self::behind(local, edges, &lanes(|lane| outwards_px[lane] + edges.curvature_px[lane]))
    }
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn add_by_lines(local: &Local, places: &Places, indices: &[u32], out: &mut Light) {
    for indices in indices.chunks(LANES) {
        let edges = Edges::of(local, places, indices);
        let middles = Dots::stepped(local, &edges, &[0.0; LANES]);
        let slanted = share(Some(&middles), &[]);
        // What lines tell otherwise changes little across a pixel.
        let more = lanes(|lane| slanted[lane] - in_the_middle(local, edges.du[lane], edges.dv[lane]));
        for (lane, index) in indices.iter().enumerate() {
            out.light[*index as usize] += more[lane];
        }
    }
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn cut_soft(way: &Way, local: &Local, points: Points, places: &Places, indices: &[u32], out: &mut Light) {
    for indices in indices.chunks(LANES) {
        let edges = Edges::of(local, places, indices);
        let [shuts, rims] = way.seen_by(&edges);
        let light = if rims.is_empty() {
            let taken = points.mean(local, &edges, [&shuts], |dots, [shuts]| {
                shuts.iter().fold([0.0; LANES], |sum, shut| {
                    let taken = share(Some(dots), std::slice::from_ref(shut));
                    lanes(|lane| sum[lane] + taken[lane])
                })
            });
            lanes(|lane| out.light[indices[lane.min(indices.len() - 1)] as usize] - taken[lane])
        } else {
            points.mean(local, &edges, [&shuts, &rims], |dots, [shuts, rims]| passing(Some(dots), shuts, rims))
        };
        let taken = taken(&edges, &shuts, &rims);
        for (lane, index) in indices.iter().enumerate() {
            let index = *index as usize;
            let (cos, sin) = (edges.normal_u[lane], edges.normal_v[lane]);
            // What the whole edge would bring if all of it moved outwards.
            let edge = out.with_radius[index] / edges.per_gradient[lane];
            out.light[index] = light[lane].max(0.0);
            out.with_u[index] -= edge * (taken.across[lane] * cos - taken.along[lane] * sin);
            out.with_v[index] -= edge * (taken.across[lane] * sin + taken.along[lane] * cos);
            out.with_radius[index] *= 1.0 - taken.length[lane];
            out.with_blur[index] += edge * taken.blur[lane];
        }
    }
}

/// Light and derivatives of nearly sharp edges: every line across the pupil makes a step of its own, as high as the line
/// is open.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2+fma"))]
fn cut_sharp(way: &Way, local: &Local, places: &Places, indices: &[u32], out: &mut Light) {
    for indices in indices.chunks(LANES) {
        let edges = Edges::of(local, places, indices);
        let [shuts, rims] = way.seen_by(&edges);
        let (mut light, mut density, mut with_lines, mut open) =
            ([0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for ((x, half), share) in POSITIONS.into_iter().zip(LINE_HALVES).zip(LINE_SHARES) {
            let lengths = open_lengths(&[x; LANES], &[-half; LANES], &[half; LANES], &shuts, &rims);
            for lane in 0..LANES {
                let pixel = Trapezoid::of(edges.normal_u[lane].abs(), edges.normal_v[lane].abs());
                let (step, slope) = pixel.step(edges.blur_px[lane].mul_add(-x, edges.depth_px[lane]));
                let weight = share * 0.5 / half * lengths[lane];
                open[lane] += weight;
                light[lane] = weight.mul_add(step, light[lane]);
                density[lane] = weight.mul_add(slope, density[lane]);
                with_lines[lane] = (weight * slope).mul_add(-x, with_lines[lane]);
            }
        }
        for (lane, index) in indices.iter().enumerate() {
            let index = *index as usize;
            let scale = out.open[index] / open[lane].max(1e-6);
            let density = scale * density[lane];
            out.light[index] = (scale * light[lane]).min(out.open[index]);
            out.with_u[index] = density * edges.normal_u[lane];
            out.with_v[index] = density * edges.normal_v[lane];
            out.with_radius[index] = density * edges.per_gradient[lane];
            out.with_blur[index] = scale * with_lines[lane];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Share of the unit disc that lies in a circle so far off, by counting.
    fn counted(offset: f64, radius: f64) -> f64 {
        const STEPS: i32 = 500;
        let at = |step: i32| (f64::from(step) + 0.5) / f64::from(STEPS);
        let discs = (-STEPS..STEPS).flat_map(|y| (-STEPS..STEPS).map(move |x| (at(x), at(y))));
        let (mut inside, mut all) = (0.0, 0.0);
        for (x, y) in discs.filter(|(x, y)| x * x + y * y < 1.0) {
            all += 1.0;
            inside += f64::from(u8::from((x - offset).hypot(y) < radius));
        }
        inside / all
    }

    #[test]
    fn circles_shut_what_lies_within_them_and_rims_what_lies_without() {
        const SHARE_MAX: f64 = 5e-4;
        let mut places = Places::default();
        places.push(0.0, 0.0);
        for (offset, radius) in
            [(0.0, 0.7), (0.5, 0.4), (0.9, 0.6), (1.2, 0.9), (2.0, 0.8), (2.5, 3.0), (2.5, 3.6), (1.5, 2.2), (4.2, 3.0)]
        {
            let circle =
                Circle { x: 0.6 * offset as f32, y: -0.8 * offset as f32, per_px: 0.01, radius: radius as f32 };
            let within = counted(offset, radius);
            for (inside, expected) in [(1.0, 1.0 - within), (-1.0, within)] {
                let (mut touched, mut open) = ([0.0], [1.0]);
                close(&circle, inside, &places, &mut touched, &mut open);
                let case = format!("offset {offset}, radius {radius}, inside {inside}");
                assert!((f64::from(open[0]) - expected).abs() < SHARE_MAX, "{case}: {} for {expected}", open[0]);
                assert_eq!(touched[0] > 0.0, expected < 1.0, "{case}");
            }
        }
    }
}
