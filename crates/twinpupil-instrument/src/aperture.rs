//! Coaxial multi-wavelength apertures: concentric zones, each passing some of the bands.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One `[[aperture]]`: a flat mask across the axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Aperture {
    /// Distance behind the rear principal plane, mm; negative is in front of the lens. With `surface`, behind that.
    pub position_mm: f64,
    /// Surface of a lens that is given surface by surface, from 0, from whose vertex the position counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub surface: Option<usize>,
    /// From the centre outwards. Light outside the last radius is blocked; a last zone without a radius has no end.
    pub zones: Vec<Zone>,
    /// Centre of the zones off the axis, mm, in the object's x and y.
    #[serde(default, skip_serializing_if = "is_origin")]
    pub centre_mm: [f64; 2],
}

/// One concentric zone of an aperture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Zone {
    /// Outer radius, mm; only the last zone may leave it out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<f64>,
    /// Names of the bands that pass.
    pub pass: Vec<String>,
}

/// A ring of one aperture that passes a band: `inner_mm ≤ radius < outer_mm`, where the outer radius may be infinite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Annulus {
    /// Inner radius, mm.
    pub inner_mm: f64,
    /// Outer radius, mm.
    pub outer_mm: f64,
}

impl Aperture {
    /// The rings that pass `band`, from the centre outwards, adjacent zones merged.
    pub fn annuli(&self, band: &str) -> Vec<Annulus> {
        let mut rings: Vec<Annulus> = Vec::new();
        let mut inner_mm = 0.0;
        for zone in &self.zones {
            let outer_mm = zone.radius_mm.unwrap_or(f64::INFINITY);
            if zone.pass.iter().any(|name| name == band) {
                match rings.last_mut() {
                    Some(ring) if ring.outer_mm == inner_mm => ring.outer_mm = outer_mm,
                    _ => rings.push(Annulus { inner_mm, outer_mm }),
                }
            }
            inner_mm = outer_mm;
        }
        rings
    }
}

impl Aperture {
    /// The mask as an image of it appears, elsewhere and in another size.
    pub(crate) fn imaged(&self, position_mm: f64, scale: f64) -> Self {
        let zone = |zone: &Zone| Zone { radius_mm: zone.radius_mm.map(|mm| mm * scale), pass: zone.pass.clone() };
        Self {
            position_mm,
            surface: None,
            zones: self.zones.iter().map(zone).collect(),
            centre_mm: self.centre_mm.map(|mm| mm * scale),
        }
    }
}

fn is_origin(centre_mm: &[f64; 2]) -> bool {
    *centre_mm == [0.0, 0.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn zone(radius_mm: Option<f64>, pass: &[&str]) -> Zone {
        Zone { radius_mm, pass: pass.iter().map(ToString::to_string).collect() }
    }

    #[test]
    fn adjacent_zones_merge_and_the_last_may_be_open() {
        let mask = Aperture {
            position_mm: 0.0,
            surface: None,
            zones: vec![zone(Some(1.0), &["a"]), zone(Some(2.0), &["a", "b"]), zone(None, &["b"])],
            centre_mm: [0.0, 0.0],
        };
        assert_eq!(mask.annuli("a"), [Annulus { inner_mm: 0.0, outer_mm: 2.0 }]);
        assert_eq!(mask.annuli("b"), [Annulus { inner_mm: 1.0, outer_mm: f64::INFINITY }]);
        assert_eq!(mask.annuli("c"), []);
    }
}
