//! Output that is either whole or not there.

use std::fs::OpenOptions;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use tempfile::NamedTempFile;

/// Files of one command, written all or none.
///
/// Every file is encoded before the first is touched, written beside its target and renamed onto it.
#[derive(Debug, Default)]
pub struct Outputs {
    files: Vec<(PathBuf, Vec<u8>)>,
    stdout: Vec<u8>,
}

impl Outputs {
    /// No files yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a file.
    pub fn add(&mut self, path: &Path, bytes: Vec<u8>) {
        self.files.push((path.to_owned(), bytes));
    }

    /// Adds a file, or text on standard output where there is no path.
    pub fn add_or_print(&mut self, path: Option<&Path>, bytes: Vec<u8>) {
        match path {
            Some(path) => self.add(path, bytes),
            None => self.stdout.extend(bytes),
        }
    }

    /// Writes every file, then standard output. Two outputs to one file are refused.
    pub fn commit(self) -> Result<()> {
        let mut staged = self
            .files
            .iter()
            .map(|(path, bytes)| stage(path, bytes).with_context(|| path.display().to_string()))
            .collect::<Result<Vec<_>>>()?;
        for (index, one) in staged.iter().enumerate() {
            if one.is_file() && staged[..index].iter().any(|earlier| earlier.path() == one.path()) {
                bail!("{}: two outputs cannot go to one file", one.path().display());
            }
        }
        // What cannot be taken back and may fail goes first; renaming hardly ever fails.
        staged.sort_by_key(Staged::is_file);
        staged.into_iter().try_for_each(|staged| {
            let path = staged.path().to_owned();
            staged.publish().with_context(|| path.display().to_string())
        })?;
        write_stdout(&self.stdout)
    }
}

/// Writes one file, or standard output where there is no path.
pub fn write(path: Option<&Path>, bytes: Vec<u8>) -> Result<()> {
    let mut outputs = Outputs::new();
    outputs.add_or_print(path, bytes);
    outputs.commit()
}

/// Writes to standard output.
pub fn write_stdout(bytes: &[u8]) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    // Without words around it, so that `main` recognizes a reader who has left.
    stdout.write_all(bytes).and_then(|()| stdout.flush()).map_err(anyhow::Error::from)
}

/// Refuses a path that cannot be written, before any work is done.
pub fn check(path: &Path) -> Result<()> {
    check_target(path).with_context(|| path.display().to_string())
}

fn check_target(path: &Path) -> Result<()> {
    if path.is_dir() {
        bail!("this is a folder, not a file");
    }
    let folder = folder_of(path);
    if folder.is_dir() {
        return Ok(());
    }
    let what = if folder.exists() { "is not a folder" } else { "does not exist" };
    bail!("the folder {} {what}", folder.display())
}

/// The path of a file that is not there yet, whichever way it was written.
fn absolute(path: &Path) -> PathBuf {
    match (std::fs::canonicalize(folder_of(path)), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path.to_owned(),
    }
}

enum Staged {
    /// Complete, under another name in the same folder.
    Temporary(NamedTempFile, PathBuf),
    /// A device or a pipe, which no rename may replace.
    Stream(PathBuf, Vec<u8>),
}

impl Staged {
    fn path(&self) -> &Path {
        match self {
            Self::Temporary(_, path) | Self::Stream(path, _) => path,
        }
    }

    fn is_file(&self) -> bool {
        matches!(self, Self::Temporary(..))
    }

    fn publish(self) -> Result<()> {
        match self {
            Self::Temporary(file, path) => {
                file.persist(path).map_err(|error| error.error).context("cannot be written")?;
            }
            Self::Stream(path, bytes) => {
                let mut stream = OpenOptions::new().write(true).open(path).context("cannot be opened")?;
                stream.write_all(&bytes)?;
            }
        }
        Ok(())
    }
}

fn stage(path: &Path, bytes: &[u8]) -> Result<Staged> {
    check_target(path)?;
    // A link is followed, so that the file it points to is replaced and not the link.
    let path = std::fs::canonicalize(path).unwrap_or_else(|_| absolute(path));
    if path.exists() && !path.is_file() {
        return Ok(Staged::Stream(path, bytes.to_owned()));
    }
    let mut file = temporary_in(folder_of(&path)).map_err(|error| match error.kind() {
        ErrorKind::PermissionDenied => anyhow::anyhow!("no permission to write into this folder"),
        _ => anyhow::Error::from(error).context("cannot be written"),
    })?;
    file.write_all(bytes).context("cannot be written")?;
    Ok(Staged::Temporary(file, path))
}

fn temporary_in(folder: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".twinpupil-");
    #[cfg(unix)]
    {
        // The permissions of any new file; the user's mask takes its part away.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn all_files_are_written_or_none() {
        let folder = tempfile::tempdir().unwrap();
        let (good, bad) = (folder.path().join("a.csv"), folder.path().join("missing/b.csv"));
        let mut outputs = Outputs::new();
        outputs.add(&good, b"1".to_vec());
        outputs.add(&bad, b"2".to_vec());
        let error = format!("{:#}", outputs.commit().unwrap_err());
        assert!(error.contains("missing/b.csv: the folder") && error.ends_with("does not exist"), "{error}");
        assert!(names(folder.path()).is_empty());

        write(Some(&good), b"old".to_vec()).unwrap();
        write(Some(&good), b"new".to_vec()).unwrap();
        assert_eq!(names(folder.path()), ["a.csv"]);
        assert_eq!(std::fs::read(good).unwrap(), b"new");
    }

    #[test]
    fn a_folder_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        assert!(write(Some(folder.path()), vec![]).is_err());
        assert!(check(folder.path()).is_err());
        assert!(check(&folder.path().join("x")).is_ok());
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_written_to_and_a_link_is_followed() {
        write(Some(Path::new("/dev/null")), b"gone".to_vec()).unwrap();
        assert!(!Path::new("/dev/null").is_file());

        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        std::fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write(Some(&link), b"new".to_vec()).unwrap();
        assert_eq!(std::fs::read(file).unwrap(), b"new");
        assert!(link.is_symlink());
    }
}
