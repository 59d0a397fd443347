"""Visual registration: the relative pose of two images that show the same place, or the reason for its rejection.

RTAB-Map's registration (0.23.8, RegistrationVis): features are matched by the distance ratio of nearest neighbours, or
within a window round the pixel predicted by a guess; PnP with RANSAC gives the pose from the first image's points and
the second image's pixels; pixels and depth refine it. A second pass takes the first result as its guess.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field

import cv2
import numpy as np

from waychair.slam.camera.feature_matching import distances_between, mutual_matches
from waychair.slam.camera.features import ImageFeatures
from waychair.slam.camera.reprojection import OUTLIER_CHI_SQUARE, NoiseModel, fit_pose, project
from waychair.types import BoolArray, FloatArray, IntArray, Pose3

_MEDIAN = 2.1981  # variance of a normal error over the 25 % quantile of its square, as in RTAB-Map
_LEAST_LINEAR, _LEAST_ANGULAR = 0.01**2, 0.008**2
"""Least variances [m^2], [rad^2] of a pair: the errors of hand-held image pairs against ground truth (nine of ten within
0.027 m and 0.034 rad) are several times larger than the spread of their matches suggests."""


_RATIO = 0.8  # largest ratio of the nearest over the second nearest distance (Vis/CorNNDR)
_WINDOW = 40.0  # px; half window round the pixel predicted by a guess (Vis/CorGuessWinSize)
_REPROJECTION = 3.0  # px; RANSAC's limit (Vis/PnPReprojError)
_ITERATIONS = 300  # of RANSAC (Vis/Iterations)
_MIN_INLIERS = 20  # least number of matches that agree with the pose (Vis/MinInliers)
_MIN_SHARE = 0.25  # least share of the matches near a guess that agree with the pose
_MIN_SPREAD = 0.0025  # least variance across the image, in squares of its width (Vis/MinInliersDistribution)
_MAX_DISTANCE = 5.0  # m; between the two cameras
_NOISE = NoiseModel(pixel=1.5, inverse_depth=0.01)


class RegistrationRefusal(enum.Enum):
    """Why a registration is rejected."""

    FEW_FEATURES = "too few features with depth"
    FEW_MATCHES = "too few features look alike"
    NO_POSE = "no pose agrees with the matches"
    FEW_INLIERS = "too few matches agree with one pose"
    CONTRADICTED = "most matches contradict the pose"
    CLUSTERED = "all matches lie in one spot of the image"
    TOO_FAR = "the two cameras would be too far apart"


@dataclass(frozen=True, slots=True)
class Registration:
    """`old_from_new` of two cameras with its covariance (6, 6) of rotation [rad], translation [m], or the reason for none.

    Of the `matches` of similar features, `inliers` agree with the pose.
    """

    old_from_new: Pose3 | None
    covariance: FloatArray
    matches: int = 0
    inliers: int = 0
    refusal: RegistrationRefusal | None = None
    points: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    """Points (N, 3) [m] of the inliers, in the old camera's frame."""
    pixels: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """Their pixels (N, 2) in the new image."""
    limits: FloatArray = field(default_factory=lambda: np.empty(0))
    """Largest reprojection error (N,) [px] of each inlier."""

    def inlier_share(self, old_from_new: Pose3, camera: FloatArray) -> float:
        """Return the share of this pose's inliers that agree with another pose."""
        at = project(self.points, old_from_new.inverse(), camera)[:, :2]
        with np.errstate(invalid="ignore"):
            return float((np.hypot(*(at - self.pixels).T) <= self.limits).mean()) if len(at) else 0.0


def register(
    old: ImageFeatures,
    new: ImageFeatures,
    camera: FloatArray,
    old_from_new: Pose3 | None = None,
) -> Registration:
    """Return the pose of the camera (fx, fy, cx, cy) of `new` in that of `old`, whose features must have depth.

    With a guess, only features near their predicted pixels are matched; if that fails, all are.
    """
    old = old.take(np.isfinite(old.points[:, 2]))
    if min(len(old), len(new)) < _MIN_INLIERS:
        return _refused(RegistrationRefusal.FEW_FEATURES)
    result = _refused(RegistrationRefusal.NO_POSE)
    if old_from_new is not None:
        result = _registered(old, new, camera, old_from_new)
    if result.old_from_new is None:
        result = _registered(old, new, camera, None)
    if result.old_from_new is None:
        return result
    again = _registered(old, new, camera, result.old_from_new)
    return again if again.inliers >= result.inliers or again.refusal is RegistrationRefusal.CONTRADICTED else result


def match_features(old: ImageFeatures, new: ImageFeatures, ratio: float, near: BoolArray | None = None) -> IntArray:
    """Return (K, 2) indices in `old` and `new` of mutual nearest features that pass the ratio test.

    `near` (N, M) marks the pairs that may be matched.
    """
    distances = distances_between(old.descriptors, new.descriptors)
    if near is None:
        return np.asarray(mutual_matches(distances, ratio), np.int64)
    distances[~near] = np.inf
    pairs = np.asarray(mutual_matches(distances, ratio), np.int64)
    return pairs[near[pairs[:, 0], pairs[:, 1]]]


