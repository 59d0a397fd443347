"""The chair's URDF for RViz and other tools, and the frames of its wheels, both from the chair's file.

Joints have the names of joint_states. Fixed joints equal the static transforms of `mounts`. Angles and axes follow
REP-103; a joint's `rpy` are rotations about the fixed axes x, y, z in turn (http://wiki.ros.org/urdf/XML/joint).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from scipy.spatial.transform import Rotation

from waychair.calibration.chair_body import BodyLayer, ChairBody
from waychair.recordings.bags.ros_messages import BASE_FRAME, WHEEL_JOINTS, make
from waychair.ros.mounts import static_transforms
from waychair.types import Pose3, WheelTicks

WHEEL_FRAMES = tuple(joint.replace("_joint", "_link") for joint in WHEEL_JOINTS)

_WHEEL_WIDTH = 0.05  # m; for drawing only
_SEAT = (0.10, 0.50)  # m above the floor; for drawing a chair with one outline for all heights
_SENSOR_SIZE = 0.04  # m; for drawing only
_COLOURS = {"body": "0.20 0.35 0.60 0.45", "wheel": "0.10 0.10 0.10 1", "sensor": "0.90 0.55 0.10 1"}


def robot_description(body: ChairBody) -> Any:
    """Return a std_msgs/String with the chair's URDF."""
    return make("std_msgs/msg/String", urdf(body))


def urdf(body: ChairBody) -> str:
    """Return the URDF (XML) of a chair: its outline, its turning drive wheels, and the frames of its sensors."""
    robot = Element("robot", name=f"waychair_{body.chair_id}")
    for name, rgba in _COLOURS.items():
        SubElement(SubElement(robot, "material", name=name), "color", rgba=rgba)
    _add_base(robot, body)
    for frame, joint, (_, mount) in zip(WHEEL_FRAMES, WHEEL_JOINTS, _wheels(body, (0.0, 0.0)).items(), strict=True):
        _add_wheel(robot, frame, body.wheel_radius)
        _add_joint(robot=robot, name=joint, kind="continuous", parent=BASE_FRAME, child=frame, at=mount, axis="0 1 0")
    for (parent, frame), mount in static_transforms(body).items():
        link = SubElement(robot, "link", name=frame)
        if parent == BASE_FRAME:
            _add_shape(
                link=link,
                kind="visual",
                shape="box",
                at=Pose3(np.eye(3), np.zeros(3)),
                material="sensor",
                size=_numbers([_SENSOR_SIZE] * 3),
            )
        _add_joint(robot=robot, name=f"{frame}_joint", kind="fixed", parent=parent, child=frame, at=mount)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def wheel_transforms(body: ChairBody, ticks: WheelTicks) -> dict[tuple[str, str], Pose3]:
    """Return `base_from_wheel` of both drive wheels, rotated by their encoder counts, by (parent, child)."""
    angle = math.tau / body.ticks_per_turn
    return _wheels(body, (ticks.left * angle, ticks.right * angle))


def _wheels(body: ChairBody, angles: tuple[float, float]) -> dict[tuple[str, str], Pose3]:
    """Return the wheel frames: wheels on the floor at both ends of the axle, rotated about y (left) by `angles` [rad]."""
    found = {}
    for frame, side, angle in zip(WHEEL_FRAMES, (1.0, -1.0), angles, strict=True):
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        found[BASE_FRAME, frame] = Pose3(turn, np.array([0.0, side * body.track / 2, body.wheel_radius]))
    return found


def _add_base(robot: Element, body: ChairBody) -> None:
    """Add the chair's body: `visual` only up to the seat, so that the sensors stay visible; `collision` in full height."""
    base = SubElement(robot, "link", name=BASE_FRAME)
    layers = body.height_layers()
    seat = BodyLayer(*_SEAT, body.front, body.rear, body.width / 2)
    for layer in body.layers or (seat,):
        _add_layer(base, "visual", layer, "body")
    for layer in layers:
        _add_layer(base, "collision", layer)


def _add_layer(base: Element, kind: str, layer: BodyLayer, material: str = "") -> None:
    middle = np.array([(layer.front - layer.rear) / 2, 0.0, (layer.bottom + layer.top) / 2])
    size = (layer.front + layer.rear, 2 * layer.half_width, layer.top - layer.bottom)
    _add_shape(link=base, kind=kind, shape="box", at=Pose3(np.eye(3), middle), material=material, size=_numbers(size))


def _add_wheel(robot: Element, frame: str, radius: float) -> None:
    """Add a wheel: a cylinder (axis z) turned to lie along y."""
    link = SubElement(robot, "link", name=frame)
    across = Pose3(Rotation.from_euler("x", math.pi / 2).as_matrix(), np.zeros(3))
    for kind, material in (("visual", "wheel"), ("collision", "")):
        _add_shape(
            link=link,
            kind=kind,
            shape="cylinder",
            at=across,
            material=material,
            radius=_numbers([radius]),
            length=_numbers([_WHEEL_WIDTH]),
        )


def _add_shape(link: Element, kind: str, shape: str, at: Pose3, material: str, **sizes: str) -> None:
    drawn = SubElement(link, kind)
    _add_origin(drawn, at)
    SubElement(SubElement(drawn, "geometry"), shape, sizes)
    if material:
        SubElement(drawn, "material", name=material)


def _add_joint(robot: Element, name: str, kind: str, parent: str, child: str, at: Pose3, axis: str = "") -> None:
    joint = SubElement(robot, "joint", name=name, type=kind)
    _add_origin(joint, at)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    if axis:
        SubElement(joint, "axis", xyz=axis)


def _add_origin(element: Element, at: Pose3) -> None:
    turns = Rotation.from_matrix(at.rotation).as_euler("xyz")
    SubElement(element, "origin", xyz=_numbers(at.translation), rpy=_numbers(turns))


def _numbers(values: Sequence[float] | Any) -> str:
    return " ".join(f"{float(value) + 0.0:.9g}" for value in np.round(np.asarray(values, np.float64), 12))
