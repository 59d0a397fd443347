"""Tags before the camera of a chair that travels: the storey in a lift and at rest, a drive on the wrong map, the place."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.runtime.test_tag_watch import HERE, ODOM, located, tagged
from waychair.maps.building.april_tags import tag_picture
from waychair.planning.building.beacon_places import pose_of_beacon
from waychair.simulation.plan.world import World
from waychair.simulation.scene.scene import WallTag
from waychair.slam.localising.localisation import LocalisationState
from waychair.trials.live.live_tags import LiveTags
from waychair.trials.travel.world_building import _with_tags
from waychair.types import OccupancyGrid, Pose2, RgbdFrame

S = 1_000_000_000
CAMERA = np.array([[400.0, 0.0, 320.0], [0.0, 400.0, 240.0], [0.0, 0.0, 1.0]])


class AtOnce(Executor):
    """Does all work in the caller's thread."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


class Chair:
    """A chair and its traveller, of which the test reads what they were told."""

    def __init__(self) -> None:
        self.told: list[Any] = []
        self.odom_from_base = ODOM
        self.aboard, self.storey, self.journey = False, "g", None

    def met_beacon(self, storey: str) -> None:
        self.told.append(("met", storey))

    def take_storey(self, storey: str, pose: Pose2 | None) -> None:
        self.told.append(("storey", storey))

    def cancel(self, *_: int) -> None:
        self.told.append(("cancel",))

    def relocalise(self, pose: Pose2) -> None:
        self.told.append(("place", round(pose.x, 1), round(pose.y, 1)))


@pytest.fixture
def chair() -> Chair:
    return Chair()


def frame(number: int, stamp_ns: int) -> RgbdFrame:
    """A tag of 0.3 m straight ahead at 2 m."""
    image = np.full((480, 640), 255, np.uint8)
    image[210:270, 290:350] = tag_picture(number)[5::10, 5::10]
    return RgbdFrame(stamp_ns, image, np.full(image.shape, 2.0, np.float32), CAMERA)


def run(chair: Chair, number: int, looks: int = 2, drives: bool = False, state: Any = LocalisationState.LOST) -> None:
    tags: Any = LiveTags(tagged(), chair, chair, AtOnce())  # type: ignore[arg-type]
    for k in range(looks):
        tags.look([frame(number, k * S), frame(number, k * S + S // 10)])  # the second comes too soon
        tags.step(
            SimpleNamespace(
                stamp_ns=k * S,
                localisation=located(HERE, state),
                verdict=SimpleNamespace(computer_drives=drives),
            )
        )


def test_a_tag_sets_the_place_of_a_lost_chair_and_leaves_a_certain_one_alone(chair: Chair) -> None:
    run(chair, 7)  # it hangs at 6, 1 and faces west; the camera is 0.3 m before the axle
    ((kind, x, y),) = chair.told
    assert kind == "place"
    assert x == pytest.approx(6.0 - 2.0, abs=0.6)
    assert y == pytest.approx(1.0, abs=0.2)
    chair.told.clear()
    run(chair, 400)
    assert chair.told == []


def test_a_tag_of_another_storey_sets_it_at_rest_and_ends_a_drive_on_the_wrong_map(chair: Chair) -> None:
    run(chair, 8, looks=1)
    assert chair.told == [("storey", "1")]
    chair.told.clear()
    run(chair, 8, looks=1, drives=True)
    assert chair.told == [("cancel",), ("cancel",)]


def test_in_a_lift_a_tag_is_evidence_for_the_storey_only(chair: Chair) -> None:
    chair.aboard = True
    run(chair, 8)
    run(chair, 7)
    assert chair.told == [("met", "1")] * 2 + [("met", "g")] * 2


def test_the_tags_of_a_world_are_beacons_of_its_building() -> None:
    world = World("clinic", OccupancyGrid(np.zeros((4, 4), np.int8), 0.1), Pose2(), level="1")
    assert _with_tags(tagged(), world) == tagged()
    hung = WallTag(31, Pose2(2.0, 1.0, 0.5), 1.2, 0.25)
    assert pose_of_beacon(_with_tags(tagged(), replace(world, tags=(hung,))), "31") == hung.middle
