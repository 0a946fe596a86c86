//! Whole files into memory.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::Path;

use anyhow::{Context, Result, bail};

/// Larger files are refused: no frame, table or instrument comes near, and reading one would only fill the memory.
const BYTES_MAX: u64 = 2 << 30;
const TOO_LARGE: &str = "the file is larger than 2 GiB";

/// The bytes of a file, or of standard input for `-`.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    read(path).with_context(|| path.display().to_string())
}

/// The text of a UTF-8 file without its byte order mark, or of standard input for `-`.
pub fn read_text(path: &Path) -> Result<String> {
    text(read_bytes(path)?).with_context(|| path.display().to_string())
}

/// UTF-8 text without its byte order mark.
pub(super) fn text(bytes: Vec<u8>) -> Result<String> {
    let text = String::from_utf8(bytes).ok().context("not UTF-8 text")?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

fn read(path: &Path) -> Result<Vec<u8>> {
    if path == Path::new("-") {
        return take(std::io::stdin().lock());
    }
    // Opening a folder succeeds on some systems and fails with different words on others.
    if path.is_dir() {
        bail!("this is a folder, not a file");
    }
    match File::open(path) {
        // What its size refuses need not be read; where a pipe has none, reading tells.
        Ok(file) if file.metadata().is_ok_and(|metadata| metadata.len() > BYTES_MAX) => bail!(TOO_LARGE),
        Ok(file) => take(file),
        Err(error) if error.kind() == ErrorKind::NotFound => bail!("there is no such file"),
        Err(error) if error.kind() == ErrorKind::PermissionDenied => bail!("no permission to read this file"),
        Err(error) => Err(error).context("cannot be opened"),
    }
}

fn take(source: impl Read) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    source.take(BYTES_MAX + 1).read_to_end(&mut bytes).context("cannot be read")?;
    if bytes.is_empty() {
        bail!("the file is empty");
    }
    if bytes.len() as u64 > BYTES_MAX {
        bail!(TOO_LARGE);
    }
    Ok(bytes)
}
