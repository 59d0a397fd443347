"""Localisation on a saved map: odometry between scans, and each scan matched against the map's walls.

While the pose is known the localiser tracks it. Without a start, or when scans stop fitting, it reports LOST and
searches the whole map (`waychair.slam.localising.kidnap_recovery`) until one place is unambiguous. The published pose moves smoothly:
while tracking, `map_from_odom` changes by at most a small step per scan.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.config import Settings, setting
from waychair.geometry import wrap_angle
from waychair.maps.grid.cells import occupied, points_from_cells
from waychair.slam.localising.kidnap_recovery import KidnapRecovery, SavedMap
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.slam.scan.beam_model import ON_OBJECT, beam_classes, beam_map, pose_probability
from waychair.slam.scan.reference_surfaces import reference_from_points
from waychair.slam.scan.relocaliser import pyramid_from_grid
from waychair.slam.scan.scan_matching import BEAM_SIGMA, Match, MatchSettings, Window, match
from waychair.slam.scan.scan_points import MIN_POINTS, ScanPoints, scan_points
from waychair.types import FloatArray, OccupancyGrid, Pose2, Scan, Twist

__all__ = ["Localisation", "LocalisationState", "Localiser", "LocaliserSettings", "wall_points"]


_SEARCH_WINDOW = Window(0.25, 0.15)  # round the odometry
_START_WINDOW = Window(0.75, 0.4)  # round a given start
_POSITION_NOISE, _ANGLE_NOISE = 0.03, 0.02  # m, rad; standard deviations of the odometry since the last scan
_MAX_POINTS = 360  # points of a scan that are matched
_HIDDEN_SHARE = 0.8  # with a larger share of beams on people and objects, the odometry is taken
_STILL_DISTANCE, _STILL_ANGLE = 0.05, 0.05  # m, rad; a chair that moved less since a scan fitted stands still
_LARGE_DISTANCE, _LARGE_ANGLE = 0.15, 0.1  # m, rad; a larger correction contradicts the odometry
_MAX_CONTRADICTIONS = 3  # of the last 10 scans; with so many, the chair was moved by hand and is lost
_STEP_DISTANCE, _STEP_ANGLE = 0.05, 0.05  # m, rad; largest step of the published pose per scan


@dataclass(frozen=True, slots=True)
class LocaliserSettings(Settings):
    """When the pose counts as degraded or lost, and when a lost chair accepts a place."""

    ok_health: float = setting(
        0.8, "",
        "pose probability, by one scan, below which localisation is degraded; larger: the chair slows down more often",
        low=0.0, high=1.0,
    )  # fmt: skip
    lost_health: float = setting(
        0.31, "", "pose probability below which a scan does not fit the map; larger: the chair is lost sooner",
        low=0.0, high=1.0,
    )  # fmt: skip
    lost_scans: int = setting(
        5, "", "scans in a row without a fit to the map after which the chair is lost; more: it is lost later",
        low=1, high=1000,
    )  # fmt: skip
    max_degraded_distance: float = setting(
        4.0,
        "m",
        "distance driven with degraded localisation after which the chair is lost; larger: it is lost later",
        low=0.1,
        high=100.0,
    )
    min_probability: float = setting(
        0.95, "", "probability at which a lost chair accepts a place on the map; larger: it takes longer and errs less",
        low=0.5, high=1.0,
    )  # fmt: skip
    search_resolution: float = setting(
        0.1, "m", "cell side of a lost chair's search of the whole map; larger: it takes less memory on large maps",
        low=0.02, high=1.0,
    )  # fmt: skip
    matching: MatchSettings = field(default_factory=MatchSettings)


class Localiser:
    """Tracks the chair on a map, from a known or an unknown start."""

    def __init__(
        self, grid: OccupancyGrid, base_from_laser: Pose2, start: Pose2 | None, settings: LocaliserSettings
    ) -> None:
        """`start` is a pose in the map, correct to within the start window, or None: then the whole map is searched."""
        self._saved = prepared_map(grid, settings)
        self._base_from_laser, self._settings = base_from_laser, settings
        self._sensor = np.array([base_from_laser.x, base_from_laser.y])
        self._estimate = self._published = Pose2()  # map_from_odom by the scans, and as published
        self.restart(start)

    def restart(self, start: Pose2 | None) -> None:
        """Restart at a pose that the rider gives, or at an unknown pose (None)."""
        self._start = start
        self._state = LocalisationState.LOST if start is None else LocalisationState.DEGRADED
        self._recovery = self._new_recovery()
        self._unfit_scans, self._degraded_distance, self._motion_since_fit = 0, 0.0, Pose2()
        self._has_fitted = False
        self._large_corrections: deque[bool] = deque(maxlen=10)
        self._last_odometry: Pose2 | None = None

    def replace_map(self, saved: SavedMap) -> None:
        """Use a redrawn map of the same building from the next scan on; the pose stays known."""
        self._saved = saved
        if self._state is LocalisationState.LOST:
            self._recovery = self._new_recovery()

    def _new_recovery(self) -> KidnapRecovery:
        return KidnapRecovery(self._saved, self._sensor, self._settings.matching, self._settings.min_probability)

    def process(self, scan: Scan, odom_from_base: Pose2, twist: Twist | None = None) -> Localisation:
        """Return the pose at a scan; `odom_from_base` and `twist` are the odometry at its first beam."""
        points = scan_points(scan, self._base_from_laser, self._settings.matching.range_max, twist)
        if self._state is LocalisationState.LOST:
            return self._search(points, odom_from_base)
        return self._track(points, odom_from_base)

    def _search(self, scan: ScanPoints, odom_from_base: Pose2) -> Localisation:
        """Process one scan while the chair is lost."""
        pose = self._recovery.process(scan, odom_from_base)
        health = self._recovery.probability()
        candidates = self._recovery.candidates
        if pose is None:
            here = self._published @ odom_from_base
            return Localisation(here, self._published, 0.0, self._state, 0.0, candidates=candidates)
        self.restart(pose)
        self._start, self._state, self._last_odometry = None, LocalisationState.OK, odom_from_base
        self._has_fitted = True
        self._estimate = self._published = pose @ odom_from_base.inverse()
        return Localisation(pose, self._published, 1.0, self._state, health, jumped=True, candidates=candidates)

    def _track(self, scan: ScanPoints, odom_from_base: Pose2) -> Localisation:
        """Process one scan while the pose is known."""
        settings, starts = self._settings, self._start is not None
        if self._start is not None:
            self._estimate, self._start = self._start @ odom_from_base.inverse(), None
        guess = self._estimate @ odom_from_base
        found, health = self._match(scan, guess, starts)
        correction = guess.inverse() @ found.pose
        fits = health >= settings.lost_health
        self._large_corrections.append(fits and not starts and self._is_large(correction))
        if fits:
            self._estimate = found.pose @ odom_from_base.inverse()
        self._update_state(odom_from_base, fits, health, blind=len(scan) < MIN_POINTS)
        if starts:
            self._published = self._estimate
        here = self._step_published(odom_from_base)
        remaining = here.inverse() @ (self._estimate @ odom_from_base)
        covariance = found.covariance if fits else None
        return Localisation(
            map_from_base=here,
            map_from_odom=self._published,
            inliers=found.inliers,
            state=self._state,
            health=health,
            covariance=covariance,
            remaining=remaining,
            jumped=starts,
        )

    def _match(self, scan: ScanPoints, guess: Pose2, starts: bool) -> tuple[Match, float]:
        """Return the best fit near the guess, and the probability that it is right."""
        trust = np.diag([_POSITION_NOISE**-2, _POSITION_NOISE**-2, _ANGLE_NOISE**-2])
        window = _SEARCH_WINDOW
        if starts:
            trust, window = np.eye(3), _START_WINDOW
        found = match(
            scan.thinned(_MAX_POINTS),
            self._saved.reference,
            guess=guess,
            guess_information=trust,
            window=window,
            settings=self._settings.matching,
        )
        if len(scan) < MIN_POINTS:
            return found, 0.0
        if not starts:
            shares = self._beam_shares(scan, guess)
            if shares[0, ON_OBJECT] > _HIDDEN_SHARE:  # the scan was matched to people
                found = replace(found, pose=guess, covariance=np.linalg.inv(trust))
                return found, float(pose_probability(shares)[0])
        return found, float(pose_probability(self._beam_shares(scan, found.pose))[0])

    def _beam_shares(self, scan: ScanPoints, pose: Pose2) -> FloatArray:
        """Return the shares (1, 7) of the scan's beam classes at a pose."""
        sensors = np.ascontiguousarray(np.broadcast_to(self._sensor, scan.points.shape))
        return beam_classes(scan.points, sensors, pose.array(), self._saved.beams)

    def _is_large(self, correction: Pose2) -> bool:
        return math.hypot(correction.x, correction.y) > _LARGE_DISTANCE or abs(correction.theta) > _LARGE_ANGLE

    def _update_state(self, odom_from_base: Pose2, fits: bool, health: float, blind: bool) -> None:
        """Update the localisation state with this scan."""
        settings = self._settings
        step = Pose2() if self._last_odometry is None else self._last_odometry.inverse() @ odom_from_base
        self._last_odometry = odom_from_base
        self._motion_since_fit = Pose2() if fits else self._motion_since_fit @ step
        stands = (
            math.hypot(self._motion_since_fit.x, self._motion_since_fit.y) < _STILL_DISTANCE
            and abs(self._motion_since_fit.theta) < _STILL_ANGLE
        )
        self._has_fitted = self._has_fitted or fits
        if fits:
            self._unfit_scans = 0
        elif blind or not stands or not self._has_fitted:
            # while the chair stands at a pose that fitted, the surroundings have changed; a start that never did is wrong
            self._unfit_scans += 1
        well = health >= settings.ok_health and not any(self._large_corrections)
        self._degraded_distance = 0.0 if well else self._degraded_distance + math.hypot(step.x, step.y)
        self._state = LocalisationState.OK if well else LocalisationState.DEGRADED
        contradicted = sum(self._large_corrections) >= _MAX_CONTRADICTIONS
        if (
            self._unfit_scans >= settings.lost_scans
            or contradicted
            or self._degraded_distance > settings.max_degraded_distance
        ):
            self.restart(None)

    def _step_published(self, odom_from_base: Pose2) -> Pose2:
        """Move the published pose one step towards the pose by the scans; return the published `map_from_base`."""
        here = self._published @ odom_from_base
        gap = here.inverse() @ (self._estimate @ odom_from_base)
        away = math.hypot(gap.x, gap.y)
        share = min(1.0, _STEP_DISTANCE / max(away, 1e-9), _STEP_ANGLE / max(abs(gap.theta), 1e-9))
        here = here @ Pose2(share * gap.x, share * gap.y, share * wrap_angle(gap.theta))
        self._published = here @ odom_from_base.inverse()
        return here


