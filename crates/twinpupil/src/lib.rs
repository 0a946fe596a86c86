//! The program: the one place of the workspace that reads and writes files.
//!
//! [`cli`] holds the command line, [`commands`] one module for each subcommand, [`io`] the files; [`drawing`], [`plot`], [`plot_sheet`], [`heat_map`],
//! [`picture`], [`vector_map`], [`printout`] and [`report`] make what a human looks at.

pub mod cli;
pub mod commands;
pub mod console;
pub mod design;
pub mod drawing;
pub mod experiments;
pub mod flow;
pub mod heat_map;
pub mod io;
pub mod load;
pub mod picture;
pub mod plot;
pub mod plot_sheet;
pub mod precision;
pub mod printout;
pub mod reason;
pub mod report;
pub mod round;
pub mod text_table;
pub mod vector_map;
