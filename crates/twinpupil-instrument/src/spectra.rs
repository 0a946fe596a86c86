//! Spectral response: how much of each band every plane of the sensor sees.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::{Band, Mosaic, Polarizers};

/// `[spectra]`: where the curves come from. Without it every plane sees its own band and nothing else.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpectraSpec {
    /// `nominal`, or a CSV file `wavelength_nm,<plane>,…` with the sensor's quantum efficiency in each plane.
    pub quantum_efficiency: String,
    /// `nominal`, or a CSV file `wavelength_nm,<band>,…` with the transmittance of each band's filter.
    pub filters: String,
}

/// Curves over wavelength, as read from a CSV file.
#[derive(Debug, Clone, PartialEq)]
pub struct SpectralTable {
    wavelength_nm: Vec<f64>,
    curves: Vec<(String, Vec<f64>)>,
}

/// Why a text is not a table of curves, or curves do not give a response.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SpectraError {
    /// The first line is not a header.
    #[error("line 1: the header must be `wavelength_nm` and at least one name")]
    Header,
    /// A row that is not numbers in range.
    #[error("line {line}: `{text}` is not a wavelength above the last and values of 0 to 1")]
    Row {
        /// First line is 1.
        line: usize,
        /// The row as read.
        text: String,
    },
    /// Fewer than two rows.
    #[error("at least two rows of values are needed")]
    TooShort,
    /// A curve that is not there.
    #[error("there is no curve `{name}`; there are: {available}")]
    NoCurve {
        /// What was asked for.
        name: String,
        /// What there is.
        available: String,
    },
    /// A band that its own plane does not see.
    #[error("plane `{plane}` does not see band `{band}`: filter and quantum efficiency do not overlap")]
    Blind {
        /// The band.
        band: String,
        /// Its plane.
        plane: String,
    },
}

impl SpectralTable {
    /// Reads `wavelength_nm,name,…` with rising wavelengths and values of 0 to 1; lines starting with `#` are skipped.
    pub fn from_csv(text: &str) -> Result<Self, SpectraError> {
        let mut lines = text.lines().enumerate().filter(|(_, line)| {
            let line = line.trim();
            !line.is_empty() && !line.starts_with('#')
        });
        let header: Vec<&str> =
            lines.next().map(|(_, line)| line.split(',').map(str::trim).collect()).unwrap_or_default();
        if header.len() < 2 || header[0] != "wavelength_nm" {
            return Err(SpectraError::Header);
        }
        let mut table =
            Self { wavelength_nm: Vec::new(), curves: header[1..].iter().map(|n| ((*n).to_owned(), vec![])).collect() };
        for (index, line) in lines {
            let bad = || SpectraError::Row { line: index + 1, text: line.trim().to_owned() };
            let row: Vec<f64> = line.split(',').map(|cell| cell.trim().parse().unwrap_or(f64::NAN)).collect();
            let rises = row[0] > table.wavelength_nm.last().copied().unwrap_or(0.0) && row[0].is_finite();
            if row.len() != header.len() || !rises || !row[1..].iter().all(|value| (0.0..=1.0).contains(value)) {
                return Err(bad());
            }
            table.wavelength_nm.push(row[0]);
            for ((_, curve), value) in table.curves.iter_mut().zip(&row[1..]) {
                curve.push(*value);
            }
        }
        if table.wavelength_nm.len() < 2 { Err(SpectraError::TooShort) } else { Ok(table) }
    }

    /// The nominal quantum efficiency that ships with the program; see the file's own comment.
    pub fn nominal_quantum_efficiency() -> Self {
        Self::from_csv(include_str!("nominal_quantum_efficiency.csv")).expect("the shipped file is tested")
    }

    /// The nominal transmittance of the paper's two filters that ships with the program; see the file's own comment.
    pub fn nominal_filters() -> Self {
        Self::from_csv(include_str!("nominal_filters.csv")).expect("the shipped file is tested")
    }

    fn curve(&self, name: &str) -> Result<&[f64], SpectraError> {
        self.curves.iter().find(|(own, _)| own == name).map(|(_, curve)| curve.as_slice()).ok_or_else(|| {
            let available = self.curves.iter().map(|(own, _)| own.as_str()).collect::<Vec<_>>().join(", ");
            SpectraError::NoCurve { name: name.to_owned(), available }
        })
    }