def _registered(old: ImageFeatures, new: ImageFeatures, camera: FloatArray, guess: Pose3 | None) -> Registration:
    """Run one pass; a guess (old_from_new) limits the matches and replaces RANSAC as the start of the fit."""
    mask = None if guess is None else _near(old, new, camera, guess)
    i, j = match_features(old, new, _RATIO, mask).T
    if len(i) < _MIN_INLIERS:
        return _refused(RegistrationRefusal.FEW_MATCHES, len(i))
    points, pixels = old.points[i].astype(np.float64), new.pixels[j].astype(np.float64)
    start = guess.inverse() if guess is not None else _ransac(points, pixels, camera)
    if start is None:
        return _refused(RegistrationRefusal.NO_POSE, len(i))
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / new.points[j, 2].astype(np.float64)
    # a corner found on a coarse pyramid level is only as accurate as that level's pixels
    scale = np.maximum(1.0, 1.2 ** new.octave[j].astype(np.float64)) if new.octave.any() else np.ones(len(j))
    fit = fit_pose(points, np.column_stack([pixels, inverse, scale]), camera, start, _NOISE)
    inliers = int(fit.inliers.sum())
    if inliers < _MIN_INLIERS:
        return _refused(RegistrationRefusal.FEW_INLIERS, len(i), inliers)
    if guess is not None and inliers < _MIN_SHARE * len(i):
        return _refused(RegistrationRefusal.CONTRADICTED, len(i), inliers)
    if _spread(pixels[fit.inliers], camera) < _MIN_SPREAD:
        return _refused(RegistrationRefusal.CLUSTERED, len(i), inliers)
    old_from_new = fit.camera_from_map.inverse()
    if float(np.linalg.norm(old_from_new.translation)) > _MAX_DISTANCE:
        return _refused(RegistrationRefusal.TOO_FAR, len(i), inliers)
    covariance = _covariance(points[fit.inliers], new.points[j][fit.inliers].astype(np.float64), old_from_new)
    limits = _NOISE.pixel * scale * math.sqrt(OUTLIER_CHI_SQUARE)
    return Registration(
        old_from_new=old_from_new,
        covariance=covariance,
        matches=len(i),
        inliers=inliers,
        refusal=None,
        points=points[fit.inliers],
        pixels=pixels[fit.inliers],
        limits=limits[fit.inliers],
    )


def _near(old: ImageFeatures, new: ImageFeatures, camera: FloatArray, guess: Pose3) -> BoolArray:
    """Return (N, M): which features of `new` lie near the predicted pixels of those of `old`."""
    expected = project(old.points.astype(np.float64), guess.inverse(), camera)[:, :2]
    with np.errstate(invalid="ignore"):
        near = np.all(np.abs(expected[:, None] - new.pixels[None]) < _WINDOW, axis=2)
    return np.asarray(near, bool)


def _ransac(points: FloatArray, pixels: FloatArray, camera: FloatArray) -> Pose3 | None:
    """Return the camera_from_points on which most matches agree, or None."""
    matrix = np.array([[camera[0], 0.0, camera[2]], [0.0, camera[1], camera[3]], [0.0, 0.0, 1.0]])
    cv2.setRNGSeed(0)  # deterministic result
    try:
        found, turn, shift, _ = cv2.solvePnPRansac(
            points, pixels, matrix, None, iterationsCount=_ITERATIONS,
            reprojectionError=_REPROJECTION, flags=cv2.SOLVEPNP_AP3P,
        )  # fmt: skip
    except cv2.error:  # no four points determine a pose
        return None
    pose = (
        Pose3(np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.asarray(shift, np.float64).ravel()) if found else None
    )
    return pose if pose is not None and np.isfinite(pose.translation).all() else None


def _spread(pixels: FloatArray, camera: FloatArray) -> float:
    """Return the smaller principal variance of pixels (N, 2), in squares of the image width."""
    inside = (pixels - pixels.mean(axis=0)) / (2.0 * camera[2])
    return float(np.linalg.eigvalsh(inside.T @ inside / len(inside))[0])


def _covariance(old: FloatArray, new: FloatArray, old_from_new: Pose3) -> FloatArray:
    """Return the covariance (6, 6) by the distances between both point sets: RTAB-Map's 25 % quantile, isotropic.

    A point of `new` without depth is placed at 1.1 times the predicted distance, as RTAB-Map does.
    """
    inside = (old - old_from_new.translation) @ old_from_new.rotation
    moved = np.where(np.isfinite(new), new, 1.1 * inside)
    away = ((moved - inside) ** 2).sum(axis=1)
    cosine = (moved * inside).sum(axis=1) / (np.linalg.norm(moved, axis=1) * np.linalg.norm(inside, axis=1))
    angles = np.arccos(np.clip(cosine, -1.0, 1.0)) ** 2
    quarter = len(away) // 4
    linear, angular = (_MEDIAN * float(np.sort(values)[quarter]) for values in (away, angles))
    return np.diag([max(angular, _LEAST_ANGULAR)] * 3 + [max(linear, _LEAST_LINEAR)] * 3)


def _refused(refusal: RegistrationRefusal, matches: int = 0, inliers: int = 0) -> Registration:
    return Registration(None, np.full((6, 6), np.nan), matches, inliers, refusal)


def angle_between(a: Pose3, b: Pose3) -> float:
    """Return the angle [rad] of the rotation between two poses."""
    from scipy.spatial.transform import Rotation

    return float(np.linalg.norm(Rotation.from_matrix(a.rotation.T @ b.rotation).as_rotvec()))
