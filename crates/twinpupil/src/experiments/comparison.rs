//! The table: what the paper prints beside what every case gives.

use serde::Serialize;
use twinpupil_reconstruct::LineFit;

use super::explanation::{Explanation, Note};
use super::published::{self, Published};
use super::rings::RADII_MM;
use super::study::{CaseStudy, Study};
use super::{Case, Experiment, Reading};

/// A number that came out of this run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Measured {
    /// The number, in the unit of its row.
    pub value: f64,
    /// Standard deviation of what it is the mean of.
    pub spread: Option<f64>,
    /// Distance at which it occurs, mm.
    pub at_z_mm: Option<f64>,
    /// Of how many, where it is a count.
    pub of: Option<usize>,
}

/// One quantity.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// What it is, with its unit.
    pub quantity: String,
    /// What the paper prints.
    pub published: Option<Published>,
    /// In the order of [`Case::REPRODUCED`]; `None` where a case has no such number.
    pub cases: [Option<Measured>; 3],
    /// Why they differ.
    pub explanation: Explanation,
    #[serde(skip)]
    decimals: usize,
}

/// The quantities of one experiment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Section {
    /// The experiment.
    pub title: &'static str,
    /// Its quantities.
    pub rows: Vec<Row>,
}

/// The whole table with its explanations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// One for each experiment.
    pub sections: Vec<Section>,
    /// One for each explanation that a row refers to.
    pub notes: Vec<Note>,
}

impl Comparison {
    /// Sets a study beside the paper.
    pub fn new(study: &Study) -> Self {
        Self { sections: vec![rings(study), depth_line(study), tilts(study)], notes: Note::all(study) }
    }

    /// Headings of the columns with numbers, two lines each.
    pub fn headings() -> [[&'static str; 2]; 4] {
        let [thin_paper, fresnel_paper, fresnel_model] = Case::REPRODUCED.map(Case::heading);
        [["published", ""], thin_paper, fresnel_paper, fresnel_model]
    }
}

impl Row {
    fn new(quantity: impl Into<String>, decimals: usize, explanation: Explanation) -> Self {
        Self { quantity: quantity.into(), published: None, cases: [None; 3], explanation, decimals }
    }

    fn published(self, published: Published) -> Self {
        Self { published: Some(published), ..self }
    }

    fn measured(self, study: &Study, measure: impl Fn(&CaseStudy) -> Option<Measured>) -> Self {
        Self { cases: study.cases().map(measure), ..self }
    }

    /// What the paper prints and what the cases give, as text.
    pub fn cells(&self) -> [String; 4] {
        let decimals = self.decimals;
        let published = self.published.map(|p| format!("{}{}", p.text(), at(p.at_z_mm)));
        let measured = self.cases.map(|measured| measured.map(|measured| measured.text(decimals)));
        let [thin_paper, fresnel_paper, fresnel_model] = measured;
        [published, thin_paper, fresnel_paper, fresnel_model].map(|cell| cell.unwrap_or_else(|| "–".to_owned()))
    }
}

impl Measured {
    fn new(value: f64) -> Self {
        Self { value, spread: None, at_z_mm: None, of: None }
    }