    /// Value of `curve` at a wavelength, linear between rows and zero outside them.
    fn value(&self, curve: &[f64], wavelength_nm: f64) -> f64 {
        let above = self.wavelength_nm.partition_point(|&node| node < wavelength_nm);
        match self.wavelength_nm.get(above) {
            Some(&node) if node == wavelength_nm => curve[above],
            Some(_) if above > 0 => {
                let (low, high) = (self.wavelength_nm[above - 1], self.wavelength_nm[above]);
                let fraction = (wavelength_nm - low) / (high - low);
                curve[above - 1] + fraction * (curve[above] - curve[above - 1])
            }
            _ => 0.0,
        }
    }
}

/// Signal in every plane from unit light of every band; a band's response in its own plane is 1.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseMatrix {
    planes: Vec<String>,
    bands: usize,
    /// Row-major: plane by plane, band by band.
    values: Vec<f64>,
}

impl ResponseMatrix {
    /// Every plane sees its own band and nothing else.
    pub fn ideal(bands: &[Band]) -> Self {
        let planes: Vec<String> = bands.iter().map(|band| band.plane.clone()).collect();
        let values = planes.iter().flat_map(|plane| bands.iter().map(move |b| f64::from(u8::from(b.plane == *plane))));
        Self { bands: bands.len(), values: values.collect(), planes }
    }

    /// Integrates filter transmittance × quantum efficiency over wavelength under equal energy.
    ///
    /// ```text
    /// M[plane][band] = ∫ T_band(λ) QE_plane(λ) dλ / ∫ T_band(λ) QE_own plane(λ) dλ
    /// ```
    pub fn from_curves(
        bands: &[Band],
        mosaic: Mosaic,
        quantum_efficiency: &SpectralTable,
        filters: &SpectralTable,
    ) -> Result<Self, SpectraError> {
        let planes: Vec<String> = match mosaic.has_page_for_each_band() {
            true => bands.iter().map(|band| band.plane.clone()).collect(),
            false => mosaic.planes(),
        };
        let integral = |plane: &str, band: &Band| -> Result<f64, SpectraError> {
            let (qe, transmittance) = (quantum_efficiency.curve(plane)?, filters.curve(&band.name)?);
            let (first, last) = (filters.wavelength_nm[0], filters.wavelength_nm[filters.wavelength_nm.len() - 1]);
            let steps = (last - first).ceil().max(1.0);
            let step_nm = (last - first) / steps;
            Ok((0..=steps as usize)
                .map(|k| first + k as f64 * step_nm)
                .map(|nm| filters.value(transmittance, nm) * quantum_efficiency.value(qe, nm) * step_nm)
                .sum())
        };
        let mut values = Vec::with_capacity(planes.len() * bands.len());
        for plane in &planes {
            for band in bands {
                let own = integral(&band.plane, band)?;
                if own <= 0.0 {
                    return Err(SpectraError::Blind { band: band.name.clone(), plane: band.plane.clone() });
                }
                values.push(integral(plane, band)? / own);
            }
        }
        Ok(Self { planes, bands: bands.len(), values })
    }

    /// The plane of each band, in the order of `bands`, sees what its row says.
    pub fn from_rows(bands: &[Band], rows: &[Vec<f64>]) -> Self {
        let planes = bands.iter().map(|band| band.plane.clone()).collect();
        Self { planes, bands: bands.len(), values: rows.iter().flatten().copied().collect() }
    }

    /// What linear polarizers before the pixels pass of bands that are polarized along their own planes' angles.
    ///
    /// ```text
    /// M[plane][band] = cos² Δ + sin² Δ / extinction ratio        Δ: angle between plane and band
    /// ```
    ///
    /// the law of Malus; E. Hecht, "Optics" (5th ed.), Section 8.2.1.
    pub fn of_polarizers(bands: &[Band], extinction_ratio: f64) -> Self {
        let planes = Mosaic::Polarizer(Polarizers::SONY).planes();
        // Exact for the angles of a mosaic, where the cosine of 90° would be 6e-17.
        let cos2 = |degrees: i32| match degrees.rem_euclid(180) {
            0 => 1.0,
            90 => 0.0,
            45 | 135 => 0.5,
            other => f64::from(other).to_radians().cos().powi(2),
        };
        let passed = |plane: &str, band: &Band| {
            let degrees = |text: &str| text.parse::<i32>().unwrap_or(0);
            let along = cos2(degrees(plane) - degrees(&band.plane));
            along + (1.0 - along) / extinction_ratio
        };
        let values = planes.iter().flat_map(|plane| bands.iter().map(move |band| passed(plane, band)));
        Self { bands: bands.len(), values: values.collect(), planes }
    }

