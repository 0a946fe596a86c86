//! Light that falls unevenly: how it grows across every dot, from the dot's own pixels and from all dots together.

use nalgebra::{Matrix2, Matrix6, SMatrix, SVector, Vector2};
use smallvec::smallvec;

use crate::likelihood::body::Body;
use crate::likelihood::coupling::Near;
use crate::likelihood::cut::uneven;
use crate::likelihood::joint::Joint;
use crate::likelihood::light::{Light, Places};
use crate::likelihood::outline::Outline;
use crate::likelihood::pencil::length;
use crate::likelihood::profile::Profiles;
use crate::likelihood::samples::{Rings, Samples, Share, Window};
use crate::likelihood::spot::Spot;
use crate::quantile::{STD_PER_DISTANCE, median};

/// Relative growth of the light along u and v, 1/px, and what is known of it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Growth {
    slope: Vector2<f64>,
    information: Matrix2<f64>,
}

/// Buffers for a closer look at one dot.
#[derive(Debug, Clone, Default)]
pub(crate) struct Glance {
    samples: Samples,
    places: Places,
    profiles: Profiles,
    codes: Vec<f32>,
    others: Vec<f32>,
    near: Near,
    modelled: Light,
    narrow: Light,
    own: Vec<Option<Growth>>,
    dots: Vec<FieldDot>,
    sorted: Vec<f64>,
}

/// Growth is believed if it is this significant: χ² of two unknowns that chance exceeds once in 3000 times.
const SIGNIFICANT_CHI2: f64 = 16.0;

/// A change of the growth that moves a dot's light by so much wakes it.
const FELT_PX: f64 = 0.003;

/// Finds how the light grows across every body in every band, with a closer look at those that are not explained if they
/// are about in their places; whether it grows anywhere.
pub(crate) fn set_illumination(joint: &mut Joint<'_>, closely: bool, glance: &mut Glance) -> bool {
    let mut is_uneven = false;
    for band in 0..joint.bands.len() {
        let mut own = std::mem::take(&mut glance.own);
        own.clear();
        own.extend((0..joint.bodies.len()).map(|index| own_growth(joint, index, band, closely, glance)));
        let mut field = Field::through(joint.bodies, &own, band, glance);
        let mut has_ground = false;
        for (index, own) in own.iter_mut().enumerate() {
            if let Some(ground) = ground_growth(joint, index, band, field.as_ref(), glance) {
                (*own, has_ground) = (Some(ground), true);
            }
        }
        if has_ground {
            field = Field::through(joint.bodies, &own, band, glance);
        }
        for (body, own) in joint.bodies.iter_mut().zip(&own) {
            let Body { alive: true, bands, stirred, .. } = body else { continue };
            let Some(light) = &mut bands[band] else { continue };
            let growth = field.as_ref().map(|field| field.at(light.spot.centre_px));
            let known = own.iter().copied().chain(growth).reduce(Growth::and);
            let slope = match known {
                Some(growth) if growth.is_significant() => growth.slope.into(),
                Some(_) => [0.0; 2],
                // Where nothing is flat, what was found once stays.
                None => light.illumination_slope,
            };
            is_uneven |= slope != [0.0; 2];
            let before_px = shift_px(&light.spot, light.illumination_slope);
            let after_px = shift_px(&light.spot, slope);
            light.illumination_slope = slope;
            if length([after_px[0] - before_px[0], after_px[1] - before_px[1]]) > FELT_PX {
                *stirred = true;
            }
        }
        glance.own = own;
    }
    is_uneven
}

/// How far the light of a spot seems moved where the illumination grows, px.
///
/// A pixel at p outside an edge gets light from where the dot is, not from p. With the dot D, the blur B of radius b, and
/// light that grows by g,
///
/// ```text
/// (1 + g·p) D ∗ B = (1 + g·p)(D ∗ B) − D ∗ (g·s B) ≈ (1 + g·p) (D ∗ B)(p + b²/4 g)
/// ```
///
/// since s B is the gradient of a bump of mass b²/4.
pub(crate) fn shift_px(spot: &Spot, growth: [f64; 2]) -> [f64; 2] {
    growth.map(|growth| -0.25 * spot.blur_px * spot.blur_px * growth)
}

