//! Instrument and scene give a frame.

use rayon::prelude::*;
use thiserror::Error;
use twinpupil_instrument::check::ValueError;
use twinpupil_instrument::{Frame, FrameError, Instrument, Registration, ResponseMatrix, Sensor};
use twinpupil_optics::{Camera, OpticsError, RayLedger};

use crate::defects::Defects;
use crate::progress::Progress;
use crate::render::{Renderer, TILE_PX, WantedCell};
use crate::sampling::PUPIL_SAMPLES_MAX;
use crate::scene::Scene;
use crate::sensor::{expected_codes, noisy_codes};

/// The most pixels that a frame may have.
const PIXELS_MAX: usize = 1 << 27;

/// How a frame is simulated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulateOptions {
    /// Rays over the pupil for every pixel and band that needs them, 1 to 65536. Powers of two are spread best. The
    /// default, 1024, leaves an error below the noise of 20 000 electrons, also in the dim feet of wide edges, where 256
    /// would add a third to the variance.
    pub pupil_samples: usize,
    /// Whether pixels hold the rounded expected value instead of a random one.
    pub noiseless: bool,
    /// Seed of the sensor's noise; the scene's if left out.
    pub seed: Option<u64>,
    /// Pixels that do not answer to light.
    pub defects: Defects,
}

impl Default for SimulateOptions {
    fn default() -> Self {
        Self { pupil_samples: 1024, noiseless: false, seed: None, defects: Defects::default() }
    }
}

