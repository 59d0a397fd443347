"""Whether colour and depth are of one camera, and the camera that they are of, from the first turns of a recording.

Depth alone gives the camera's motion between two pictures, by point-to-plane ICP, and colour alone tells where corners
move to. If depth is not registered to colour, or a focal length is another than the given one, the two disagree on
every turn. A least-squares fit over all turns finds the focal lengths of both, the pose between the two sensors, and
the motions together: pixels of tracked corners and distances of depth points to the other picture's surfaces.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TypeAlias

import cv2
import numpy as np

from waychair.slam.camera.features import gray_image
from waychair.slam.camera.meeting_surfaces import Surfaces, between_pixels, meeting, of_squares
from waychair.slam.camera.picture_registration import angle_between
from waychair.slam.camera.reprojection import move_kernel, pinhole, unrolled
from waychair.types import BoolArray, Bytes, Float32Array, FloatArray, Pose3, RgbdFrame

PICTURES = 300
"""Most pictures that are looked at: the first ten seconds of 30 Hz."""

_CORNERS, _APART, _QUALITY = 250, 12, 0.005  # tracked in a picture; least distance [px]; weakest share of the strongest
_WINDOW, _LEVELS = (15, 15), 4  # of the tracking
_BACK = 0.5  # px; a corner that is tracked back to another place was lost
_LEAST_CORNERS = 60  # of a turn
_TURN, _LEAST_TURN = 0.16, 0.08  # rad; a turn is full, and counts
_TURNS, _LEAST_TURNS = 24, 6  # most and least turns that are fitted
_STRIDE = 3  # squares between the surfaces that are compared
_ITERATIONS, _ICP_STEPS = 12, 8
_PIXEL, _HUBER = 0.5, 1.5  # px, sigma
_RANGE = (0.002, 0.001)  # m, 1/m; noise of a surface's depth: constant, and times the squared depth
_PRIOR = 0.1  # standard deviation of shares, rad, m: cameras are no farther from what is told of them
_STEP = 1e-4  # of numerical derivatives
_OFFSET, _ROTATION, _FOCAL = 0.01, 0.01, 0.02  # m, rad, share; what registered cameras are off by at most
_TOLERANCES = np.repeat((_FOCAL, _ROTATION, _OFFSET), (2, 3, 3))
_SURE = 4.0  # standard deviations
_HELD = 1e-6  # standard deviation of what stays as it is told
_EXPLAINED, _EXPLAINED_SHARPLY = 0.8, 0.93
"""Share of the given camera's error that another one may leave: where blur, a rolling shutter and depth's own faults remain,
and where the other camera explains the turns to the noise."""

_SHARP = 0.0013  # share of the focal length: a smaller error is noise


@dataclass(frozen=True, slots=True)
class CameraFit:
    """The camera by which depth and colour agree.

    `colour_focal`, `depth_focal`: factors on the given focal length. `colour_from_depth`: pose of the depth sensor in
    the colour sensor's optical frame. `deviations` (8,): standard deviations of both factors, of the rotation [rad] and
    of the translation [m]. `error_given`, `error_fitted`: middle pixel error [px] of tracked corners over the turns, by
    the given camera and by this one.
    """

    colour_focal: float
    depth_focal: float
    colour_from_depth: Pose3
    deviations: FloatArray
    focal: float
    error_given: float
    error_fitted: float
    turns: int

    @property
    def offset(self) -> float:
        """The distance [m] between the two sensors."""
        return float(np.linalg.norm(self.colour_from_depth.translation))

    @property
    def rotation(self) -> float:
        """The angle [rad] between the two sensors."""
        return angle_between(self.colour_from_depth, Pose3(np.eye(3), np.zeros(3)))

    @property
    def registered(self) -> bool:
        """Whether depth may be registered to colour: nothing shows that the sensors lie or look apart."""
        # each axis by its own doubt: turns of a chair about one axis tell sideways offsets well, and heights hardly
        return not (self._explains and self._apart[2:].any())

    @property
    def focal_right(self) -> bool:
        """Whether both focal lengths may be the given one."""
        return not (self._explains and self._apart[:2].any())

    @property
    def vague(self) -> BoolArray:
        """Which parameters (8,), in the order of `deviations`, the turns tell no better than what is given."""
        vague = (self.deviations > _TOLERANCES) & (np.abs(self._parameters) < self.deviations)
        return np.asarray(vague, np.bool_)

    @property
    def _apart(self) -> BoolArray:
        """Which parameters (8,) are surely not those of a registered camera with the given focal length."""
        return np.asarray(np.abs(self._parameters) > np.maximum(_TOLERANCES, _SURE * self.deviations), np.bool_)

    @property
    def _parameters(self) -> FloatArray:
        """The parameters (8,) as `_Fit` has them."""
        focal = np.log([self.colour_focal, self.depth_focal])
        return np.concatenate([focal, _vector_of(self.colour_from_depth.rotation), self.colour_from_depth.translation])

    @property
    def _explains(self) -> bool:
        """Whether the camera explains the turns much better than the given one; noise alone is not explained away."""
        share = _EXPLAINED if self.error_fitted > _SHARP * self.focal else _EXPLAINED_SHARPLY
        return self.error_fitted < share * self.error_given


_PixelTerm: TypeAlias = tuple[tuple[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, slots=True)
class _Turn:
    """Two pictures between which the camera turned: surfaces, corners (N, 2) [px] in both, and the
    rotation (3, 3) `new_from_old` by the corners."""

    old: Surfaces
    new: Surfaces
    before: FloatArray
    after: FloatArray
    rotation: FloatArray


def fit_camera(frames: Iterable[RgbdFrame]) -> CameraFit | None:
    """Return the camera of the first turns of a recording; None where they are too few to tell."""
    camera, turns = _turns(frames)
    if camera is None or len(turns) < _LEAST_TURNS:
        return None
    return _Fit(camera, turns).solved()


def registered(frame: RgbdFrame, fit: CameraFit) -> RgbdFrame:
    """Return the frame with its depth seen from the colour sensor, and with the fitted focal length.

    Depth points are drawn over the pixels that they cover, the nearest first; other pixels have no depth.
    """
    height, width = frame.depth.shape
    given = pinhole(frame.camera_matrix)
    colour, depth = given * (fit.colour_focal, fit.colour_focal, 1, 1), given * (fit.depth_focal, fit.depth_focal, 1, 1)
    rows, columns = np.nonzero(np.nan_to_num(frame.depth) > 0.0)
    z = frame.depth[rows, columns].astype(np.float64)
    points = np.stack([(columns - depth[2]) / depth[0] * z, (rows - depth[3]) / depth[1] * z, z], axis=1)
    points = points @ fit.colour_from_depth.rotation.T + fit.colour_from_depth.translation
    points = points[points[:, 2] > 0.0]
    u, v = (colour[k] * points[:, k] / points[:, 2] + colour[2 + k] for k in range(2))
    seen = np.full(height * width, np.inf, np.float32)
    size = 0.5 * max(1.0, colour[0] / depth[0]) + 0.01  # px; half the side of a depth pixel in the colour picture
    for du in (-size, size):
        for dv in (-size, size):
            at_u, at_v = np.rint(u + du).astype(np.int64), np.rint(v + dv).astype(np.int64)
            inside = (at_u >= 0) & (at_u < width) & (at_v >= 0) & (at_v < height)
            np.minimum.at(seen, at_v[inside] * width + at_u[inside], points[inside, 2].astype(np.float32))
    seen[~np.isfinite(seen)] = np.nan
    matrix = frame.camera_matrix.copy()
    matrix[0, 0], matrix[1, 1] = colour[0], colour[1]
    return replace(frame, depth=seen.reshape(height, width), camera_matrix=matrix)


def _turns(frames: Iterable[RgbdFrame]) -> tuple[FloatArray | None, list[_Turn]]:
    """Return the camera (4,) of the frames, and the first turns with corners that were tracked through all pictures."""
    turns: list[_Turn] = []
    camera: FloatArray | None = None
    key: RgbdFrame | None = None  # the picture in which the turn began
    last: tuple[Bytes, int] = np.empty((0, 0), np.uint8), 0
    before = now = np.empty((0, 2), np.float32)
    begun: FloatArray | None = None
    for number, frame in enumerate(frames):
        if number >= PICTURES or len(turns) >= _TURNS:
            break
        if camera is None:
            camera = pinhole(frame.camera_matrix)
        gray = gray_image(frame.image)
        if key is not None and gray.shape == last[0].shape:
            there, kept = _tracked(last[0], gray, now)
            seconds = max(frame.stamp_ns - last[1], 1) * 1e-9
            rate = _vector_of(_rotation_of(now[kept], there[kept], camera)) / seconds
            begun = rate if begun is None else begun
            before, now = before[kept], there[kept]
            turn = _rotation_of(before, now, camera)
            angle = float(np.linalg.norm(_vector_of(turn)))
            if len(now) >= _LEAST_CORNERS and angle < _TURN:
                last = gray, frame.stamp_ns
                continue
            if len(now) >= _LEAST_CORNERS and angle >= _LEAST_TURN:
                corners = _unrolled(before, key, begun, camera), _unrolled(now, frame, rate, camera)
                surfaces = Surfaces.of(key, begun), Surfaces.of(frame, rate)
                turns.append(_Turn(*surfaces, *corners, turn))
        key, last, begun = frame, (gray, frame.stamp_ns), None
        found = cv2.goodFeaturesToTrack(gray, _CORNERS, _QUALITY, _APART)
        before = now = np.empty((0, 2), np.float32) if found is None else np.asarray(found, np.float32).reshape(-1, 2)
    return camera, turns


def _unrolled(corners: Float32Array, frame: RgbdFrame, rate: FloatArray, camera: FloatArray) -> FloatArray:
    """Return corners (N, 2) as if all rows were exposed with the middle one, while things turn by `rate` [rad/s]."""
    times = (corners[:, 1].astype(np.float64) - 0.5 * len(frame.depth)) * frame.row_step
    observed = np.column_stack([corners.astype(np.float64), np.full((len(corners), 1), np.nan), np.ones(len(corners))])
    return unrolled(observed, np.concatenate([rate, np.zeros(3)]), times, camera)[:, :2]


def _vector_of(rotation: FloatArray) -> FloatArray:
    """Return the rotation vector (3,) [rad] of a matrix (3, 3) of less than half a turn."""
    return np.asarray(cv2.Rodrigues(rotation)[0], np.float64).ravel()


def _tracked(last: Bytes, gray: Bytes, corners: Float32Array) -> tuple[Float32Array, BoolArray]:
    """Return the corners (N, 2) in the next picture, and which of them (N,) are also tracked back."""
    if not len(corners):
        return corners, np.zeros(0, np.bool_)
    options = {"winSize": _WINDOW, "maxLevel": _LEVELS}
    there, found, _ = cv2.calcOpticalFlowPyrLK(last, gray, corners, None, **options)  # type: ignore[call-overload]
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(gray, last, there, None, **options)  # type: ignore[call-overload]
    near = np.hypot(*(back - corners).T) < _BACK
    return np.asarray(there, np.float32), near & (found.ravel() > 0) & (found_back.ravel() > 0)


def _rotation_of(before: Float32Array, now: Float32Array, camera: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) that takes most corners' directions to those in the other picture (Kabsch), robustly."""
    rays = [np.column_stack([(each - camera[2:]) / camera[:2], np.ones(len(each))]) for each in (before, now)]
    old, new = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in rays)
    weights, turn = np.ones(len(old)), np.eye(3)
    for _ in range(5):
        left, _, right = np.linalg.svd((new * weights[:, None]).T @ old)
        turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        weights = 1.0 / (0.005 + np.linalg.norm(new - old @ turn.T, axis=1))
    return turn


