//! PNG pages.

use std::io::{Cursor, ErrorKind};

use anyhow::{Context, Result, anyhow, bail};
use png::{BitDepth, ColorType, Compression, Decoder, DecodingError, Encoder, Limits, Transformations};

use super::page::{Page, check_size, unsupported_colours, unsupported_samples};

/// Decodes the image of a PNG file.
pub(super) fn decode(bytes: &[u8], size_px: Option<[usize; 2]>) -> Result<Page> {
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: 64 << 20 });
    decoder.set_transformations(Transformations::IDENTITY);
    let header = decoder.read_header_info().map_err(sentence)?;
    let size = [header.width as usize, header.height as usize];
    let (channels, bits) = layout(header.color_type, header.bit_depth)?;
    check_size(size, size_px)?;

    let mut reader = decoder.read_info().map_err(sentence)?;
    let length = reader.output_buffer_size().ok_or_else(|| anyhow!("the image does not fit into memory"))?;
    // Deflate packs at most 1032 to 1: a header that promises more than the file can hold allocates nothing.
    if length / 1032 > bytes.len() {
        bail!("the PNG is truncated");
    }
    let mut data = vec![0; length];
    reader.next_frame(&mut data).map_err(sentence)?;
    reader.finish().map_err(sentence)?;
    let samples = match bits {
        8 => data.into_iter().map(u16::from).collect(),
        _ => data.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect(),
    };
    Ok(Page { size_px: size, channels, bits, samples })
}

fn layout(colours: ColorType, depth: BitDepth) -> Result<(usize, u8)> {
    let channels = match colours {
        ColorType::Grayscale => 1,
        ColorType::Rgb => 3,
        ColorType::Indexed => return Err(unsupported_colours("has a colour palette")),
        ColorType::GrayscaleAlpha | ColorType::Rgba => return Err(unsupported_colours("has an alpha channel")),
    };
    match depth {
        BitDepth::Eight => Ok((channels, 8)),
        BitDepth::Sixteen => Ok((channels, 16)),
        other => Err(unsupported_samples(&format!("{} bit", other as u8))),
    }
}

fn sentence(error: DecodingError) -> anyhow::Error {
    match error {
        DecodingError::IoError(error) if error.kind() == ErrorKind::UnexpectedEof => anyhow!("the PNG is truncated"),
        DecodingError::LimitsExceeded => anyhow!("the PNG needs more memory than it should"),
        other => anyhow!("the PNG is damaged: {other}"),
    }
}

/// Encodes a page.
pub(super) fn encode(page: &Page) -> Result<Vec<u8>> {
    let colours = if page.channels == 3 { ColorType::Rgb } else { ColorType::Grayscale };
    match page.bits {
        8 => {
            let data: Vec<u8> = page.samples.iter().map(|&sample| sample as u8).collect();
            encode_bytes(page.size_px, colours, BitDepth::Eight, &data)
        }
        _ => {
            let data: Vec<u8> = page.samples.iter().flat_map(|sample| sample.to_be_bytes()).collect();
            encode_bytes(page.size_px, colours, BitDepth::Sixteen, &data)
        }
    }
}

/// Encodes 8 bit RGB pixels, row by row, three bytes each: a picture for display.
pub fn encode_rgb8(size_px: [usize; 2], rgb: &[u8]) -> Result<Vec<u8>> {
    encode_bytes(size_px, ColorType::Rgb, BitDepth::Eight, rgb)
}

fn encode_bytes(size_px: [usize; 2], colours: ColorType, depth: BitDepth, data: &[u8]) -> Result<Vec<u8>> {
    let [width, height] = size_px.map(u32::try_from);
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width?, height?);
    encoder.set_color(colours);
    encoder.set_depth(depth);
    // The default compression takes three times as long as simulating a frame, for a tenth of the size.
    encoder.set_compression(Compression::Fast);
    let mut writer = encoder.write_header().context("cannot be encoded as PNG")?;
    writer.write_image_data(data).context("cannot be encoded as PNG")?;
    writer.finish().context("cannot be encoded as PNG")?;
    Ok(bytes)
}
