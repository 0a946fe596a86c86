//! All readings of all experiments, reduced.

use anyhow::Result;
use twinpupil_reconstruct::LineFit;

use super::depth_line::DepthLine;
use super::rings::{RADII_MM, RingDepth, ring};
use super::statistics::{mean, rms};
use super::{Case, Experiment, Reading, published, tilt};

/// What one case makes of every experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct CaseStudy {
    /// The lens and the way of reading.
    pub case: Case,
    /// The inner and the outer ring, each by distance.
    pub rings: [Vec<RingDepth>; 2],
    /// The plate across the axis.
    pub line: DepthLine,
    /// The fits of the tilted plates, in the order of [`published::TILTS`].
    pub tilts: Vec<LineFit>,
    /// Every frame.
    pub readings: Vec<Reading>,
}

/// What every case makes of every experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct Study {
    /// The thin lens, read by the paper's equations: the simulation that the paper compares itself with.
    pub thin_paper: CaseStudy,
    /// The Fresnel lens, read by the paper's equations.
    pub fresnel_paper: CaseStudy,
    /// The Fresnel lens, read by inverting its response.
    pub fresnel_model: CaseStudy,
}

impl Study {
    /// Reduces the readings of all cases.
    pub fn new(readings: &[Reading]) -> Result<Self> {
        let case = |case| CaseStudy::new(case, readings);
        Ok(Self {
            thin_paper: case(Case::ThinPaper)?,
            fresnel_paper: case(Case::FresnelPaper)?,
            fresnel_model: case(Case::FresnelModel)?,
        })
    }

    /// In the order of [`Case::REPRODUCED`].
    pub fn cases(&self) -> [&CaseStudy; 3] {
        [&self.thin_paper, &self.fresnel_paper, &self.fresnel_model]
    }
}

impl CaseStudy {
    fn new(case: Case, readings: &[Reading]) -> Result<Self> {
        let readings: Vec<Reading> = readings.iter().filter(|reading| reading.case == case).cloned().collect();
        let tilted = |tilt: &published::PublishedTilt| tilt::of_tilt(&readings, tilt.tilt_deg).map(tilt::fit);
        let tilts = published::TILTS.iter().filter_map(tilted).collect::<Result<_>>()?;
        let rings = RADII_MM.map(|r_mm| ring(&readings, r_mm));
        Ok(Self { case, rings, line: DepthLine::new(&readings)?, tilts, readings })
    }

    /// Dots recovered, of those that lie wholly on the sensor, in the frames that `wanted` picks.
    pub fn found(&self, wanted: impl Fn(&Reading) -> bool) -> [usize; 2] {
        let readings = self.readings.iter().filter(|reading| wanted(reading));
        readings.fold([0, 0], |[found, whole], reading| [found + reading.whole_found(), whole + reading.whole.len()])
    }

    /// Points of all frames that are no dot.
    pub fn strays(&self) -> usize {
        self.readings.iter().map(|reading| reading.strays_mm.len()).sum()
    }

    /// Standard deviation of the depths of the plate across the axis about the mean of their distance, mm, over dots
    /// at least `r_mm` from the axis.
    pub fn plate_scatter_mm(&self, r_mm: f64) -> f64 {
        let plates = self.readings.iter().filter(|reading| reading.experiment == Experiment::Plate);
        let deviations = |reading: &Reading| {
            let clear = reading.dots.iter().filter(|dot| dot.radius_mm() >= r_mm);
            let depths_mm: Vec<f64> = clear.map(|dot| dot.found_mm[2]).collect();
            let mean_mm = mean(&depths_mm);
            depths_mm.into_iter().map(move |z_mm| z_mm - mean_mm).collect::<Vec<_>>()
        };
        rms(&plates.flat_map(deviations).collect::<Vec<_>>())
    }
}
