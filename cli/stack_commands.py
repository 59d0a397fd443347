"""Commands for a running chair: `waychair up`, goto, confirm, pause, go-on, cancel and status."""

from __future__ import annotations

import math
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from waychair.cli.options.arguments import NonNegativeInt

if TYPE_CHECKING:
    from waychair.ros.client import ChairClient
    from waychair.ros.messages.chair import DriveReport
    from waychair.types import Pose2

Pose = Annotated[str, Parameter(allow_leading_hyphen=True)]

_WATCH_S = 0.05
_SAME_GOAL_M = 0.05

WARNING = """\
waychair is research software, not a medical device. Modifying a wheelchair may void its approval. A person must walk
beside the chair, within reach of an emergency stop that cuts its motors. Test first in the simulator, then with the
wheels off the ground, then with a dummy load and a walking spotter, and only then with a rider."""


def up_command(
    *,
    sim: str | None = None,
    map: Path | None = None,
    mapping: bool = False,
    chair: Path | None = None,
    cable: str = "",
    start: Pose | None = None,
    camera: bool = True,
    people: bool = True,
    seed: NonNegativeInt = 0,
    unattended: bool = False,
    urgent: bool = False,
    lan: bool = False,
    domain: NonNegativeInt | None = None,
    namespace: str = "",
    config: Path | None = None,
    params: Path | None = None,
    out: Path = Path("out/up"),
    box: Path | None = None,
    no_box: Annotated[bool, Parameter(negative=())] = False,
    page: bool | None = None,
    page_port: NonNegativeInt | None = None,
    page_lan: bool = False,
    page_name: tuple[str, ...] = (),
    token: str | None = None,
) -> None:
    """Start all ROS nodes of a chair, and keep them running until Ctrl-C or SIGTERM.

    Parameters
    ----------
    sim
        Simulate a chair in this world (see `waychair worlds`), in real time.
    map
        Map folder to drive on; the default of a simulated chair is its world's plan.
    mapping
        Make a map during the drive.
    chair
        A real chair's calibration file.
    cable
        Port of a real chair's board: /dev/ttyUSB0, pty:PATH or tcp:HOST:PORT.
    start
        X,Y,YAW: the chair's pose; default its last pose, else it relocalises.
    camera
        Simulate or use a camera.
    people
        Simulate the world's people.
    seed
        Seed of the simulated chair.
    unattended
        Let a simulated chair drive to goals without confirmation.
    urgent
        Real-time priority for the nodes, if the system grants it; useful on a busy computer.
    lan
        Let other computers on the network see the nodes; without security keys, velocity commands are then ignored.
    domain
        ROS domain, 0 to 101.
    namespace
        Prefix for the names of all nodes and topics, for several chairs in one domain.
    config
        YAML file with settings that differ from the defaults (see `waychair config`).
    params
        A ROS parameter file, which overrides --config.
    out
        Folder for the run's files.
    box
        Folder of the black box for `waychair why`; default `box` in the run's folder.
    no_box
        Write no black box.
    page
        Serve the rider's page; default if the extra [ui] is installed.
    page_port
        Port of the page; default 8000, or a free port if that is taken.
    page_lan
        Let other computers on the network open the page with the token; the nodes stay hidden.
    page_name
        Further host name by which --page-lan may be opened, such as chair.lan; may be repeated. Numbers and NAME.local
        always work.
    token
        Token for --page-lan; default a random one, which is printed.
    """
    from waychair.cli.options.arguments import BadArgument, pose_from_text
    from waychair.cli.options.configuration import load_configuration
    from waychair.cli.options.page_process import TOKEN, has_ui, page_names, page_sentence, page_token, port_of_page
    from waychair.errors import MissingExtra, RosError
    from waychair.maps.drawn.zones import check_zones, load_zones
    from waychair.maps.folders.map_files import load_map
    from waychair.ros.environment import is_secured, ros_environment
    from waychair.ros.interface_types import interface_type
    from waychair.ros.shared_memory import remove_dead_segments
    from waychair.ros.stack import Stack, node_parameters, processes
    from waychair.runtime.processes import Supervision, signalled

    if page and not has_ui():
        raise MissingExtra("the page needs the extra [ui]: pip install 'waychair[ui]'")
    if unattended and sim is None:
        raise BadArgument("--unattended needs --sim: the rider of a real chair confirms each goal")
    if map is not None:
        check_zones(load_zones(map), load_map(map))  # here, else each node would report the error and exit
    page_names(page_name, page_lan)  # refused here, before anything is started
    configured = load_configuration(config)
    environment = ros_environment(domain=domain, lan=lan)
    deaf = lan and not is_secured(environment)
    stack = Stack(
        folder=out,
        world=sim or "",
        map_folder=map,
        mapping=mapping,
        calibration=chair,
        cable=cable,
        camera=camera,
        people=people,
        seed=seed,
        unattended=unattended,
        ignore_commands=deaf,
        start=None if start is None else pose_from_text(start, "--start"),
        parameters=params,
        urgent=urgent,
        box=None if no_box else box or out / "box",
        page_port=port_of_page(page_port) if page or (page is None and has_ui()) else None,
        page_host="0.0.0.0" if page_lan else "127.0.0.1",
        page_names=page_name,
        namespace=namespace,
        settings=node_parameters(configured.chair, configured.map, configured.simulation, configured.nodes),
    )
    table = processes(stack)
    environment = {**environment, TOKEN: page_token(page_lan, token)}
    interface_type("waychair_msgs/msg/DriveState")  # built here, else all nodes would wait for the first
    print(WARNING, file=sys.stderr)
    if lan:
        print(
            "The whole network can see the nodes: map, pictures, scans and goals. "
            + ("Velocity commands are ignored, as there are no security keys." if deaf else "Messages are signed."),
            file=sys.stderr,
        )
    if stack.page_port is not None:
        said = page_sentence(stack.page_port, page_lan, environment[TOKEN], page_name)
        print(f"waychair: {said}", file=sys.stderr)
    remove_dead_segments()
    ending = signalled(signal.SIGINT, signal.SIGTERM)
    with Supervision(table, environment, lambda sentence: print(f"waychair: {sentence}", file=sys.stderr)) as running:
        while not ending():
            time.sleep(_WATCH_S)
            if over := running.watch():
                raise RosError(f"{over}: see its messages above")


