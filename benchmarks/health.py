"""Fits the localiser's health (the probability that a pose is right) on some scans and verifies it on others.

    python -m benchmarks.health

Poses are made as the localiser makes them: scans of the later part of a recording matched on the map of the earlier,
from starts near the truth, from starts up to 3 m beside it, and from the places that the global search offers. Right
is within 0.3 m and 5 degrees of the truth; right and wrong poses weigh the same. Logistic regression (Hastie,
Tibshirani and Friedman 2009, section 4.4) with a weak quadratic penalty on the shares of the beams' classes.

Fitted on the Intel lab's last fifth and Freiburg 079's fourth fifth; verified on Freiburg's last fifth, on which the
kidnapping is measured. A fit on the Intel lab alone trusts Freiburg's corridor too much: it has few rooms alike.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import minimize

from benchmarks.acceptance.kidnap import NEAR_M, NEAR_RAD, Split, split
from benchmarks.acceptance.logs import DATA
from waychair.geometry import pose_from_array, wrap_angle
from waychair.slam.beam_model import HealthSettings, beam_classes, beam_map, log_odds
from waychair.slam.localiser import walls
from waychair.slam.reference import reference_from_points
from waychair.slam.relocaliser import RelocaliserSettings, global_search, pyramid_from_grid
from waychair.slam.scan_matching import MatchSettings, Window, match
from waychair.slam.scan_points import MIN_POINTS, scan_points
from waychair.types import BoolArray, FloatArray

SCANS, SEED = 300, 5
INTEL, FREIBURG = "lidar_intel/intel_first1088s.clf.gz", "lidar_fr079/fr079_laser.clf.gz"


def samples(data: Split, scans: int = SCANS) -> tuple[FloatArray, BoolArray]:
    """Shares of the beams' classes (M, 5) at matched poses, and whether each pose is right (M,)."""
    rng, matching, search = np.random.default_rng(SEED), MatchSettings(), RelocaliserSettings()
    reference = reference_from_points(*walls(data.grid), matching.resolution, matching.sigma)
    beams, pyramid = beam_map(data.grid), pyramid_from_grid(data.grid, search)
    shares, right = [], []
    for k in rng.choice(np.flatnonzero(data.mapped), scans):
        frame, true = data.frames[k].scan, data.truth[k]
        assert frame is not None
        scan = scan_points(frame, data.base_from_laser, matching.range_max)
        if len(scan) < MIN_POINTS:
            continue
        starts = [place.pose.array() for place in global_search(scan.points, pyramid, search)]
        starts += [true + rng.normal(size=3) * (0.05, 0.05, 0.03) for _ in range(3)]
        starts += [true + rng.uniform(-1, 1, 3) * (3.0, 3.0, 0.5) for _ in range(4)]
        sensor = np.array([data.base_from_laser.x, data.base_from_laser.y])
        sensors = np.ascontiguousarray(np.broadcast_to(sensor, scan.points.shape))
        for start in starts:
            found = match(scan, reference, pose_from_array(start), np.eye(3), Window(0.25, 0.15), matching)
            pose = found.pose.array()
            shares.append(beam_classes(scan.points, sensors, pose, beams)[0])
            near = math.dist(pose[:2], true[:2]) <= NEAR_M
            right.append(near and abs(wrap_angle(float(pose[2] - true[2]))) <= NEAR_RAD)
    return np.array(shares), np.array(right)


def fitted(shares: FloatArray, right: BoolArray) -> HealthSettings:
    """The log-odds' weights that explain the samples best."""
    features = np.column_stack([np.ones(len(shares)), shares[:, :4]])
    weights = np.where(right, 0.5 / right.sum(), 0.5 / (~right).sum())
    signs = np.where(right, -1.0, 1.0)

    def loss(w: FloatArray) -> float:
        return float(weights @ np.logaddexp(0.0, signs * (features @ w))) + 1e-5 * float(w[1:] @ w[1:])

    return HealthSettings(*(round(float(w), 1) for w in minimize(loss, np.zeros(5)).x))


def reliability(shares: FloatArray, right: BoolArray, health: HealthSettings) -> list[tuple[float, float, int]]:
    """Per band of health: its mean, the share of right poses (right and wrong weighing the same), the number of poses."""
    stated = 1.0 / (1.0 + np.exp(-log_odds(shares, health)))
    weights = np.where(right, 0.5 / right.sum(), 0.5 / (~right).sum())
    table = []
    for low, high in ((0.0, 0.1), (0.1, 0.5), (0.5, 0.9), (0.9, 0.99), (0.99, 1.01)):
        band = (stated >= low) & (stated < high)
        if band.any():
            w = weights[band]
            table.append((float(w @ stated[band] / w.sum()), float(w @ right[band] / w.sum()), int(band.sum())))
    return table


def main() -> None:
    """Print the fit and how far the health in force can be believed."""
    intel = samples(split(DATA / INTEL))
    earlier = samples(split(DATA / FREIBURG, 0.6, 0.8))
    later = samples(split(DATA / FREIBURG))
    print("fitted:", fitted(*(np.concatenate(parts) for parts in zip(intel, earlier, strict=True))))
    print("in force:", HealthSettings())
    for name, (shares, right) in (("intel", intel), ("freiburg, earlier", earlier), ("freiburg, verified", later)):
        print(f"{name}: {right.sum()} right, {(~right).sum()} wrong")
        for stated, true, count in reliability(shares, right, HealthSettings()):
            print(f"  health {stated:.3f}: right {true:.3f} ({count} poses)")


if __name__ == "__main__":
    main()