    fn text(&self, decimals: usize) -> String {
        let value = signed(self.value, decimals);
        match (self.of, self.spread) {
            _ if self.value.is_nan() => "none".to_owned(),
            (Some(of), _) => format!("{value} of {of}"),
            (None, Some(spread)) => format!("{value} ± {spread:.decimals$}"),
            (None, None) => format!("{value}{}", at(self.at_z_mm)),
        }
    }
}

/// With a true minus sign.
pub(super) fn signed(value: f64, decimals: usize) -> String {
    format!("{value:.decimals$}").replace('-', "−")
}

fn at(z_mm: Option<f64>) -> String {
    z_mm.map(|z_mm| format!(" at {z_mm}")).unwrap_or_default()
}

/// Distances of the rings that the table lists, mm; the files and the plot have all.
const LISTED_MM: [f64; 3] = [250.0, 300.0, 350.0];

fn rings(study: &Study) -> Section {
    let mut rows = Vec::new();
    for (ring, r_mm) in RADII_MM.into_iter().enumerate() {
        let explanation = if ring == 0 { Explanation::Clipping } else { Explanation::Dispersion };
        for z_mm in LISTED_MM {
            let depth = |case: &CaseStudy| {
                let depth = case.rings[ring].iter().find(|depth| depth.true_z_mm == z_mm)?;
                Some(Measured { spread: Some(depth.spread_mm), ..Measured::new(depth.mean_mm) })
            };
            let quantity = format!("z of the ring r = {r_mm:.1} at {z_mm} mm");
            rows.push(Row::new(quantity, 2, explanation).measured(study, depth));
        }
    }
    rows.push(found(study, |reading| reading.experiment == Experiment::Dots));
    Section { title: "22 dots without noise [Ohno2018, Figs. 3, 4]", rows }
}

fn depth_line(study: &Study) -> Section {
    let simulation = &study.thin_paper.line;
    // The simulation is not compared with itself.
    let compared = |case: &CaseStudy| case.case != Case::ThinPaper;
    let off_truth = |case: &CaseStudy| {
        let largest = case.line.largest_from_truth();
        Some(Measured { at_z_mm: Some(largest.at_z_mm), ..Measured::new(largest.value_mm) })
    };
    let off_simulation = |case: &CaseStudy| {
        let largest = case.line.largest_from(simulation);
        compared(case).then(|| Measured { at_z_mm: Some(largest.at_z_mm), ..Measured::new(largest.value_mm) })
    };
    let std_ideal = |case: &CaseStudy| Some(Measured::new(case.line.std_against_ideal_mm));
    let std_simulation = |case: &CaseStudy| compared(case).then(|| Measured::new(case.line.std_against_mm(simulation)));
    let rows = vec![
        Row::new("fitted line off the truth by at most, mm", 2, Explanation::Line)
            .published(published::LINE_OFF_TRUTH_MM)
            .measured(study, off_truth),
        Row::new("… off the simulation by at most, mm", 2, Explanation::Simulation)
            .published(published::LINE_OFF_SIMULATION_MM)
            .measured(study, off_simulation),
        Row::new("standard deviation against ideal, mm", 2, Explanation::Scatter)
            .published(published::STD_AGAINST_IDEAL_MM)
            .measured(study, std_ideal),
        Row::new("… against the simulation, mm", 2, Explanation::Simulation)
            .published(published::STD_AGAINST_SIMULATION_MM)
            .measured(study, std_simulation),
        found(study, |reading| reading.experiment == Experiment::Plate),
    ];
    Section { title: "Random plate at 250 … 350 mm [Ohno2018, Fig. 10]", rows }
}

fn tilts(study: &Study) -> Section {
    let mut rows = Vec::new();
    for (index, tilt) in published::TILTS.iter().enumerate() {
        let of_fit = |measure: fn(&LineFit) -> f64| {
            move |case: &CaseStudy| case.tilts.get(index).map(|fit| Measured::new(measure(fit)))
        };
        let fitted = Row::new(format!("fitted tilt at {}°, degrees", tilt.tilt_deg), 2, Explanation::Tilt);
        rows.push(fitted.published(tilt.fitted_deg).measured(study, of_fit(|fit| fit.tilt_rad.value.to_degrees())));
        let r_squared = Row::new(format!("R² at {}°", tilt.tilt_deg), 5, Explanation::Tilt);
        rows.push(r_squared.published(tilt.r_squared).measured(study, of_fit(|fit| fit.quality.r_squared)));
    }
    rows.push(found(study, |reading| matches!(reading.experiment, Experiment::Tilt { .. })));
    Section { title: "Tilted plate at 300 mm [Ohno2018, Fig. 11]", rows }
}

/// How many dots were recovered.
fn found(study: &Study, wanted: impl Fn(&Reading) -> bool) -> Row {
    let count = |case: &CaseStudy| {
        let [found, whole] = case.found(&wanted);
        Some(Measured { of: Some(whole), ..Measured::new(found as f64) })
    };
    Row::new("dots recovered, of those wholly on the sensor", 0, Explanation::Lost).measured(study, count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        let measured = Measured { spread: Some(0.004), ..Measured::new(247.1) };
        assert_eq!(measured.text(2), "247.10 ± 0.00");
        assert_eq!(Measured { at_z_mm: Some(350.0), ..Measured::new(-7.43) }.text(1), "−7.4 at 350");
        assert_eq!(Measured { of: Some(22), ..Measured::new(21.0) }.text(0), "21 of 22");
        let row = Row::new("line", 1, Explanation::Line).published(published::LINE_OFF_TRUTH_MM);
        assert_eq!(row.cells(), ["3.6 at 350", "–", "–", "–"]);
    }
}
