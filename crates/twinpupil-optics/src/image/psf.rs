//! The image of a point: by diffraction, and by rays.

use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

use super::PupilFunction;
use super::bessel::j1_over_x;
use super::pupil::Cell;

/// The image of a point by diffraction, on a square grid about the image of the chief ray.
///
/// ```text
/// I(x) = |∫ A exp(2πi (W − u·x)/λ) du|² / (∫ A du)²        [Goodman, Introduction to Fourier Optics, sec. 6.3]
/// ```
///
/// over the pupil function's directions u, relative to the light that would be in the middle without aberrations.
#[derive(Debug, Clone, PartialEq)]
pub struct Psf {
    /// Places along a side; that of the chief ray is at half of it.
    pub size: usize,
    /// From one to the next, mm.
    pub pitch_mm: f64,
    /// Row by row, along y.
    pub intensity: Vec<f64>,
    /// All light, as the sum of the intensity at all places.
    light_on_grid: f64,
}

/// Light of rays by their distance from some place.
#[derive(Debug, Clone, PartialEq)]
pub struct Encircled {
    /// Distance, mm, and light of every ray, from the middle outwards.
    places: Vec<[f64; 2]>,
    /// Light of the first rays: of none, of one, …
    sums: Vec<f64>,
}

/// Light by diffraction within circles about some place: with the spectrum S of the light about there,
///
/// ```text
/// E(r) = ∫ S(ν) r J₁(2π ν r)/ν d²ν        [Goodman, Introduction to Fourier Optics, secs. 2.1.5, 6.3]
/// ```
///
/// which is exact between the places of a grid, for light has no finer spectrum.
#[derive(Debug, Clone, PartialEq)]
pub struct EncircledWaves {
    /// Frequency, cycles/mm, and spectrum, all frequencies alike added up, over that of none.
    spectrum: Vec<[f64; 2]>,
    /// Area of a place of the spectrum over all light, 1/mm².
    cell_per_mm2: f64,
    /// How far from the middle the grid reaches, mm.
    reach_mm: f64,
}

/// How many times as wide as the pupil the grid of the transform is: places are a quarter of λ/2NA apart.
const PADDING: usize = 4;

impl PupilFunction {
    /// The image by diffraction.
    pub fn psf(&self) -> Psf {
        let size = PADDING * self.size;
        let mut field = vec![Complex::default(); size * size];
        let mut amplitudes = 0.0;
        for (n, cell) in self.cells.iter().enumerate() {
            if let Some(cell) = cell {
                field[n / self.size * size + n % self.size] =
                    Complex::from_polar(cell.mean_amplitude(), self.phase_rad(cell));
                amplitudes += cell.mean_amplitude();
            }
        }
        transform(&mut field, size);
        let half = size / 2;
        // The transform has its middle in the corner, and rows and columns exchanged.
        let at = |row: usize, column: usize| field[(column + half) % size * size + (row + half) % size];
        let intensity = |n: usize| at(n / size, n % size).norm_sqr() / (amplitudes * amplitudes);
        Psf {
            size,
            pitch_mm: self.wavelength_mm / (size as f64 * self.step),
            intensity: (0..size * size).map(intensity).collect(),
            // Parseval's theorem, with the light of places on the rim and not its square.
            light_on_grid: (size * size) as f64 * self.lit().map(Cell::light).sum::<f64>() / (amplitudes * amplitudes),
        }
    }

    /// Light at places along x (0) or y (1) through the image of the chief ray, as [`Psf`] has it.
    pub fn section(&self, axis: usize, offsets_mm: &[f64]) -> Vec<f64> {
        // One sum across the section serves all its places.
        let mut lines = vec![Complex::<f64>::default(); self.size];
        for (n, cell) in self.cells.iter().enumerate() {
            if let Some(cell) = cell {
                lines[[n % self.size, n / self.size][axis]] +=
                    Complex::from_polar(cell.mean_amplitude(), self.phase_rad(cell));
            }
        }
        let middle = 0.5 * (self.size as f64 - 1.0);
        let at = |offset_mm: &f64| {
            let rad = -std::f64::consts::TAU * self.step * offset_mm / self.wavelength_mm;
            let sum: Complex<f64> =
                (0..).zip(&lines).map(|(k, line)| line * Complex::cis(rad * (f64::from(k) - middle))).sum();
            sum.norm_sqr() / self.amplitudes().powi(2)
        };
        offsets_mm.iter().map(at).collect()
    }

