//! The paper's instrument [Ohno2018, Table 1], once, for tests, benchmarks, docs and the demo.

use crate::Instrument;

/// The instrument file as the program prints it, comments and all.
pub const INSTRUMENT_TOML: &str = include_str!("paper.toml");

/// The paper's instrument with an ideal lens of f = 100 mm.
pub fn instrument() -> Instrument {
    Instrument::from_toml(INSTRUMENT_TOML).expect("the shipped file is tested")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_instrument_is_in_focus_at_296_08() {
        let [telecentric, entocentric] = instrument().projections();
        assert!((telecentric.focus_distance_mm() - 151.0 * 100.0 / 51.0).abs() < 1e-12);
        assert!((telecentric.magnification(300.0) - 0.51).abs() < 1e-15);
        assert!((entocentric.magnification(300.0) - 151.0 / 300.0).abs() < 1e-15);
    }
}
