//! Bad frames, tables and instruments: one clear sentence each, exit code 1, nothing written.

use std::io::Cursor;

use png::{BitDepth, ColorType};
use tiff::encoder::TiffEncoder;
use tiff::encoder::colortype::{self, Gray16, Gray32, Gray32Float, GrayI16, RGB8};

use crate::program::{Workplace, small_instrument};

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;
const PIXELS: usize = (WIDTH * HEIGHT) as usize;

fn png(width: u32, height: u32, colours: ColorType, depth: BitDepth) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(colours);
    encoder.set_depth(depth);
    if colours == ColorType::Indexed {
        encoder.set_palette(vec![0, 0, 0, 255, 255, 255]);
    }
    let bits = colours.samples() * depth as usize * width as usize;
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&vec![0; bits.div_ceil(8) * height as usize]).unwrap();
    writer.finish().unwrap();
    bytes
}

fn grey_png() -> Vec<u8> {
    png(WIDTH, HEIGHT, ColorType::Grayscale, BitDepth::Sixteen)
}

fn tiff(write: impl Fn(&mut TiffEncoder<&mut Cursor<Vec<u8>>>)) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    write(&mut TiffEncoder::new(&mut bytes).unwrap());
    bytes.into_inner()
}

fn grey_tiff(pages: usize, code: u16) -> Vec<u8> {
    tiff(|encoder| {
        (0..pages).for_each(|_| encoder.write_image::<Gray16>(WIDTH, HEIGHT, &[code; PIXELS]).unwrap());
    })
}

