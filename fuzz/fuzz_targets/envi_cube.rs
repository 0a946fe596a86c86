//! A header and the data behind it are refused, or they are a frame that is written and read back to the same.

#![no_main]

use std::io::Cursor;

use libfuzzer_sys::fuzz_target;
use twinpupil::io::envi::{Interleave, decode_cube, encode_cube};
use twinpupil_instrument::CubePlane;

fuzz_target!(|input: (&str, &[u8])| {
    let (header, data) = input;
    let planes = [CubePlane::Wavelength(680.0), CubePlane::Index(0)];
    let decode = |header: &str, data: &[u8], planes: &[CubePlane]| {
        decode_cube(header, data.len() as u64, &mut Cursor::new(data), planes, None, u16::MAX)
    };
    let Ok(frame) = decode(header, data, &planes) else { return };
    let numbered = [CubePlane::Index(2), CubePlane::Index(0)];
    for interleave in Interleave::ALL {
        let (header, data) = encode_cube(&frame, &numbered, interleave).expect("every frame fits a cube");
        let header = String::from_utf8(header).expect("text");
        assert_eq!(decode(&header, &data, &numbered).expect("reads back"), frame);
    }
});