/// Mends the light of a spot that seems moved: its edges are as steep as those of narrower blurs, and what masks leave of a
/// pencil looks to one side.
///
/// The bump of [`shift_px`] is `∫ t³ B_t dt/b²` over the discs B_t up to the blur's radius b: the light changes as does that of
/// edges with such blurs, by Gauss's rule for the weight t³ of two.
pub(crate) fn bend(
    own: &mut Light,
    spot: &Spot,
    growth: [f64; 2],
    places: &Places,
    profiles: &mut Profiles,
    narrow: &mut Light,
) {
    const NARROW: [(f64, f32); 2] = [(0.898_714, 0.732_384), (0.529_857, 0.267_616)];
    let [du, dv] = shift_px(spot, growth);
    if length([du, dv]) < FELT_PX {
        return;
    }
    let (du, dv) = (du as f32, dv as f32);
    for (k, share) in own.light.iter_mut().enumerate() {
        *share -= du * own.with_u[k] + dv * own.with_v[k];
    }
    if spot.is_clipped() {
        uneven(spot, growth.map(|slope| slope as f32), places, own);
    } else {
        own.lopsided.clear();
    }
    for (width, weight) in NARROW {
        narrow.fill(&Spot { ways: smallvec![smallvec![]], ..spot.narrowed(width) }, places, profiles);
        for index in &own.lopsided {
            (narrow.with_u[*index as usize], narrow.with_v[*index as usize]) = (0.0, 0.0);
        }
        for (k, share) in own.light.iter_mut().enumerate() {
            *share += weight * (du * narrow.with_u[k] + dv * narrow.with_v[k]);
        }
    }
}

impl Growth {
    fn and(self, other: Self) -> Self {
        let information = self.information + other.information;
        let sum = self.information * self.slope + other.information * other.slope;
        match information.try_inverse() {
            Some(covariance) => Self { slope: covariance * sum, information },
            None => self,
        }
    }

    fn is_significant(&self) -> bool {
        self.slope.dot(&(self.information * self.slope)) > SIGNIFICANT_CHI2
    }
}

/// What a dot's own pixels show.
fn own_growth(joint: &Joint<'_>, index: usize, band: usize, closely: bool, glance: &mut Glance) -> Option<Growth> {
    let body = &joint.bodies[index];
    let light = body.bands[band].as_ref().filter(|_| body.alive && !body.saturated)?;
    let full = &light.window.as_ref()?.full;
    if full.count() >= FULL_MIN {
        let (slope, information) = full.growth(joint.bands[band].black.noise())?;
        let falloff = Vector2::from(light.spot.falloff_slope());
        return Some(Growth { slope: slope - falloff, information });
    }
    // Where nothing is flat, the fit tells whether it is worth while.
    if closely && body.seen == Share::All && !body.explains(UNEXPLAINED_CHI2) {
        modelled_growth(joint, index, band, glance)
    } else {
        None
    }
}

/// What the ground about a dark dot shows, where the light of the whole frame is uneven.
fn ground_growth(
    joint: &Joint<'_>,
    index: usize,
    band: usize,
    field: Option<&Field>,
    glance: &mut Glance,
) -> Option<Growth> {
    let body = &joint.bodies[index];
    let light = body.bands[band].as_ref().filter(|light| body.alive && light.contrast < 0.0)?;
    let is_uneven = field?.at(light.spot.centre_px).is_significant();
    if is_uneven { modelled_growth(joint, index, band, glance) } else { None }
}

/// Pixels that a dot must fill to tell how the light grows.
const FULL_MIN: f64 = 100.0;

/// χ² over its pixels from which a dot without flat places is looked at closely.
const UNEXPLAINED_CHI2: f64 = 1.3;