    /// Light at a place, as [`Psf`] has it.
    fn light_at(&self, [x_mm, y_mm]: [f64; 2]) -> f64 {
        let sum: Complex<f64> = (self.cells.iter().enumerate())
            .filter_map(|(n, cell)| {
                let (cell, [u, v]) = (cell.as_ref()?, self.offset(n));
                let tilt_rad = std::f64::consts::TAU * (u * x_mm + v * y_mm) / self.wavelength_mm;
                Some(Complex::from_polar(cell.mean_amplitude(), self.phase_rad(cell) - tilt_rad))
            })
            .sum();
        sum.norm_sqr() / self.amplitudes().powi(2)
    }

    fn amplitudes(&self) -> f64 {
        self.lit().map(Cell::mean_amplitude).sum()
    }

    /// Strehl's ratio: the most light anywhere in the image, relative to that without aberrations.
    pub fn strehl_ratio(&self, psf: &Psf) -> f64 {
        let place_mm = psf.brightest_mm();
        self.light_at(place_mm).max(self.light_at([0.0; 2]))
    }

    /// Where rays are in the image on the average of their light, from the chief ray, mm.
    pub fn centroid_mm(&self) -> [f64; 2] {
        let light: f64 = self.lit().map(Cell::light).sum();
        [0, 1].map(|k| self.lit().map(|cell| cell.light() * cell.deviation.error_mm[k]).sum::<f64>() / light)
    }

    /// Light of rays by their distance from the centroid.
    pub fn encircled_by_rays(&self) -> Encircled {
        let centre_mm = self.centroid_mm();
        let places = self.lit().map(|cell| {
            let [x, y] = [0, 1].map(|k| cell.deviation.error_mm[k] - centre_mm[k]);
            [x.hypot(y), cell.light()]
        });
        Encircled::new(places.collect())
    }
}

/// A square of numbers, transformed, with its rows and columns exchanged.
fn transform(field: &mut [Complex<f64>], size: usize) {
    let fft = FftPlanner::new().plan_fft_forward(size);
    fft.process(field);
    for row in 0..size {
        for column in row + 1..size {
            field.swap(row * size + column, column * size + row);
        }
    }
    fft.process(field);
}

impl Psf {
    /// Light within circles about a place, such as the centroid.
    pub fn encircled(&self, centre_mm: [f64; 2]) -> EncircledWaves {
        let size = self.size;
        let mut field: Vec<Complex<f64>> = self.intensity.iter().map(|light| Complex::from(*light)).collect();
        transform(&mut field, size);
        let cell_per_mm = 1.0 / (size as f64 * self.pitch_mm);
        let half = size as i64 / 2;
        let mut by_square = vec![0.0; (2 * half * half) as usize + 1];
        for (n, value) in field.iter().enumerate() {
            let signed = |k: usize| if (k as i64) < half { k as i64 } else { k as i64 - size as i64 };
            // Rows and columns are exchanged.
            let [i, j] = [signed(n / size), signed(n % size)];
            let from_corner = |k: i64, mm: f64| k as f64 * (mm * cell_per_mm + half as f64 / size as f64);
            let turn = from_corner(i, centre_mm[0]) + from_corner(j, centre_mm[1]);
            by_square[(i * i + j * j) as usize] += (value * Complex::cis(std::f64::consts::TAU * turn)).re;
        }
        let all = self.light_on_grid;
        by_square[0] = all;
        let spectrum = by_square.into_iter().enumerate().filter(|(_, value)| value.abs() > FAINT * all);
        EncircledWaves {
            spectrum: spectrum.map(|(square, value)| [(square as f64).sqrt() * cell_per_mm, value / all]).collect(),
            cell_per_mm2: cell_per_mm * cell_per_mm,
            reach_mm: 0.5 / cell_per_mm,
        }
    }

    /// From the image of the chief ray, mm.
    fn place_mm(&self, n: usize) -> [f64; 2] {
        [n % self.size, n / self.size].map(|k| (k as f64 - (self.size / 2) as f64) * self.pitch_mm)
    }

