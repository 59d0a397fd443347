"""The words of AprilTags: whose they are, and what they do to a chair's place."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tests.maps.building.buildings import two_storeys
from waychair.maps.building.hgraph import Beacon, HGraph, SubmapFrame
from waychair.maps.building.hgraph_edits import with_submap
from waychair.planning.building.beacon_places import pose_of_beacon
from waychair.runtime.tag_watch import TagWatch, TagWord, words_of_tags
from waychair.slam.camera.seen_tags import SeenTag
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.types import Pose2

HERE = Pose2(4.0, 1.0, 0.5)
ODOM = Pose2(9.0, -3.0, 1.0)
S = 1_000_000_000


def tagged() -> HGraph:
    """Tag 7 on the ground floor, 8 on the first in a sub-map with a frame of its own, 9 on both."""
    hgraph = two_storeys()
    ward = next(path for path in hgraph.submaps if path.startswith("1/"))
    hgraph = with_submap(hgraph, replace(hgraph.submaps[ward], frame=SubmapFrame(2.0, 1.0, math.pi / 2)))
    for path, beacons in (
        ("g", (Beacon("7", Pose2(6.0, 1.0, math.pi)), Beacon("9", Pose2()))),
        (ward, (Beacon("8", Pose2(1.0, 0.0, 0.0)),)),
        ("1", (Beacon("9", Pose2()),)),
    ):
        hgraph = with_submap(hgraph, replace(hgraph.submaps[path], beacons=beacons))
    return hgraph


def located(pose: Pose2, state: LocalisationState = LocalisationState.OK) -> Localisation:
    return Localisation(pose, pose @ ODOM.inverse(), 0.9, state, 0.9)


def test_a_tags_place_is_that_of_its_sub_maps_frame_and_tags_of_others_tell_nothing() -> None:
    hgraph = tagged()
    found = pose_of_beacon(hgraph, "8")
    assert found is not None
    assert (found.x, found.y, found.theta) == pytest.approx((2.0, 2.0, math.pi / 2))
    seen = [SeenTag(number, Pose2(2.0, 0.0, math.pi)) for number in (7, 9, 400)]
    (word,) = words_of_tags(hgraph, seen)
    assert (word.beacon, word.storey) == ("7", "g")
    assert word.map_from_base is not None
    assert (word.map_from_base.x, word.map_from_base.y) == pytest.approx((4.0, 1.0))
    assert words_of_tags(hgraph, [SeenTag(8)]) == (TagWord("8", "1"),)


def test_a_lost_chair_takes_the_place_of_two_agreeing_looks_and_then_has_time_to_check_it() -> None:
    for before in (None, located(HERE @ Pose2(5.0, 0.0), LocalisationState.LOST)):
        watch, words = TagWatch(), (TagWord("7", "g", HERE),)
        assert watch.place(words, ODOM, before, 0) is None
        taken = watch.place(words, ODOM, before, S)
        assert taken is not None
        assert (taken.x, taken.y, taken.theta) == pytest.approx((HERE.x, HERE.y, HERE.theta))
        assert watch.place(words, ODOM, before, 2 * S) is None
        assert watch.place(words, ODOM, before, 5 * S) is not None  # the localiser has not got there


@pytest.mark.parametrize("state", [LocalisationState.OK, LocalisationState.DEGRADED])
def test_a_place_is_confirmed_within_the_accuracy_of_hung_tags_and_doubted_beyond(state: LocalisationState) -> None:
    words = (TagWord("7", "g", HERE),)
    for offset, doubted in ((Pose2(0.5, 0.0), False), (Pose2(1.2, 0.0), True), (Pose2(0.0, 0.0, 0.6), True)):
        watch, known = TagWatch(), located(HERE @ offset, state)
        watch.place(words, ODOM, known, 0)
        assert (watch.place(words, ODOM, known, S) is not None) is doubted


def test_looks_that_disagree_by_odometry_and_tags_without_depth_do_nothing() -> None:
    watch = TagWatch()
    for pose in (HERE, HERE @ Pose2(1.0, 0.0), HERE, None, HERE):
        assert watch.place((TagWord("7", "g", pose),), ODOM, None, 0) is None
    moved = Pose2(1.0, 0.0)  # a chair that drives on sees the same place of odom in map
    assert watch.place((TagWord("7", "g", HERE @ moved),), ODOM @ moved, None, 0) is not None
