//! Options that several commands share.

use std::path::PathBuf;

use clap::ValueEnum;
use twinpupil_reconstruct::Polarity;

/// A number of an option, of which `legal` says in words what `is_legal` is true of: a parser for the command line.
pub fn number(legal: &'static str, is_legal: fn(&f64) -> bool) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| text.parse().ok().filter(is_legal).ok_or_else(|| format!("legal: {legal}"))
}

/// A length that is a size, mm.
pub fn size_mm() -> impl Fn(&str) -> Result<f64, String> + Clone {
    number("above 0, up to 1e6", |mm| *mm > 0.0 && *mm <= 1e6)
}

/// A length that may be none, mm.
pub fn extent_mm() -> impl Fn(&str) -> Result<f64, String> + Clone {
    number("0 to 1e6", |mm| (0.0..=1e6).contains(mm))
}

/// A distance of objects, mm.
pub fn distance_mm() -> impl Fn(&str) -> Result<f64, String> + Clone {
    number("above 0, up to 1e7", |mm| *mm > 0.0 && *mm <= 1e7)
}

/// A file of one kind, which its name must say: a parser for the command line.
pub fn file_of(kind: &'static str) -> impl Fn(&str) -> Result<PathBuf, String> + Clone {
    move |text| {
        let path = PathBuf::from(text);
        let is_of_kind = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(kind));
        if is_of_kind { Ok(path) } else { Err(format!("legal: a name that ends in .{kind}")) }
    }
}

/// Whether features are brighter or darker than their surroundings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PolarityOption {
    /// As the frame shows
    Auto,
    /// Bright features on dark ground
    Bright,
    /// Dark features on bright ground
    Dark,
}

impl PolarityOption {
    /// `None` where the frame decides.
    pub fn polarity(self) -> Option<Polarity> {
        match self {
            Self::Auto => None,
            Self::Bright => Some(Polarity::Bright),
            Self::Dark => Some(Polarity::Dark),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_of_the_kind_that_its_name_says() {
        assert_eq!(file_of("png")("a/b.PNG"), Ok(PathBuf::from("a/b.PNG")));
        assert_eq!(file_of("png")("a.svg"), Err("legal: a name that ends in .png".to_owned()));
    }

    #[test]
    fn what_is_no_legal_number_is_told_what_is() {
        for text in ["nan", "inf", "0", "-1", "1e9", "x", ""] {
            assert_eq!(size_mm()(text), Err("legal: above 0, up to 1e6".to_owned()), "{text}");
        }
        assert_eq!((size_mm()("2.5"), extent_mm()("0"), distance_mm()("1e7")), (Ok(2.5), Ok(0.0), Ok(1e7)));
    }
}
