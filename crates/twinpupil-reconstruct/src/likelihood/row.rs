//! The light of a spot along a row of pixels, and how it changes with the spot.

use crate::likelihood::clipped;
use crate::likelihood::sharp::sharp_row;
use crate::likelihood::soft::soft_row;
use crate::likelihood::spot::Spot;

/// Pixels along a row of a page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pixels {
    /// Position of the first, px.
    pub(crate) u_px: f64,
    /// Position of the row, px.
    pub(crate) v_px: f64,
    /// From one to the next, px.
    pub(crate) step_px: f64,
    pub(crate) count: usize,
}

/// Light in every pixel of a row, relative to a pixel that sees only the dot through an open pupil, and its
/// derivatives, per px.
#[derive(Debug, Clone, Default)]
pub(crate) struct Row {
    pub(crate) light: Vec<f32>,
    /// With the centre's u and v.
    pub(crate) with_u: Vec<f32>,
    pub(crate) with_v: Vec<f32>,
    /// With the radius.
    pub(crate) with_radius: Vec<f32>,
    /// With the blur's radius.
    pub(crate) with_blur: Vec<f32>,
    /// Share of the pupil that is open.
    pub(crate) open: Vec<f32>,
}

/// Below this blur the square of the pixel shapes the edge.
const SHARP_PX: f64 = 1.0;

/// Share of its radius by which the blur of a dot may reach across the edge at one end and along it at the other before
/// both have to be told apart.
const SLANTED: f64 = 0.03;

/// Below this blur it hardly matters which part of the pencil the masks leave.
const CUT_SHARP_PX: f64 = 0.3;

/// What the row kernels need of a spot, relative to the first pixel of a row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Local {
    /// From the spot's centre to the first pixel, px.
    pub(crate) du_px: f32,
    pub(crate) dv_px: f32,
    pub(crate) step_px: f32,
    /// From px to the unit disc, without the radius.
    pub(crate) inverse: [[f32; 2]; 2],
    pub(crate) radius_px: f32,
    pub(crate) blur_px: f32,
    /// Growth of the blur over the unit disc's first axis, relative to the blur.
    pub(crate) blur_slope: f32,
}

impl Row {
    /// Makes place for `count` pixels.
    pub(crate) fn resize(&mut self, count: usize) {
        let Self { light, with_u, with_v, with_radius, with_blur, open } = self;
        for values in [light, with_u, with_v, with_radius, with_blur, open] {
            values.resize(count, 0.0);
        }
    }

    /// Fills the row with the light of a spot.
    pub(crate) fn fill(&mut self, spot: &Spot, pixels: &Pixels) {
        self.resize(pixels.count);
        let local = Local::of(spot, pixels);
        let blur_px = spot.blur_px.abs();
        let slanted = spot.foreshortening() * blur_px > SLANTED * spot.radius_px;
        match spot.is_clipped() {
            false if blur_px < SHARP_PX => sharp_row(&local, None, self),
            false if slanted => {
                clipped::soft(spot, pixels, &local, true, self);
            }
            false => soft_row(&local, self),
            true if blur_px < CUT_SHARP_PX => clipped::sharp(spot, pixels, &local, self),
            true => clipped::soft(spot, pixels, &local, slanted, self),
        }
        if !spot.is_clipped() {
            self.open.fill(1.0);
        }
    }
}

