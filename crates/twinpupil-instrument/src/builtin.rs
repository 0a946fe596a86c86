//! Instruments that ship with the program: the paper's, and one for each other way in which planes reach a file.

use crate::paper;

/// Name and file, comments and all, of every instrument that ships.
pub const ALL: [(&str, &str); 5] = [
    ("paper", paper::INSTRUMENT_TOML),
    ("polarizer", include_str!("builtin/polarizer.toml")),
    ("hyperspectral", include_str!("builtin/hyperspectral.toml")),
    ("two-sensors", include_str!("builtin/two-sensors.toml")),
    ("three-bands", include_str!("builtin/three-bands.toml")),
];

/// The file of the instrument of that name.
pub fn toml(name: &str) -> Option<&'static str> {
    ALL.into_iter().find(|(own, _)| *own == name).map(|(_, text)| text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Instrument;

    #[test]
    fn every_shipped_file_is_legal_and_prints_back() {
        for (name, text) in ALL {
            let instrument = Instrument::from_toml(text).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(Instrument::from_toml(&instrument.to_toml()).unwrap(), instrument, "{name}");
        }
    }

    #[test]
    fn a_pupil_in_between_magnifies_in_between() {
        let instrument = Instrument::from_toml(toml("three-bands").unwrap()).unwrap();
        for z_mm in [250.0, 350.0] {
            let [telecentric, entocentric, between] = [0, 1, 2]
                .map(|k| instrument.projection(&instrument.bands[instrument.bands_by_role()[k]]).magnification(z_mm));
            let (low, high) = (telecentric.min(entocentric), telecentric.max(entocentric));
            assert!((low..high).contains(&between), "{z_mm}: {telecentric} {between} {entocentric}");
            // p = x (L/d − 1)/(1 + z (1/d − 1/f)) with d = 60.
            let by_hand = (151.0 / 60.0 - 1.0) / (1.0 + z_mm * (1.0 / 60.0 - 1.0 / 100.0));
            assert!((between - by_hand).abs() < 1e-12);
        }
    }
}
