"""Records what Optiland says of wavefronts, foci and contrast of lenses in `tests/lenses`.

    python tests/published/record_images.py > tests/published/optiland-images.csv

optiland 0.6.3, from this crate's folder, with rays aimed at the stop one by one. What it prints is compared with, never
renewed to make a test pass.
"""

import sys
import tomllib

import numpy as np
from optiland.analysis import FieldCurvature
from optiland.distribution import BaseDistribution
from optiland.mtf import FFTMTF
from optiland.wavefront import Wavefront

from record import optiland_lens

# Diameter of the entrance pupil, largest field in degrees, wavelengths, the primary one first.
LENSES = {
    "cooke-triplet": (10.0, 20.0, (550.0, 480.0, 650.0)),
    "double-gauss": (33.0, 10.0, (587.6, 486.1, 656.3)),
}
FIELDS = (0.0, 0.7, 1.0)
PLACES = ((0.0, -1.0), (0.0, -0.5), (0.0, 0.3), (0.0, 0.7), (0.0, 1.0), (0.5, 0.0), (1.0, 0.0), (0.6, -0.6))
CYCLES_PER_MM = (10.0, 25.0, 50.0, 100.0, 200.0)
GRID = 256
# Rays across the pupil and places across the image, and how much of that is summed up.
SUM_RAYS, SUM_PLACES, SUM_MM = 200, 512, 0.4


class Grid(BaseDistribution):
    def generate_points(self, num_points=None):
        pass


class Places(BaseDistribution):
    def generate_points(self, num_points=None):
        self.x, self.y = (np.array(column) for column in zip(*PLACES))


def lens_as_used(name):
    pupil_mm, field_deg, wavelengths = LENSES[name]
    with open(f"tests/lenses/{name}.toml", "rb") as file:
        optic = optiland_lens(tomllib.load(file))
    optic.set_aperture(aperture_type="EPD", value=pupil_mm)
    for part in FIELDS[1:]:
        optic.fields.add(y=part * field_deg)
    optic.wavelengths.wavelengths.clear()
    for k, nm in enumerate(wavelengths):
        optic.wavelengths.add(value=nm / 1000.0, is_primary=k == 0)
    optic.ray_tracer.set_aiming("iterative", max_iter=30, tol=1e-12)
    return optic


def contrast_by_sum(optic, part, um):
    """Contrast of the point spread that is the sum of Optiland's rays, even over the beam before the lens."""
    side = (np.arange(SUM_RAYS) + 0.5) / SUM_RAYS * 2 - 1
    x, y = np.meshgrid(side, side)
    places = Grid()
    places.x, places.y = x.ravel(), y.ravel()
    wavefront = Wavefront(optic, [(0.0, part)], [um], SUM_RAYS, places).get_data((0.0, part), um)
    radius = number(wavefront.radius)
    chief = optic.trace_generic(0.0, part, 0.0, 0.0, wavelength=um)
    start = optic.ray_tracer.ray_generator.generate_rays(0.0, part, places.x, places.y, um)
    before = [np.asarray(c - start.z * d / start.N).reshape(x.shape) for c, d in ((start.x, start.L), (start.y, start.M))]
    rays = optic.trace_generic(np.zeros(x.size), np.full(x.size, part), places.x, places.y, wavelength=um)
    u, v = (np.asarray(d - (c - number(middle)) / radius).reshape(x.shape)
            for d, c, middle in ((rays.L, rays.x, chief.x), (rays.M, rays.y, chief.y)))
    within = x**2 + y**2 <= 1.0
    light = np.sqrt(area(u, v) * area(*before)) * np.exp(2j * np.pi * np.asarray(wavefront.opd).reshape(x.shape))
    offsets = (np.arange(SUM_PLACES) / SUM_PLACES - 0.5) * SUM_MM
    phases = [np.exp(-2j * np.pi / (um * 1e-3) * np.outer(offsets, c[within] - c[within].mean())) for c in (u, v)]
    image = np.abs((phases[1] * light[within]) @ phases[0].T) ** 2
    for cycles in CYCLES_PER_MM:
        wave = np.exp(-2j * np.pi * cycles * offsets)
        yield [abs((image.sum(axis) * wave).sum()) / image.sum() for axis in (1, 0)]


def area(a, b):
    return np.abs(np.gradient(a, axis=1) * np.gradient(b, axis=0) - np.gradient(a, axis=0) * np.gradient(b, axis=1))


def number(value):
    return float(np.asarray(value).reshape(-1)[0])


def main():
    print("# Wavefronts, foci and contrast by optiland 0.6.3, recorded by record_images.py; never renewed to make a test pass.")
    print("# Rows `chief`: height in the image, mm; then tangential and sagittal focus behind the image, mm.")
    print("# Rows `opd`: place in the pupil in its radii; then path of the chief ray less that of the ray, in wavelengths.")
    print("# Rows `mtf`, on the axis: cycles/mm; then tangential and sagittal contrast by FFTMTF with a pupil of 256 places.")
    print("# Rows `sum`: the same by a sum over Optiland's rays, in whose directions FFTMTF takes the pupil as even.")
    print("lens,pupil_mm,field_deg,wavelength_nm,kind,a,b,c")
    for name, (pupil_mm, field_deg, wavelengths) in LENSES.items():
        optic = lens_as_used(name)
        for part in FIELDS:
            for nm in wavelengths:
                um = nm / 1000.0
                head = f"{name},{pupil_mm!r},{part * field_deg!r},{nm!r}"
                curvature = FieldCurvature(optic, wavelengths=[um], num_points=11)
                at = round(10 * part)
                chief = optic.trace_generic(0.0, part, 0.0, 0.0, wavelength=um)
                foci = [number(curvature.data[0][k][at]) for k in (0, 1)]
                print(f"{head},chief,{number(chief.y):.10f},{foci[0]:.8f},{foci[1]:.8f}")
                places = Places()
                places.generate_points()
                wavefront = Wavefront(optic, [(0.0, part)], [um], len(PLACES), places)
                opd = wavefront.get_data((0.0, part), um).opd
                for (x, y), waves in zip(PLACES, opd):
                    print(f"{head},opd,{x!r},{y!r},{float(waves):.8f}")
                if nm == wavelengths[0] and part == 0.0:
                    mtf = FFTMTF(optic, [(0.0, part)], um, num_rays=GRID, grid_size=4 * GRID)
                    for cycles in CYCLES_PER_MM:
                        pair = [np.interp(cycles, np.asarray(f[0]), np.asarray(mtf.mtf[0][k]))
                                for k, f in enumerate((mtf.freq_tang, mtf.freq_sag))]
                        print(f"{head},mtf,{cycles!r},{pair[0]:.6f},{pair[1]:.6f}")
                if nm == wavelengths[0]:
                    for cycles, (tangential, sagittal) in zip(CYCLES_PER_MM, contrast_by_sum(optic, part, um)):
                        print(f"{head},sum,{cycles!r},{tangential:.6f},{sagittal:.6f}")


if __name__ == "__main__":
    sys.exit(main())
