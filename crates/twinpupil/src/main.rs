//! The program `twinpupil`; everything it does lies in the library of the same name.

use std::process::ExitCode;

fn main() -> ExitCode {
    twinpupil::cli::main()
}
