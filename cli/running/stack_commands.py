"""Commands for a running chair: goto, confirm, pause, go-on, cancel, stop, reset, initial-pose, status."""

from __future__ import annotations

import math
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from waychair.cli.options.stack_options import ChairAddress

if TYPE_CHECKING:
    from waychair.ros.client import ChairClient
    from waychair.ros.messages.chair import DriveReport
    from waychair.slam.localising.localisation import Localisation
    from waychair.types import Pose2

Pose = Annotated[str, Parameter(allow_leading_hyphen=True)]

_ADDRESS = ChairAddress()

_SAME_GOAL_M = 0.05

_DRAWN_S = 2.0
"""Time in which the navigator reads a place that was added while it runs."""

_NEEDED = ("bridge", "mapper", "navigator")
"""The nodes without which no chair drives."""

_DISCOVERED_S = 3.0
"""Time in which this program discovers the nodes that run."""

_PLACED_S = 2.0
"""Time to wait for a localisation, which comes 25 times a second once there is one."""

_LOCALISED_S = 5.0
"""Time in which the mapper localises the chair at a pose that was set."""


def goto_command(
    *goals: Pose,
    yes: bool = False,
    wait: bool = True,
    cancel_on_exit: bool = False,
    timeout: float = 600.0,
    address: ChairAddress = _ADDRESS,
) -> None:
    """Send the running chair to places, one after the other.

    Ctrl-C ends this command, not the drive, unless --cancel-on-exit is given.

    Parameters
    ----------
    goals
        Names of places, or X,Y or X,Y,YAW in metres and radians.
    yes
        Confirm the goal, too: you watch the chair now.
    wait
        Wait until the chair has arrived; --no-wait ends the command as soon as the goal is accepted.
    cancel_on_exit
        Cancel the drive if this command is ended before the chair has arrived, by Ctrl-C for instance.
    timeout
        Time limit of each drive, in seconds; the drive is cancelled then.
    """
    from waychair.cli.options.arguments import BadArgument

    if not goals:
        raise BadArgument("name a place to go to, or X,Y,YAW; `waychair places` lists them")
    if not wait and (len(goals) > 1 or cancel_on_exit):
        raise BadArgument("--no-wait sends one goal and leaves: omit it, the other goals and --cancel-on-exit")
    with address.client() as client:
        client.wait_until_active()
        poses = [_pose(client, text) for text in goals]
        for text, pose in zip(goals, poses, strict=True):
            if not client.go_to_pose(pose):
                _fail(f"the goal '{text}' was refused; see `waychair status`")
            with _ended_by_user(client, text, cancel_on_exit):
                _begin(client, yes)
                if wait:
                    _wait_for_end(client, text, timeout)
                else:
                    print(
                        f"{text}: the goal is accepted; `waychair status` tells more, `waychair cancel` ends the drive"
                    )


def confirm_command(goal: Pose | None = None, /, *, address: ChairAddress = _ADDRESS) -> None:
    """Confirm the waiting goal for the rider, and no other goal that comes meanwhile.

    Parameters
    ----------
    goal
        Confirm only if the waiting goal is this place or pose; default any goal, whose name is printed.
    """
    with address.client() as client:
        state = client.drive_state()
        named = _goal_name(client, state)
        if goal is not None and _distance(_pose(client, goal), state.goal) > _SAME_GOAL_M:
            _fail(f"the waiting goal is {named}: check it, then confirm that one")
        done, sentence = client.confirm(goal_id=state.goal_id)
    if not done:
        _fail(sentence)
    print(f"{named}: {sentence}")


def cancel_command(*, address: ChairAddress = _ADDRESS) -> None:
    """Cancel the drive; the chair stops gently."""
    _ask(address, "cancel")


def pause_command(*, address: ChairAddress = _ADDRESS) -> None:
    """Pause the drive: the chair stops and keeps its goal until `waychair go-on`."""
    _ask(address, "pause")


def go_on_command(*, address: ChairAddress = _ADDRESS) -> None:
    """Continue the paused drive, or take the other way that the chair offers."""
    _ask(address, "go_on")


def stop_command(*, address: ChairAddress = _ADDRESS) -> None:
    """Stop the chair, as the rider's Stop does: the computer lets go, and the joystick is live."""
    _ask(address, "stop")


def reset_command(*, address: ChairAddress = _ADDRESS) -> None:
    """Reset latched faults, after somebody has repaired their cause; the chair does not move."""
    _ask(address, "reset_faults")


def initial_pose_command(pose: Pose, /, *, address: ChairAddress = _ADDRESS) -> None:
    """Tell the chair where it stands on its map.

    Parameters
    ----------
    pose
        Name of a place, or X,Y or X,Y,YAW in metres and radians.
    """
    with address.client() as client:
        given = _pose(client, pose)
        found = client.relocalise(given, _LOCALISED_S)
    print(_place_line(found))
    if found.lost:
        _fail(f"the scans do not fit the map at {pose}: give the pose more exactly")


