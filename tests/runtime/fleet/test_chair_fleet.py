"""A real chair's fleet file is checked before anything is started."""

from __future__ import annotations

import socket
from contextlib import closing
from pathlib import Path

import pytest

from waychair.errors import FleetError
from waychair.runtime.fleet.chair_fleet import FLEET, LAN, fleet_environment, joined_fleet


def fleet_file(folder: Path, more: str = "", number: int = 1) -> Path:
    """Write a fleet's file."""
    path = folder / "fleet.yaml"
    path.write_text(f"building: T\nnumber: {number}\nchairs: [1, 2]\nvoters: [9]\n{more}")
    return path


@pytest.mark.parametrize(
    ("more", "number", "lan", "said"),
    [
        ("", 9, False, "number 9 is a voter's: give the number of this chair, one of"),
        ("listen: tls/192.0.2.1:7450\n", 1, False, "beyond this computer: give --lan"),
        ("", 1, True, "--lan needs keys"),
        ("keys: nowhere\n", 1, False, "there is no .*authority.pem"),
    ],
)
def test_a_chair_with_a_wrong_file_does_not_start(tmp_path: Path, more: str, number: int, lan: bool, said: str) -> None:
    with pytest.raises(FleetError, match=said):
        fleet_environment(fleet_file(tmp_path, more, number), lan)


def test_the_file_reaches_the_chairs_process_and_a_taken_port_is_named(tmp_path: Path) -> None:
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        path = fleet_file(tmp_path, f"listen: tcp/127.0.0.1:{port}\n")
        found = fleet_environment(path, lan=False)
        assert found == {FLEET: str(path), LAN: ""}
        with pytest.raises(FleetError, match=f"127.0.0.1:{port} is taken by another program"):
            joined_fleet(found)
    joined = joined_fleet(found)
    joined.transport.close()
    assert (joined.number, joined.fleet.chairs, joined.fleet.voters) == (1, {1, 2}, {9})
    with pytest.raises(FleetError, match="no fleet is named"):
        joined_fleet({})
