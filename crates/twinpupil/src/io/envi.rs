//! Hyperspectral cubes: an ENVI header beside a file of raw samples.
//!
//! The format is that of NV5's ENVI: a text of `key = value` lines that starts with the word `ENVI`, and samples in one
//! of three orders. "ENVI Header Files", NV5 Geospatial documentation.

use std::collections::HashMap;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use twinpupil_instrument::{CubePlane, Frame};

use super::input;
use super::page::check_size;

/// Larger headers are refused.
const HEADER_BYTES_MAX: usize = 16 << 20;

/// Extensions of the file of samples that are looked for beside a header.
const DATA_EXTENSIONS: [&str; 8] = ["raw", "dat", "img", "bsq", "bil", "bip", "bin", ""];

/// The order of the samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interleave {
    /// Plane after plane.
    Bsq,
    /// Row after row, each with all planes one after the other.
    Bil,
    /// Pixel after pixel.
    Bip,
}

impl Interleave {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Bsq, Self::Bil, Self::Bip];

    /// The word used in headers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bsq => "bsq",
            Self::Bil => "bil",
            Self::Bip => "bip",
        }
    }
}

/// How a sample is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Samples {
    /// Data type 1: 8 bit unsigned.
    U8,
    /// Data type 2: 16 bit signed.
    I16,
    /// Data type 12: 16 bit unsigned.
    U16,
}

impl Samples {
    fn bytes(self) -> u64 {
        if self == Self::U8 { 1 } else { 2 }
    }
}

/// A header, checked: how the samples of a cube lie in its file.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    columns: usize,
    rows: usize,
    planes: usize,
    samples: Samples,
    interleave: Interleave,
    big_endian: bool,
    offset: u64,
    /// Wavelength of every plane, nm; empty if the header states none.
    wavelengths_nm: Vec<f64>,
}

