//! What was measured on a sensor of a band's own, in pixels of the reference frame.

use twinpupil_instrument::{PixelPoint, Registration};

use crate::detect::{Detection, Feature};

/// Moves everything that was found onto the reference frame; positions go through the homography, areas and deviations
/// through its slope.
pub(crate) fn onto_reference(detection: &mut Detection, registration: &Registration) {
    if registration.is_identity() {
        return;
    }
    let features = detection.features.iter_mut();
    for feature in features.chain(detection.rejected.iter_mut().map(|bystander| &mut bystander.feature)) {
        *feature = mapped(feature, registration);
    }
    detection.features.sort_by(|a, b| a.centre.v.total_cmp(&b.centre.v).then(a.centre.u.total_cmp(&b.centre.u)));
}

fn mapped(feature: &Feature, registration: &Registration) -> Feature {
    let area = registration.area_px2(feature.centre);
    let (centre, centre_std_px) = mapped_centre(feature.centre, feature.centre_std_px, registration);
    Feature {
        centre,
        centre_std_px,
        area_px: feature.area_px * area,
        edge_px: feature.edge_px * area.sqrt(),
        ..*feature
    }
}

/// A centre and its deviations along u and v on the reference frame.
pub(crate) fn mapped_centre(
    centre: PixelPoint,
    std_px: [f64; 2],
    registration: &Registration,
) -> (PixelPoint, [f64; 2]) {
    let slope = registration.jacobian(centre);
    (registration.map(centre), slope.map(|[with_u, with_v]| (with_u * std_px[0]).hypot(with_v * std_px[1])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_swaps_the_deviations() {
        let turn = Registration::from_rows([[0.0, -2.0, 100.0], [2.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
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
        let mapped = mapped(&feature, &turn);
        assert_eq!(mapped.centre, PixelPoint { u: 92.0, v: 6.0 });
        assert_eq!((mapped.centre_std_px, mapped.area_px, mapped.edge_px), ([0.4, 0.2], 200.0, 8.0));
    }
}
