//! A folder of output that is either whole or not touched.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use super::output::Outputs;

/// The files of one command in one folder, written all or none; files of an earlier run are replaced, others stay.
#[derive(Debug)]
pub struct FolderOutputs {
    folder: PathBuf,
    files: Vec<(&'static str, Vec<u8>)>,
}

impl FolderOutputs {
    /// No files yet. Refuses a path at which there can be no folder, before any work is done.
    pub fn new(folder: &Path) -> Result<Self> {
        check(folder).with_context(|| folder.display().to_string())?;
        Ok(Self { folder: folder.to_owned(), files: Vec::new() })
    }

    /// Adds a file.
    pub fn add(&mut self, name: &'static str, bytes: Vec<u8>) {
        self.files.push((name, bytes));
    }

    /// Where a file will be.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Names of the files added so far.
    pub fn names(&self) -> Vec<&'static str> {
        self.files.iter().map(|(name, _)| *name).collect()
    }

    /// Writes every file. A folder that was not there before is taken away again if that fails.
    pub fn commit(self) -> Result<()> {
        let is_new = !self.folder.exists();
        if is_new {
            std::fs::create_dir(&self.folder).with_context(|| self.folder.display().to_string())?;
        }
        let mut outputs = Outputs::new();
        for (name, bytes) in self.files {
            outputs.add(&self.folder.join(name), bytes);
        }
        let written = outputs.commit();
        if written.is_err() && is_new {
            // Only an empty folder goes, and the first error is the one to tell.
            let _ = std::fs::remove_dir(&self.folder);
        }
        written
    }
}

fn check(folder: &Path) -> Result<()> {
    if folder.as_os_str().is_empty() {
        bail!("a folder needs a name");
    }
    if folder.is_dir() {
        return Ok(());
    }
    if folder.exists() {
        bail!("this is a file, not a folder");
    }
    match folder.parent() {
        Some(parent) if parent == Path::new("") || parent.is_dir() => Ok(()),
        Some(parent) => bail!("the folder {} does not exist", parent.display()),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_made_filled_and_filled_again() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        for text in ["old", "new"] {
            let mut outputs = FolderOutputs::new(&folder).unwrap();
            outputs.add("a.txt", text.into());
            outputs.commit().unwrap();
            assert_eq!(std::fs::read_to_string(folder.join("a.txt")).unwrap(), text);
        }
    }

    #[test]
    fn files_and_missing_parents_are_refused_and_failure_leaves_nothing() {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("file");
        std::fs::write(&file, "").unwrap();
        assert!(format!("{:#}", FolderOutputs::new(&file).unwrap_err()).ends_with("this is a file, not a folder"));
        assert!(FolderOutputs::new(&place.path().join("none/out")).is_err());
        assert!(FolderOutputs::new(Path::new("")).is_err());

        let folder = place.path().join("out");
        let mut outputs = FolderOutputs::new(&folder).unwrap();
        outputs.add("a.txt", vec![1]);
        outputs.add("missing/b.txt", vec![2]);
        assert!(outputs.commit().is_err());
        assert!(!folder.exists());
    }
}