    /// Light at a place from the image of the chief ray, between those of the grid; 0 beyond it.
    pub fn light(&self, place_mm: [f64; 2]) -> f64 {
        let [x, y] = place_mm.map(|mm| mm / self.pitch_mm + (self.size / 2) as f64);
        let last = self.size as f64 - 2.0;
        if !(x >= 0.0 && y >= 0.0 && x <= last && y <= last) {
            return 0.0;
        }
        let ([column, row], [right, up]) = ([x as usize, y as usize], [x.fract(), y.fract()]);
        let along = |row: usize| {
            let at = row * self.size + column;
            (1.0 - right) * self.intensity[at] + right * self.intensity[at + 1]
        };
        (1.0 - up) * along(row) + up * along(row + 1)
    }

    /// Where most light is, mm: between the places of the grid, by parabolas.
    fn brightest_mm(&self) -> [f64; 2] {
        let most = (0..self.intensity.len()).max_by(|a, b| self.intensity[*a].total_cmp(&self.intensity[*b]));
        let n = most.unwrap_or(0);
        let place_mm = self.place_mm(n);
        [(0, 1), (1, self.size)].map(|(axis, stride)| {
            let beside = |to: Option<usize>| to.and_then(|to| self.intensity.get(to)).copied().unwrap_or(0.0);
            let (before, here, after) =
                (beside(n.checked_sub(stride)), self.intensity[n], beside(n.checked_add(stride)));
            let bend = before - 2.0 * here + after;
            let shift = if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
            place_mm[axis] + shift * self.pitch_mm
        })
    }
}

/// Of all light: what a frequency has less of does not count.
const FAINT: f64 = 1e-12;

impl EncircledWaves {
    /// Share of the light within a radius.
    pub fn share(&self, radius_mm: f64) -> f64 {
        // 2π r² J₁(x)/x with x = 2π ν r.
        let disc = |nu_per_mm: f64| {
            std::f64::consts::TAU * radius_mm * radius_mm * j1_over_x(std::f64::consts::TAU * nu_per_mm * radius_mm)
        };
        self.cell_per_mm2 * self.spectrum.iter().map(|[nu_per_mm, value]| value * disc(*nu_per_mm)).sum::<f64>()
    }

    /// Radius within which that share of the light is, mm.
    pub fn radius_mm(&self, share: f64) -> f64 {
        halved(self.reach_mm, |radius_mm| self.share(radius_mm) < share)
    }
}

impl Encircled {
    fn new(mut places: Vec<[f64; 2]>) -> Self {
        places.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
        let sums = places.iter().scan(0.0, |sum, [_, light]| {
            *sum += light;
            Some(*sum)
        });
        Self { sums: std::iter::once(0.0).chain(sums).collect(), places }
    }

    /// Share of the light within a radius.
    pub fn share(&self, radius_mm: f64) -> f64 {
        let within = self.places.partition_point(|[at_mm, _]| *at_mm <= radius_mm);
        self.sums[within] / self.sums.last().copied().unwrap_or(0.0)
    }

    /// Radius within which that share of the light is, mm.
    pub fn radius_mm(&self, share: f64) -> f64 {
        let farthest_mm = self.places.last().map_or(0.0, |[at_mm, _]| *at_mm);
        halved(farthest_mm, |radius_mm| self.share(radius_mm) < share)
    }

    /// Root of the mean square of the distances, mm.
    pub fn rms_mm(&self) -> f64 {
        (self.places.iter().map(|[at_mm, light]| light * at_mm * at_mm).sum::<f64>()
            / self.sums.last().copied().unwrap_or(0.0))
        .sqrt()
    }
}

/// The least radius up to some largest one that is not too small.
fn halved(largest_mm: f64, is_too_small: impl Fn(f64) -> bool) -> f64 {
    let (mut low_mm, mut high_mm) = (0.0, largest_mm);
    for _ in 0..HALVINGS {
        let middle_mm = 0.5 * (low_mm + high_mm);
        if is_too_small(middle_mm) { low_mm = middle_mm } else { high_mm = middle_mm }
    }
    high_mm
}

/// Of the largest distance: to a millionth of it.
const HALVINGS: usize = 20;
