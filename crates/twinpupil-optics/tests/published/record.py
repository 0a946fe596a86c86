"""Records where Optiland and batoid put the rays of the lenses in `tests/lenses`.

    python tests/published/record.py > tests/published/optiland-batoid.csv

optiland 0.6.3 and batoid 0.9.0, from this crate's folder. Glasses are Optiland's own, from the refractiveindex.info database;
batoid is given Optiland's indices. What it prints is compared with, never renewed to make a test pass.
"""

import math
import sys
import tomllib

import batoid
import numpy as np
import optiland
from optiland.materials import IdealMaterial, Material
from optiland.optic import Optic
from optiland.rays import RealRays

RAYS = 1000
# Radius of the beam before the first surface, its centre there, its slopes, wavelengths.
BEAMS = {
    "double-gauss": (10.0, (-3.0, -10.0), (0.05, 0.17), (486.1, 587.6, 656.3)),
    "cooke-triplet": (4.0, (0.0, -2.9), (0.0, 0.25), (480.0, 550.0, 650.0)),
    "achromat": (10.0, (0.0, 0.0), (0.03, -0.02), (450.0, 550.0, 680.0)),
    "asphere": (4.5, (0.0, 0.0), (0.02, 0.05), (450.0, 550.0, 680.0)),
}
CATALOGUES = {"SK16": "hikari"}


def material(lens, name):
    medium = lens.get("media", {}).get(name)
    if medium:
        return IdealMaterial(medium["coefficients"][0])
    if name == "air":
        return IdealMaterial(1.0)
    return Material(name, CATALOGUES.get(name, "schott"))


def index(lens, name, wavelength_nm):
    return float(np.asarray(material(lens, name).n(wavelength_nm / 1000.0)).reshape(-1)[0])


def optiland_lens(lens):
    optic = Optic()
    optic.surfaces.add(index=0, radius=np.inf, thickness=np.inf)
    for k, surface in enumerate(lens["surface"]):
        shape = surface.get("shape", {"kind": "plane"})
        options = {"index": k + 1, "thickness": surface["gap_mm"], "material": material(lens, surface.get("medium", "air"))}
        options["radius"] = shape.get("radius_mm", np.inf)
        if shape["kind"] == "even-asphere":
            options |= {"surface_type": "even_asphere", "conic": shape["conic_constant"], "coefficients": shape["coefficients"]}
        optic.surfaces.add(is_stop=surface.get("stop", False), **options)
    optic.surfaces.add(index=len(lens["surface"]) + 1)
    optic.set_aperture(aperture_type="EPD", value=1.0)
    optic.fields.set_type("angle")
    optic.fields.add(y=0)
    optic.wavelengths.add(value=0.55, is_primary=True)
    return optic


def batoid_lens(lens, wavelength_nm):
    items, z, before = [], 0.0, batoid.ConstMedium(1.0)
    for k, surface in enumerate(lens["surface"]):
        shape = surface.get("shape", {"kind": "plane"})
        if shape["kind"] == "sphere":
            form = batoid.Sphere(shape["radius_mm"])
        elif shape["kind"] == "even-asphere":
            # batoid's coefficients start at r⁴.
            form = batoid.Asphere(shape["radius_mm"], shape["conic_constant"], np.array(shape["coefficients"][1:]))
        else:
            form = batoid.Plane()
        behind = batoid.ConstMedium(index(lens, surface.get("medium", "air"), wavelength_nm))
        place = batoid.CoordSys().shiftGlobal([0, 0, z])
        items.append(batoid.RefractiveInterface(form, name=str(k), coordSys=place, inMedium=before, outMedium=behind))
        before, z = behind, z + surface["gap_mm"]
    image = batoid.CoordSys().shiftGlobal([0, 0, z])
    items.append(batoid.Detector(batoid.Plane(), name="image", coordSys=image, inMedium=before, outMedium=before))
    return batoid.CompoundOptic(items, name="lens", inMedium=batoid.ConstMedium(1.0), outMedium=before)


def main():
    print(f"# Rays in the image by optiland {optiland.__version__ if hasattr(optiland, '__version__') else '0.6.3'} and "
          f"batoid {batoid.__version__}, recorded by record.py; never renewed to make a test pass.")
    print("# A line `lens` has name, beam radius, centre and slopes; ray k of 1000 starts at radius √((k + ½)/1000) and azimuth")
    print("# 2.399963229728653 k, and has the k-th of three wavelengths, round and round.")
    print("lens_or_wavelength_nm,optiland_x_mm,optiland_y_mm,batoid_x_mm,batoid_y_mm")
    for name, (radius, (cx, cy), (gx, gy), wavelengths) in BEAMS.items():
        with open(f"tests/lenses/{name}.toml", "rb") as file:
            lens = tomllib.load(file)
        k = np.arange(RAYS)
        r, turn = radius * np.sqrt((k + 0.5) / RAYS), 2.399963229728653 * k
        x, y = cx + r * np.cos(turn), cy + r * np.sin(turn)
        length = math.sqrt(1.0 + gx * gx + gy * gy)
        direction = [np.full(RAYS, c / length) for c in (gx, gy, 1.0)]
        out = np.zeros((RAYS, 4))
        for j, wavelength in enumerate(wavelengths):
            rays = RealRays(x, y, np.zeros(RAYS), *direction, np.ones(RAYS), np.full(RAYS, wavelength / 1000.0))
            optiland_lens(lens).surfaces.trace(rays)
            vector = batoid.RayVector(x, y, np.zeros(RAYS), *direction, np.zeros(RAYS), np.full(RAYS, wavelength))
            # Speeds are in units of that of light: the first medium is air.
            traced = batoid_lens(lens, wavelength).trace(vector)
            mine = k % 3 == j
            out[mine] = np.stack([rays.x, rays.y, traced.x, traced.y], axis=1)[mine]
        print(f"lens,{name},{radius!r},{cx!r},{cy!r},{gx!r},{gy!r}")
        for k in range(RAYS):
            print(f"{wavelengths[k % 3]!r}," + ",".join(f"{value:.11f}" for value in out[k]))


if __name__ == "__main__":
    sys.exit(main())