/// Why a frame cannot be simulated.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SimulateError {
    /// An instrument that cannot be traced.
    #[error(transparent)]
    Optics(#[from] OpticsError),
    /// A value outside its range.
    #[error(transparent)]
    Value(#[from] ValueError),
    /// A scene with an image plate whose picture was not handed over.
    #[error("`plate.image` is {path}, but the scene has been given no picture")]
    NoPicture {
        /// The path that the scene file states.
        path: String,
    },
    /// The codes are not a frame.
    #[error(transparent)]
    Frame(#[from] FrameError),
}

/// The electrons that a frame's pixels would hold on average.
#[derive(Debug, Clone, PartialEq)]
pub struct Expectation {
    /// The pages of the frame, each row by row, in electrons, not limited by the full well.
    pub pages: Vec<Vec<f64>>,
    /// What became of the rays.
    pub ledger: RayLedger,
}

/// A simulated frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Simulation {
    /// The codes that the camera delivers.
    pub frame: Frame,
    /// What became of the rays.
    pub ledger: RayLedger,
}

/// Simulates one exposure: the expected electrons of every pixel, then the sensor's noise and codes.
///
/// `progress` is told the share that is done, 0 to 1, from several threads at once.
pub fn simulate(
    instrument: &Instrument,
    scene: &Scene,
    response: &ResponseMatrix,
    options: &SimulateOptions,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Simulation, SimulateError> {
    options.defects.check()?;
    let expectation = expected_electrons(instrument, scene, response, options.pupil_samples, progress)?;
    let frame = expose(&instrument.sensor, &expectation, options, options.seed.unwrap_or(scene.seed))?;
    Ok(Simulation { frame, ledger: expectation.ledger })
}

/// The codes that the sensor delivers where these electrons are expected: another exposure of the same scene for every
/// seed.
pub fn expose(
    sensor: &Sensor,
    expectation: &Expectation,
    options: &SimulateOptions,
    seed: u64,
) -> Result<Frame, SimulateError> {
    options.defects.check()?;
    let codes = |(page, electrons): (usize, &Vec<f64>)| {
        let mut codes = match options.noiseless {
            true => expected_codes(sensor, electrons),
            false => noisy_codes(sensor, electrons, page, seed),
        };
        if options.defects.dead + options.defects.hot > 0.0 {
            options.defects.strike(sensor, page, &mut codes);
        }
        codes
    };
    let codes = expectation.pages.iter().enumerate().map(codes).collect();
    let [width_px, height_px] = sensor.size_px;
    Ok(Frame::new(width_px, height_px, sensor.code_max(), codes)?)
}

/// The mean over pupil and pixel of the radiance that every pixel sees, times the response of its plane.
///
/// ```text
/// E = Σ_band M[plane][band] · mean over rays of weight × radiance
/// ```
///
/// `pupil_samples` is the number of rays for every pixel and band, 1 to 65536; rays are only traced where their
/// outcome is open. `progress` is told the share that is done, 0 to 1, from several threads at once.
pub fn expected_electrons(
    instrument: &Instrument,
    scene: &Scene,
    response: &ResponseMatrix,
    pupil_samples: usize,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Expectation, SimulateError> {
    expectation(instrument, scene, response, pupil_samples, 0, progress)
}

/// [`expected_electrons`] with other rays for every `turn`.
pub(crate) fn expectation(
    instrument: &Instrument,
    scene: &Scene,
    response: &ResponseMatrix,
    pupil_samples: usize,
    turn: usize,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Expectation, SimulateError> {
    check(instrument, scene, pupil_samples)?;
    let mixing = Mixing::new(instrument, response)?;
    let camera = Camera::new(instrument)?;
    let grids = grids(instrument);
    let bands = instrument.bands.len();
    let [width_px, height_px] = instrument.sensor.size_px;
    let progress = Progress::new(grids.len() * bands * height_px.div_ceil(TILE_PX), progress);
    let mut ledger = RayLedger::default();
    let mut pages = vec![Vec::new(); instrument.pages()];
    for (registration, of_grid) in grids {
        let renderer = Renderer::new(instrument, &camera, scene, pupil_samples, turn, registration);
        let mut band_electrons = Vec::with_capacity(bands);
        for band in 0..bands {
            let (electrons, band_ledger) = renderer.band_electrons(band, mixing.wanted(&of_grid, band), &progress);
            ledger.merge(&band_ledger);
            band_electrons.push(electrons);
        }
        for page in of_grid {
            pages[page] = mixing.page(page, &band_electrons, width_px);
        }
    }
    Ok(Expectation { pages, ledger })
}

/// The pages whose pixels lie at the same places of the reference frame: all of them, unless bands have sensors of
/// their own.
fn grids(instrument: &Instrument) -> Vec<(Registration, Vec<usize>)> {
    let mut grids: Vec<(Registration, Vec<usize>)> = Vec::new();
    for page in 0..instrument.pages() {
        let registration = instrument.band_of_page(page).map_or(Registration::IDENTITY, |band| band.registration);
        match grids.iter_mut().find(|(own, _)| *own == registration) {
            Some((_, pages)) => pages.push(page),
            None => grids.push((registration, vec![page])),
        }
    }
    grids
}

fn check(instrument: &Instrument, scene: &Scene, pupil_samples: usize) -> Result<(), SimulateError> {
    if !(1..=PUPIL_SAMPLES_MAX).contains(&pupil_samples) {
        return Err(ValueError::new("pupil samples", pupil_samples, format!("1 to {PUPIL_SAMPLES_MAX}")).into());
    }
    let [width_px, height_px] = instrument.sensor.size_px;
    if width_px.saturating_mul(height_px) > PIXELS_MAX {
        let value = format!("[{width_px}, {height_px}]");
        return Err(ValueError::new("sensor.size_px", value, format!("up to {PIXELS_MAX} pixels to simulate")).into());
    }
    match scene.picture_path() {
        Some(path) if scene.texture().is_none() => Err(SimulateError::NoPicture { path: path.to_owned() }),
        _ => Ok(()),
    }
}

/// How strongly the pixels of every page respond to every band.
struct Mixing {
    /// Page by page, the responses of the four pixels of a 2×2 cell, row by row, to the bands.
    pages: Vec<[[Vec<f64>; 2]; 2]>,
}

impl Mixing {
    fn new(instrument: &Instrument, response: &ResponseMatrix) -> Result<Self, ValueError> {
        let bands = instrument.bands.len();
        let of_pixel =
            |page: usize, column: usize, row: usize| response.of_plane(&instrument.plane_of(page, column, row));
        let cell = |page: usize| [0, 1].map(|row| [0, 1].map(|column| of_pixel(page, column, row)));
        let pages: Vec<_> = (0..instrument.pages()).map(cell).collect();
        match pages.iter().flatten().flatten().find(|responses| responses.len() != bands) {
            Some(odd) => Err(ValueError::new("bands of the response matrix", odd.len(), bands.to_string())),
            None => Ok(Self { pages }),
        }
    }

    /// The pixels of a 2×2 cell that respond to a band in at least one of `pages`.
    fn wanted(&self, pages: &[usize], band: usize) -> WantedCell {
        let responds = |page: &usize, row: usize, column: usize| self.pages[*page][row][column][band] != 0.0;
        [0, 1].map(|row| [0, 1].map(|column| pages.iter().any(|page| responds(page, row, column))))
    }

    /// The electrons of a page from those of every band.
    fn page(&self, page: usize, band_electrons: &[Vec<f64>], width_px: usize) -> Vec<f64> {
        let cell = &self.pages[page];
        let mut electrons = vec![0.0; band_electrons.first().map_or(0, Vec::len)];
        electrons.par_chunks_mut(width_px).enumerate().for_each(|(row, row_electrons)| {
            let first = row * width_px;
            for (column, pixel) in row_electrons.iter_mut().enumerate() {
                let responses = cell[row % 2][column % 2].iter();
                *pixel = responses.zip(band_electrons).map(|(r, electrons)| r * electrons[first + column]).sum();
            }
        });
        electrons
    }
}
