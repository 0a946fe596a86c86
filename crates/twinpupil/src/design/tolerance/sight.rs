//! Where a camera shows points, and which point it takes images for.

use std::f64::consts::PI;

use anyhow::Result;
use twinpupil_calibrate::Shown;
use twinpupil_instrument::{ImagePoint, Instrument, Page, PixelPoint, Projection};
use twinpupil_optics::Camera;
use twinpupil_reconstruct::ChiefRays;

/// A camera and where it shows points: the middle of all light that comes through its lens and its masks. Grooves of Fresnel
/// lenses count as infinitely fine: an average over some rays jumps by tenths of a pixel where one of them meets a wall.
#[derive(Debug, Clone)]
pub struct Sight {
    camera: Camera,
    pages: Vec<Page>,
    projections: Vec<Projection>,
    size_px: [usize; 2],
    pitch_mm: f64,
}

/// Light that leaks from bands into the planes of others, and what it does to the images of dots.
#[derive(Debug, Clone, Copy)]
pub struct Leak<'a> {
    /// Signal in every plane from unit light of every other band.
    pub matrix: &'a [Vec<f64>],
    /// Diameter of the dots, mm.
    pub dot_diameter_mm: f64,
}

/// Throughput of a point's light below which its dot is not found.
const THROUGHPUT_MIN: f64 = 0.05;

impl Sight {
    /// Of an instrument.
    pub fn new(instrument: &Instrument) -> Result<Self> {
        let bands = &instrument.bands;
        Ok(Self {
            camera: Camera::new(instrument)?.smoothed(),
            pages: bands.iter().map(|band| instrument.page(band)).collect(),
            projections: bands.iter().map(|band| instrument.projection(band)).collect(),
            size_px: instrument.sensor.size_px,
            pitch_mm: instrument.sensor.pitch_mm,
        })
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.pages.len()
    }

    /// How the page of a band shows a point; `None` where too little of its light comes through.
    pub fn shown(&self, band: usize, object_mm: [f64; 3]) -> Option<Shown> {
        let (image, blur_px) = self.image(band, object_mm)?;
        Some(Shown { centre: self.pages[band].to_page(image), blur_px })
    }

    /// Where a band images a point, mm from the axis, and the radius of its blur, px.
    fn image(&self, band: usize, object_mm: [f64; 3]) -> Option<(ImagePoint, f64)> {
        let image = self.camera.bands()[band].quick_point_image(object_mm);
        let projection = &self.projections[band];
        let ideal_mm = -projection.pupil_radius_mm * projection.chief(object_mm[2]).shift;
        let blur_px = (ideal_mm + image.spread.growth_mm) / self.pitch_mm;
        (image.throughput > THROUGHPUT_MIN).then_some((image.centroid, blur_px))
    }

    /// How the pages of all bands show a dot, if all of them do.
    ///
    /// A ghost of the dot in another band's light, as far as it lies over the dot's own image, is measured with it and draws
    /// the middle of its light after it: by its share of the light, the leak, times the overlap of two discs that far apart,
    /// as wide as the dot and half of its blur on both sides. So centroids are drawn, to a tenth where the discs overlap by
    /// half and to a factor of two where they hardly do, as simulated frames show; a fit of pixels is drawn less.
    pub fn dot(&self, object_mm: [f64; 3], leak: &Leak<'_>) -> Option<Vec<Shown>> {
        let images: Vec<(ImagePoint, f64)> =
            (0..self.bands()).map(|band| self.image(band, object_mm)).collect::<Option<_>>()?;
        let drawn = |band: usize| {
            let ((own, blur_px), mut image) = (images[band], images[band].0);
            let magnification = self.projections[band].magnification(object_mm[2]).abs();
            let width_mm = leak.dot_diameter_mm * magnification + blur_px.abs() * self.pitch_mm;
            for ((ghost, _), share) in images.iter().zip(&leak.matrix[band]).filter(|(_, share)| **share != 0.0) {
                let [dx, dy] = [ghost.x_mm - own.x_mm, ghost.y_mm - own.y_mm];
                let drawn = share * overlap(dx.hypot(dy) / width_mm);
                image.x_mm += drawn * dx;
                image.y_mm += drawn * dy;
            }
            Shown { centre: self.pages[band].to_page(image), blur_px }
        };
        let shown: Vec<Shown> = (0..self.bands()).map(drawn).collect();
        shown.iter().all(|shown| self.is_on_page(&shown.centre)).then_some(shown)
    }

