"""Finds the same dots in the same frames with OpenCV and prints both programs' results side by side.

    python bench/opencv.py target/bench/twinpupil.json

The file is what `side_by_side` printed: the camera's numbers, the frames, their true dots with the Cramér–Rao bound of
their depth, and what twinpupil made of them. OpenCV runs on one thread. Two ways are tried, both with settings that do well
on all frames with other noise (`--tune` prints the comparison):

- demosaic, then SimpleBlobDetector on the red and on the blue plane, as its documentation has it;
- no demosaic: threshold, findContours and grey-value moments on the mosaic's own red and blue pixels.

Features are paired by azimuth and made points by [Ohno2018, Eqs. 7, 8], with a second round that knows the plate the
first one found. Pairing is not counted in OpenCV's time; in twinpupil's it is.
"""

import argparse
import json
import math
import statistics
import time

import cv2
import numpy as np

# Parts of a code that SimpleBlobDetector sees as 0 … 255.
WHITE = 255.0

# Of those that `--tune` compares none is better on every frame: min, max and step of SimpleBlobDetector's thresholds; share
# of a dot's height from which a pixel belongs to a contour and counts in its moments, where less would be a neighbour's.
BLOB_THRESHOLDS = (40.0, 150.0, 10.0)
CONTOUR_SHARE = 0.3


def blob_detector(thresholds=BLOB_THRESHOLDS):
    parameters = cv2.SimpleBlobDetector_Params()
    parameters.minThreshold, parameters.maxThreshold, parameters.thresholdStep = thresholds
    parameters.minRepeatability = 2
    parameters.minDistBetweenBlobs = 8
    parameters.filterByColor, parameters.blobColor = True, 255
    parameters.filterByArea, parameters.minArea, parameters.maxArea = True, 20, 60_000
    # Clipped images are no circles, so no filter on shape.
    parameters.filterByCircularity = parameters.filterByConvexity = parameters.filterByInertia = False
    return cv2.SimpleBlobDetector_create(parameters)


def demosaic_and_blobs(raw, code_max, detector):
    """Centres (u, v) in the red and the blue plane."""
    colours = cv2.cvtColor(raw, cv2.COLOR_BayerRGGB2RGB)
    centres = []
    for channel in (0, 2):
        plane = cv2.convertScaleAbs(cv2.extractChannel(colours, channel), alpha=WHITE / code_max)
        blobs = detector.detect(plane)
        centres.append(np.array([blob.pt for blob in blobs], dtype=float).reshape(-1, 2))
    return centres


