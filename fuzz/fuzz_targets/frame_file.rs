//! The bytes of a file are refused, or they are a frame that is written and read back to the same.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use twinpupil::io::frame::{FrameFormat, decode_frame, encode_frame};
use twinpupil_fuzz::instrument;
use twinpupil_instrument::Mosaic;

fuzz_target!(|bytes: &[u8]| {
    for mosaic in [Mosaic::Rggb, Mosaic::Rgb, Mosaic::Mono] {
        for format in [FrameFormat::of_instrument(&instrument(mosaic)), FrameFormat::bare(mosaic, 2)] {
            let Ok(frame) = decode_frame(bytes, &format) else { continue };
            let written = encode_frame(Path::new("frame.tiff"), &frame, mosaic).expect("every frame fits a TIFF");
            assert_eq!(decode_frame(&written, &format).expect("reads back"), frame);
        }
    }
});
