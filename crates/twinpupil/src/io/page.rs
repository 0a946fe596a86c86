//! One page of an image file, and what the bytes of a file seem to be.

use anyhow::{Result, bail};

/// Pages with more pixels are refused before anything is allocated for them: four times the largest sensor on sale.
const PIXELS_MAX: usize = 1 << 30;

/// One decoded page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Page {
    /// Columns and rows.
    pub size_px: [usize; 2],
    /// 1 for grey, 3 for RGB.
    pub channels: usize,
    /// Bits of a sample in the file: 8 or 16.
    pub bits: u8,
    /// Row by row, channels interleaved.
    pub samples: Vec<u16>,
}

/// Decodes every page of a PNG or TIFF file, refusing other sizes than `size_px` where one is given.
pub fn decode(bytes: &[u8], size_px: Option<[usize; 2]>) -> Result<Vec<Page>> {
    match kind(bytes) {
        "a PNG image" => Ok(vec![super::png::decode(bytes, size_px)?]),
        "a TIFF image" => super::tiff::decode(bytes, size_px),
        other => bail!("not a PNG or TIFF image; it seems to be {other}"),
    }
}

/// Refuses a page by the size in its header, before anything is allocated for its pixels.
pub(super) fn check_size(found_px: [usize; 2], expected_px: Option<[usize; 2]>) -> Result<()> {
    let [width_px, height_px] = found_px;
    if let Some([width, height]) = expected_px.filter(|expected_px| *expected_px != found_px) {
        bail!("the frame is {width_px} × {height_px}, the instrument's sensor.size_px is {width} × {height}");
    }
    if width_px == 0 || height_px == 0 {
        bail!("the image has no pixels");
    }
    if width_px.saturating_mul(height_px) > PIXELS_MAX {
        bail!("{width_px} × {height_px} pixels are more than the {PIXELS_MAX} that can be read");
    }
    Ok(())
}

/// The sentence for samples that are not 8 or 16 bit unsigned.
pub(super) fn unsupported_samples(samples: &str) -> anyhow::Error {
    anyhow::anyhow!("the image has {samples} samples; convert it to 8 or 16 bit unsigned")
}

/// The sentence for a colour model that a sensor does not deliver.
pub(super) fn unsupported_colours(what: &str) -> anyhow::Error {
    anyhow::anyhow!("the image {what}; convert it to grey or RGB")
}

/// What a file seems to be, by its first bytes.
fn kind(bytes: &[u8]) -> &'static str {
    const SIGNATURES: [(&[u8], &str); 17] = [
        (b"\x89PNG\r\n\x1a\n", "a PNG image"),
        (b"II*\0", "a TIFF image"),
        (b"MM\0*", "a TIFF image"),
        (b"II+\0", "a TIFF image"),
        (b"MM\0+", "a TIFF image"),
        (b"\x89PNG", "a PNG image that was transferred as text"),
        (b"\xff\xd8\xff", "a JPEG image"),
        (b"GIF8", "a GIF image"),
        (b"BM", "a BMP image"),
        (b"P5", "a PGM image"),
        (b"P6", "a PPM image"),
        (b"v/1\x01", "an OpenEXR image"),
        (b"SIMPLE  =", "a FITS image"),
        (b"\x89HDF", "an HDF5 file"),
        (b"%PDF", "a PDF document"),
        (b"PK\x03\x04", "a ZIP archive"),
        (b"\x1f\x8b", "a gzip archive"),
    ];
    if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        return "a WebP image";
    }
    let known = SIGNATURES.iter().find(|(signature, _)| bytes.starts_with(signature)).map(|(_, name)| *name);
    known.unwrap_or_else(|| if is_text(bytes) { "a text file" } else { "something unknown" })
}

fn is_text(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(512)];
    let printable = |byte: &u8| !byte.is_ascii_control() || matches!(byte, b'\n' | b'\r' | b'\t');
    head.iter().all(printable) && String::from_utf8_lossy(head).chars().filter(|&c| c == '\u{fffd}').count() <= 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(bytes: &[u8]) -> String {
        decode(bytes, None).expect_err("must be refused").to_string()
    }

    #[test]
    fn other_files_are_named() {
        assert!(message(b"\xff\xd8\xff\xe0...").ends_with("it seems to be a JPEG image"));
        assert!(message(b"RIFF....WEBPVP8 ").ends_with("a WebP image"));
        assert!(message("schema = 1\nname = \"ä\"".as_bytes()).ends_with("a text file"));
        assert!(message(&[0, 1, 2, 3]).ends_with("something unknown"));
    }

    #[test]
    fn absurd_sizes_are_refused_by_their_header() {
        assert!(check_size([100_000, 100_000], None).is_err());
        assert!(check_size([usize::MAX, usize::MAX], None).is_err());
        assert!(check_size([0, 5], None).is_err());
        assert!(check_size([20_000, 20_000], None).is_ok());
        let error = check_size([640, 480], Some([1920, 1200])).unwrap_err().to_string();
        assert_eq!(error, "the frame is 640 × 480, the instrument's sensor.size_px is 1920 × 1200");
    }
}
