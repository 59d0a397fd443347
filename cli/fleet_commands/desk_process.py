"""The process of the staff's desk of a fleet: `python -m ... FLEET PORT`, a voter with the staff's page."""

from __future__ import annotations

import signal
import sys
from pathlib import Path


def main() -> None:
    """Run the process."""
    from waychair.cli.fleet_commands.staff_options import desk_beside
    from waychair.errors import WaychairError
    from waychair.runtime.fleet.fleet_file import load_fleet
    from waychair.runtime.fleet.network.peer_process import serve
    from waychair.runtime.processes import CANNOT_START, beats, signalled

    path, port = Path(sys.argv[1]), int(sys.argv[2])
    stopped, beat = signalled(signal.SIGINT, signal.SIGTERM), beats()
    try:
        file = load_fleet(path)
        with desk_beside(file, port, path.parent / "desk.jsonl") as beside:
            serve(file, False, stopped, told=lambda step: None if beat is None else beat(), beside=beside)
    except WaychairError as error:
        print(f"waychair: the staff's desk: {error}", file=sys.stderr)
        sys.exit(CANNOT_START)


if __name__ == "__main__":
    main()
