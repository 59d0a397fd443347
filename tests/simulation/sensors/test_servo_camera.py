"""The laser's line in rendered pictures: where it lies, what hides it, where it is lost, and the same bytes by seed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.servo_camera_mount import SERVO_CAMERA
from waychair.errors import ConfigError
from waychair.geometry import in_space
from waychair.planning.seen.laser_picture import line_in_picture, rows_of_ranges
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.scene.scene import Block, Lamp, PersonBehaviour, PersonState
from waychair.simulation.sensors.pan_tilt import ServoCameraFaults
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.simulation.sensors.servo_camera import ServoCamera, ServoCameraSettings
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.types import Float32Array, PanTiltCommand, Picture, Pose2, ServoMessage, Twist

if renderer_problem():
    pytest.skip(str(renderer_problem()), allow_module_level=True)

HERE = in_space(Pose2(7.0, 4.0, math.pi / 2))
"""In the corridor of `corridor_t`, 1.8 m wide, with its far wall 5 m ahead."""

PERIOD_NS = 100_000_000


@pytest.fixture(scope="module")
def corridor() -> World:
    return load_world("corridor_t")


def _pictures(camera: ServoCamera, people: tuple[PersonState, ...] = (), count: int = 4) -> list[Picture]:
    """The last two pictures, that with the laser first."""
    camera.order(PanTiltCommand(0, 0.0, 0.0, laser=True))
    seen = [list(camera.sense(k * PERIOD_NS, HERE, Twist(), people))[1] for k in range(count)]
    pictures = [each for each in seen[-2:] if isinstance(each, Picture)]
    return sorted(pictures, key=lambda each: not each.laser)


def _red(world: World, people: tuple[PersonState, ...] = (), faults: ServoCameraFaults | None = None) -> Float32Array:
    """Light (H, W) that the laser adds in red."""
    camera = ServoCamera(np.random.default_rng(3), world)
    camera.faults = faults or ServoCameraFaults()
    lit, dark = (np.square(each.image.astype(np.float32) / 255.0) for each in _pictures(camera, people))
    return np.asarray(lit[..., 0] - dark[..., 0], np.float32)


def _row(away: float) -> float:
    """The row of the line on something this far ahead."""
    return 239.5 + SERVO_CAMERA.focal * SERVO_CAMERA.baseline / away


def _wall(at: float, material: str = "plaster", low: float = 0.0) -> Block:
    """A wall right across the corridor, its face `at` metres before the camera."""
    y = 4.0 + SERVO_CAMERA.forward + at + 0.05
    return Block(Pose2(7.0, y, 0.0), 1.8, 0.1, low, 2.0, material)


def _with(world: World, *blocks: Block) -> World:
    return replace(world, blocks=(*world.blocks, *blocks))


def _is_line(red: Float32Array, away: float, columns: slice = slice(300, 340)) -> bool:
    """Whether there is a line at this distance, and nowhere else in these columns."""
    rows = red[245:, columns].mean(axis=1)
    return bool(abs(rows.argmax() + 245 - _row(away)) <= 1.0 and rows.max() > 6 * np.std(rows[rows < 0.5 * rows.max()]))


def _seen(world: World, away: float) -> float:
    """The share of the middle columns in which the line is found at a distance."""
    lit, dark = _pictures(ServoCamera(np.random.default_rng(3), world))
    found = line_in_picture(lit.image, dark.image, rows_of_ranges(0.3, 8.0, SERVO_CAMERA.focal, 239.5, 0.10))
    return float(np.mean(np.abs(found.rows[220:420] - _row(away)) < 1.5))


def test_the_line_lies_where_triangulation_has_it(corridor: World) -> None:
    world = _with(corridor, _wall(2.0))
    red = _red(world)
    assert _is_line(red, 2.0)
    assert _is_line(red, 2.0, slice(200, 240))
    assert _seen(world, 2.0) > 0.97


def test_a_board_hides_the_line_behind_it_and_shows_it_itself(corridor: World) -> None:
    board = Block(Pose2(7.0, 4.0 + SERVO_CAMERA.forward + 1.0, 0.0), 0.2, 0.02, 0.0, 0.7, "wood")
    red = _red(_with(corridor, _wall(2.0), board))
    assert _is_line(red, 0.99)  # its front; the camera sees the wall above it, where no line is
    assert _is_line(red, 2.0, slice(200, 230))


def test_the_line_crosses_a_person_who_stands_before_the_wall(corridor: World) -> None:
    person = PersonState(
        Pose2(7.0, 4.0 + SERVO_CAMERA.forward + 1.2, -math.pi / 2), 0.0, 0.0, 0.25, PersonBehaviour.SEATED
    )
    red = _red(_with(corridor, _wall(2.0)), (person,))
    rows = red[245:, 300:340].mean(axis=1).argmax() + 245
    assert _row(1.5) < rows < _row(0.8)


def test_the_line_is_lost_on_black_and_mirrors_and_goes_through_glass(corridor: World) -> None:
    behind = _wall(3.0)
    for material in ("black_leather", "mirror"):
        world = _with(corridor, _wall(1.5, material), behind)
        assert _seen(world, 1.5) < 0.05
        assert _seen(world, 3.0) == 0.0
    glazed = _with(corridor, _wall(1.5, "glass"), behind)
    assert _seen(glazed, 1.5) == 0.0
    assert _seen(glazed, 3.0) > 0.8


def test_the_line_is_lost_in_bright_light(corridor: World) -> None:
    lit = replace(corridor, lamps=tuple(Lamp(7.0, 3.0 + k, 2.6, 90.0) for k in range(4)))
    assert _seen(_with(lit, _wall(2.0)), 2.0) < 0.05


def test_a_covered_lens_and_a_dead_laser_show_no_line(corridor: World) -> None:
    world = _with(corridor, _wall(2.0))
    assert not _is_line(_red(world, faults=ServoCameraFaults(laser_off=True)), 2.0)
    camera = ServoCamera(np.random.default_rng(3), world)
    camera.faults = ServoCameraFaults(dark=True)
    lit, dark = _pictures(camera)
    assert lit.laser
    assert not dark.laser
    assert np.ptp(lit.image[200:300, 200:300].astype(float).mean(axis=(1, 2))) < 12.0


def test_a_simulated_chair_sends_angles_and_pictures_and_its_other_bytes_stay(corridor: World) -> None:
    def run(rate_hz: float) -> tuple[list[str], list[ServoMessage]]:
        settings = SimulatorSettings(servo_camera=ServoCameraSettings(rate_hz))
        simulator = Simulator(corridor, CHAIR_A, settings, seed=4)
        if rate_hz:
            simulator.aim(PanTiltCommand(0, 1.0, 0.2, laser=True))
        messages = [repr(each) for each in simulator.advance(400_000_000)]
        if rate_hz:
            assert simulator.servo_angles()[0] == pytest.approx(1.0, abs=0.01)
        return messages, list(simulator.look())

    plain, eyed, again = run(0.0), run(5.0), run(5.0)
    assert plain[0] == eyed[0]
    assert plain[1] == []
    assert [type(each).__name__ for each in eyed[1]] == ["PanTiltAngles", "Picture"] * 2
    pictures = [[each.image.tobytes() for each in run[1] if isinstance(each, Picture)] for run in (eyed, again)]
    assert pictures[0] == pictures[1]
    with pytest.raises(ConfigError, match=r"set servo_camera\.rate_hz above 0"):
        Simulator(corridor, CHAIR_A).aim(PanTiltCommand(0, 0.0, 0.0))
