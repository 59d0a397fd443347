"""`waychair up` and the commands for a running chair: what is refused before anything runs, in one sentence."""

from __future__ import annotations

import fcntl
import subprocess
import sys
from pathlib import Path

import pytest

from waychair.cli.main import app
from waychair.cli.options.arguments import BadArgument
from waychair.cli.options.page_process import check_page_port, port_of_page
from waychair.errors import ConfigError, WaychairError
from waychair.maps.drawn.places import save_places
from waychair.maps.folders.map_drawing import DrawnFiles
from waychair.ros.node_settings.sections import NODES
from waychair.ros.parameter_files import parameters_of_nodes, read_parameter_file
from waychair.ros.shared_memory import remove_dead_segments
from waychair.ros.stack import Stack, processes
from waychair.runtime.processes import CANNOT_START, Process, Supervision
from waychair.types import Place, Pose2

WORLD = "small_clinic"
STARTED = ("bridge", "mapper", "navigator")


def given(tmp_path: Path, text: str, namespace: str = "") -> dict[str, dict[str, object]]:
    """Return the parameters that a file gives the nodes of a real chair without a page."""
    path = tmp_path / "own.yaml"
    path.write_text(text)
    return parameters_of_nodes(path, NODES, STARTED, namespace)


@pytest.mark.parametrize(
    ("text", "namespace"),
    [
        ("/**/navigator: {ros__parameters: {limiter.max_speed: 0.3}}", ""),
        ("navigator: {ros__parameters: {limiter: {max_speed: 0.3}}}", ""),
        ("/navigator: {ros__parameters: {limiter.max_speed: 0.3}}", ""),
        ("/*/navigator: {ros__parameters: {limiter.max_speed: 0.3}}", "left"),
        ("left: {navigator: {ros__parameters: {limiter.max_speed: 0.3}}}", "/left"),
        ("/left/navigator: {ros__parameters: {limiter.max_speed: 0.3}}", "left"),
    ],
)
def test_a_node_is_named_as_ros_names_it(tmp_path: Path, text: str, namespace: str) -> None:
    assert given(tmp_path, text, namespace) == {"bridge": {}, "mapper": {}, "navigator": {"limiter.max_speed": 0.3}}


def test_a_value_for_all_nodes_reaches_those_that_have_it(tmp_path: Path) -> None:
    found = given(tmp_path, "/**: {ros__parameters: {limiter.max_speed: 0.3, use_sim_time: true}}")
    assert found["bridge"] == found["navigator"] == {"limiter.max_speed": 0.3, "use_sim_time": True}
    assert found["mapper"] == {"use_sim_time": True}


def test_later_lines_outweigh_and_nodes_of_other_runs_may_be_named(tmp_path: Path) -> None:
    lines = [
        "/**: {ros__parameters: {scan_frame: roof}}",
        "/**/mapper: {ros__parameters: {scan_frame: seat}}",
        "/**/simulator: {ros__parameters: {seed: 4}}",
        "/**/recorder: {ros__parameters: {out: x}}",
    ]
    found = given(tmp_path, "\n".join(lines))
    assert (found["mapper"], found["navigator"]) == ({"scan_frame": "seat"}, {"scan_frame": "roof"})


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "/**/navgator: {ros__parameters: {limiter.max_speed: 0.2}}",
            "'/\\*\\*/navgator'; did you mean '/\\*\\*/navigator'",
        ),
        ("/**/mappr: {ros__parameters: {}}", "did you mean '/\\*\\*/mapper'"),
        ("/right/navigator: {ros__parameters: {}}", "nodes are /bridge, /mapper, /navigator"),
        (
            "/**: {ros__parameters: {limiter.max_sped: 0.2}}",
            "no node has the parameter .* did you mean 'limiter.max_speed'",
        ),
        ("/**/navigator: {limiter.max_speed: 0.2}", "needs `ros__parameters:` below it"),
        ("/**/navigator: {ros__parameters: 0.2}", "must hold `name: value` lines"),
        ("/**/navigator: 0.2", "needs `ros__parameters:`"),
        ("- navigator", "must hold a node's name"),
        ("/**/navigator:\n\tros__parameters: {}", "line 2: a tab .*: indent by spaces"),
        ("/**/navigator: {ros__parameters: {a: 1}}\n/**/navigator: {ros__parameters: {b: 1}}", "given twice"),
    ],
)
def test_a_parameter_file_that_ros_would_ignore_or_refuse_late_is_refused_by_name(
    tmp_path: Path, text: str, sentence: str
) -> None:
    with pytest.raises(ConfigError, match=sentence):
        given(tmp_path, text)


