"""The process of a peer without a chair in a simulated fleet, a voter or the router: `python -m ... FOLDER NUMBER`."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

from waychair.errors import WaychairError
from waychair.runtime.fleet.network.peer_process import serve
from waychair.runtime.processes import CANNOT_START, beats, signalled
from waychair.trials.fleet.live.live_plan import ROUTER, fleet_file, read_plan


def main() -> None:
    """Run the process."""
    folder, number = Path(sys.argv[1]), int(sys.argv[2])
    stopped, beat = signalled(signal.SIGINT, signal.SIGTERM), beats()
    try:
        mode = "router" if number == ROUTER else read_plan(folder).mode
        file = fleet_file(folder, number)
        serve(file, False, stopped, told=lambda step: None if beat is None else beat(), mode=mode)
    except WaychairError as error:
        print(f"waychair: peer {number}: {error}", file=sys.stderr)
        sys.exit(CANNOT_START)


if __name__ == "__main__":
    main()
