"""Whole guided drives with both boards' C in the loop."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from evaluation.scenes.tight_places import door_scene, map_of

from waychair.calibration.chair_body import CHAIR_A
from waychair.trials.guiding.guided import GuidedSetup, guided_drive
from waychair.trials.guiding.guided_report import report, save_report
from waychair.types import HelpLevel


@pytest.mark.nightly
def test_a_driver_who_feels_the_glove_alone_gets_through_a_door_untouched(tmp_path: Path) -> None:
    scene = door_scene(0.9, 0.0, CHAIR_A, 107)
    setup = GuidedSetup(scene.world, map_of(scene.world), CHAIR_A, level=HelpLevel.GUIDE, seed=107)
    record = guided_drive(setup, scene.goal, 180.0)
    assert record.reached, record.reason
    assert record.contact_speeds == ()
    assert len(record.felt) >= 0.9 * len(record.told)
    save_report(record, setup, tmp_path)
    kept = json.loads((tmp_path / "guided.json").read_text())
    assert kept == json.loads(json.dumps(report(record, setup)))
    assert (tmp_path / "symbols.csv").read_text().count("said") == len(record.told)
