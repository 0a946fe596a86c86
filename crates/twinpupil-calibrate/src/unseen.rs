//! Rows and columns of the target file that no frame shows, though there would be room on the sensor.

use crate::adjust::Weighing;
use crate::now::Now;
use crate::seen::Seen;
use crate::target::{Target, TargetDot};

/// Dots of a row or column that are in view and not seen, from which on it is no chance.
const DOTS_MIN: usize = 3;

/// How far within the sensor the outline of a dot has to be to be surely seen, px.
const MARGIN_PX: f64 = 5.0;

/// What is wrong with the number of rows or of columns, in sentences.
pub(crate) fn unseen_lines(now: &Now, seen: &[Seen<'_>], target: &Target) -> Vec<String> {
    let spec = target.spec();
    let row: fn(&TargetDot) -> usize = |dot| dot.row;
    let column: fn(&TargetDot) -> usize = |dot| dot.column;
    let lines = [("rows", spec.rows, row), ("columns", spec.columns, column)];
    let wrong = |(key, stated, line): (&str, usize, fn(&TargetDot) -> usize)| {
        let extents: Vec<[usize; 2]> = seen.iter().map(|one| extent(one, target, line)).collect();
        let most = extents.iter().map(|[first, last]| last - first + 1).max()?;
        let has_room = |(place, [first, last]): (usize, &[usize; 2])| {
            let beside = [first.checked_sub(1), Some(last + 1)];
            beside.into_iter().flatten().any(|beside| is_in_view(now, target, place, |dot| line(dot) == beside))
        };
        let is_wrong = most < stated && extents.iter().enumerate().any(has_room);
        is_wrong.then(|| {
            format!(
                "the target file says {key} = {stated}, but no frame shows more than {most}, though the next would be on the \
                 sensor: correct the file, or light the whole target"
            )
        })
    };
    lines.into_iter().filter_map(wrong).collect()
}

/// The first and the last row or column that a frame shows in any band.
fn extent(seen: &Seen<'_>, target: &Target, line: fn(&TargetDot) -> usize) -> [usize; 2] {
    let lines = || (0..seen.sighting.len()).flat_map(|band| seen.dots(band)).map(|(dot, _)| line(&target.dots()[dot]));
    [lines().min().unwrap_or(0), lines().max().unwrap_or(0)]
}

/// Whether some of the target's dots are in view of any band where a frame has the target.
fn is_in_view(now: &Now, target: &Target, place: usize, is_sought: impl Fn(&TargetDot) -> bool) -> bool {
    let problem = now.problem(&[], &[], Weighing::BY_NOISE);
    let state = &now.adjusted.state;
    let size_px = now.instrument.sensor.size_px;
    let is_on_page = |band: usize, dot: usize| {
        let image = problem.image(band, dot, &now.cameras, state, &state.poses[place]);
        let reach_px = image.z.abs() + image.w.abs() + MARGIN_PX;
        (0..2).all(|k| (reach_px..size_px[k] as f64 - reach_px).contains(&image[k]))
    };
    let sought: Vec<usize> = (0..target.dots().len()).filter(|dot| is_sought(&target.dots()[*dot])).collect();
    (0..now.cameras.len()).any(|band| sought.iter().filter(|dot| is_on_page(band, **dot)).count() >= DOTS_MIN)
}
