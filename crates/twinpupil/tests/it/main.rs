//! Runs the built program: what it writes, what it refuses and how it says so.
#![cfg(test)]

mod axis;
mod bad_input;
mod carriers;
mod commands;
mod design;
mod experiments;
mod golden;
mod program;
mod real_lens;
mod tolerance;
