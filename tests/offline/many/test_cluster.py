"""Recordings on the workers of a Dask cluster on this computer: shared folders, sent recordings, and what dies."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from tests.offline.many.test_many_maps import OPTIONS, ROOT, _text_when_there, _wait_until_gone, bags_of
from tests.ports import free_port, wait_until_open
from waychair.errors import ClusterError
from waychair.offline.many.bags import named_bags
from waychair.offline.many.cluster import ClusterPool, SharedFolder, shared_path
from waychair.offline.many.many_maps import map_many
from waychair.offline.many.outcomes import OutcomeState


@contextmanager
def started(module: str, *arguments: str, cwd: Path | None = None) -> Iterator[subprocess.Popen[bytes]]:
    """Run a part of a cluster during the block."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)])}
    command = [sys.executable, "-m", f"distributed.cli.{module}", *arguments, "--no-dashboard"]
    process = subprocess.Popen(command, env=environment, cwd=cwd, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def cluster(workers: int, folder: Path) -> Iterator[tuple[str, subprocess.Popen[bytes], list[subprocess.Popen[bytes]]]]:
    """Run a scheduler with workers during the block; yield its address and the processes."""
    address = f"tcp://127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        port = address.rpartition(":")[2]
        scheduler = stack.enter_context(started("dask_scheduler", "--host", "127.0.0.1", "--port", port))
        wait_until_open(int(port))
        own = ("--nthreads", "1", "--no-nanny", "--local-directory", str(folder))
        yield address, scheduler, [stack.enter_context(started("dask_worker", address, *own)) for _ in range(workers)]


def test_paths_are_translated_by_the_first_shared_folder_that_holds_them() -> None:
    shared = [SharedFolder("/data/", "/mnt/d"), SharedFolder("/home/me", "/nfs/me/")]
    assert shared_path("/data/run.bag", shared) == "/mnt/d/run.bag"
    assert shared_path("/database/run.bag", shared) == "/database/run.bag"
    assert shared_path("/home/me", shared) == "/nfs/me"


def test_a_cluster_that_is_not_there_is_named_with_advice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("waychair.offline.many.cluster.CONNECT_S", 0.5)
    bags = named_bags(bags_of(tmp_path, one="fine"))[0]
    address = f"tcp://127.0.0.1:{free_port()}"
    with pytest.raises(ClusterError, match=f"there is no cluster at {address}: start one with `dask scheduler`"):
        map_many(bags, tmp_path / "out", OPTIONS, ClusterPool(address))
    with pytest.raises(ClusterError, match="there is no cluster at nowhere"):
        map_many(bags, tmp_path / "out", OPTIONS, ClusterPool("nowhere:x"))


def test_workers_map_what_they_see_and_are_sent_what_they_do_not_see_and_a_killed_worker_costs_nothing(
    tmp_path: Path,
) -> None:
    paths = bags_of(tmp_path, one="fine", two="broken", three="killed 1", slow=f"waits for {tmp_path / 'go'}")
    bags = named_bags(paths)[0]
    with cluster(2, tmp_path / "scratch") as (address, scheduler, workers):
        # no worker sees the folders under these names: it is sent the recordings
        sent = map_many(bags[:3], tmp_path / "sent", OPTIONS, ClusterPool(address, [SharedFolder("/tmp", "/nowhere")]))
        assert {name: outcome.state for name, outcome in sent.outcomes.items()} == {
            "one": OutcomeState.DONE, "two": OutcomeState.FAILED, "three": OutcomeState.DONE,
        }  # fmt: skip
        assert json.loads((tmp_path / "sent" / "three" / "report.json").read_text()) == {"tries": 2}
        assert all(
            outcome.kept
            for outcome in map_many(bags[:3], tmp_path / "sent", OPTIONS, ClusterPool(address)).outcomes.values()
        )

        def told(bag: object, outcome: object, number: int) -> None:
            if number == 3:  # the slow one alone is left: its worker is killed, the other one goes on with it
                pid = int(_text_when_there(tmp_path / "began"))
                parent = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
                (victim,) = [each for each in workers if each.pid == parent]
                victim.send_signal(signal.SIGKILL)
                _wait_until_gone(pid)
                (tmp_path / "go").touch()

        maps = map_many(bags, tmp_path / "out", OPTIONS, ClusterPool(address), told)
        assert maps.outcomes["slow"].state is OutcomeState.DONE
        assert json.loads((tmp_path / "out" / "slow" / "report.json").read_text()) == {"tries": 2}
        (tmp_path / "go").unlink()
        (tmp_path / "began").unlink()

        def kill_scheduler() -> None:
            _text_when_there(tmp_path / "began")
            scheduler.send_signal(signal.SIGKILL)

        killing = threading.Thread(target=kill_scheduler)
        killing.start()
        options = replace(OPTIONS, options=("--odom=none",))
        advice = r"went away: .*; start it again and run the same command, which goes on"
        with pytest.raises(ClusterError, match=advice):
            map_many(bags[3:], tmp_path / "out", options, ClusterPool(address))
        killing.join()
        assert json.loads((tmp_path / "out" / "slow" / "report.json").read_text()) == {"tries": 2}  # the old map, whole