def goto_command(
    *goals: Pose, yes: bool = False, timeout: float = 600.0, domain: NonNegativeInt | None = None, namespace: str = ""
) -> None:
    """Send the running chair to places, one after the other.

    Parameters
    ----------
    goals
        Names of places, or X,Y or X,Y,YAW in metres and radians.
    yes
        Confirm the goal, too: you watch the chair now.
    timeout
        Time limit of each drive, in seconds.
    domain
        ROS domain of the chair.
    namespace
        Namespace of the chair's nodes.
    """
    from waychair.cli.options.arguments import BadArgument
    from waychair.ros.client import ChairClient, TaskResult

    if not goals:
        raise BadArgument("name a place to go to, or X,Y,YAW; `waychair places` lists them")
    with ChairClient(domain=domain, namespace=namespace) as client:
        client.wait_until_active()
        poses = [_pose(client, text) for text in goals]
        for text, pose in zip(goals, poses, strict=True):
            if not client.go_to_pose(pose):
                _fail(f"the goal '{text}' was refused; see `waychair status`")
            _begin(client, yes)
            ends = time.monotonic() + timeout
            while not client.is_task_complete(0.2):
                if time.monotonic() > ends:
                    client.cancel_task()
                    _fail(f"'{text}' was not reached within {timeout:g} s; the drive was cancelled")
            ended = client.result()
            if ended.result is not TaskResult.SUCCEEDED:
                _fail(f"'{text}' was not reached: {ended.reason or ended.result.name.lower()}")
            at = client.localisation().map_from_base
            print(f"{text}: reached, {at.x:.2f}, {at.y:.2f}, {at.theta:.2f}")


def confirm_command(goal: Pose | None = None, /, *, domain: NonNegativeInt | None = None, namespace: str = "") -> None:
    """Confirm the waiting goal for the rider, and no other goal that comes meanwhile.

    Parameters
    ----------
    goal
        Confirm only if the waiting goal is this place or pose; default any goal, whose name is printed.
    domain
        ROS domain of the chair.
    namespace
        Namespace of the chair's nodes.
    """
    from waychair.ros.client import ChairClient

    with ChairClient(domain=domain, namespace=namespace) as client:
        state = client.drive_state()
        named = _named(client, state)
        if goal is not None and _distance(_pose(client, goal), state.goal) > _SAME_GOAL_M:
            _fail(f"the waiting goal is {named}: check it, then confirm that one")
        done, sentence = client.confirm(goal_id=state.goal_id)
    if not done:
        _fail(sentence)
    print(f"{named}: {sentence}")


