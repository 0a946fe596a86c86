//! Runs the built program: what it writes, what it refuses and how it says so.

mod bad_input;
mod commands;
mod program;
