//! Why the columns differ: sentences whose every number comes from the run.

use serde::Serialize;
use twinpupil_instrument::{Instrument, Projection};
use twinpupil_optics::Camera;

use super::comparison::signed;
use super::published;
use super::rig::fresnel_instrument;
use super::rings::RingDepth;
use super::statistics::spread;
use super::study::{CaseStudy, Study};

/// What a row is explained by; its number in the table is its place in this list, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Explanation {
    /// The masks clip each other's pupils near the axis.
    Clipping,
    /// The focal length differs between the bands.
    Dispersion,
    /// Dots that are not recovered.
    Lost,
    /// What the line of Fig. 10 is made of.
    Line,
    /// What the simulation is that the paper compares with.
    Simulation,
    /// What scatters the depths.
    Scatter,
    /// What bends the tilts.
    Tilt,
}

/// One explanation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Note {
    /// Which.
    pub explanation: Explanation,
    /// One or two sentences.
    pub text: String,
}

impl Explanation {
    /// All, in the order in which the table first refers to them.
    pub const ALL: [Self; 7] =
        [Self::Clipping, Self::Dispersion, Self::Lost, Self::Line, Self::Simulation, Self::Scatter, Self::Tilt];

    /// Its number in the table.
    pub fn number(self) -> usize {
        1 + self as usize
    }

    fn text(self, study: &Study) -> String {
        match self {
            Self::Clipping => clipping(study),
            Self::Dispersion => dispersion(study),
            Self::Lost => lost(study),
            Self::Line => line(study),
            Self::Simulation => SIMULATION.to_owned(),
            Self::Scatter => scatter(study),
            Self::Tilt => tilt(study),
        }
    }
}

impl Note {
    /// Every explanation of a study.
    pub fn all(study: &Study) -> Vec<Self> {
        Explanation::ALL.map(|explanation| Self { explanation, text: explanation.text(study) }).into()
    }
}

const SIMULATION: &str = "The simulation is the thin-lens column: its mean depth at each distance. The paper's text does \
    not define its own more closely.";

fn clipping(study: &Study) -> String {
    let [inner, outer] = &study.thin_paper.rings;
    let [nearest, farthest] = ends(inner).map(|depth| signed(error_mm(depth), 2));
    format!(
        "The two masks clip each other's pupils near the axis and move the centroids of defocused dots. Seen alone in \
         the thin lens, which has neither dispersion nor a profile: r = 2.0 is off by {nearest} mm at the near end and \
         {farthest} mm at the far end, r = 7.5 by at most {:.2} mm. Inverting the forward model leaves at most {:.2} mm \
         at r = 2.0 behind the Fresnel lens.",
        largest_mm(outer),
        largest_mm(&study.fresnel_model.rings[0]),
    )
}

fn dispersion(study: &Study) -> String {
    let outer = &study.fresnel_paper.rings[1];
    let [near, far] = ends(outer);
    let predicted_mm = |depth: RingDepth| dispersed_depth_mm(depth.true_z_mm).map_or(f64::NAN, |z| z - depth.true_z_mm);
    format!(
        "PMMA makes the focal length {} mm in red where the data sheet's 100 mm is used; to first order that alone \
         shifts depth by {} mm at the near end and {} mm at the far end. Found at r = 7.5, clear of clipping: {} and {} \
         mm; the rest, {} and {} mm, includes the lens's profile and thickness.",
        red_focal_length_mm().map_or("?".to_owned(), |f_mm| format!("{f_mm:.2}")),
        signed(predicted_mm(near), 2),
        signed(predicted_mm(far), 2),
        signed(error_mm(near), 2),
        signed(error_mm(far), 2),
        signed(error_mm(near) - predicted_mm(near), 2),
        signed(error_mm(far) - predicted_mm(far), 2),
    )
}

/// A dot that reaches the −x axis is split by the cut of the azimuth at ±π.
fn lost(study: &Study) -> String {
    let mut lost = 0;
    let mut on_cut = 0;
    for (paper, model) in study.fresnel_paper.readings.iter().zip(&study.fresnel_model.readings) {
        let by_paper = |dot: usize| paper.dots.iter().any(|located| located.dot == dot);
        for located in model.dots.iter().filter(|located| !by_paper(located.dot)) {
            let [x_mm, y_mm, _] = located.true_mm;
            lost += 1;
            on_cut += usize::from(x_mm < 0.0 && y_mm.abs() <= DOT_RADIUS_MM);
        }
    }
    let strays: usize = study.cases().iter().map(|case| case.strays()).sum();
    let cut = if lost == 0 {
        "The paper's equations lose no dot that the default finds.".to_owned()
    } else {
        format!(
            "Eq. 11 averages azimuths, which breaks where they jump from π to −π: {on_cut} of the {lost} dots that the \
             paper's equations lose and the default finds lie across the −x axis."
        )
    };
    format!("{cut} Points that are no dot, in all frames and columns: {strays}.")
}

/// Radius of the paper's dots, mm.
const DOT_RADIUS_MM: f64 = 0.5;

fn line(study: &Study) -> String {
    let [thin, fresnel] = [&study.thin_paper, &study.fresnel_paper].map(|case| case.line.largest_from_truth());
    format!(
        "Straight line through all points of all distances. With the thin lens clipping touches too few dots to move \
         it by more than {:.2} mm; the Fresnel lens's {} mm follow from dispersion, note {}. The published line lies \
         between the two, and the text does not say how f and L were determined.",
        thin.value_mm.abs(),
        signed(fresnel.value_mm, 2),
        Explanation::Dispersion.number(),
    )
}

