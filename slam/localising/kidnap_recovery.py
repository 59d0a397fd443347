"""Relocalisation of a lost (kidnapped) chair: candidate places, compared while it moves until one is unambiguous.

The scans since the chair was lost are matched with each other into a small local map. At intervals this whole cloud is
searched for on the saved map. The places found join the earlier candidates, which move along in the local frame, and the
beam model rates each of them. A wrong place is the worst error. So a place must be probable against all others and
against being nowhere on the map, win several searches in a row some distance apart, and be well constrained in all
directions.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from waychair.geometry import rotation, transform_points, wrap_angle
from waychair.slam.scan.beam_model import BeamMap, beam_classes, place_log_odds
from waychair.slam.scan.reference_surfaces import ScanReference, reference_from_scans
from waychair.slam.scan.relocaliser import APART_ANGLE, APART_DISTANCE, HYPOTHESES, Hypothesis, Pyramid, global_search
from waychair.slam.scan.scan_matching import BEAM_SIGMA, MatchSettings, Window, match
from waychair.slam.scan.scan_points import MIN_POINTS, ScanPoints, ScanStore
from waychair.types import FloatArray, Pose2

_KEY_DISTANCE, _KEY_ANGLE = 0.15, 0.2  # m, rad; a scan is kept after this distance or turn
_KEPT_SCANS = 20  # latest scans that are searched for together
_MATCH_WINDOW = Window(0.3, 0.35)  # between one kept scan and the next
_SEARCH_SPACING, _SEARCH_TURN = 0.3, 0.5  # m, rad; distance or turn between two searches of the map
_PLACE_WINDOW = Window(0.2, 0.08)  # of the match at a place
_PLACE_POINTS = 360  # points of the match at a place
_MAX_ODDS_GAP = 8.0  # places whose log-odds are lower than the best by more are dropped
_MAX_DEVIATION = 0.1  # m; largest standard deviation of an accepted place
_CONFIRMATIONS = 3  # searches in a row that one place must win
_CONFIRMED_DISTANCE = 0.5  # m; distance driven while one place wins


@dataclass(frozen=True, slots=True)
class SavedMap:
    """A map in the forms for matching, beam tracing and global search."""

    reference: ScanReference
    beams: BeamMap
    pyramid: Pyramid


@dataclass(frozen=True, slots=True)
class PlaceCandidate:
    """A place where the chair may be: pose, log-odds by the beams, and whether all directions are well constrained."""

    pose: Pose2
    log_odds: float
    is_constrained: bool


class KidnapRecovery:
    """The scans since the chair was lost, and the places where it may be (`candidates`, best first)."""

    def __init__(self, saved: SavedMap, sensor: FloatArray, matching: MatchSettings, min_probability: float) -> None:
        """`sensor` (2,) [m] is the lidar's position in the base frame; `min_probability` that of an accepted place."""
        self._saved, self._sensor, self._matching, self._min_probability = saved, sensor, matching, min_probability
        self._kept: deque[tuple[ScanPoints, Pose2]] = deque(maxlen=_KEPT_SCANS)
        self._odometry = Pose2()  # odom_from_base at the last kept scan
        self._distance = self._turn = math.inf  # since the last search
        self._winner: Pose2 | None = None  # map_from_local of the last winner
        self._wins, self._won_distance = 0, 0.0
        self.candidates: tuple[PlaceCandidate, ...] = ()
        self.searches = 0

    def process(self, scan: ScanPoints, odom_from_base: Pose2) -> Pose2 | None:
        """Return `map_from_base` once one place is accepted, else None."""
        moved = self._odometry.inverse() @ odom_from_base
        away = math.hypot(moved.x, moved.y)
        if len(scan) < MIN_POINTS or (self._kept and away < _KEY_DISTANCE and abs(moved.theta) < _KEY_ANGLE):
            return None
        step = self._keep(scan, moved, odom_from_base)
        self._distance += math.hypot(step.x, step.y)
        self._turn += abs(step.theta)
        if self._distance < _SEARCH_SPACING and self._turn < _SEARCH_TURN:
            return None
        driven, self._distance, self._turn = self._distance, 0.0, 0.0
        cloud, sensors = self._cloud()
        self.candidates = self._rated(cloud, sensors, self._places(cloud))
        return self._accepted(driven if math.isfinite(driven) else 0.0)

    def probability(self) -> float:
        """Return the probability of the best candidate against all others and against being nowhere on the map."""
        if not self.candidates:
            return 0.0
        odds = np.exp(np.clip([candidate.log_odds for candidate in self.candidates], -50.0, 50.0))
        return float(odds[0] / (1.0 + odds.sum()))

    def _keep(self, scan: ScanPoints, moved: Pose2, odom_from_base: Pose2) -> Pose2:
        """Add a scan to the local map where it matches; return the motion since the last kept scan."""
        matching = self._matching
        self._odometry = odom_from_base
        if not self._kept:
            self._kept.append((scan, Pose2()))
            return Pose2()
        last = self._kept[-1][1]
        guess = last @ moved
        store = ScanStore()
        for earlier, _ in self._kept:
            store.append(earlier)
        poses = np.array([pose.array() for _, pose in self._kept])
        reference = reference_from_scans(
            store,
            poses,
            members=range(len(poses)),
            centre=guess.array(),
            reach=12.0,
            resolution=matching.resolution,
            sigma=BEAM_SIGMA,
        )
        found = match(
            scan,
            reference,
            guess=guess,
            guess_information=np.diag([100.0, 100.0, 400.0]),
            window=_MATCH_WINDOW,
            settings=matching,
        )
        pose = found.pose if found.inliers > 0.3 else guess
        self._kept.append((scan, pose))
        self.candidates = tuple(
            PlaceCandidate(candidate.pose @ (last.inverse() @ pose), candidate.log_odds, candidate.is_constrained)
            for candidate in self.candidates
        )
        return last.inverse() @ pose

    def _cloud(self) -> tuple[ScanPoints, FloatArray]:
        """Return the kept points in the frame of the last scan, thinned evenly, and the lidar's position for each (N, 2)."""
        base, points, normals, sensors = self._kept[-1][1], [], [], []
        for scan, pose in reversed(self._kept):
            base_from_scan = base.inverse() @ pose
            points.append(transform_points(base_from_scan, scan.points))
            normals.append(scan.normals @ rotation(base_from_scan.theta).T)
            seen_from = transform_points(base_from_scan, self._sensor[None])
            sensors.append(np.broadcast_to(seen_from, scan.points.shape))
        step = max(1, len(points) // 5)  # neighbouring beams of a scan are redundant
        every, facing, seen_from = (np.concatenate(parts)[::step] for parts in (points, normals, sensors))
        cloud = ScanPoints(np.ascontiguousarray(every), np.ascontiguousarray(facing))
        return cloud, np.ascontiguousarray(seen_from)

    def _places(self, cloud: ScanPoints) -> tuple[Hypothesis, ...]:
        """Return the places found on the whole map, and the earlier candidates."""
        self.searches += 1
        fresh = global_search(cloud.points, self._saved.pyramid)
        earlier = tuple(Hypothesis(candidate.pose, 0.0) for candidate in self.candidates)
        return fresh + earlier

    def _rated(
        self, cloud: ScanPoints, sensors: FloatArray, places: tuple[Hypothesis, ...]
    ) -> tuple[PlaceCandidate, ...]:
        """Return the places at their best fit, best log-odds first, without duplicates and hopeless ones."""
        thin = cloud.thinned(_PLACE_POINTS)
        rated: list[PlaceCandidate] = []
        for place in places:
            found = match(
                thin,
                self._saved.reference,
                guess=place.pose,
                guess_information=np.eye(3),
                window=_PLACE_WINDOW,
                settings=self._matching,
            )
            shares = beam_classes(cloud.points, sensors, found.pose.array(), self._saved.beams)
            deviation = math.sqrt(float(np.linalg.eigvalsh(found.covariance[:2, :2])[-1]))
            is_constrained = not found.degenerate and deviation <= _MAX_DEVIATION
            rated.append(PlaceCandidate(found.pose, float(place_log_odds(shares)[0]), is_constrained))
        rated.sort(key=lambda candidate: -candidate.log_odds)
        kept: list[PlaceCandidate] = []
        for candidate in rated:
            behind = rated[0].log_odds - candidate.log_odds
            if behind <= _MAX_ODDS_GAP and all(self._distinct(candidate.pose, k.pose) for k in kept):
                kept.append(candidate)
        return tuple(kept[: 2 * HYPOTHESES])

    def _distinct(self, a: Pose2, b: Pose2) -> bool:
        turned = abs(wrap_angle(a.theta - b.theta))
        return math.hypot(a.x - b.x, a.y - b.y) >= APART_DISTANCE or turned >= APART_ANGLE

    def _accepted(self, driven: float) -> Pose2 | None:
        """Return the pose of the winner once it has won enough searches in a row over enough distance, else None."""
        if not self.candidates or not self.candidates[0].is_constrained or self.probability() < self._min_probability:
            self._winner, self._wins = None, 0
            return None
        best = self.candidates[0].pose
        map_from_local = best @ self._kept[-1][1].inverse()
        same = self._winner is not None and not self._distinct(self._winner @ self._kept[-1][1], best)
        self._wins, self._won_distance = (self._wins + 1, self._won_distance + driven) if same else (1, 0.0)
        self._winner = map_from_local
        done = self._wins >= _CONFIRMATIONS and self._won_distance >= _CONFIRMED_DISTANCE
        return best if done else None
