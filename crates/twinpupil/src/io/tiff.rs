//! TIFF pages.

use std::io::{Cursor, ErrorKind};

use anyhow::{Context, Result, anyhow, bail};
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::encoder::colortype::{ColorType as Encoding, Gray8, Gray16, Gray32Float, RGB8, RGB16};
use tiff::encoder::{TiffEncoder, TiffValue};
use tiff::tags::{SampleFormat, Tag};
use tiff::{ColorType, TiffError};

use super::page::{Page, check_size, unsupported_colours, unsupported_samples};

/// More pages are refused: a frame has one for each band.
const PAGES_MAX: usize = 64;

/// Decodes every page of a TIFF file.
pub(super) fn decode(bytes: &[u8], size_px: Option<[usize; 2]>) -> Result<Vec<Page>> {
    let mut limits = Limits::default();
    limits.decoding_buffer_size = 6 << 30;
    limits.intermediate_buffer_size = 1 << 30;
    limits.ifd_value_size = 64 << 20;
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(sentence)?.with_limits(limits);
    let mut pages = Vec::new();
    loop {
        pages.push(decode_page(&mut decoder, bytes.len(), size_px)?);
        if !decoder.more_images() {
            return Ok(pages);
        }
        if pages.len() == PAGES_MAX {
            bail!("the TIFF has more than {PAGES_MAX} pages");
        }
        decoder.next_image().map_err(sentence)?;
    }
}

fn decode_page(decoder: &mut Decoder<Cursor<&[u8]>>, file_bytes: usize, size_px: Option<[usize; 2]>) -> Result<Page> {
    let (width, height) = decoder.dimensions().map_err(sentence)?;
    let size = [width as usize, height as usize];
    let format = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).map_err(sentence)?.unwrap_or_default();
    let format = format.first().map_or(SampleFormat::Uint, |&code| SampleFormat::from_u16_exhaustive(code));
    let (channels, bits) = layout(decoder.colortype().map_err(sentence)?, format)?;
    check_size(size, size_px)?;
    // Deflate and LZW pack at most about 1400 to 1: a header that promises more than the file can hold allocates nothing.
    if size[0] * size[1] * channels * usize::from(bits / 8) / 1400 > file_bytes {
        bail!("the TIFF is truncated");
    }

    let mut data = DecodingResult::U8(Vec::new());
    let planes = decoder.read_image_to_buffer(&mut data).map_err(sentence)?.planes;
    let samples = match data {
        DecodingResult::U8(data) => data.into_iter().map(u16::from).collect(),
        DecodingResult::U16(data) => data,
        _ => return Err(unsupported_samples("other than unsigned integer")),
    };
    let samples = if planes == channels && channels > 1 { interleaved(&samples, channels) } else { samples };
    if samples.len() != size[0] * size[1] * channels {
        bail!("the TIFF is damaged: {} samples for {width} × {height} pixels", samples.len());
    }
    Ok(Page { size_px: size, channels, bits, samples })
}

fn layout(colours: ColorType, format: SampleFormat) -> Result<(usize, u8)> {
    let (channels, bits) = match colours {
        ColorType::Gray(bits) => (1, bits),
        ColorType::RGB(bits) => (3, bits),
        ColorType::Palette(_) => return Err(unsupported_colours("has a colour palette")),
        ColorType::GrayA(_) | ColorType::RGBA(_) => return Err(unsupported_colours("has an alpha channel")),
        ColorType::Multiband { num_samples, .. } => {
            return Err(unsupported_colours(&format!("has {num_samples} samples a pixel")));
        }
        other => return Err(unsupported_colours(&format!("has the colours {other:?}"))),
    };
    match (format, bits) {
        (SampleFormat::Uint | SampleFormat::Void, 8 | 16) => Ok((channels, bits)),
        (SampleFormat::Uint | SampleFormat::Void, _) => Err(unsupported_samples(&format!("{bits} bit"))),
        (SampleFormat::IEEEFP, _) => Err(unsupported_samples(&format!("{bits} bit floating-point"))),
        (SampleFormat::Int, _) => Err(unsupported_samples(&format!("{bits} bit signed"))),
        _ => Err(unsupported_samples("unknown")),
    }
}

/// Plane after plane → pixel after pixel.
fn interleaved(planar: &[u16], channels: usize) -> Vec<u16> {
    let pixels = planar.len() / channels;
    (0..pixels * channels).map(|i| planar[i % channels * pixels + i / channels]).collect()
}

fn sentence(error: TiffError) -> anyhow::Error {
    match error {
        TiffError::IoError(error) if error.kind() == ErrorKind::UnexpectedEof => anyhow!("the TIFF is truncated"),
        TiffError::LimitsExceeded => anyhow!("the TIFF needs more memory than it should"),
        TiffError::UnsupportedError(error) => anyhow!("the TIFF cannot be read: {error}"),
        TiffError::FormatError(error) => anyhow!("the TIFF is damaged: {error}"),
        other => anyhow!("the TIFF is damaged: {other}"),
    }
}

/// Encodes pages, uncompressed, which every reader understands.
pub(super) fn encode(pages: &[Page]) -> Result<Vec<u8>> {
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes)?;
    for page in pages {
        let narrow = || page.samples.iter().map(|&sample| sample as u8).collect::<Vec<u8>>();
        match (page.channels, page.bits) {
            (1, 8) => write::<Gray8>(&mut encoder, page, &narrow()),
            (1, _) => write::<Gray16>(&mut encoder, page, &page.samples),
            (_, 8) => write::<RGB8>(&mut encoder, page, &narrow()),
            (_, _) => write::<RGB16>(&mut encoder, page, &page.samples),
        }
        .context("cannot be encoded as TIFF")?;
    }
    Ok(bytes.into_inner())
}

/// Encodes pages of numbers as 32-bit floats, each row by row.
pub fn encode_tiff_f32(size_px: [usize; 2], pages: &[Vec<f64>]) -> Result<Vec<u8>> {
    let [width, height] = size_px.map(u32::try_from);
    let (width, height) = (width?, height?);
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes)?;
    for page in pages {
        let numbers: Vec<f32> = page.iter().map(|number| *number as f32).collect();
        encoder.write_image::<Gray32Float>(width, height, &numbers).context("cannot be encoded as TIFF")?;
    }
    Ok(bytes.into_inner())
}

fn write<E: Encoding>(encoder: &mut TiffEncoder<&mut Cursor<Vec<u8>>>, page: &Page, samples: &[E::Inner]) -> Result<()>
where
    [E::Inner]: TiffValue,
{
    let [width, height] = page.size_px.map(u32::try_from);
    Ok(encoder.write_image::<E>(width?, height?, samples)?)
}
