//! Crosstalk as the instrument file states it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::{ValueError, within};

/// `[crosstalk]`: how much of every band each band's plane sees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CrosstalkSpec {
    /// Row i: signal in the plane of band i from unit light of every band, in the order of the file; 1 from its own.
    pub matrix: Vec<Vec<f64>>,
}

impl CrosstalkSpec {
    pub(crate) fn check(&self, bands: usize) -> Result<(), ValueError> {
        let legal = format!("{bands} rows of {bands} numbers, one for each band");
        if self.matrix.len() != bands {
            return Err(ValueError::new("crosstalk.matrix", format!("{} rows", self.matrix.len()), legal));
        }
        for (i, row) in self.matrix.iter().enumerate() {
            if row.len() != bands {
                return Err(ValueError::new(format!("crosstalk.matrix[{i}]"), format!("{} numbers", row.len()), legal));
            }
            for (j, value) in row.iter().enumerate() {
                let key = format!("crosstalk.matrix[{i}][{j}]");
                if i == j && *value != 1.0 {
                    return Err(ValueError::new(key, value, "1 for a band in its own plane"));
                }
                within(&key, *value, 0.0, 1.0)?;
            }
        }
        Ok(())
    }
}
