//! The files that carry one frame: one, or one for each sensor.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use twinpupil_instrument::{Frame, Instrument, Mosaic};

use super::envi;
use super::frame::{FrameFormat, decode_frame, encode_frame};
use super::{input, page};

/// What stands for the name of a band in a path.
const BAND: &str = "{band}";

/// So many frames, in words.
pub fn frames(count: usize) -> String {
    format!("{count} frame{}", if count == 1 { "" } else { "s" })
}

/// The files of one frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameFiles {
    /// What the frame is called in tables and messages.
    pub name: String,
    /// One file, or one for each page.
    paths: Vec<PathBuf>,
}

impl FrameFiles {
    /// The files of every frame that the command line names.
    ///
    /// Each is a frame of its own, unless every band has a sensor of its own: then a path with `{band}` stands for the
    /// files of all bands, and without it they come one after the other.
    pub fn of_arguments(arguments: &[PathBuf], format: &FrameFormat) -> Result<Vec<Self>> {
        let Some(bands) = format.bands_by_file() else {
            let one = |path: &PathBuf| Self { name: path.display().to_string(), paths: vec![path.clone()] };
            return Ok(arguments.iter().map(one).collect());
        };
        let mut frames = Vec::new();
        let mut pending: Vec<PathBuf> = Vec::new();
        for argument in arguments {
            match argument.to_str().filter(|text| text.contains(BAND)) {
                Some(text) if pending.is_empty() => {
                    let paths = bands.iter().map(|band| text.replace(BAND, band).into()).collect();
                    frames.push(Self { name: text.to_owned(), paths });
                }
                Some(text) => bail!("{text}: stands between the files of one frame"),
                None => pending.push(argument.clone()),
            }
            if pending.len() == bands.len() {
                let names: Vec<String> = pending.iter().map(|path| path.display().to_string()).collect();
                frames.push(Self { name: names.join(" + "), paths: std::mem::take(&mut pending) });
            }
        }
        if let Some(last) = pending.last() {
            let (count, bands) = (bands.len(), bands.join(", "));
            bail!(
                "{}: a frame of this instrument has {count} files ({bands}), or one path with {BAND}",
                last.display()
            );
        }
        Ok(frames)
    }

    /// The one frame that a command writes.
    pub fn of_output(arguments: &[PathBuf], instrument: &Instrument) -> Result<Self> {
        let format = FrameFormat::of_instrument(instrument);
        let mut frames = Self::of_arguments(arguments, &format)?;
        match (frames.pop(), frames.last()) {
            (Some(only), None) => Ok(only),
            (Some(second), Some(_)) => bail!("{}: one frame has one output", second.name),
            (None, _) => bail!("a frame needs a file"),
        }
    }

    /// The files.
    pub fn paths(&self) -> &[PathBuf] {
        &self.paths
    }

    /// Reads the frame.
    pub fn read(&self, format: &FrameFormat) -> Result<Frame> {
        match (format.mosaic(), self.paths.as_slice()) {
            (Mosaic::Cube, [path]) => envi::read_cube(path, format.cube(), format.size_px(), format.code_max(16)),
            (_, [path]) => {
                let bytes = input::read_bytes(path)?;
                decode_frame(&bytes, format).with_context(|| path.display().to_string())
            }
            (_, paths) => {
                let pages = paths.iter().map(|path| read_page(path, format)).collect::<Result<Vec<_>>>()?;
                let (first, rest) = (&pages[0], &pages[1..]);
                if let Some(odd) = rest.iter().position(|page| page.code_max() != first.code_max()) {
                    bail!("{}: not as many bits as {}", paths[odd + 1].display(), paths[0].display());
                }
                let codes = pages.iter().flat_map(|page| page.pages().to_vec()).collect();
                Frame::new(first.width_px(), first.height_px(), first.code_max(), codes)
                    .with_context(|| self.name.clone())
            }
        }
    }

