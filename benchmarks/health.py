"""Fits the localiser's health (the probability that a pose is right) on some scans and verifies it on others.

    python -m benchmarks.health

Poses are made as the localiser makes them: scans of the later part of a recording matched on the map of the earlier,
from starts near the truth, from starts up to 3 m beside it, and from the places that the global search offers. Right
is within 0.3 m and 5 degrees of the truth; right and wrong poses weigh the same. Logistic regression (Hastie,
Tibshirani and Friedman 2009, section 4.4) with a weak quadratic penalty on the shares of the beams' classes.

Fitted on the Intel lab's last fifth and Freiburg 079's fourth fifth; verified on Freiburg's last fifth, on which the
kidnapping is measured. A fit on the Intel lab alone trusts Freiburg's corridor too much: it has few rooms alike. What
is stated is tempered (Platt 1999) by the Intel lab and two simulated floors together, and verified on both parts of
Freiburg and on another floor. In the middle of the scale it stays a compromise: a lab full of things shows right poses
with odds at which a clean simulated floor shows wrong ones.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import minimize

from benchmarks.acceptance.kidnap import NEAR_M, NEAR_RAD, Split, simulated_split, split
from benchmarks.acceptance.logs import DATA
from waychair.geometry import pose_from_array, wrap_angle
from waychair.slam.beam_model import HealthSettings, beam_classes, beam_map, log_odds, probability
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


def tempered(shares: FloatArray, right: BoolArray, health: HealthSettings) -> tuple[float, float]:
    """`temper` and `caution` that make the log-odds of a fit hold for the samples."""
    odds, weights = log_odds(shares, health), np.where(right, 0.5 / right.sum(), 0.5 / (~right).sum())
    signs = np.where(right, -1.0, 1.0)
    best = minimize(lambda p: float(weights @ np.logaddexp(0.0, signs * (p[0] * odds - p[1]))), np.array([1.0, 0.0]))
    return round(float(best.x[0]), 2), round(float(best.x[1]), 2)


def reliability(shares: FloatArray, right: BoolArray, health: HealthSettings) -> list[tuple[float, float, int]]:
    """Per band of health: its mean, the share of right poses (right and wrong weighing the same), the number of poses."""
    stated = probability(log_odds(shares, health), health)
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
    floors = {name: samples(simulated_split(name)) for name in ("small_clinic", "basement", "apartment")}
    print("fitted:", fitted(*_together(intel, earlier)))
    print("tempered:", tempered(*_together(intel, floors["small_clinic"], floors["basement"]), HealthSettings()))
    print("in force:", HealthSettings())
    used = {"intel, fitted and tempered": intel, "freiburg, earlier, fitted": earlier}
    used |= {f"{name}, tempered": floors[name] for name in ("small_clinic", "basement")}
    for name, (shares, right) in (
        used | {"freiburg, verified": later, "apartment, verified": floors["apartment"]}
    ).items():
        print(f"{name}: {right.sum()} right, {(~right).sum()} wrong")
        for stated, true, count in reliability(shares, right, HealthSettings()):
            print(f"  health {stated:.3f}: right {true:.3f} ({count} poses)")


def _together(*parts: tuple[FloatArray, BoolArray]) -> tuple[FloatArray, BoolArray]:
    return np.concatenate([shares for shares, _ in parts]), np.concatenate([right for _, right in parts])


if __name__ == "__main__":
    main()
