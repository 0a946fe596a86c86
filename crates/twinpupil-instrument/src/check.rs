//! Checks of user input, each failing with one sentence that names the key, the value and what is legal.

use thiserror::Error;

/// A value outside its legal range.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("`{key}` is {value}; legal: {legal}")]
pub struct ValueError {
    /// Full key, such as `sensor.pitch_mm` or `aperture[1].zones[0].radius_mm`.
    pub key: String,
    /// The value as the user wrote it.
    pub value: String,
    /// What would have been legal.
    pub legal: String,
}

impl ValueError {
    /// The error for `key`, printing `value` as it reads.
    pub fn new(key: impl Into<String>, value: impl ToString, legal: impl Into<String>) -> Self {
        Self { key: key.into(), value: value.to_string(), legal: legal.into() }
    }
}

/// Text that is not the TOML that was expected: bad syntax, an unknown or a missing key, a wrong type.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("line {line}: {message}")]
pub struct SyntaxError {
    /// First line is 1.
    pub line: usize,
    /// One sentence, without a line break.
    pub message: String,
}

/// Parses `text` into `T`, locating the first error by its line.
pub fn parse_toml<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, SyntaxError> {
    toml::from_str(text).map_err(|error| {
        let offset = error.span().map_or(0, |span| span.start.min(text.len()));
        let line = 1 + text.as_bytes()[..offset].iter().filter(|&&byte| byte == b'\n').count();
        let message = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
        SyntaxError { line, message }
    })
}

/// `value` must be finite and within `range`.
pub fn within(key: &str, value: f64, min: f64, max: f64) -> Result<(), ValueError> {
    if value.is_finite() && (min..=max).contains(&value) {
        return Ok(());
    }
    Err(ValueError::new(key, readable(value), format!("{min} to {max}")))
}

/// `value` must be finite, above zero and at most `max`.
pub fn positive(key: &str, value: f64, max: f64) -> Result<(), ValueError> {
    if value.is_finite() && value > 0.0 && value <= max {
        return Ok(());
    }
    Err(ValueError::new(key, readable(value), format!("above 0, up to {max}")))
}

/// A number in as many digits as a reader wants to see.
fn readable(value: f64) -> String {
    match value.abs() {
        size if size != 0.0 && !(1e-5..1e9).contains(&size) && value.is_finite() => format!("{value:e}"),
        _ => value.to_string(),
    }
}

/// The file's `schema` must be the one this version reads.
pub fn schema(value: u32) -> Result<(), ValueError> {
    if value == 1 { Ok(()) } else { Err(ValueError::new("schema", value, "1")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct One {
        #[allow(dead_code, reason = "only parsed")]
        a: f64,
    }

    #[test]
    fn a_syntax_error_names_its_line() {
        let error = parse_toml::<One>("a = 1.0\nb = 2.0\n").expect_err("b is unknown");
        assert_eq!(error.line, 2);
        assert!(error.message.contains("unknown field `b`"), "{error}");
        assert!(!error.message.contains('\n'));
    }

    #[test]
    fn nan_is_never_within() {
        assert!(within("x", f64::NAN, 0.0, 1.0).is_err());
        assert!(positive("x", f64::NAN, 1.0).is_err());
        assert_eq!(positive("x", -1.0, 5.0).unwrap_err().to_string(), "`x` is -1; legal: above 0, up to 5");
    }
}