def status_command(*, json: bool = False, address: ChairAddress = _ADDRESS) -> None:
    """Print the chair's pose and its certainty, the drive mode, and the reasons that prevent a drive.

    Parameters
    ----------
    json
        Print JSON.
    """
    import json as writer

    with address.client() as client:
        state = client.drive_state()
        found, refused_pose, unknown = _place(client)
        goal = _goal_name(client, state) if state.driving or state.waits else None
        running = client.nodes(_NEEDED, _DISCOVERED_S)
    missing = [name for name in _NEEDED if name not in running]
    starting = _starting(missing, found is None)
    if json:
        facts = {
            "starting": starting,
            "pose": None if found is None else found.map_from_base.array().tolist(),
            "localisation": None if found is None else found.state.value,
            "health": None if found is None else found.health,
            "mode": state.mode.value,
            "reason": state.reason,
            "goal": goal,
            "last_stop": state.last_stop,
            "last_goal": state.last_goal,
            "refused_pose": refused_pose,
            "ready": state.ready and not starting,
            "halts": dict(state.halts),
        }
        print(writer.dumps(facts))
        return
    lines = [
        ("starting", starting),
        ("place", unknown if found is None else _place_line(found)),
        ("mode", f"{state.mode.value}{': ' if state.reason else ''}{state.reason}"),
        ("next", _next(state, goal or "")),
        ("last goal", state.last_goal),
        ("initial pose", refused_pose),
        ("last stop", state.last_stop and f"{state.last_stop}; run `waychair why` for more"),
        *state.halts,
        ("ready", "" if state.halts or starting else "nothing prevents a drive"),
    ]
    for name, text in lines:
        if text:
            print(f"{name:13s} {text}")


def _starting(missing: list[str], unplaced: bool) -> str:
    """Return why the chair is not ready yet, from the nodes that are missing and whether its place is unknown."""
    if missing:
        return f"{' and '.join(missing)} {'does' if len(missing) == 1 else 'do'} not run yet"
    return "the chair does not know its place yet" if unplaced else ""


def _place(client: ChairClient) -> tuple[Localisation | None, str, str]:
    """Return the localisation, why the last initial pose was refused, and why there is no localisation yet."""
    from waychair.errors import RosError

    try:
        return client.localisation(_PLACED_S), client.refused_pose(), ""
    except RosError as error:
        told = client.report("mapper", "localisation")
        return None, "", f"unknown yet: {told.message if told is not None and told.message else error}"


def _place_line(found: Localisation) -> str:
    """Return a pose and its certainty as text."""
    at = found.map_from_base
    return f"{at.x:.2f}, {at.y:.2f}, {at.theta:.2f} ({found.state.value}, {found.health:.0%})"


def _next(state: DriveReport, goal: str) -> str:
    """Return the chair's next action as text."""
    if state.driving:
        return "it follows a page's joystick" if state.steered else f"it drives to {goal}"
    if state.waits:
        return f"it waits for the rider's confirmation of {goal}"
    return "it waits for a goal"


def _ask(address: ChairAddress, service: str) -> None:
    """Call a service of the running chair that needs no more than its name, and print its sentence."""
    with address.client() as client:
        done, sentence = client.trigger(service)
    if not done:
        _fail(sentence)
    print(sentence)


@contextmanager
def _ended_by_user(client: ChairClient, goal: str, cancels: bool) -> Iterator[None]:
    """Cancel the drive if the user ends the block, or say that the chair drives on and how to end that."""
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, signal.default_int_handler)
    try:
        yield
    except KeyboardInterrupt as stop:
        if cancels:
            client.cancel_task()
            stop.add_note(f"the drive to {goal} was cancelled")
        elif client.drive_state().driving:
            stop.add_note(f"the chair DRIVES ON to {goal}: `waychair stop` stops it at once, `waychair cancel` gently")
        else:
            stop.add_note(f"the goal {goal} still waits for the rider's confirmation: `waychair cancel` withdraws it")
        raise


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


def _wait_for_end(client: ChairClient, goal: str, timeout_s: float) -> None:
    """Wait until the chair has arrived, and print where.

    Raises:
        RosError: the drive ended elsewhere, or was cancelled after `timeout_s`.
    """
    from waychair.ros.messages.outcomes import TaskResult

    ends = time.monotonic() + timeout_s
    while not client.is_task_complete(0.2):
        if time.monotonic() > ends:
            client.cancel_task()
            _fail(f"'{goal}' was not reached within {timeout_s:g} s; the drive was cancelled")
    ended = client.result()
    if ended.result is not TaskResult.SUCCEEDED:
        _fail(f"'{goal}' was not reached: {ended.reason or ended.result.name.lower()}")
    at = client.localisation().map_from_base
    print(f"{goal}: reached, {at.x:.2f}, {at.y:.2f}, {at.theta:.2f}")


def _pose(client: ChairClient, text: str) -> Pose2:
    """Return the pose of a place of the running chair's map, or the pose that the text gives."""
    from waychair.cli.options.arguments import place_from_text
    from waychair.errors import UnknownPlace

    try:
        return place_from_text(client.places(), text, "a goal").pose
    except UnknownPlace:
        client.spin(_DRAWN_S)  # it may have been added just now
        return place_from_text(client.places(), text, "a goal").pose


def _goal_name(client: ChairClient, state: DriveReport) -> str:
    """Return the name of the bridge's goal: a place, its coordinates, or "no goal"."""
    if not state.goal_id:
        return "no goal"
    near = {name: _distance(place.pose, state.goal) for name, place in client.places().items()}
    name = min(near, key=near.__getitem__, default="")
    return name if name and near[name] < _SAME_GOAL_M else f"{state.goal.x:.2f}, {state.goal.y:.2f}"


def _distance(one: Pose2, other: Pose2) -> float:
    return math.hypot(one.x - other.x, one.y - other.y)


def _fail(sentence: str) -> None:
    from waychair.errors import RosError

    raise RosError(sentence)
