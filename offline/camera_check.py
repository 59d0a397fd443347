"""The check whether colour and depth of a recording are of the camera that is told, with its words for people."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, islice
from typing import Literal

from waychair.errors import RecordingError
from waychair.recordings.recording import Recording
from waychair.slam.camera.camera_fit import PICTURES, CameraFit, fit_camera, registered
from waychair.slam.camera.reprojection import pinhole
from waychair.types import FloatArray, Json, RgbdFrame


@dataclass(frozen=True, slots=True)
class CameraCheck:
    """The camera by which colour and depth agree, None where there are too few turns to tell, and the given one (4,)."""

    fit: CameraFit | None
    given: FloatArray

    @property
    def fits(self) -> bool:
        """Whether nothing shows that the given camera is wrong."""
        return self.fit is None or (self.fit.registered and self.fit.focal_right)

    def sentences(self, used: bool) -> list[str]:
        """Return the warning about a camera that does not fit, with the way on unless the estimate is `used`."""
        if self.fit is None or self.fits:
            return []
        fit, amiss = self.fit, []
        if not fit.registered:
            x, y, z = (1e3 * fit.colour_from_depth.translation).round().astype(int).tolist()
            amiss.append(
                f"depth is not registered to colour: the depth sensor lies {1e3 * fit.offset:.0f} mm from the colour sensor "
                f"({x}, {y}, {z} mm right, down and ahead) and is turned by {math.degrees(fit.rotation):.1f} degrees"
            )
        if not fit.focal_right:
            colour, depth = self.given[0] * fit.colour_focal, self.given[0] * fit.depth_focal
            amiss.append(
                f"the focal length is {colour:.1f} px in colour and {depth:.1f} px in depth, not {self.given[0]:.1f}"
            )
        way = "this is used" if used else "trajectory and map are bent by it; --register auto uses the estimate"
        return [f"{' and '.join(amiss)} (by the first {fit.turns} turns): {way}"]

    def data(self, used: bool) -> Json:
        """Return the part of report.json."""
        if self.fit is None:
            return {"turns": "too few to check colour and depth"}
        fit = self.fit
        return {
            "turns": fit.turns,
            "registered": fit.registered,
            "focal_right": fit.focal_right,
            "estimate_used": used,
            "offset_m": [round(value, 4) for value in fit.colour_from_depth.translation.tolist()],
            "rotation_deg": round(math.degrees(fit.rotation), 2),
            "colour_focal_px": round(float(self.given[0]) * fit.colour_focal, 1),
            "depth_focal_px": round(float(self.given[0]) * fit.depth_focal, 1),
            "error_px": {"given": round(fit.error_given, 2), "estimated": round(fit.error_fitted, 2)},
        }


@dataclass(frozen=True, slots=True)
class CheckedPictures:
    """A recording with its pictures as they are to be used, and what the check of their camera found.

    `check` is None where no picture with depth can be read. `used`: whether the pictures are those of the estimated
    camera. `seconds`: CPU time [s] of the check.
    """

    recording: Recording
    check: CameraCheck | None
    used: bool
    seconds: float

    def sentences(self) -> list[str]:
        """Return the warning about a camera that does not fit."""
        return [] if self.check is None else self.check.sentences(self.used)

    def data(self) -> Json:
        """Return the part `camera` of report.json; empty without a check."""
        return {} if self.check is None else self.check.data(self.used)


def checked_pictures(recording: Recording, register: Literal["check", "auto"]) -> CheckedPictures:
    """Check the camera of a recording's pictures; with "auto" they become those of the estimate, if the camera is wrong.

    Only the first `PICTURES` pictures are read for it, once.
    """
    began = time.process_time()
    check = _camera_check(recording)
    estimate = None if check is None or check.fits or register != "auto" else check.fit
    if estimate is not None:
        recording = replace(recording, pictures=partial(_registered, recording.pictures, estimate))
    return CheckedPictures(recording, check, estimate is not None, time.process_time() - began)


def _camera_check(recording: Recording) -> CameraCheck | None:
    """Compare depth with colour over the first turns of a recording; its count of unreadable pictures does not change."""
    unread = Counter(recording.unread)
    pictures = islice(recording.pictures(), PICTURES)
    try:
        first = next(pictures, None)
        if first is None:
            return None
        return CameraCheck(fit_camera(chain([first], pictures)), pinhole(first.camera_matrix))
    except RecordingError:
        return None  # who uses the pictures tells it
    finally:
        recording.unread.clear()
        recording.unread.update(unread)


def _registered(pictures: Callable[[], Iterator[RgbdFrame]], fit: CameraFit) -> Iterator[RgbdFrame]:
    for picture in pictures():
        yield registered(picture, fit)
