"""Names of places and zones from pages: nothing is replaced without a request, and long names work."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.ui.driving import pose_of
from tests.ui.noted import Noted
from waychair.maps.drawn.places import load_places, save_places
from waychair.maps.drawn.zones import Rule
from waychair.runtime.pages.chair_port import PortAnswer
from waychair.trials.live.live_chair import LiveChair
from waychair.types import Place, Pose2
from waychair.ui.commands import obey

FAR_OFF = [[3.0, 3.0], [4.0, 3.0], [4.0, 4.0]]
LONG = "the window at the end of the long corridor, from which one sees the sea"


@pytest.fixture
def drawn(port: Noted) -> Iterator[Noted]:
    """The port; changes of places and zones are undone after the test."""
    before = port.layout()
    yield port
    for _ in range(20):
        now = port.layout()
        if (dict(now.places), now.zones) == (dict(before.places), before.zones):
            break
        port.undo()


def put(port: Noted, name: str, x: float, replaces: bool = False) -> PortAnswer:
    asked = {"name": name, "tolerance_m": 0.1, "tolerance_rad": 0.1, "pose": [x, 2.0, 0.0], "replaces": replaces}
    return obey(port, "set_place", asked)


def test_the_second_of_two_pages_with_the_same_proposed_name_replaces_nothing(drawn: Noted) -> None:
    keep_out = {"name": "zone 1", "rule": "keep_out", "polygon": FAR_OFF}
    slow = {"name": "zone 1", "rule": "slow", "polygon": [[x + 2.0, y] for x, y in FAR_OFF]}
    assert obey(drawn, "set_zone", keep_out).done
    answer = obey(drawn, "set_zone", slow)
    assert not answer.done
    assert "there is a zone 'zone 1' already" in answer.sentence
    assert [zone.rule for zone in drawn.layout().zones] == [Rule.KEEP_OUT]
    assert obey(drawn, "set_zone", {**slow, "replaces": True}).done
    assert [zone.rule for zone in drawn.layout().zones] == [Rule.SLOW]


def test_a_place_is_replaced_only_on_request(drawn: Noted) -> None:
    assert put(drawn, "desk", 1.0).done
    pose_of(drawn)
    here = {"name": "desk", "tolerance_m": 0.1, "tolerance_rad": 0.1}
    for answer in (put(drawn, "desk", 1.5), obey(drawn, "place_here", here)):
        assert not answer.done
        assert "there is a place 'desk' already" in answer.sentence
    assert drawn.layout().places["desk"].pose.x == 1.0
    assert put(drawn, "desk", 1.5, replaces=True).done
    assert drawn.layout().places["desk"].pose.x == 1.5


def test_a_new_name_is_one_change_and_is_undone_by_one(drawn: Noted) -> None:
    assert put(drawn, "desk", 1.0).done
    assert put(drawn, "bed", 1.5).done
    before = dict(drawn.layout().places)
    taken = obey(drawn, "rename_place", {"name": "desk", "new_name": "bed"})
    assert not taken.done
    assert "there is a place 'bed' already" in taken.sentence
    assert dict(drawn.layout().places) == before
    assert obey(drawn, "rename_place", {"name": "desk", "new_name": "table"}).done
    now = drawn.layout().places
    assert list(now) == [{"desk": "table"}.get(name, name) for name in before]
    assert now["table"].pose == before["desk"].pose
    assert drawn.undo().done
    assert dict(drawn.layout().places) == before


def test_a_place_with_a_very_long_name_is_driven_to_renamed_and_removed(drawn: Noted, chair: LiveChair) -> None:
    folder = chair._map.folder
    save_places(folder, {**load_places(folder), LONG: Place(LONG, Pose2(1.0, 2.0))})
    assert put(drawn, "desk", 1.5).done  # then the file is read again
    assert LONG in drawn.layout().places
    assert not put(drawn, LONG, 1.0).done
    assert obey(drawn, "go", {"place": LONG}).done
    answer = obey(drawn, "confirm", {"goal": LONG})
    assert "is invalid" not in answer.sentence
    assert drawn.named("confirm")[0].asked == (LONG,)
    drawn.stop()
    assert obey(drawn, "rename_place", {"name": LONG, "new_name": "window"}).done
    assert drawn.undo().done
    assert obey(drawn, "remove_place", {"name": LONG}).done
    assert LONG not in drawn.layout().places
