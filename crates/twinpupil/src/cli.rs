//! The command line: arguments, exit codes and the one line that tells what went wrong.

use std::io::{ErrorKind, Write};
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::{Parser, Subcommand};

use crate::commands::{
    analyze, calibrate, crosstalk, demo, design, detect, fit, instrument, optics, reconstruct, reproduce, scene,
    simulate, target,
};
use crate::console::Console;
use crate::reason::one_line;

/// Depth from one exposure: simulates, reads and designs cameras with two coaxial colour apertures.
///
/// Data goes to standard output or to -o FILE, progress and summaries to standard error.
/// Exit code 0: done; 1: failed, for the reason that is printed; 2: wrong usage.
#[derive(Debug, Parser)]
#[command(name = "twinpupil", version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Threads to compute on; one for each core if left out
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
    /// No progress and no summary on standard error
    #[arg(long, short, global = true)]
    quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Print or explain an instrument file
    #[command(subcommand)]
    Instrument(instrument::Command),
    /// Print a scene file
    #[command(subcommand)]
    Scene(scene::Command),
    /// Draw a target to calibrate with, or explain its file
    #[command(subcommand)]
    Target(target::Command),
    /// Turn an instrument and a scene into the frame that the camera would deliver
    Simulate(simulate::Args),
    /// Find the features of each band
    Detect(detect::Args),
    /// Turn frames into points in space
    Reconstruct(reconstruct::Args),
    /// Fit a line or a plane through points
    #[command(subcommand)]
    Fit(fit::Command),
    /// Determine an instrument's numbers from frames of a dot grid
    Calibrate(calibrate::Args),
    /// Tell what a design is worth
    #[command(subcommand)]
    Analyze(analyze::Command),
    /// Make a camera of a lens: where the masks and the sensor go, how wide the pupils are, what it can do
    Design(design::Args),
    /// Tell what a lens does that is given surface by surface
    #[command(subcommand)]
    Optics(optics::Command),
    /// Measure crosstalk on flat frames and write it into an instrument file
    Crosstalk(crosstalk::Args),
    /// Repeat the experiments of the paper and set the results beside the published ones
    Reproduce(reproduce::Args),
    /// Simulate the paper's plate, reconstruct it and show what comes out, within seconds
    Demo(demo::Args),
}

/// Reads the arguments of the process, does what they say and returns its exit code.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        // Help and version are printed to standard output with code 0, wrong usage to standard error with code 2.
        Err(error) => {
            let _ = error.print();
            return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2));
        }
    };
    match run(&cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if reader_has_left(&error) => ExitCode::SUCCESS,
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "twinpupil: {}", one_line(&error));
            ExitCode::FAILURE
        }
    }
}

fn run(cli: &Cli) -> Result<()> {
    if let Some(threads) = cli.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global().context("cannot start threads")?;
    }
    let console = Console::new(cli.quiet);
    match &cli.command {
        Command::Instrument(command) => instrument::run(command, &console),
        Command::Scene(command) => scene::run(command),
        Command::Target(command) => target::run(command, &console),
        Command::Simulate(args) => simulate::run(args, &console),
        Command::Detect(args) => detect::run(args, &console),
        Command::Reconstruct(args) => reconstruct::run(args, &console),
        Command::Fit(command) => fit::run(command),
        Command::Calibrate(args) => calibrate::run(args, &console),
        Command::Analyze(command) => analyze::run(command, &console),
        Command::Design(args) => design::run(args, &console),
        Command::Optics(command) => optics::run(command, &console),
        Command::Crosstalk(args) => crosstalk::run(args, &console),
        Command::Reproduce(args) => reproduce::run(args, &console),
        Command::Demo(args) => demo::run(args, &console),
    }
}

/// Whether standard output was closed early, as `| head` does: the reader has what it wanted.
fn reader_has_left(error: &anyhow::Error) -> bool {
    error.downcast_ref::<std::io::Error>().is_some_and(|error| error.kind() == ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