def cancel_command(*, domain: NonNegativeInt | None = None, namespace: str = "") -> None:
    """Cancel the drive; the chair stops.

    Parameters
    ----------
    domain
        ROS domain of the chair.
    namespace
        Namespace of the chair's nodes.
    """
    from waychair.ros.client import ChairClient

    with ChairClient(domain=domain, namespace=namespace) as client:
        print(client.cancel()[1])


def pause_command(*, domain: NonNegativeInt | None = None, namespace: str = "") -> None:
    """Pause the drive: the chair stops and keeps its goal until `waychair go-on`.

    Parameters
    ----------
    domain
        ROS domain of the chair.
    namespace
        Namespace of the chair's nodes.
    """
    from waychair.ros.client import ChairClient

    with ChairClient(domain=domain, namespace=namespace) as client:
        _say(client.pause())


def go_on_command(*, domain: NonNegativeInt | None = None, namespace: str = "") -> None:
    """Continue the paused drive.

    Parameters
    ----------
    domain
        ROS domain of the chair.
    namespace
        Namespace of the chair's nodes.
    """
    from waychair.ros.client import ChairClient

    with ChairClient(domain=domain, namespace=namespace) as client:
        _say(client.go_on())


def _say(answer: tuple[bool, str]) -> None:
    done, sentence = answer
    if not done:
        _fail(sentence)
    print(sentence)


def status_command(*, json: bool = False, domain: NonNegativeInt | None = None, namespace: str = "") -> None:
    """Print the chair's pose and its certainty, the drive mode, and the reasons that prevent a drive.

    Parameters
    ----------
    json
        Print JSON.
    domain
        ROS domain of the chair.
    namespace
        Namespace of the chair's nodes.
    """
    import json as writer

    from waychair.ros.client import ChairClient

    with ChairClient(domain=domain, namespace=namespace) as client:
        state, found = client.drive_state(), client.localisation()
        goal = _named(client, state)
    pose = found.map_from_base
    if json:
        facts = {
            "pose": [pose.x, pose.y, pose.theta],
            "localisation": found.state.value,
            "health": found.health,
            "mode": state.mode.value,
            "reason": state.reason,
            "goal": goal if state.driving or state.waits else None,
            "last_stop": state.last_stop,
            "ready": state.ready,
            "halts": dict(state.halts),
        }
        print(writer.dumps(facts))
        return
    print(f"place         {pose.x:.2f}, {pose.y:.2f}, {pose.theta:.2f} ({found.state.value}, {found.health:.0%})")
    print(f"mode          {state.mode.value}{': ' if state.reason else ''}{state.reason}")
    print(f"next          {_next(state, goal)}")
    if state.last_stop:
        print(f"last stop     {state.last_stop}; run `waychair why` for more")
    for stop_id, sentence in state.halts:
        print(f"{stop_id:13s} {sentence}")
    if not state.halts:
        print("ready         nothing prevents a drive")


def _next(state: DriveReport, goal: str) -> str:
    """Return the chair's next action as text."""
    if state.driving:
        return "it follows a page's joystick" if state.steered else f"it drives to {goal}"
    if state.waits:
        return f"it waits for the rider's confirmation of {goal}"
    return "it waits for a goal"


def _pose(client: ChairClient, text: str) -> Pose2:
    """Return the pose of a place of the running chair's map, or the pose that the text gives."""
    from waychair.cli.options.arguments import pose_from_text
    from waychair.maps.drawn.places import find

    known = client.places()
    return pose_from_text(text, "a goal") if "," in text and text not in known else find(known, text).pose


def _named(client: ChairClient, state: DriveReport) -> str:
    """Return the name of the bridge's goal: a place, its coordinates, or "no goal"."""
    if not state.goal_id:
        return "no goal"
    near = {name: _distance(place.pose, state.goal) for name, place in client.places().items()}
    name = min(near, key=near.__getitem__, default="")
    return name if name and near[name] < _SAME_GOAL_M else f"{state.goal.x:.2f}, {state.goal.y:.2f}"


def _distance(one: Pose2, other: Pose2) -> float:
    return math.hypot(one.x - other.x, one.y - other.y)


def _begin(client: ChairClient, yes: bool) -> None:
    """With `yes` confirm the goal once the bridge knows it, else ask the user for the confirmation."""
    if not yes:
        print("waiting for the rider's confirmation: press Drive, or run `waychair confirm`", file=sys.stderr)
        return
    said = ""
    for _ in range(20):
        begun, said = client.confirm()
        if begun or client.is_task_complete(0.1):
            return
    _fail(f"the drive did not start: {said}")


def _fail(sentence: str) -> None:
    from waychair.errors import RosError

    raise RosError(sentence)