@pytest.mark.parametrize("name", ["nowhere.yaml", "."])
def test_a_parameter_file_that_is_none_is_told(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match="cannot read"):
        read_parameter_file(tmp_path / name)
    (tmp_path / "empty.yaml").touch()
    assert read_parameter_file(tmp_path / "empty.yaml") == ()


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        ("limiter.max_speed: 99", "max_speed = 99"),
        ("limiter.max_speed: fast", "float"),
        ("cmera: false", "did you mean 'camera'"),
    ],
)
def test_a_wrong_value_names_the_file_and_the_node_before_any_node_starts(
    tmp_path: Path, value: str, sentence: str
) -> None:
    own = tmp_path / "own.yaml"
    own.write_text(f"/**/navigator: {{ros__parameters: {{{value}}}}}\n")
    with pytest.raises(ConfigError, match=rf"own.yaml: navigator.*{sentence}"):
        processes(Stack(tmp_path, world=WORLD, parameters=own))


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("up", "--map", "m", "--cable", "/dev/ttyUSB0"), "--cable needs --chair"),
        (("up", "--sim", WORLD, "--chair", "nowhere.json"), "cannot read nowhere.json"),
        (("up", "--sim", WORLD, "--params", "nowhere.yaml"), "cannot read nowhere.yaml"),
        (("up", "--sim", WORLD, "--map", "nowhere"), "there is no map at nowhere"),
        (("up", "--sim", WORLD, "--page-port", "99999"), "--page-port 99999 is no port: choose 1 to 65535"),
        (("page", "--port", "99999"), "--port 99999 is no port: choose 1 to 65535"),
        (("goto",), "name a place to go to"),
        (("goto", "bath", "lift", "--no-wait"), "--no-wait sends one goal"),
        (("goto", "bath", "--no-wait", "--cancel-on-exit"), "--no-wait sends one goal"),
    ],
)
def test_a_command_that_cannot_work_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], sentence: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(WaychairError, match=sentence):
        app(list(words), exit_on_error=False, result_action="return_value")
    assert not list(tmp_path.glob("out/up/*.log"))


def test_a_port_of_the_page_that_is_taken_says_why() -> None:
    import socket

    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1]
        with pytest.raises(BadArgument, match=f"--page-port {number} is taken: choose another port"):
            port_of_page(number)
    check_page_port(65_535, "--port")
    with pytest.raises(BadArgument, match="--port 65536 is no port"):
        check_page_port(65_536, "--port")


def test_a_process_that_cannot_start_ends_the_run_at_once(tmp_path: Path) -> None:
    module = tmp_path / "refusing.py"
    module.write_text(f"import sys; sys.exit({CANNOT_START})\n")
    environment = {"PYTHONPATH": str(tmp_path), "PATH": ""}
    said: list[str] = []
    with Supervision([Process("mapper", "refusing")], environment, said.append) as running:
        running_pid = running.pids["mapper"]
        over = ""
        while not over:
            over = running.watch()
    assert over == "'mapper' cannot start"
    assert said == [f"'mapper' runs as process {running_pid}"], "it is not started again"


def test_a_drawing_of_another_program_is_noticed_once(tmp_path: Path) -> None:
    drawn = DrawnFiles(tmp_path)
    assert not drawn.changed()
    save_places(tmp_path, {"lift": Place("lift", Pose2(1.0, 2.0, 0.0))})
    assert drawn.changed()
    assert not drawn.changed()
    save_places(tmp_path, {"bath": Place("bath", Pose2(1.0, 2.0, 0.0))})
    drawn.note()
    assert not drawn.changed()
    (tmp_path / "places.yaml").unlink()
    assert drawn.changed()


def test_ports_of_a_dead_chair_go_while_a_chair_of_another_domain_lives(tmp_path: Path) -> None:
    living, dead = "fastrtps_port7661", "fastrtps_port7911"  # of the domains 1 and 2
    everybodys, segment = "fastrtps_port7000", "fastrtps_0123456789abcdef"
    for name in (living, f"{living}_el", f"sem.{living}_mutex", dead, f"{dead}_el", f"sem.{dead}_mutex", everybodys):
        (tmp_path / name).touch()
    for name in (segment, f"{segment}_el"):
        (tmp_path / name).touch()
    with (tmp_path / f"{living}_el").open() as lock, (tmp_path / f"{segment}_el").open() as owner:
        fcntl.flock(lock, fcntl.LOCK_EX)
        fcntl.flock(owner, fcntl.LOCK_EX)
        assert remove_dead_segments(tmp_path) == 0
        left = {path.name for path in tmp_path.iterdir()}
    assert left == {living, f"{living}_el", f"sem.{living}_mutex", everybodys, segment, f"{segment}_el"}


@pytest.mark.nightly
def test_stop_without_a_chair_says_that_none_runs() -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed (no rclpy)")
    script = "from waychair.cli.main import main; main()"
    told = subprocess.run(
        [sys.executable, "-c", script, "stop", "--domain", "100"], capture_output=True, text=True, check=False
    )
    assert told.returncode == 1
    assert told.stderr.startswith("waychair: no chair runs in ROS domain 100: start one with `waychair up`")