def prepared_map(grid: OccupancyGrid, settings: LocaliserSettings) -> SavedMap:
    """Return a map prepared for a localiser with these settings; takes as long as several scans, in any thread."""
    reference = reference_from_points(*wall_points(grid), settings.matching.resolution, BEAM_SIGMA)
    return SavedMap(reference, beam_map(grid), pyramid_from_grid(grid, settings.search_resolution))


def wall_points(grid: OccupancyGrid) -> tuple[FloatArray, FloatArray]:
    """Return points (N, 2) [m] and normals (N, 2), in the map frame, of occupied cells that border on free cells.

    A point is the centre of its cell: lidar hits spread over the cells that they made occupied, so the centre is the
    surface's mean position. The normal belongs to a line through the nearest such cells and points to the free side.
    """
    from scipy.spatial import cKDTree

    solid = np.pad(occupied(grid), 1)
    free = np.pad((grid.cells >= 0) & ~occupied(grid), 1)
    points, facing = [], []
    for row, col in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        cells = np.argwhere(solid & np.roll(free, (-row, -col), axis=(0, 1))) - 1
        centres = points_from_cells(grid, cells)
        normal = grid.map_from_grid @ Pose2(col, row)
        normal_xy = np.array([normal.x - grid.map_from_grid.x, normal.y - grid.map_from_grid.y])
        points.append(centres)
        facing.append(np.broadcast_to(normal_xy, centres.shape))
    every, normals = np.concatenate(points), np.concatenate(facing)
    if len(every) < 3:
        return every, normals
    count = min(9, len(every))
    distances, near = cKDTree(every).query(every, k=count)
    weights = (distances < 4 * grid.resolution) * (np.einsum("nd,nkd->nk", normals, normals[near]) > -0.5)
    total = weights.sum(axis=1)
    offsets = every[near] - (weights[..., None] * every[near]).sum(axis=1)[:, None] / total[:, None, None]
    spread = np.einsum("nk,nki,nkj->nij", weights.astype(float), offsets, offsets)
    line = np.linalg.eigh(spread)[1][:, :, 0]
    mean_facing = np.einsum("nk,nkd->nd", weights.astype(float), normals[near])
    line *= np.where(np.einsum("nd,nd->n", line, mean_facing) < 0, -1.0, 1.0)[:, None]
    return every, line