    /// Encodes a frame into its files.
    pub fn encode(&self, frame: &Frame, instrument: &Instrument) -> Result<Vec<(PathBuf, Vec<u8>)>> {
        let format = FrameFormat::of_instrument(instrument);
        match (format.mosaic(), self.paths.as_slice()) {
            (Mosaic::Cube, [path]) => {
                let (header_path, data_path, interleave) = envi::cube_paths(path)?;
                let (header, data) = envi::encode_cube(frame, format.cube(), interleave)?;
                Ok(vec![(header_path, header), (data_path, data)])
            }
            (mosaic, [path]) => Ok(vec![(path.clone(), encode_frame(path, frame, mosaic)?)]),
            (_, paths) => {
                let one = |(path, codes): (&PathBuf, &Vec<u16>)| {
                    let page = Frame::new(frame.width_px(), frame.height_px(), frame.code_max(), vec![codes.clone()])?;
                    Ok((path.clone(), encode_frame(path, &page, Mosaic::Mono)?))
                };
                paths.iter().zip(frame.pages()).map(one).collect()
            }
        }
    }
}

/// The page of one sensor.
fn read_page(path: &Path, format: &FrameFormat) -> Result<Frame> {
    let bytes = input::read_bytes(path)?;
    let decoded = page::decode(&bytes, format.size_px()).and_then(|_| decode_frame(&bytes, &format.of_one_sensor()));
    decoded.with_context(|| path.display().to_string())
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::builtin;

    use super::*;

    fn two_sensors() -> Instrument {
        Instrument::from_toml(builtin::toml("two-sensors").unwrap()).unwrap()
    }

    fn names(arguments: &[&str]) -> Result<Vec<String>, String> {
        let arguments: Vec<PathBuf> = arguments.iter().map(PathBuf::from).collect();
        let frames = FrameFiles::of_arguments(&arguments, &FrameFormat::of_instrument(&two_sensors()));
        let frames = frames.map_err(|error| error.to_string())?;
        let files = |frame: &FrameFiles| frame.paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>();
        Ok(frames.iter().map(|frame| files(frame).join(" ")).collect())
    }

    #[test]
    fn files_are_grouped_in_order_or_by_pattern() {
        assert_eq!(names(&["r1", "b1", "r2", "b2"]).unwrap(), ["r1 b1", "r2 b2"]);
        assert_eq!(names(&["a-{band}.png", "b.png", "c.png"]).unwrap(), ["a-red.png a-blue.png", "b.png c.png"]);
        assert!(names(&["r1", "b1", "r2"]).unwrap_err().starts_with("r2: a frame of this instrument has 2 files"));
        assert!(names(&["r1", "x-{band}.png"]).unwrap_err().contains("stands between the files of one frame"));
    }

    #[test]
    fn every_carrier_is_written_and_read_back() {
        let folder = tempfile::tempdir().unwrap();
        for (name, files) in [
            ("paper", vec!["f.png"]),
            ("polarizer", vec!["f.tif"]),
            ("two-sensors", vec!["r.png", "b.tif"]),
            ("hyperspectral", vec!["f.bip"]),
        ] {
            let mut spec = Instrument::from_toml(builtin::toml(name).unwrap()).unwrap().into_spec();
            spec.sensor.size_px = [31, 17];
            let instrument = Instrument::new(spec).unwrap();
            let code = |page: usize, index: usize| ((index * 37 + page * 101) % 4096) as u16;
            let pages = (0..instrument.pages()).map(|page| (0..31 * 17).map(|index| code(page, index)).collect());
            let frame = Frame::new(31, 17, 4095, pages.collect()).unwrap();
            let arguments: Vec<PathBuf> = files.iter().map(|file| folder.path().join(file)).collect();
            let output = FrameFiles::of_output(&arguments, &instrument).unwrap();
            for (path, bytes) in output.encode(&frame, &instrument).unwrap() {
                std::fs::write(path, bytes).unwrap();
            }
            assert_eq!(output.read(&FrameFormat::of_instrument(&instrument)).unwrap(), frame, "{name}");
        }
    }
}
