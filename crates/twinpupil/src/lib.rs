//! The program: the one place of the workspace that reads and writes files.
//!
//! [`cli`] holds the command line, [`commands`] one module for each subcommand, [`io`] the files; [`plot`], [`picture`]
//! and [`report`] make what a human looks at.

pub mod io;