/// What all pixels of a dot show, whatever its place, size, blur and light may be.
fn modelled_growth(joint: &Joint<'_>, index: usize, band: usize, glance: &mut Glance) -> Option<Growth> {
    const OTHERS: usize = 6;
    let (view, light) = (&joint.bands[band], joint.bodies[index].bands[band].as_ref()?);
    let Glance { samples, places, profiles, codes, others, near, modelled, narrow, .. } = glance;
    let spot = &light.spot;
    samples.clear();
    let (outline, window_px) = (Outline::of(spot), view.window_px(spot));
    let (grain, rise) = light.window.as_ref().map_or((1, 0.0), Window::grain);
    let rings = Rings { outline, window_px, even_px: 0.0, levels: [0.0; 2], grain, rise };
    let window = samples.read(&view.plane, view.black.noise(), &rings);
    samples.about(&window, Share::All, spot.centre_px, places, codes);
    others.clear();
    others.resize(codes.len(), 0.0);
    for neighbour in joint.buffers.neighbours.of(index * joint.bands.len() + band) {
        if let Some(other) = &joint.bodies[*neighbour as usize / joint.bands.len()].bands[band] {
            let other = other.near();
            near.find(&other, spot.centre_px, places, profiles);
            near.add(&other, others);
        }
    }
    modelled.fill(spot, places, profiles);
    bend(modelled, spot, light.illumination_slope, places, profiles, narrow);
    let (mut information, mut score) = (SMatrix::<f64, 8, 8>::zeros(), SVector::<f64, 8>::zeros());
    let [gu, gv] = light.growth();
    for (k, code) in codes.iter().enumerate() {
        let [du, dv] = [places.du[k], places.dv[k]].map(f64::from);
        let lit = 1.0 + gu * du + gv * dv;
        let [share, open] = [modelled.light[k], modelled.open[k]].map(f64::from);
        let level = light.contrast * share + light.background * open;
        let foreign = f64::from(others[k]);
        let read = f64::from(*code) - view.black.noise().black_level;
        if *code >= f32::from(view.plane.code_max) || read <= f64::from(view.black.light_max) {
            continue;
        }
        let scale = light.contrast * lit;
        let [u, v, radius, blur] =
            [modelled.with_u[k], modelled.with_v[k], modelled.with_radius[k], modelled.with_blur[k]]
                .map(|change| scale * f64::from(change));
        let row = SVector::from([u, v, radius, blur, lit * share, lit * open, level * du, level * dv]);
        let trust = window.pixels / view.black.noise().variance(view.black.noise().black_level + level * lit + foreign);
        information += row * row.transpose() * trust;
        score += row * ((read - foreign - level * lit) * trust);
    }
    // What the six others cannot explain as well.
    let others: Matrix6<f64> = information.fixed_view::<OTHERS, OTHERS>(0, 0).into_owned();
    let mixed = information.fixed_view::<2, OTHERS>(OTHERS, 0) * others.try_inverse()?;
    let left = information.fixed_view::<2, 2>(OTHERS, OTHERS) - mixed * information.fixed_view::<OTHERS, 2>(0, OTHERS);
    let score = score.fixed_rows::<2>(OTHERS) - mixed * score.fixed_rows::<OTHERS>(0);
    let step = left.try_inverse()? * score;
    Some(Growth { slope: Vector2::from(light.illumination_slope) + step, information: left })
}

/// Unknowns of the field: the light, its slopes and its curvatures.
const UNKNOWNS: usize = 6;

/// The light over the whole frame in one band, over that of the typical dot: a quadratic.
///
/// ```text
/// I = c + a x + b y + d x²/2 + e x y + f y²/2
/// ```
#[derive(Debug, Clone)]
struct Field {
    centre_px: [f64; 2],
    unknowns: SVector<f64, UNKNOWNS>,
    covariance: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    /// Variance of the slope of single dots about that of the field, 1/px².
    scatter: f64,
    /// How small a variance they could have told.
    told: f64,
}

/// Length in which places are counted, px.
const UNIT_PX: f64 = 1000.0;

/// What slopes and curvatures are thought to be beforehand, over that length.
const SLOPE_STD: f64 = 3.0;
const CURVATURE_STD: f64 = 1.0;

/// Dots are no more alike than this, relative; and how many tell a field.
const LEVEL_STD_MIN: f64 = 0.002;
const DOTS_MIN: usize = 6;

/// One of so many dots at least has to show a slope of its own before slopes are believed.
const OWN_SHARE_MIN: usize = 4;

/// What one dot tells of the field.
#[derive(Debug, Clone, Copy)]
struct FieldDot {
    centre_px: [f64; 2],
    /// Its light over that of the typical one.
    level: f64,
    own: Option<Growth>,
    /// Whether it is about as bright as the field, and how far from that, relative.
    kept: bool,
    off: f64,
}

