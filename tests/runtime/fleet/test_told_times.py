"""The times that a chair tells of its chain come true where nobody holds it up."""

from __future__ import annotations

import pytest

from tests.runtime.fleet.test_fleet_member import PLAN
from waychair.trials.fleet.fleet_on_lines import ChairsOnLines


@pytest.mark.parametrize("chairs", [1, 2])
def test_a_chair_says_when_its_rear_will_have_left_each_spot_and_when_it_arrives(chairs: int) -> None:
    world, now_ns = ChairsOnLines(PLAN, chairs, 0), 10**12
    told: dict[tuple[int, int], list[float]] = {}
    off: list[float] = []
    ready: list[float] = []
    for _ in range(1500):
        now_ns += 100_000_000
        for number, step in world.step(now_ns).items():
            report, now_s = step.driven.report, now_ns * 1e-9
            rear = report.visits - report.behind
            for each in [key for key in told if key[0] == number and key[1] < rear]:
                off += [when - now_s for when in told.pop(each)]
            for k, left_ms in enumerate(report.leaves_in_ms):
                told.setdefault((number, rear + k), []).append(now_s + left_ms / 1e3)
            if world.chairs[number].driver.wanted == 0:
                ready.append(report.ready_in_ms / 1e3)
    assert len(off) > 2000
    assert max(map(abs, off)) < 1.5
    assert max(ready) > 5.0
    assert min(ready) == 0.0
