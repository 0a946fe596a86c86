//! Dots on the places of a grid, as many in one scene as find room beside each other.

use std::f64::consts::PI;

use anyhow::Result;
use twinpupil_instrument::{Instrument, PixelPoint, Role};
use twinpupil_simulate::{DotSpec, Scene, SceneSpec};

use super::Grid;

/// Ground around the image of a dot that no other's image may reach, px.
const MARGIN_PX: f64 = 10.0;

/// Azimuths tried for a dot before it goes on another sheet.
const ATTEMPTS: usize = 60;

/// The golden angle, π (3 − √5): multiples of it come nowhere near each other for long.
const GOLDEN_RAD: f64 = PI * (3.0 - 2.236_067_977_499_79);

/// What all dots have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DotKind {
    /// Diameter, mm.
    pub diameter_mm: f64,
    /// Electrons of a dot in a pixel that sees the whole pupil.
    pub brightness_e: f64,
    /// Electrons of the ground.
    pub background_e: f64,
}

/// A place of the grid: indices of its depth and of its distance from the axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// Which depth.
    pub z: usize,
    /// Which distance from the axis.
    pub r: usize,
}

/// A dot of a sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SheetDot {
    /// The place that it stands for.
    pub place: Place,
    /// Where it is, mm.
    pub centre_mm: [f64; 3],
    /// Its images in the telecentric and the entocentric band.
    pub images: [Spot; 2],
}

/// A disc on the frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Its centre.
    pub centre: PixelPoint,
    /// Its radius, blur included, px.
    pub radius_px: f64,
}

/// Dots at one depth, none of which touches another on the frame.
#[derive(Debug, Clone)]
pub struct Sheet {
    /// The dots, in the order of the scene's.
    pub dots: Vec<SheetDot>,
    /// The same as a scene.
    pub scene: Scene,
}

impl Spot {
    /// Whether a position lies on it.
    pub fn covers(&self, position: PixelPoint) -> bool {
        self.distance_px(position) <= self.radius_px
    }

    /// Distance of a position from its centre, px.
    pub fn distance_px(&self, position: PixelPoint) -> f64 {
        (position.u - self.centre.u).hypot(position.v - self.centre.v)
    }

    fn touches(&self, other: &Self) -> bool {
        self.distance_px(other.centre) < self.radius_px + other.radius_px + 2.0 * MARGIN_PX
    }

    fn is_within(&self, size_px: [usize; 2]) -> bool {
        let reach_px = self.radius_px + 1.0;
        let within = |at_px: f64, size_px: usize| at_px >= reach_px && at_px + reach_px <= size_px as f64 - 1.0;
        within(self.centre.u, size_px[0]) && within(self.centre.v, size_px[1])
    }
}

impl SheetDot {
    /// A dot on an azimuth, to first order.
    fn new(instrument: &Instrument, place: Place, [r_mm, z_mm]: [f64; 2], azimuth_rad: f64, diameter_mm: f64) -> Self {
        let centre_mm = [r_mm * azimuth_rad.cos(), r_mm * azimuth_rad.sin(), z_mm];
        let images = [Role::Telecentric, Role::Entocentric].map(|role| {
            let band = instrument.band(role);
            let (projection, page) = (instrument.projection(band), instrument.page(band));
            let image = projection.image(centre_mm);
            let [[a, b], [c, d]] = page.px_per_mm(image);
            let radius_mm = 0.5 * diameter_mm * projection.magnification(z_mm).abs() + projection.blur_radius_mm(z_mm);
            Spot { centre: page.to_page(image), radius_px: radius_mm * (a * d - b * c).abs().sqrt() }
        });
        Self { place, centre_mm, images }
    }

    /// Its azimuth about the optical axis.
    pub fn azimuth_rad(&self) -> f64 {
        self.centre_mm[1].atan2(self.centre_mm[0])
    }

    fn touches(&self, other: &Self) -> bool {
        self.images.iter().zip(&other.images).any(|(own, its)| own.touches(its))
    }
}

