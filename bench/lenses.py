"""Traces the same rays through the same lens with batoid and Optiland and prints all three programs' speeds.

    python bench/lenses.py target/bench/lenses.json

The file is what `lenses` printed: surfaces, rays, where twinpupil has them in the image and how fast it was. Each program runs
on one thread and counts processor time; the others are given batches of several sizes, of which the fastest counts, and
their rays are made beforehand.
"""

import argparse
import json
import time

import batoid
import numpy as np
from optiland.materials import IdealMaterial
from optiland.optic import Optic
from optiland.rays import RealRays

BATCHES = (1, 4, 16, 64)

# Largest distance in the image between two programs, mm.
TOLERANCE_MM = 1e-9


def batoid_lens(surfaces):
    items, z, before = [], 0.0, batoid.ConstMedium(1.0)
    for k, surface in enumerate(surfaces):
        curvature = surface["curvature_per_mm"]
        form = batoid.Sphere(1.0 / curvature) if curvature else batoid.Plane()
        behind = batoid.ConstMedium(surface["index_behind"])
        place = batoid.CoordSys().shiftGlobal([0, 0, z])
        items.append(batoid.RefractiveInterface(form, name=str(k), coordSys=place, inMedium=before, outMedium=behind))
        before, z = behind, z + surface["gap_mm"]
    image = batoid.CoordSys().shiftGlobal([0, 0, z])
    items.append(batoid.Detector(batoid.Plane(), name="image", coordSys=image, inMedium=before, outMedium=before))
    return batoid.CompoundOptic(items, name="lens", inMedium=batoid.ConstMedium(1.0), outMedium=before)


def optiland_lens(surfaces):
    optic = Optic()
    optic.surfaces.add(index=0, radius=np.inf, thickness=np.inf)
    for k, surface in enumerate(surfaces):
        curvature = surface["curvature_per_mm"]
        radius = 1.0 / curvature if curvature else np.inf
        medium = IdealMaterial(surface["index_behind"])
        optic.surfaces.add(index=k + 1, radius=radius, thickness=surface["gap_mm"], material=medium, is_stop=k == 5)
    optic.surfaces.add(index=len(surfaces) + 1)
    optic.set_aperture(aperture_type="EPD", value=1.0)
    optic.fields.set_type("angle")
    optic.fields.add(y=0)
    optic.wavelengths.add(value=0.5876, is_primary=True)
    return optic


def with_batoid(lens, starts):
    x, y, z, dx, dy, dz = (np.ascontiguousarray(column) for column in starts.T)
    rays = batoid.RayVector(x, y, z, dx, dy, dz, np.zeros(len(x)), np.full(len(x), 587.6))
    start = time.thread_time()
    lens.trace(rays)
    return time.thread_time() - start, np.stack([rays.x, rays.y], axis=1)


def with_optiland(lens, starts):
    rays = RealRays(*starts.T.copy(), np.ones(len(starts)), np.full(len(starts), 0.5876))
    start = time.thread_time()
    lens.surfaces.trace(rays)
    return time.thread_time() - start, np.stack([rays.x, rays.y], axis=1)


def measured(trace, lens, starts, repeats, met):
    best, image = 0.0, None
    for batches in BATCHES:
        many = np.tile(starts, (batches, 1))
        for _ in range(max(3, repeats // batches)):
            seconds, image = trace(lens, many)
            best = max(best, len(many) * met / seconds)
    return best, image[: len(starts)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("twinpupil", help="what `lenses` printed")
    parser.add_argument("--repeats", type=int, default=100)
    arguments = parser.parse_args()
    with open(arguments.twinpupil, encoding="utf-8") as file:
        bench = json.load(file)
    starts, image, met = np.array(bench["starts"]), np.array(bench["image_mm"]), bench["met"]
    ours = bench["one_thread_per_s"]
    print(f"{len(starts)} rays through {met} surfaces, one thread     M ray-surfaces/s   twinpupil over it")
    print(f"  twinpupil {ours / 1e6:40.1f}")
    for name, trace, lens in (
        ("batoid", with_batoid, batoid_lens(bench["surfaces"])),
        ("Optiland", with_optiland, optiland_lens(bench["surfaces"])),
    ):
        speed, places = measured(trace, lens, starts, arguments.repeats, met)
        off_mm = float(np.abs(places - image).max())
        print(f"  {name:9} {speed / 1e6:40.1f} {ours / speed:19.1f}   same places to {off_mm:.1e} mm")
        if not off_mm < TOLERANCE_MM:
            raise SystemExit(f"{name} has rays elsewhere: {off_mm} mm")
    print(f"twinpupil on two threads over one: {bench['two_threads_over_one']:.2f}")


if __name__ == "__main__":
    main()
