//! Catalogues of glasses in the AGF format.
//!
//! A glass is a line `NM name formula …`, a line `CD` with the coefficients and a line `LD` with the shortest and longest
//! wavelength in µm. Other lines tell of transmission, heat and price, and are passed over.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use crate::check::SyntaxError;
use crate::text::decode;
use crate::{Formula, Glass, MediumSpec};

/// Glasses by name; names are the same in upper and lower case.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Catalogue {
    /// By the name in upper case.
    glasses: BTreeMap<String, Glass>,
}

static BUILT_IN: LazyLock<Catalogue> = LazyLock::new(|| {
    Catalogue::from_agf(include_bytes!("glasses.agf")).expect("the catalogue that ships with the program is whole")
});

impl Catalogue {
    /// The glasses that ship with the program; `glasses.agf` names the source of each.
    pub fn built_in() -> &'static Self {
        &BUILT_IN
    }

    /// Reads an AGF file.
    pub fn from_agf(bytes: &[u8]) -> Result<Self, SyntaxError> {
        let text = decode(bytes)?;
        let mut catalogue = Self::default();
        let mut entry: Option<Entry> = None;
        let (mut count, mut last) = (0, "");
        for (number, line) in (1..).zip(text.lines()) {
            count = number;
            let mut words = line.split_whitespace();
            let keyword = words.next().unwrap_or_default();
            last = keyword;
            let numbers = || words.map(|word| number_of(word, number)).collect::<Result<Vec<f64>, _>>();
            match keyword {
                "NM" => {
                    catalogue.take(entry.take())?;
                    entry = Some(Entry::new(line, number)?);
                }
                "CD" => Entry::at(&mut entry, number)?.coefficients = numbers()?,
                "LD" => Entry::at(&mut entry, number)?.limits_um = numbers()?,
                _ => {}
            }
        }
        if last == "CD" && !text.ends_with('\n') {
            return Err(at(count, "the file ends within the coefficients of a glass: is it cut?"));
        }
        catalogue.take(entry)?;
        if catalogue.glasses.is_empty() {
            return Err(at(count.max(1), "the file ends without a glass: no line starts with NM"));
        }
        Ok(catalogue)
    }

    /// The glass of that name.
    pub fn glass(&self, name: &str) -> Option<&Glass> {
        self.glasses.get(&name.to_uppercase())
    }

    /// All of them, by name.
    pub fn glasses(&self) -> impl ExactSizeIterator<Item = &Glass> {
        self.glasses.values()
    }

    fn take(&mut self, entry: Option<Entry>) -> Result<(), SyntaxError> {
        let Some(entry) = entry else { return Ok(()) };
        let glass = entry.glass()?;
        self.glasses.insert(glass.name().to_uppercase(), glass);
        Ok(())
    }
}

/// What is read of a glass so far.
struct Entry {
    name: String,
    line: usize,
    formula: Formula,
    coefficients: Vec<f64>,
    limits_um: Vec<f64>,
}

impl Entry {
    fn new(text: &str, line: usize) -> Result<Self, SyntaxError> {
        let mut words = text.split_whitespace().skip(1);
        let (Some(name), Some(formula)) = (words.next(), words.next()) else {
            return Err(at(line, "NM lacks the name or the formula of a glass"));
        };
        let formula = formula_of(number_of(formula, line)?)
            .ok_or_else(|| at(line, &format!("formula {formula} of glass {name} is unknown; legal: 1 to 13")))?;
        Ok(Self { name: name.to_owned(), line, formula, coefficients: Vec::new(), limits_um: Vec::new() })
    }

    /// The glass that a line belongs to.
    fn at(entry: &mut Option<Self>, line: usize) -> Result<&mut Self, SyntaxError> {
        entry.as_mut().ok_or_else(|| at(line, "numbers of a glass come before its NM"))
    }

    fn glass(self) -> Result<Glass, SyntaxError> {
        let Self { name, line, formula, mut coefficients, limits_um } = self;
        let [_, most] = formula.coefficient_counts();
        coefficients.truncate(most);
        if formula.is_of_pairs() && coefficients.len() % 2 == 1 {
            let message = format!("glass {name} has {} coefficients; legal: pairs", coefficients.len());
            return Err(at(line, &message));
        }
        let wavelengths_nm = match limits_um[..] {
            [shortest_um, longest_um, ..] if longest_um > 0.0 => [1000.0 * shortest_um, 1000.0 * longest_um],
            _ => UNLIMITED_NM,
        };
        let medium = MediumSpec { formula, coefficients, wavelengths_nm };
        medium.check(&name).map_err(|error| at(line, &error.to_string()))?;
        Ok(Glass::new(name, medium))
    }
}

