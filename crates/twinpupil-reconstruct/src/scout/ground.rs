//! The level of the ground: even, as some thousand pixels show, or else a surface.

use multiversion::multiversion;
use twinpupil_instrument::PlaneView;

use crate::background::{Background, Polarity, measured_noise, quantile};
use crate::noise::Noise;
use crate::quantile::code_quantile;
use crate::shading::Shading;

/// The ground of a plane.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ground {
    /// Which side of it features lie on.
    pub(crate) polarity: Polarity,
    /// Mean level, codes.
    pub(crate) level: f64,
    /// Standard deviation of one of its pixels, codes.
    pub(crate) pixel_noise: f32,
    /// Its surface where it is not even.
    pub(crate) surface: Option<Background>,
}

/// Pixels spread evenly over a plane, tile by tile.
#[derive(Debug, Clone, Default)]
pub(crate) struct Survey {
    size: [usize; 2],
    /// Column and row of every sample, for a plane of that size.
    places: Vec<[u32; 2]>,
    codes: Vec<u16>,
}

/// Tiles across and down the plane, and samples across and down a tile.
const TILES: [usize; 2] = [8, 5];
const TILE_SAMPLES: usize = 8;

/// Every so manieth row is looked at by any search, and planes of so many rows have enough of those.
const SEARCHED: u32 = 12;
const ROWS_TO_SHARE: usize = 480;

/// Share of a tile that is ground on either side of the middle, however many features it holds, but for a few tiles.
const GROUND_SHARE: f64 = 0.2;

/// A quantile of a tile's samples scatters by a fifth of a pixel's noise: even grounds differ by less than this.
const EVEN_SIGMAS: f32 = 2.0;

/// Samples within so many standard deviations of the ground belong to it.
const GROUND_SIGMAS: f32 = 2.5;

/// A ground that scatters by more than so many times the noise of its pixels is not even.
const NOISIER: f32 = 4.0;

/// Least noise of a pixel: that of rounding to whole codes, 1/√12.
const ROUNDING_NOISE: f32 = 0.29;

impl Ground {
    /// Looks at the ground of a plane. `noise` gives the variance of a pixel where it is known, `shading` what the masks
    /// leave of an even ground.
    pub(crate) fn survey(
        plane: &PlaneView<'_>,
        polarity: Option<Polarity>,
        noise: Option<&Noise>,
        shading: Option<&Shading>,
        survey: &mut Survey,
    ) -> Self {
        survey.sample(plane);
        let codes = &survey.codes[..];
        let side = polarity.unwrap_or_else(|| longer_tail(codes));
        let levels = tile_levels(codes, side, GROUND_SHARE);
        let start = quantile(&mut levels.clone(), 0.5);
        let (level, scatter) = level_and_scatter(codes, start, side);
        let known = noise.map(|noise| noise.variance(level).sqrt() as f32);
        let pixel_noise = known.unwrap_or(0.0).max(scatter).max(ROUNDING_NOISE);
        // Light that grows across the frame scatters its levels too.
        let known = known.unwrap_or_else(|| measured_noise(plane) as f32);
        let tolerance = EVEN_SIGMAS * pixel_noise.min(NOISIER * known.max(ROUNDING_NOISE));
        if is_even(&levels, codes, side, tolerance) {
            return Self { polarity: side, level, pixel_noise, surface: None };
        }
        let surface = Background::estimate(plane, polarity, noise, shading);
        Self {
            polarity: surface.polarity,
            level: surface.mean + noise.map_or(0.0, |noise| noise.black_level),
            pixel_noise: (surface.pixel_noise as f32).max(ROUNDING_NOISE),
            surface: Some(surface),
        }
    }
}

impl Survey {
    /// Reads the samples of a plane.
    fn sample(&mut self, plane: &PlaneView<'_>) {
        let size = [plane.columns, plane.rows];
        if self.size != size {
            self.size = size;
            self.spread();
        }
        self.codes.clear();
        for row in self.places.chunks_exact(TILE_SAMPLES) {
            let line = plane.line(row[0][1] as usize);
            self.codes.extend(row.iter().map(|[column, _]| line[*column as usize * plane.step_px]));
        }
    }

