//! A simulated camera on a bench: scenes in, points out.

use twinpupil_instrument::{Frame, Instrument, ResponseMatrix, Role};
use twinpupil_optics::response_table_for;
use twinpupil_reconstruct::{Mode, Options, Point, Reconstruction, Reconstructor};
use twinpupil_simulate::{
    Defects, DotSpec, Expectation, Scene, SceneSpec, SimulateOptions, expected_electrons, expose, simulate,
};

/// An instrument with a way to simulate and a way to read its frames.
#[derive(Debug)]
pub struct Rig {
    /// The camera.
    pub instrument: Instrument,
    pub(crate) response: ResponseMatrix,
    reconstructor: Reconstructor,
    /// Pixels of its sensor that do not answer to light.
    pub defects: Defects,
}

impl Rig {
    /// A rig that reads frames in a mode, knowing its lens exactly.
    ///
    /// # Panics
    /// If the instrument cannot be traced: rigs are built from instruments that can.
    pub fn new(instrument: Instrument, mode: Mode) -> Self {
        let response = instrument.response_matrix();
        Self::with_response(instrument, mode, response)
    }

    /// A rig whose sensor mixes the bands by a response that the reconstruction knows.
    ///
    /// # Panics
    /// If the instrument cannot be traced.
    pub fn with_response(instrument: Instrument, mode: Mode, response: ResponseMatrix) -> Self {
        let table = response_table_for(&instrument).expect("the instrument can be traced");
        let options = Options { mode, ..Options::default() };
        let reconstructor = Reconstructor::new(instrument.clone(), Some(table), options).unmixing(&response);
        Self { instrument, response, reconstructor, defects: Defects::default() }
    }

    /// A frame of a scene, noisy if there is a seed.
    ///
    /// # Panics
    /// If the scene cannot be simulated.
    pub fn frame(&self, scene: &Scene, noise_seed: Option<u64>) -> Frame {
        let options = SimulateOptions {
            noiseless: noise_seed.is_none(),
            seed: noise_seed,
            defects: self.defects,
            ..SimulateOptions::default()
        };
        simulate(&self.instrument, scene, &self.response, &options, &|_| {}).expect("the scene can be simulated").frame
    }

    /// The electrons that a scene brings to every pixel: exposed again and again it is the same scene.
    ///
    /// # Panics
    /// If the scene cannot be simulated.
    pub fn expectation(&self, scene: &Scene, pupil_samples: usize) -> Expectation {
        expected_electrons(&self.instrument, scene, &self.response, pupil_samples, &|_| {})
            .expect("the scene can be simulated")
    }

    /// A noisy frame of an expectation.
    ///
    /// # Panics
    /// If the expectation is not of this camera.
    pub fn exposed(&self, expectation: &Expectation, noise_seed: u64) -> Frame {
        let options = SimulateOptions { defects: self.defects, ..SimulateOptions::default() };
        expose(&self.instrument.sensor, expectation, &options, noise_seed).expect("an expectation of this camera")
    }

    /// All that a frame of this camera gives.
    ///
    /// # Panics
    /// If the frame is not of this camera.
    pub fn read(&self, frame: &Frame) -> Reconstruction {
        self.reconstructor.reconstruct(frame).expect("a frame of this camera")
    }

    /// Number of features of a frame in a band, measured or not.
    ///
    /// # Panics
    /// If the frame is not of this camera.
    pub fn detected(&self, frame: &Frame, band: usize) -> usize {
        let detection = self.reconstructor.detect_band(frame, band).expect("a frame of this camera");
        detection.features.len() + detection.rejected.len()
    }

    /// The points of a frame of this camera.
    ///
    /// # Panics
    /// If the frame is not of this camera.
    pub fn points(&self, frame: &Frame) -> Vec<Point> {
        self.read(frame).points
    }

    /// Whether a dot's image, blur included, lies on the sensor in both bands.
    pub fn sees_whole(&self, centre_mm: [f64; 3], diameter_mm: f64) -> bool {
        let sensor = &self.instrument.sensor;
        [Role::Telecentric, Role::Entocentric].into_iter().all(|role| {
            let band = self.instrument.band(role);
            let (projection, page) = (self.instrument.projection(band), self.instrument.page(band));
            let image = projection.image(centre_mm);
            let [[a, b], [c, d]] = page.px_per_mm(image);
            let radius_mm =
                0.5 * diameter_mm * projection.magnification(centre_mm[2]) + projection.blur_radius_mm(centre_mm[2]);
            let radius_px = radius_mm * (a * d - b * c).abs().sqrt();
            let within =
                |position: f64, size: usize| position >= radius_px && position + radius_px <= size as f64 - 1.0;
            let place = page.to_page(image);
            within(place.u, sensor.size_px[0]) && within(place.v, sensor.size_px[1])
        })
    }

    /// Whether the images of two dots, blur included, are apart in both bands.
    pub fn sees_apart(&self, a_mm: [f64; 3], b_mm: [f64; 3], diameter_mm: f64) -> bool {
        self.instrument.projections().iter().all(|projection| {
            let reach_mm =
                |z_mm: f64| 0.5 * diameter_mm * projection.magnification(z_mm) + projection.blur_radius_mm(z_mm);
            let (a, b) = (projection.image(a_mm), projection.image(b_mm));
            (a.x_mm - b.x_mm).hypot(a.y_mm - b.y_mm) > reach_mm(a_mm[2]) + reach_mm(b_mm[2])
        })
    }
}

/// Bright dots of 1 mm and 20 000 electrons that face the camera.
///
/// # Panics
/// If a dot is not legal.
pub fn dots(centres_mm: &[[f64; 3]]) -> Scene {
    let dot = |&[x_mm, y_mm, z_mm]: &[f64; 3]| DotSpec { x_mm, y_mm, z_mm, diameter_mm: 1.0 };
    Scene::new(SceneSpec {
        schema: 1,
        name: "dots".to_owned(),
        seed: 0,
        background_e: 0.0,
        brightness_e: 20_000.0,
        illumination: None,
        dots: centres_mm.iter().map(dot).collect(),
        plate: None,
    })
    .expect("legal dots")
}

/// The point nearest to a position across the axis, if one is within 0.3 mm.
pub fn nearest(points: &[Point], centre_mm: [f64; 3]) -> Option<&Point> {
    const REACH_MM: f64 = 0.3;
    nearest_of_all(points, centre_mm).filter(|point| distance_mm(point, centre_mm) < REACH_MM)
}

/// The point nearest to a position across the axis.
pub(crate) fn nearest_of_all(points: &[Point], centre_mm: [f64; 3]) -> Option<&Point> {
    points.iter().min_by(|a, b| distance_mm(a, centre_mm).total_cmp(&distance_mm(b, centre_mm)))
}

/// How far a point lies from a position across the axis.
fn distance_mm(point: &Point, [x_mm, y_mm, _]: [f64; 3]) -> f64 {
    (point.position_mm[0] - x_mm).hypot(point.position_mm[1] - y_mm)
}