/// Where a catalogue does not say.
const UNLIMITED_NM: [f64; 2] = [200.0, 20_000.0];

/// The formula of a number in NM.
fn formula_of(number: f64) -> Option<Formula> {
    let formulas = [
        Formula::Schott,
        Formula::Sellmeier1,
        Formula::Herzberger,
        Formula::Sellmeier2,
        Formula::Conrady,
        Formula::Sellmeier3,
        Formula::Handbook1,
        Formula::Handbook2,
        Formula::Sellmeier4,
        Formula::Extended,
        Formula::Sellmeier5,
        Formula::Extended2,
        Formula::Extended3,
    ];
    let place = (1.0..14.0).contains(&number).then(|| number as usize - 1)?;
    formulas.get(place).copied()
}

fn number_of(word: &str, line: usize) -> Result<f64, SyntaxError> {
    let number = word.parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| at(line, &format!("`{word}` is not a number")))
}

fn at(line: usize, message: &str) -> SyntaxError {
    SyntaxError { line, message: message.to_owned() }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_built_in_glasses_have_the_indices_that_their_makers_print() {
        // n_d of SCHOTT's and Nikon's data sheets.
        for (name, expected) in [
            ("N-BK7", 1.5168),
            ("N-SF11", 1.78472),
            ("F2", 1.62004),
            ("f5", 1.60342),
            ("N-SK2", 1.60738),
            ("N-SSK2", 1.62229),
            ("N-SK16", 1.62041),
            ("N-LAK22", 1.65113),
            ("N-BAF10", 1.67003),
            ("SK16", 1.62041),
            ("F_SILICA", 1.45846),
            ("CAF2", 1.43385),
        ] {
            let index = Catalogue::built_in().glass(name).unwrap().index(587.5618).unwrap();
            assert!((index - expected).abs() < 6e-6, "{name}: {index}");
        }
        assert!(Catalogue::built_in().glasses().len() > 150);
    }

    #[test]
    fn every_built_in_glass_is_transparent_over_its_range() {
        for glass in Catalogue::built_in().glasses() {
            let [shortest_nm, longest_nm] = glass.wavelengths_nm();
            for k in 0..=20 {
                let index = glass.index(shortest_nm + (longest_nm - shortest_nm) * f64::from(k) / 20.0).unwrap();
                assert!((1.2..2.5).contains(&index), "{}: {index}", glass.name());
            }
        }
    }

    #[test]
    fn damaged_catalogues_are_refused_with_the_line() {
        let said = |text: &str| Catalogue::from_agf(text.as_bytes()).unwrap_err().to_string();
        assert_eq!(said(""), "line 1: the file ends without a glass: no line starts with NM");
        assert_eq!(said("CC x\nCD 1 2\n"), "line 2: numbers of a glass come before its NM");
        assert_eq!(said("NM A\n"), "line 1: NM lacks the name or the formula of a glass");
        assert_eq!(said("NM A 77 0 1.5 60\n"), "line 1: formula 77 of glass A is unknown; legal: 1 to 13");
        assert_eq!(said("NM A 2 0 1.5 60\nCD 1.0 x\n"), "line 2: `x` is not a number");
        assert_eq!(said("NM A 2 0 1.5 60\nCD 1.0 nan\n"), "line 2: `nan` is not a number");
        assert_eq!(
            said("CC\nNM A 2 0 1.5 60\nNM B 2\nCD 1 0.01\n"),
            "line 2: `A.coefficients` is 0 numbers; legal: 1 to 6"
        );
        assert_eq!(
            said("NM A 2 0 1.5 60\nCD 1.04 0.006 0.23"),
            "line 2: the file ends within the coefficients of a glass: is it cut?"
        );
        assert_eq!(said("NM A 2 0 1.5 60\nCD 1.04\nLD 0.3 2\n"), "line 1: glass A has 1 coefficients; legal: pairs");
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = Catalogue::from_agf(&bytes);
        }

        #[test]
        fn no_words_make_it_panic(words in prop::collection::vec("NM|CD|LD|\n|[A-Z0-9.e-]{1,6}|nan|1e999", 0..60)) {
            if let Ok(catalogue) = Catalogue::from_agf(words.join(" ").as_bytes()) {
                for glass in catalogue.glasses() {
                    let _ = glass.index(550.0);
                }
            }
        }
    }
}
