"""Fit the localiser's health (the probability that a pose is right) on some scans and verify it on others.

    python -m evaluation.speed.health

Poses are computed as by the localiser: scans of the later part of a recording are matched on the map of the earlier
part, from starts near the truth, up to 3 m beside it, and from the candidates of the global search. A third of the
scans is unchanged; the others contain three or ten people: discs, alone or in rows, that hide the walls behind. A pose
is right within 0.3 m and 5 degrees of the truth; right and wrong poses have equal total weights. The model is a
logistic regression (Hastie, Tibshirani and Friedman 2009, section 4.4) with a weak quadratic penalty on the weights.

The health of a tracked pose is fitted on the Intel lab's last fifth, Freiburg 079's fourth fifth and two simulated
floors, with equal weights. Right poses in a cluttered lab look like wrong ones on a clean floor, so the middle of the
scale is a compromise. It is verified on Freiburg's last fifth, which also serves the kidnapping test, and on another
floor. The odds of relocalised places are fitted on the scans without people of the two recordings; a fit on the Intel
lab alone trusts Freiburg's corridor with its similar rooms too much.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from evaluation.figures.mapping.kidnap import NEAR_M, NEAR_RAD, Split, simulated_split, split
from evaluation.figures.mapping.logs import DATA
from waychair.geometry import pose_from_array, wrap_angle
from waychair.slam.localising.localiser import LocaliserSettings, wall_points
from waychair.slam.scan.beam_model import (
    HEALTH,
    IN_FREE,
    IN_UNKNOWN,
    NEAR_WALL,
    ON_FAR_WALL,
    ON_OBJECT,
    ON_WALL,
    PLACE,
    THROUGH_WALL,
    HealthWeights,
    PlaceWeights,
    beam_classes,
    beam_map,
    pose_probability,
)
from waychair.slam.scan.reference_surfaces import reference_from_points
from waychair.slam.scan.relocaliser import global_search, pyramid_from_grid
from waychair.slam.scan.scan_matching import BEAM_SIGMA, MatchSettings, Window, match
from waychair.slam.scan.scan_points import MIN_POINTS, scan_points
from waychair.types import BoolArray, FloatArray, IntArray, Scan

SCANS, SEED = 450, 5
CROWDS = (0, 3, 10)
INTEL, FREIBURG = "lidar_intel/intel_first1088s.clf.gz", "lidar_fr079/fr079_laser.clf.gz"


@dataclass(frozen=True, slots=True)
class Samples:
    """Shares (M, 7) of beam classes at matched poses, whether each pose is right (M,), number of people (M,)."""

    shares: FloatArray
    right: BoolArray
    people: IntArray

    def among(self, people: int) -> Samples:
        """Return the samples with this number of people."""
        chosen = self.people == people
        return Samples(self.shares[chosen], self.right[chosen], self.people[chosen])

    @property
    def weights(self) -> FloatArray:
        """Return weights (M,); right and wrong poses have a total of one half each."""
        weights: FloatArray = np.where(self.right, 0.5 / self.right.sum(), 0.5 / (~self.right).sum())
        return weights


def samples(data: Split, scans: int = SCANS) -> Samples:
    """Return matched poses for `scans` scans of a split."""
    rng, matching = np.random.default_rng(SEED), MatchSettings()
    reference = reference_from_points(*wall_points(data.grid), matching.resolution, BEAM_SIGMA)
    beams, pyramid = beam_map(data.grid), pyramid_from_grid(data.grid)
    shares, right, people = [], [], []
    for j, k in enumerate(rng.choice(np.flatnonzero(data.mapped), scans)):
        frame, true, count = data.frames[k].scan, data.truth[k], CROWDS[j % len(CROWDS)]
        assert frame is not None
        scan = scan_points(crowded(frame, count, rng), data.base_from_laser, matching.range_max)
        if len(scan) < MIN_POINTS:
            continue
        starts = [place.pose.array() for place in global_search(scan.points, pyramid)]
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
            people.append(count)
    return Samples(np.array(shares), np.array(right), np.array(people))


def crowded(scan: Scan, people: int, rng: np.random.Generator) -> Scan:
    """Return the scan with people: discs of 0.2 to 0.3 m, 0.6 to 3 m away, alone or up to four in a row."""
    bearings = scan.angle_min + scan.angle_step * np.arange(len(scan.ranges))
    ranges = np.where(scan.ranges > 0, scan.ranges, np.inf)  # beams without a hit are infinite
    for x, y in _groups(people, rng):
        away, bearing, radius = math.hypot(x, y), math.atan2(y, x), rng.uniform(0.2, 0.3)
        across, along = away * np.sin(bearings - bearing), away * np.cos(bearings - bearing)
        met = (np.abs(across) < radius) & (along > 0)
        ranges = np.where(met, np.fmin(ranges, along - np.sqrt(np.maximum(radius**2 - across**2, 0.0))), ranges)
    return replace(scan, ranges=ranges.astype(np.float32))


def _groups(people: int, rng: np.random.Generator) -> FloatArray:
    """Return positions (N, 2) [m] of people, at least 0.5 m from the lidar."""
    places: list[FloatArray] = []
    while len(places) < people:
        away, bearing, row = rng.uniform(0.6, 3.0), rng.uniform(-math.pi, math.pi), rng.uniform(-math.pi, math.pi)
        first, beside = np.array([math.cos(bearing), math.sin(bearing)]), np.array([math.cos(row), math.sin(row)])
        group = [away * first + 0.45 * k * beside for k in range(rng.integers(1, 5))]
        places += [place for place in group if math.hypot(*place) > 0.5]
    return np.array(places[:people]).reshape(-1, 2)


def fitted_health(parts: Sequence[Samples]) -> HealthWeights:
    """Return the weights of the best fit, with equal weights of the parts."""
    classes = [ON_WALL, NEAR_WALL, IN_FREE, THROUGH_WALL, IN_UNKNOWN]
    return HealthWeights(*_weights([part.shares[:, classes] for part in parts], parts))


def fitted_place(calm: Samples) -> PlaceWeights:
    """Return the fit for relocalised places: with a bias, with objects as surfaces, without the beams through walls."""
    shares = calm.shares
    free, through = shares[:, IN_FREE] + shares[:, ON_OBJECT], shares[:, THROUGH_WALL] + shares[:, ON_FAR_WALL]
    features = np.column_stack([np.ones(len(shares)), shares[:, ON_WALL], shares[:, NEAR_WALL], free, through])
    return PlaceWeights(*_weights([features], [calm], first=1))


def _weights(features: Sequence[FloatArray], parts: Sequence[Samples], first: int = 0) -> list[float]:
    """Return the weights of the features (M, K) of the parts; those from `first` on are penalised."""

    def loss(w: FloatArray) -> float:
        losses = [
            part.weights @ np.logaddexp(0.0, np.where(part.right, -1.0, 1.0) * (of_part @ w))
            for of_part, part in zip(features, parts, strict=True)
        ]
        return float(np.mean(losses)) + 1e-5 * float(w[first:] @ w[first:])

    return [round(float(w), 1) for w in minimize(loss, np.zeros(features[0].shape[1])).x]


def reliability(some: Samples, health: HealthWeights) -> list[tuple[float, float, int]]:
    """Return, per band of health, its mean, the weighted share of right poses, and the number of poses."""
    stated, table = pose_probability(some.shares, health), []
    for low, high in ((0.0, 0.1), (0.1, 0.5), (0.5, 0.8), (0.8, 0.9), (0.9, 1.01)):
        band = (stated >= low) & (stated < high)
        if band.any():
            w = some.weights[band]
            table.append((float(w @ stated[band] / w.sum()), float(w @ some.right[band] / w.sum()), int(band.sum())))
    return table


def main() -> None:
    """Print the fits and the reliability of the present health settings."""
    parts = {
        "intel, fitted": samples(split(DATA / INTEL)),
        "freiburg, earlier, fitted": samples(split(DATA / FREIBURG, 0.6, 0.8)),
        "small_clinic, fitted": samples(simulated_split("small_clinic")),
        "basement, fitted": samples(simulated_split("basement")),
    }
    intel, freiburg = (part.among(0) for part in list(parts.values())[:2])
    calm = Samples(*(np.concatenate([getattr(p, name) for p in (intel, freiburg)]) for name in Samples.__slots__))
    print("fitted:", fitted_health(list(parts.values())), fitted_place(calm))
    print("in force:", HEALTH, PLACE)
    parts["freiburg, verified"] = samples(split(DATA / FREIBURG))
    parts["apartment, verified"] = samples(simulated_split("apartment"))
    for name, part in parts.items():
        for people in CROWDS:
            _show(f"{name}, {people} people", part.among(people))


def _show(name: str, some: Samples) -> None:
    limits, stated = LocaliserSettings(), pose_probability(some.shares, HEALTH)
    right, wrong = stated[some.right], stated[~some.right]
    print(
        f"{name}: of {len(right)} right poses {(right >= limits.ok_health).mean():.3f} ok, "
        f"{(right < limits.lost_health).mean():.3f} contradicted; "
        f"of {len(wrong)} wrong ones {(wrong >= limits.ok_health).mean():.3f}, {(wrong < limits.lost_health).mean():.3f}"
    )
    for health, true, count in reliability(some, HEALTH):
        print(f"  health {health:.3f}: right {true:.3f} ({count} poses)")


if __name__ == "__main__":
    main()
