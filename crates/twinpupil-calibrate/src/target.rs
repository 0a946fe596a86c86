//! What is calibrated with: a plate of dots whose places are known.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;
use twinpupil_instrument::check::{self, SyntaxError, ValueError, positive};

/// A target file that is not legal.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum TargetError {
    /// Not the TOML that was expected.
    #[error(transparent)]
    Syntax(#[from] SyntaxError),
    /// A value outside its range.
    #[error(transparent)]
    Value(#[from] ValueError),
}

/// `target.toml` as it is written; [`Target`] is the same, checked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TargetSpec {
    /// Version of this format: 1.
    pub schema: u32,
    /// What the user calls the target.
    pub name: String,
    /// What is on it.
    pub kind: TargetKind,
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Distance between neighbouring centres, mm.
    pub pitch_mm: f64,
    /// Diameter of the dots, mm.
    pub dot_diameter_mm: f64,
    /// Dots that tell which way round the target is.
    #[serde(default, rename = "fiducial", skip_serializing_if = "Vec::is_empty")]
    pub fiducials: Vec<Fiducial>,
}

/// What is on a target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TargetKind {
    /// Round dots in rows and columns.
    DotGrid,
}

/// One `[[fiducial]]`: a place of the grid that is not like the others.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fiducial {
    /// Row, from the top and from 0.
    pub row: usize,
    /// Column, from the left and from 0.
    pub column: usize,
    /// Diameter of the dot there, mm; left out where there is no dot at all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub diameter_mm: Option<f64>,
}

/// A dot of a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetDot {
    /// Row, from the top and from 0.
    pub row: usize,
    /// Column, from the left and from 0.
    pub column: usize,
    /// Its centre right of and below the middle of the grid, mm.
    pub position_mm: [f64; 2],
    /// Its diameter, mm.
    pub diameter_mm: f64,
}

/// A checked target.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    spec: TargetSpec,
    dots: Vec<TargetDot>,
}

/// Most rows and columns.
const SIDE_MAX: usize = 1000;

/// A larger dot is told from its neighbours if its diameter is so many times theirs.
const LARGER_MIN: f64 = 1.2;

impl Target {
    /// Checks every value of `spec`.
    pub fn new(spec: TargetSpec) -> Result<Self, ValueError> {
        check::schema(spec.schema)?;
        for (key, side) in [("rows", spec.rows), ("columns", spec.columns)] {
            if !(2..=SIDE_MAX).contains(&side) {
                return Err(ValueError::new(key, side, format!("2 to {SIDE_MAX}")));
            }
        }
        if spec.rows * spec.columns < 9 {
            return Err(ValueError::new("rows", spec.rows, "at least 9 dots in all"));
        }
        positive("pitch_mm", spec.pitch_mm, 1e4)?;
        positive("dot_diameter_mm", spec.dot_diameter_mm, 1e4)?;
        if spec.dot_diameter_mm >= spec.pitch_mm {
            let legal = format!("below pitch_mm = {}, so that dots do not touch", spec.pitch_mm);
            return Err(ValueError::new("dot_diameter_mm", spec.dot_diameter_mm, legal));
        }
        for (index, fiducial) in spec.fiducials.iter().enumerate() {
            check_fiducial(&spec, index, fiducial)?;
        }
        let dots = dots(&spec);
        Ok(Self { spec, dots })
    }

    /// Reads and checks a target file.
    pub fn from_toml(text: &str) -> Result<Self, TargetError> {
        Ok(Self::new(check::parse_toml(text)?)?)
    }

    /// The target as a file that [`Target::from_toml`] reads back to the same.
    pub fn to_toml(&self) -> String {
        toml::to_string(&self.spec).expect("a checked target is plain data")
    }

    /// JSON schema of the target file.
    pub fn json_schema() -> schemars::Schema {
        schemars::schema_for!(TargetSpec)
    }

    /// What the user stated.
    pub fn spec(&self) -> &TargetSpec {
        &self.spec
    }

    /// Its dots, row by row, without those that are missing.
    pub fn dots(&self) -> &[TargetDot] {
        &self.dots
    }

    /// The fiducial at a place.
    pub fn fiducial(&self, row: usize, column: usize) -> Option<&Fiducial> {
        self.spec.fiducials.iter().find(|fiducial| (fiducial.row, fiducial.column) == (row, column))
    }

    /// Index of the dot at a place.
    pub fn dot_at(&self, row: usize, column: usize) -> Option<usize> {
        self.dots.binary_search_by_key(&(row, column), |dot| (dot.row, dot.column)).ok()
    }
}

impl Target {
    /// Whether it looks the same in a mirror, turned as it may be, so that a mirrored image does not show.
    pub fn is_mirror_symmetric(&self) -> bool {
        let TargetSpec { rows, columns, fiducials, .. } = &self.spec;
        let is_kept = |mirrored: &dyn Fn(&Fiducial) -> [usize; 2]| {
            fiducials.iter().all(|own| {
                let [row, column] = mirrored(own);
                self.fiducial(row, column).is_some_and(|other| other.diameter_mm == own.diameter_mm)
            })
        };
        let (last_row, last_column) = (rows - 1, columns - 1);
        let upright =
            is_kept(&|own| [own.row, last_column - own.column]) || is_kept(&|own| [last_row - own.row, own.column]);
        let across = rows == columns
            && (is_kept(&|own| [own.column, own.row])
                || is_kept(&|own| [last_column - own.column, last_row - own.row]));
        upright || across
    }
}

