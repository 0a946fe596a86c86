//! Bytes are refused, as a `.zmx` file and as a catalogue of glasses, or they are a lens that can be traced. A test of the optics
//! does the same to thousands of damaged files.

#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../crates/twinpupil-optics/tests/prescriptions/lens_file.rs"]
mod lens_file;

fuzz_target!(|bytes: &[u8]| {
    let _ = lens_file::take(bytes);
});
