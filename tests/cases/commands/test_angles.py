"""Angles as people type them: in radians or with a unit, and refused beyond a full turn with the words to type."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cli.command import refused, waychair
from waychair.cli.options.arguments import BadArgument, place_from_text, pose_from_text
from waychair.cli.options.configuration import load_configuration
from waychair.errors import ConfigError, PlaceError, UnknownPlace, WorldError, ZoneError
from waychair.maps.drawn.places import load_places
from waychair.maps.drawn.zones import load_zones
from waychair.maps.folders.map_files import save_map
from waychair.pose_text import ImpossiblePose, NoPoseText, angle_from_text, is_like_pose
from waychair.recordings.scans import mount_from_text
from waychair.simulation.plan.plan_file import load_building
from waychair.simulation.plant.chair_file import load_chair
from waychair.types import OccupancyGrid, Place, Pose2

SQUARE = "polygon: [[0, 0], [4, 0], [4, 4]]"


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """A room of 8 m by 6 m with walls all round."""
    cells = np.zeros((120, 160), np.int8)
    cells[:2] = cells[-2:] = 100
    cells[:, :2] = cells[:, -2:] = 100
    save_map(tmp_path / "room", OccupancyGrid(cells, 0.05))
    return tmp_path / "room"


@given(st.floats(-360, 360), st.sampled_from(["deg", " deg", "°", "degrees", "DEG"]))
def test_degrees_are_read_with_their_unit(degrees: float, unit: str) -> None:
    assert angle_from_text(f"{degrees!r}{unit}") == pytest.approx(math.radians(degrees))


@given(st.floats(-6.283, 6.283), st.sampled_from(["", "rad", " rad"]))
def test_radians_are_read_with_and_without_their_unit(radians: float, unit: str) -> None:
    assert angle_from_text(f"{radians!r}{unit}") == radians


@given(st.floats(6.2842, 360) | st.floats(-360, -6.2842))
def test_more_than_a_full_turn_is_refused_with_the_words_for_degrees(angle: float) -> None:
    with pytest.raises(ImpossiblePose, match="more than a full turn") as caught:
        angle_from_text(repr(angle))
    words = str(caught.value).split("write ")[1].split(" or ")
    assert [angle_from_text(text) for text in words] == pytest.approx([math.radians(angle)] * 2, rel=1e-3)


@pytest.mark.parametrize("text", ["400deg", "-361°", "5000", "1e300"])
def test_what_is_more_than_a_full_turn_in_degrees_too_gets_the_range(text: str) -> None:
    with pytest.raises(ImpossiblePose, match=r"full turn.*give -"):
        angle_from_text(text)


@pytest.mark.parametrize("text", ["", "deg", "ninety", "nan", "infdeg", "90grad", "1,5", "--1"])
def test_what_is_no_angle_is_told_from_one_that_is_too_large(text: str) -> None:
    with pytest.raises(NoPoseText) as caught:
        angle_from_text(text)
    assert not isinstance(caught.value, ImpossiblePose)


def test_a_full_turn_may_be_rounded() -> None:
    assert angle_from_text("6.2832") == 6.2832
    assert angle_from_text("-360deg") == -math.tau


def test_an_option_takes_degrees_and_says_what_ninety_radians_are() -> None:
    assert pose_from_text("1.5,-2,45deg", "--start") == Pose2(1.5, -2.0, math.radians(45))
    with pytest.raises(BadArgument, match=r"--goal is '3,0,90': 90 rad is 5157 degrees.*write 90deg or 1\.571"):
        pose_from_text("3,0,90", "--goal")
    with pytest.raises(BadArgument, match=r"--goal must be X,Y or X,Y,YAW in metres and radians.*45deg.*not '3'"):
        pose_from_text("3", "--goal")
    with pytest.raises(BadArgument, match="up to 1e\\+06 m"):
        pose_from_text("2e6,0", "--goal")


def test_the_mount_of_a_lidar_takes_degrees_and_is_refused_by_the_name_of_its_option() -> None:
    mount = mount_from_text("0.2, 0, 180deg, upside-down")
    assert mount.upside_down
    assert mount.base_from_laser == Pose2(0.2, 0.0, math.pi)
    assert mount_from_text("0.2,0,270deg").base_from_laser.theta == pytest.approx(-math.pi / 2)
    with pytest.raises(ConfigError, match=r"--base-from-laser.*'0.2,0,180'.*write 180deg or 3\.142"):
        mount_from_text("0.2,0,180")
    with pytest.raises(ConfigError, match=r"--base-from-laser.*such as.*not '0.2,upside-down'"):
        mount_from_text("0.2,upside-down")


def test_places_in_a_file_take_degrees(room: Path) -> None:
    (room / "places.yaml").write_text("bed: [6, 4, 90deg]\ndesk: [2, 2, -45°, 0.05, 5deg]\nlift: [1, 1, 3.5]\n")
    places = load_places(room)
    assert places["bed"].pose.theta == pytest.approx(math.pi / 2)
    assert (places["desk"].pose.theta, places["desk"].tolerance_rad) == pytest.approx((-math.pi / 4, math.radians(5)))
    assert places["lift"].pose.theta == pytest.approx(3.5 - math.tau)


def test_a_place_in_a_file_that_faces_ninety_radians_is_refused_with_its_line(room: Path) -> None:
    (room / "places.yaml").write_text("lift: [1, 1, 0]\nbed: [6, 4, 90]\n")
    with pytest.raises(PlaceError, match=r"line 2: the place 'bed'.*5157 degrees.*write 90deg or 1\.571"):
        load_places(room)


def test_a_one_way_zone_takes_degrees_and_refuses_more_than_a_turn(room: Path) -> None:
    zones = room / "zones.yaml"
    zones.write_text(f"ramp: {{one_way: 180deg, {SQUARE}}}\n")
    assert load_zones(room)[0].value == pytest.approx(math.pi)
    zones.write_text(f"ramp: {{one_way: 180, {SQUARE}}}\n")
    with pytest.raises(ZoneError, match=r"line 1: 'ramp': one_way is 180: 180 rad.*write 180deg or 3\.142"):
        load_zones(room)
    zones.write_text(f"ramp: {{one_way: east, {SQUARE}}}\n")
    with pytest.raises(ZoneError, match="must be a heading in radians, or in degrees such as 90deg"):
        load_zones(room)


def test_a_place_is_added_in_degrees_and_stored_in_radians(room: Path) -> None:
    assert waychair("places", "--map", room, "--add", "bed", "6,4,90deg").stdout == "bed: 6.00, 4.00, 1.57\n"
    said = refused(waychair("places", "--map", room, "--add", "sofa", "6,4,90"))
    assert "90 rad is 5157 degrees" in said
    assert list(load_places(room)) == ["bed"]


PLACES = {
    name: Place(name, Pose2(1.0, 2.0, 0.0)) for name in ("2nd toilet", "101", "3b", "Lift, 2nd floor", "-1 store")
}


@pytest.mark.parametrize(
    ("typed", "meant"),
    [("2nd toile", "2nd toilet"), ("102", "101"), ("3c", "3b"), ("2, lift floor", "Lift, 2nd floor")],
)
def test_a_mistyped_name_that_begins_with_a_digit_is_answered_with_the_name_that_was_meant(
    typed: str, meant: str
) -> None:
    with pytest.raises(UnknownPlace, match=f"no place '{typed}'; did you mean [^?]*{meant}"):
        place_from_text(PLACES, typed, "--goal")


@pytest.mark.parametrize("name", list(PLACES))
def test_names_with_digits_and_commas_are_places(name: str) -> None:
    assert place_from_text(PLACES, name, "--goal") is PLACES[name]


def test_two_numbers_are_a_pose_and_one_number_is_answered_with_both_forms() -> None:
    assert place_from_text(PLACES, "1,2,90deg", "--goal").pose == Pose2(1.0, 2.0, math.pi / 2)
    with pytest.raises(BadArgument, match="--goal must be X,Y"):
        place_from_text(PLACES, "1,2,3,4", "--goal")
    with pytest.raises(UnknownPlace, match=r"did you mean.* A pose is X,Y or X,Y,YAW"):
        place_from_text(PLACES, "1.5", "--goal")


@pytest.mark.parametrize("name", ["1,2", "1.5,-2,0.78", "3, 4, 90deg", "-1,2,north"])
def test_a_name_that_reads_as_coordinates_is_refused(room: Path, name: str) -> None:
    assert is_like_pose(name)
    said = refused(waychair("places", "--map", room, "--add", name, "6,4"))
    assert f"'{name}' cannot be the name of a place, as it reads as coordinates" in said
    assert not (room / "places.yaml").exists()


def test_a_setting_and_a_chair_file_take_degrees(tmp_path: Path) -> None:
    file = tmp_path / "chair.yaml"
    file.write_text("body: {chair_id: ward, laser_theta: 90deg, camera_pitch: 10 deg}\n")
    body = load_chair(file).body
    assert (body.laser_theta, body.camera_pitch) == pytest.approx((math.pi / 2, math.radians(10)))
    settings_file = tmp_path / "c.yaml"
    settings_file.write_text("map: {mapper: {key_angle: 20deg}}\n")
    assert load_configuration(settings_file).map.mapper.key_angle == pytest.approx(math.radians(20))


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("90", r"must lie in .* rad; for 90 degrees write 90deg or 1\.571"),
        ("9000deg", "9000deg is more than a full turn"),
        ("left", "laser_theta is 'left'; it must be radians, or degrees such as 90deg"),
    ],
)
def test_an_impossible_angle_of_a_chair_file_is_refused_with_the_words_to_write(
    tmp_path: Path, value: str, said: str
) -> None:
    file = tmp_path / "chair.yaml"
    file.write_text(f"body: {{chair_id: ward, laser_theta: {value}}}\n")
    with pytest.raises(ConfigError, match=said):
        load_chair(file)


def test_the_plan_of_a_world_takes_degrees_and_refuses_ninety_radians_with_their_line(tmp_path: Path) -> None:
    plan = (
        "name: ward\nsize: [8, 6]\nstart: [2, 2, {start}]\nwalls: []\nresolution: 0.05\n"
        "boxes:\n  - {{centre: [6, 5], size: [0.5, 0.5], yaw: 30deg, high: 1.0}}\nplaces:\n  bed: [4, 4, {bed}]\n"
    )
    file = tmp_path / "ward.yaml"
    file.write_text(plan.format(start="90deg", bed="-1.5"))
    level = load_building(file).levels[0].plan
    assert (level.start[2], level.boxes[0].yaw) == pytest.approx((math.pi / 2, math.pi / 6))
    file.write_text(plan.format(start="90", bed="0"))
    with pytest.raises(WorldError, match=r"line 3: start\[2\]: 90 rad is 5157 degrees.*write 90deg"):
        load_building(file)
    file.write_text(plan.format(start="0", bed="180"))
    with pytest.raises(WorldError, match=r"line 9: places\.bed\[2\]: 180 rad"):
        load_building(file)