impl Header {
    /// Reads the text of a header.
    pub fn parse(text: &str) -> Result<Self> {
        let entries = Entries::parse(text)?;
        let samples = match entries.whole("data type")? {
            1 => Samples::U8,
            2 => Samples::I16,
            12 => Samples::U16,
            other => bail!("`data type` is {other}; legal: 1, 2 or 12 (8 bit, 16 bit signed, 16 bit unsigned)"),
        };
        let word = entries.text("interleave")?.to_ascii_lowercase();
        let Some(interleave) = Interleave::ALL.into_iter().find(|interleave| interleave.name() == word) else {
            bail!("`interleave` is {word}; legal: bsq, bil or bip")
        };
        let big_endian = match entries.whole_or("byte order", 0)? {
            order @ (0 | 1) => order == 1,
            other => bail!("`byte order` is {other}; legal: 0 or 1"),
        };
        if let Some(compression) = entries.get("file compression").filter(|value| *value != "0") {
            bail!("`file compression` is {compression}; legal: 0");
        }
        let size = |key: &'static str| -> Result<usize> {
            let value = entries.whole(key)?;
            match usize::try_from(value).ok().filter(|size| (1..=1 << 24).contains(size)) {
                Some(size) => Ok(size),
                None => bail!("`{key}` is {value}; legal: 1 to {}", 1 << 24),
            }
        };
        let header = Self {
            columns: size("samples")?,
            rows: size("lines")?,
            planes: size("bands")?,
            samples,
            interleave,
            big_endian,
            offset: entries.whole_or("header offset", 0)?,
            wavelengths_nm: entries.wavelengths_nm()?,
        };
        match header.wavelengths_nm.len() {
            0 => Ok(header),
            count if count == header.planes => Ok(header),
            count => bail!("`wavelength` has {count} values; legal: {}, one for each of `bands`", header.planes),
        }
    }

    /// Bytes that the file of samples must have.
    fn file_bytes(&self) -> Option<u64> {
        let pixels = (self.columns as u64).checked_mul(self.rows as u64)?.checked_mul(self.planes as u64)?;
        pixels.checked_mul(self.samples.bytes())?.checked_add(self.offset)
    }

    /// Index of a plane in the cube.
    fn index(&self, plane: CubePlane) -> Result<usize> {
        match plane {
            CubePlane::Index(index) if index < self.planes => Ok(index),
            CubePlane::Index(index) => bail!("plane {index} is asked for; legal: 0 to {}", self.planes - 1),
            CubePlane::Wavelength(nm) => {
                let off_nm = |index: &usize| (self.wavelengths_nm[*index] - nm).abs();
                let nearest = (0..self.wavelengths_nm.len()).min_by(|a, b| off_nm(a).total_cmp(&off_nm(b)));
                let nearest = nearest.with_context(|| {
                    format!("plane `{nm} nm` is asked for, but the header has no `wavelength`; legal: a plane's number")
                })?;
                if off_nm(&nearest) > self.spacing_nm() {
                    bail!("plane `{nm} nm` is asked for; the nearest is {} nm", self.wavelengths_nm[nearest]);
                }
                Ok(nearest)
            }
        }
    }

    /// The widest step from one wavelength to the next: what lies farther off than this is not in the cube.
    fn spacing_nm(&self) -> f64 {
        let mut rising = self.wavelengths_nm.clone();
        rising.sort_by(f64::total_cmp);
        rising.windows(2).map(|pair| pair[1] - pair[0]).reduce(f64::max).unwrap_or(f64::INFINITY)
    }

    /// Reads some planes of the cube, a row at a time; refuses a file of another length before anything is allocated.
    ///
    /// `bytes` is the length of `data`.
    fn read(&self, planes: &[CubePlane], bytes: u64, data: &mut (impl Read + Seek)) -> Result<Vec<Vec<u16>>> {
        let indices = planes.iter().map(|plane| self.index(*plane)).collect::<Result<Vec<_>>>()?;
        if let Some(twice) = (1..indices.len()).find(|k| indices[..*k].contains(&indices[*k])) {
            bail!("plane `{}` is the cube's plane {}, as another band's is", planes[twice], indices[twice]);
        }
        let expected = self.file_bytes().context("the header states more samples than a file can hold")?;
        if bytes != expected {
            let Self { columns, rows, planes, offset, .. } = self;
            let width = self.samples.bytes();
            bail!(
                "the data has {bytes} bytes; legal: {expected}, as the header says \
                 ({columns} samples × {rows} lines × {planes} bands × {width} bytes after {offset})"
            );
        }
        let mut pages = vec![Vec::with_capacity(self.columns * self.rows); indices.len()];
        let mut line = Vec::new();
        for row in 0..self.rows {
            match self.interleave {
                Interleave::Bip => {
                    let samples = self.columns * self.planes;
                    self.read_line(data, (row * samples) as u64, samples, &mut line)?;
                    for (page, index) in pages.iter_mut().zip(&indices) {
                        let own = line.chunks_exact(self.pixel_bytes() * self.planes);
                        let own = own.map(|pixel| &pixel[index * self.pixel_bytes()..][..self.pixel_bytes()]);
                        own.map(|sample| self.code(sample)).try_for_each(|code| code.map(|code| page.push(code)))?;
                    }
                }
                Interleave::Bsq | Interleave::Bil => {
                    for (page, index) in pages.iter_mut().zip(&indices) {
                        let line_index = match self.interleave {
                            Interleave::Bsq => *index as u64 * self.rows as u64 + row as u64,
                            _ => row as u64 * self.planes as u64 + *index as u64,
                        };
                        self.read_line(data, line_index * self.columns as u64, self.columns, &mut line)?;
                        let samples = line.chunks_exact(self.pixel_bytes());
                        samples
                            .map(|sample| self.code(sample))
                            .try_for_each(|code| code.map(|code| page.push(code)))?;
                    }
                }
            }
        }
        Ok(pages)
    }

    fn pixel_bytes(&self) -> usize {
        self.samples.bytes() as usize
    }

    /// Reads samples from a place in the cube on.
    fn read_line(&self, data: &mut (impl Read + Seek), first: u64, count: usize, line: &mut Vec<u8>) -> Result<()> {
        data.seek(SeekFrom::Start(self.offset + first * self.samples.bytes())).context("the data cannot be read")?;
        line.resize(count * self.pixel_bytes(), 0);
        data.read_exact(line).context("the data cannot be read")
    }

    fn code(&self, sample: &[u8]) -> Result<u16> {
        let word = match *sample {
            [byte] => return Ok(byte.into()),
            [a, b] if self.big_endian => u16::from_be_bytes([a, b]),
            [a, b] => u16::from_le_bytes([a, b]),
            _ => 0,
        };
        if self.samples == Samples::I16 && word > i16::MAX as u16 {
            bail!("a sample is {}; legal: 0 to 32767", word as i16);
        }
        Ok(word)
    }
}

