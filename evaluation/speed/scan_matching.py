"""Times of scan matching: branch and bound against exhaustive search of the same window, and the stages of a match.

    python -m evaluation.speed.scan_matching

Median processor times in one process, on a synthetic room with a scan of 180 beams; compare the ratios.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable

import numpy as np
from numba import njit

from waychair.slam.scan.reference_surfaces import ScanReference, reference_from_scans
from waychair.slam.scan.scan_matching import BEAM_SIGMA, MatchSettings, Window, correlative_search, refine
from waychair.slam.scan.scan_points import ScanPoints, ScanStore, scan_points
from waychair.types import Bytes, FloatArray, Pose2, Scan

RUNS = 30


def room_scan(pose: Pose2, rng: np.random.Generator) -> ScanPoints:
    """Return a scan of 180 beams in a 12 x 8 m room with two pillars, with 1 cm of noise."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, 180)
    c, s = np.cos(angles + pose.theta), np.sin(angles + pose.theta)
    with np.errstate(divide="ignore"):
        ranges = np.minimum(
            np.where(c > 0, (12 - pose.x) / c, -pose.x / c), np.where(s > 0, (8 - pose.y) / s, -pose.y / s)
        )
    for x, y in ((4.0, 5.0), (9.0, 2.5)):
        along = c * (x - pose.x) + s * (y - pose.y)
        beside = np.abs(c * (y - pose.y) - s * (x - pose.x))
        hit = np.where((along > 0) & (beside < 0.3), along - np.sqrt(np.maximum(0.09 - beside**2, 0)), np.inf)
        ranges = np.minimum(ranges, hit)
    ranges += 0.01 * rng.standard_normal(len(ranges))
    scan = Scan(0, ranges.astype(np.float32), -math.pi / 2, math.pi / 179, range_max=30.0)
    return scan_points(scan, Pose2(), 20.0)


@njit(cache=True)
def exhaustive(
    points: FloatArray,
    likelihood: Bytes,
    origin: FloatArray,
    resolution: float,
    guess: FloatArray,
    cells: int,
    angles: FloatArray,
) -> float:
    """Return the best mean likelihood over all poses of the window."""
    best = 0.0
    for angle in angles:
        c, s = math.cos(guess[2] + angle), math.sin(guess[2] + angle)
        for row in range(-cells, cells + 1):
            for col in range(-cells, cells + 1):
                total = 0
                for i in range(len(points)):
                    x = guess[0] + c * points[i, 0] - s * points[i, 1] - origin[0]
                    y = guess[1] + s * points[i, 0] + c * points[i, 1] - origin[1]
                    r, k = math.floor(y / resolution) + row, math.floor(x / resolution) + col
                    if 0 <= r < likelihood.shape[0] and 0 <= k < likelihood.shape[1]:
                        total += likelihood[r, k]
                best = max(best, total / (255.0 * len(points)))
    return best


def median_ms(action: Callable[[], object]) -> float:
    """Return the median processor time of an action [ms], after one run that may compile."""
    action()
    times = []
    for _ in range(RUNS):
        started = time.process_time_ns()
        action()
        times.append((time.process_time_ns() - started) * 1e-6)
    return statistics.median(times)


def main() -> None:
    """Print the table."""
    rng, settings = np.random.default_rng(0), MatchSettings()
    poses = np.array([[3.0 + 0.1 * k, 3.5, 0.2] for k in range(40)])
    store = ScanStore()
    for pose in poses:
        store.append(room_scan(Pose2(*pose), rng))

    def build() -> ScanReference:
        return reference_from_scans(store, poses, range(40), poses[-1], 12.0, settings.resolution, BEAM_SIGMA)

    reference, scan = build(), room_scan(Pose2(7.0, 3.5, 0.2), rng)
    guess = Pose2(7.15, 3.4, 0.3)
    print(f"reference of 40 scans         {median_ms(build):8.2f} ms")
    for distance, angle in ((0.3, 0.35), (1.2, 0.6), (4.0, 0.7)):
        window = Window(distance, angle)
        bounded = median_ms(lambda w=window: correlative_search(scan.points, reference, guess, w))  # type: ignore[misc]
        far = float(np.quantile(np.hypot(*scan.points.T), 0.8))
        step = math.acos(1 - settings.resolution**2 / (2 * far**2))
        turns = np.arange(-math.ceil(angle / step), math.ceil(angle / step) + 1, dtype=np.float64) * step
        cells = math.ceil(distance / settings.resolution)
        plain = (scan.points, reference.bounds[0], reference.origin, settings.resolution, guess.array(), cells)
        exhaustive(*plain, turns[:1])
        started = time.process_time_ns()
        exhaustive(*plain, turns)
        every = (time.process_time_ns() - started) * 1e-6
        print(
            f"search +-{distance} m +-{angle} rad  {bounded:8.2f} ms, exhaustive {every:9.1f} ms: {every / bounded:7.1f}x"
        )
    start = Pose2(7.03, 3.48, 0.21)
    refined = median_ms(lambda: refine(scan, reference, start, start, np.eye(3), settings))
    print(f"refinement                    {refined:8.2f} ms")


if __name__ == "__main__":
    main()
