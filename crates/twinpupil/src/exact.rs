//! Numbers that come back from JSON to the last bit.

use std::num::ParseFloatError;

use serde::{Deserialize, Serialize};

/// A number written as text: readers of JSON may be off by the last bit of a number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Exact(pub f64);

impl From<Exact> for String {
    fn from(exact: Exact) -> Self {
        exact.0.to_string()
    }
}

impl TryFrom<String> for Exact {
    type Error = ParseFloatError;

    fn try_from(text: String) -> Result<Self, ParseFloatError> {
        text.parse().map(Self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_comes_back_as_it_was() {
        for value in [300.0, 0.85 * 310.1, 1.0 / 3.0, 5e-324, 1.797_693_134_862_315_7e308, -0.0] {
            let text = serde_json::to_string(&Exact(value)).unwrap();
            let read: Exact = serde_json::from_str(&text).unwrap();
            assert_eq!(read.0.to_bits(), value.to_bits(), "{text}");
        }
        assert_eq!(serde_json::to_string(&Exact(300.0)).unwrap(), "\"300\"");
        assert!(serde_json::from_str::<Exact>("\"far\"").is_err());
    }
}
