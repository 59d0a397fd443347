"""Commands for a chair that runs: start its nodes, send it somewhere, ask how it is."""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from waychair.ros.client import ChairClient

Pose = Annotated[str, Parameter(allow_leading_hyphen=True)]

_WATCH_S = 0.05

WARNING = """\
waychair is research software, not a medical device. Modifying a wheelchair may void its approval. Somebody must walk
beside the chair, within reach of an emergency stop that cuts its motors. First the simulator, then wheels off the
ground, then a dummy load, then a walking spotter, and only then a rider."""


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
    seed: int = 0,
    unattended: bool = False,
    urgent: bool = False,
    lan: bool = False,
    domain: int | None = None,
    params: Path | None = None,
    out: Path = Path("out/up"),
) -> None:
    """Start all nodes of a chair, and keep them running until Ctrl-C or SIGTERM.

    Parameters
    ----------
    sim
        Simulate a chair in this world (see `waychair worlds`), in real time.
    map
        Map folder to drive on; a simulated chair without one is given its world's own plan.
    mapping
        Make a map on the way.
    chair
        A real chair's calibration file.
    cable
        Port of a real chair's board: /dev/ttyUSB0, pty:PATH or tcp:HOST:PORT.
    start
        X,Y,YAW where the chair stands; by default where it stood last, or it finds itself.
    camera
        With a camera.
    people
        With the world's people.
    seed
        Seed of the simulated chair.
    unattended
        Of a simulated chair: a goal needs no yes.
    urgent
        Real-time priority for the nodes, where the system grants it: on a computer that does other things, too.
    lan
        Let other computers on the network see the nodes; without security keys no speeds are obeyed then.
    domain
        ROS domain, 0 to 101.
    params
        A ROS parameter file.
    out
        Folder for the run's files.
    """
    from waychair.cli.arguments import BadArgument, pose_from_text
    from waychair.errors import RosError
    from waychair.ros.environment import is_secured, ros_environment
    from waychair.ros.interface_types import interface_type
    from waychair.ros.stack import Stack, processes
    from waychair.runtime.processes import Supervision, signalled

    if unattended and sim is None:
        raise BadArgument("--unattended is for simulated chairs: whoever sits in a real one says yes")
    environment = ros_environment(domain=domain, lan=lan)
    deaf = lan and not is_secured(environment)
    stack = Stack(
        out, sim or "", map, mapping, chair, cable, camera, people, seed, unattended, deaf,
        None if start is None else pose_from_text(start, "--start"), params, urgent,
    )  # fmt: skip
    table = processes(stack)
    interface_type("waychair_msgs/msg/DriveState")  # built here, or every node would wait for the first
    print(WARNING, file=sys.stderr)
    if lan:
        print(
            "The nodes can be seen from the whole network: map, pictures, scans and goals. "
            + ("No speeds are obeyed, since there are no security keys." if deaf else "Messages are signed."),
            file=sys.stderr,
        )
    ending = signalled(signal.SIGINT, signal.SIGTERM)
    with Supervision(table, environment, lambda sentence: print(f"waychair: {sentence}", file=sys.stderr)) as running:
        while not ending():
            time.sleep(_WATCH_S)
            if over := running.watch():
                raise RosError(f"{over}: see its messages above")


def goto_command(*goals: Pose, yes: bool = False, timeout: float = 600.0, domain: int | None = None) -> None:
    """Send the running chair to places, one after the other.

    Parameters
    ----------
    goals
        Names of places, or X,Y or X,Y,YAW in metres and radians.
    yes
        Say the rider's yes as well: somebody is watching the chair now.
    timeout
        Seconds for each drive.
    domain
        ROS domain of the chair.
    """
    from waychair.cli.arguments import BadArgument, pose_from_text
    from waychair.maps.places import find
    from waychair.ros.client import ChairClient, TaskResult

    if not goals:
        raise BadArgument("name a place to go to, or X,Y,YAW; `waychair places` lists them")
    with ChairClient(domain=domain) as client:
        client.wait_until_active()
        known = client.places()
        poses = []
        for text in goals:
            is_pose = "," in text and text not in known
            poses.append(pose_from_text(text, "a goal") if is_pose else find(known, text).pose)
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


def confirm_command(*, domain: int | None = None) -> None:
    """Say the rider's yes to the goal that waits.

    Parameters
    ----------
    domain
        ROS domain of the chair.
    """
    from waychair.ros.client import ChairClient

    with ChairClient(domain=domain) as client:
        done, sentence = client.confirm()
    if not done:
        _fail(sentence)
    print(sentence)


def cancel_command(*, domain: int | None = None) -> None:
    """End the drive; the chair comes to rest.

    Parameters
    ----------
    domain
        ROS domain of the chair.
    """
    from waychair.ros.client import ChairClient

    with ChairClient(domain=domain) as client:
        print(client.cancel()[1])


def status_command(*, json: bool = False, domain: int | None = None) -> None:
    """Where the chair is, how sure it is of that, who drives, and what stands against a drive.

    Parameters
    ----------
    json
        Print JSON.
    domain
        ROS domain of the chair.
    """
    import json as writer

    from waychair.ros.client import ChairClient

    with ChairClient(domain=domain) as client:
        state, found = client.drive_state(), client.localisation()
    pose = found.map_from_base
    if json:
        facts = {
            "pose": [pose.x, pose.y, pose.theta],
            "localisation": found.state.value,
            "health": found.health,
            "mode": state.mode.value,
            "reason": state.reason,
            "ready": state.ready,
            "halts": dict(state.halts),
        }
        print(writer.dumps(facts))
        return
    print(f"place         {pose.x:.2f}, {pose.y:.2f}, {pose.theta:.2f} ({found.state.value}, {found.health:.0%})")
    print(f"mode          {state.mode.value}{': ' if state.reason else ''}{state.reason}")
    for stop_id, sentence in state.halts:
        print(f"{stop_id:13s} {sentence}")
    if not state.halts:
        print("ready         nothing stands against a drive")


def _begin(client: ChairClient, yes: bool) -> None:
    """Wait for the bridge to know of the goal, and say yes to it or ask for it."""
    if not yes:
        print("waiting for the rider's yes: press Drive, or `waychair confirm`", file=sys.stderr)
        return
    said = ""
    for _ in range(20):
        begun, said = client.confirm()
        if begun or client.is_task_complete(0.1):
            return
    _fail(f"the drive does not begin: {said}")


def _fail(sentence: str) -> None:
    from waychair.errors import RosError

    raise RosError(sentence)
