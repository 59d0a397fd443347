"""The messages of the camera on servos, over the wire and back, and the simulator node that obeys and sends them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from waychair.calibration.servo_camera_mount import SERVO_CAMERA
from waychair.errors import MessageError
from waychair.recordings.bags import ros_messages
from waychair.ros import topics
from waychair.ros.messages import wire
from waychair.ros.messages.servos import (
    pan_tilt_angles,
    pan_tilt_command,
    picture_messages,
    read_pan_tilt_angles,
    read_pan_tilt_command,
    read_picture,
)
from waychair.ros.messages.wire import stamp_of
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.types import PanTiltAngles, PanTiltCommand, Picture

if TYPE_CHECKING:
    from tests.ros.harness import Harness


def _sent(message: Any) -> Any:
    return wire.deserialised(wire.serialised(message), message.__msgtype__)


def test_orders_angles_and_pictures_arrive_unchanged() -> None:
    order = PanTiltCommand(12, 5.5, -0.2, True)
    assert read_pan_tilt_command(_sent(pan_tilt_command(order))) == order
    angles = PanTiltAngles(13, 1.25, 0.5, False)
    assert read_pan_tilt_angles(_sent(pan_tilt_angles(angles, True))) == (angles, True)
    image = np.random.default_rng(1).integers(0, 255, (6, 8, 3)).astype(np.uint8)
    picture = Picture(14, image, SERVO_CAMERA.camera_matrix, True)
    colour, info = (_sent(each) for each in picture_messages(picture))
    assert colour.header.frame_id == info.header.frame_id == topics.SERVO_FRAME
    came = read_picture(colour, info, True)
    assert (came.stamp_ns, came.laser) == (14, True)
    assert (came.image == image).all()
    assert came.camera_matrix == pytest.approx(SERVO_CAMERA.camera_matrix)


def test_an_order_wraps_into_the_servos_range_and_one_that_is_no_angle_is_refused() -> None:
    assert read_pan_tilt_command(pan_tilt_command(PanTiltCommand(0, -0.5, 0.0))).pan == pytest.approx(math.tau - 0.5)
    for pan, tilt in ((math.nan, 0.0), (0.0, math.inf)):
        with pytest.raises(MessageError, match="an angle of the camera"):
            read_pan_tilt_command(pan_tilt_command(PanTiltCommand(0, pan, tilt)))


def test_a_grey_picture_and_a_camera_without_focal_length_are_refused() -> None:
    _, info = picture_messages(Picture(0, np.zeros((4, 4, 3), np.uint8), SERVO_CAMERA.camera_matrix))
    grey = ros_messages.image(0, np.zeros((4, 4), np.uint8), "mono8", topics.SERVO_FRAME)
    with pytest.raises(MessageError, match="red"):
        read_picture(grey, info, False)
    colour, blank = picture_messages(Picture(0, np.zeros((4, 4, 3), np.uint8), np.zeros((3, 3))))
    with pytest.raises(MessageError, match="calibrate"):
        read_picture(colour, blank, False)


@pytest.mark.nightly
@pytest.mark.skipif(renderer_problem() is not None, reason=str(renderer_problem()))
def test_the_simulator_turns_the_camera_as_told_and_sends_what_it_sees(ros: Harness) -> None:
    heard = {each: ros.heard(each, f"/eye/{each.name}") for each in (topics.PAN_TILT, topics.SERVO_PICTURE)}
    arguments = ("-p", "sensors.servo_camera.rate_hz:=2.0", "-p", "camera:=false", "-r", "__ns:=/eye")
    with ros.process("-m", "waychair.ros.nodes.simulator_node", "--ros-args", *arguments):
        tell = ros.publisher(topics.PAN_TILT_COMMAND, f"/eye/{topics.PAN_TILT_COMMAND.name}")
        angles = heard[topics.PAN_TILT]

        def there() -> bool:
            told = [read_pan_tilt_angles(message) for message in angles]
            turned = any(each.settled and abs(each.pan - 1.0) < 1e-6 and laser for each, laser in told)
            return turned and len(heard[topics.SERVO_PICTURE]) > 2

        ros.spin_until(there, "the camera's aim", lambda: tell(pan_tilt_command(PanTiltCommand(0, 1.0, 0.0, True))))
    stamps = {stamp_of(message) for message in angles}
    assert {stamp_of(message) for message in heard[topics.SERVO_PICTURE]} <= stamps
