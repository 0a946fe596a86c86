//! The bands of an instrument as the adjustment sees them.

use twinpupil_instrument::{Instrument, LensTerms, Projection};

use crate::adjust::BandCamera;
use crate::forward::{CAMERA_SLOTS, Slot};

/// The bands of an instrument with these projections and what its lens adds to them; the target's dots are `diameter_scale` times as wide as stated.
pub(crate) fn cameras(
    instrument: &Instrument,
    projections: &[Projection],
    lens: &[LensTerms],
    diameter_scale: f64,
) -> Vec<BandCamera> {
    let camera = |((band, projection), lens): ((&twinpupil_instrument::Band, &Projection), &LensTerms)| {
        let mut slots = [0.0; CAMERA_SLOTS];
        let mut set = |slot: Slot, value: f64| slots[slot as usize] = value;
        let sensor = &instrument.sensor;
        set(Slot::SensorDistance, projection.sensor_distance_mm);
        set(Slot::FocalLength, projection.focal_length_mm);
        set(Slot::PupilPosition, projection.pupil_position_mm);
        set(Slot::PupilRadius, projection.pupil_radius_mm);
        set(Slot::PupilX, projection.pupil_centre_mm[0]);
        set(Slot::PupilY, projection.pupil_centre_mm[1]);
        set(Slot::AxisU, sensor.axis_px[0]);
        set(Slot::AxisV, sensor.axis_px[1]);
        let [tilt_u, tilt_v] = sensor.tilt_deg.map(|tilt_deg| tilt_deg.to_radians().tan());
        set(Slot::TiltU, tilt_u);
        set(Slot::TiltV, tilt_v);
        set(Slot::K1, band.distortion.k1_per_mm2);
        set(Slot::K2, band.distortion.k2_per_mm4);
        set(Slot::P1, band.distortion.p1_per_mm);
        set(Slot::P2, band.distortion.p2_per_mm);
        set(Slot::Diameter, diameter_scale);
        BandCamera::new(slots, band.registration.inverse().rows(), *lens, band.correction.clone())
    };
    instrument.bands.iter().zip(projections).zip(lens).map(camera).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Vector3};
    use twinpupil_instrument::{Correction, Distortion, Registration, paper};

    use super::*;
    use crate::forward::{SLOTS, Slots, View, spot};

    #[test]
    fn the_centre_of_a_small_facing_dot_is_where_the_instrument_says() {
        let mut spec = paper::instrument().into_spec();
        spec.sensor.tilt_deg = [1.5, -2.0];
        spec.sensor.mosaic = twinpupil_instrument::Mosaic::Sensors;
        for (index, band) in spec.bands.iter_mut().enumerate() {
            let k = 1.0 + index as f64;
            band.plane = index.to_string();
            band.distortion =
                Distortion { k1_per_mm2: 2e-5 * k, k2_per_mm4: -1e-7, p1_per_mm: 1e-5, p2_per_mm: -3e-5 * k };
            let mut correction = Correction::none(6.0, 4);
            (correction.x_mm[11], correction.y_mm[6]) = (1e-3 * k, -2e-3);
            band.correction = Some(correction);
        }
        spec.bands[1].registration =
            Registration::from_rows([[1.01, 0.03, 5.0], [-0.03, 1.01, 9.0], [1e-6, 2e-6, 1.0]]);
        spec.apertures[1].centre_mm = [0.05, -0.08];
        let instrument = Instrument::new(spec).unwrap();
        let projections: Vec<Projection> = instrument.bands.iter().map(|band| instrument.projection(band)).collect();
        for (index, camera) in cameras(&instrument, &projections, &[LensTerms::default(); 2], 1.0).iter().enumerate() {
            let band = &instrument.bands[index];
            for object_mm in [[3.0, -2.0, 260.0], [-4.0, 1.0, 335.0]] {
                let mut slots = Slots::zeros();
                slots.as_mut_slice()[..CAMERA_SLOTS].copy_from_slice(&camera.slots);
                slots.as_mut_slice()[SLOTS - 3..].copy_from_slice(&object_mm);
                let view = View {
                    target_mm: [0.0; 2],
                    diameter_mm: 1e-3,
                    rotation: Rotation3::new(Vector3::zeros()).into_inner(),
                    pitch_mm: instrument.sensor.pitch_mm,
                    page_from_reference: camera.page_from_reference,
                    lens: camera.lens,
                    displacement: camera.displacement.as_ref(),
                };
                let (found, _) = spot(&slots, &view);
                let expected = instrument.page(band).to_page(projections[index].image(object_mm));
                let off_px = (found.x - expected.u).hypot(found.y - expected.v);
                assert!(off_px < 1e-9, "{}: {found:?} {expected:?}", band.name);
            }
        }
    }
}