/// The keys of a header and their values.
struct Entries {
    values: HashMap<String, String>,
}

impl Entries {
    fn parse(text: &str) -> Result<Self> {
        let mut lines = text.lines().enumerate();
        if lines.next().is_none_or(|(_, first)| first.trim() != "ENVI") {
            bail!("not an ENVI header: line 1 must be ENVI");
        }
        let mut values = HashMap::new();
        while let Some((number, line)) = lines.next() {
            if line.trim().is_empty() || line.trim_start().starts_with(';') {
                continue;
            }
            let Some((key, value)) = line.split_once('=') else {
                bail!("line {}: `{}` is not `key = value`", number + 1, shortened(line))
            };
            let mut value = value.trim().to_owned();
            if value.starts_with('{') {
                while !value.contains('}') {
                    let Some((_, more)) = lines.next() else { bail!("line {}: {{ without }}", number + 1) };
                    value = value + " " + more.trim();
                }
            }
            let key = key.split_whitespace().collect::<Vec<_>>().join(" ").to_ascii_lowercase();
            if values.insert(key.clone(), value).is_some() {
                bail!("line {}: `{}` is stated twice", number + 1, shortened(&key));
            }
        }
        Ok(Self { values })
    }

    fn get(&self, key: &str) -> Option<&str> {
        self.values.get(key).map(String::as_str)
    }

    fn text(&self, key: &str) -> Result<&str> {
        self.get(key).with_context(|| format!("`{key}` is missing"))
    }

    fn whole(&self, key: &str) -> Result<u64> {
        let value = self.text(key)?;
        value.parse().ok().with_context(|| format!("`{key}` is {}; legal: a whole number", shortened(value)))
    }

    fn whole_or(&self, key: &str, default: u64) -> Result<u64> {
        if self.get(key).is_some() { self.whole(key) } else { Ok(default) }
    }

    fn wavelengths_nm(&self) -> Result<Vec<f64>> {
        let Some(list) = self.get("wavelength") else { return Ok(Vec::new()) };
        let unit_nm = match self.get("wavelength units").unwrap_or("Nanometers").to_ascii_lowercase().as_str() {
            "nanometers" | "nm" => 1.0,
            "micrometers" | "um" | "µm" => 1000.0,
            other => bail!("`wavelength units` is {}; legal: Nanometers or Micrometers", shortened(other)),
        };
        let inner = list.trim_start_matches('{').split('}').next().unwrap_or_default();
        let number = |text: &str| {
            let value: Option<f64> = text.trim().parse().ok();
            value.filter(|nm| nm.is_finite() && *nm > 0.0).map(|value| value * unit_nm).with_context(|| {
                format!("`wavelength` has the value {}; legal: numbers above 0", shortened(text.trim()))
            })
        };
        inner.split(',').map(number).collect()
    }
}

/// As much of a text as fits a line.
fn shortened(text: &str) -> String {
    const CHARS: usize = 40;
    let text = text.trim();
    if text.chars().count() <= CHARS { text.to_owned() } else { text.chars().take(CHARS).collect::<String>() + "…" }
}

/// Reads the planes of a cube; `path` is its header or its file of samples, with the other one beside it.
///
/// `code_max` is the sensor's largest code.
pub fn read_cube(path: &Path, planes: &[CubePlane], size_px: Option<[usize; 2]>, code_max: u16) -> Result<Frame> {
    let (header_path, data_path) = pair_of(path)?;
    let text = input::read_text(&header_path)?;
    let mut data =
        std::fs::File::open(&data_path).with_context(|| format!("{}: there is no such file", data_path.display()))?;
    let bytes = data.metadata().with_context(|| data_path.display().to_string())?.len();
    decode_cube(&text, bytes, &mut data, planes, size_px, code_max).with_context(|| header_path.display().to_string())
}

