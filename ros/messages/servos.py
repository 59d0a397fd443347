"""Messages of the camera on servos: orders, reported angles, pictures, and their pairing."""

from __future__ import annotations

import math
from collections import OrderedDict
from typing import Any

import cv2

from waychair.errors import MessageError, RecordingError
from waychair.recordings.bags.ros_decoding import picture_from_message
from waychair.recordings.bags.ros_messages import BASE_FRAME, header, image, intrinsics, make
from waychair.ros.messages.camera import read_intrinsics
from waychair.ros.messages.wire import require_finite, stamp_of
from waychair.ros.topics import SERVO_FRAME
from waychair.types import PanTiltAngles, PanTiltCommand, Picture


def pan_tilt_command(command: PanTiltCommand) -> Any:
    """Return a waychair_msgs/PanTiltCommand."""
    head = header(command.stamp_ns, BASE_FRAME)
    return make("waychair_msgs/msg/PanTiltCommand", head, command.pan, command.tilt, command.laser)


def read_pan_tilt_command(message: Any) -> PanTiltCommand:
    """Return the order of a waychair_msgs/PanTiltCommand; pan in [0, 2 pi).

    Raises:
        MessageError: an angle is not finite.
    """
    pan, tilt = float(message.pan), float(message.tilt)
    require_finite("an angle of the camera", pan, tilt)
    return PanTiltCommand(stamp_of(message), pan % math.tau, tilt, bool(message.laser))


def pan_tilt_angles(angles: PanTiltAngles, laser: bool) -> Any:
    """Return a waychair_msgs/PanTiltAngles; `laser`: it was ordered on in the picture of this stamp."""
    head = header(angles.stamp_ns, BASE_FRAME)
    return make("waychair_msgs/msg/PanTiltAngles", head, angles.pan, angles.tilt, angles.settled, laser)


def read_pan_tilt_angles(message: Any) -> tuple[PanTiltAngles, bool]:
    """Return the angles of a waychair_msgs/PanTiltAngles, and whether the laser was ordered on.

    Angles that are not finite are kept: `planning.seen.laser_sight` names servos that do not report.
    """
    angles = PanTiltAngles(stamp_of(message), float(message.pan), float(message.tilt), bool(message.settled))
    return angles, bool(message.laser)


def picture_messages(picture: Picture) -> tuple[Any, Any]:
    """Return a sensor_msgs/Image (rgb8) and its sensor_msgs/CameraInfo."""
    colour = image(picture.stamp_ns, picture.image, "rgb8", SERVO_FRAME)
    height, width = picture.image.shape[:2]
    return colour, intrinsics(picture.stamp_ns, picture.camera_matrix, width, height, SERVO_FRAME)


def read_picture(colour: Any, info: Any, laser: bool) -> Picture:
    """Return the picture of a sensor_msgs/Image and the CameraInfo of its camera.

    Raises:
        MessageError: an impossible image or camera, or one not in colour.
    """
    try:
        pixels = picture_from_message(colour)
    except (RecordingError, cv2.error) as error:
        raise MessageError(f"a picture cannot be read: {error}") from error
    if pixels.ndim != 3:
        raise MessageError("a picture of the camera on servos is grey: the laser's line is red, so send rgb8 or bgr8")
    return Picture(stamp_of(colour), pixels, read_intrinsics(info), laser)


_WAITING = 8
"""Reports of the servos that are kept for pictures that come later."""


class ServoPairing:
    """Pairs pictures with the report of the same stamp, which tells whether the laser was on; in any order of arrival."""

    def __init__(self) -> None:
        self._info: Any = None
        self._lasers: OrderedDict[int, bool] = OrderedDict()
        self._colour: Any = None

    def calibrated(self, info: Any) -> None:
        """Take a sensor_msgs/CameraInfo."""
        self._info = info

    def angles(self, message: Any) -> tuple[PanTiltAngles, Picture | None]:
        """Take a waychair_msgs/PanTiltAngles; return it, and the picture that has waited for it. Raises as `read_picture`."""
        angles, laser = read_pan_tilt_angles(message)
        self._lasers[angles.stamp_ns] = laser
        while len(self._lasers) > _WAITING:
            self._lasers.popitem(last=False)
        return angles, self._paired()

    def colour(self, message: Any) -> Picture | None:
        """Take a sensor_msgs/Image; return the picture if its report has arrived. Raises as `read_picture`."""
        self._colour = message
        return self._paired()

    def _paired(self) -> Picture | None:
        colour = self._colour
        if colour is None or self._info is None or stamp_of(colour) not in self._lasers:
            return None
        self._colour = None
        return read_picture(colour, self._info, self._lasers[stamp_of(colour)])