    /// The same sensor in light of one band alone, as a flat frame for measuring crosstalk is lit.
    #[must_use]
    pub fn lit_by(mut self, band: usize) -> Self {
        for row in self.values.chunks_exact_mut(self.bands) {
            row.iter_mut().enumerate().filter(|(own, _)| *own != band).for_each(|(_, value)| *value = 0.0);
        }
        self
    }

    /// Signal in `plane` from unit light of each band; zero in a plane that is not listed.
    pub fn of_plane(&self, plane: &str) -> Vec<f64> {
        match self.planes.iter().position(|own| own == plane) {
            Some(row) => self.values[row * self.bands..(row + 1) * self.bands].to_vec(),
            None => vec![0.0; self.bands],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper;

    #[test]
    fn the_shipped_curves_separate_the_papers_bands() {
        let instrument = paper::instrument();
        let matrix = ResponseMatrix::from_curves(
            &instrument.bands,
            Mosaic::Rggb,
            &SpectralTable::nominal_quantum_efficiency(),
            &SpectralTable::nominal_filters(),
        )
        .expect("the shipped curves cover the bands");
        let (red, blue) = (matrix.of_plane("r"), matrix.of_plane("b"));
        assert_eq!((red[0], blue[1]), (1.0, 1.0));
        assert!(red[1] > 0.0 && red[1] < 0.15 && blue[0] > 0.0 && blue[0] < 0.15, "{matrix:?}");
    }

    #[test]
    fn two_box_curves_give_their_overlap() {
        let qe =
            SpectralTable::from_csv("wavelength_nm,r,g,b\n400,0,0,1\n500,0,0,1\n501,1,0,0.25\n600,1,0,0.25\n").unwrap();
        let filters =
            SpectralTable::from_csv("wavelength_nm,red,blue\n400,0,1\n499,0,1\n500,0,0\n510,0,0\n511,1,0\n600,1,0\n")
                .unwrap();
        let matrix = ResponseMatrix::from_curves(&paper::instrument().bands, Mosaic::Rgb, &qe, &filters).unwrap();
        assert!((matrix.of_plane("b")[0] - 0.25).abs() < 1e-12);
        assert_eq!(matrix.of_plane("r")[1], 0.0);
    }

    #[test]
    fn polarizers_follow_malus() {
        let mut bands = paper::instrument().into_spec().bands;
        bands[0].plane = "0".to_owned();
        bands[1].plane = "90".to_owned();
        let matrix = ResponseMatrix::of_polarizers(&bands, 100.0);
        assert_eq!(matrix.of_plane("0"), [1.0, 0.01]);
        assert_eq!(matrix.of_plane("90"), [0.01, 1.0]);
        assert_eq!(matrix.of_plane("45"), [0.505, 0.505]);
        assert_eq!(ResponseMatrix::of_polarizers(&bands, f64::INFINITY).of_plane("135"), [0.5, 0.5]);
        assert_eq!(matrix.lit_by(1).of_plane("0"), [0.0, 0.01]);
    }

    #[test]
    fn damaged_tables_are_errors() {
        for text in ["", "nm,r\n1,1\n", "wavelength_nm\n400\n", "wavelength_nm,r\n400,0.5\n"] {
            assert!(SpectralTable::from_csv(text).is_err(), "{text:?}");
        }
        let error = SpectralTable::from_csv("wavelength_nm,r\n400,0.5\n390,0.5\n").unwrap_err();
        assert!(matches!(error, SpectraError::Row { line: 3, .. }));
        assert!(SpectralTable::from_csv("wavelength_nm,r\n400,0.5\n410,nan\n").is_err());
        assert!(SpectralTable::from_csv("wavelength_nm,r\n400,0.5\n410\n").is_err());
    }
}
