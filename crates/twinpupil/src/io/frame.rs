//! Frames from and to PNG and TIFF files.

use std::path::Path;

use anyhow::{Result, bail};
use twinpupil_instrument::{CubePlane, Frame, FrameError, Instrument, Mosaic};

use super::envi;
use super::files::FrameFiles;
use super::page::{self, Page};
use super::{png, tiff};

/// What a frame file must look like.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameFormat {
    mosaic: Mosaic,
    pages: usize,
    /// Columns and rows, where they are known.
    size_px: Option<[usize; 2]>,
    /// The sensor's bits and their largest code, where they are known.
    depth: Option<(u8, u16)>,
    /// Names of the bands, in the order of their pages, where each has a file of its own.
    bands_by_file: Option<Vec<String>>,
    /// The planes of a cube.
    cube: Vec<CubePlane>,
}

impl FrameFormat {
    /// Frames of an instrument's sensor.
    pub fn of_instrument(instrument: &Instrument) -> Self {
        let sensor = &instrument.sensor;
        Self {
            mosaic: sensor.mosaic,
            pages: instrument.pages(),
            size_px: Some(sensor.size_px),
            depth: Some((sensor.bit_depth, sensor.code_max())),
            bands_by_file: (sensor.mosaic == Mosaic::Sensors).then(|| {
                let name = |page| instrument.band_of_page(page).map(|band| band.name.clone());
                (0..instrument.pages()).map(|page| name(page).unwrap_or_else(|| page.to_string())).collect()
            }),
            cube: match sensor.mosaic {
                Mosaic::Cube => instrument.bands.iter().filter_map(|band| CubePlane::parse(&band.plane)).collect(),
                _ => Vec::new(),
            },
        }
    }

    /// Frames of a sensor of which only the mosaic is known, with `bands` pages if it is monochrome.
    pub fn bare(mosaic: Mosaic, bands: usize) -> Self {
        let pages = mosaic.pages(bands);
        Self { mosaic, pages, size_px: None, depth: None, bands_by_file: None, cube: Vec::new() }
    }

    /// How colour is sampled.
    pub fn mosaic(&self) -> Mosaic {
        self.mosaic
    }

    /// Columns and rows, where they are known.
    pub fn size_px(&self) -> Option<[usize; 2]> {
        self.size_px
    }

    /// Names of the bands, in the order of their pages, where each has a file of its own.
    pub fn bands_by_file(&self) -> Option<&[String]> {
        self.bands_by_file.as_deref()
    }

    /// The planes of a cube.
    pub fn cube(&self) -> &[CubePlane] {
        &self.cube
    }

    /// The format of the file of one of several sensors.
    #[must_use]
    pub fn of_one_sensor(&self) -> Self {
        Self { mosaic: Mosaic::Mono, pages: 1, bands_by_file: None, ..self.clone() }
    }

    /// The largest code of a file with `bits` bits a sample.
    pub fn code_max(&self, bits: u8) -> u16 {
        let sensor_max = self.depth.map_or(u16::MAX, |(_, code_max)| code_max);
        if bits == 8 { sensor_max.min(255) } else { sensor_max }
    }
}

/// Reads a frame from the bytes of a PNG or TIFF file.
///
/// A mosaic is one grey page, RGB one colour page or three grey ones, `mono` one grey page for each band. The largest
/// code is 255 in a file of 8 bit, and that of the sensor's bit depth in a file of 16 bit.
pub fn decode_frame(bytes: &[u8], format: &FrameFormat) -> Result<Frame> {
    let pages = page::decode(bytes, format.size_px)?;
    let ([width_px, height_px], bits) = (pages[0].size_px, pages[0].bits);
    if let Some(odd) = pages.iter().find(|page| (page.size_px, page.bits) != (pages[0].size_px, bits)) {
        let [width, height] = odd.size_px;
        bail!("the pages differ: {width_px} × {height_px} of {bits} bit and {width} × {height} of {} bit", odd.bits);
    }
    let planes = grey_planes(pages, format)?;
    Frame::new(width_px, height_px, format.code_max(bits), planes).map_err(|error| match (error, format.depth) {
        (FrameError::AboveCodeMax { code, code_max }, Some((bit_depth, _))) => {
            anyhow::anyhow!("pixel value {code} is above the {bit_depth}-bit maximum {code_max} (sensor.bit_depth)")
        }
        (error, _) => error.into(),
    })
}

/// The pages of the frame, whichever way the file stores them.
fn grey_planes(pages: Vec<Page>, format: &FrameFormat) -> Result<Vec<Vec<u16>>> {
    let (mosaic, expected) = (format.mosaic.name(), format.pages);
    let coloured = pages.iter().any(|page| page.channels == 3);
    match format.mosaic {
        Mosaic::Rgb if coloured && pages.len() == 1 => Ok(split(&pages[0])),
        Mosaic::Rgb if coloured => bail!("the file has {} pages where one colour page is expected", pages.len()),
        Mosaic::Mono if coloured => {
            bail!("the image is in colour where sensor.mosaic = \"{mosaic}\" expects {expected} grey page(s)")
        }
        _ if coloured => bail!(
            "the image is in colour where sensor.mosaic = \"{mosaic}\" expects the raw grey mosaic, before demosaicing"
        ),
        Mosaic::Rgb if pages.len() == 1 => {
            bail!("the image is grey where sensor.mosaic = \"rgb\" expects colour, or three grey pages")
        }
        _ if pages.len() != expected => {
            bail!("the file has {} page(s) where sensor.mosaic = \"{mosaic}\" expects {expected}", pages.len())
        }
        _ => Ok(pages.into_iter().map(|page| page.samples).collect()),
    }
}

