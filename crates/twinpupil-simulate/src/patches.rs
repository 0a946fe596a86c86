//! What a lens does to rays, patch by patch of the sensor.

use std::sync::OnceLock;

use twinpupil_optics::RayMap;

/// Squares of pixels, each with the rays from it as polynomials, once they are asked for.
#[derive(Debug)]
pub(crate) struct Patches {
    across: usize,
    size_px: [usize; 2],
    maps: Vec<OnceLock<Option<RayMap>>>,
}

impl Patches {
    /// Side of a square, px: small enough that few terms follow the lens, and large enough that a map serves many pixels.
    const SIDE_PX: usize = 64;

    /// Those of a sensor.
    pub(crate) fn new(size_px: [usize; 2]) -> Self {
        let [across, down] = size_px.map(|size| size.div_ceil(Self::SIDE_PX));
        Self { across, size_px, maps: (0..across * down).map(|_| OnceLock::new()).collect() }
    }

    /// The rays from the square of a pixel, which `make` finds for a rectangle by its first pixel and its size; `None` where
    /// they are no polynomials.
    pub(crate) fn around(
        &self,
        pixel: [usize; 2],
        make: impl FnOnce([usize; 2], [usize; 2]) -> Option<RayMap>,
    ) -> Option<&RayMap> {
        let [column, row] = pixel.map(|place| place / Self::SIDE_PX);
        let make = || {
            let first = [column, row].map(|place| place * Self::SIDE_PX);
            make(first, [0, 1].map(|axis| Self::SIDE_PX.min(self.size_px[axis] - first[axis])))
        };
        self.maps.get(row * self.across + column)?.get_or_init(make).as_ref()
    }
}
