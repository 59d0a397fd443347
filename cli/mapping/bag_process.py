"""One recording of `waychair map-all` in a process of its own: `waychair map` with a limit of memory.

It ends at once when the process that started it is gone, by the other end of its standard input.
"""

from __future__ import annotations

import os
import resource
import select
import signal
import sys
import threading
from pathlib import Path

from waychair.errors import RecordingError

_LOOK_S = 0.1
_INPUT = 0  # file descriptor of the standard input
_STATM = Path("/proc/self/statm")


def bag_process() -> None:
    """Run `waychair map` with the arguments after the first one, which is the limit of memory [bytes].

    Exits with `OF_RECORDING` if the recording is the cause of a failure, with `OUT_OF_MEMORY` above the limit.
    """
    limit = int(sys.argv[1])
    threading.Thread(target=_watch, args=(limit,), name="lifeline", daemon=True).start()
    from waychair.cli.main import main
    from waychair.offline.many.bag_runs import OF_RECORDING, OUT_OF_MEMORY

    sys.argv = ["waychair", "map", *sys.argv[2:]]
    try:
        main()
    except SystemExit as end:
        cause = end.__context__  # the error of which `main` printed the sentence
        if end.code == 1 and isinstance(cause, RecordingError):
            sys.exit(OF_RECORDING)
        if end.code == 1 and isinstance(cause, MemoryError):
            sys.exit(OUT_OF_MEMORY)
        raise


def _watch(limit: int) -> None:
    """End this process when its starter is gone or it uses more memory than allowed; never returns."""
    from waychair.offline.many.bag_runs import OUT_OF_MEMORY

    while True:
        readable, _, _ = select.select([_INPUT], [], [], _LOOK_S)
        if readable and not os.read(_INPUT, 1):
            os.kill(os.getpid(), signal.SIGKILL)
        if _memory() > limit:
            told = f"waychair: it needs more memory than {limit / 1e9:.1f} GB: give more with --per-bag-memory\n"
            os.write(2, told.encode())
            os._exit(OUT_OF_MEMORY)


def _memory() -> int:
    """Return the resident memory of this process [bytes]; its peak where the system does not tell more."""
    try:
        with _STATM.open("rb") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


if __name__ == "__main__":
    bag_process()