/// A valid signature and header of a grey image, and nothing else.
fn png_header(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = grey_png();
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    let checksum = crc(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
    bytes
}

/// CRC-32 as in the PNG specification, Annex D.
fn crc(bytes: &[u8]) -> u32 {
    let step = |crc: u32, byte: &u8| (0..8).fold(crc ^ u32::from(*byte), |c, _| (c >> 1) ^ ((c & 1) * 0xedb8_8320));
    !bytes.iter().fold(u32::MAX, step)
}

/// Why `reconstruct` refuses a frame file of that name and content.
fn refusal(instrument: &str, name: &str, content: &[u8]) -> String {
    let workplace = Workplace::new();
    workplace.write("camera.toml", instrument);
    workplace.write(name, content);
    let command = format!("reconstruct {name} --instrument camera.toml -o points.csv --rejected rejected.csv");
    let line = workplace.fail(&command);
    let reason = line.strip_prefix(&format!("{name}: "));
    reason.unwrap_or_else(|| panic!("{line} does not name {name}")).to_owned()
}

fn refused(name: &str, content: &[u8], expected: &str) {
    let reason = refusal(&small_instrument(), name, content);
    assert!(reason.starts_with(expected), "{name}: {reason:?} does not start with {expected:?}");
}

#[test]
fn files_that_are_not_frames() {
    refused("frame.png", b"", "the file is empty");
    refused("frame.png", b"\xff\xd8\xff\xe0 JFIF", "not a PNG or TIFF image; it seems to be a JPEG image");
    refused("frame.png", small_instrument().as_bytes(), "not a PNG or TIFF image; it seems to be a text file");
    refused("frame.png", &[7; 100], "not a PNG or TIFF image; it seems to be something unknown");

    let workplace = Workplace::new();
    std::fs::create_dir(workplace.path("folder.png")).unwrap();
    let reason = |name| workplace.fail(&format!("reconstruct {name} --instrument small.toml -o points.csv"));
    assert_eq!(reason("missing.png"), "missing.png: there is no such file");
    assert_eq!(reason("folder.png"), "folder.png: this is a folder, not a file");
}

#[test]
fn truncated_and_damaged_files() {
    let (png, tiff) = (grey_png(), grey_tiff(1, 7));
    for length in [8, 20, png.len() / 2, png.len() - 20] {
        refused("frame.png", &png[..length], "the PNG is truncated");
    }
    refused("frame.tif", &tiff[..tiff.len() / 2], "the TIFF is truncated");
    refused("frame.tif", &tiff[..6], "the TIFF is truncated");
    let mut damaged = png.clone();
    damaged[45] ^= 0xff;
    refused("frame.png", &damaged, "the PNG is damaged: ");
}

#[test]
fn colours_and_samples_that_no_sensor_delivers() {
    let png = |colours, depth| png(WIDTH, HEIGHT, colours, depth);
    let convert = "; convert it to grey or RGB";
    refused("f.png", &png(ColorType::Indexed, BitDepth::Eight), &format!("the image has a colour palette{convert}"));
    for colours in [ColorType::Rgba, ColorType::GrayscaleAlpha] {
        refused("f.png", &png(colours, BitDepth::Eight), &format!("the image has an alpha channel{convert}"));
    }
    let widen = "samples; convert it to 8 or 16 bit unsigned";
    refused("f.png", &png(ColorType::Grayscale, BitDepth::One), &format!("the image has 1 bit {widen}"));

    let float = tiff(|encoder| encoder.write_image::<Gray32Float>(WIDTH, HEIGHT, &[0.5; PIXELS]).unwrap());
    refused("f.tif", &float, &format!("the image has 32 bit floating-point {widen}"));
    let wide = tiff(|encoder| encoder.write_image::<Gray32>(WIDTH, HEIGHT, &[5; PIXELS]).unwrap());
    refused("f.tif", &wide, &format!("the image has 32 bit {widen}"));
    let signed = tiff(|encoder| encoder.write_image::<GrayI16>(WIDTH, HEIGHT, &[-5; PIXELS]).unwrap());
    refused("f.tif", &signed, &format!("the image has 16 bit signed {widen}"));
    let alpha = tiff(|encoder| encoder.write_image::<colortype::RGBA8>(WIDTH, HEIGHT, &[5; 4 * PIXELS]).unwrap());
    refused("f.tif", &alpha, &format!("the image has an alpha channel{convert}"));
}

#[test]
fn frames_that_do_not_fit_the_instrument() {
    let size = "the instrument's sensor.size_px is 64 × 48";
    let wrong = png(80, 48, ColorType::Grayscale, BitDepth::Sixteen);
    refused("f.png", &wrong, &format!("the frame is 80 × 48, {size}"));
    refused("f.png", &png_header(100_000, 100_000), &format!("the frame is 100000 × 100000, {size}"));
    refused("f.tif", &grey_tiff(1, 51_234), "pixel value 51234 is above the 12-bit maximum 4095 (sensor.bit_depth)");
    refused("f.tif", &grey_tiff(3, 0), "the file has 3 page(s) where sensor.mosaic = \"rggb\" expects 1");
    let colour = png(WIDTH, HEIGHT, ColorType::Rgb, BitDepth::Eight);
    let raw = "the image is in colour where sensor.mosaic = \"rggb\" expects the raw grey mosaic, before demosaicing";
    refused("f.png", &colour, raw);

    let rgb = small_instrument().replace("\"rggb\"", "\"rgb\"");
    let grey = "the image is grey where sensor.mosaic = \"rgb\" expects colour, or three grey pages";
    assert_eq!(refusal(&rgb, "f.png", &grey_png()), grey);
    assert_eq!(
        refusal(&rgb, "f.tif", &grey_tiff(2, 0)),
        "the file has 2 page(s) where sensor.mosaic = \"rgb\" expects 3"
    );

    let mono = rgb.replace("\"rgb\"", "\"mono\"").replace("= \"r\" ", "= \"0\" ").replace("= \"b\"", "= \"1\"");
    let colour = tiff(|encoder| encoder.write_image::<RGB8>(WIDTH, HEIGHT, &[5; 3 * PIXELS]).unwrap());
    let pages = "the image is in colour where sensor.mosaic = \"mono\" expects 2 grey page(s)";
    assert_eq!(refusal(&mono, "f.tif", &colour), pages);
    assert_eq!(refusal(&mono, "f.png", &grey_png()), "the file has 1 page(s) where sensor.mosaic = \"mono\" expects 2");
}

#[test]
fn absurd_sizes_without_an_instrument() {
    let workplace = Workplace::new();
    workplace.write("huge.png", png_header(100_000, 100_000));
    workplace.write("large.png", png_header(30_000, 30_000));
    let reason = |name| workplace.fail(&format!("detect {name} --mosaic rggb --plane r -o features.csv"));
    assert!(reason("huge.png").starts_with("huge.png: 100000 × 100000 pixels are more than"));
    assert_eq!(reason("large.png"), "large.png: the PNG is truncated");
}

#[test]
fn empty_scenes_give_empty_tables_that_say_why() {
    let workplace = Workplace::new();
    for (name, code, why) in [
        ("black.tif", 0, "every pixel reads 0"),
        ("grey.tif", 77, "every pixel reads 77"),
        ("white.tif", 4095, "every pixel is saturated at 4095"),
    ] {
        workplace.write(name, grey_tiff(1, code));
        let output = workplace.run(&format!("reconstruct {name} --instrument small.toml -o points.csv"));
        let summary = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{summary}");
        assert!(summary.contains(&format!("{name}: no points, because {why}\n")), "{summary}");
        assert_eq!(workplace.read("points.csv").lines().count(), 1);
    }
}

#[test]
fn bad_instruments_and_scenes() {
    let workplace = Workplace::new();
    let reason = |content: String| {
        workplace.write("bad.toml", content);
        workplace.fail("instrument print bad.toml")
    };
    let edited = |from: &str, to: &str| reason(small_instrument().replacen(from, to, 1));
    assert_eq!(reason("schema = ".to_owned()).split(": ").take(2).collect::<Vec<_>>(), ["bad.toml", "line 1"]);
    assert_eq!(reason(String::new()), "bad.toml: the file is empty");
    let negative = "bad.toml: `sensor.pitch_mm` is -0.00586; legal: 0.00001 to 1";
    assert_eq!(edited("pitch_mm = 0.00586", "pitch_mm = -0.00586"), negative);
    assert!(edited("pitch_mm = 0.00586", "pitch_mm = nan").starts_with("bad.toml: `sensor.pitch_mm` is NaN"));
    assert!(edited("name = ", "nmae = ").contains("unknown field `nmae`"));
    workplace.write("bad.toml", [0xff, 0xfe, 0x00]);
    assert_eq!(workplace.fail("instrument print bad.toml"), "bad.toml: not UTF-8 text");
    assert_eq!(workplace.fail("instrument show none.toml"), "none.toml: there is no such file");

    let scene = "schema = 1\nname = \"s\"\n[plate]\ndistance_mm = 300\npattern = \"image\"\n";
    workplace.write("scene.toml", format!("{scene}image = \"none.png\"\nwidth_mm = 10.0\n"));
    let simulate = "simulate --instrument small.toml --scene scene.toml -o frame.png";
    assert_eq!(workplace.fail(simulate), "none.png: there is no such file");
    workplace.write("scene.toml", "schema = 1\nname = \"s\"\n[[dot]]\nx_mm = 0\ny_mm = 0\nz_mm = -1\n");
    assert!(workplace.fail(simulate).starts_with("scene.toml: `dot[0].z_mm` is -1"));
    workplace.write(
        "spectra.toml",
        small_instrument() + "\n[spectra]\nquantum_efficiency = \"qe.csv\"\nfilters = \"nominal\"\n",
    );
    let simulate = "simulate --instrument spectra.toml --scene paper -o frame.png";
    assert_eq!(workplace.fail(simulate), "qe.csv: there is no such file");
    workplace.write("qe.csv", "wavelength_nm,r\n400,2\n");
    assert!(workplace.fail(simulate).starts_with("qe.csv: line 2: "));
}

#[test]
fn bad_targets() {
    let workplace = Workplace::new();
    let grid = |rest: &str| {
        let dots = "target dot-grid --rows 3 --columns 4 --pitch-mm 2";
        workplace.fail(&format!("{dots} --file t.toml -o grid.svg {rest}"))
    };
    let touching = "`dot_diameter_mm` is 2; legal: below pitch_mm = 2, so that dots do not touch";
    assert_eq!(grid("--dot-diameter-mm 2"), touching);
    assert_eq!(grid("--dot-diameter-mm 1 --missing 3,0"), "`fiducial[0].row` is 3; legal: 0 to 2");
    assert!(grid("--dot-diameter-mm 1 --missing 1,1 --larger 1,1,1.5").starts_with("`fiducial[1]` is row 1, column 1"));
    assert!(grid("--dot-diameter-mm 1 --larger 1,1,1.1").starts_with("`fiducial[0].diameter_mm` is 1.1"));
    assert_eq!(grid("--dot-diameter-mm 1 --margin-mm=-1"), "--margin-mm is -1; legal: 0 to 10000");
    let grid = "target dot-grid --rows 3 --columns 1000 --pitch-mm 10 --dot-diameter-mm 5";
    let refused = "grid.png: the extension tells no format; legal: .svg, .pdf";
    assert_eq!(workplace.fail(&format!("{grid} -o grid.png")), refused);
    let long = "a sheet of 10035 mm is too long for a page of PDF; legal: up to 5080 mm, or SVG";
    assert_eq!(workplace.fail(&format!("{grid} -o grid.pdf")), long);
    let twice = workplace.fail(&format!("{grid} -o a.svg --file a.svg"));
    assert!(twice.ends_with("a.svg: two outputs cannot go to one file"), "{twice}");
    workplace.write("t.toml", "schema = 1\nname = \"t\"\nkind = \"chessboard\"\n");
    assert!(workplace.fail("target print t.toml").starts_with("t.toml: line 3: "));
}

#[test]
fn bad_tables() {
    let workplace = Workplace::new();
    let reason = |content: &str| {
        workplace.write("p.csv", content);
        workplace.fail("fit plane p.csv")
    };
    assert_eq!(reason("x_mm,y_mm\n1,2\n"), "p.csv: line 1: there is no column `z_mm`");
    assert_eq!(reason("x_mm,y_mm,z_mm\n1,2,3\n1,2,?\n"), "p.csv: line 3, column `z_mm`: `?` is not a finite number");
    assert_eq!(reason("x_mm,y_mm,z_mm\n1,2\n"), "p.csv: line 2: 2 fields where the header has 3");
    assert_eq!(reason("x_mm,y_mm,z_mm\n1,2,3\n"), "p.csv: 1 points are too few: at least 3 are needed");
}

#[test]
fn outputs_that_cannot_be_written() {
    let workplace = Workplace::new();
    std::fs::create_dir(workplace.path("folder")).unwrap();
    let simulate = |rest: &str| workplace.fail(&format!("simulate --instrument small.toml --scene paper {rest}"));
    assert_eq!(simulate("-o none/f.png"), "none/f.png: the folder none does not exist");
    assert_eq!(simulate("-o folder"), "folder: a frame is written as .png, .tif or .tiff");
    assert_eq!(simulate("-o small.toml/f.png"), "small.toml/f.png: the folder small.toml is not a folder");
    assert_eq!(simulate("-o f.png --truth t.txt"), "t.txt: a table is written as .csv, .ply or .parquet");
    assert_eq!(simulate("-o f.png --truth none/t.csv"), "none/t.csv: the folder none does not exist");
    assert_eq!(workplace.fail("instrument paper -o folder"), "folder: this is a folder, not a file");
}