    fn is_on_page(&self, centre: &PixelPoint) -> bool {
        let within = |place: f64, size: usize| (0.0..=(size - 1) as f64).contains(&place);
        within(centre.u, self.size_px[0]) && within(centre.v, self.size_px[1])
    }
}

/// Share of a disc that another of its size covers, their middles `apart` diameters from each other.
fn overlap(apart: f64) -> f64 {
    // A lens of two circular segments.
    if apart < 1.0 { 2.0 / PI * (apart.acos() - apart * (1.0 - apart * apart).sqrt()) } else { 0.0 }
}

/// A camera that takes images for points.
#[derive(Debug, Clone)]
pub struct Reader {
    sight: Sight,
    chief: ChiefRays,
}

impl Reader {
    /// That reads as an instrument says.
    pub fn new(instrument: &Instrument) -> Result<Self> {
        Ok(Self { sight: Sight::new(instrument)?, chief: ChiefRays::new(instrument) })
    }

    /// The point that the instrument would show there in all bands.
    ///
    /// What lens and masks add to chief rays at the point found so far is taken off the images before the chief rays are
    /// followed again, until that moves it no more: the inverse of the forward model, without a table between.
    pub fn position_mm(&self, pixels: &[PixelPoint], start_mm: [f64; 3]) -> Option<[f64; 3]> {
        const ROUNDS: usize = 60;
        const RESTING_MM: f64 = 1e-6;
        const DAMPED: f64 = 0.5;
        let Sight { camera, pages, projections, .. } = &self.sight;
        let images: Vec<ImagePoint> = pages.iter().zip(pixels).map(|(page, pixel)| page.to_image(*pixel)).collect();
        let (mut object_mm, mut before_mm) = (start_mm, f64::INFINITY);
        for _ in 0..ROUNDS {
            let chief = |(band, image): (usize, &ImagePoint)| {
                let whole = camera.bands()[band].quick_point_image(object_mm).centroid;
                let first_order = projections[band].image(object_mm);
                ImagePoint {
                    x_mm: image.x_mm - (whole.x_mm - first_order.x_mm),
                    y_mm: image.y_mm - (whole.y_mm - first_order.y_mm),
                }
            };
            let chief: Vec<ImagePoint> = images.iter().enumerate().map(chief).collect();
            let next_mm = self.chief.position_mm(&chief)?;
            let step: [f64; 3] = std::array::from_fn(|k| next_mm[k] - object_mm[k]);
            let step_mm = step.iter().map(|mm| mm * mm).sum::<f64>().sqrt();
            if step_mm < RESTING_MM {
                return Some(next_mm);
            }
            // Where masks bend the image a step may lead too far.
            let share = if step_mm > DAMPED * before_mm { DAMPED } else { 1.0 };
            object_mm = std::array::from_fn(|k| object_mm[k] + share * step[k]);
            before_mm = step_mm;
        }
        None
    }
}

#[cfg(test)]
pub(super) mod tests {
    use twinpupil_instrument::paper;

    use super::*;

    #[test]
    fn a_camera_reads_what_it_shows() {
        let mut spec = paper::instrument().into_spec();
        spec.sensor.tilt_deg = [0.3, -0.2];
        spec.apertures[1].centre_mm = [0.05, 0.02];
        let instrument = Instrument::new(spec).unwrap();
        let (sight, reader) = (Sight::new(&instrument).unwrap(), Reader::new(&instrument).unwrap());
        let leak = Leak { matrix: &[vec![0.0; 2], vec![0.0; 2]], dot_diameter_mm: 1.0 };
        // The first one is clipped.
        for object_mm in [[1.6, 1.0, 260.0], [4.0, -3.0, 255.0], [-3.0, 2.0, 340.0]] {
            let centres: Vec<PixelPoint> =
                sight.dot(object_mm, &leak).unwrap().iter().map(|shown| shown.centre).collect();
            let found_mm = reader.position_mm(&centres, [object_mm[0], object_mm[1], object_mm[2] + 3.0]).unwrap();
            let off_mm = (0..3).map(|k| (found_mm[k] - object_mm[k]).abs()).fold(0.0, f64::max);
            assert!(off_mm < 1e-4, "{found_mm:?} {object_mm:?}");
        }
        assert_eq!(sight.dot([0.0, 0.0, 300.0], &leak), None);
        assert_eq!(sight.dot([50.0, 0.0, 300.0], &leak), None);
    }