impl Field {
    /// Through the slopes that single dots show, and through their brightness as far as they are alike.
    fn through(bodies: &[Body], own: &[Option<Growth>], band: usize, glance: &mut Glance) -> Option<Self> {
        // So many tell it well enough.
        const DOTS_MAX: usize = 400;
        let Glance { dots, sorted, .. } = glance;
        dots.clear();
        dots.extend(bodies.iter().zip(own).step_by(bodies.len() / DOTS_MAX + 1).filter_map(|(body, own)| {
            let light = body.bands[band].as_ref().filter(|light| light.contrast != 0.0)?;
            let tells = body.is_placed() && !body.saturated;
            // What the lens lets through is known.
            let level = light.contrast.abs() / (1.0 - light.spot.falloff());
            tells.then_some(FieldDot { centre_px: light.spot.centre_px, level, own: *own, kept: true, off: 0.0 })
        }));
        if dots.len() < DOTS_MIN { None } else { Self::of(dots, sorted) }
    }

    fn of(dots: &mut [FieldDot], sorted: &mut Vec<f64>) -> Option<Self> {
        const ROUNDS: usize = 4;
        // A few that show a slope are those that something else is wrong with, and tell nothing of how much slopes differ.
        if dots.iter().filter(|dot| dot.own.is_some()).count() * OWN_SHARE_MIN < dots.len() {
            dots.iter_mut().for_each(|dot| dot.own = None);
        }
        sorted.clear();
        sorted.extend(dots.iter().map(|dot| dot.level));
        let typical = median(sorted)?;
        dots.iter_mut().for_each(|dot| dot.level /= typical);
        let count = dots.len() as f64;
        let centre_px = [0, 1].map(|k| dots.iter().map(|dot| dot.centre_px[k]).sum::<f64>() / count);
        let (scatter, told) = (f64::INFINITY, f64::INFINITY);
        let mut field = Self { centre_px, unknowns: SVector::zeros(), covariance: SMatrix::zeros(), scatter, told };
        let mut level_std = 1.0_f64;
        for _ in 0..ROUNDS {
            field.fit(dots, level_std)?;
            level_std = field.compare(dots, sorted)?;
        }
        Some(field)
    }

    /// The field that explains the dots best.
    fn fit(&mut self, dots: &[FieldDot], level_std: f64) -> Option<()> {
        let mut information = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut score = SVector::<f64, UNKNOWNS>::zeros();
        for k in 1..UNKNOWNS {
            information[(k, k)] += if k < 3 { SLOPE_STD } else { CURVATURE_STD }.powi(-2);
        }
        for FieldDot { centre_px, level, own, kept, .. } in dots {
            let [row, along_u, along_v] = self.rows(*centre_px);
            let field_level = self.level_at(*centre_px);
            if *kept {
                let trust = (field_level * level_std).powi(-2);
                information += row * row.transpose() * trust;
                score += row * (level * trust);
            }
            if let Some(Growth { slope, information: known }) = own.filter(|_| self.scatter.is_finite()) {
                // Dots whose own pixels say it well count no more than they are alike.
                let covariance = known.try_inverse().unwrap_or_default() + Matrix2::identity() * self.scatter;
                let known = covariance.try_inverse().unwrap_or_default() * (field_level * UNIT_PX).powi(-2);
                let rows = SMatrix::<f64, 2, UNKNOWNS>::from_rows(&[along_u.transpose(), along_v.transpose()]);
                information += rows.transpose() * known * rows;
                score += rows.transpose() * known * (slope * (field_level * UNIT_PX));
            }
        }
        self.covariance = information.try_inverse()?;
        self.unknowns = self.covariance * score;
        Some(())
    }

