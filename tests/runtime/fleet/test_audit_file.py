"""The audit's log: whole lines, and a full disk that costs lines only."""

from __future__ import annotations

import json
import resource
from pathlib import Path

import pytest

from tests.full_disk import files_up_to
from tests.planning.fleet.peers.buildings import Desk
from waychair.errors import FleetError
from waychair.planning.fleet.audit import audited
from waychair.planning.fleet.peers.peer import Own
from waychair.runtime.fleet.audit_file import AGAIN_AFTER_NS, AuditFile
from waychair.types import Json


def _lines(path: Path) -> list[Json]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_a_warden_tells_each_wait_with_its_reason_once_it_has_ended(tmp_path: Path) -> None:
    desk = Desk(2, voters=1)
    desk.run(6)
    log = AuditFile(tmp_path / "audit.jsonl")
    desk.wish(1, "Q")  # where chair 2 stands

    def keep() -> bool:
        for step in desk.steps.values():
            assert log.add(step.records, desk.now_ns) == ""
        return False

    desk.run(5, keep)
    desk.own[1] = Own(desk.own[1].entered)
    desk.wish(2, "R")
    desk.run(4, keep)
    desk.own[2] = Own((desk.fleet.ways.slots["R"][0],), 9)
    desk.run(4, keep)
    log.close()
    records = _lines(tmp_path / "audit.jsonl")
    assert (records[0]["waits"], records[0]["first"], records[0]["place"]) == (1, 2, "Q")
    assert records[0]["real_s"] >= 4.0
    assert audited(records).waits == records


def test_a_full_disk_is_named_once_and_half_a_line_is_never_left(tmp_path: Path) -> None:
    path = tmp_path / "audit.jsonl"
    log = AuditFile(path)
    log.add([{"n": 1}], 0)
    with files_up_to(path.stat().st_size + 4):
        said = log.add([{"n": 2}, {"n": 3}], 1)
        assert "cannot be written" in said
        assert "orders go on" in said
        assert log.add([{"n": 4}], 2) == ""
        assert log.add([{"n": 5}], 1 + AGAIN_AFTER_NS) == ""
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] != path.stat().st_size + 4
    assert log.add([{"n": 6}], 2 + 2 * AGAIN_AFTER_NS).endswith("4 lines are missing.")
    log.close()
    assert _lines(path) == [{"n": 1}, {"n": 6}]


def test_a_log_that_cannot_be_opened_is_named(tmp_path: Path) -> None:
    with pytest.raises(FleetError, match="give another path"):
        AuditFile(tmp_path / "nowhere" / "audit.jsonl")