    /// The paper's camera behind a Fresnel lens, as such or surface by surface.
    pub(in super::super) fn grooved(lens: &str, entocentric_mm: f64) -> Instrument {
        let (before, rest) = paper::INSTRUMENT_TOML.split_once("[lens]").unwrap();
        let (_, behind) = rest.split_once("[sensor]").unwrap();
        let behind = behind.replacen("position_mm = 0.0", &format!("position_mm = {entocentric_mm}"), 1);
        Instrument::from_toml(&format!("{before}[lens]\n{lens}\n[sensor]{behind}")).unwrap()
    }

    pub(in super::super) const FRESNEL: &str = "model = \"fresnel\"\nfocal_length_mm = 100.0\n";
    pub(in super::super) const FACETS: &str = r#"
model = "prescription"
[[lens.prescription.surface]]
shape = { kind = "facets", focal_length_mm = 100.0, pitch_mm = 0.25, draft_deg = 3.0 }
gap_mm = 2.0
medium = "pmma"
half_size_mm = [38.5, 38.5]
[[lens.prescription.surface]]
half_size_mm = [38.5, 38.5]
"#;

    #[test]
    fn images_behind_grooves_move_evenly() {
        const STEP_MM: f64 = 0.01;
        for instrument in [grooved(FRESNEL, 1.0), grooved(FACETS, 2.0)] {
            let sight = Sight::new(&instrument).unwrap();
            for (band, z_mm) in [(0, 260.0), (0, 330.0), (1, 260.0), (1, 330.0)] {
                let place = |k: i32| {
                    let shown = sight.shown(band, [5.0 + STEP_MM * f64::from(k), 1.0, z_mm]).unwrap();
                    [shown.centre.u, shown.centre.v, shown.blur_px]
                };
                for k in 0..200 {
                    let [before, here, behind] = [-1, 0, 1].map(|step| place(k + step));
                    for n in 0..3 {
                        let bend_px = before[n] - 2.0 * here[n] + behind[n];
                        assert!(bend_px.abs() < 1e-3, "{:?} {band} {z_mm} {k} {n}: {bend_px}", instrument.lens);
                    }
                }
            }
        }
    }

    #[test]
    fn a_ghost_draws_by_its_share_where_it_covers_the_dot() {
        assert_eq!((overlap(0.0), overlap(1.0), overlap(2.0)), (1.0, 0.0, 0.0));
        // Discs one radius apart: (2π/3 − √3/2)/π.
        assert!((overlap(0.5) - (2.0 / 3.0 - 3.0_f64.sqrt() / (2.0 * PI))).abs() < 1e-12);
        let instrument = paper::instrument();
        let sight = Sight::new(&instrument).unwrap();
        let object_mm = [0.0, 6.0, 310.0];
        let shown = |share: f64| {
            let matrix = [vec![0.0, share], vec![0.0, 0.0]];
            sight.dot(object_mm, &Leak { matrix: &matrix, dot_diameter_mm: 1.0 }).unwrap()
        };
        let (clean, drawn) = (shown(0.0), shown(0.01));
        let apart_px = clean[1].centre.v - clean[0].centre.v;
        let wide_px = 0.51 / instrument.sensor.pitch_mm + clean[0].blur_px.abs();
        let expected_px = 0.01 * overlap(apart_px.abs() / wide_px) * apart_px;
        assert!((drawn[0].centre.v - clean[0].centre.v - expected_px).abs() < 1e-9 && drawn[1] == clean[1]);
    }
}