    /// Spreads the samples: one in every cell of a grid, where in it changes from cell to cell, so that features in a
    /// grid of their own are not hit in step.
    fn spread(&mut self) {
        // Multiples of the golden ratio and of a cousin of it, in 1/65536, leave no gaps.
        const TURNS: [usize; 2] = [40_503, 24_421];
        let place = |cell: usize, turn: usize, cells: usize, pixels: usize| {
            (((cell << 16) + (turn & 0xffff)) * pixels / (cells << 16)) as u32
        };
        // Rows that a search which leaves out rows looks at as well, so that few are read twice.
        let shared = |row: u32| if self.size[1] >= ROWS_TO_SHARE { row / SEARCHED * SEARCHED } else { row };
        self.places.clear();
        for (j, i) in (0..TILES[1]).flat_map(|j| (0..TILES[0]).map(move |i| (j, i))) {
            for (r, c) in (0..TILE_SAMPLES).flat_map(|r| (0..TILE_SAMPLES).map(move |c| (r, c))) {
                let (row, column) = (j * TILE_SAMPLES + r, i * TILE_SAMPLES + c);
                let across = column * TURNS[0] + row * TURNS[1];
                self.places.push([
                    place(column, across, TILES[0] * TILE_SAMPLES, self.size[0]),
                    shared(place(row, row * TURNS[0], TILES[1] * TILE_SAMPLES, self.size[1])),
                ]);
            }
        }
    }

    /// The rows of the samples, from top to bottom.
    pub(crate) fn rows(&self) -> impl Iterator<Item = usize> {
        let tile_rows = self.places.chunks_exact(TILE_SAMPLES * TILE_SAMPLES * TILES[0]);
        tile_rows
            .flat_map(|row| row[..TILE_SAMPLES * TILE_SAMPLES].iter().step_by(TILE_SAMPLES))
            .map(|place| place[1] as usize)
    }

    /// Columns and rows of the samples.
    pub(crate) fn places(&self) -> &[[u32; 2]] {
        &self.places
    }
}

/// The level of every tile, if so much of it is ground.
fn tile_levels(codes: &[u16], side: Polarity, ground_share: f64) -> [f32; TILES[0] * TILES[1]] {
    let share = if side == Polarity::Bright { ground_share } else { 1.0 - ground_share };
    let mut levels = [0.0; TILES[0] * TILES[1]];
    for (level, tile) in levels.iter_mut().zip(codes.chunks_exact(TILE_SAMPLES * TILE_SAMPLES)) {
        *level = f32::from(code_quantile(tile, share));
    }
    levels
}

/// Whether tiles differ by no more than a tolerance, all or all but a few that are so crowded that they seem lit: then as much of
/// every one is looked at as is ground there.
fn is_even(levels: &[f32; TILES[0] * TILES[1]], codes: &[u16], side: Polarity, tolerance: f32) -> bool {
    const CROWDED_GROUND_SHARE: f64 = 0.05;
    const CROWDED_MAX: usize = TILES[0] * TILES[1] / 8;
    let sign = side.sign() as f32;
    let lit = |levels: &[f32]| {
        let lowest = levels.iter().map(|level| sign * level).fold(f32::MAX, f32::min);
        levels.iter().filter(|level| sign * **level > lowest + tolerance).count()
    };
    match lit(levels) {
        0 => true,
        1..=CROWDED_MAX => lit(&tile_levels(codes, side, CROWDED_GROUND_SHARE)) == 0,
        _ => false,
    }
}

/// The polarity whose tail about the median is the longer.
fn longer_tail(codes: &[u16]) -> Polarity {
    const TAIL: f64 = 0.005;
    let [low, middle, high] = [TAIL, 0.5, 1.0 - TAIL].map(|share| i32::from(code_quantile(codes, share)));
    if middle - low > high - middle { Polarity::Dark } else { Polarity::Bright }
}

/// Mean and standard deviation of the samples about a level; from `start`, a quantile on the far side of the features.
fn level_and_scatter(codes: &[u16], start: f32, side: Polarity) -> (f64, f32) {
    const ROUNDS: usize = 3;
    // Samples beyond the start are all ground: their spread about it gives the first width.
    let (nearest, farthest) = if side == Polarity::Bright { (f32::MIN, 0.0) } else { (0.0, f32::MAX) };
    let [count, _, squares] = sums_between(codes, start, nearest, farthest);
    let (mut level, mut scatter) = (start, 2.0 * (squares / count.max(1.0)).sqrt());
    for _ in 0..ROUNDS {
        let reach = GROUND_SIGMAS * scatter.max(0.5);
        let [count, sum, squares] = sums_between(codes, level, -reach, reach);
        let mean = sum / count.max(1.0);
        level += mean;
        // A normal distribution cut off at 2.5 σ keeps 0.95 of its width.
        scatter = (squares / count.max(1.0) - mean * mean).max(0.0).sqrt() / 0.95;
    }
    (f64::from(level), scatter)
}

