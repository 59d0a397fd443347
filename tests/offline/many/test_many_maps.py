"""Many recordings: each ends in a whole map or a reason, and the same command goes on after any kill."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from tests.offline.many.quick_mapping import __name__ as QUICK
from waychair.errors import OutputError, RecordingError
from waychair.offline.many.bag_runs import WORK
from waychair.offline.many.bags import listed, named_bags
from waychair.offline.many.many_maps import ManyMaps, MapOptions, map_many
from waychair.offline.many.outcomes import RECORD, OutcomeState
from waychair.offline.many.pools import ProcessPool

ROOT = Path(__file__).resolve().parents[3]
OPTIONS = MapOptions(QUICK)


@pytest.fixture(autouse=True)
def _processes_find_the_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT / "src"), str(ROOT)]))


def bags_of(folder: Path, **texts: str) -> list[Path]:
    """Write recordings of these texts and return their paths."""
    for name, text in texts.items():
        (folder / f"{name}.log").write_text(text)
    return [folder / f"{name}.log" for name in texts]


def mapped(paths: list[Path], out: Path, options: MapOptions = OPTIONS, jobs: int = 2) -> ManyMaps:
    """Map the recordings with quick processes."""
    return map_many(named_bags(paths)[0], out, options, ProcessPool(jobs))


def test_one_that_is_broken_or_gone_stops_none_of_the_others(tmp_path: Path) -> None:
    paths = [*bags_of(tmp_path, one="fine", two="broken", three="fine"), tmp_path / "gone.bag"]
    maps = mapped(paths, tmp_path / "out")
    states = {name: (outcome.state, outcome.why) for name, outcome in maps.outcomes.items()}
    assert states["one"] == states["three"] == (OutcomeState.DONE, "")
    assert states["two"] == (OutcomeState.FAILED, "this recording is broken; record it again")
    assert "there is no recording at" in states["gone"][1]
    assert maps.failed == 2
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"one", "three", WORK, "report.json", "index.html"}
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert [(row["name"], row["state"]) for row in report["recordings"]] == [
        ("one", "done"), ("two", "failed"), ("three", "done"), ("gone", "failed"),
    ]  # fmt: skip
    assert all(row["cpu_s"] > 0 and row["peak_memory_mb"] > 1 for row in report["recordings"][:3])
    page = (tmp_path / "out" / "index.html").read_text()
    assert 'href="one/report.json"' in page
    assert "this recording is broken" in page


def test_what_is_done_or_failed_is_kept_until_the_recording_or_the_options_change(tmp_path: Path) -> None:
    paths = bags_of(tmp_path, one="fine", two="broken")
    first = mapped(paths, tmp_path / "out")
    again = mapped(paths, tmp_path / "out")
    assert all(outcome.kept for outcome in again.outcomes.values())
    assert again.outcomes["one"].seconds == first.outcomes["one"].seconds
    assert not mapped(paths, tmp_path / "out", replace(OPTIONS, retry_failed=True)).outcomes["two"].kept
    assert not mapped(paths, tmp_path / "out", replace(OPTIONS, options=("--odom=none",))).outcomes["one"].kept
    paths[1].write_text("mended")
    mended = mapped(paths, tmp_path / "out", replace(OPTIONS, options=("--odom=none",))).outcomes
    assert mended["one"].kept
    assert (mended["two"].state, mended["two"].kept) == (OutcomeState.DONE, False)


def test_a_killed_process_goes_on_once_from_its_checkpoint(tmp_path: Path) -> None:
    maps = mapped(bags_of(tmp_path, once="killed 1", ever="always killed"), tmp_path / "out")
    assert maps.outcomes["once"].state is OutcomeState.DONE
    assert json.loads((tmp_path / "out" / "once" / "report.json").read_text()) == {"tries": 2}
    ever = maps.outcomes["ever"]
    assert (ever.state, ever.why[:36]) == (OutcomeState.STOPPED, "its process was killed by signal 9, ")
    (tmp_path / "ever.log").write_text("killed 9")  # not remembered as a failure, nor would the same text be
    assert mapped([tmp_path / "ever.log"], tmp_path / "out").outcomes["ever"].state is OutcomeState.DONE


def test_after_kill_9_of_the_command_its_processes_end_and_the_same_command_goes_on(tmp_path: Path) -> None:
    (path,) = bags_of(tmp_path, slow=f"waits for {tmp_path / 'go'}")
    program = (
        "import sys; from pathlib import Path\n"
        "from tests.offline.many.test_many_maps import mapped\n"
        "mapped([Path(sys.argv[1])], Path(sys.argv[2]))"
    )
    command = [sys.executable, "-c", program, str(path), str(tmp_path / "out")]
    with subprocess.Popen(command, cwd=ROOT) as run:
        pid = int(_text_when_there(tmp_path / "began"))
        with pytest.raises(OutputError, match="another waychair map-all writes into"):
            mapped([path], tmp_path / "out")
        run.send_signal(signal.SIGKILL)
    _wait_until_gone(pid)
    assert not (tmp_path / "out" / "slow").exists()  # half a map is never in its place
    (tmp_path / "go").touch()
    outcome = mapped([path], tmp_path / "out").outcomes["slow"]
    assert (outcome.state, outcome.kept) == (OutcomeState.DONE, False)
    assert json.loads((tmp_path / "out" / "slow" / "report.json").read_text()) == {"tries": 2}


def test_a_finished_map_that_was_not_in_its_place_yet_is_put_there(tmp_path: Path) -> None:
    paths = bags_of(tmp_path, one="fine")
    fingerprint = mapped(paths, tmp_path / "out").outcomes["one"].fingerprint
    (tmp_path / "out" / "one").rename(tmp_path / "out" / WORK / f"one.{fingerprint[:12]}")
    assert mapped(paths, tmp_path / "out").outcomes["one"].kept
    assert (tmp_path / "out" / "one" / "map.pgm").is_file()


def test_folders_of_others_and_drawn_maps_are_left_alone(tmp_path: Path) -> None:
    paths = bags_of(tmp_path, mine="fine", drawn="fine")
    (tmp_path / "out" / "mine").mkdir(parents=True)
    (tmp_path / "out" / "mine" / "thesis.tex").write_text("years of work")
    maps = mapped(paths, tmp_path / "out")
    assert "is there already, and not from this command" in maps.outcomes["mine"].why
    assert (tmp_path / "out" / "mine" / "thesis.tex").read_text() == "years of work"
    (tmp_path / "out" / "drawn" / "places.yaml").write_text("desk: {x: 1.0, y: 2.0, yaw: 0.0}\n")
    paths[1].write_text("driven again")
    assert "places, zones or erased parts" in mapped(paths, tmp_path / "out").outcomes["drawn"].why
    assert (tmp_path / "out" / "drawn" / "places.yaml").is_file()


def test_an_interrupt_ends_the_processes_and_keeps_finished_maps(tmp_path: Path) -> None:
    paths = bags_of(tmp_path, one="fine", slow=f"waits for {tmp_path / 'go'}")

    def told(bag: object, outcome: object, number: int) -> None:
        _text_when_there(tmp_path / "began")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        map_many(named_bags(paths)[0], tmp_path / "out", OPTIONS, ProcessPool(2), told)
    _wait_until_gone(int((tmp_path / "began").read_text()))
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert {row["name"]: row["state"] for row in report["recordings"]} == {"one": "done", "slow": "waiting"}


def test_recordings_alike_in_name_get_folders_that_do_not_depend_on_their_order(tmp_path: Path) -> None:
    paths = [tmp_path / "ward a" / "run.bag", tmp_path / "ward b" / "run.bag", tmp_path / "run.clf.gz"]
    for path in paths:
        path.parent.mkdir(exist_ok=True)
        path.touch()
    bags, told = named_bags([*paths, paths[0]])
    assert [bag.path for bag in bags] == paths
    names = [bag.name for bag in bags]
    assert names == ["ward_a-run", "ward_b-run", "run.clf.gz"]
    assert "is given twice" in told[0]
    assert len(told) == 4
    backwards = {bag.path: bag.name for bag in named_bags(paths[::-1])[0]}
    assert [backwards[path] for path in paths] == names


def test_a_list_names_recordings_as_seen_from_its_folder(tmp_path: Path) -> None:
    text = "# of Monday\n\nrun.bag\n/data/other.bag\n"
    (tmp_path / "list.txt").write_text(text)
    assert listed([tmp_path / "list.txt", Path("own.log")]) == (
        tmp_path / "run.bag", Path("/data/other.bag"), Path("own.log"),
    )  # fmt: skip
    (tmp_path / "list.txt").write_text("# none\n")
    with pytest.raises(RecordingError, match="lists no recording"):
        listed([tmp_path / "list.txt"])


def test_a_map_without_its_record_or_report_is_made_again(tmp_path: Path) -> None:
    paths = bags_of(tmp_path, one="fine")
    mapped(paths, tmp_path / "out")
    (tmp_path / "out" / "one" / "report.json").unlink()
    assert not mapped(paths, tmp_path / "out").outcomes["one"].kept
    (tmp_path / "out" / "one" / RECORD).write_text("{half")
    assert "not from this command" in mapped(paths, tmp_path / "out").outcomes["one"].why


def _text_when_there(path: Path) -> str:
    while not path.exists() or not path.read_text():
        time.sleep(0.02)
    return path.read_text()


def _wait_until_gone(pid: int) -> None:
    while True:
        try:
            os.kill(pid, 0)
            if Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z":
                return
        except (ProcessLookupError, FileNotFoundError):
            return
        time.sleep(0.02)
