//! What a stage says of the frames: CSV with `frame`, `travel_mm` and `std_mm`.

use std::path::Path;

use anyhow::{Context, Result, bail};
use twinpupil_calibrate::StagePosition;

use super::files::FrameFiles;
use super::read_table::ReadTable;

/// Where the stage stood at every frame; `None` for those that the file does not name.
pub fn read_stage(path: &Path, frames: &[FrameFiles]) -> Result<Vec<Option<StagePosition>>> {
    positions(&ReadTable::read(path)?, frames).with_context(|| path.display().to_string())
}

fn positions(table: &ReadTable, frames: &[FrameFiles]) -> Result<Vec<Option<StagePosition>>> {
    let (names, travels_mm, stds_mm) = (table.labels("frame")?, table.finite("travel_mm")?, table.finite("std_mm")?);
    let mut positions = vec![None; frames.len()];
    for ((name, travel_mm), std_mm) in names.iter().zip(travels_mm).zip(stds_mm) {
        if std_mm <= 0.0 {
            bail!("frame `{}`: std_mm is {std_mm}; legal: above 0", printable(name));
        }
        let is_named = |frame: &FrameFiles| frame.name == *name || file_name(&frame.name) == Some(name.as_str());
        let mut own = frames.iter().enumerate().filter(|(_, frame)| is_named(frame)).map(|(index, _)| index);
        match (own.next(), own.next()) {
            (Some(index), None) if positions[index].is_none() => {
                positions[index] = Some(StagePosition { travel_mm, std_mm });
            }
            (Some(_), None) => bail!("frame `{}` appears twice", printable(name)),
            (None, _) => bail!("frame `{}` is none of those to calibrate from", printable(name)),
            (Some(_), Some(_)) => {
                bail!("frame `{}` is the name of several; legal: their paths as they were given", printable(name))
            }
        }
    }
    if positions.iter().flatten().count() < 2 {
        bail!("{} frame has a position; legal: two at least", positions.iter().flatten().count());
    }
    Ok(positions)
}

/// A name as a sentence can hold it, whatever the file holds.
fn printable(name: &str) -> String {
    const CHARACTERS_MAX: usize = 80;
    let mut characters = name.chars().flat_map(char::escape_debug);
    let head: String = characters.by_ref().take(CHARACTERS_MAX).collect();
    if characters.next().is_some() { format!("{head}…") } else { head }
}

fn file_name(name: &str) -> Option<&str> {
    Path::new(name).file_name()?.to_str()
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::io::frame::FrameFormat;

    fn frames() -> Vec<FrameFiles> {
        let format = FrameFormat::of_instrument(&twinpupil_instrument::paper::instrument());
        let paths = ["a/1.png", "a/2.png", "b/2.png"].map(PathBuf::from);
        FrameFiles::of_arguments(&paths, &format).unwrap()
    }

    fn read(text: &str) -> Result<Vec<Option<StagePosition>>> {
        positions(&ReadTable::parse(text)?, &frames())
    }

    #[test]
    fn positions_belong_to_frames_by_name() {
        let found = read("frame,travel_mm,std_mm\n1.png,0,0.002\nb/2.png,12.5,0.003\n").unwrap();
        assert_eq!(found[0], Some(StagePosition { travel_mm: 0.0, std_mm: 0.002 }));
        assert_eq!(found[1], None);
        assert_eq!(found[2], Some(StagePosition { travel_mm: 12.5, std_mm: 0.003 }));
    }

    #[test]
    fn what_is_wrong_is_told() {
        let message = |rows: &str| read(&format!("frame,travel_mm,std_mm\n{rows}")).unwrap_err().to_string();
        assert!(message("3.png,0,1\n").contains("`3.png` is none of those"));
        assert!(message("2.png,0,1\n").contains("the name of several"));
        assert!(message("1.png,0,1\n1.png,1,1\n").contains("appears twice"));
        assert!(message("1.png,0,0\n").contains("legal: above 0"));
        assert!(message("1.png,0,1\n").contains("two at least"));
        let noise = message(&format!("{}\u{7},0,1\n", "x\u{1b}".repeat(500)));
        assert!(noise.len() < 200 && !noise.contains('\u{1b}'), "{noise}");
        assert!(read("frame,travel_mm\n1.png,0\n").unwrap_err().to_string().contains("`std_mm`"));
    }
}
