"""Places and zones move with the rooms when a drive of another day corrects the map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.offline.test_sessions import Drive, joined, mapped, part
from waychair.maps.drawn.anchors import load_nodes
from waychair.maps.drawn.places import load_places, save_places
from waychair.maps.drawn.zones import Rule, Zone, load_zones
from waychair.maps.folders.map_drawing import DrawingEditor
from waychair.types import Place, Pose2


@pytest.mark.nightly
def test_places_and_zones_follow_the_nodes_when_a_drive_of_another_day_is_joined(drive: Drive, tmp_path: Path) -> None:
    folder, lap = tmp_path / "map", len(drive[0]) // 2
    mapped(part(drive, 0, lap * 3 // 4, 0)[0], folder)
    before = load_nodes(folder)
    far = Pose2(*before[-1].tolist()) @ Pose2(0.4, 0.2, 1.0)
    corners = np.array([[far.x, far.y], [far.x + 1.0, far.y], [far.x, far.y + 1.0]])
    save_places(folder, {"far": Place("far", far)})
    DrawingEditor(folder).set_zone(Zone("wet", Rule.KEEP_OUT, corners))
    joined(part(drive, lap // 2, 2 * lap, 1)[0], folder)
    after = load_nodes(folder)[: len(before)]
    assert not np.allclose(after, before, atol=1e-4)  # the loop closed on the second day corrects the first day's map
    anchored = Pose2(*after[-1].tolist()) @ Pose2(0.4, 0.2, 1.0)
    assert load_places(folder)["far"].pose.array() == pytest.approx(anchored.array(), abs=1e-6)
    assert load_zones(folder)[0].polygon[0] == pytest.approx([anchored.x, anchored.y], abs=1e-6)
