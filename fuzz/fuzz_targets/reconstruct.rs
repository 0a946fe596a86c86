//! Any codes give points of finite numbers, and every feature found is part of a point or rejected.

#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use twinpupil_fuzz::{SIZE_PX, instrument};
use twinpupil_instrument::{Frame, Instrument, Mosaic, ResponseMatrix, Role, SpectralTable};
use twinpupil_reconstruct::{Mode, Options, Reconstruction, Reconstructor};

const CODE_MAX: u16 = 4095;

/// Bytes of one painted disc: centre, radius, height and page.
const DISC_BYTES: usize = 5;

/// Quantum efficiency with strong crosstalk, for the planes of every mosaic.
const QUANTUM_EFFICIENCY: &str = "wavelength_nm,r,g,b,0,1,45,90,135\n\
    400,0.1,0.1,0.9,0.1,0.9,0.5,0.9,0.5\n700,0.9,0.1,0.1,0.9,0.1,0.5,0.1,0.5\n";

/// For every mosaic, a camera that reads by the paper's equations, one that inverts the forward model, one that takes off
/// crosstalk before, and one that compares every pixel with it.
static CAMERAS: LazyLock<Vec<(Instrument, [Reconstructor; 4])>> = LazyLock::new(|| Mosaic::ALL.map(camera).to_vec());

fn camera(mosaic: Mosaic) -> (Instrument, [Reconstructor; 4]) {
    let instrument = instrument(mosaic);
    let table = twinpupil_optics::response_table_for(&instrument).expect("traceable");
    let quantum_efficiency = SpectralTable::from_csv(QUANTUM_EFFICIENCY).expect("legal");
    let filters = SpectralTable::nominal_filters();
    let response = ResponseMatrix::from_curves(&instrument.bands, mosaic, &quantum_efficiency, &filters).expect("seen");
    let reader = |mode, table| Reconstructor::new(instrument.clone(), table, Options { mode, ..Options::default() });
    let inverting = reader(Mode::Centroid, Some(table.clone()));
    let comparing = reader(Mode::Model, Some(table));
    let readers = [reader(Mode::Paper, None), inverting.clone(), inverting.unmixing(&response), comparing];
    (instrument, readers)
}

fuzz_target!(|bytes: &[u8]| {
    let [mosaic, discs, rest @ ..] = bytes else { return };
    let (instrument, readers) = &CAMERAS[usize::from(*mosaic) % CAMERAS.len()];
    let (discs, texture) = rest.split_at((usize::from(discs % 32) * DISC_BYTES).min(rest.len()));
    let frame = frame(instrument.pages(), discs, texture);
    for reader in readers {
        let reconstruction = reader.reconstruct(&frame).expect("the frame has the sensor's size");
        check_numbers(&reconstruction);
        check_balance(instrument, reader, &frame, &reconstruction);
    }
});

/// Pages of repeated `texture` with `discs` painted over it.
fn frame(pages: usize, discs: &[u8], texture: &[u8]) -> Frame {
    let [width, height] = SIZE_PX;
    let wide = |byte: u8| u16::from(byte) * 16 + u16::from(byte) / 16;
    let code = |index: usize| texture.get(index % texture.len().max(1)).copied().map_or(0, wide);
    let mut codes: Vec<Vec<u16>> =
        (0..pages).map(|page| (0..width * height).map(|i| code(i + page)).collect()).collect();
    for disc in discs.chunks_exact(DISC_BYTES) {
        let (u, v, radius) = (f64::from(disc[0]) / 4.0, f64::from(disc[1]) / 5.0, f64::from(disc[2] % 64) / 6.0);
        let page = &mut codes[usize::from(disc[4]) % pages];
        for (index, pixel) in page.iter_mut().enumerate() {
            let distance = ((index % width) as f64 - u).hypot((index / width) as f64 - v);
            let share = (radius + 0.5 - distance).clamp(0.0, 1.0);
            *pixel = pixel.saturating_add((share * f64::from(wide(disc[3]))) as u16).min(CODE_MAX);
        }
    }
    Frame::new(width, height, CODE_MAX, codes).expect("codes up to the largest")
}

fn check_numbers(reconstruction: &Reconstruction) {
    for point in &reconstruction.points {
        let lengths_mm = point.position_mm.iter().chain(&point.std_mm).chain([&point.diameter_mm]);
        assert!(
            lengths_mm.chain([&point.gamma, &point.azimuth_residual_px]).all(|value| value.is_finite()),
            "{point:?}"
        );
        for feature in [point.telecentric, point.entocentric] {
            let centre = [feature.centre.u, feature.centre.v];
            assert!(centre.iter().chain(&feature.centre_std_px).all(|value| value.is_finite()), "{feature:?}");
        }
    }
    for rejection in &reconstruction.rejected {
        assert!(rejection.position.u.is_finite() && rejection.position.v.is_finite(), "{rejection:?}");
    }
}

/// In each band, found = points + rejected.
fn check_balance(instrument: &Instrument, reader: &Reconstructor, frame: &Frame, reconstruction: &Reconstruction) {
    for role in [Role::Telecentric, Role::Entocentric] {
        let detection = reader.detect(frame, role).expect("the frame has the plane");
        let band = &instrument.band(role).name;
        let rejected = reconstruction.rejected.iter().filter(|rejection| rejection.band == *band).count();
        let found = detection.features.len() + detection.rejected.len();
        assert_eq!(found, reconstruction.points.len() + rejected, "{band}");
    }
}