impl Sheet {
    /// Sheets that hold `copies` dots for every place of which some azimuth is on the sensor.
    pub fn all(instrument: &Instrument, grid: &Grid, kind: &DotKind, copies: usize) -> Result<Vec<Self>> {
        let depths = 0..grid.z_mm.len();
        let sheets = depths.flat_map(|z| sheets_at(instrument, grid, z, kind.diameter_mm, copies));
        sheets.map(|dots| Self::new(dots, kind)).collect()
    }

    fn new(dots: Vec<SheetDot>, kind: &DotKind) -> Result<Self> {
        let DotKind { diameter_mm, brightness_e, background_e } = *kind;
        let spec = |dot: &SheetDot| {
            let [x_mm, y_mm, z_mm] = dot.centre_mm;
            DotSpec { x_mm, y_mm, z_mm, diameter_mm }
        };
        let scene = Scene::new(SceneSpec {
            schema: 1,
            name: "precision".to_owned(),
            seed: 0,
            background_e,
            brightness_e,
            illumination: None,
            dots: dots.iter().map(spec).collect(),
            plate: None,
        })?;
        Ok(Self { dots, scene })
    }
}

/// The dots of the sheets at one depth. Outer dots, which have the fewest azimuths, are placed first.
fn sheets_at(instrument: &Instrument, grid: &Grid, z: usize, diameter_mm: f64, copies: usize) -> Vec<Vec<SheetDot>> {
    let mut sheets: Vec<Vec<SheetDot>> = Vec::new();
    let mut turns = 0;
    for r in (0..grid.r_mm.len()).rev() {
        for _ in 0..copies {
            let at = [grid.r_mm[r], grid.z_mm[z]];
            let seen: Vec<SheetDot> = (turns..turns + ATTEMPTS)
                .map(|turn| SheetDot::new(instrument, Place { z, r }, at, turn as f64 * GOLDEN_RAD, diameter_mm))
                .filter(|dot| dot.images.iter().all(|image| image.is_within(instrument.sensor.size_px)))
                .collect();
            let Some(first) = seen.first() else { break };
            let free =
                |sheet: &Vec<SheetDot>| seen.iter().copied().find(|dot| !sheet.iter().any(|other| other.touches(dot)));
            match sheets.iter_mut().find_map(|sheet| free(sheet).map(|dot| (sheet, dot))) {
                Some((sheet, dot)) => sheet.push(dot),
                None => sheets.push(vec![*first]),
            }
            turns += 1;
        }
    }
    sheets
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::paper;

    use super::*;

    const KIND: DotKind = DotKind { diameter_mm: 1.0, brightness_e: 20_000.0, background_e: 0.0 };

    #[test]
    fn every_place_in_sight_has_its_dots_and_none_touch() {
        let instrument = paper::instrument();
        let grid = Grid { z_mm: vec![250.0, 350.0], r_mm: vec![1.0, 4.0, 7.5, 30.0] };
        let sheets = Sheet::all(&instrument, &grid, &KIND, 5).unwrap();
        for z in 0..2 {
            for (r, expected) in [5, 5, 5, 0].into_iter().enumerate() {
                let dots = sheets.iter().flat_map(|sheet| &sheet.dots).filter(|dot| dot.place == Place { z, r });
                assert_eq!(dots.count(), expected, "{z} {r}");
            }
        }
        for sheet in &sheets {
            assert_eq!(sheet.dots.len(), sheet.scene.dots().len());
            for (i, dot) in sheet.dots.iter().enumerate() {
                assert!(sheet.dots[..i].iter().all(|other| !other.touches(dot)));
                assert_eq!(sheet.scene.dots()[i].centre_mm, dot.centre_mm);
                assert!((dot.centre_mm[0].hypot(dot.centre_mm[1]) - grid.r_mm[dot.place.r]).abs() < 1e-12);
            }
        }
        // Five inner dots do not fit round the axis at once.
        assert!(sheets.len() > 2);
    }
}