    /// Finds how far the dots lie off the field, and which of them it is not for; the deviation of their brightness.
    fn compare(&mut self, dots: &mut [FieldDot], sorted: &mut Vec<f64>) -> Option<f64> {
        const FAR_SIGMAS: f64 = 3.0;
        for dot in &mut *dots {
            dot.off = (dot.level / self.level_at(dot.centre_px) - 1.0).abs();
        }
        sorted.clear();
        sorted.extend(dots.iter().map(|dot| dot.off));
        let level_std = (STD_PER_DISTANCE * median(sorted)?).max(LEVEL_STD_MIN);
        dots.iter_mut().for_each(|dot| dot.kept = dot.off < FAR_SIGMAS * level_std);
        let slopes =
            || dots.iter().filter_map(|dot| Some((dot.centre_px, dot.own?, dot.own?.information.try_inverse()?)));
        sorted.clear();
        sorted.extend(slopes().map(|(centre_px, own, noise)| {
            let off = own.slope - self.slope_at(centre_px);
            (off.norm_squared() - noise.trace()).max(0.0)
        }));
        self.scatter = median(sorted).unwrap_or(0.0);
        sorted.clear();
        sorted.extend(slopes().map(|(_, _, noise)| noise.trace()));
        let count = sorted.len() as f64;
        self.told = median(sorted).map_or(f64::INFINITY, |noise| noise / count.sqrt());
        Some(level_std)
    }

    /// What the unknowns do to the logarithm of the light at a place, and to its slopes along u and v over the unit.
    fn rows(&self, [u_px, v_px]: [f64; 2]) -> [SVector<f64, UNKNOWNS>; 3] {
        let (x, y) = ((u_px - self.centre_px[0]) / UNIT_PX, (v_px - self.centre_px[1]) / UNIT_PX);
        [
            SVector::from([1.0, x, y, 0.5 * x * x, x * y, 0.5 * y * y]),
            SVector::from([0.0, 1.0, 0.0, x, y, 0.0]),
            SVector::from([0.0, 0.0, 1.0, 0.0, x, y]),
        ]
    }

    /// The light at a place; a quadratic that falls below none there stands for darkness.
    fn level_at(&self, place_px: [f64; 2]) -> f64 {
        const DARKEST: f64 = 0.02;
        self.rows(place_px)[0].dot(&self.unknowns).max(DARKEST)
    }

    fn slope_at(&self, place_px: [f64; 2]) -> Vector2<f64> {
        let [_, along_u, along_v] = self.rows(place_px);
        let per_level = 1.0 / (UNIT_PX * self.level_at(place_px));
        Vector2::new(along_u.dot(&self.unknowns), along_v.dot(&self.unknowns)) * per_level
    }

