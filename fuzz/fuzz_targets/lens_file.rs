//! Bytes are refused, as a `.zmx` file and as a catalogue of glasses, or they are a lens that can be traced: every ray has a
//! fate, and one that arrives is somewhere.

#![no_main]

use libfuzzer_sys::fuzz_target;
use twinpupil_instrument::Catalogue;
use twinpupil_optics::{Fate, Ray, Rays, Train, ZmxLens};

fuzz_target!(|bytes: &[u8]| {
    if let Ok(catalogue) = Catalogue::from_agf(bytes) {
        for glass in catalogue.glasses() {
            if let Ok(index) = glass.index(550.0) {
                assert!(index.is_finite());
            }
        }
    }
    let Ok(lens) = ZmxLens::read(bytes) else { return };
    let Ok(train) = Train::new(&lens.prescription, &[], 550.0) else { return };
    let _ = train.first_order(lens.prescription.stop());
    let mut rays: Rays = (0..10).map(|k| Ray::new([0.0, f64::from(k), 0.0], [0.0, 0.01, 1.0])).collect();
    let ledger = train.trace(&mut rays);
    assert_eq!((ledger.launched, ledger.total()), (10, 10));
    for (ray, fate) in rays.iter() {
        assert!(fate != Fate::Arrived || ray.position_mm.iter().all(|c| c.is_finite()), "{ray:?}");
    }
});
