"""Visual odometry with depth: each picture is tracked against a map of landmarks, each known by its first patch.

Frame to map, as in RTAB-Map (Labbe and Michaud, JFR 2019, section 3.2): guess the motion, search the landmarks where
the guess projects them, fit the pose, make a key frame where too little of the map is seen, and adjust the latest key
frames. Patches are aligned (`patch_alignment`), since descriptors lie on whole pixels.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import cv2
import numpy as np

from waychair.config import Settings, setting
from waychair.slam.camera.dense_alignment import align_pictures
from waychair.slam.camera.feature_settings import FeatureSettings
from waychair.slam.camera.features import ImageFeatures, gray_image
from waychair.slam.camera.patch_alignment import affine_kernel, align
from waychair.slam.camera.picture_features import PictureFeatures, without_rolling_shutter
from waychair.slam.camera.picture_registration import Registration, register
from waychair.slam.camera.reprojection import NoiseModel, PoseFit, back_project, fit_pose, pinhole, project, unrolled
from waychair.slam.camera.tracked_picture import Picture, PictureOutcome, TrackedPicture
from waychair.slam.camera.visual_map import DEPTH_STEP, KeyFrame, VisualMap, inverse_depths, pyramid_of
from waychair.types import FloatArray, IntArray, Pose3, RgbdFrame

Recall: TypeAlias = Callable[[ImageFeatures], Sequence[int]]
"""Returns the key frames most similar to a picture by features of places, best first."""


_LANDMARKS = 350  # landmarks searched in a picture
_CELL = 32  # [px] side of the squares over which they are spread
_CORNER_QUALITY = 0.005  # weakest corner as a share of the strongest
_CORNER_DISTANCE = 10.0  # [px] between corners
_MIN_CORRELATION = 0.8  # of a patch with its first one
_MIN_INLIERS, _MIN_SHARE = 20, 0.4  # least landmarks of a pose, and their least share of the found ones
_KEY_SHARE = 0.75  # a key frame is made when a smaller share of the nearest one's landmarks is seen,
KEY_ANGLE, KEY_DISTANCE = 0.25, 0.15  # or beyond this [rad], [m] from the nearest one
_WINDOW, _NEIGHBOURS = 8, 6  # latest key frames adjusted together, with others that share most landmarks
_ADJUSTMENTS = 5  # steps of each bundle adjustment
_FOUND_SHARE = 0.25  # landmarks found less often where they should be seen are removed
_LEAST_CONTRAST = 4.0  # [grey levels] standard deviation below which a picture is blank
_NOISE = NoiseModel()


@dataclass(frozen=True, slots=True)
class VisualOdometrySettings(Settings):
    """Settings of the visual odometry."""

    max_speed: float = setting(
        2.0,
        "m/s",
        "fastest motion of the camera that a pose may need; larger: fewer poses are rejected, more are wrong",
        low=0.1,
        high=100.0,
    )
    max_depth: float = setting(
        6.0,
        "m",
        "farthest depth of new landmarks; larger: distant points of rough depth are used, too",
        low=0.5,
        high=100.0,
    )
    restart_after: float = setting(
        2.0, "s",
        "time without tracking after which a new piece of the map begins; larger: longer waits for known places",
        low=0.0, high=1e6,
    )  # fmt: skip
    features: FeatureSettings = field(default_factory=lambda: FeatureSettings(upright=False))


_LONGEST_STEP = 0.3  # [s] longest time over which the camera's velocity is extrapolated
_PAUSE, _LONG = 1.7, 0.1  # a pause is longer than _PAUSE shortest intervals, or than _LONG [s]


class VisualOdometry:
    """Pass frames to `process` in order; `map` holds the key frames and landmarks so far."""

    def __init__(self, settings: VisualOdometrySettings | None = None, recall: Recall | None = None) -> None:
        """Begin without a map. `recall` proposes key frames for a lost camera, besides the latest ones as they are seen from nearby."""
        self.settings = settings or VisualOdometrySettings()
        self.map: VisualMap | None = None
        self.features = PictureFeatures(self.settings.features)
        self._recall = recall
        self.piece = 0  # piece of the map that the camera is in
        self.counts: Counter[str] = Counter()
        self._last: Picture | None = None
        self._tracked: TrackedPicture | None = None  # the latest result with a pose
        self._velocity = np.zeros(6)  # rotation vector [rad/s], translation [m/s] of the camera's motion
        self._stamp = 0
        self._unsure_start = False  # the first key frame is not yet corrected for the rolling shutter
        self._interval = _LONGEST_STEP  # [s] shortest interval between two pictures

    @property
    def _current_map(self) -> VisualMap:
        """The map, which must exist."""
        assert self.map is not None
        return self.map

    def process(self, frame: RgbdFrame) -> TrackedPicture:
        """Process a frame; return its pose and outcome."""
        gray = gray_image(frame.image)
        if float(gray[::4, ::4].std()) < _LEAST_CONTRAST:
            return self._count_state(TrackedPicture(PictureOutcome.BLIND))
        picture = Picture(frame, pyramid_of(gray), frame.depth)
        if self.map is None:
            return self._count_state(self._start(picture))
        paused = self._has_paused(picture)
        tracked = self._follow(picture, self._guess(picture, self._predict(frame.stamp_ns)), PictureOutcome.FOLLOWED)
        if tracked is not None and self._unsure_start and picture.frame.row_step:
            tracked = self._start_again(picture, tracked)
        if tracked is None or paused or self._is_key(tracked):  # never build a map on a wrong pose
            tracked = self._better_pose(picture, tracked)
        if tracked is None:
            return self._count_state(self._begin_new_piece(picture))
        if tracked.state is PictureOutcome.FOLLOWED and self._is_key(tracked):
            tracked = self._add_key(picture, tracked)
        self._remember(picture, tracked)
        return self._count_state(tracked)

    def relocate_newest(self, piece: int) -> None:
        """Search the newest key frame's landmarks again, after the map was bent and joined to `piece`."""
        assert self._last is not None
        assert self._tracked is not None
        self.piece, key = piece, len(self._current_map.key_frames) - 1
        own = self._current_map.key_frames[key]
        self._tracked = replace(self._tracked, camera_from_map=own.camera_from_map)
        again = self._follow(self._last, own.camera_from_map, PictureOutcome.FOLLOWED, self._tracked.velocity)
        if again is not None:
            fresh = ~np.isin(again.landmarks, own.landmarks)
            own.landmarks = np.concatenate([own.landmarks, again.landmarks[fresh]])
            own.observed = np.concatenate([own.observed, again.observed[fresh]])
            self._current_map.adjust(self._window(key), _NOISE, _ADJUSTMENTS)
        self._tracked = replace(
            self._tracked, camera_from_map=own.camera_from_map, landmarks=own.landmarks, observed=own.observed
        )

    def _count_state(self, tracked: TrackedPicture) -> TrackedPicture:
        self.counts[tracked.state.name.lower()] += 1
        return tracked

    def _start(self, picture: Picture, velocity: FloatArray | None = None) -> TrackedPicture:
        """Make the first key frame, at the map's origin; its velocity is unknown before the second picture."""
        camera = pinhole(picture.frame.camera_matrix)
        self.map, self._unsure_start = VisualMap(camera), velocity is None
        started = TrackedPicture(PictureOutcome.STARTED, Pose3(np.eye(3), np.zeros(3)))
        tracked = self._add_key(picture, started if velocity is None else replace(started, velocity=velocity))
        if len(tracked.landmarks) < _MIN_INLIERS:
            self.map = None
            return TrackedPicture(PictureOutcome.NO_DEPTH)
        self._remember(picture, tracked)
        return tracked

    def _start_again(self, picture: Picture, tracked: TrackedPicture) -> TrackedPicture | None:
        """Make the first key frame again with the velocity from the second picture, and track the second against it."""
        assert self._last is not None
        assert tracked.camera_from_map is not None
        first, self.counts["key_frames"] = self._last, 0
        self._start(first, tracked.velocity)
        return self._follow(picture, tracked.camera_from_map, PictureOutcome.FOLLOWED)

    def _has_paused(self, picture: Picture) -> bool:
        """Return whether the last picture is so old that the guessed motion may be wrong.

        Points nearly in a plane look almost the same from two poses (Schweighofer and Pinz, PAMI 2006); a fit begun
        near the wrong one stays there.
        """
        elapsed = (picture.frame.stamp_ns - self._stamp) * 1e-9
        self._interval = min(self._interval, elapsed)
        return elapsed > min(_PAUSE * self._interval, _LONG)

    def _better_pose(self, picture: Picture, guessed: TrackedPicture | None) -> TrackedPicture | None:
        """Return the guessed result, or that by features if it sees more of the map."""
        piece = self.piece
        found = self._find_again(picture, lost=guessed is None)
        if guessed is None or found is None:
            return found if guessed is None else guessed
        if self.piece != piece or len(found.landmarks) <= len(guessed.landmarks):
            self.piece = piece  # tracking stays in its piece; only a loop joins it to another
            return guessed
        return replace(found, state=PictureOutcome.FOLLOWED)

    def _remember(self, picture: Picture, tracked: TrackedPicture) -> None:
        assert tracked.camera_from_map is not None
        self._velocity = self._velocity_to(tracked.camera_from_map, picture)
        self._last, self._tracked, self._stamp = picture, tracked, picture.frame.stamp_ns

    def _predict(self, stamp_ns: int) -> Pose3:
        """Return camera_from_map for a camera of constant velocity."""
        assert self._tracked is not None
        assert self._tracked.camera_from_map is not None
        step = self._velocity * min(max((stamp_ns - self._stamp) * 1e-9, 0.0), _LONGEST_STEP)
        from scipy.spatial.transform import Rotation

        return Pose3(Rotation.from_rotvec(step[:3]).as_matrix(), step[3:]) @ self._tracked.camera_from_map

    def _guess(self, picture: Picture, predicted: Pose3) -> Pose3:
        """Return the better of prediction and standing still, refined by dense alignment with the last picture."""
        assert self._last is not None
        assert self._tracked is not None
        last = self._tracked.camera_from_map
        assert last is not None
        fits = []
        for start in (predicted @ last.inverse(), Pose3(np.eye(3), np.zeros(3))):
            fit = align_pictures(
                before=self._last.pyramid,
                depth=self._last.depth,
                now=picture.pyramid,
                camera=self._current_map.camera,
                guess=start,
                levels=(4, 3),
            )
            fits.append(fit)
        best = min(fits, key=lambda fit: fit.loss / max(fit.share, 1e-3))
        best = align_pictures(
            before=self._last.pyramid,
            depth=self._last.depth,
            now=picture.pyramid,
            camera=self._current_map.camera,
            guess=best.now_from_before,
            levels=(2,),
        )
        return best.now_from_before @ last

    def _follow(
        self, picture: Picture, guess: Pose3, state: PictureOutcome, known_velocity: FloatArray | None = None
    ) -> TrackedPicture | None:
        """Fit the pose to the landmarks of the map near `guess`; return None if too few are found."""
        settings, camera = self.settings, self._current_map.camera
        wanted, expected = self._in_view(guess, picture)
        if len(wanted) < _MIN_INLIERS:
            return None
        velocity = self._velocity_to(guess, picture) if known_velocity is None else known_velocity
        rolled = unrolled(expected, velocity, -picture.row_time(expected[:, 1]), camera)
        pixels, level = self._aligned(picture, wanted, guess, rolled[:, :2])
        good = level >= 0
        if good.sum() < _MIN_INLIERS:
            return None
        raw = np.column_stack([pixels[good], inverse_depths(picture.depth, pixels[good]), 2.0 ** level[good]])
        points, pose = self._current_map.points[wanted[good]], guess
        for _ in range(2):  # the second time with the velocity from the first
            velocity = self._velocity_to(pose, picture) if known_velocity is None else known_velocity
            seen = unrolled(raw, velocity, picture.row_time(raw[:, 1]), camera)
            fit: PoseFit = fit_pose(points, seen, camera, guess, _NOISE)
            pose = fit.camera_from_map
        if fit.inliers.sum() < max(_MIN_INLIERS, _MIN_SHARE * good.sum()):
            return None
        if state is PictureOutcome.FOLLOWED and float(np.linalg.norm(velocity[3:])) > settings.max_speed:
            return None
        found = wanted[good][fit.inliers]
        self._current_map.count(wanted, found, _FOUND_SHARE, 8)
        return TrackedPicture(state, fit.camera_from_map, found, seen[fit.inliers], velocity=velocity)

    def _velocity_to(self, pose: Pose3, picture: Picture) -> FloatArray:
        """Return the velocity (6,) [rad/s], [m/s] of points in the camera's frame since the last picture, or 0."""
        before = self._tracked.camera_from_map if self._tracked is not None else None
        elapsed = (picture.frame.stamp_ns - self._stamp) * 1e-9
        if before is None or not 0.0 < elapsed < _LONGEST_STEP:
            return np.zeros(6)
        moved = pose @ before.inverse()
        from scipy.spatial.transform import Rotation

        return np.concatenate([Rotation.from_matrix(moved.rotation).as_rotvec(), moved.translation]) / elapsed

    def _in_view(self, pose: Pose3, picture: Picture) -> tuple[IntArray, FloatArray]:
        """Return landmarks that should be seen from a pose, spread over the picture, and their observations (K, 4)."""
        assert self._tracked is not None
        candidates = self._current_map.landmarks_of(self._local(pose))
        at = project(self._current_map.points[candidates], pose, self._current_map.camera)
        height, width = picture.depth.shape
        margin = 8
        with np.errstate(invalid="ignore"):
            inside = (
                (at[:, 0] > margin) & (at[:, 0] < width - margin) & (at[:, 1] > margin) & (at[:, 1] < height - margin)
            )
        candidates, at = candidates[inside], at[inside]
        reliable = self._current_map.found[candidates] / self._current_map.expected[candidates] + 0.01 * np.minimum(
            self._current_map.found[candidates], 50
        )
        order = np.argsort(-reliable, kind="stable")
        chosen = order[_spread(at[order, :2], _CELL, _LANDMARKS)]
        return candidates[chosen], np.column_stack([at[chosen], np.ones(len(chosen))])

    def _local(self, pose: Pose3) -> list[int]:
        """Return the key frames with a similar view: the latest, and those nearest in position and direction."""
        every = self._current_map.key_frames
        own = [number for number, key in enumerate(every) if key.piece == self.piece]
        keys = [every[number] for number in own]
        if len(keys) <= 12:
            return own
        here, ahead = -pose.rotation.T @ pose.translation, pose.rotation[2]
        places = np.array([-key.camera_from_map.rotation.T @ key.camera_from_map.translation for key in keys])
        facing = np.array([key.camera_from_map.rotation[2] @ ahead for key in keys])
        cost = np.linalg.norm(places - here, axis=1) + 2.0 * np.arccos(np.clip(facing, -1.0, 1.0))
        cost[-3:] = 0.0
        return [own[k] for k in np.argsort(cost, kind="stable")[:12].tolist()]

    def _aligned(
        self, picture: Picture, wanted: IntArray, guess: Pose3, expected: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Return pixels (K, 2) of landmarks in the picture, and the finest level (K,) of each match, or -1."""
        pixels, level = expected.copy(), np.full(len(wanted), -1)
        anchors = self._current_map.anchor[wanted]
        for key in np.unique(anchors).tolist():
            own = np.flatnonzero(anchors == key)
            there = self._current_map.key_frames[key]
            affine = affine_kernel(
                points=self._current_map.points[wanted[own]], reference_turn=there.camera_from_map.rotation,
                reference_shift=there.camera_from_map.translation,
                turn=guess.rotation, shift=guess.translation, camera=self._current_map.camera,
            )  # fmt: skip
            at = self._current_map.anchor_pixel[wanted[own]]
            pixels[own], level[own] = align(
                reference=there.pyramid,
                picture=picture.pyramid,
                at=at,
                affine=affine,
                guess=expected[own],
                levels=(2, 1, 0),
                reach=4.0,
                least=_MIN_CORRELATION,
            )
        return pixels, level

    def _is_key(self, tracked: TrackedPicture) -> bool:
        """Return whether no key frame is near, or too little of the nearest one is seen now.

        The nearest counts and not the latest: a camera that returns to a known place makes no key frame.
        """
        assert tracked.camera_from_map is not None
        own = [key for key in self._current_map.key_frames if key.piece == self.piece]
        away = [self._away(tracked.camera_from_map, key.camera_from_map) for key in own]
        nearest = int(np.argmin(away))
        known = own[nearest].landmarks
        most = min(int(self._current_map.alive[known].sum()), _LANDMARKS)
        share = _KEY_SHARE * min(1.0, 0.75 + away[nearest])  # near by, blur hides landmarks, not displacement
        return away[nearest] > 1.0 or len(tracked.landmarks) < share * most

    def _away(self, pose: Pose3, other: Pose3) -> float:
        """Return the distance of two poses (camera_from_map): 1 where another key frame is due."""
        moved = pose @ other.inverse()
        turned = float(np.arccos(np.clip(0.5 * (np.trace(moved.rotation) - 1.0), -1.0, 1.0)))
        return max(turned / KEY_ANGLE, float(np.linalg.norm(moved.translation)) / KEY_DISTANCE)

    def _add_key(self, picture: Picture, tracked: TrackedPicture) -> TrackedPicture:
        """Make a key frame of the picture with new landmarks where it has few, and adjust the latest key frames."""
        assert tracked.camera_from_map is not None
        key = len(self._current_map.key_frames)
        taken = unrolled(
            tracked.observed, tracked.velocity, -picture.row_time(tracked.observed[:, 1]), self._current_map.camera
        )
        pixels, inverse = self._corners(picture, taken[:, :2])
        raw = np.column_stack([pixels, inverse, np.ones(len(pixels))])
        observed = unrolled(raw, tracked.velocity, picture.row_time(pixels[:, 1]), self._current_map.camera)
        map_from_camera = tracked.camera_from_map.inverse()
        points = (
            back_project(observed, self._current_map.camera) @ map_from_camera.rotation.T + map_from_camera.translation
        )
        fresh = self._current_map.add_landmarks(points, pixels, key)
        landmarks = np.concatenate([tracked.landmarks, fresh])
        seen = np.concatenate([tracked.observed, observed])
        camera = self._current_map.camera
        coarse = np.ascontiguousarray(picture.depth[::DEPTH_STEP, ::DEPTH_STEP])
        self._current_map.key_frames.append(
            KeyFrame(
                stamp_ns=picture.frame.stamp_ns,
                camera_from_map=tracked.camera_from_map,
                pyramid=picture.pyramid,
                landmarks=landmarks,
                observed=seen,
                features=without_rolling_shutter(self.features.plain(picture), picture, tracked.velocity, camera),
                sized=without_rolling_shutter(self.features.sized(picture), picture, tracked.velocity, camera),
                depth=coarse,
                piece=self.piece,
            )
        )
        self.counts["key_frames"] += 1
        if tracked.state is not PictureOutcome.STARTED:
            self.counts["given_up"] += self._current_map.adjust(self._window(key), _NOISE, _ADJUSTMENTS)
        own = self._current_map.key_frames[key]
        return TrackedPicture(
            state=tracked.state,
            camera_from_map=own.camera_from_map,
            landmarks=own.landmarks,
            observed=own.observed,
            key=key,
            velocity=tracked.velocity,
        )

    def _window(self, key: int) -> list[int]:
        """Return the latest key frames, and others that share the most landmarks with the newest."""
        piece = [k for k, own in enumerate(self._current_map.key_frames) if own.piece == self.piece]
        latest = piece[-_WINDOW:]
        shared = self._current_map.sharing(self._current_map.key_frames[key].landmarks)
        shared[latest] = 0
        others = [k for k in np.argsort(-shared, kind="stable").tolist() if shared[k] >= 15]
        return sorted([*latest, *others[:_NEIGHBOURS]])

    def _corners(self, picture: Picture, taken: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pixels (K, 2) of corners with depth away from those taken, and their inverse depths (K,)."""
        settings = self.settings
        with np.errstate(invalid="ignore"):
            mask = ((picture.depth > 0.0) & (picture.depth < settings.max_depth)).astype(np.uint8)
        mask[:12] = mask[-12:] = 0
        mask[:, :12] = mask[:, -12:] = 0
        for x, y in taken.round().astype(int).tolist():
            cv2.circle(mask, (x, y), round(_CORNER_DISTANCE), 0, -1)
        wanted = max(_LANDMARKS - len(taken), _LANDMARKS // 4)
        corners = cv2.goodFeaturesToTrack(picture.pyramid[0], wanted, _CORNER_QUALITY, _CORNER_DISTANCE, mask=mask)
        if corners is None:
            return np.empty((0, 2)), np.empty(0)
        pixels = corners.reshape(-1, 2).astype(np.float64)
        inverse = inverse_depths(picture.depth, pixels)
        known = np.isfinite(inverse)
        return pixels[known], inverse[known]

    def _find_again(self, picture: Picture, lost: bool) -> TrackedPicture | None:
        """Return the result by matching features with the latest and the most similar key frames, or None.

        Features of places are less precise, and locate only a `lost` camera.
        """
        keys, camera, piece = self._current_map.key_frames, self._current_map.camera, self.piece
        plain = self.features.plain(picture)
        for key in range(len(keys) - 1, max(-1, len(keys) - 4), -1):
            tracked = self._found_at(picture, key, register(keys[key].features, plain, camera))
            if tracked is not None:
                return tracked
        if self._recall is not None:
            sized = self.features.sized(picture)
            for key in self._recall(sized):
                for old, new in ((keys[key].features, plain), (keys[key].sized, sized))[: 1 + lost]:
                    tracked = self._found_at(picture, key, register(old, new, camera))
                    if tracked is not None:
                        return tracked
        self.piece = piece
        return None

    def _found_at(self, picture: Picture, key: int, found: Registration) -> TrackedPicture | None:
        """Return the result by following the map from a registration with a key frame, or None."""
        if found.old_from_new is None:
            return None
        own = self._current_map.key_frames[key]
        self.piece = own.piece
        return self._follow(picture, found.old_from_new.inverse() @ own.camera_from_map, PictureOutcome.FOUND)

    def _begin_new_piece(self, picture: Picture) -> TrackedPicture:
        """Return LOST, or after a while begin a new piece of the map at the last known pose."""
        assert self._tracked is not None
        if (picture.frame.stamp_ns - self._stamp) * 1e-9 < self.settings.restart_after:
            return TrackedPicture(PictureOutcome.LOST)
        corners, _ = self._corners(picture, np.empty((0, 2)))
        if len(corners) < _LANDMARKS // 2:
            return TrackedPicture(PictureOutcome.LOST)
        self.piece = 1 + max(key.piece for key in self._current_map.key_frames)
        tracked = self._add_key(picture, TrackedPicture(PictureOutcome.STARTED, self._tracked.camera_from_map))
        self._remember(picture, tracked)
        return tracked


def _spread(pixels: FloatArray, cell: int, most: int) -> IntArray:
    """Return at most `most` indices of pixels (N, 2), taken in turns from squares of the picture, first ones first."""
    if len(pixels) <= most:
        return np.arange(len(pixels))
    squares = (pixels[:, 1] // cell).astype(np.int64) * 1000 + (pixels[:, 0] // cell).astype(np.int64)
    order = np.argsort(squares, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(squares[order]) > 0])
    turn = np.empty(len(pixels), np.int64)
    turn[order] = np.arange(len(pixels)) - np.repeat(starts, np.diff(np.r_[starts, len(pixels)]))
    return np.sort(np.lexsort((np.arange(len(pixels)), turn))[:most])
