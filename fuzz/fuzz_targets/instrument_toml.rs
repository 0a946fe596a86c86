//! A text is refused, or it is an instrument that prints and reads back to the same.

#![no_main]

use libfuzzer_sys::fuzz_target;
use twinpupil_instrument::Instrument;

fuzz_target!(|text: &str| {
    let Ok(instrument) = Instrument::from_toml(text) else { return };
    let printed = instrument.to_toml();
    assert_eq!(Instrument::from_toml(&printed).expect("reads back"), instrument, "{printed}");
});
