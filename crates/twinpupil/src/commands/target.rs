//! `twinpupil target`: print what cameras are calibrated with, and the file that tells of it.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::Subcommand;
use twinpupil_calibrate::{Fiducial, Target, TargetKind, TargetSpec};

use super::destination::{Destination, pretty};
use crate::console::Console;
use crate::io::input;
use crate::io::output::Outputs;
use crate::printout::{Format, Ink, Printout};

/// `twinpupil target …`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Draw a grid of dots to print, true to scale, and write its target file
    DotGrid(DotGrid),
    /// Check a target file and print it back
    Print {
        /// Target file
        file: PathBuf,
        /// Where it goes.
        #[command(flatten)]
        to: Destination,
    },
    /// Print the JSON schema of target files
    Schema(Destination),
}

/// `twinpupil target dot-grid …`.
#[derive(Debug, clap::Args)]
pub struct DotGrid {
    /// Number of rows
    #[arg(long, value_name = "N")]
    rows: usize,
    /// Number of columns
    #[arg(long, value_name = "N")]
    columns: usize,
    /// Distance between neighbouring centres, mm
    #[arg(long, value_name = "MM")]
    pitch_mm: f64,
    /// Diameter of the dots, mm
    #[arg(long, value_name = "MM")]
    dot_diameter_mm: f64,
    /// A place without a dot, which tells which way round the target is; both from 0, may be repeated
    #[arg(long, value_name = "ROW,COLUMN", value_parser = missing)]
    missing: Vec<Fiducial>,
    /// A place with a larger dot, which tells the same; may be repeated
    #[arg(long, value_name = "ROW,COLUMN,DIAMETER_MM", value_parser = larger)]
    larger: Vec<Fiducial>,
    /// What the target is called; its size if left out
    #[arg(long, value_name = "TEXT")]
    name: Option<String>,
    /// Black dots on white, as if neither is said
    #[arg(long, conflicts_with = "light_on_dark")]
    dark_on_light: bool,
    /// White dots on black
    #[arg(long)]
    light_on_dark: bool,
    /// Blank width about the dots, mm; 10 or two pitches, the larger, if left out
    #[arg(long, value_name = "MM")]
    margin_mm: Option<f64>,
    /// Target file to write
    #[arg(long, value_name = "FILE")]
    file: Option<PathBuf>,
    /// Drawing to write, .svg or .pdf; SVG on standard output if left out
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs `twinpupil target`.
pub fn run(command: &Command, console: &Console) -> Result<()> {
    match command {
        Command::DotGrid(args) => dot_grid(args, console),
        Command::Print { file, to } => {
            let target = Target::from_toml(&input::read_text(file)?).with_context(|| file.display().to_string())?;
            to.write(target.to_toml())
        }
        Command::Schema(to) => to.write(pretty(Target::json_schema().as_value())?),
    }
}

fn dot_grid(args: &DotGrid, console: &Console) -> Result<()> {
    const MARGIN_MM_MAX: f64 = 1e4;
    let format = args.output.as_deref().map_or(Ok(Format::Svg), Format::of)?;
    let target = Target::new(args.spec())?;
    if let Some(margin_mm) = args.margin_mm.filter(|margin_mm| !(0.0..=MARGIN_MM_MAX).contains(margin_mm)) {
        bail!("--margin-mm is {margin_mm}; legal: 0 to {MARGIN_MM_MAX}");
    }
    let ink = if args.light_on_dark { Ink::LightOnDark } else { Ink::DarkOnLight };
    let printout = Printout::new(&target, ink, args.margin_mm);
    let mut outputs = Outputs::new();
    outputs.add_or_print(args.output.as_deref(), printout.encode(format)?);
    if let Some(file) = &args.file {
        outputs.add(file, target.to_toml().into_bytes());
    }
    outputs.commit()?;
    if let Some(path) = &args.output {
        let ([width_mm, height_mm], dots) = (printout.size_mm(), printout.dots());
        console.note(format!("{}: {width_mm:.1} × {height_mm:.1} mm, {dots} dots", path.display()));
    }
    Ok(())
}

impl DotGrid {
    fn spec(&self) -> TargetSpec {
        let Self { rows, columns, pitch_mm, dot_diameter_mm, .. } = *self;
        TargetSpec {
            schema: 1,
            name: self.name.clone().unwrap_or_else(|| format!("{columns} x {rows} dots, {pitch_mm} mm apart")),
            kind: TargetKind::DotGrid,
            rows,
            columns,
            pitch_mm,
            dot_diameter_mm,
            fiducials: self.missing.iter().chain(&self.larger).copied().collect(),
        }
    }
}

fn missing(text: &str) -> Result<Fiducial, String> {
    match text.split(',').map(str::trim).collect::<Vec<_>>()[..] {
        [row, column] => fiducial(row, column, None),
        _ => None,
    }
    .ok_or_else(|| "legal: ROW,COLUMN, whole numbers from 0".to_owned())
}

fn larger(text: &str) -> Result<Fiducial, String> {
    match text.split(',').map(str::trim).collect::<Vec<_>>()[..] {
        [row, column, diameter_mm] => diameter_mm.parse().ok().and_then(|mm| fiducial(row, column, Some(mm))),
        _ => None,
    }
    .ok_or_else(|| "legal: ROW,COLUMN,DIAMETER_MM, the first two whole numbers from 0".to_owned())
}

fn fiducial(row: &str, column: &str, diameter_mm: Option<f64>) -> Option<Fiducial> {
    Some(Fiducial { row: row.parse().ok()?, column: column.parse().ok()?, diameter_mm })
}