/// [`read_cube`] from a header's text and `bytes` of data.
pub fn decode_cube(
    header: &str,
    bytes: u64,
    data: &mut (impl Read + Seek),
    planes: &[CubePlane],
    size_px: Option<[usize; 2]>,
    code_max: u16,
) -> Result<Frame> {
    if header.len() > HEADER_BYTES_MAX {
        bail!("the header is larger than {} MiB", HEADER_BYTES_MAX >> 20);
    }
    let header = Header::parse(header)?;
    check_size([header.columns, header.rows], size_px)?;
    let code_max = if header.samples == Samples::U8 { code_max.min(255) } else { code_max };
    let pages = header.read(planes, bytes, data)?;
    Ok(Frame::new(header.columns, header.rows, code_max, pages)?)
}

/// The header and the file of samples that belong together.
fn pair_of(path: &Path) -> Result<(PathBuf, PathBuf)> {
    if is_header(path) {
        let beside = DATA_EXTENSIONS.map(|extension| path.with_extension(extension));
        let found = beside.iter().find(|data| data.is_file());
        let data = found.with_context(|| {
            let names = DATA_EXTENSIONS[..DATA_EXTENSIONS.len() - 1].join(", .");
            format!("{}: there is no file of samples beside it (.{names} or no extension)", path.display())
        })?;
        return Ok((path.to_owned(), data.clone()));
    }
    // Both ways of naming a header are common: cube.hdr and cube.raw.hdr.
    let mut appended = path.as_os_str().to_owned();
    appended.push(".hdr");
    let beside = [path.with_extension("hdr"), PathBuf::from(appended)];
    let header = beside.iter().find(|header| header.is_file());
    let header = header.with_context(|| format!("{}: there is no ENVI header beside it (.hdr)", path.display()))?;
    Ok((header.clone(), path.to_owned()))
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

fn is_header(path: &Path) -> bool {
    extension(path) == "hdr"
}

/// Where a cube is written and how its samples are ordered, by the extension of `path`: `.hdr`, `.raw`, `.dat`, `.img`
/// and `.bsq` plane after plane, `.bil` and `.bip` as they say.
pub fn cube_paths(path: &Path) -> Result<(PathBuf, PathBuf, Interleave)> {
    let interleave = match extension(path).as_str() {
        "hdr" | "raw" | "dat" | "img" | "bsq" => Interleave::Bsq,
        "bil" => Interleave::Bil,
        "bip" => Interleave::Bip,
        _ => bail!("{}: a cube is written as .hdr, .raw, .dat, .img, .bsq, .bil or .bip", path.display()),
    };
    let data = if is_header(path) { path.with_extension("raw") } else { path.to_owned() };
    Ok((path.with_extension("hdr"), data, interleave))
}

/// The planes of a cube that is written: their numbers or wavelengths, all of one kind.
fn places(planes: &[CubePlane]) -> Result<(usize, Vec<usize>, Vec<f64>)> {
    let indices: Vec<usize> = planes
        .iter()
        .filter_map(|plane| if let CubePlane::Index(index) = plane { Some(*index) } else { None })
        .collect();
    let wavelengths_nm: Vec<f64> = planes
        .iter()
        .filter_map(|plane| if let CubePlane::Wavelength(nm) = plane { Some(*nm) } else { None })
        .collect();
    match (indices.is_empty(), wavelengths_nm.is_empty()) {
        (_, true) => Ok((indices.iter().max().map_or(0, |last| last + 1), indices, wavelengths_nm)),
        (true, _) => Ok((planes.len(), (0..planes.len()).collect(), wavelengths_nm)),
        _ => bail!("a cube is written by the numbers of its planes or by their wavelengths, not by both"),
    }
}

/// Header and data of the cube that carries a frame. Planes between numbered ones are dark.
pub fn encode_cube(frame: &Frame, planes: &[CubePlane], interleave: Interleave) -> Result<(Vec<u8>, Vec<u8>)> {
    const PLANES_MAX: usize = 4096;
    let (count, places, wavelengths_nm) = places(planes)?;
    if count > PLANES_MAX {
        bail!("a cube of {count} planes is not written; legal: up to {PLANES_MAX}");
    }
    let (columns, rows) = (frame.width_px(), frame.height_px());
    let is_small = frame.code_max() <= 255;
    let dark = vec![0; columns];
    let line = |plane: usize, row: usize| match places.iter().position(|place| *place == plane) {
        Some(page) => &frame.pages()[page][row * columns..][..columns],
        None => dark.as_slice(),
    };
    let mut data = Vec::with_capacity(columns * rows * count * if is_small { 1 } else { 2 });
    let mut push = |code: u16| match is_small {
        true => data.push(code as u8),
        false => data.extend(code.to_le_bytes()),
    };
    match interleave {
        Interleave::Bsq => {
            (0..count).for_each(|plane| (0..rows).for_each(|row| line(plane, row).iter().for_each(|c| push(*c))));
        }
        Interleave::Bil => {
            (0..rows).for_each(|row| (0..count).for_each(|plane| line(plane, row).iter().for_each(|c| push(*c))));
        }
        Interleave::Bip => {
            for row in 0..rows {
                let lines: Vec<&[u16]> = (0..count).map(|plane| line(plane, row)).collect();
                (0..columns).for_each(|column| lines.iter().for_each(|line| push(line[column])));
            }
        }
    }
    let mut header = format!(
        "ENVI\ndescription = {{twinpupil}}\nsamples = {columns}\nlines = {rows}\nbands = {count}\nheader offset = 0\n\
         file type = ENVI Standard\ndata type = {}\ninterleave = {}\nbyte order = 0\n",
        if is_small { 1 } else { 12 },
        interleave.name(),
    );
    if !wavelengths_nm.is_empty() {
        let list = wavelengths_nm.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
        header += &format!("wavelength units = Nanometers\nwavelength = {{{list}}}\n");
    }
    Ok((header.into_bytes(), data))
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    const PLANES: [CubePlane; 2] = [CubePlane::Wavelength(680.0), CubePlane::Wavelength(450.0)];

    fn frame(code_max: u16) -> Frame {
        let codes =
            |page: usize| (0..7 * 5).map(|i| ((i * 31 + page * 97) % (usize::from(code_max) + 1)) as u16).collect();
        Frame::new(7, 5, code_max, (0..2).map(codes).collect()).expect("a legal frame")
    }

    fn decode(header: &str, data: &[u8], planes: &[CubePlane]) -> Result<Frame> {
        decode_cube(header, data.len() as u64, &mut Cursor::new(data), planes, None, 4095)
    }

    fn refusal(header: &str, data: &[u8], planes: &[CubePlane]) -> String {
        format!("{:#}", decode(header, data, planes).expect_err("must be refused"))
    }

    #[test]
    fn what_is_written_is_read_back() {
        for interleave in Interleave::ALL {
            for code_max in [255, 4095] {
                for planes in [PLANES.to_vec(), vec![CubePlane::Index(3), CubePlane::Index(1)]] {
                    let (header, data) = encode_cube(&frame(code_max), &planes, interleave).expect("encodes");
                    let header = String::from_utf8(header).unwrap();
                    assert_eq!(decode(&header, &data, &planes).expect("reads back"), frame(code_max), "{header}");
                }
            }
        }
    }

    /// A cube of 2 × 1 pixels and 3 planes, by hand.
    fn by_hand(interleave: &str, order: u8) -> String {
        format!(
            "ENVI\r\n; a comment\nsamples = 2\nlines = 1\nBands  = 3\nheader offset = 4\ndata type = 12\n\
             interleave = {interleave}\nbyte order = {order}\nwavelength units = Micrometers\n\
             wavelength = {{\n 0.45,\n 0.55, 0.68 }}\nmap info = {{UTM, 1}}\n"
        )
    }

    #[test]
    fn the_three_orders_are_those_of_the_format() {
        // Planes 1 2, 3 4 and 5 6.
        for (interleave, codes) in
            [("bsq", [1, 2, 3, 4, 5, 6]), ("bil", [1, 2, 3, 4, 5, 6]), ("BIP", [1, 3, 5, 2, 4, 6])]
        {
            for order in [0, 1] {
                let bytes = codes.map(|code: u16| if order == 0 { code.to_le_bytes() } else { code.to_be_bytes() });
                let data = [&[9; 4], bytes.as_flattened()].concat();
                let planes = [CubePlane::Wavelength(700.0), CubePlane::Index(0)];
                let frame = decode(&by_hand(interleave, order), &data, &planes).expect("reads");
                assert_eq!(frame.pages(), [vec![5, 6], vec![1, 2]], "{interleave} {order}");
            }
        }
    }

    #[test]
    fn every_fault_is_named() {
        let header = by_hand("bsq", 0);
        let data = [0; 16];
        let cases = [
            ("ENVI", "ENVY", "not an ENVI header"),
            ("samples = 2", "samples = 0", "`samples` is 0; legal: 1 to 16777216"),
            ("samples = 2", "samples = -2", "`samples` is -2; legal: a whole number"),
            ("samples = 2\n", "", "`samples` is missing"),
            ("samples = 2", "samples = 16777216", "the data has 16 bytes; legal: 100663300"),
            ("lines = 1", "lines = 2", "the data has 16 bytes; legal: 28, as the header says"),
            ("data type = 12", "data type = 4", "`data type` is 4; legal: 1, 2 or 12"),
            ("interleave = bsq", "interleave = xyz", "`interleave` is xyz; legal: bsq, bil or bip"),
            ("byte order = 0", "byte order = 2", "`byte order` is 2; legal: 0 or 1"),
            ("header offset = 4", "header offset = 18446744073709551615", "more samples than a file can hold"),
            ("0.45,", "", "`wavelength` has 2 values; legal: 3"),
            ("0.45,", "red,", "`wavelength` has the value red; legal: numbers above 0"),
            ("Micrometers", "Furlongs", "`wavelength units` is furlongs"),
            ("lines = 1", "lines 1", "line 4: `lines 1` is not `key = value`"),
            ("lines = 1", "lines = 1\nlines = 1", "`lines` is stated twice"),
            ("map info", "file compression = 1\nmap info", "`file compression` is 1; legal: 0"),
        ];
        for (from, to, expected) in cases {
            assert!(header.contains(from), "{from}");
            let message = refusal(&header.replacen(from, to, 1), &data, &PLANES);
            assert!(message.contains(expected), "{message:?} lacks {expected:?}");
        }
        assert!(refusal(&format!("{header}x = {{\n"), &data, &PLANES).contains("{ without }"));
        let twice = [CubePlane::Wavelength(600.0), CubePlane::Wavelength(560.0)];
        assert!(refusal(&header, &data, &twice).contains("as another band's is"));
        assert!(refusal(&header, &data, &[CubePlane::Index(3)]).contains("legal: 0 to 2"));
        let signed = header.replace("data type = 12", "data type = 2");
        assert!(refusal(&signed, &[0xff; 16], &PLANES).contains("a sample is -1; legal: 0 to 32767"));
        assert!(refusal(&header, &[0xff; 16], &PLANES).contains("above the sensor's largest code 4095"));
        let far = [CubePlane::Wavelength(900.0)];
        assert!(refusal(&header, &data, &far).contains("plane `900 nm` is asked for; the nearest is 680 nm"));
        let bare = header.replace("wavelength = ", "other = ");
        assert!(refusal(&bare, &data, &PLANES).contains("the header has no `wavelength`"));
    }

    #[test]
    fn damaged_headers_never_panic() {
        let header = by_hand("bil", 0);
        for length in 0..header.len() {
            let _ = decode(&header[..length], &[0; 16], &PLANES);
        }
        for position in 0..header.len() {
            for byte in [b'9', b'{', b'}', b'=', b'\n', b'-'] {
                let mut damaged = header.clone().into_bytes();
                damaged[position] = byte;
                let _ = decode(&String::from_utf8(damaged).unwrap(), &[0; 16], &PLANES);
            }
        }
    }
}