fn check_fiducial(spec: &TargetSpec, index: usize, fiducial: &Fiducial) -> Result<(), ValueError> {
    let key = |name: &str| format!("fiducial[{index}].{name}");
    let legal = |count: usize| format!("0 to {}", count - 1);
    if fiducial.row >= spec.rows {
        return Err(ValueError::new(key("row"), fiducial.row, legal(spec.rows)));
    }
    if fiducial.column >= spec.columns {
        return Err(ValueError::new(key("column"), fiducial.column, legal(spec.columns)));
    }
    let is_same = |other: &&Fiducial| (other.row, other.column) == (fiducial.row, fiducial.column);
    if spec.fiducials[..index].iter().any(|other| is_same(&other)) {
        let place = format!("row {}, column {} again", fiducial.row, fiducial.column);
        return Err(ValueError::new(format!("fiducial[{index}]"), place, "a place of its own"));
    }
    match fiducial.diameter_mm {
        Some(diameter_mm) => {
            let (least_mm, most_mm) = (LARGER_MIN * spec.dot_diameter_mm, spec.pitch_mm);
            check::within(&key("diameter_mm"), diameter_mm, least_mm, most_mm)
        }
        None => Ok(()),
    }
}

fn dots(spec: &TargetSpec) -> Vec<TargetDot> {
    let middle = |count: usize| 0.5 * (count - 1) as f64;
    let at = |row: usize, column: usize| {
        let fiducial = spec.fiducials.iter().find(|fiducial| (fiducial.row, fiducial.column) == (row, column));
        let diameter_mm = fiducial.map_or(Some(spec.dot_diameter_mm), |fiducial| fiducial.diameter_mm)?;
        let position_mm = [column as f64 - middle(spec.columns), row as f64 - middle(spec.rows)];
        Some(TargetDot { row, column, position_mm: position_mm.map(|steps| steps * spec.pitch_mm), diameter_mm })
    };
    (0..spec.rows).flat_map(|row| (0..spec.columns).filter_map(move |column| at(row, column))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: &str = "schema = 1\nname = \"t\"\nkind = \"dot-grid\"\nrows = 3\ncolumns = 5\npitch_mm = 2.0\n\
                        dot_diameter_mm = 1.0\n";

    #[test]
    fn a_grid_is_centred_and_leaves_out_what_is_missing() {
        let text =
            format!("{GRID}[[fiducial]]\nrow = 0\ncolumn = 1\n[[fiducial]]\nrow = 2\ncolumn = 4\ndiameter_mm = 1.5");
        let target = Target::from_toml(&text).unwrap();
        assert_eq!(target.dots().len(), 14);
        assert_eq!(target.dot_at(0, 1), None);
        let corner = &target.dots()[target.dot_at(2, 4).unwrap()];
        assert_eq!((corner.position_mm, corner.diameter_mm), ([4.0, 2.0], 1.5));
        assert_eq!(target.dots()[target.dot_at(1, 2).unwrap()].position_mm, [0.0, 0.0]);
        assert_eq!(Target::from_toml(&target.to_toml()).unwrap(), target);
    }

    #[test]
    fn only_fiducials_beside_all_middles_tell_a_mirrored_target() {
        let of = |rows: usize, places: &[[usize; 2]]| {
            let fiducial = |[row, column]: [usize; 2]| format!("[[fiducial]]\nrow = {row}\ncolumn = {column}\n");
            let fiducials: String = places.iter().copied().map(fiducial).collect();
            let grid = GRID.replace("rows = 3", &format!("rows = {rows}"));
            Target::from_toml(&format!("{grid}{fiducials}")).unwrap().is_mirror_symmetric()
        };
        assert!(of(3, &[]) && of(3, &[[1, 0]]) && of(3, &[[0, 0], [0, 4]]));
        assert!(!of(3, &[[0, 0]]) && !of(3, &[[0, 0], [2, 4]]));
        // A square one also has diagonals.
        assert!(of(5, &[[0, 0]]) && !of(5, &[[0, 1]]));
    }

    #[test]
    fn what_is_not_legal_is_named() {
        let message = |from: &str, to: &str| Target::from_toml(&GRID.replace(from, to)).unwrap_err().to_string();
        assert!(message("rows = 3", "rows = 1").contains("`rows` is 1; legal: 2 to 1000"));
        assert!(message("dot_diameter_mm = 1.0", "dot_diameter_mm = 2.0").contains("below pitch_mm"));
        assert!(message("dot-grid", "chessboard").contains("line 3"));
        let twice = format!("{GRID}[[fiducial]]\nrow = 0\ncolumn = 1\n[[fiducial]]\nrow = 0\ncolumn = 1\n");
        assert!(Target::from_toml(&twice).unwrap_err().to_string().contains("fiducial[1]"));
    }
}
