//! Why something failed, as a sentence.

/// The chain of causes on one line, whatever line breaks a library put into it; a cause that the one before it has stated
/// already is not repeated.
pub fn one_line(error: &anyhow::Error) -> String {
    let mut said: Vec<String> = Vec::new();
    for cause in error.chain() {
        let cause = cause.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        if said.last().is_none_or(|before| !before.ends_with(&cause)) {
            said.push(cause);
        }
    }
    said.join(": ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, thiserror::Error)]
    #[error("the frame is none: {0}")]
    struct Outer(#[from] std::num::ParseIntError);

    #[test]
    fn errors_are_one_line() {
        let error = anyhow::anyhow!("a\n  b").context("file");
        assert_eq!(one_line(&error), "file: a b");
    }

    #[test]
    fn a_cause_that_is_stated_is_not_repeated() {
        let error = anyhow::Error::from(Outer("x".parse::<i32>().unwrap_err())).context("file");
        assert_eq!(one_line(&error), "file: the frame is none: invalid digit found in string");
    }
}