fn scatter(study: &Study) -> String {
    let [thin, fresnel, model] = study.cases().map(|case| case.plate_scatter_mm(CLEAR_RADIUS_MM));
    format!(
        "Root mean square over all points, offsets included. Noise is not the limit: about the mean of its distance, \
         depth scatters by {thin:.3}, {fresnel:.3} and {model:.3} mm in the three columns, for dots at \
         r ≥ {CLEAR_RADIUS_MM} mm, which no mask clips."
    )
}

/// Radius from which no mask clips any part of a dot of 1 mm, mm: `instrument show paper` has 2.68 mm for points at
/// z = 350.
const CLEAR_RADIUS_MM: f64 = 3.2;

fn tilt(study: &Study) -> String {
    let least = |case: &CaseStudy| case.tilts.iter().map(|fit| fit.quality.r_squared).fold(f64::INFINITY, f64::min);
    let scatters = published::TILTS
        .iter()
        .map(|tilt| scatter_for(tilt.r_squared.value, tilt.fitted_deg.value, x_spread_mm(study, tilt.tilt_deg)));
    let (low, high) = scatters.fold((f64::INFINITY, 0.0_f64), |(low, high), s| (low.min(s), high.max(s)));
    format!(
        "The published R² of 0.62 to 0.89 mean depths that scatter by {low:.1} to {high:.1} mm about their line, if the \
         dots spread in x as here. Photon and read noise and clipping do not scatter them so much: the least R² here is \
         {:.4} by the paper's equations and {:.4} by the default. What scattered the paper's, its text does not say.",
        least(&study.thin_paper).min(least(&study.fresnel_paper)),
        least(&study.fresnel_model),
    )
}

/// Standard deviation of the x of a tilted plate's dots, mm.
fn x_spread_mm(study: &Study, tilt_deg: f64) -> f64 {
    let dots = super::tilt::of_tilt(&study.fresnel_model.readings, tilt_deg).map(|reading| &reading.dots);
    spread(&dots.into_iter().flatten().map(|dot| dot.true_mm[0]).collect::<Vec<_>>())
}

/// Scatter about a line of given tilt and R²: `R² = tan² θ σ_x² / (tan² θ σ_x² + σ²)`.
fn scatter_for(r_squared: f64, tilt_deg: f64, x_spread_mm: f64) -> f64 {
    tilt_deg.to_radians().tan() * x_spread_mm * ((1.0 - r_squared) / r_squared).sqrt()
}

/// Depth that the paper's equations give for a point at `z_mm` if the only flaw is that the focal length differs from
/// band to band, mm.
///
/// ```text
/// z' = L f/(L − f) · m_R(z; f_red) / m_B(z)       m: magnifications of the chief rays, see `Projection`
/// ```
pub fn dispersed_depth_mm(z_mm: f64) -> Option<f64> {
    let instrument = fresnel_instrument().ok()?;
    let [telecentric, entocentric] = instrument.projections();
    let telecentric = Projection { focal_length_mm: red_focal_length_mm()?, ..telecentric };
    let gamma = telecentric.magnification(z_mm) / entocentric.magnification(z_mm);
    Some(instrument.focus_distance_mm() * gamma)
}

/// Focal length of the Fresnel lens in the telecentric band, mm.
fn red_focal_length_mm() -> Option<f64> {
    let instrument: Instrument = fresnel_instrument().ok()?;
    let telecentric = instrument.band_index(twinpupil_instrument::Role::Telecentric);
    Some(Camera::new(&instrument).ok()?.bands()[telecentric].focal_length_mm())
}

/// The nearest and the farthest.
fn ends(depths: &[RingDepth]) -> [RingDepth; 2] {
    let none = RingDepth { r_mm: f64::NAN, true_z_mm: f64::NAN, mean_mm: f64::NAN, spread_mm: f64::NAN, dots: 0 };
    [depths.first(), depths.last()].map(|depth| depth.copied().unwrap_or(none))
}

fn error_mm(depth: RingDepth) -> f64 {
    depth.mean_mm - depth.true_z_mm
}

fn largest_mm(depths: &[RingDepth]) -> f64 {
    depths.iter().map(|&depth| error_mm(depth).abs()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dispersion_alone_costs_four_to_eight_millimetres() {
        // m_R = (L − d)/(d + z (1 − d/f)) with d = 100 and f = 100.64; m_B = L/z.
        for z_mm in [250.0, 350.0] {
            let by_hand = 296.0784 * 51.0 / (100.0 + z_mm * (1.0 - 100.0 / 100.64)) / (151.0 / z_mm);
            assert!((dispersed_depth_mm(z_mm).unwrap() - by_hand).abs() < 0.05);
        }
    }

    #[test]
    fn scatter_and_r_squared_are_two_sides() {
        // Slope 1, σ_x = 3, σ = 4: R² = 9/25.
        assert!((scatter_for(0.36, 45.0, 3.0) - 4.0).abs() < 1e-12);
    }

    #[test]
    fn explanations_are_numbered_in_order() {
        assert_eq!(Explanation::ALL.map(Explanation::number), [1, 2, 3, 4, 5, 6, 7]);
    }
}