    /// The growth at a place, and how well it is known for a dot there: light is no more a quadratic than to some percent of
    /// its slope, unless many dots show that it is.
    fn at(&self, place_px: [f64; 2]) -> Growth {
        const DOUBT: f64 = 0.03;
        let [_, along_u, along_v] = self.rows(place_px);
        let rows = SMatrix::<f64, 2, UNKNOWNS>::from_rows(&[along_u.transpose(), along_v.transpose()]);
        let slope = self.slope_at(place_px);
        let doubt = self.scatter + (DOUBT * DOUBT * slope.norm_squared()).min(self.told);
        let per_level = 1.0 / (UNIT_PX * self.level_at(place_px));
        let covariance =
            rows * self.covariance * rows.transpose() * (per_level * per_level) + Matrix2::identity() * doubt;
        Growth { slope, information: covariance.try_inverse().unwrap_or_default() }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use twinpupil_instrument::paper;

    use super::*;
    use crate::likelihood::pencil::Pencil;
    use crate::likelihood::spot::{Dot, Raster};

    #[test]
    fn a_dot_that_shows_another_slope_does_not_hide_that_of_the_field() {
        const SLOPE: f64 = 3e-4;
        let odd = Growth { slope: Vector2::new(-4e-3, 3e-3), information: Matrix2::identity() * 1e7 };
        let dot = |k: usize| {
            let centre_px = [300.0 * (k % 6) as f64, 250.0 * (k / 6) as f64];
            let level = 1.0 + SLOPE * centre_px[0] + 1e-3 * (7.0 * k as f64).sin();
            FieldDot { centre_px, level, own: (k == 14).then_some(odd), kept: true, off: 0.0 }
        };
        let mut dots: Vec<FieldDot> = (0..24).map(dot).collect();
        let growth = Field::of(&mut dots, &mut Vec::new()).expect("24 dots tell a field").at([0.0, 375.0]);
        assert!(growth.is_significant(), "{growth:?}");
        assert!((growth.slope - Vector2::new(SLOPE, 0.0)).norm() < 0.05 * SLOPE, "{growth:?}");
    }

    /// Light of a facing dot at a place beside its centre, point by point of the pupil: even, and where it grows.
    fn point_by_point(spot: &Spot, [du, dv]: [f64; 2], growth: [f64; 2]) -> [f64; 2] {
        const RINGS: usize = 300;
        const POINTS: usize = 900;
        let [x_mm, y_mm] = spot.image_mm([spot.centre_px[0] + du, spot.centre_px[1] + dv]);
        let is_open = |[x, y]: [f64; 2]| {
            spot.ways.iter().any(|way| {
                way.iter().all(|edge| {
                    let [cx, cy] = [edge.start[0] + edge.per_image * x_mm, edge.start[1] + edge.per_image * y_mm];
                    (length([x - cx, y - cy]) < edge.radius) == edge.passes_inside
                })
            })
        };
        let mut sums = [0.0; 2];
        for ring in 0..RINGS {
            let radius = ((ring as f64 + 0.5) / RINGS as f64).sqrt();
            for point in 0..POINTS {
                let (sin, cos) = (TAU * (point as f64 + 0.5) / POINTS as f64).sin_cos();
                let w = [radius * cos, radius * sin];
                let seen_px = [du + spot.blur_px * w[0], dv + spot.blur_px * w[1]];
                if is_open(w) && length(seen_px) < spot.radius_px {
                    sums[0] += 1.0;
                    sums[1] += 1.0 + growth[0] * seen_px[0] + growth[1] * seen_px[1];
                }
            }
        }
        sums.map(|sum| sum / (RINGS * POINTS) as f64)
    }

    #[test]
    fn light_that_grows_is_that_of_every_point_of_the_pupil() {
        let instrument = paper::instrument();
        let raster = Raster { axis_px: [959.5, 599.5], pitch_mm: 0.00586 };
        const PLACES: usize = 60;
        // Two narrower blurs stand for all of them.
        const SHARE_MAX: f64 = 0.04;
        let growth = [2e-3, -1.2e-3];
        for (centre_mm, band, is_clipped) in
            [([4.0, 2.5, 270.0], 0, false), ([1.5, -1.3, 262.0], 0, true), ([1.5, -1.3, 338.0], 1, true)]
        {
            let dot = Dot { centre_mm, diameter_mm: 1.0, slopes: [0.0; 2] };
            let pencil = Pencil::of_band(&instrument, &instrument.bands[band], 100.0);
            let spot = Spot::of(&dot, &pencil, raster, None);
            assert_eq!(spot.is_clipped(), is_clipped, "{centre_mm:?}");
            let shift = shift_px(&spot, growth);
            let mut shifted = spot.clone();
            shifted.shift(shift);
            let (mut about, mut about_shifted) = (Places::default(), Places::default());
            let offset = |k: usize| {
                let (sin, cos) = (0.7 * k as f64).sin_cos();
                let outwards_px = spot.radius_px + spot.blur_px.abs() * ((k % 10) as f64 * 0.22 - 1.0);
                [outwards_px * cos, outwards_px * sin]
            };
            for [du, dv] in (0..PLACES).map(offset) {
                about.push(du as f32, dv as f32);
                about_shifted.push((du - shift[0]) as f32, (dv - shift[1]) as f32);
            }
            let (mut even, mut uneven, mut narrow) = (Light::default(), Light::default(), Light::default());
            let profiles = &mut Profiles::default();
            even.fill(&spot, &about, profiles);
            uneven.fill(&shifted, &about_shifted, profiles);
            bend(&mut uneven, &shifted, growth, &about_shifted, profiles, &mut narrow);
            for k in 0..PLACES {
                let [du, dv] = offset(k);
                let [without, with] = point_by_point(&spot, [du, dv], growth);
                let lit = 1.0 + growth[0] * du + growth[1] * dv;
                let found = f64::from(uneven.light[k]) * lit - f64::from(even.light[k]);
                // As much as the light may differ from the middle of a pencil to its side.
                let share = (found - (with - without)) / (spot.blur_px.abs() * length(growth));
                assert!(share.abs() < SHARE_MAX, "{centre_mm:?} at {du} {dv}: {found}, {share} off");
            }
        }
    }
}