/// Number of the codes between two distances from a level, sum of their distances and of the squares.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn sums_between(codes: &[u16], level: f32, nearest: f32, farthest: f32) -> [f32; 3] {
    const LANES: usize = 8;
    let mut sums = [[0.0_f32; LANES]; 3];
    // The few that fill no lanes are left out.
    for values in codes.as_chunks::<LANES>().0 {
        for lane in 0..LANES {
            let off = f32::from(values[lane]) - level;
            let counts = if (off >= nearest) & (off <= farthest) { 1.0 } else { 0.0 };
            sums[0][lane] += counts;
            sums[1][lane] += counts * off;
            sums[2][lane] += counts * off * off;
        }
    }
    sums.map(|lanes| lanes.iter().sum())
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{Frame, Mosaic};

    use super::*;

    fn ground(level: impl Fn(usize, usize) -> u16) -> Ground {
        let codes = (0..400 * 300).map(|index| level(index % 400, index / 400)).collect();
        let frame = Frame::new(400, 300, u16::MAX, vec![codes]).expect("a legal frame");
        let plane = frame.plane(Mosaic::Mono, "0").expect("page 0");
        Ground::survey(&plane, None, None, None, &mut Survey::default())
    }

    /// Noise of 2 codes, roughly normal.
    fn noise(u: usize, v: usize) -> u16 {
        let mix = (u * 7919 + v * 104_729) as u64;
        let bits = mix.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 48;
        (bits & 0xffff).count_ones() as u16
    }

    #[test]
    fn an_even_ground_under_discs_is_its_mean() {
        let inside =
            |u: usize, v: usize| (u % 100).abs_diff(50).pow(2) + (v % 100).abs_diff(50).pow(2) < 35_usize.pow(2);
        let bright = ground(|u, v| 100 + noise(u, v) + if inside(u, v) { 3000 } else { 0 });
        assert_eq!((bright.polarity, bright.surface.is_none()), (Polarity::Bright, true));
        assert!((bright.level - 108.0).abs() < 0.3, "{}", bright.level);
        assert!((bright.pixel_noise - 2.0).abs() < 0.3, "{}", bright.pixel_noise);
        let dark = ground(|u, v| 3000 + noise(u, v) - if (u / 40 + v / 40) % 5 == 0 { 2500 } else { 0 });
        assert_eq!((dark.polarity, dark.surface.is_none()), (Polarity::Dark, true));
        assert!((dark.level - 3008.0).abs() < 0.3, "{}", dark.level);
    }

    #[test]
    fn a_slope_is_a_surface() {
        let ground = ground(|u, v| 1000 + u as u16 / 8 + noise(u, v));
        assert!(ground.surface.is_some());
    }

    #[test]
    fn a_crowd_of_features_is_no_surface_and_a_lamp_is_one() {
        let near = |u: usize, v: usize, radius: usize| u.abs_diff(180).pow(2) + v.abs_diff(150).pow(2) < radius.pow(2);
        let is_dot = |u: usize, v: usize| u % 20 > 2 && v % 20 > 1;
        // Where no light falls, codes below zero read zero.
        let dark = |u: usize, v: usize| noise(u, v).saturating_sub(8);
        let crowd = ground(|u, v| dark(u, v) + if near(u, v, 60) && is_dot(u, v) { 900 } else { 0 });
        assert!(crowd.surface.is_none());
        let lamp = ground(|u, v| dark(u, v) + if near(u, v, 60) { 900 } else { 0 });
        assert!(lamp.surface.is_some());
        let glow = ground(|u, v| 100 + noise(u, v) + if near(u, v, 60) { 12 } else { 0 });
        assert!(glow.surface.is_some());
    }

    #[test]
    fn a_constant_plane_is_even() {
        let ground = ground(|_, _| 4095);
        assert_eq!((ground.level, ground.surface.is_none()), (4095.0, true));
        assert!(ground.pixel_noise < 0.5);
    }
}
