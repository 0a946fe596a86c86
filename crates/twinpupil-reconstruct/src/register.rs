//! What was measured on the page of a band, in pixels of the ideal image plane: as an ideal lens would show it on the
//! reference frame, across the axis.

use std::f64::consts::PI;

use twinpupil_instrument::{Page, PixelPoint, Sensor};

use crate::detect::{Detection, Feature};

/// The way between the page of a band and the ideal image plane.
#[derive(Debug, Clone)]
pub(crate) struct Register {
    sensor: Sensor,
    page: Page,
    /// Whether pages are read as they lie.
    is_identity: bool,
}

impl Register {
    pub(crate) fn new(sensor: &Sensor, page: Page) -> Self {
        // Closer than this to the sensor's own pixels is rounding.
        const SAME_PX: f64 = 1e-9;
        let [u, v] = sensor.axis_px;
        let is_identity = page.raster().is_some_and(|(axis, pitch_mm)| {
            (axis.u - u).abs() + (axis.v - v).abs() < SAME_PX && (pitch_mm / sensor.pitch_mm - 1.0).abs() < SAME_PX
        });
        Self { sensor: sensor.clone(), page, is_identity }
    }

    /// The page.
    pub(crate) fn page(&self) -> &Page {
        &self.page
    }

    /// Whether pages are read as they lie.
    pub(crate) fn is_identity(&self) -> bool {
        self.is_identity
    }

    /// Moves everything that was found onto the ideal image plane; positions go through the page's map, areas and
    /// deviations through its slope.
    pub(crate) fn onto_image_plane(&self, detection: &mut Detection) {
        if self.is_identity {
            return;
        }
        let features = detection.features.iter_mut();
        for feature in features.chain(detection.rejected.iter_mut().map(|bystander| &mut bystander.feature)) {
            *feature = self.mapped(feature);
        }
        detection
            .features
            .sort_unstable_by(|a, b| a.centre.v.total_cmp(&b.centre.v).then(a.centre.u.total_cmp(&b.centre.u)));
    }

    /// A centre and its deviations along u and v on the ideal image plane.
    pub(crate) fn mapped_centre(&self, centre: PixelPoint, std_px: [f64; 2]) -> (PixelPoint, [f64; 2]) {
        if self.is_identity {
            return (centre, std_px);
        }
        let slope = self.page.mm_per_px(centre).map(|row| row.map(|entry| entry / self.sensor.pitch_mm));
        let std_px = slope.map(|[with_u, with_v]| (with_u * std_px[0]).hypot(with_v * std_px[1]));
        (self.sensor.pixel_from_image(self.page.to_image(centre)), std_px)
    }

    /// A feature of the ideal image plane as its page shows it.
    pub(crate) fn on_page(&self, feature: &Feature) -> Feature {
        if self.is_identity {
            return *feature;
        }
        let image = self.sensor.image_from_pixel(feature.centre);
        let centre = self.page.to_page(image);
        let area = self.area_px2(centre);
        Feature { centre, area_px: feature.area_px / area, edge_px: feature.edge_px / area.sqrt(), ..*feature }
    }

    /// Area on the ideal image plane of a pixel of the page, in pixels of the sensor.
    pub(crate) fn area_px2(&self, at: PixelPoint) -> f64 {
        if self.is_identity {
            return 1.0;
        }
        let [[a, b], [c, d]] = self.page.mm_per_px(at);
        (a * d - b * c).abs() / (self.sensor.pitch_mm * self.sensor.pitch_mm)
    }

    /// A feature of a page, whose centre is the middle of its light, on the ideal image plane.
    pub(crate) fn mapped(&self, feature: &Feature) -> Feature {
        let area = self.area_px2(feature.centre);
        // Of the light of a disc of radius a, blurred over one of radius b: a² + b².
        let spread_px2 = feature.area_px / PI + feature.edge_px * feature.edge_px;
        let spread_mm2 = spread_px2 * area * self.sensor.pitch_mm * self.sensor.pitch_mm;
        let [du, dv] = self.page.bend_px(self.page.to_image(feature.centre), [spread_mm2, 0.0, spread_mm2]);
        let middle = PixelPoint { u: feature.centre.u - du, v: feature.centre.v - dv };
        let (centre, centre_std_px) = self.mapped_centre(middle, feature.centre_std_px);
        Feature {
            centre,
            centre_std_px,
            area_px: feature.area_px * area,
            edge_px: feature.edge_px * area.sqrt(),
            ..*feature
        }
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{Instrument, Mosaic, Registration, paper};

    use super::*;

    #[test]
    fn a_quarter_turn_swaps_the_deviations() {
        let mut spec = paper::instrument().into_spec();
        spec.sensor.mosaic = Mosaic::Sensors;
        for (band, plane) in spec.bands.iter_mut().zip(["0", "1"]) {
            band.plane = plane.to_owned();
        }
        spec.bands[1].registration = Registration::from_rows([[0.0, -2.0, 100.0], [2.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
        let instrument = Instrument::new(spec).unwrap();
        let [plain, turned] =
            [0, 1].map(|band| Register::new(&instrument.sensor, instrument.page(&instrument.bands[band])));
        let feature = Feature {
            centre: PixelPoint { u: 3.0, v: 4.0 },
            centre_std_px: [0.1, 0.2],
            area_px: 50.0,
            height_codes: 1000.0,
            ground_codes: 0.0,
            edge_px: 4.0,
            overlapped: false,
            saturated: false,
        };
        assert!(plain.is_identity() && !turned.is_identity());
        let mapped = turned.mapped(&feature);
        assert!((mapped.centre.u - 92.0).abs() < 1e-9 && (mapped.centre.v - 6.0).abs() < 1e-9, "{mapped:?}");
        let [du, dv] = mapped.centre_std_px;
        assert!((du - 0.4).abs() < 1e-12 && (dv - 0.2).abs() < 1e-12);
        assert!((mapped.area_px - 200.0).abs() < 1e-9 && (mapped.edge_px - 8.0).abs() < 1e-12);
        let back = turned.on_page(&mapped);
        assert!(
            (back.centre.u - 3.0).abs() < 1e-9
                && (back.centre.v - 4.0).abs() < 1e-9
                && (back.area_px - 50.0).abs() < 1e-9
        );
    }
}