impl Local {
    fn of(spot: &Spot, pixels: &Pixels) -> Self {
        Self {
            du_px: (pixels.u_px - spot.centre_px[0]) as f32,
            dv_px: (pixels.v_px - spot.centre_px[1]) as f32,
            step_px: pixels.step_px as f32,
            inverse: spot.inverse.map(|row| row.map(|value| value as f32)),
            radius_px: spot.radius_px as f32,
            blur_px: spot.blur_px as f32,
            blur_slope: spot.blur_slope as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;
    use crate::likelihood::pencil::Pencil;
    use crate::likelihood::spot::{Dot, Page};

    /// Light of a dot in one pixel by brute force: rays from everywhere in the pixel through everywhere in the pupil, on
    /// to the plane of the dot. `masks` are the other band's stops: position, radius, and whether they pass inside.
    fn brute_force(dot: &Dot, band: usize, u_px: f64, v_px: f64) -> f64 {
        const PLACES: usize = 10;
        const RAYS: usize = 128;
        let (f, l, pitch_mm) = (100.0, 151.0, 0.00586);
        let [x0, y0, z0] = dot.centre_mm;
        let [sx, sy] = dot.slopes;
        let golden_angle = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let mut lit = 0;
        for place in 0..PLACES * PLACES {
            let within = |k: usize| (k as f64 + 0.5) / PLACES as f64 - 0.5;
            let px = (u_px + within(place % PLACES) - 959.5) * pitch_mm;
            let py = (v_px + within(place / PLACES) - 599.5) * pitch_mm;
            for ray in 0..RAYS {
                let radius = ((ray as f64 + 0.5) / RAYS as f64).sqrt();
                let (sin, cos) = (golden_angle * ray as f64 + place as f64).sin_cos();
                // Band 0 passes 0.5 in the focal plane and beyond 1 on the lens, band 1 the other way round.
                let (ax, ay) = match band {
                    0 => {
                        let share = 1.0 - f / l;
                        ((0.5 * radius * cos + px * f / l) / share, (0.5 * radius * sin + py * f / l) / share)
                    }
                    _ => (radius * cos, radius * sin),
                };
                let open = match band {
                    0 => ax.hypot(ay) >= 1.0,
                    _ => (ax * (1.0 - f / l) - px * f / l).hypot(ay * (1.0 - f / l) - py * f / l) >= 0.5,
                };
                let (nx, ny) = (ax * (1.0 / l - 1.0 / f) + px / l, ay * (1.0 / l - 1.0 / f) + py / l);
                let z = (z0 + sx * (ax - x0) + sy * (ay - y0)) / (1.0 - sx * nx - sy * ny);
                let (dx, dy) = (ax + nx * z - x0, ay + ny * z - y0);
                let square = dx * dx + dy * dy + (z - z0) * (z - z0);
                lit += usize::from(open && square < 0.25 * dot.diameter_mm * dot.diameter_mm);
            }
        }
        lit as f64 / (PLACES * PLACES * RAYS) as f64
    }

    /// Root mean square and largest difference to brute force over pixels of the edge.
    fn difference(dot: &Dot, band: usize) -> (f64, f64) {
        let instrument = paper::instrument();
        let pencil = Pencil::of_band(&instrument, &instrument.bands[band], 100.0);
        let page = Page { axis_px: [959.5, 599.5], pitch_mm: 0.00586 };
        let spot = Spot::of(dot, &pencil, page, 0.0);
        let mut row = Row::default();
        let (mut sum, mut largest, mut count) = (0.0, 0.0_f64, 0);
        let reach = spot.reach_px().ceil();
        for dv in (0..(2.0 * reach) as usize).step_by(29) {
            let pixels = Pixels {
                u_px: (spot.centre_px[0] - reach).floor(),
                v_px: (spot.centre_px[1] - reach).floor() + dv as f64,
                step_px: 1.0,
                count: 2 * reach as usize + 2,
            };
            row.fill(&spot, &pixels);
            for (index, light) in row.light.iter().enumerate() {
                // Every pixel that is neither dark nor full, and some of the others.
                if (*light > 0.0 && *light < 0.999 * row.open[index]) || index % 32 == 0 {
                    let exact = brute_force(dot, band, pixels.u_px + index as f64, pixels.v_px);
                    let difference = f64::from(*light) - exact;
                    sum += difference * difference;
                    largest = largest.max(difference.abs());
                    count += 1;
                }
            }
        }
        ((sum / f64::from(count)).sqrt(), largest)
    }

    #[test]
    fn light_is_that_of_brute_force() {
        const FACING: [f64; 2] = [0.0, 0.0];
        // Far from the axis and cut by the masks; wide, narrow and hardly blurred; facing and tilted by 30° and 60°.
        let cases = [
            ([5.0, -1.3, 250.0], FACING, 0),
            ([5.0, -1.3, 290.0], FACING, 1),
            ([5.0, -1.3, 294.0], FACING, 1),
            ([1.5, 1.6, 280.0], FACING, 0),
            ([1.5, 1.6, 293.0], FACING, 1),
            ([5.0, -1.3, 280.0], [0.577, 0.0], 1),
            ([1.5, 1.6, 300.0], [0.577, 0.0], 0),
            ([5.0, -1.3, 290.0], [1.5, 0.866], 0),
            ([1.5, 1.6, 250.0], [1.5, 0.866], 1),
        ];
        for (centre_mm, slopes, band) in cases {
            let (rms, largest) = difference(&Dot { centre_mm, diameter_mm: 1.0, slopes }, band);
            // A pixel's noise is 0.007 of the full light at 20 000 electrons.
            assert!(rms < 0.003 && largest < 0.012, "{centre_mm:?} {slopes:?} {band}: {rms} {largest}");
        }
    }
}
