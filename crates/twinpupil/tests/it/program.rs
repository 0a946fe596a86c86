//! The program in a folder of its own.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;
use twinpupil_instrument::paper;

/// A temporary folder that commands run in.
pub(crate) struct Workplace {
    folder: TempDir,
}

impl Workplace {
    /// A folder with `small.toml`, the paper's instrument with a sensor of 64 × 48 pixels.
    pub(crate) fn new() -> Self {
        let workplace = Self { folder: tempfile::tempdir().unwrap() };
        workplace.write("small.toml", small_instrument());
        workplace
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), content).unwrap();
    }

    pub(crate) fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    /// Names of all files, hidden ones too.
    pub(crate) fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder.path()).unwrap();
        let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// Runs the program with words separated by spaces.
    pub(crate) fn run(&self, arguments: &str) -> Output {
        self.command(arguments).output().unwrap()
    }

    pub(crate) fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(Path::new(env!("CARGO_BIN_EXE_twinpupil")));
        command.current_dir(self.folder.path()).args(arguments.split_whitespace());
        command
    }

    /// Runs a command that must succeed and returns its standard output.
    pub(crate) fn succeed(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }

    /// Runs a command that must fail with exit code 1, one line on standard error, nothing on standard output and no
    /// new file; returns the line.
    pub(crate) fn fail(&self, arguments: &str) -> String {
        let before = self.names();
        let output = self.run(arguments);
        let line = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{arguments}: {line}");
        assert!(output.stdout.is_empty(), "{arguments}: {}", String::from_utf8_lossy(&output.stdout));
        assert_eq!(line.lines().count(), 1, "{arguments}: {line}");
        assert_eq!(self.names(), before, "{arguments} left files behind");
        let reason = line.trim_end().strip_prefix("twinpupil: ");
        reason.unwrap_or_else(|| panic!("{arguments}: {line}")).to_owned()
    }
}

pub(crate) fn small_instrument() -> String {
    paper::INSTRUMENT_TOML
        .replace("size_px = [1920, 1200]", "size_px = [64, 48]")
        .replace("axis_px = [959.5, 599.5]", "axis_px = [31.5, 23.5]")
}