class _Fit:
    """The least squares: parameters (8,) are logarithms of the colour's and depth's focal factors, rotation vector [rad]
    and translation [m] of `colour_from_depth`; each turn has its motion `new_from_old` of the depth sensor."""

    def __init__(self, camera: FloatArray, turns: list[_Turn]) -> None:
        self.camera, self.turns = camera, turns
        self.inverse = np.stack([turn.old.inverse for turn in turns])
        self.owner = np.repeat(np.arange(len(turns)), [len(turn.before) for turn in turns])
        self.before = np.concatenate([turn.before for turn in turns])
        self.after = np.concatenate([turn.after for turn in turns])
        self._planes: tuple[float, list[list[_Planes]]] | None = None  # for a depth's focal factor, of each turn

    def solved(self) -> CameraFit | None:
        """Return the fit; None where depth alone gives too few motions.

        Where the camera is wrong, what the turns do not tell stays as it is given, instead of becoming noise.
        """
        given = np.zeros(8)
        motions = [Pose3(turn.rotation.copy(), np.zeros(3)) for turn in self.turns]
        for _ in range(_ICP_STEPS):
            motions, _ = self._step(given, motions, self._depth_terms(given, motions), None)
        for _ in range(_ICP_STEPS):
            pixels = self._pixel_blocks(given, motions)
            motions, _ = self._step(given, motions, self._depth_terms(given, motions), pixels)
        error_given = self._middle_error(given, motions)
        fit = self._fitted(motions, np.full(8, _PRIOR), error_given)
        if fit is None or (fit.registered and fit.focal_right) or not fit.vague.any():
            return fit
        held = self._fitted(motions, np.where(fit.vague, _HELD, _PRIOR), error_given)
        return None if held is None else replace(held, deviations=fit.deviations)

    def _fitted(self, motions: list[Pose3], priors: FloatArray, error_given: float) -> CameraFit | None:
        """Return the fit with standard deviations (8,) of the given camera, from motions by it."""
        found, deviations = np.zeros(8), np.zeros(8)
        for _ in range(_ITERATIONS):
            terms = self._depth_terms(found, motions)
            if sum(each.count > 0 for each in terms) < _LEAST_TURNS:
                return None
            blocks = self._pixel_blocks(found, motions)
            motions, (step, deviations) = self._step(found, motions, terms, blocks, priors=priors)
            found = found + step
            if np.abs(step).max() < 1e-5:
                break
        pose = _pose(found)
        return CameraFit(
            colour_focal=math.exp(found[0]),
            depth_focal=math.exp(found[1]),
            colour_from_depth=pose,
            deviations=deviations,
            focal=float(self.camera[0]),
            error_given=error_given,
            error_fitted=self._middle_error(found, motions),
            turns=len(self.turns),
        )

    def _middle_error(self, parameters: FloatArray, motions: list[Pose3]) -> float:
        """Return the middle error [px] of the corners."""
        errors, _ = self._pixels(self._points(parameters), parameters, motions)
        lengths = np.hypot(*errors.T)
        return float(np.nanmedian(lengths)) if np.isfinite(lengths).any() else math.nan

    def _points(self, parameters: FloatArray) -> FloatArray:
        """Return the points (N, 3) [m] of the corners in the depth sensor's frame of the old pictures; nan without depth.

        A corner's ray is followed to the surface that the depth sensor sees there.
        """
        colour_from_depth = _pose(parameters)
        turn, shift = colour_from_depth.rotation, colour_from_depth.translation
        colour = self.camera[:2] * math.exp(parameters[0])
        depth = of_squares(self.camera * (math.exp(parameters[1]), math.exp(parameters[1]), 1.0, 1.0))
        rays = np.column_stack([(self.before - self.camera[2:]) / colour, np.ones(len(self.before))]) @ turn
        origin = -shift @ turn
        along = np.full(len(rays), 2.0)
        for _ in range(5):
            points = along[:, None] * rays + origin
            at = depth[:2] * points[:, :2] / points[:, 2:] + depth[2:]
            seen = between_pixels(self.inverse, self.owner, at)
            along = (1.0 / seen - origin[2]) / rays[:, 2]
            along = np.where(np.isfinite(along), along, np.nan)
        return along[:, None] * rays + origin

    def _pixels(
        self, points: FloatArray, parameters: FloatArray, motions: list[Pose3]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the corners' errors (N, 2) [px] in the new pictures, and derivatives (N, 2, 6) by their motions."""
        colour_from_depth = _pose(parameters)
        turns = np.array([motion.rotation for motion in motions])[self.owner]
        shifts = np.array([motion.translation for motion in motions])[self.owner]
        there = np.einsum("nij,nj->ni", turns, points) + shifts
        inside = there @ colour_from_depth.rotation.T + colour_from_depth.translation
        focal = self.camera[:2] * math.exp(parameters[0])
        z = inside[:, 2]
        errors = focal * inside[:, :2] / z[:, None] + self.camera[2:] - self.after
        by_point = np.zeros((len(points), 2, 3))
        for k in range(2):
            by_point[:, k, k] = focal[k] / z
            by_point[:, k, 2] = -focal[k] * inside[:, k] / z**2
        by_point = by_point @ colour_from_depth.rotation
        by_turn = np.cross(there[:, None, :], by_point)
        return errors, np.concatenate([by_turn, by_point], axis=2)

    def _step(
        self,
        parameters: FloatArray,
        motions: list[Pose3],
        terms: list[_DepthTerm],
        pixels: list[_PixelTerm] | None,
        *,
        priors: FloatArray | None = None,
    ) -> tuple[list[Pose3], tuple[FloatArray, FloatArray]]:
        """Return the motions after a Gauss-Newton step, and the step of the parameters with standard deviations (8,).

        The motions are eliminated. Without `pixels` only depth counts; without `priors`, the standard deviations (8,) of
        the given camera, the parameters stay.
        """
        weights = (np.full(8, _PRIOR) if priors is None else priors) ** -2
        normal, pull = np.diag(weights), -parameters * weights
        solved = []
        for number, term in enumerate(terms):
            own, mixed, shared = term.own.copy(), np.zeros((6, 8)), np.zeros((8, 8))
            mixed[:, 1], shared[1, 1] = term.mixed, term.focal
            right, shared_right = term.pull.copy(), np.zeros(8)
            shared_right[1] = term.focal_pull
            if pixels is not None:
                (to_own, to_mixed, to_shared), (to_right, to_shared_right) = pixels[number]
                own, mixed, shared = own + to_own, mixed + to_mixed, shared + to_shared
                right, shared_right = right + to_right, shared_right + to_shared_right
            own += 1e-3 * np.eye(6)
            solved.append((np.linalg.solve(own, mixed), np.linalg.solve(own, right)))
            normal += shared - mixed.T @ solved[-1][0]
            pull += shared_right - mixed.T @ solved[-1][1]
        step = np.zeros(8)
        if priors is not None:
            step = np.asarray(np.linalg.solve(normal, pull), np.float64)
        deviations = np.asarray(np.sqrt(np.diag(np.linalg.inv(normal))), np.float64)
        moved = []
        for motion, (by_camera, alone) in zip(motions, solved, strict=True):
            turn, shift = motion.rotation.copy(), motion.translation.copy()
            move_kernel(turn, shift, np.asarray(alone - by_camera @ step, np.float64))
            moved.append(Pose3(turn, shift))
        return moved, (step, deviations)

    def _pixel_blocks(self, parameters: FloatArray, motions: list[Pose3]) -> list[_PixelTerm]:
        """Return for each turn the normal equations of its corners: by motion, mixed, by parameters, and right sides."""
        errors, by_motion = self._pixels(self._points(parameters), parameters, motions)
        by_camera = np.empty((*errors.shape, 8))
        for k in range(8):
            ahead = parameters + _STEP * np.eye(8)[k]
            by_camera[..., k] = (self._pixels(self._points(ahead), ahead, motions)[0] - errors) / _STEP
        lengths = np.hypot(*errors.T) / _PIXEL
        with np.errstate(divide="ignore", invalid="ignore"):
            weights = np.minimum(1.0, _HUBER / lengths) / _PIXEL**2
        known = np.isfinite(errors).all(axis=1) & np.isfinite(by_camera).all(axis=(1, 2))
        # a corner beside a step of depth jumps with the parameters
        known &= np.abs(by_camera).max(axis=(1, 2), initial=0.0, where=np.isfinite(by_camera)) < 20.0 * self.camera[0]
        blocks = []
        for number in range(len(self.turns)):
            mine = known & (self.owner == number)
            w = weights[mine]
            a, b, e = by_motion[mine], by_camera[mine], errors[mine]
            left = np.einsum("nki,n,nkj->ij", a, w, a), np.einsum("nki,n,nkj->ij", a, w, b)
            right = -np.einsum("nki,n,nk->i", a, w, e), -np.einsum("nki,n,nk->i", b, w, e)
            blocks.append(((*left, np.einsum("nki,n,nkj->ij", b, w, b)), right))
        return blocks

    def _depth_terms(self, parameters: FloatArray, motions: list[Pose3]) -> list[_DepthTerm]:
        """Return the normal equations of depth for each turn, by its motion and by the depth's focal length."""
        logarithm = float(parameters[1])
        cameras = [
            of_squares(self.camera * (factor, factor, 1.0, 1.0))
            for factor in (math.exp(logarithm), math.exp(logarithm + _STEP))
        ]
        if self._planes is None or self._planes[0] != logarithm:  # as long as the camera stays, its planes do
            self._planes = logarithm, [[_Planes.of(turn, camera) for camera in cameras] for turn in self.turns]
        return [
            _depth_term(planes, motion, cameras[0], turn.new.inverse.shape)
            for planes, motion, turn in zip(self._planes[1], motions, self.turns, strict=True)
        ]


@dataclass(frozen=True, slots=True)
class _DepthTerm:
    """Normal equations of a turn's depth: `own` (6, 6) by the motion, `mixed` (6,), `focal` by the focal length, and
    right sides; `count` points met."""

    own: FloatArray
    mixed: FloatArray
    focal: float
    pull: FloatArray
    focal_pull: float
    count: int


@dataclass(frozen=True, slots=True)
class _Planes:
    """Points (N, 3) [m] on the old picture's surfaces and (M, 3) on the new one's, and their normals, by one camera."""

    old: FloatArray
    old_facing: FloatArray
    new: FloatArray
    facing: FloatArray

    @classmethod
    def of(cls, turn: _Turn, camera: FloatArray) -> _Planes:
        """Return the planes of a turn by the camera (4,) of pictures of squares."""
        return cls(*turn.old.planes(camera, _STRIDE), *turn.new.planes(camera))


def _depth_term(planes: list[_Planes], motion: Pose3, camera: FloatArray, shape: tuple[int, ...]) -> _DepthTerm:
    """Compare the old picture's points, moved, with the surfaces of the new one that the camera sees in their place.

    `planes`: by the camera (4,) of pictures of squares of a shape (h, w), and by a slightly longer focal length, for the
    derivative.
    """
    first = planes[0]
    points = first.old @ motion.rotation.T + motion.translation
    met, at = meeting(points, first.old_facing @ motion.rotation.T, first.new, first.facing, camera, shape)
    there, normals, away = points[met], first.facing[at], points[met, 2]
    errors = [
        ((each.old[met] @ motion.rotation.T + motion.translation - each.new[at]) * each.facing[at]).sum(axis=1)
        for each in planes
    ]
    sigma = _RANGE[0] + _RANGE[1] * away**2
    weights = np.minimum(1.0, _HUBER * sigma / np.maximum(np.abs(errors[0]), 1e-9)) / sigma**2
    by_motion = np.concatenate([np.cross(there, normals), normals], axis=1)
    by_focal = (errors[1] - errors[0]) / _STEP
    weighted = by_motion * weights[:, None]
    return _DepthTerm(
        own=weighted.T @ by_motion,
        mixed=weighted.T @ by_focal,
        focal=float((weights * by_focal**2).sum()),
        pull=-weighted.T @ errors[0],
        focal_pull=-float((weights * by_focal * errors[0]).sum()),
        count=len(met),
    )


def _pose(parameters: FloatArray) -> Pose3:
    """Return `colour_from_depth` of the parameters."""
    turn, shift = np.eye(3), np.zeros(3)
    move_kernel(turn, shift, np.concatenate([parameters[2:5], np.zeros(3)]))
    return Pose3(turn, parameters[5:8].copy())
