from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from waychair.errors import WorkerLost
from waychair.trials.worker_pool import worker_pool

_PARENT = """
import os, time
from waychair.trials.worker_pool import worker_pool

if __name__ == "__main__":
    with worker_pool(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        pool.submit(time.sleep, 120)
        pool.submit(time.sleep, 120).result()
"""


def test_a_killed_process_is_named_with_advice() -> None:
    with pytest.raises(WorkerLost, match="reduce --jobs"), worker_pool(2) as pool:
        list(pool.map(os._exit, [1, 1]))


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_the_process_that_began_them(how: signal.Signals) -> None:
    parent = subprocess.Popen([sys.executable, "-c", _PARENT], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    worker = int(parent.stdout.readline())
    parent.send_signal(how)
    parent.wait()
    parent.stdout.close()
    end = time.monotonic() + 20.0
    while _runs(worker):
        assert time.monotonic() < end
        time.sleep(0.05)


def _runs(process: int) -> bool:
    stat = Path(f"/proc/{process}/stat")
    try:
        return stat.read_text(encoding="utf-8").split()[2] != "Z"
    except OSError:
        return False
