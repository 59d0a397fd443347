"""The check whether colour and depth of a recording are of the camera that is told, with its words for people."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from waychair.recordings.recording import Recording
from waychair.slam.camera.camera_fit import CameraFit, fit_camera
from waychair.slam.camera.reprojection import pinhole
from waychair.types import FloatArray, Json


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


def check_camera(recording: Recording) -> CameraCheck:
    """Compare depth with colour over the first turns of a recording; its count of unreadable pictures does not change."""
    unread = Counter(recording.unread)
    first = next(iter(recording.pictures()), None)
    fit = None if first is None else fit_camera(recording.pictures())
    recording.unread.clear()
    recording.unread.update(unread)
    given = pinhole(first.camera_matrix) if first is not None else np.zeros(4)
    return CameraCheck(fit, given)
