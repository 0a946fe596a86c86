//! What the optics make of one object point.

use twinpupil_instrument::{ImagePoint, PointSpread};

use crate::least_squares::least_squares;

/// The image of a point: how much light there is and where its centroid lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointImage {
    /// Light that arrives, relative to the unclipped pupil of the ideal lens.
    pub throughput: f64,
    /// Upright centroid of the light on the sensor; of the unclipped pupil if no light arrives.
    pub centroid: ImagePoint,
    /// How much farther out than the ideal lens the lens images the point through the whole pupil, as pixels see it: a
    /// mean in which rays count alike, wherever they spread the light of its surroundings.
    pub aberration_mm: [f64; 2],
    /// How the lens spreads the light of the whole pupil, with x along the radius from the axis; as an ideal lens does where it
    /// is not known.
    pub spread: PointSpread,
}

/// What the lens adds to where light through a point of the pupil arrives, and how much that is.
pub(crate) struct Added {
    pub(crate) pupil: [f64; 2],
    pub(crate) added_mm: [f64; 2],
    pub(crate) weight: f64,
}

/// How light is spread that arrives from pupil points farther than through the ideal lens, by the polynomial that comes
/// nearest, and how far off that is.
pub(crate) fn spread([x_mm, y_mm, _]: [f64; 3], added: &[Added]) -> PointSpread {
    let r_mm = x_mm.hypot(y_mm);
    let [cos, sin] = if r_mm > 0.0 { [x_mm / r_mm, y_mm / r_mm] } else { [1.0, 0.0] };
    // Along the radius and across it.
    let turned = |[x, y]: [f64; 2]| [cos * x + sin * y, cos * y - sin * x];
    let terms = |[u, v]: [f64; 2]| {
        let cubic = u * u + v * v - 2.0 / 3.0;
        [1.0, u, v, u * u, u * v, v * v, cubic * u, cubic * v]
    };
    let column = |k: usize| added.iter().map(|one| terms(turned(one.pupil))[k]).collect();
    let right = |k: usize| added.iter().map(|one| turned(one.added_mm)[k]).collect();
    let factors_mm = least_squares((0..8).map(column).collect(), [right(0), right(1)]);
    let [along, across] = [-factors_mm[1][0], -factors_mm[2][1]];
    let light: f64 = added.iter().map(|one| one.weight).sum();
    let tilt: f64 = added.iter().map(|one| one.weight * turned(one.pupil)[0]).sum();
    let spread = PointSpread {
        growth_mm: 0.5 * (along + across),
        stretch_mm: 0.5 * (along - across),
        coma_mm: [factors_mm[3][0], factors_mm[5][0], factors_mm[4][1]],
        spherical_mm: -0.5 * (factors_mm[6][0] + factors_mm[7][1]),
        // The mean square of a coordinate over the disc is ¼.
        light_growth: 4.0 * tilt / light,
        falloff: 1.0 - light / added.len() as f64,
        left_mm: 0.0,
    };
    let squares = added.iter().map(|one| {
        let left_mm = minus(minus(turned(one.added_mm), factors_mm[0]), moved_mm(&spread, turned(one.pupil)));
        left_mm[0] * left_mm[0] + left_mm[1] * left_mm[1]
    });
    let mean_square_mm2 = squares.sum::<f64>() / (2 * added.len()) as f64;
    PointSpread { left_mm: mean_square_mm2.sqrt(), ..spread }
}

/// What a spread says of light through a point of the pupil, along the radius and across it.
fn moved_mm(spread: &PointSpread, [u, v]: [f64; 2]) -> [f64; 2] {
    let PointSpread { growth_mm, stretch_mm, coma_mm: [a, b, c], spherical_mm, .. } = *spread;
    let cubic_mm = spherical_mm * (u * u + v * v - 2.0 / 3.0);
    [
        -(growth_mm + stretch_mm + cubic_mm) * u + a * u * u + b * v * v,
        -(growth_mm - stretch_mm + cubic_mm) * v + c * u * v,
    ]
}

pub(crate) fn minus(place: [f64; 2], other: [f64; 2]) -> [f64; 2] {
    [place[0] - other[0], place[1] - other[1]]
}
