//! What must hold of any bytes that are read as a lens or as a catalogue. The fuzz target `lens_file` is the same.

use twinpupil_instrument::Catalogue;
use twinpupil_optics::{Fate, Field, Imager, Ray, Rays, Train, ZmxLens};

/// How bytes were taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Taken {
    /// As a lens that was traced.
    Lens,
    /// As a lens of materials that are not known, or not at this wavelength.
    LensWithoutGlass,
    /// As a catalogue.
    Catalogue,
    /// Refused as both.
    Refused,
}

const WAVELENGTH_NM: f64 = 550.0;

/// Bytes are refused with a line of the file, as a `.zmx` file and as a catalogue of glasses, or they are a lens that can be
/// traced: every ray has a fate, and one that arrives is somewhere.
pub(crate) fn take(bytes: &[u8]) -> Taken {
    let lines = 1 + bytes.iter().filter(|byte| **byte == b'\n' || **byte == b'\r').count();
    let is_catalogue = match Catalogue::from_agf(bytes) {
        Ok(catalogue) => {
            for glass in catalogue.glasses() {
                assert!(glass.index(WAVELENGTH_NM).map_or(true, f64::is_finite), "{}", glass.name());
            }
            true
        }
        Err(error) => {
            assert!((1..=lines).contains(&error.line) && !error.message.is_empty(), "{error}");
            false
        }
    };
    match ZmxLens::read(bytes) {
        Ok(lens) => trace(&lens),
        Err(error) => {
            assert!(error.to_string().starts_with("line "), "{error}");
            if is_catalogue { Taken::Catalogue } else { Taken::Refused }
        }
    }
}

fn trace(lens: &ZmxLens) -> Taken {
    let Ok(train) = Train::new(&lens.prescription, &[], WAVELENGTH_NM) else { return Taken::LensWithoutGlass };
    let stop = lens.prescription.stop();
    let first_order = train.first_order(stop);
    let _ = train.seidel(first_order.marginal_ray(1.0, None), first_order.chief_ray(0.01));
    let mut rays: Rays = (0..10).map(|k| Ray::new([0.0, f64::from(k), 0.0], [0.0, 0.01, 1.0])).collect();
    let ledger = train.trace(&mut rays);
    assert_eq!((ledger.launched, ledger.total()), (10, 10));
    for (ray, fate) in rays.iter() {
        assert!(fate != Fate::Arrived || ray.position_mm.iter().all(|c| c.is_finite()), "{ray:?}");
    }
    let imager = Imager::through_stop(train, WAVELENGTH_NM, stop, 1.0);
    if let Some(sight) = imager.sight(Field::Infinite { slope: [0.0, 0.01] }) {
        for deviation in sight.deviations(&[[0.0, 1.0], [0.5, 0.0]]).into_iter().flatten() {
            assert!(deviation.error_mm.iter().all(|mm| mm.is_finite()), "{deviation:?}");
        }
        let _ = sight.foci();
        let _ = sight.pupil_function(4).map(|pupil| pupil.contrasts(&[10.0]));
    }
    Taken::Lens
}
