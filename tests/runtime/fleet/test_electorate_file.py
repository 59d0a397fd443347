"""Who is counted is kept over restarts, and a chair that is switched off in good order is counted no more."""

from __future__ import annotations

from pathlib import Path

from tests.runtime.fleet.test_fleet_member import DESK, ROOMS, STEP_NS, WAYS, Ward
from waychair.planning.fleet.peers.messages import Electorate
from waychair.runtime.fleet.electorate_file import keep_electorate, kept_electorate
from waychair.runtime.fleet.fleet_member import FleetMember
from waychair.trials.fleet.fleet_on_lines import CarriedEnd

NUMBERS = (1, 2, DESK)


def test_what_was_kept_is_read_again_unless_it_is_damaged_or_of_another_site(tmp_path: Path) -> None:
    path = tmp_path / "electorate1.json"
    assert kept_electorate(path, NUMBERS) is None
    assert keep_electorate(path, Electorate(5001, 2, (1, DESK))) == ""
    assert kept_electorate(path, NUMBERS) == Electorate(5001, 2, (1, DESK))
    assert kept_electorate(path, (1, 2)) is None
    path.write_text("[5001, 2")
    assert kept_electorate(path, NUMBERS) is None


def test_where_it_cannot_be_kept_people_are_told(tmp_path: Path) -> None:
    said = keep_electorate(tmp_path, Electorate(5001, 2, (1,)))
    assert said.startswith("Who is counted cannot be kept: ")


def test_a_chair_that_is_parked_is_counted_no_more_and_knows_so_after_its_restart(tmp_path: Path) -> None:
    ward, memory = Ward(), tmp_path / "electorate2.json"
    old = ward.members[2]
    ward.members[2] = FleetMember(
        ward.voter.fleet, 2, 202, old.driver.driver, ward.starts[2], CarriedEnd(ward.air, 2), memory=memory
    )
    ward.run(6)
    ward.members[2].park()
    ward.run(1)
    assert ward.members[1].driver.peer.voter.electorate.members == (1, DESK)
    kept = kept_electorate(memory, NUMBERS)
    assert kept == ward.members[1].driver.peer.voter.electorate
    again = FleetMember(ward.voter.fleet, 2, 302, old.driver.driver, ROOMS[-1], CarriedEnd(ward.air, 2), memory=memory)
    assert again.driver.peer.voter.electorate == kept


def test_a_chair_that_stands_in_a_way_cannot_be_parked() -> None:
    ward = Ward()
    section = next(spot for spot in range(len(WAYS.names)) if WAYS.passing_ms[spot] > 1)
    ward.members[2].driver.stand_in((section,))
    ward.members[2].park()
    ward.run(6)
    assert not ward.voter.known[2].state.parked
    assert ward.now_ns - ward.voter.known[2].heard_ns < 3 * STEP_NS