/// The red, green and blue pages of a colour page.
fn split(page: &Page) -> Vec<Vec<u16>> {
    (0..3).map(|channel| page.samples.iter().skip(channel).step_by(3).copied().collect()).collect()
}

/// Encodes a frame by the extension of `path`: PNG or TIFF, 8 bit where the codes fit, else 16 bit.
///
/// RGB becomes one interleaved page; the pages of a `mono` frame stay pages, which needs TIFF.
pub fn encode_frame(path: &Path, frame: &Frame, mosaic: Mosaic) -> Result<Vec<u8>> {
    let pages = file_pages(frame, mosaic);
    match FrameFile::of(path)? {
        FrameFile::Tiff => tiff::encode(&pages),
        FrameFile::Png if pages.len() == 1 => png::encode(&pages[0]),
        FrameFile::Png => {
            bail!("{}: a PNG holds one page and the frame has {}; write a .tiff", path.display(), pages.len())
        }
    }
}

/// Refuses files into which the frames of an instrument cannot be encoded, before any work is done.
pub fn check_frame_files(files: &FrameFiles, instrument: &Instrument) -> Result<()> {
    let mosaic = instrument.sensor.mosaic;
    let pages = if matches!(mosaic, Mosaic::Rgb | Mosaic::Sensors) { 1 } else { instrument.pages() };
    for path in files.paths() {
        if mosaic == Mosaic::Cube {
            envi::cube_paths(path)?;
        } else if FrameFile::of(path)? == FrameFile::Png && pages > 1 {
            bail!("{}: a PNG holds one page and the frame has {pages}; write a .tiff", path.display());
        }
    }
    Ok(())
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FrameFile {
    Png,
    Tiff,
}

impl FrameFile {
    fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match extension.as_str() {
            "png" => Ok(Self::Png),
            "tif" | "tiff" => Ok(Self::Tiff),
            _ => bail!("{}: a frame is written as .png, .tif or .tiff", path.display()),
        }
    }
}

fn file_pages(frame: &Frame, mosaic: Mosaic) -> Vec<Page> {
    let size_px = [frame.width_px(), frame.height_px()];
    let bits = if frame.code_max() <= 255 { 8 } else { 16 };
    match (mosaic, frame.pages()) {
        (Mosaic::Rgb, [red, green, blue]) => {
            let samples = red.iter().zip(green).zip(blue).flat_map(|((r, g), b)| [*r, *g, *b]).collect();
            vec![Page { size_px, channels: 3, bits, samples }]
        }
        (_, pages) => pages.iter().map(|codes| Page { size_px, channels: 1, bits, samples: codes.clone() }).collect(),
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;

    fn frame(pages: usize, code_max: u16) -> Frame {
        let codes =
            |page: usize| (0..7 * 5).map(|i| ((i * 31 + page * 97) % (usize::from(code_max) + 1)) as u16).collect();
        Frame::new(7, 5, code_max, (0..pages).map(codes).collect()).expect("a legal frame")
    }

    #[test]
    fn what_is_written_is_read_back() {
        let cases = [(Mosaic::Rggb, 1, 2), (Mosaic::Rgb, 3, 2), (Mosaic::Mono, 2, 2), (Mosaic::Mono, 1, 1)];
        for (mosaic, pages, bands) in cases {
            for (extension, code_max) in [("png", 255), ("png", u16::MAX), ("TIF", 255), ("tiff", u16::MAX)] {
                if mosaic == Mosaic::Mono && pages > 1 && extension == "png" {
                    continue;
                }
                let frame = frame(pages, code_max);
                let path = Path::new("frame").with_extension(extension);
                let bytes = encode_frame(&path, &frame, mosaic).expect("encodes");
                let back = decode_frame(&bytes, &FrameFormat::bare(mosaic, bands)).expect("reads back");
                assert_eq!(back, frame, "{mosaic:?} {extension} {code_max}");
            }
        }
    }

    #[test]
    fn three_grey_pages_are_an_rgb_frame() {
        let frame = frame(3, 4095);
        let bytes = encode_frame(Path::new("f.tif"), &frame, Mosaic::Mono).expect("encodes");
        let back = decode_frame(&bytes, &FrameFormat::bare(Mosaic::Rgb, 2)).expect("reads");
        assert_eq!(back.pages(), frame.pages());
    }

    #[test]
    fn damaged_files_never_panic() {
        for path in ["f.png", "f.tif"] {
            let bytes = encode_frame(Path::new(path), &frame(1, 4095), Mosaic::Rggb).expect("encodes");
            let format = FrameFormat::bare(Mosaic::Rggb, 2);
            for length in 1..bytes.len() {
                let _ = decode_frame(&bytes[..length], &format);
            }
            for position in 0..bytes.len() {
                for value in [0x00, 0x01, 0x7f, 0xff] {
                    let mut damaged = bytes.clone();
                    damaged[position] = value;
                    let _ = decode_frame(&damaged, &format);
                }
            }
        }
    }

    #[test]
    fn a_multi_page_png_is_refused_before_and_after() {
        let mut spec = paper::instrument().into_spec();
        spec.sensor.mosaic = Mosaic::Mono;
        spec.bands[0].plane = "0".to_owned();
        spec.bands[1].plane = "1".to_owned();
        let mono = Instrument::new(spec).expect("legal");
        let check = |path: &str, instrument: &Instrument| {
            check_frame_files(&FrameFiles::of_output(&[path.into()], instrument).unwrap(), instrument)
        };
        let early = check("f.png", &mono).unwrap_err().to_string();
        let late = encode_frame(Path::new("f.png"), &frame(2, 255), Mosaic::Mono).unwrap_err().to_string();
        assert_eq!(early, late);
        assert!(check("f.bmp", &paper::instrument()).is_err());
        assert!(check("f", &paper::instrument()).is_err());
    }
}
