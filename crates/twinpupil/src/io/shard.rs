//! `--shard i/n`: which part of a run this machine does.

use std::fmt::{self, Display};
use std::str::FromStr;

/// The i-th of n parts, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    index: usize,
    count: usize,
}

/// Most parts.
const COUNT_MAX: usize = 100_000;

impl Shard {
    /// All of a run.
    pub const WHOLE: Self = Self { index: 1, count: 1 };

    /// Whether a piece of the run, by its number from 0, is this part's.
    pub fn holds(&self, piece: usize) -> bool {
        piece % self.count == self.index - 1
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let illegal =
            || format!("`{text}` is no shard; legal: i/n with i from 1 to n, such as 1/4, and n up to {COUNT_MAX}");
        let (index, count) = text.split_once('/').ok_or_else(illegal)?;
        let (index, count) = (index.parse().map_err(|_| illegal())?, count.parse().map_err(|_| illegal())?);
        if (1..=COUNT_MAX).contains(&count) && (1..=count).contains(&index) {
            return Ok(Self { index, count });
        }
        Err(illegal())
    }
}

impl Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_piece_is_one_shards() {
        for count in [1, 2, 7, 60] {
            let shards: Vec<Shard> = (1..=count).map(|index| format!("{index}/{count}").parse().unwrap()).collect();
            for piece in 0..50 {
                assert_eq!(shards.iter().filter(|shard| shard.holds(piece)).count(), 1);
            }
        }
    }

    #[test]
    fn what_is_no_shard_is_refused() {
        for text in ["0/7", "8/7", "1/0", "7", "a/b", "-1/3", "1/2/3", "", "1/1000000"] {
            let said = text.parse::<Shard>().unwrap_err();
            assert!(said.starts_with(&format!("`{text}` is no shard; legal: i/n")), "{said}");
        }
        assert_eq!("3/7".parse::<Shard>().unwrap().to_string(), "3/7");
    }
}