def contours_and_moments(raw, share=CONTOUR_SHARE):
    """The same on the mosaic's own pixels: red in its first row and column, blue in its second."""
    centres = []
    for offset in (0, 1):
        plane = np.ascontiguousarray(raw[offset::2, offset::2]).astype(np.float32)
        ground = float(np.median(plane[::16, ::16]))
        # Of a bright dot; the brightest pixel may be noise.
        height = float(np.percentile(plane[::2, ::2], 99.5)) - ground
        _, light = cv2.threshold(plane - (ground + share * height), 0.0, 0.0, cv2.THRESH_TOZERO)
        contours, _ = cv2.findContours((light > 0.0).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        found = [centre for contour in contours if (centre := grey_centre(light, contour)) is not None]
        centres.append(2.0 * np.array(found, dtype=float).reshape(-1, 2) + offset)
    return centres


def grey_centre(light, contour):
    """Centroid of the light within a contour's box; None for specks and cut dots."""
    u, v, width, height = cv2.boundingRect(contour)
    rows, columns = light.shape
    if min(width, height) < 3 or min(u, v) == 0 or u + width == columns or v + height == rows:
        return None
    moments = cv2.moments(light[v : v + height, u : u + width])
    return u + moments["m10"] / moments["m00"], v + moments["m01"] / moments["m00"]


def points_of(centres, camera):
    """Pairs features of the two bands and returns x, y, z in mm, one row a point."""
    polar = [to_polar(plane, camera) for plane in centres]
    if min(len(radius) for radius, _ in polar) == 0:
        return np.empty((0, 3))
    first = paired(polar, camera, None)
    return paired(polar, camera, plane_through(first)) if len(first) >= 10 else first


def to_polar(centres, camera):
    at = (centres - np.array(camera["axis_px"])) * camera["pitch_mm"]
    return np.hypot(at[:, 0], at[:, 1]), np.arctan2(at[:, 1], at[:, 0])


def paired(polar, camera, plate):
    """Pairs that are each other's best within the depth range: by azimuth, and by depth once there is a plate."""
    (r_red, phi_red), (r_blue, phi_blue) = polar
    f, l = camera["focal_length_mm"], camera["sensor_distance_mm"]
    beside_px = r_red[:, None] * np.sin(phi_red[:, None] - phi_blue[None, :]) / camera["pitch_mm"]
    ahead = np.cos(phi_red[:, None] - phi_blue[None, :]) > 0
    x, y = (f / (l - f) * r_red * turn for turn in (np.cos(phi_red), np.sin(phi_red)))
    z = l * f / (l - f) * r_red[:, None] / np.maximum(r_blue[None, :], 1e-9)
    near, far = camera["depth_range_mm"]
    cost = np.abs(beside_px)
    legal = ahead & (z > near) & (z < far) & (cost < 3.0)
    if plate is not None:
        off_px = (z - plate(x, y)[:, None]) / z * r_blue[None, :] / camera["pitch_mm"]
        cost = np.hypot(beside_px, off_px)
        legal &= cost < 12.0
    cost = np.where(legal, cost, np.inf)
    best_blue, best_red = cost.argmin(axis=1), cost.argmin(axis=0)
    red = np.flatnonzero((best_red[best_blue] == np.arange(len(r_red))) & np.isfinite(cost.min(axis=1)))
    return np.column_stack([x[red], y[red], z[red, best_blue[red]]])


def plane_through(points):
    """Least squares, thrice, each time without what lies far off."""
    design = np.column_stack([points[:, 0], points[:, 1], np.ones(len(points))])
    kept = np.abs(points[:, 2] - np.median(points[:, 2])) < 30.0
    for _ in range(3):
        solution, *_ = np.linalg.lstsq(design[kept], points[kept, 2], rcond=None)
        off = np.abs(points[:, 2] - design @ solution)
        kept = off < 3.0 * max(np.median(off), 0.01)
    return lambda x, y: solution[0] * x + solution[1] * y + solution[2]


def score(points, dots, rules):
    """As `side_by_side` scores twinpupil's points."""
    def on_dot(dot):
        x, y, z = dot["centre_mm"]
        beside = np.hypot(points[:, 0] - x, points[:, 1] - y)
        is_at = (beside < 0.5 * dot["diameter_mm"]) & (np.abs(points[:, 2] - z) < rules["false_depth_mm"])
        return np.where(is_at, beside, np.inf)

    is_true = np.zeros(len(points), bool)
    counted, errors = 0, []
    for dot in dots:
        beside = on_dot(dot)
        is_true |= np.isfinite(beside)
        r = math.hypot(*dot["centre_mm"][:2])
        if dot["z_bound_mm"] is None or r < rules["counted_mm"]:
            continue
        counted += 1
        if len(points) and np.isfinite(beside.min()):
            errors.append((r, (points[beside.argmin(), 2] - dot["centre_mm"][2]) / dot["z_bound_mm"]))
    rms = lambda values: math.sqrt(statistics.fmean(v * v for v in values)) if values else math.nan
    return {
        "dots": counted,
        "found": len(errors),
        "error_over_bound": rms([error for _, error in errors]),
        "unclipped_error_over_bound": rms([error for r, error in errors if r >= rules["unclipped_mm"]]),
        "false_points": int((~is_true).sum()),
    }


def timed(find, repeats):
    centres = find()
    times = []
    for _ in range(repeats):
        # Processor time, so that what else the machine does costs neither program much.
        start = time.thread_time()
        find()
        times.append(1000.0 * (time.thread_time() - start))
    return centres, statistics.median(times), min(times)


def results(frame, bench, repeats):
    """OpenCV's two ways with one frame."""
    camera, rules = bench["instrument"], bench["rules"]
    raw = cv2.imread(frame["frame"], cv2.IMREAD_UNCHANGED)
    detector = blob_detector()
    ways = {
        "OpenCV, SimpleBlobDetector": lambda: demosaic_and_blobs(raw, camera["code_max"], detector),
        "OpenCV, contours, moments": lambda: contours_and_moments(raw),
    }
    for method, find in ways.items():
        centres, median_ms, least_ms = timed(find, repeats)
        times = {"method": method, "median_ms": median_ms, "least_ms": least_ms}
        yield times | score(points_of(centres, camera), frame["dots"], rules)


HEADER = ("", "ms a frame", "least", "ratio", "error/bound", "r ≥ {unclipped_mm}", "found", "recall", "false")


def table(bench):
    rows = [tuple(heading.format(**bench["rules"]) for heading in HEADER)]
    for frame in bench["frames"]:
        rows.append((frame["name"],) + ("",) * 8)
        fastest = frame["results"][0]["median_ms"]
        rows.extend(cells(result, fastest) for result in frame["results"])
    widths = [max(len(row[k]) for row in rows) for k in range(len(HEADER))]
    for row in rows:
        first, *others = (cell.ljust(w) if k == 0 else cell.rjust(w) for k, (cell, w) in enumerate(zip(row, widths)))
        print("  ".join([first, *others]).rstrip())


def cells(result, fastest_ms):
    return (
        "  " + result["method"],
        f"{result['median_ms']:.2f}",
        f"{result['least_ms']:.2f}",
        f"{result['median_ms'] / fastest_ms:.2f}",
        f"{result['error_over_bound']:.2f}",
        f"{result['unclipped_error_over_bound']:.2f}",
        f"{result['found']} of {result['dots']}",
        f"{100 * result['found'] / max(result['dots'], 1):.1f} %",
        str(result["false_points"]),
    )


def tune(bench):
    """Settings of both ways against error, recall and time, frame by frame."""
    steps = [(low, high, step) for low in (10.0, 40.0, 70.0) for high in (120.0, 150.0, 170.0) for step in (5.0, 10.0, 20.0)]
    camera = bench["instrument"]
    for frame in bench["frames"]:
        raw = cv2.imread(frame["frame"], cv2.IMREAD_UNCHANGED)
        blobs = lambda detector: lambda: demosaic_and_blobs(raw, camera["code_max"], detector)
        ways = {f"thresholds {thresholds}": blobs(blob_detector(thresholds)) for thresholds in steps}
        contours = lambda share: lambda: contours_and_moments(raw, share)
        ways |= {f"share {share}": contours(share) for share in (0.05, 0.1, 0.2, 0.3, 0.4, 0.5)}
        for setting, find in ways.items():
            centres, median_ms, _ = timed(find, 3)
            print(frame["name"], setting, f"{median_ms:.1f} ms", score(points_of(centres, camera), frame["dots"], bench["rules"]))


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("bench", help="what side_by_side printed")
    arguments.add_argument("--repeats", type=int, default=20)
    arguments.add_argument("--tune", action="store_true", help="compare thresholds instead")
    arguments = arguments.parse_args()
    cv2.setNumThreads(1)
    with open(arguments.bench, encoding="utf-8") as file:
        bench = json.load(file)
    if arguments.tune:
        return tune(bench)
    for frame in bench["frames"]:
        frame["results"].extend(results(frame, bench, arguments.repeats))
    print(f"OpenCV {cv2.__version__}; processor time of one thread, but where it says elapsed; ratio: time over that of twinpupil's model mode")
    table(bench)


if __name__ == "__main__":
    main()
